"""Puts names and dates wherever a case can hold them, and looks for them in the bytes of a folder."""
import gzip
import os
import struct
import zlib

import genpy
import rosbag
import roslz4

NAME, PLACE = 'Mustermann', 'Klinikum_Adorf'
DATE = '1957-04-12'
#: Texts that have a form of their own: with another one the message is none, and is refused.
FORMED = {('sensor_msgs/CameraInfo', 'distortion_model'), ('sensor_msgs/PointField', 'name'), ('sensor_msgs/Image', 'encoding')}
#: Texts by which parts of a case find each other: renamed alike everywhere.
LINKS = {('cortshift_msgs/StageInfo', 'key'), ('std_msgs/Header', 'frame_id'), ('geometry_msgs/TransformStamped', 'child_frame_id')}


def texts_of(message):
    """(message, slot, value) of every text in a message, lists of texts included."""
    for slot, kind in zip(message.__slots__, message._slot_types):
        value = getattr(message, slot)
        if kind in ('string', 'string[]'):
            yield message, slot, value
        elif isinstance(value, genpy.Message):
            yield from texts_of(value)
        elif isinstance(value, (list, tuple)) and value and isinstance(value[0], genpy.Message):
            for item in value:
                yield from texts_of(item)


def stamps_of(message):
    """Every time in a message."""
    for slot, kind in zip(message.__slots__, message._slot_types):
        value = getattr(message, slot)
        if kind == 'time':
            yield value
        elif isinstance(value, genpy.Message):
            yield from stamps_of(value)
        elif isinstance(value, (list, tuple)) and value and isinstance(value[0], genpy.Message):
            for item in value:
                yield from stamps_of(item)


def plant(message, text):
    """`text` in every place of a message that a person or a program may have written it to."""
    for owner, slot, value in list(texts_of(message)):
        place = owner._type, slot
        if place in FORMED or place in LINKS or slot in ('from_key', 'to_key'):
            continue
        if owner._type == 'std_msgs/String':
            setattr(owner, slot, value + f'settings_calibration: "/data/{text}"\nnote: {text}\n{text}: 3\n')
        else:
            setattr(owner, slot, [*value, text] if isinstance(value, list) else f'{value} {text}')
    return message


def bytes_of(path):
    """What a file holds, with everything in it that is compressed taken out as well."""
    with open(path, 'rb') as file:
        data = file.read()
    if data[:2] == b'\x1f\x8b':
        return data + gzip.decompress(data)
    if data.startswith(b'#ROSBAG'):
        return data + b''.join(chunks_of(data))
    return data


def chunks_of(data):
    place = data.index(b'\n') + 1
    while place < len(data):
        length, = struct.unpack_from('<I', data, place)
        header, place = data[place + 4:place + 4 + length], place + 4 + length
        length, = struct.unpack_from('<I', data, place)
        body, place = data[place + 4:place + 4 + length], place + 4 + length
        if b'op=\x05' in header:
            yield roslz4.decompress(body) if b'compression=lz4' in header else body


def files_below(folder):
    return sorted(os.path.join(below, name) for below, _, names in os.walk(folder) for name in names)


def found(folder, *secrets):
    """(file, secret) where a secret stands in a name or in the bytes, as UTF-8 or UTF-16, in whatever case."""
    hits = []
    for path in files_below(folder):
        data = (os.path.relpath(path, folder).encode() + bytes_of(path)).lower()
        for secret in secrets:
            forms = [secret] if isinstance(secret, bytes) else [secret.lower().encode(), secret.lower().encode('utf-16-le')]
            if any(form.lower() in data for form in forms):
                hits.append((os.path.relpath(path, folder), secret))
    return hits


def rewritten(path, change, extra=()):
    """Replace a bag: change(topic, message, time) gives what stands in its place; extra: more (topic, message, time).

    The bag's connections name a caller, as those of a recording do. Returns nothing; a stage keeps its checksum right.
    """
    with rosbag.Bag(path) as bag:
        entries = [change(topic, message, time) for topic, message, time in bag.read_messages()]
    with rosbag.Bag(path, 'w', compression='lz4') as bag:
        for topic, message, time in [*entries, *extra]:
            bag.write(topic, message, time, connection_header={
                'topic': topic, 'type': message._type, 'md5sum': message._md5sum, 'message_definition': message._full_text,
                'callerid': f'/{NAME}'})
    name = os.path.basename(path)
    if name[:4].isdigit():
        with open(path, 'rb') as file:
            checksum = zlib.crc32(file.read())
        os.rename(path, os.path.join(os.path.dirname(path), f'{name[:-13]}_{checksum:08x}.bag'))


def png_with_text(data, text):
    """A PNG with a text chunk after its header, and bytes behind its end."""
    body = b'tEXtAuthor\0' + text.encode()
    chunk = struct.pack('>I', len(body) - 4) + body + struct.pack('>I', zlib.crc32(body))
    return data[:33] + chunk + data[33:] + text.encode()


def jpeg_with_text(data, text):
    """A JPEG with EXIF-like and comment segments, and bytes behind its end."""
    segments = b''.join(b'\xff' + marker + struct.pack('>H', 2 + len(body)) + body
                        for marker, body in ((b'\xe1', b'Exif\0\0' + text.encode()), (b'\xfe', text.encode())))
    return data[:2] + segments + data[2:] + text.encode()
