"""Which texts may stay, and what stands for the others.

Nothing is searched for: a name can look like anything. What stays is what is known to come from this software, word by word."""
import datetime
import re
import time

import genpy

from cortshift_tracking.errors import CaseError
from cortshift_tracking.case.messages import MR_KEY
from cortshift_tracking.probe.points import GRAVITY_LABELS

#: The moment of the first stage in every case that is handed on: 2000-01-01 00:00:00 UTC [s].
FIRST_STAGE = 946684800
WITHHELD = 'there is a remark here, withheld because it may name somebody: ask whoever handed this case on'
FRAMES = ('pmr', 'reference', 'microscope', 'left_optical', 'right_optical', 'probe_tip')
#: Words of the sentences in fields and summaries (surround.cpp, outline.cpp, uncertainty.cpp, pose_uncertainty.cpp, parameters.cpp).
SENTENCE_WORDS = frozenset('''
    a agrees all and anything around as at be bone both brain by calibration case centre check clamp clear cloth cm2 colour confidence
    configured contradicts correct corrected correction deg differently does draw drawn edge enough eye field file flesh gravity hand heights
    here image in is it its itself kept known lies like limit live look looked looks loose match may measured mm more moved move moves much
    needed no not nothing nowhere of off on one only optical or other outline own parameter place points probe proposed reference
    residuals seemed seen service set should side small so surround surface tell tells than that the their there these they this tissue to
    together too tracker tracking turned under uncertainty until use view was what where which wide with without would least leaves
    leave better knows little average from tracked hold rigid stage stages surfaces pair pairs are frame starts preoperative mr set_gravity degrees count
    colours craniotomy differ relief stands up way % an agree'''.split())
#: Parts of the names in calibration files.
KEY_WORDS = frozenset('''
    date verdict rms error residual views view images image width height size camera matrix distortion model coefficients rectification
    projection rows cols data reprojection epipolar corner spacing mm px deg sd square board inner corners left right focal length aspect
    over cx cy fx fy k1 k2 k3 k4 k5 k6 p1 p2 k d r p in rotation vector translation baseline deviation percent lens alone reach distance
    cross validation held out turn used checked rejected method methods spread difference misfit tracker assumed position diversity
    parent child frame binning x y roi offset do rectify calibrated region radius centre reference setting settings powers scale
    polynomial magnification'''.split())
#: Words that are values, in parameters and calibration files.
VALUES = frozenset('''plumb_bob rational_polynomial equidistant good doubtful useless auto linear nearest correct check off true false
    green red blue grey mono all left right'''.split()) | set(FRAMES)
LARGEST = 1e6   # numbers of a calibration are smaller; dates and numbers of patients are not
DATES = ('%Y-%m-%dT%H:%M:%SZ', '%Y-%m-%dT%H:%M:%S', '%Y-%m-%d %H:%M:%S', '%Y-%m-%d %H:%M', '%Y-%m-%d')
_NUMBER = re.compile(r'[-+]?\d+(\.\d+)?([eE][-+]?\d+)?\Z')
_SMALL_NUMBER = re.compile(r'[-+]?\d{1,3}(\.\d{1,4})?\Z')
_VERSION = re.compile(r'(v?\d+\.\d+\.\d+(-\d+-g)?)?[0-9a-f]{0,40}(-dirty)?\Z')
_HASHES = re.compile(r'[0-9a-f]{64}(,[0-9a-f]{64})?\Z')


def sentence(text):
    """The text itself where every word of it is one of this software's sentences; else WITHHELD; nothing stays nothing."""
    words = re.sub(r'[:;,()|]|\.(?=\s|\Z)|(?<=[a-z])-(?=[a-z])', ' ', text).split()
    own = all(word.lower() in SENTENCE_WORDS or _SMALL_NUMBER.match(word) for word in words)
    return text if own and text.isascii() else WITHHELD


def version(text):
    return text if _VERSION.match(text) else ''


def hashes(text):
    return text if _HASHES.match(text) else ''


def own_key(key):
    """Whether a key of a calibration file is of this software or of ROS's camera_info."""
    return isinstance(key, str) and all(part in KEY_WORDS for part in key.lower().split('_'))


def parameters(text):
    """The effective parameters of a stage, with every value that is no number and none of VALUES withheld."""
    lines = []
    for line in text.splitlines():
        name, colon, value = line.partition(': ')
        if line in ('# surface_reconstruction', '# shift_tracker'):
            lines.append(line)
        elif colon and re.fullmatch(r'[a-z_]{1,40}', name):
            items = [item.strip() for item in value.strip().strip('[]').split(',')]
            plain = all(not item or item.strip('"') in VALUES or _NUMBER.match(item) and abs(float(item)) < LARGEST for item in items)
            lines.append(f'{name}: {value}' if plain or value == '""' else f'{name}: "withheld"')
    return ''.join(line + '\n' for line in lines)


class Names:
    """Numbers in place of names, and one shift for every time of a case."""

    def __init__(self, keep_keys=False):
        self._keep, self._known, self._shift = keep_keys, {'stage': {}, 'point': {}, 'frame': {}}, 0

    def set_first(self, stamp):
        """stamp: genpy.Time of the first stage."""
        self._shift = FIRST_STAGE - stamp.secs

    def key(self, key):
        return self._number('stage', key, self._keep or key == MR_KEY)

    def label(self, label):
        return self._number('point', label, self._keep or label in GRAVITY_LABELS.values())

    def frame(self, frame):
        return self._number('frame', frame, frame.lstrip('/') in FRAMES)

    def mapping(self):
        """(what, was, is) of keys and labels that have another name now."""
        return [(kind, was, now) for kind in ('stage', 'point') for was, now in self._known[kind].items()]

    def _number(self, kind, name, keep):
        if keep or not name:
            return name
        known = self._known[kind]
        return known.setdefault(name, f'{kind}_{len(known) + 1}')

    def time(self, stamp):
        """A stamp of the same instant; zero, which is none, stays. Raises CaseError where another clock made it."""
        if stamp.secs == 0 and stamp.nsecs <= 1:
            return stamp
        secs = stamp.secs + self._shift
        if not 0 < secs < 2 ** 32:
            raise CaseError(f'the stamp {stamp.secs} s is of another clock than that of the stages, so that shifting it would not hide '
                            'it; take out what it belongs to')
        return genpy.Time(secs, stamp.nsecs)

    def date(self, value):
        """Text of a shifted date; '' where it is none that is understood."""
        if isinstance(value, datetime.datetime):
            value = value.strftime(DATES[1])
        elif isinstance(value, datetime.date):
            value = value.isoformat()
        for form in DATES:
            try:
                seconds = datetime.datetime.strptime(str(value), form).replace(tzinfo=datetime.timezone.utc).timestamp()
            except ValueError:
                continue
            return time.strftime(form, time.gmtime(seconds + self._shift))
        return ''
