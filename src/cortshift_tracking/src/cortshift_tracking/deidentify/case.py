"""A case folder, written anew without what says whose it is."""
import contextlib
import csv
import io
import json
import os
import re
import shutil
import tempfile
import zlib
from dataclasses import dataclass, field
from typing import List

import genpy
import rosbag
import yaml

from cortshift_tracking.case.bag_reading import open_bag
from cortshift_tracking.case.folder import LEFT_ALONE
from cortshift_tracking.deidentify import words
from cortshift_tracking.deidentify.messages import TOPICS, Cleaner
from cortshift_tracking.errors import CaseError, CortshiftError
from cortshift_tracking.mr.reader import load_volume, save_nifti
from cortshift_tracking.probe import points as probe_points
from cortshift_tracking.probe import store
from cortshift_tracking.report import picks
from cortshift_tracking.texts import read_table, read_text, read_yaml

STAGE_NAME = re.compile(r'(\d{4,9})_[A-Za-z0-9_-]{1,64}_[0-9a-f]{8}\.bag\Z')   # as in stage_store.cpp
FIELD_NAME = re.compile(r'[A-Za-z0-9_-]{1,64}__[A-Za-z0-9_-]{1,64}\.bag\Z')
STATE_NAME, SUMMARY_NAME, MR_NAMES = 'case_state.json', 'summary.csv', ('pmr.nii', 'pmr.nii.gz')
SUMMARY_TEXTS = ('warnings', 'outline', 'surround')
FOLDERS = ('', 'stages', 'fields')   # names that a case gives its folders
SAID = '''A case of cortshift that was made to be handed on (script/deidentify).
The first stage is at 2000-01-01 00:00:00 UTC and all other times lie as far from it as they did. Notes, names of stages and of points,
remarks that may name somebody, logs, reports and recordings of other programs are not in it. Pixels of the images and voxels of the MR
are as they were.
'''


@dataclass
class Done:
    """What was written, and what was not and why (file, reason): for whoever hands the case on, not for whoever gets it."""
    stages: int = 0
    fields: int = 0
    files: List[str] = field(default_factory=list)
    left_out: List[tuple] = field(default_factory=list)
    mapping: List[tuple] = field(default_factory=list)
    mr: bool = False


def deidentify(folder, out, mr=None, keep_keys=False):
    """Write `folder`, a case, to `out`, which must not exist or be empty; nothing is there unless all went well.

    mr: MrSource, or None: pmr.nii or pmr.nii.gz of the case. keep_keys: names of stages and points name nobody.
    Raises CaseError, VolumeError, OSError.
    """
    if not os.path.isdir(folder):
        raise CaseError(f'{folder}: no such folder; give the folder of a case')
    folder, out = os.path.realpath(folder), os.path.realpath(out)
    if os.path.isdir(out) and os.listdir(out) or os.path.isfile(out):
        raise CaseError(f'{out}: exists already; nothing is overwritten: give another name')
    if (out + os.sep).startswith(folder + os.sep):
        raise CaseError(f'{out} lies in the case itself; give a folder outside')
    os.makedirs(os.path.dirname(out), exist_ok=True)
    scratch = tempfile.mkdtemp(prefix='.deidentify.', dir=os.path.dirname(out))
    try:
        done = _Case(folder, scratch, keep_keys).write(mr)
        if os.path.isdir(out):
            os.rmdir(out)
        os.rename(scratch, out)
    except BaseException:
        shutil.rmtree(scratch, ignore_errors=True)
        raise
    return done


