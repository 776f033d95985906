"""The console's page without a graph: it cannot be framed or embedded by another page, and asks for a token where a site wants one."""
import base64
import http.client
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from cortshift_tracking.console.page import CLOSED, Handler, TokenError, token_of
from selenium import webdriver
from selenium.webdriver.common.by import By

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


def asked(port, path='/', method='GET', **headers):
    connection = http.client.HTTPConnection('127.0.0.1', port, timeout=20)
    connection.request(method, path, headers=headers)
    answer = connection.getresponse()
    answer.read()
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


def test_a_frame_in_a_foreign_page_shows_nothing(serve):
    page = serve()
    foreign = serve(Foreign, framed=f'http://127.0.0.1:{page}/')
    options = webdriver.ChromeOptions()
    options.binary_location = '/usr/bin/chromium'
    for argument in ('--headless', '--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage'):
        options.add_argument(argument)
    browser = webdriver.Chrome(options=options)
    try:
        browser.get(f'http://127.0.0.1:{page}/')
        assert browser.find_elements(By.ID, 'capture')   # by itself it is there
        browser.get(f'http://127.0.0.1:{foreign}/')
        assert browser.find_elements(By.ID, 'foreign')
        browser.switch_to.frame(0)
        assert not browser.find_elements(By.ID, 'capture')
    finally:
        browser.quit()
