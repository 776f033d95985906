"""Records a case on the way: bags of some minutes that stand alone, compressed, the oldest given up when there are too many."""
import os
import shutil
import signal
import subprocess
import threading
import time

import roslib.packages
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from cortshift_tracking.parameters import Number, ParameterError, read_parameters

GIGABYTE = 1e9
PERIOD = 1.0       # s between looks
SETTLED = 5.0      # s: a recording that ends later than that is begun again at once, what ends sooner at the next look
SILENCE = 20.0     # s without growth: nothing is published, or the disk does not take it
LOSS_SHOWN = 60.0  # s that a loss is warned of; the sum stays among the values
INFOS = ['stereo/left/camera_info', 'stereo/right/camera_info']  # hold until the next one, latched or not
TOPICS = ['stereo/left/image_raw', 'stereo/right/image_raw', 'stereo/left/image_raw/compressed', 'stereo/right/image_raw/compressed',
          *INFOS, 'microscope/pose', 'microscope/settings', 'shift/field', '/tf', '/tf_static', '/diagnostics', '/rosout']
PARAMETERS = {
    'folder': '',                              # '': recordings of this ROS home
    'minutes': Number(5.0, 0.05, 120.0),       # of one file
    'files': Number(24, 2, 10000),             # newest files that are kept
    'compression': 'lz4',                      # lz4 or none
    'min_disk_gb': Number(2.0, 0.1, 1000.0),   # below this recording pauses: the stages need the rest
}


class Recorder:
    """Parameters: PARAMETERS. Publishes /diagnostics. Runs record_parts, and again should it end.

    Is this node killed, its recording goes on until that of the next one takes the name over, or nobody comes.
    """

    def __init__(self):
        values = read_parameters(PARAMETERS)
        if values['compression'] not in ('lz4', 'none'):
            raise ParameterError(f'parameter {rospy.get_name()}/compression = {values["compression"]!r} is not allowed; allowed is '
                                 'lz4, none')
        home = os.environ.get('ROS_HOME') or os.path.expanduser('~/.ros')
        self._values = values
        self._folder = os.path.abspath(os.path.expanduser(values['folder'] or os.path.join(home, 'cortshift', 'recordings', rospy.get_namespace()[1:])))
        try:
            os.makedirs(self._folder, exist_ok=True)
        except OSError as error:
            raise ParameterError(f'parameter {rospy.get_name()}/folder: {error}') from error
        self._program = roslib.packages.find_node('cortshift_tracking', 'record_parts')[0]   # rosrun looks for it anew at each start
        self._process, self._ending = None, False
        self._wake = threading.Event()
        self._lock = threading.Lock()  # of the two
        self._starts, self._size, self._grown = 0, 0, time.monotonic()
        self._lost, self._lost_at, self._failure = {}, None, ''  # by topic, of the running recorder; why the last one ended
        self._diagnostics = rospy.Publisher('/diagnostics', DiagnosticArray, queue_size=5)
        rospy.on_shutdown(self._end)
        threading.Thread(target=self._watch, daemon=True).start()

    def _start(self):
        prefix = os.path.join(self._folder, time.strftime('case_%Y%m%dT%H%M%S'))
        command = [self._program, '--prefix', prefix, '--minutes', str(self._values['minutes']), '--parts', str(self._values['files']),
                   '--compression', self._values['compression'], '--parent', str(os.getpid()), '__name:=case_recording']
        for topic in INFOS:
            command += ['--hold', topic]
        # In a session of its own: a signal to all that this node started must not end it behind the node's back.
        with self._lock:
            if self._ending:
                return
            self._process = subprocess.Popen(command + TOPICS, stdout=subprocess.PIPE, universal_newlines=True, start_new_session=True)
        threading.Thread(target=self._listen, args=(self._process.stdout,), daemon=True).start()
        self._starts += 1

    def _listen(self, output):
        """What record_parts says, until it ends."""
        lost_before, begun = dict(self._lost), time.monotonic()
        for line in output:
            word, _, rest = line.strip().partition(' ')
            if word == 'lost':
                topic, _, count = rest.rpartition(' ')
                self._lost = dict(self._lost, **{topic: lost_before.get(topic, 0) + int(count)})
                self._lost_at = time.monotonic()
                rospy.logwarn('the recording lacks %s messages of %s so far', self._lost[topic], topic)
            elif word == 'failed':
                self._failure = rest
        if time.monotonic() - begun > SETTLED:
            self._wake.set()

    def _end(self):
        with self._lock:
            self._ending = True
        self._stop()

    def _stop(self):
        with self._lock:
            process, self._process = self._process, None
        if process is not None and process.poll() is None:
            process.send_signal(signal.SIGINT)  # closes the file with its index
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()

    def _watch(self):
        while not rospy.is_shutdown():
            free = shutil.disk_usage(self._folder).free / GIGABYTE
            running = self._process is not None and self._process.poll() is None
            if free < self._values['min_disk_gb']:
                self._stop()
            elif not running:
                self._start()
            self._report(free)
            self._wake.wait(PERIOD)
            self._wake.clear()

    def _report(self, free):
        files = [entry for entry in os.scandir(self._folder) if entry.name.endswith(('.bag', '.bag.active'))]
        size = sum(entry.stat().st_size for entry in files)
        now = time.monotonic()
        if size != self._size:
            self._size, self._grown = size, now
        status = DiagnosticStatus(DiagnosticStatus.OK, f'{rospy.get_name()[1:]}: recording', 'recording', '', [])
        if free < self._values['min_disk_gb']:
            status.level, status.message = DiagnosticStatus.ERROR, f'recording pauses: only {free:.1f} GB are free'
        elif now - self._grown > SILENCE:
            status.level, status.message = DiagnosticStatus.WARN, f'nothing has been written for {now - self._grown:.0f} s'
        elif self._lost_at is not None and now - self._lost_at < LOSS_SHOWN:
            status.level, status.message = DiagnosticStatus.WARN, 'messages are lost: ' + ', '.join(
                f'{count} of {topic}' for topic, count in sorted(self._lost.items())) + '; is the disk or the network too slow?'
        elif self._starts > 1:
            status.level = DiagnosticStatus.WARN
            status.message = f'the recording ended {self._starts - 1} times and was started again' + (
                f' ({self._failure})' if self._failure else '')
        status.values = [KeyValue('folder', self._folder), KeyValue('files', str(len(files))),
                         KeyValue('lost_messages', str(sum(self._lost.values()))),
                         KeyValue('size_GB', f'{size / GIGABYTE:.3f}'), KeyValue('disk_left_GB', f'{free:.1f}')]
        message = DiagnosticArray(status=[status])
        message.header.stamp = rospy.Time.now()
        self._diagnostics.publish(message)


def main():
    rospy.init_node('case_recorder')
    try:
        Recorder()
    except ParameterError as error:
        rospy.logfatal('case_recorder cannot start: %s', error)
        return 1
    rospy.spin()
    return 0
