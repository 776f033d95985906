#!/usr/bin/python3
"""igtl_bridge and who may disturb it: hostile, slow and strange peers, and bad configurations."""
import contextlib
import os
import random
import re
import socket
import sys
import time
import unittest

import numpy as np
import rostest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import wait_until  # noqa: E402
from igtl_bridge import MICROMETRE, Bridge, BridgeTest, Tracker, field, pose_mm  # noqa: E402
from igtl_messages import Raw, String, Transform  # noqa: E402


class IgtlPeers(BridgeTest, unittest.TestCase):
    def test_hostile_peers_disturb_nobody(self):
        """10 000 random, truncated and mutated messages while another client works."""
        seed = random.Random(1169)
        good = Transform('ScopeToReference', matrix=np.eye(4)).pack()
        text = String('cortshift', string='capture_stage k' * 20).pack()
        victim = self.bridge.client()
        self.addCleanup(victim.stop)
        tracker = Tracker(victim, ScopeToReference=pose_mm([0, 1, 0], 0.2, [1, 2, 3]))
        self.addCleanup(tracker.stop)
        wait_until(lambda: self.edge('microscope', 0), 20, 'a pose of the other client')
        since, tracked_from, began = len(self.transforms), tracker.sent, time.time()
        memory = self.memory()

        def hostile():
            kind = seed.randrange(6)
            if kind == 5:  # everything right but the content
                return Raw('ScopeToReference', version=seed.choice([1, 2]),
                           bytes=seed.randbytes(seed.choice([12, 48, 70, seed.randrange(300)])),
                           kind=seed.choice(['TRANSFORM', 'POSITION', 'TDATA', 'STATUS', 'STRING', 'COMMAND', 'BIND'])).pack()
            if kind == 0:
                return seed.randbytes(seed.randrange(1, 300))
            message = bytearray(seed.choice([good, text]))
            if kind == 1:
                return message[:seed.randrange(1, len(message))]
            if kind == 2:  # a body of any size, announced
                message[42:50] = seed.randbytes(8)
            elif kind == 3:
                message[2:14] = seed.randbytes(12)
            for _ in range(seed.randrange(1, 9)):
                message[seed.randrange(len(message))] = seed.randrange(256)
            return message

        attacks = 0
        while attacks < 10000:
            with socket.create_connection(('127.0.0.1', self.bridge.port)) as attacker:
                # Several in one connection, until it is closed on us; the next attacker waits for that, else it is one client too many.
                attacker.settimeout(20)
                with contextlib.suppress(OSError):
                    for _ in range(seed.randrange(1, 6)):
                        attacks += 1
                        attacker.sendall(hostile())
                    attacker.shutdown(socket.SHUT_WR)
                with contextlib.suppress(ConnectionError):
                    while attacker.recv(65536):
                        pass
            if attacks % 1000 < 3:
                z = 0.001 * (attacks // 1000 + 1)
                self.fields.publish(field(np.full((2, 2, 3), z), np.zeros((2, 2, 3))))
                wait_until(lambda: abs(victim.expect('ShiftField').points[0, 2] - 1000 * z) < MICROMETRE, 20, 'field')
        seconds = time.time() - began
        tracker.stop()
        sent = tracker.sent - tracked_from
        wait_until(lambda: len(self.edge('microscope', since)) >= sent, 20, f'{sent} poses of the other client')
        stamps = np.array([t.header.stamp.to_sec() for t in self.edge('microscope', since)])
        print(f'{attacks} hostile messages in {seconds:.1f} s: {len(stamps)} of {sent} poses of the other client arrived, '
              f'longest gap {1000 * np.diff(stamps).max():.0f} ms, memory {memory:.0f} -> {self.memory():.0f} MB')
        self.assertIsNone(self.bridge.process.poll())
        self.assertLess(self.memory(), memory + 50)
        wait_until(lambda: int(self.bridge.value('connections', 'connections closed for malformed messages')) > 1000, 20,
                   'count of malformed messages')
        self.assertTrue(victim.is_connected() and self.client.is_connected())

    def memory(self):
        with open(f'/proc/{self.bridge.process.pid}/status') as file:
            return int(re.search(r'VmRSS:\s+(\d+)', file.read()).group(1)) / 1024

    def test_half_a_message_ends_the_connection(self):
        with socket.create_connection(('127.0.0.1', self.bridge.port)) as slow:
            slow.settimeout(20)
            slow.sendall(String('cortshift', string='capture_stage k').pack()[:70])
            while slow.recv(65536):  # what every client is sent; then the end
                pass

    def test_who_may_connect(self):
        port = self.bridge.port
        with socket.socket() as stranger:
            stranger.bind(('127.0.0.9', 0))
            stranger.connect(('127.0.0.1', port))
            stranger.settimeout(20)
            self.assertEqual(stranger.recv(100), b'')
        with self.assertRaises(ConnectionRefusedError):  # it listens on 127.0.0.1 alone
            socket.create_connection(('127.0.0.2', port))

    def test_refuses_to_start(self):
        for changes, expected in (({'listen_port': 70000}, 'listen_port = 70000 is not allowed; allowed is 0 ... 65535'),
                                  ({'colour': 1}, 'colour is unknown'),
                                  ({'link_axes': 'RAS'}, 'allowed is one of ras, lps'),
                                  ({'listen_address': 'everywhere'}, "listen_address = 'everywhere'"),
                                  ({'tools': [{'device': 'M', 'parent': 'floor', 'child': 'microscope'}]}, "parent = 'floor'"),
                                  ({'tools': [{'device': 'M', 'frame': 'microscope'}]}, "key 'frame' is unknown"),
                                  ({'listen_port': self.bridge.port}, 'cannot listen')):
            bridge = Bridge('igtl_refused', **changes)
            output = bridge.wait()
            self.assertEqual(bridge.process.returncode, 1, output)
            self.assertIn(expected, output)


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'igtl_peers', IgtlPeers)
