"""The console as a page for a browser on this machine."""
import base64
import hmac
import json
import os
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import rospy
from cv_bridge import CvBridge
from sensor_msgs.msg import Image

from cortshift_tracking.console.worker import DeskError
from cortshift_tracking.errors import CortshiftError

PAGE = Path(__file__).with_name('page.html')
PICTURES = {'outline': 'shift/outline', 'overlay_before': 'shift/overlay_before', 'overlay_after': 'shift/overlay_after', 'magnitude': 'shift/magnitude'}
PATHS = {f'/picture/{name}.png': name for name in PICTURES}
MAX_REQUEST = 4096       # bytes
MAX_CORNERS = 200        # of an outline; the page thins what is drawn
WIDEST_PICTURE = 900     # pixels; more does not fit beside the others
SHORTEST_TOKEN = 16      # characters
HEADER = 'X-Cortshift'   # a form of another page cannot send it


CLOSED = {
    'Cache-Control': 'no-store',
    'Content-Security-Policy': "default-src 'self'; img-src 'self' data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
                               "frame-ancestors 'none'; form-action 'none'; base-uri 'none'",
    'X-Frame-Options': 'DENY', 'Cross-Origin-Resource-Policy': 'same-origin', 'Cross-Origin-Opener-Policy': 'same-origin',
    'X-Content-Type-Options': 'nosniff', 'Referrer-Policy': 'no-referrer'}


class TokenError(CortshiftError):
    """A file of a token that cannot be used; the message says why."""


def token_of(path):
    """The token in a file, for the page; '' where no file is named. TokenError where it is readable by others, short or missing."""
    if not path:
        return ''
    try:
        mode, token = os.stat(path).st_mode, Path(path).read_text(encoding='utf-8').strip()
    except (OSError, UnicodeDecodeError) as error:
        raise TokenError(f'the token cannot be read: {error}') from error
    if mode & 0o077:
        raise TokenError(f'{path} can be read by others: chmod 600 it')
    if len(token) < SHORTEST_TOKEN:
        raise TokenError(f'{path}: a token has at least {SHORTEST_TOKEN} characters; openssl rand -hex 16 makes one')
    return token


class Pictures:
    """The newest picture of each kind as PNG, encoded when it is asked for."""

    def __init__(self):
        self._lock = threading.Lock()
        self._messages, self._numbers, self._bridge = {}, dict.fromkeys(PICTURES, 0), CvBridge()
        for name, topic in PICTURES.items():
            rospy.Subscriber(topic, Image, self._keep, name, queue_size=1, buff_size=1 << 25)

    def _keep(self, message, name):
        with self._lock:
            self._messages[name] = message
            self._numbers[name] += 1

    def numbers(self):
        """How often each has changed: the page loads a picture when its number does."""
        with self._lock:
            return dict(self._numbers)

    def png(self, name):
        """Bytes of the picture; None where there is none yet."""
        with self._lock:
            message = self._messages.get(name)
        if message is None:
            return None
        image = self._bridge.imgmsg_to_cv2(message, 'bgr8')
        scale = min(1.0, WIDEST_PICTURE / max(image.shape[:2]))
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        return cv2.imencode('.png', image)[1].tobytes()


def status_of(desk, pictures):
    """Everything that the page shows, for JSON."""
    activity, tracker = desk.activity, desk.tracker
    return {
        'activity': {'what': activity.what, 'busy': activity.busy, 'success': activity.success, 'message': activity.message,
                     'progress': desk.progress()},
        'shift': dict(zip(('stages', 'numbers'), desk.shift)),
        'coverage': desk.coverage(), 'warnings': desk.warnings(), 'live': tracker.live,
        'live_from': tracker.live_from, 'gravity': tracker.gravity, 'exclusions': tracker.exclusions,
        'outlined': desk.outlined,
        'phantom_stages_left': desk.phantom_stages_left,
        'stages': [{'key': s.key, 'note': s.note, 'stamp': s.stamp.to_sec(), 'coverage': s.coverage, 'epoch': s.epoch}
                   for s in desk.stages],
        'pictures': pictures.numbers(),
    }


