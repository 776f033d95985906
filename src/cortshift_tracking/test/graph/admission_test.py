#!/usr/bin/python3
"""Faults in the shipped recording, played into the running graph: refused or warned of as by process_bag."""
import copy
import os
import sys
import tempfile
import unittest

import genpy
import numpy as np
import rospy
import rostest
from cortshift_msgs.srv import ComputeShift

SUPPORT = os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support')
sys.path[:0] = [SUPPORT, os.path.join(SUPPORT, 'recording')]
import changes  # noqa: E402
import faults  # noqa: E402
from fault_trials import shipped_entries, write  # noqa: E402
from graph import Player, ShiftTracker  # noqa: E402

FIRST, SECOND = 5.2, 21.2   # [s] of the recording


class Admission(unittest.TestCase):
    player = None

    def play(self, entries, number):
        """Each recording lies 1000 s behind the one before, so that the graph goes on."""
        entries = changes.moved_in_time(entries, 1000.0 * number)
        path = os.path.join(self.folder, f'{number}.bag')
        self.start = changes.begin_of(entries)
        write([entry for entry in entries if entry[2].to_sec() < self.start + SECOND + 6], path)
        if self.player:
            self.player.stop()
        self.player = Player(path)
        self.addCleanup(self.player.stop)
        return self.player

    def capture(self, player, key, seconds):
        player.wait_for(self.start + seconds)
        return self.tracker.capture_stage(key, '')

    def faulty(self, name):
        return faults.FAULTS[name](copy.deepcopy(self.entries), np.random.default_rng(0))

    def test_what_must_not_enter_unchecked(self):
        """In this order: what a graph has heard once of settings and fixed edges it keeps."""
        rospy.init_node('test_admission', disable_rostime=True)
        self.entries = shipped_entries()
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name
        self.tracker = ShiftTracker()

        with self.subTest('a setting that is not told'):
            player = self.play(self.faulty('setting_not_told'), 1)
            answer = self.capture(player, 'unset', FIRST)
            self.assertTrue(answer.success, answer.message)
            self.assertIn('nothing on /microscope/settings', ' '.join(answer.stage.warnings))
            self.assertIn('WARNING', answer.message)
            self.assertTrue(answer.stage.provenance.software)
            self.assertEqual(len(answer.stage.provenance.calibration), 64)

        with self.subTest('untouched'):
            player = self.play(copy.deepcopy(self.entries), 2)
            answers = [self.capture(player, key, at) for key, at in (('a', FIRST), ('b', SECOND))]
            for answer in answers:
                self.assertTrue(answer.success, answer.message)
                self.assertEqual(answer.stage.warnings, [])
            shift = self.tracker.compute_shift('a', 'b')
            self.assertTrue(shift.success, shift.message)
            self.assertEqual(shift.summary.warnings, [])
            field = self.tracker.field('a', 'b')
            self.assertEqual(field.provenance.calibration, answers[0].stage.provenance.calibration)

        with self.subTest('a recorder whose clock is 3 s ahead'):
            ahead = [[topic, message, time + genpy.Duration(3)] for topic, message, time in copy.deepcopy(self.entries)]
            player = self.play(ahead, 3)
            answer = self.capture(player, 'ahead', FIRST)
            self.assertFalse(answer.success)   # never the pair of the next stage; process_bag, which has one clock, takes the right one
            self.assertIn('that the clocks agree', answer.message)

        with self.subTest('a hand-eye calibration that changes'):
            player = self.play(self.faulty('hand_eye_changes'), 4)
            answers = [self.capture(player, key, at) for key, at in (('before', FIRST), ('after', SECOND))]
            for answer in answers:
                self.assertTrue(answer.success, answer.message)
            self.assertNotEqual(answers[0].stage.epoch, answers[1].stage.epoch)
            shift = self.tracker.compute_shift('before', 'after')
            self.assertFalse(shift.success)
            self.assertIn('the calibration (camera_info, the hand-eye or the stereo edge) changed', shift.message)
            across = rospy.ServiceProxy('/shift_tracker/compute_shift_across_epochs', ComputeShift)('before', 'after')
            self.assertTrue(across.success, across.message)
            self.assertIn('no movement of the brain', ' '.join(across.summary.warnings))

        for number, (name, text, at) in enumerate([('pose_of_two_publishers', 'two publishers', SECOND),
                                                   ('baseline_of_two_truths', 'differ about the stereo head', SECOND),
                                                   ('pose_fixed_and_moving', 'fixed on /tf_static', FIRST)]):
            with self.subTest(name):
                player = self.play(self.faulty(name), 5 + number)
                answer = self.capture(player, name, at)
                self.assertFalse(answer.success)
                self.assertIn(text, answer.message)
    

if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'admission', Admission)
