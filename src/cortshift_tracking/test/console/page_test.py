"""The console's page without a graph: it cannot be framed or embedded by another page, and asks for a token where a site wants one."""
import base64
import http.client
import json
import math
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np
import pytest
from cortshift_tracking.console.drawing import Grid, area_of
from cortshift_tracking.console.graph_state import TrackerState
from cortshift_tracking.console.page import CLOSED, Handler, TokenError, token_of
from cortshift_tracking.console.worker import Activity, DeskError
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

TOKEN = '0123456789abcdef'


class NoPictures:
    def png(self, _):
        return None


class Foreign(BaseHTTPRequestHandler):
    """Another site's page, with the console's page in a frame."""

    def do_GET(self):
        content = f'<html><body id="foreign"><iframe src="{self.server.framed}"></iframe></body></html>'.encode()
        self.send_response(200)
        self.send_header('Content-Type', 'text/html')
        self.send_header('Content-Length', str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_):
        pass


def served(handler, **attributes):
    server = ThreadingHTTPServer(('127.0.0.1', 0), handler)
    server.daemon_threads = True
    for name, value in attributes.items():
        setattr(server, name, value)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


@pytest.fixture(name='serve')
def serve_fixture():
    servers = []

    def start(handler=Handler, **attributes):
        servers.append(served(handler, **{'desk': None, 'pictures': NoPictures(), 'token': '', **attributes}))
        return servers[-1].server_address[1]
    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


def asked(port, path='/', method='GET', body=None, **headers):
    connection = http.client.HTTPConnection('127.0.0.1', port, timeout=20)
    connection.request(method, path, body, headers)
    answer = connection.getresponse()
    answer.content = answer.read()
    return answer


@pytest.mark.parametrize('path', ['/', '/picture/magnitude.png', '/nowhere'])
def test_every_answer_is_closed_to_other_pages(serve, path):
    answer = asked(serve(), path)
    assert answer.status == (200 if path == '/' else 404)
    for name, value in CLOSED.items():
        assert answer.headers.get_all(name) == [value]
    assert "frame-ancestors 'none'" in answer.headers['Content-Security-Policy']
    assert (answer.headers['Cross-Origin-Resource-Policy'], answer.headers['X-Content-Type-Options']) == ('same-origin', 'nosniff')


def basic(password):
    return 'Basic ' + base64.b64encode(b'surgeon:' + password.encode()).decode()


@pytest.mark.parametrize('given', [None, basic(''), basic('0123456789abcde'), basic('0123456789abcdef0'), 'Basic ?', 'Bearer ' + TOKEN,
                                   'Basic ' + base64.b64encode(b'\xff\xfe').decode()])
def test_without_the_token_nothing_is_shown_or_done(serve, given):
    port = serve(token=TOKEN)
    headers = {} if given is None else {'Authorization': given}
    for path, method in (('/', 'GET'), ('/status', 'GET'), ('/picture/magnitude.png', 'GET'), ('/capture', 'POST')):
        answer = asked(port, path, method, **{'X-Cortshift': '1', **headers})
        assert answer.status == 401 and answer.headers['WWW-Authenticate'].startswith('Basic realm="cortshift')


def test_with_the_token_the_page_is_there(serve):
    assert asked(serve(token=TOKEN), Authorization=basic(TOKEN)).status == 200


def test_the_file_of_the_token(tmp_path):
    path = tmp_path / 'token'
    with pytest.raises(TokenError, match='cannot be read'):
        token_of(str(path))
    path.write_text(TOKEN + '\n')
    path.chmod(0o644)
    with pytest.raises(TokenError, match='chmod 600'):
        token_of(str(path))
    path.chmod(0o600)
    assert token_of(str(path)) == TOKEN and token_of('') == ''
    path.write_text('short')
    with pytest.raises(TokenError, match='at least 16'):
        token_of(str(path))


@pytest.fixture(name='browser')
def browser_fixture():
    options = webdriver.ChromeOptions()
    options.binary_location = '/usr/bin/chromium'
    for argument in ('--headless', '--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage', '--window-size=1280,1600'):
        options.add_argument(argument)
    browser = webdriver.Chrome(options=options)
    yield browser
    browser.quit()


def test_a_frame_in_a_foreign_page_shows_nothing(serve, browser):
    page = serve()
    foreign = serve(Foreign, framed=f'http://127.0.0.1:{page}/')
    browser.get(f'http://127.0.0.1:{page}/')
    assert browser.find_elements(By.ID, 'capture')   # by itself it is there
    browser.get(f'http://127.0.0.1:{foreign}/')
    assert browser.find_elements(By.ID, 'foreign')
    browser.switch_to.frame(0)
    assert not browser.find_elements(By.ID, 'capture')


# ---- drawing the outline of the brain

GRID = Grid(300, 240, 0.0002)   # 60 mm x 48 mm
CENTRE, RADII = (0.026, 0.030), (0.018, 0.012)   # m, of the brain on it


class Stage:
    """A picture of a stage as shift_tracker draws it: the last row at the top, a legend below; the brain is the red ellipse."""

    def numbers(self):
        return {'outline': 1}

    def png(self, _):
        image = np.full((GRID.height, GRID.width, 3), 190, np.uint8)
        centre, radii = ([int(round(v / GRID.resolution)) for v in pair] for pair in (CENTRE, RADII))
        cv2.ellipse(image, centre, radii, 0, 0, 360, (60, 60, 200), -1)
        image = cv2.resize(image[::-1], None, fx=3, fy=3, interpolation=cv2.INTER_NEAREST)
        return cv2.imencode('.png', np.concatenate([image, np.zeros((56, image.shape[1], 3), np.uint8)]))[1].tobytes()


