"""Checks an operating room before a case: calibration, cameras, tracker, disk, clock.

    script/preflight [--site config/site.yaml]

Prints one line for each check: ok, WARN or FAIL with what to do. Nothing is changed and no image is taken.
Exit status: 0 nothing failed, 1 something failed, 2 bad usage."""
import argparse
import ctypes
import datetime
import math
import os
import re
import shutil
import socket
import struct
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import rosgraph

from cortshift_tracking.errors import CaseError
from cortshift_tracking.texts import read_text, read_yaml
from cortshift_tracking.theatre.site_keys import KeyFault, given, given_texts, section

OK, WARN, FAIL = 'ok', 'WARN', 'FAIL'
DATE = re.compile(r'\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ')
DAY = 86400.0
GIGABYTE = 1e9
HEADER = struct.Struct('> H 12s 20s Q Q Q')  # of OpenIGTLink: version, type, device, time stamp, size of the body, CRC
LONGEST_NAME = 20    # bytes, as above
MAX_BODY = 1 << 28
TIME_ERROR = 5       # of adjtimex: the clock is not synchronised
LISTEN = 2.0         # s that a tracker is listened to
MAX_CLOCK_OFFSET = 0.5  # s between the tracker's clock and ours, the bridge's default


@dataclass
class Limits:
    """Of a site, under the key `preflight` of its file; these are the defaults."""
    calibration_days: float = 90.0  # older: WARN, twice as old: FAIL
    disk_gb: float = 20.0           # less: FAIL; a case of two hours with its recording
    clock_must_be_synchronised: bool = False  # true with several machines, or with a tracker that has a clock of its own


@dataclass
class Finding:
    level: str
    check: str
    text: str


def calibration_date(path):
    """Date of a calibration in seconds since 1970, and whether it says so itself (else the file's own date)."""
    found = DATE.search(read_text(path))
    if found is None:
        return path.stat().st_mtime, False
    try:
        return datetime.datetime.fromisoformat(found.group().replace('Z', '+00:00')).timestamp(), True
    except ValueError as error:
        raise CaseError(f'{path}: {found.group()} is no date') from error


def age_finding(check, path, limits, now):
    date, said = calibration_date(path)
    days = (now - date) / DAY
    text = f'{path} is {days:.0f} days old' + ('' if said else ' by its file date; it does not say its own')
    if days < -1:
        return Finding(FAIL, check, f'{path} is from the future ({-days:.0f} days); check the clock')
    if days > 2 * limits.calibration_days:
        return Finding(FAIL, check, f'{text} (at most {2 * limits.calibration_days:.0f}); calibrate again')
    if days > limits.calibration_days:
        return Finding(WARN, check, f'{text}; calibrate soon (from {limits.calibration_days:.0f} days on)')
    return Finding(OK if said else WARN, check, text)


def check_calibration(driver, limits, now):
    """Findings, and the calibrated image size or None."""
    paths, findings, loaded = {}, [], {}
    for key in ('calibration_left', 'calibration_right', 'hand_eye'):
        try:
            value = paths[key] = given(driver, key, str, 'stereo_driver/', f'{key}: /var/lib/cortshift/{key}.yaml')
        except KeyFault as error:
            findings.append(Finding(FAIL, key, str(error)))
            continue
        if not value:
            if key == 'hand_eye':
                findings.append(Finding(WARN, key, 'none: microscope -> left_optical must be published by something else'))
            else:
                findings.append(Finding(FAIL, key, f'none; set stereo_driver/{key}'))
            continue
        try:
            content = read_yaml(value)
            if not isinstance(content, dict):
                raise CaseError(f'{value}: holds no calibration')
            findings.append(age_finding(key, Path(value), limits, now))
            loaded[key] = content
        except CaseError as error:
            findings.append(Finding(FAIL, key, f'{error}; calibrate, or correct the path'))
    lenses = [lens_finding(key, loaded[key]) for key in loaded if key != 'hand_eye']
    findings += [finding for finding in lenses if finding]
    if 'calibration_left' not in loaded or 'calibration_right' not in loaded:
        return findings, None
    return findings + match_findings(paths, loaded), image_size(loaded['calibration_left'])


