"""Image files without what is written beside the pixels: text, camera, place, time. The pixels stay to the bit."""
import struct

from cortshift_tracking.errors import CaseError

PNG, JPEG = b'\x89PNG\r\n\x1a\n', b'\xff\xd8'
PNG_KEPT = (b'IHDR', b'PLTE', b'tRNS', b'IDAT', b'IEND')
#: JPEG segments that are only for people: APP1 to APP13, APP15 and comments. APP0 is JFIF, APP14 says how colours are coded.
JPEG_DROPPED = {0xe1 + n for n in range(13)} | {0xef, 0xfe}
JPEG_SCAN, JPEG_END, JFIF = 0xda, 0xd9, b'JFIF\0'
JFIF_LENGTH = 16   # without a thumbnail


def pixels_only(data):
    """The file's bytes with its pixels alone. Raises CaseError for what is neither PNG nor JPEG, or cut."""
    try:
        if data.startswith(PNG):
            return _png(data)
        if data.startswith(JPEG):
            return _jpeg(data)
    except (struct.error, IndexError) as error:
        raise CaseError('an image is cut or damaged; take it out') from error
    raise CaseError('an image is neither PNG nor JPEG, so that what it carries beside its pixels is not known; convert it')


def _png(data):
    out, place = [PNG], len(PNG)
    while True:
        length, kind = struct.unpack_from('>I4s', data, place)
        end = place + 12 + length
        if end > len(data):
            raise IndexError
        if kind in PNG_KEPT:
            out.append(data[place:end])
        elif not kind[0] & 0x20:
            raise CaseError(f'an image has the part {kind!r}, which it cannot be read without; convert it')
        if kind == b'IEND':
            return b''.join(out)
        place = end


def _jpeg(data):
    out, place = [JPEG], len(JPEG)
    while True:
        if data[place] != 0xff:
            raise IndexError
        kind = data[place + 1]
        if kind == 0xff:   # a filling byte
            place += 1
            continue
        if kind == JPEG_END:
            return b''.join([*out, data[place:place + 2]])
        length = struct.unpack_from('>H', data, place + 2)[0]
        end = place + 2 + length
        if length < 2 or end > len(data):
            raise IndexError
        if kind == 0xe0 and data[place + 4:place + 9] == JFIF and length >= JFIF_LENGTH:
            out.append(b'\xff\xe0' + struct.pack('>H', JFIF_LENGTH) + data[place + 4:place + 16] + b'\0\0')
        elif kind not in JPEG_DROPPED and kind != 0xe0:
            out.append(data[place:end])
        place = end
        if kind == JPEG_SCAN:
            while not (data[place] == 0xff and data[place + 1] not in (0, *range(0xd0, 0xd8))):
                place += 1
            out.append(data[end:place])
