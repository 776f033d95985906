"""The console in a terminal: one key for each request, and a status line."""
import os
import select
import shutil
import sys
import termios
import threading
import time
import tty

import rospy

from cortshift_tracking.console.worker import DeskError

HELP = 'c capture   s shift of the last two stages   v live on/off   l list   n next phantom stage   h help   q quit'
PERIOD = 0.25  # s between looks at the status
BAR = 20


def status_line(desk):
    """One line: what is under way or was last done, coverage, live mode, stages and warnings."""
    activity = desk.activity
    if activity.busy:
        done = int(BAR * desk.progress())
        doing = f'{activity.what} [{"#" * done}{"." * (BAR - done)}]'
    else:
        doing = 'ready'
    coverage = desk.coverage()
    warnings = desk.warnings()
    return ' | '.join([doing, f'{len(desk.stages)} stages',
                       'coverage ' + ('unknown' if coverage is None else f'{100 * coverage:.0f} %'),
                       *tracker_words(desk.tracker),
                       f'{len(warnings)} warnings: {warnings[0]}' if warnings else 'no warnings'])


def tracker_words(tracker):
    """What shift_tracker works with, for a person."""
    words = ['live ' + {None: 'unknown', False: 'off', True: f'on from {tracker.live_from}'}[tracker.live],
             f'gravity {tracker.gravity}']
    if tracker.exclusions:
        words.append(f'regions excluded at {", ".join(tracker.exclusions)}')
    return words


def stage_lines(stages):
    if not stages:
        return ['no stage has been captured yet']
    return [f'{time.strftime("%H:%M:%S", time.localtime(s.stamp.to_sec()))}  {s.key:<20} {100 * s.coverage:3.0f} %  '
            f'epoch {s.epoch}  {s.note}'.rstrip() for s in stages]


class Terminal:
    """Reads single keys from stdin until q, the end of the input or the end of ROS."""

    def __init__(self, desk, output=sys.stdout):
        self._desk, self._out = desk, output
        self._line = ''
        self._said = None   # the activity that was reported
        self._screen = threading.Lock()
        self._keys = {'c': desk.capture, 's': desk.compute_last_pair, 'n': desk.next_phantom_stage,
                      'v': lambda: desk.set_live(not desk.tracker.live), 'l': self._list, 'h': lambda: self._say(HELP)}

    def run(self):
        interactive = sys.stdin.isatty()
        settings = termios.tcgetattr(sys.stdin) if interactive else None
        try:
            if interactive:
                tty.setcbreak(sys.stdin)
            self._say(HELP)
            while not rospy.is_shutdown():
                if select.select([sys.stdin], [], [], PERIOD)[0]:
                    key = os.read(sys.stdin.fileno(), 1).decode(errors='replace')
                    if key in ('', 'q'):
                        break
                    self._press(key)
                self._refresh()
        finally:
            if settings is not None:
                termios.tcsetattr(sys.stdin, termios.TCSADRAIN, settings)
            self._say('')

    def _press(self, key):
        if key.isspace():
            return
        if key not in self._keys:
            self._say(f'key {key!r} does nothing; h for help')
            return
        try:
            self._keys[key]()
        except DeskError as error:
            self._say(str(error))

    def _list(self):
        for line in stage_lines(self._desk.stages):
            self._say(line)

    def _refresh(self):
        activity = self._desk.activity
        if not activity.busy and activity.message and activity is not self._said:
            self._said = activity
            self._say(('' if activity.success else 'REFUSED: ') + activity.message)
            for name, text in activity.summary:
                self._say(f'  {name}: {text}')
        line = status_line(self._desk)[:shutil.get_terminal_size().columns - 1]
        if line != self._line:
            self._draw(line)

    def _say(self, text):
        with self._screen:
            self._out.write('\r\033[K' + text + '\n' + self._line)
            self._out.flush()

    def _draw(self, line):
        with self._screen:
            self._line = line
            self._out.write('\r\033[K' + line)
            self._out.flush()