def image_size(camera):
    """Columns and rows as the file says them."""
    return camera.get('image_width', camera.get('width')), camera.get('image_height', camera.get('height'))


def camera_numbers(camera, key, short_key):
    """Numbers of a camera_info: {data: [...]}, a flat list or a list of rows, by its own key or the message's.

    Raises KeyError, TypeError or ValueError where there are none. YAML has text in 1e-05, yaml-cpp a number.
    """
    found = camera[key] if key in camera else camera[short_key]
    found = found['data'] if isinstance(found, dict) else found
    if not isinstance(found, list):
        raise TypeError(key)
    numbers = [float(number) for row in found for number in (row if isinstance(row, list) else [row])]
    if not all(map(math.isfinite, numbers)):
        raise ValueError(key)
    return numbers


LENSES = {'plumb_bob': (0, 4, 5), 'rational_polynomial': (8,), 'equidistant': (4,)}


def lens_finding(key, camera):
    """What the nodes would refuse; None where they would not."""
    model = camera.get('distortion_model')
    if not isinstance(model, str) or model not in LENSES:
        return Finding(FAIL, key, f'distortion_model is {model!r}; supported are {", ".join(LENSES)}')
    try:
        terms = camera_numbers(camera, 'distortion_coefficients', 'D')
    except (KeyError, TypeError, ValueError):
        return Finding(FAIL, key, 'distortion_coefficients are missing, or no list of numbers; calibrate again')
    if not all(isinstance(length, int) for length in image_size(camera)):
        return Finding(FAIL, key, f'image_width and image_height are {image_size(camera)}, not whole numbers; calibrate again')
    needed = max(LENSES[model])
    if model != 'equidistant' and len(terms) in (8, 12, 14) and not any(terms[needed:]):
        terms = terms[:needed]  # OpenCV fills up with zeros
    if len(terms) not in LENSES[model]:
        return Finding(FAIL, key, f'{len(terms)} distortion_coefficients; {model} has {needed}')
    return None


def match_findings(paths, loaded):
    """Whether the files belong to each other."""
    left, right = loaded['calibration_left'], loaded['calibration_right']
    if image_size(left) != image_size(right):
        return [Finding(FAIL, 'calibration match', f'left is for {image_size(left)} pixels, right for {image_size(right)}; '
                        'take both files of one calibration')]
    try:
        projection = [camera_numbers(camera, 'projection_matrix', 'P') for camera in (left, right)]
        same = all(projection[0][i] == projection[1][i] for i in (0, 5))
        baseline = -projection[1][3] / projection[1][0]
    except (KeyError, TypeError, ValueError, IndexError, ZeroDivisionError):
        return [Finding(FAIL, 'calibration match', 'projection_matrix is missing or incomplete; calibrate again')]
    dates = {key: calibration_date(Path(paths[key])) for key in loaded}
    if not same or not 0.001 < baseline < 0.5:
        return [Finding(FAIL, 'calibration match', f'the two files are not of one stereo calibration (baseline {baseline} m)')]
    if dates['calibration_left'][1] and dates['calibration_right'][1] and \
            dates['calibration_left'][0] != dates['calibration_right'][0]:
        return [Finding(FAIL, 'calibration match', 'left and right are of different dates; take both files of one calibration')]
    if 'hand_eye' in loaded and dates['hand_eye'][0] < dates['calibration_left'][0] and dates['hand_eye'][1]:
        return [Finding(FAIL, 'calibration match', 'hand_eye is older than the stereo calibration it builds on; '
                        'run calibrate_hand_eye again')]
    return [Finding(OK, 'calibration match', f'{image_size(left)[0]} x {image_size(left)[1]} pixels, '
                    f'baseline {1000 * baseline:.2f} mm')]