class _Case:
    def __init__(self, folder, out, keep_keys):
        self.folder, self.out, self.done = folder, out, Done()
        self.names = words.Names(keep_keys)
        self.cleaner = Cleaner(self.names)
        self._folders = {name: name for name in FOLDERS}

    def write(self, mr):
        paths, here = [], self.folder
        for below, folders, files in os.walk(here):
            for name in set(folders) & set(LEFT_ALONE):
                self._leave_out(os.path.join(below, name), 'what was deleted or set aside is not handed on')
            folders[:] = sorted(name for name in folders if name not in LEFT_ALONE)
            paths += [os.path.join(below, name) for name in sorted(files)]
        self._begin([path for path in paths if path.endswith('.bag')])
        kinds = ((STAGE_NAME.match, self._stage), (lambda name: name.endswith('.bag'), self._bag),
                 ({store.FILE_NAME}.__contains__, self._points), ({STATE_NAME}.__contains__, self._state),
                 ({picks.FILE_NAME}.__contains__, self._picks), ({SUMMARY_NAME}.__contains__, self._summary),
                 (lambda name: name.endswith('.yaml'), self._calibration))
        for fits, copy in kinds:
            for path in [path for path in paths if fits(os.path.basename(path))]:
                paths.remove(path)
                try:
                    copy(path)
                except CortshiftError as error:
                    self._leave_out(path, str(error))
        paths = [path for path in paths if os.path.basename(path) not in MR_NAMES or os.path.dirname(path) != here]
        self._write_mr(mr)
        for path in paths:
            self._leave_out(path, 'is not needed, or can be made again')
        if not self.done.stages:
            raise CaseError(f'{here}: no stage of it can be handed on: ' + ('; '.join(f'{name}: {why}' for name, why in self.done.left_out)
                                                                            or 'it holds none'))
        self._text('', 'deidentified.txt', _said(self.done))
        self.done.mapping = self.names.mapping()
        return self.done

    def _begin(self, bags):
        """Numbers the stages in the order of their exposure, the first of which is where time begins."""
        found = []
        for path in bags:
            with contextlib.suppress(CaseError), open_bag(path) as bag:
                found += [(message.stamp, message.key) for _, message, _ in bag.read_messages('/stage/info')]
        if not found:
            raise CaseError(f'{self.folder}: holds no stage; give the folder of a case')
        found.sort()
        self.names.set_first(found[0][0])
        for _, key in found:
            self.names.key(key)

    def _leave_out(self, path, why):
        self.done.left_out.append((os.path.relpath(path, self.folder), why.replace(f'{path}: ', '', 1)))

    def _place(self, path):
        """Folder in `out` for a file of the case; folders have no names but those that the software gives."""
        name = os.path.relpath(os.path.dirname(path), self.folder)
        name = '' if name == '.' else name
        new = self._folders.setdefault(name, f'folder_{len(self._folders) - len(FOLDERS) + 1}')
        place = os.path.join(self.out, new)
        os.makedirs(place, exist_ok=True)
        return place

    def _text(self, path, name, text):
        place = self._place(path) if path else self.out
        with open(os.path.join(place, name), 'w', encoding='utf-8') as file:
            file.write(text)
        self.done.files.append(name)

    # ---- bags ------------------------------------------------------------------------------------------------------------

    def _copy_bag(self, path, target):
        """Writes the messages that are handed on. Returns [(topic, message)] of stages and fields. Raises CaseError."""
        told, kept = set(), []
        with open_bag(path) as bag, rosbag.Bag(target, 'w', compression='lz4') as out:
            counts = {topic: known.message_count for topic, known in bag.get_type_and_topic_info().topics.items()}
            parameters = [raw for topic, raw, _ in bag.read_messages('/stage/parameters', raw=True)]
            for raw in parameters:   # its hash stands in messages before it
                self._cleaned('/stage/parameters', raw)
            for topic, raw, time in bag.read_messages(raw=True):
                message = self._cleaned(topic, raw)
                if message is None:
                    told.add(topic)
                    continue
                out.write(topic, message, self.names.time(genpy.Time(time.secs, time.nsecs)))
                if topic in ('/stage/info', '/shift/field'):
                    kept.append((topic, message))
        for topic in sorted(told):
            self._leave_out(path, f'{counts[topic]} messages on {topic}: not of a topic and type that is handed on')
        return kept

    def _cleaned(self, topic, raw):
        kind, data, checksum = raw[:3]
        own = TOPICS.get(topic)
        if own is None or (own._type, own._md5sum) != (kind, checksum):
            return None
        message = own()
        try:
            message.deserialize(data)
        except genpy.DeserializationError as error:
            raise CaseError(f'a message on {topic} is damaged ({error}); take it out') from error
        return self.cleaner.clean(message)

    def _new_bag(self, path):
        handle, name = tempfile.mkstemp(suffix='.part', dir=self._place(path))
        os.close(handle)
        return name

    def _stage(self, path):
        number = STAGE_NAME.match(os.path.basename(path)).group(1)
        with _new(self._new_bag(path)) as target:
            infos = [message for topic, message in self._copy_bag(path, target) if topic == '/stage/info']
            if len(infos) != 1:
                raise CaseError(f'holds {len(infos)} stages; a stage is one')
            with open(target, 'rb') as file:
                checksum = zlib.crc32(file.read())
            os.rename(target, os.path.join(self._place(path), f'{number}_{infos[0].key}_{checksum:08x}.bag'))
        self.done.stages += 1

    def _bag(self, path):
        with _new(self._new_bag(path)) as target:
            kept = self._copy_bag(path, target)
            if not kept:
                raise CaseError('holds neither a stage nor a field; recordings are not handed on')
            messages = [message for topic, message in kept if topic == '/shift/field']
            if len(messages) == len(kept) == 1 and FIELD_NAME.match(os.path.basename(path)):
                name = f'{messages[0].from_key}__{messages[0].to_key}.bag'
            else:
                name = f'recording_{len(self.done.files) + 1}.bag'
            place = os.path.join(self._place(path), name)
            if os.path.exists(place):
                raise CaseError('another file has the same field; take one of them away')
            os.rename(target, place)
        self.done.fields += len(messages)
        self.done.stages += len(kept) - len(messages)
        self.done.files.append(name)

    # ---- files beside them -----------------------------------------------------------------------------------------------

    def _points(self, path):
        points = [probe_points.ProbePoint(self.names.key(p.stage), self.names.label(p.label), self._pair(p.stamp), p.position_pmr,
                                          p.spread, p.samples) for p in store.read_points(os.path.dirname(path))]
        store.write_points(self._place(path), points)
        self.done.files.append(store.FILE_NAME)

    def _pair(self, stamp):
        shifted = self.names.time(genpy.Time(*stamp))
        return shifted.secs, shifted.nsecs

    def _state(self, path):
        try:
            state = json.loads(read_text(path))
            gravity = state['gravity']
            new = {'format': state['format'], 'unit': state['unit'], 'gravity': gravity and {
                'direction_pmr': [float(value) for value in gravity['direction_pmr']], 'source': words.sentence(gravity['source'])}}
            for drawn in ('excluded', 'outlines'):
                new[drawn] = {self.names.key(key): {
                    'stamp': self._pair(entry['stamp']),
                    'regions': [[[float(x), float(y)] for x, y in region] for region in entry['regions']]}
                    for key, entry in state.get(drawn, {}).items()}
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
            raise CaseError(f'is not a whole file of this version ({error!r}); gravity, regions and outlines are not handed on') from error
        if (new['format'], new['unit']) != ('cortshift case state, version 1', 'm'):
            raise CaseError('is of another version; gravity, regions and outlines are not handed on')
        self._text(path, STATE_NAME, json.dumps(new, indent=1) + '\n')

    def _picks(self, path):
        table = read_table(path)
        rows = []
        for row in table.rows:
            with contextlib.suppress(ValueError, KeyError):
                rows.append([self.names.key(row.cells['stage']), self.names.label(row.cells['label']), row.number('column_px'),
                             row.number('row_px')])
        self._text(path, picks.FILE_NAME, _csv([picks.COLUMNS, *rows]))

    def _summary(self, path):
        reader = csv.DictReader(io.StringIO(read_text(path), newline=''))
        columns = [name for name in reader.fieldnames or () if re.fullmatch(r'[a-z]+(_[a-z]+)*', name) and (
            name.endswith(('_m', '_rad', '_points', '_key')) or name in ('overlap', *SUMMARY_TEXTS))]
        rows = [[self._cell(name, row[name] or '') for name in columns] for row in reader]
        self._text(path, SUMMARY_NAME, _csv([columns, *rows]))

    def _cell(self, name, text):
        if name.endswith('_key'):
            return self.names.key(text)
        if name in SUMMARY_TEXTS:
            return ' | '.join(words.sentence(part) for part in text.split(' | '))
        try:
            float(text or 'nan')
        except ValueError:
            return ''
        return text

    def _calibration(self, path):
        content = read_yaml(path)
        if not isinstance(content, dict):
            raise CaseError('is no file of a calibration')
        clean = self._numbers(content)
        if not clean:
            raise CaseError('holds nothing of a calibration')
        self._text(path, f'calibration_{sum(name.startswith("calibration_") for name in self.done.files) + 1}.yaml',
                   yaml.safe_dump(clean, sort_keys=False))

    def _numbers(self, value, key=''):
        """Numbers and dates of a calibration file; None: nothing of it stays."""
        if isinstance(value, dict):
            items = ((name, self._numbers(below, name)) for name, below in value.items() if words.own_key(name))
            return {name: below for name, below in items if below is not None} or None
        if isinstance(value, list):
            return [below for below in (self._numbers(item) for item in value) if below is not None]
        if 'date' in str(key).lower():
            return self.names.date(value) or None
        if isinstance(value, (bool, int, float)):
            return value if not abs(value) >= words.LARGEST else None
        return value if value in words.VALUES else None

    def _write_mr(self, source):
        path = source.path if source else next((path for path in (os.path.join(self.folder, name) for name in MR_NAMES)
                                                if os.path.exists(path)), None)
        if path is None:
            return
        volume = load_volume(path, source.axes, source.form, source.series) if source else load_volume(path)
        save_nifti(volume, os.path.join(self.out, MR_NAMES[1]))
        self.done.mr = True


@contextlib.contextmanager
def _new(path):
    """Removes what is still there under a temporary name at the end."""
    try:
        yield path
    finally:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path)


def _csv(rows):
    text = io.StringIO()
    csv.writer(text, lineterminator='\n').writerows(rows)
    return text.getvalue()


def _said(done):
    return SAID + f'{done.stages} stages, {done.fields} fields{", the MR" if done.mr else ""}.\n'
