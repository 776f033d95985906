"""Faults that are done to a running graph, and how long each node takes to be whole again."""
import os
import signal
import socket
import time
import urllib.request
from dataclasses import dataclass

import rospy
from cortshift_msgs.srv import ListPoints, ListStages
from soak_watch import pid_of

PATIENCE = 60.0     # s for a node to be whole again
PAUSE = (3.0, 9.0)  # s between faults
STILL = 3.0         # s that the driver stands still, or a camera has no power
FULL = 6.0          # s that the disk is full
STEP = 2.0          # s that the clock is set by ...
STEPPED = 8.0       # s ... and for so long


def set_clock(seconds):
    """The machine's, by so much. @raises PermissionError"""
    time.clock_settime(time.CLOCK_REALTIME, time.clock_gettime(time.CLOCK_REALTIME) + seconds)


@dataclass
class Fault:
    kind: str
    began: float
    ended: float = float('inf')
    whole: float = None   # s until what the node gives flows again; None: it did not


class Victims:
    """The nodes, and how each is seen to be whole: by what it gives, not by being there."""

    def __init__(self, gaps, igtl_port, page_port):
        self._gaps, self._igtl, self._page = gaps, igtl_port, page_port
        self._whole = {
            'shift_tracker': lambda began: self._answers('/shift_tracker/list_stages', ListStages),
            'surface_reconstruction': lambda began: gaps.since('/surface/points', began),
            'stereo_driver': lambda began: gaps.since('/stereo/left/image_raw', began),
            'probe': lambda began: self._answers('/probe/list_points', ListPoints),
            'igtl_bridge': lambda began: self._accepts(),
            'case_recorder': lambda began: True,
            'console_page': lambda began: self._serves(),
            'master_keeper': lambda began: True}

    @property
    def nodes(self):
        return list(self._whole)

    def wait_whole(self, node, began, before=None, seconds=PATIENCE):
        """Seconds from `began` until the node, as another process than `before`, gives what it is for; None if it does not."""
        while time.monotonic() < began + seconds:
            pid = pid_of(node)
            if pid not in (None, before) and self._whole[node](time.monotonic() - 1 if before is None else began):
                return time.monotonic() - began
            time.sleep(0.05)
        return None

    @staticmethod
    def _answers(name, kind):
        try:
            rospy.wait_for_service(name, timeout=0.2)
            rospy.ServiceProxy(name, kind)()
            return True
        except (rospy.ServiceException, rospy.ROSException):
            return False

    def _accepts(self):
        try:
            socket.create_connection(('127.0.0.1', self._igtl), timeout=1).close()
            return True
        except OSError:
            return False

    def _serves(self):
        try:
            with urllib.request.urlopen(f'http://127.0.0.1:{self._page}/status', timeout=2) as answer:
                return answer.status == 200
        except OSError:
            return False


class Faults:
    """done: every fault so far, the one under way included."""

    def __init__(self, victims, graph, random):
        self.done = []
        self._victims, self._graph, self._random = victims, graph, random

    def _begin(self, kind):
        self.done.append(Fault(kind, time.monotonic()))
        return self.done[-1]

    def kill(self, node):
        pid = pid_of(node)
        fault = self._begin(f'kill -9 {node}')
        if pid is not None:
            os.kill(pid, signal.SIGKILL)
            fault.whole = self._victims.wait_whole(node, fault.began, pid)
        fault.ended = time.monotonic()

    def driver_stands_still(self):
        pid = pid_of('stereo_driver')
        fault = self._begin('driver stands still')
        if pid is not None:
            os.kill(pid, signal.SIGSTOP)
            time.sleep(STILL)
            os.kill(pid, signal.SIGCONT)
            fault.whole = self._victims.wait_whole('stereo_driver', time.monotonic())
        fault.ended = time.monotonic()

    def camera_gone(self):
        """One of the two, and the pairs with it."""
        fault = self._begin('camera gone')
        self._graph.theatre.camera_gone(self._random.choice(('left', 'right')), STILL)
        fault.whole = self._victims.wait_whole('stereo_driver', time.monotonic())
        fault.ended = time.monotonic()

    def client_hangs(self):
        """Connects, takes nothing, and stays: longer than the bridge waits for a peer that takes nothing."""
        fault = self._begin('client hangs')
        try:
            self._hanging = socket.create_connection(('127.0.0.1', self._graph.igtl), timeout=2)   # closed when the next one hangs
            self._hanging.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        except OSError:
            pass
        fault.ended = time.monotonic()
        fault.whole = 0.0

    def disk_full(self):
        fault = self._begin('disk full')
        ballast = os.path.join(self._graph.case, 'ballast')
        try:
            with open(ballast, 'wb', buffering=0) as file:
                while file.write(bytes(1 << 20)):
                    pass
        except OSError:
            pass
        time.sleep(FULL)
        os.unlink(ballast)
        fault.ended, fault.whole = time.monotonic(), 0.0

    def master_ends(self):
        """And another one is started: all nodes are to be found there, and answer."""
        fault = self._begin('master ends')
        self._graph.end_master()
        self._graph.start_master()
        whole = [self._victims.wait_whole(node, fault.began) for node in self._victims.nodes]
        fault.whole = None if None in whole else max(whole)
        fault.ended = time.monotonic()

    def clock_is_set(self):
        """By STEP, and back: what a time server does that is found late."""
        fault = self._begin('clock is set')
        step = self._random.choice((STEP, -STEP))
        try:
            set_clock(step)
            time.sleep(STEPPED)
        finally:
            set_clock(-step)
        began = time.monotonic()
        whole = [self._victims.wait_whole(node, began) for node in self._victims.nodes]
        fault.whole = None if None in whole else max(whole)
        fault.ended = time.monotonic()

    def kinds(self):
        """Functions to choose from; nodes weigh more than the rest."""
        kinds = [lambda node=node: self.kill(node) for node in self._victims.nodes] * 2
        kinds += [self.driver_stands_still, self.driver_stands_still, self.client_hangs, self.master_ends]
        kinds += [self.camera_gone] * 3 * bool(self._graph.theatre)
        return kinds + [self.disk_full] * 2 * self._graph.own_disk + [self.clock_is_set] * self._graph.own_clock

    def run(self, until):
        """The master's end, which every node is to outlive, then at random until a time."""
        kinds = self.kinds()
        time.sleep(PAUSE[0])
        self.master_ends()
        while time.monotonic() < until:
            time.sleep(self._random.uniform(*PAUSE))
            self._random.choice(kinds)()