def check_cameras(driver, size):
    source = given(driver, 'source', str, 'stereo_driver/', 'source: aravis')
    if source != 'aravis':
        if source in ('', 'none'):
            return [Finding(FAIL, 'cameras', 'stereo_driver/source is none; set it to aravis in the site file')]
        return [Finding(OK, 'cameras', f'source {source}: none to check')]
    cameras = given(driver, 'aravis', dict, 'stereo_driver/', 'left: and right: below it, indented')
    sides = {side: given(cameras, side, dict, 'stereo_driver/aravis/', side + ': {device: 192.168.1.11}') for side in ('left', 'right')}
    tool = shutil.which('arv-tool-0.8')
    if tool is None:
        return [Finding(WARN, 'cameras', 'not checked: install aravis-tools-cli')]
    findings = []
    for side, camera in sides.items():
        device, check = camera.get('device'), f'{side} camera'
        features = given_texts(camera, 'features', f'stereo_driver/aravis/{side}/', 'features: ["Width=1920", "Height=1080"]')
        if isinstance(device, (dict, list, bool)):
            raise KeyFault(f'stereo_driver/aravis/{side}/device is {device!r:.60}, not an address or a name; write device: 192.168.1.11')
        if not device:
            findings.append(Finding(FAIL, check, f'no device; set stereo_driver/aravis/{side}/device'))
            continue
        by_address = re.fullmatch(r'\d+\.\d+\.\d+\.\d+', str(device))
        try:
            run = subprocess.run([tool, '-a' if by_address else '-n', str(device), 'control', 'Width', 'Height'], timeout=60,
                                 capture_output=True, text=True, errors='replace')
        except subprocess.TimeoutExpired:
            findings.append(Finding(FAIL, check, f'{device} does not answer within 60 s; check power, cable and address'))
            continue
        found = dict(re.findall(r'(Width|Height) = (\d+)', run.stdout))
        if len(found) < 2:
            said = (run.stdout + run.stderr).strip().replace('\n', ' ')
            findings.append(Finding(FAIL, check, f'{device} does not answer ({said or "nothing"}); check power, cable and address'))
        elif size is not None and (int(found['Width']), int(found['Height'])) != size and \
                not any(f.startswith(('Width=', 'Height=')) for f in features):
            findings.append(Finding(FAIL, check, f'{device} gives {found["Width"]} x {found["Height"]} pixels, the calibration is '
                                    f'for {size[0]} x {size[1]}; set Width and Height, or calibrate again'))
        else:
            findings.append(Finding(OK, check, f'{device} answers, {found["Width"]} x {found["Height"]} pixels'))
    return findings


def is_server(text):
    """Whether the bridge would take it: an IPv4 address and a port."""
    address, _, port = text.rpartition(':')
    try:
        socket.inet_pton(socket.AF_INET, address)
    except (OSError, ValueError):
        return False
    return re.fullmatch('[0-9]{1,5}', port) is not None and 0 < int(port) < 65536


def listen(server, seconds):
    """{device or tool name: newest stamp [s]} that an OpenIGTLink server sends, and our clock at that time. OSError."""
    host, port = server.rsplit(':', 1)
    heard, end = {}, time.monotonic() + seconds
    with socket.create_connection((host, int(port)), timeout=seconds) as link:
        def read(count):
            data = b''
            while len(data) < count:
                link.settimeout(max(0.01, end - time.monotonic()))
                part = link.recv(min(1 << 16, count - len(data)))
                if not part:
                    raise OSError('the connection was closed')
                data += part
            return data
        try:
            while time.monotonic() < end:
                _, kind, device, stamp, size, _ = HEADER.unpack(read(HEADER.size))
                if size > MAX_BODY:
                    raise OSError('it does not speak OpenIGTLink')
                body = read(size)
                seconds_of = (stamp >> 32) + (stamp & 0xffffffff) / 2 ** 32
                names = [device]
                if kind.rstrip(b'\0') == b'TDATA':
                    names += [body[i:i + 20] for i in range(0, len(body) - 69, 70)]
                for name in names:
                    heard[name.rstrip(b'\0').decode(errors='replace')] = (seconds_of, time.time())
        except socket.timeout:
            pass
    return heard


