#!/usr/bin/python3
"""The console on the phantom: a whole case by keys, then another one by the page's buttons in a real browser."""
import contextlib
import json
import os
import pty
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import unittest
import urllib.error
import urllib.request
import xmlrpc.client

import cv2
import numpy as np
import rosgraph
import rosnode
import rospy
import rostest
from selenium import webdriver
from selenium.webdriver.common.by import By

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import ShiftTracker, wait_until  # noqa: E402

LONG = 90  # s for anything that computes


@contextlib.contextmanager
def suspended(node):
    """The process of a node, stopped for as long as `with` lasts."""
    api = xmlrpc.client.ServerProxy(rosnode.get_api_uri(rosgraph.Master('/test_console'), '/' + node))
    pid = api.getPid('/test_console')[2]
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


class Terminal:
    """The console in a pseudo terminal: `press` keys, read what it `says`."""

    def __init__(self):
        self._master, slave = pty.openpty()
        self.process = subprocess.Popen(['rosrun', 'cortshift_tracking', 'console', '--port', '0'], stdin=slave, stdout=slave,
                                        stderr=slave, start_new_session=True, env={**os.environ, 'COLUMNS': '200'})
        os.close(slave)
        self.text = ''
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        while True:
            try:
                part = os.read(self._master, 4096)
            except OSError:
                return
            if not part:
                return
            self.text += part.decode(errors='replace')

    def press(self, key, pattern, seconds=LONG):
        """What matches the pattern in the text that follows the key."""
        start = len(self.text)
        os.write(self._master, key.encode())
        wait_until(lambda: re.search(pattern, self.text[start:]), seconds, f'{pattern!r} after key {key}')
        return re.search(pattern, self.text[start:])

    def expect(self, pattern, seconds=LONG):
        wait_until(lambda: re.search(pattern, self.text), seconds, repr(pattern))
        return re.search(pattern, self.text)


