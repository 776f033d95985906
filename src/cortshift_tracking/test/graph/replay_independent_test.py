#!/usr/bin/python3
"""replay.launch on a recorded case that shares nothing with the project's phantom, and on faulty ones."""
import os
import sys
import tempfile
import unittest

import numpy as np
import rospy
import rostest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import Player, ShiftTracker, field_arrays  # noqa: E402
from independent_case import IndependentCase  # noqa: E402

START = 1700000000.0


class ReplayIndependent(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('test_replay_independent', disable_rostime=True)
        cls.folder = tempfile.TemporaryDirectory()
        cls.case = IndependentCase()
        cls.tracker = ShiftTracker()

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def play(self, start=START, **what):
        path = os.path.join(self.folder.name, 'case.bag')
        self.case.write(path, start=start, **what)
        player = Player(path)
        self.addCleanup(player.stop)
        return player

    def test_field_against_truth(self):
        player = self.play()
        player.wait_for(START + 3.2)
        answer = self.tracker.capture_stage('before', 'recorded')
        self.assertTrue(answer.success, answer.message)
        self.assertLess(abs(answer.stage.stamp.to_sec() - START - 2.4), 0.5)
        player.wait_for(START + 9.2)
        answer = self.tracker.capture_stage('after', '')
        self.assertTrue(answer.success, answer.message)
        shift = self.tracker.compute_shift('before', 'after')
        self.assertTrue(shift.success, shift.message)
        field = self.tracker.field('before', 'after')
        self.assertEqual(field.header.frame_id, 'pmr')
        start, displacement, confidence = field_arrays(field)
        reported = np.isfinite(displacement).all(-1)
        self.assertEqual(reported.sum(), shift.summary.valid_points)
        self.assertTrue((np.isfinite(start).all(-1) == reported).all())
        truth = self.case.displacement(start[reported])
        _, _, height = self.case.material('before', start[reported])
        error = np.linalg.norm(displacement[reported] - truth, axis=-1) * 1000
        print(f'independent bag: {reported.sum()} points; surface error median {np.median(np.abs(height)) * 1000:.3f} mm; '
              f'displacement error median {np.median(error):.3f} mm, 95th percentile {np.percentile(error, 95):.3f} mm')
        self.assertGreater(np.linalg.norm(truth, axis=-1).max(), 0.006)
        self.assertLess(np.median(error), 0.25)
        self.assertLess(np.percentile(error, 95), 0.6)
        # 0.1 mm grid points over a view of about 85 x 65 mm.
        self.assertGreater(reported.sum() * field.resolution ** 2, 0.0035)
        magnitude = np.linalg.norm(displacement[reported], axis=-1)
        self.assertAlmostEqual(shift.summary.magnitude_mean, magnitude.mean(), delta=1e-6)

    def test_missing_poses_are_named(self):
        player = self.play(start=START + 1000, stages=('before',), tracked=False)
        player.wait_for(START + 1002.7)
        answer = self.tracker.capture_stage('untracked', '')
        self.assertFalse(answer.success)
        self.assertIn('untracked', answer.message)
        self.assertIn('microscope', answer.message)

    def test_unsynchronised_pairs_are_named(self):
        player = self.play(start=START + 2000, stages=('before',), right_delay=0.012)
        player.wait_for(START + 2002.7)
        answer = self.tracker.capture_stage('unsynchronised', '')
        self.assertFalse(answer.success)
        self.assertIn('synchronis', answer.message)


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'replay_independent', ReplayIndependent)
