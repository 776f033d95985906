"""Those who use the graph: captures and shifts by service, a client over OpenIGTLink, a page that is looked at."""
import threading
import time
import urllib.request

import rospy
from cortshift_msgs.srv import CaptureStage, ComputeShift, SetPhantomStage, TrackShift
from igtl_client import Client
from igtl_messages import String

PHANTOM_STAGES = ('first', 'second')
REPLY = 30.0   # s that a client waits for


class User:
    """A thread that does something again and again until it is stopped. Failures of what dies under it are counted, not raised."""

    def __init__(self, gaps, period):
        self.counts, self.acknowledged, self.refusals = {}, [], {}
        self._gaps, self._period, self._stopping = gaps, period, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self):
        self._thread.start()
        return self

    def stop(self):
        self._stopping.set()
        self._thread.join(120)

    def count(self, what):
        self.counts[what] = self.counts.get(what, 0) + 1

    def refused(self, reason):
        self.count('refused')
        words = reason.split(':')[0][:80]
        self.refusals[words] = self.refusals.get(words, 0) + 1

    def _run(self):
        while not self._stopping.wait(self._period):
            self.once()
        self.end()

    def end(self):
        pass


class Surgeon(User):
    """Captures a stage, and a shift from the one before it."""

    def __init__(self, gaps, period, prefix, theatre=None):
        """theatre: what shows the stages; None: the phantom's driver."""
        super().__init__(gaps, period)
        self._number, self._prefix, self.shifts, self._theatre = 0, prefix, 0, theatre

    def _call(self, name, kind, *arguments):
        try:
            rospy.wait_for_service(name, timeout=2)
            return rospy.ServiceProxy(name, kind)(*arguments)
        except (rospy.ServiceException, rospy.ROSException):
            return None

    def capture(self):
        """The answer, or None where there was none."""
        self._number += 1
        key = f'{self._prefix}{self._number:04d}'
        self.count('asked')
        answer = self._call('/shift_tracker/capture_stage', CaptureStage, key, 'soak')
        if answer is None:
            self.count('unanswered')
        elif answer.success:
            self.acknowledged.append(key)
            self._gaps.tick('captures acknowledged')
        else:
            self.refused(answer.message)
        return answer

    def once(self):
        if self._number % 4 == 0:
            self._show(PHANTOM_STAGES[self._number // 4 % 2])
        self.capture()
        if len(self.acknowledged) > 1:
            answer = self._call('/shift_tracker/compute_shift', ComputeShift, *self.acknowledged[-2:])
            self.count('shifts asked')
            if answer is not None and answer.success:
                self.shifts += 1

    def _show(self, stage):
        if self._theatre:
            self._theatre.set_stage(stage)
        else:
            self._call('/stereo_driver/set_stage', SetPhantomStage, stage)

    def track(self, key):
        answer = self._call('/shift_tracker/track', TrackShift, key, True)
        return answer is not None and answer.success


class SlicerLike(User):
    """Takes what the bridge sends, connects again where it is gone, and now and then asks for a capture."""

    def __init__(self, gaps, port, period=6.0):
        super().__init__(gaps, period)
        self._port, self._client, self._number = port, None, 0

    def once(self):
        try:
            if self._client is None or not self._client.is_connected():
                self.end()
                self._client = Client('127.0.0.1', self._port)
                self.count('connections')
            self._number += 1
            key = f'igtl{self._number:04d}'
            self._client.take('CortshiftReply', 0)
            asked = time.time()
            self.count('asked')
            self._client.send(String('cortshift', string=f'capture_stage {key} soak'))
            reply = self._client.take('CortshiftReply', REPLY, asked - 1)
            if reply is None:
                self.count('unanswered')
            elif reply.string.startswith('OK') and key in reply.string:
                self.acknowledged.append(key)
            else:
                self.refused(reply.string)
            self._gaps.tick('replies over OpenIGTLink')
        except (OSError, AssertionError):
            self.count('connections that ended')
            self._client = None

    def end(self):
        if self._client is not None:
            self._client.stop()
            self._client = None


class Reader(User):
    """Looks at the console's page."""

    def __init__(self, gaps, port, period=1.0):
        super().__init__(gaps, period)
        self._address = f'http://127.0.0.1:{port}/status'

    def once(self):
        try:
            with urllib.request.urlopen(self._address, timeout=5) as answer:
                answer.read()
            self._gaps.tick('console page')
        except OSError:
            self.count('failed')