class Console(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('test_console')
        cls.tracker = ShiftTracker(120)
        rospy.wait_for_service('/stereo_driver/set_stage', timeout=120)
        cls.terminal = Terminal()
        cls.address = cls.terminal.expect(r'page: (http://\S+)').group(1)
        cls.terminal.expect('no warnings')

    @classmethod
    def tearDownClass(cls):
        if cls.terminal.process.poll() is None:
            cls.terminal.process.send_signal(signal.SIGINT)
            cls.terminal.process.wait(20)

    def ask(self, path, body=b'{}', **headers):
        """HTTP status and JSON of the answer; a body of None makes it GET."""
        request = urllib.request.Request(self.address + path, data=body, headers=headers)
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                return answer.status, json.loads(answer.read())
        except urllib.error.HTTPError as error:
            text = error.read()
            return error.code, json.loads(text) if error.headers.get_content_type() == 'application/json' else {}

    def test_a_case_from_the_first_key_to_the_last(self):
        """One console and one case: each step goes on from the one before."""
        for step in (self.a_case_by_keys, self.a_case_in_the_browser, self.the_page_is_for_this_machine_alone,
                     self.a_second_request_waits_for_the_first, self.silent_nodes_are_warned_of, self.quits):
            print('step:', step.__name__.replace('_', ' '), flush=True)
            step()

    def a_case_by_keys(self):
        t = self.terminal
        t.press('s', 'REFUSED: a shift needs two stages')
        t.press('v', 'REFUSED: live mode needs a stage')
        t.press('l', 'no stage has been captured yet')
        t.press('c', "stage 'stage_01' is stored")
        t.press('n', 'the phantom is at stage early_resection')
        t.press('c', "stage 'stage_02' is stored")
        t.press('l', r'(?s)stage_01 .*stage_02 ')
        magnitude = float(t.press('s', r'magnitude: ([\d.]+) ± [\d.]+ mm').group(1))
        self.assertAlmostEqual(magnitude, 1000 * self.tracker.field('stage_01', 'stage_02').summary.magnitude_mean, places=2)
        t.press('v', 'live on')
        wait_until(lambda: self.tracker.field('stage_01', '').summary.valid_points > 1000, LONG, 'a field of the live mode')
        t.press('v', 'live off')
        t.press('x', "key 'x' does nothing")
        self.assertRegex(t.text, r'coverage \d\d+ %')
        self.assertEqual([s.key for s in self.tracker.list_stages().stages], ['stage_01', 'stage_02'])

    def a_case_in_the_browser(self):
        options = webdriver.ChromeOptions()
        options.binary_location = '/usr/bin/chromium'
        for argument in ('--headless', '--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage', '--window-size=1280,1250'):
            options.add_argument(argument)
        options.set_capability('goog:loggingPrefs', {'browser': 'ALL'})
        browser = webdriver.Chrome(options=options)
        self.addCleanup(browser.quit)
        browser.get(self.address)

        def text(name):
            return browser.find_element(By.ID, name).get_property('textContent')

        def click(name, expected):
            """Presses the button when it may be pressed, and waits for the answer."""
            button = browser.find_element(By.ID, name)
            wait_until(button.is_enabled, LONG, f'button {name} enabled')
            button.click()
            wait_until(lambda: re.search(expected, text('message')), LONG, f'{expected!r} in place of {text("message")!r}')

        wait_until(lambda: text('count') == '2', LONG, 'the two stages that the keys captured')
        click('phantom', 'after_resection')
        browser.find_element(By.ID, 'note').send_keys('cavity <b>open</b>')
        click('capture', "stage 'stage_03' is stored")
        self.assertEqual(self.tracker.list_stages().stages[-1].note, 'cavity <b>open</b>')
        button = browser.find_element(By.ID, 'compute')
        wait_until(button.is_enabled, LONG, 'the button')
        with suspended('shift_tracker'):   # a shift that takes its time
            button.click()
            wait_until(lambda: int(browser.find_element(By.CSS_SELECTOR, '.bar').get_attribute('aria-valuenow')) > 10, LONG,
                       'progress')
        wait_until(lambda: re.search('shift stage_02 to stage_03', text('message')), LONG, 'the shift')
        # The numbers of the pair that the keys computed stand there until the page has asked again.
        wait_until(lambda: text('pair') == 'stage_02 → stage_03', 20, 'the pair')
        summary = self.tracker.field('stage_02', 'stage_03').summary
        self.assertIn(f'{1000 * summary.magnitude_mean:.2f} ±', text('summary'))
        for name in ('overlay_before', 'overlay_after', 'magnitude'):
            image = browser.find_element(By.ID, name)
            wait_until(lambda: image.get_property('naturalWidth') > 100, 20, f'picture {name}')
        wait_until(lambda: text('warnings') == 'none', 20, f'no warnings: {text("warnings")}')
        self.assertRegex(text('coverage'), r'^\d\d+ %$')
        self.assertIn('cavity <b>open</b>', text('stages'))
        click('phantom', 'last stage of its case')
        self.assertIn('refused', browser.find_element(By.ID, 'message').get_attribute('class'))
        click('track', 'tracking the shift from')
        wait_until(lambda: text('live') == 'on', 20, 'live on')
        wait_until(lambda: text('pair').startswith('stage_01 → live'), LONG, 'a field of the live mode')
        click('track', 'tracking is off')
        folder = os.environ.get('ROS_TEST_RESULTS_DIR') or tempfile.mkdtemp()
        picture = os.path.join(folder, 'console_page.png')
        browser.save_screenshot(picture)
        print('screenshot', picture)
        self.assertGreater(np.std(cv2.imread(picture)), 20)
        wrong = [entry['message'] for entry in browser.get_log('browser') if entry['level'] == 'SEVERE']
        self.assertEqual([w for w in wrong if '409' not in w], [])

    def the_page_is_for_this_machine_alone(self):
        port = int(self.address.rsplit(':', 1)[1].strip('/'))
        with self.assertRaises(ConnectionRefusedError):  # it listens on 127.0.0.1
            socket.create_connection(('127.0.0.2', port))
        before = len(self.tracker.list_stages().stages)
        self.assertEqual(self.ask('capture')[0], 403)  # a form of another page sends no such header
        self.assertEqual(self.ask('capture', **{'X-Cortshift': '1', 'Origin': 'http://elsewhere.example'})[0], 403)
        self.assertEqual(self.ask('capture', **{'X-Cortshift': '1', 'Host': f'elsewhere.example:{port}'})[0], 403)
        self.assertEqual(self.ask('status', None, Host='elsewhere.example')[0], 403)
        for body in (b'[]', b'{', b'{"note": 7}', b'x' * 5000):
            self.assertEqual(self.ask('capture', body, **{'X-Cortshift': '1'})[0], 400, body[:10])
        self.assertEqual(self.ask('nothing', **{'X-Cortshift': '1'})[0], 404)
        self.assertEqual(self.ask('picture/../../console_page.py', None)[0], 404)
        self.assertEqual(len(self.tracker.list_stages().stages), before)

    def a_second_request_waits_for_the_first(self):
        header = {'X-Cortshift': '1'}
        wait_until(lambda: not self.ask('status', None)[1]['activity']['busy'], LONG, 'nothing under way')
        self.assertEqual(self.ask('compute', **header)[0], 200)
        code, answer = self.ask('capture', **header)
        self.assertEqual(code, 409)
        self.assertIn('still under way', answer['message'])
        wait_until(lambda: not self.ask('status', None)[1]['activity']['busy'], LONG, 'the shift done')

    def silent_nodes_are_warned_of(self):
        with suspended('surface_reconstruction'):
            wait_until(lambda: any('nothing is heard of surface_reconstruction' in w
                                   for w in self.ask('status', None)[1]['warnings']), LONG, 'warning of the silent node')
            self.assertIsNone(self.ask('status', None)[1]['coverage'])

    def quits(self):
        os.write(self.terminal._master, b'q')
        self.assertEqual(self.terminal.process.wait(20), 0)


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'console', Console)
