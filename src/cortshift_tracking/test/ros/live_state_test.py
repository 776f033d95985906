#!/usr/bin/python3
"""Live mode follows what becomes of the stage that it started from."""
import os
import signal
import shutil
import sys
import tempfile
import unittest

import numpy as np
import rospy
import rostest
from cortshift_msgs.msg import DisplacementField
from geometry_msgs.msg import Point32, Polygon, TransformStamped
from sensor_msgs.msg import CameraInfo
from tf2_msgs.msg import TFMessage

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import Diagnostics, TrackerProcess, field_arrays, wait_until  # noqa: E402
from sheet import SheetSource  # noqa: E402

STATE = 'shift_tracker: state'
GRID = 0.0008  # m, of the live mode
SQUARE = [[0.025, 0.025], [0.035, 0.025], [0.035, 0.035], [0.025, 0.035]]  # m, in the projection frame: the middle of the sheet


class LiveState(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('live_state')
        cls.folder = tempfile.mkdtemp(prefix='cortshift_live_')
        cls.fields = []
        rospy.Subscriber('/shift/field', DisplacementField, cls.fields.append, queue_size=20)
        cls.diagnostics = Diagnostics()
        cls.surfaces = SheetSource(cls.diagnostics)
        cls.node = TrackerProcess()
        cls.tracker = cls.node.start(case_folder=cls.folder, track_resolution=GRID, resolution=0.0004, coarse_resolution=GRID,
                                     capture_timeout=5.0)
        cls.surfaces.connect()

    @classmethod
    def tearDownClass(cls):
        cls.node.end(signal.SIGKILL)
        shutil.rmtree(cls.folder)

    def capture(self, key):
        self.surfaces.send()
        answer = self.tracker.capture_stage(key, '')
        self.assertTrue(answer.success, answer.message)

    def live_field(self):
        """The field of a surface that is sent now."""
        stamp = self.surfaces.send(0.001)
        wait_until(lambda: self.fields and self.fields[-1].to_stamp == stamp, 60, 'a live field')
        return field_arrays(self.fields[-1])[1]

    def test_exclusions_count_at_once(self):
        self.capture('drawn_on')
        self.assertTrue(self.tracker.track('drawn_on', True).success)
        middle = int(0.03 / GRID)
        self.assertTrue(np.isfinite(self.live_field()[middle, middle]).all())
        answer = self.tracker.exclude_regions('drawn_on', [Polygon([Point32(x, y, 0) for x, y in SQUARE])])
        self.assertTrue(answer.success, answer.message)
        holed = self.live_field()
        self.assertTrue(np.isnan(holed[middle, middle]).all())
        self.assertTrue(np.isfinite(holed).any())
        self.assertTrue(self.tracker.exclude_regions('drawn_on', []).success)
        self.assertTrue(np.isfinite(self.live_field()[middle, middle]).all())

    def test_another_calibration_is_no_movement(self):
        placed = rospy.Publisher('/tf_static', TFMessage, queue_size=1, latch=True)
        infos = [rospy.Publisher(f'/stereo/{side}/camera_info', CameraInfo, queue_size=4) for side in ('left', 'right')]
        edges = [TransformStamped(child_frame_id=child) for child in ('reference', 'microscope', 'left_optical', 'right_optical')]
        for edge, parent in zip(edges, ('pmr', 'reference', 'microscope', 'left_optical')):
            edge.header.frame_id, edge.transform.rotation.w = parent, 1
        placed.publish(TFMessage(edges))
        wait_until(lambda: all(p.get_num_connections() for p in infos), 30, 'the subscriptions of camera_info')

        def send(focal):
            info = CameraInfo(width=640, height=480, distortion_model='plumb_bob', K=[focal, 0, 320, 0, focal, 240, 0, 0, 1])
            info.header.stamp = rospy.Time.now()
            for publisher in infos:
                publisher.publish(info)
            return self.surfaces.send(0.001)

        def captured():
            send(800)
            stage = self.tracker.capture_stage('calibrated', '').stage
            if stage.provenance.calibration:
                return True
            self.tracker.delete_stage('calibrated')  # what it was taken with had not arrived yet
            return False

        def follow():
            began = rospy.Time.now()
            wait_until(lambda: send(800) and self.fields and self.fields[-1].to_stamp >= began, 60, 'a field of the same calibration')

        def refused():
            send(801)
            return 'the calibration (camera_info' in self.diagnostics.values(STATE).get('live_trouble', '')
        wait_until(captured, 30, 'a stage of known calibration')
        self.assertTrue(self.tracker.track('calibrated', True).success)
        follow()
        self.assertEqual(self.fields[-1].provenance.calibration, self.tracker.list_stages().stages[-1].provenance.calibration)
        wait_until(refused, 60, 'the refusal of another calibration')
        self.diagnostics.wait_for(STATE, live='on', live_trouble="changed between 'calibrated'")
        count = len(self.fields)
        send(801)
        self.diagnostics.wait_for(STATE, live='on', live_trouble="changed between 'calibrated'")
        self.assertEqual(len(self.fields), count)
        follow()
        self.assertTrue(self.tracker.track('', False).success)

    def test_a_stage_that_is_deleted_ends_it(self):
        self.capture('gone')
        self.assertTrue(self.tracker.track('gone', True).success)
        self.diagnostics.wait_for(STATE, live='on', live_from='gone', live_trouble='')
        self.live_field()
        self.assertTrue(self.tracker.delete_stage('gone').success)
        self.diagnostics.wait_for(STATE, live='off', live_from='', live_trouble="stage 'gone' that it started from is deleted",
                                  message='live mode has ended')
        self.capture('gone')  # another one of the same key
        count = len(self.fields)
        self.surfaces.send(0.001)
        self.diagnostics.wait_for(STATE, live='off')
        self.assertEqual(len(self.fields), count)
        self.assertTrue(self.tracker.track('gone', True).success)
        self.live_field()
        self.assertEqual(self.fields[-1].from_stamp, self.tracker.list_stages().stages[-1].stamp)
        self.diagnostics.wait_for(STATE, live='on', live_from='gone', live_trouble='')
        self.assertTrue(self.tracker.track('', False).success)
        self.diagnostics.wait_for(STATE, live='off', live_trouble='', message='ok')


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'live_state', LiveState)