class Handler(BaseHTTPRequestHandler):
    """GET /, /status, /picture/NAME.png; POST /capture {note}, /compute, /live {on}, /phantom, /outline {key, line}."""

    server_version, sys_version = 'cortshift', ''

    def do_GET(self):
        if not self._from_here():
            return
        path = self.path.split('?')[0]
        if path == '/':
            self._answer(PAGE.read_bytes(), 'text/html; charset=utf-8')
        elif path == '/status':
            self._answer_json(status_of(self.server.desk, self.server.pictures))
        elif path in PATHS:
            png = self.server.pictures.png(PATHS[path])
            if png is None:
                self.send_error(HTTPStatus.NOT_FOUND, 'no such picture yet')
            else:
                self._answer(png, 'image/png')
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def do_POST(self):
        desk = self.server.desk
        requests = {'/capture': lambda body: desk.capture(text_of(body, 'note')), '/compute': lambda _: desk.compute_last_pair(),
                    '/live': lambda body: desk.set_live(body.get('on') is True), '/phantom': lambda _: desk.next_phantom_stage(),
                    '/outline': lambda body: desk.set_outline(text_of(body, 'key'), line_of(body, 'line'))}
        if not self._from_here():
            return
        if self.headers.get(HEADER) is None:
            self.send_error(HTTPStatus.FORBIDDEN, f"only the console's own page asks, with header {HEADER}")
            return
        try:
            size = int(self.headers.get('Content-Length') or 0)
            if not 0 <= size <= MAX_REQUEST:
                raise ValueError(f'a request has at most {MAX_REQUEST} bytes')
            body = json.loads(self.rfile.read(size) or b'{}')
            if not isinstance(body, dict):
                raise ValueError('a request is a JSON object')
            requests[self.path](body)
        except KeyError:
            self.send_error(HTTPStatus.NOT_FOUND)
        except ValueError as error:
            self._answer_json({'accepted': False, 'message': str(error)}, HTTPStatus.BAD_REQUEST)
        except DeskError as error:
            self._answer_json({'accepted': False, 'message': str(error)}, HTTPStatus.CONFLICT)
        else:
            self._answer_json({'accepted': True, 'message': ''})

    def _from_here(self):
        """Another name for this machine in the request comes from a page that pretends to be ours."""
        port = self.server.server_address[1]
        allowed = [f'{name}:{port}' for name in ('127.0.0.1', 'localhost')]
        origin = self.headers.get('Origin')
        if self.headers.get('Host') in allowed and (origin is None or origin in ['http://' + host for host in allowed]):
            return self._knows_token()
        self.send_error(HTTPStatus.FORBIDDEN, 'this page is for browsers on this machine alone')
        return False

    def end_headers(self):
        """Of every answer, refusals too: no other page may frame, embed or keep what is shown here."""
        for name, value in CLOSED.items():
            self.send_header(name, value)
        super().end_headers()

    def _knows_token(self):
        """Where the site wants a token, the browser asks for it (as password; any name) and sends it from then on."""
        token = self.server.token
        kind, _, given = (self.headers.get('Authorization') or '').partition(' ')
        try:
            password = base64.b64decode(given, validate=True).partition(b':')[2] if kind == 'Basic' else b''
        except ValueError:
            password = b''
        if not token or hmac.compare_digest(password, token.encode()):
            return True
        self.send_response(HTTPStatus.UNAUTHORIZED, 'the token of this console is needed')
        self.send_header('WWW-Authenticate', 'Basic realm="cortshift: token as password", charset="UTF-8"')
        self.send_header('Content-Length', '0')
        self.end_headers()
        return False

    def _answer_json(self, value, status=HTTPStatus.OK):
        self._answer(json.dumps(value).encode(), 'application/json', status)

    def _answer(self, content, kind, status=HTTPStatus.OK):
        self.send_response(status)
        self.send_header('Content-Type', kind)
        self.send_header('Content-Length', str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_):
        pass  # the page asks twice a second


def text_of(body, key):
    value = body.get(key, '')
    if not isinstance(value, str):
        raise ValueError(f'{key} is a text')
    return value


def line_of(body, key):
    """A closed line [(x, y)]; empty: none."""
    line = body.get(key)
    if not isinstance(line, list) or len(line) in (1, 2) or len(line) > MAX_CORNERS:
        raise ValueError(f'{key} is a list of no or 3 to {MAX_CORNERS} points')
    for point in line:
        if not isinstance(point, list) or len(point) != 2 or not all(type(v) in (int, float) and 0 <= v <= 4 for v in point):
            raise ValueError(f'{key}: a point is [x, y] in widths of the picture')
    return [tuple(point) for point in line]


class PageServer:
    """Serves the page on loopback from threads of its own; `port` 0 takes a free one. token: asked for where it is not empty."""

    def __init__(self, desk, port, token=''):
        self._server = ThreadingHTTPServer(('127.0.0.1', port), Handler)
        self._server.daemon_threads = True
        self._server.desk, self._server.pictures, self._server.token = desk, Pictures(), token
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    @property
    def address(self):
        return f'http://127.0.0.1:{self._server.server_address[1]}/'

    def stop(self):
        self._server.shutdown()
        self._server.server_close()