class Drawn:
    """A desk that takes outlines, and does nothing else."""

    activity, tracker, shift, stages = Activity(), TrackerState(), ('first → second', ()), []
    phantom_stages_left, outlined = None, 'first'

    def __init__(self):
        self.asked = []

    def progress(self):
        return 1.0

    def coverage(self):
        return None

    def warnings(self):
        return []

    def set_outline(self, key, line):
        self.asked.append((key, GRID.outline(line) if line else []))


def outline(port, body, **headers):
    return asked(port, '/outline', 'POST', json.dumps(body), **{'X-Cortshift': '1', **headers})


def test_an_outline_is_drawn_with_the_pointer(serve, browser, tmp_path):
    desk = Drawn()
    port = serve(desk=desk, pictures=Stage())
    browser.get(f'http://127.0.0.1:{port}/')
    wait = WebDriverWait(browser, 20)
    picture = browser.find_element(By.ID, 'outline')
    wait.until(lambda _: picture.get_property('naturalWidth') > 0 and browser.find_element(By.ID, 'draw').is_enabled())
    assert browser.find_element(By.ID, 'outlined').text == 'first'
    assert not browser.find_element(By.ID, 'keep').is_enabled()
    browser.find_element(By.ID, 'draw').click()
    browser.execute_script('arguments[0].scrollIntoView()', picture)
    width, height = picture.size['width'], picture.size['height']
    at = []   # in pixels of the page from the middle of the picture
    for i in range(48):
        x, y = (c + r * f(2 * math.pi * i / 48) for c, r, f in zip(CENTRE, RADII, (math.cos, math.sin)))
        at.append((x / 0.060 * width - width / 2, (0.048 - y) / 0.060 * width - height / 2))
    hand = ActionChains(browser, duration=10).move_to_element_with_offset(picture, *map(round, at[0])).click_and_hold()
    for (x, y), (u, v) in zip(at, at[1:]):
        hand.move_by_offset(round(u) - round(x), round(v) - round(y))
    hand.release().perform()
    wait.until(lambda _: browser.find_element(By.ID, 'keep').is_enabled())
    browser.save_screenshot(str(tmp_path / 'drawing.png'))
    line = cv2.imread(str(tmp_path / 'drawing.png')).astype(int)
    assert ((abs(line - (41, 180, 240)) < 40).all(2)).sum() > 200, 'the line is seen while it is drawn'
    browser.find_element(By.ID, 'keep').click()
    wait.until(lambda _: desk.asked)
    key, corners = desk.asked[0]
    assert key == 'first' and len(corners) > 20
    for x, y in corners:   # to a millimetre: two pixels of the page
        assert abs(math.hypot((x - CENTRE[0]) / RADII[0], (y - CENTRE[1]) / RADII[1]) - 1) < 0.001 / RADII[1]
    assert area_of(corners) == pytest.approx(math.pi * RADII[0] * RADII[1], rel=0.05)
    wait.until(lambda _: browser.find_element(By.ID, 'automatic').is_enabled())
    browser.find_element(By.ID, 'automatic').click()
    wait.until(lambda _: len(desk.asked) == 2)
    assert desk.asked[1] == ('first', [])


def test_an_outline_is_taken_from_the_page_alone_and_must_be_one(serve):
    desk = Drawn()
    port, line = serve(desk=desk, token=TOKEN), [[0.1, 0.1], [0.9, 0.1], [0.5, 0.7]]
    known = {'Authorization': basic(TOKEN)}
    assert outline(port, {'key': 'first', 'line': line}).status == 401
    assert asked(port, '/outline', 'POST', json.dumps({'key': 'first', 'line': line}), **known).status == 403   # without the header
    assert outline(port, {'key': 'first', 'line': line}, Origin='http://elsewhere.example', **known).status == 403
    for wrong in (None, 'x', line[:2], [[0.1, 0.1]] * 201, [*line[:2], [0.1]], [*line[:2], [0.1, True]], [*line[:2], [0.1, -1]],
                  [*line[:2], ['a', 0]], [*line[:2], [0.1, float('nan')]]):
        assert outline(port, {'key': 'first', 'line': wrong}, **known).status == 400, wrong
    assert not desk.asked
    assert outline(port, {'key': 'first', 'line': line}, **known).status == 200
    slip = outline(port, {'key': 'first', 'line': [[0.5, 0.5], [0.51, 0.5], [0.5, 0.51]]}, **known)
    assert slip.status == 409 and 'draw once around the brain' in json.loads(slip.content)['message']
    assert [key for key, _ in desk.asked] == ['first']


def test_a_picture_is_the_grid_upside_down():
    (x0, y0), (x1, y1), _ = GRID.outline([(0, 0), (1, 0.8), (1, 0)])
    assert (x0, y0) == pytest.approx((0, 239 * 0.0002)) and (x1, y1) == pytest.approx((299 * 0.0002, 0))
    assert GRID.outline([(0.5, 0.4), (1, 0.4), (1, 3)])[2] == pytest.approx((299 * 0.0002, 0)), 'the legend is no part of it'
    with pytest.raises(DeskError):
        GRID.outline([(0.1, 0.1), (0.2, 0.2), (0.3, 0.3)])