def check_tracker(bridge):
    servers = given_texts(bridge, 'servers', 'igtl_bridge/', 'servers: ["192.168.1.20:18944"]')
    tools, example = [], 'tools: [{device: MicroscopeToRef, parent: reference, child: microscope}]'
    for tool in given(bridge, 'tools', list, 'igtl_bridge/', example):
        if not isinstance(tool, dict) or not isinstance(tool.get('device'), str) or not tool['device']:
            raise KeyFault(f'igtl_bridge/tools holds {tool!r:.60}, not a dictionary with the name of a device; write {example}')
        tools.append(tool['device'])
    if not tools:
        return [Finding(FAIL, 'tracker', 'no tools; list them under igtl_bridge/tools in the site file')]
    too_long = [tool for tool in tools if len(str(tool).encode()) > LONGEST_NAME]
    if too_long:
        return [Finding(FAIL, f'tool {tool}', f'the name has {len(str(tool).encode())} characters and OpenIGTLink has room for {LONGEST_NAME}; '
                        'give the name that the navigation system sends') for tool in too_long]
    if not servers:
        return [Finding(WARN, 'tracker', f'it connects to us (no igtl_bridge/servers); wait for {", ".join(tools)} to be OK in the '
                        'diagnostics')]
    findings, heard = [], {}
    for server in servers:
        if not is_server(server):
            findings.append(Finding(FAIL, 'tracker', f'igtl_bridge/servers holds {server!r:.60}, not ADDRESS:PORT in numbers; write '
                                    '192.168.1.20:18944'))
            continue
        try:
            heard.update(listen(server, LISTEN))
            findings.append(Finding(OK, 'tracker', f'{server} answers'))
        except OSError as error:
            findings.append(Finding(FAIL, 'tracker', f'{server}: {error}; start the navigation system, check address and firewall'))
    for tool in tools:
        if tool not in heard:
            findings.append(Finding(WARN, f'tool {tool}', f'not heard for {LISTEN:.0f} s: out of sight, or of another name '
                                    f'(heard: {", ".join(sorted(heard)) or "nothing"})'))
            continue
        stamp, arrived = heard[tool]
        offset = stamp - arrived
        if stamp == 0 or abs(offset) > MAX_CLOCK_OFFSET:
            findings.append(Finding(FAIL, f'tool {tool}', 'its messages carry no time stamp' if stamp == 0 else
                                    f'its clock differs from ours by {offset:.3f} s; synchronise both by NTP'))
        else:
            findings.append(Finding(OK, f'tool {tool}', f'heard, clock {1000 * offset:+.0f} ms from ours'))
    return findings


def existing(path):
    """The folder itself or the nearest one above it that exists."""
    path = Path(path).expanduser().absolute()
    while not path.exists():
        path = path.parent
    return path


def check_disk(site, limits):
    home = os.environ.get('ROS_HOME') or '~/.ros'
    findings = []
    for check, name, key in (('case folder', 'shift_tracker', 'case_folder'), ('recording', 'case_recorder', 'folder')):
        try:
            folder = given(section(site, name), key, str, name + '/', f'{key}: /data/cases') or home
            place = existing(folder)
        except KeyFault as error:
            findings.append(Finding(FAIL, check, str(error)))
            continue
        except (OSError, RuntimeError, ValueError):  # above it no one may look; "~" of nobody; a zero byte
            findings.append(Finding(FAIL, check, f'{name}/{key}: {folder!r} cannot be looked at; correct the path or the rights above it'))
            continue
        left = shutil.disk_usage(place).free / GIGABYTE
        text = f'{left:.1f} GB are free for {folder}'
        if not os.access(place, os.W_OK):
            findings.append(Finding(FAIL, check, f'{place} may not be written; correct its rights or the path'))
        elif left < limits.disk_gb:
            findings.append(Finding(FAIL, check, f'{text}, less than {limits.disk_gb:.0f} GB; free some'))
        else:
            findings.append(Finding(OK, check, text))
    return findings


