#!/usr/bin/python3
"""igtl_bridge and its tools: every message type, their state, requests, and the bridge as a client of a tracker."""
import os
import sys
import time
import unittest

import numpy as np
import rospy
import rostest
from cortshift_msgs.msg import ShiftSummary, StageInfo
from cortshift_msgs.srv import (CaptureStage, CaptureStageResponse, ComputeShift, ComputeShiftResponse, ListStages,
                                ListStagesResponse)
from tf2_msgs.msg import TFMessage

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import wait_until  # noqa: E402
from igtl_bridge import MICROMETRE, Bridge, BridgeTest, Tracker, pose_mm, quaternion_matrix, quaternion_of  # noqa: E402
from igtl_client import Port  # noqa: E402
from igtl_messages import Command, GetStatus, Position, Status, String, TrackingData  # noqa: E402


class IgtlTools(BridgeTest, unittest.TestCase):
    def test_tools_in_every_message_type(self):
        matrix = pose_mm([1, 1, 2], 0.6, [5, 6, 7])
        since = len(self.transforms)
        self.client.send(TrackingData('Polaris', tools={'StylusToReference': matrix, 'Other': np.eye(4)}))
        wait_until(lambda: self.edge('probe_tip', since), 20, 'pose from TDATA')
        self.client.send(Position('StylusToReference', position=[8, 9, 10], quaternion=quaternion_of(matrix[:3, :3])))
        wait_until(lambda: len(self.edge('probe_tip', since)) == 2, 20, 'pose from POSITION')
        first, second = self.edge('probe_tip', since)
        for transform, expected in ((first, [5, 6, 7]), (second, [8, 9, 10])):
            t, q = transform.transform.translation, transform.transform.rotation
            self.assertLess(np.abs(1000 * np.array([t.x, t.y, t.z]) - expected).max(), MICROMETRE)
            self.assertLess(np.abs(quaternion_matrix([q.x, q.y, q.z, q.w]) - matrix[:3, :3]).max(), 1e-6)

    def test_state_of_tools(self):
        def state():
            return self.bridge.value('tools', 'StylusToReference')
        stylus = pose_mm([0, 0, 1], 0.1, [1, 2, 3])
        tracker = Tracker(self.client, StylusToReference=stylus)
        wait_until(lambda: state() == 'OK', 20, 'state OK')
        tracker.stop()
        wait_until(lambda: state() == 'STALE', 20, 'state STALE')
        since = len(self.transforms)
        faults = {'INVALID': lambda: self.client.transform('StylusToReference', stylus, time.time(), Status='INVALID'),
                  'no time stamp': lambda: self.client.transform('StylusToReference', stylus, 0),
                  'synchronise': lambda: self.client.transform('StylusToReference', stylus, time.time() - 30),
                  'rigid': lambda: self.client.transform('StylusToReference', 1.01 * stylus, time.time()),
                  'finite': lambda: self.client.transform('StylusToReference', np.nan * stylus, time.time()),
                  'status 16': lambda: self.client.send(Status('StylusToReference', code=16))}
        for reason, send in faults.items():
            send()
            wait_until(lambda: state() == 'INVALID' and reason in self.bridge.status['tools'][0], 20, f'INVALID: {reason}')
        self.assertEqual(self.edge('probe_tip', since), [])

    def test_requests(self):
        stages, asked = [], []

        def capture(request):
            asked.append((request.key, request.note))
            if request.key in [s.key for s in stages]:
                return CaptureStageResponse(False, f'key {request.key} exists', StageInfo())
            stages.append(StageInfo(key=request.key, note=request.note, valid_points=5, coverage=0.5))
            return CaptureStageResponse(True, f'stored {request.key}', stages[-1])

        def ask(text):
            self.client.send(String('cortshift', string=text))
            return self.client.expect('CortshiftReply').string

        self.assertRegex(ask('capture_stage early'), 'REFUSED .*shift_tracker')
        services = [rospy.Service('/shift_tracker/capture_stage', CaptureStage, capture),
                    rospy.Service('/shift_tracker/list_stages', ListStages, lambda _: ListStagesResponse(list(stages))),
                    rospy.Service('/shift_tracker/compute_shift', ComputeShift, lambda r: ComputeShiftResponse(
                        True, f'from {r.from_key} to {r.to_key}', ShiftSummary()))]
        self.addCleanup(lambda: [s.shutdown() for s in services])
        self.client.expect('Stages')
        self.assertEqual(ask('capture_stage dura_open before the cut'), 'OK capture_stage dura_open: stored dura_open')
        self.assertIn('captured dura_open', self.client.expect('StageEvent').string)
        self.assertIn('dura_open', self.client.expect('Stages').string)
        self.assertEqual(ask('capture_stage dura_open'), 'REFUSED capture_stage dura_open: key dura_open exists')
        self.assertEqual(ask('compute_shift a b'), 'OK compute_shift a b: from a to b')
        for wrong in ('capture_stage ../../x', 'shutdown', '', 'capture_stage a\nb'):
            self.assertTrue(ask(wrong).startswith('REFUSED'), wrong)
        for number, name, text in ((4, 'capture_stage', 'second'), (5, 'Slicer', 'capture_stage third')):
            self.client.send(Command('Slicer', version=2, number=number, name=name, text=text))
            reply = self.client.expect('CortshiftReply')
            self.assertEqual((reply.kind, reply.number, reply.name), ('RTS_COMMAND', number, name))
            self.assertEqual(reply.metadata['Status'], 'SUCCESS')
        self.assertEqual(asked, [('dura_open', 'before the cut'), ('dura_open', ''), ('second', ''), ('third', '')])
        wait_until(lambda: 'third' in self.client.expect('Stages').string, 20, 'list with the third stage')
        stages.pop()
        wait_until(lambda: 'deleted third' in self.client.expect('StageEvent').string, 20, 'event of the deletion')
        self.client.send(GetStatus('anything'))
        self.assertEqual(self.client.expect('cortshift').code, 1)

    def test_the_registration_holds_for_one_launch(self):
        tools = [{'device': 'PatientToReference', 'parent': 'reference', 'child': 'pmr'}]
        said = []
        rospy.Subscriber('/tf_static', TFMessage, lambda m: said.extend(t for t in m.transforms if 'pmr' in (t.child_frame_id, t.header.frame_id)))

        def bridge(launch):
            started = Bridge('bridge_of_a_launch', tools=tools, launch=launch)
            self.assertGreater(started.port, 0)   # it runs
            return started

        first = bridge('of_the_first_patient')
        client = first.client()
        tracker = Tracker(client, PatientToReference=pose_mm([0, 0, 1], 0.1, [1, 2, 3]))
        wait_until(lambda: said, 20, 'the registration')
        tracker.stop()
        client.stop()
        first.process.kill()
        first.wait()
        for launch, again in (('of_the_first_patient', True), ('of_the_second_patient', False), ('', False)):
            del said[:]
            other = bridge(launch)
            if again:
                wait_until(lambda: said, 20, 'the registration again')
            time.sleep(0.5)
            other.stop()
            self.assertEqual(bool(said), again, launch)

    def test_as_a_client_of_a_tracker(self):
        port = Port()
        self.addCleanup(port.close)
        matrix = pose_mm([1, 0, 0], 0.3, [4, 5, 6])
        bridge = Bridge('igtl_client', listen=False, servers=[f'127.0.0.1:{port.number}'], reconnect_min=0.1, reconnect_max=0.5,
                        tools=[{'device': 'RefToTracker', 'parent': 'tracker', 'child': 'reference'},
                               {'device': 'DrillToTracker', 'parent': 'tracker', 'child': 'drill'}])
        self.addCleanup(bridge.stop)
        reference = pose_mm([0, 2, 1], 1.3, [100, -200, -1500])
        wait_until(lambda: 'no connection' in bridge.status.get('connections', [''])[0], 20, 'warning without the server')
        for _ in range(2):  # the second time after the server was away
            with port.listen() as server:
                since = len(self.transforms)
                message = TrackingData('Polaris', tools={'DrillToTracker': reference @ matrix, 'RefToTracker': reference})
                server.sendall(message.pack())
                wait_until(lambda: self.edge('drill', since), 20, 'pose of the drill')
                t = self.edge('drill', since)[0]
                self.assertEqual(t.header.frame_id, 'reference')
                t = t.transform.translation
                # Single precision at 1.5 m from the tracker: 0.1 um, twice.
                self.assertLess(np.abs(1000 * np.array([t.x, t.y, t.z]) - [4, 5, 6]).max(), MICROMETRE)
            wait_until(lambda: 'no connection' in bridge.status['connections'][0], 20, 'warning without the server')


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'igtl_tools', IgtlTools)