def check_clock(limits):
    buffer = ctypes.create_string_buffer(1024)  # struct timex, larger than any; modes = 0 only reads
    state = ctypes.CDLL(None, use_errno=True).adjtimex(buffer)
    if state < 0:
        return [Finding(WARN, 'clock', f'not checked: {os.strerror(ctypes.get_errno())}')]
    if state == TIME_ERROR:
        return [Finding(FAIL if limits.clock_must_be_synchronised else WARN, 'clock',
                        'not synchronised; start chrony or systemd-timesyncd with the server that the tracker uses')]
    return [Finding(OK, 'clock', 'synchronised')]


def check_simulated_time():
    """A replay leaves use_sim_time on the master: the clocks of nodes that are started then stand still."""
    try:
        left = rosgraph.Master('/preflight').hasParam('/use_sim_time') and rosgraph.Master('/preflight').getParam('/use_sim_time')
    except (rosgraph.MasterException, OSError):
        return []  # no master: nothing can be left on it
    if left:
        return [Finding(FAIL, 'use_sim_time', 'the master says use_sim_time, left there by a replay: clocks of nodes stand still; '
                        'rosparam set use_sim_time false, and start again what runs already')]
    return [Finding(OK, 'use_sim_time', 'not set: nodes use the clock of the machine')]


def preflight(site, now=None):
    """All findings. site: contents of the site's file. ValueError for a file that is no site file."""
    if not isinstance(site, dict):
        raise ValueError('it is not a dictionary of nodes')
    own = section(site, 'preflight')
    unknown = set(own) - set(Limits.__dataclass_fields__)
    if unknown:
        raise ValueError(f'preflight/{sorted(unknown)[0]} is unknown; known are {", ".join(Limits.__dataclass_fields__)}')
    for key, value in own.items():
        standard = getattr(Limits, key)
        if isinstance(value, bool) != isinstance(standard, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise ValueError(f'preflight/{key} = {value!r} is not {"true or false" if isinstance(standard, bool) else "a number"}')
    limits = Limits(**own)
    driver, bridge = section(site, 'stereo_driver'), section(site, 'igtl_bridge')
    findings, size = check_calibration(driver, limits, now or time.time())
    for check, of, *arguments in (('cameras', check_cameras, driver, size), ('tracker', check_tracker, bridge)):
        try:
            findings += of(*arguments)
        except KeyFault as error:
            findings.append(Finding(FAIL, check, str(error)))
    return [*findings, *check_disk(site, limits), *check_clock(limits), *check_simulated_time()]


def main(words):
    parser = argparse.ArgumentParser(prog='preflight', description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--site', default='config/site.yaml', help='file of the site (default: config/site.yaml)')
    site = parser.parse_args(words).site
    try:
        findings = preflight(read_yaml(site))
    except CaseError as error:
        print(f'preflight: {error}', file=sys.stderr)
        return 1
    except ValueError as error:
        print(f'preflight: {site}: {error}', file=sys.stderr)
        return 1
    width = max(len(finding.check) for finding in findings)
    for finding in findings:
        print(f'{finding.level:<4}  {finding.check:<{width}}  {finding.text}')
    failed = sum(finding.level == FAIL for finding in findings)
    print(f'{len(findings)} checks: ' + (f'{failed} failed' if failed else 'ready'))
    return 1 if failed else 0
