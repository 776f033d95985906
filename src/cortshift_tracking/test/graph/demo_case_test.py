#!/usr/bin/python3
"""The demo: graph, probe, tables and report on the phantom, against its truth."""
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import unittest
from dataclasses import replace

import numpy as np
import rospkg
import rospy
import rostest
import yaml
from cortshift_tracking.case.folder import read_case
from cortshift_tracking.case.messages import field_from_message
from cortshift_tracking.report.picks import read_picks
from cortshift_tracking.report.tables import TABLE_3_HEADER, TABLE_3_WORDS, table_2, table_3
from cortshift_tracking.report.validation import compare_pair, surface_accuracy

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import ShiftTracker  # noqa: E402
from programs import program  # noqa: E402

CASE = os.path.join(rospkg.RosPack().get_path('cortshift_tracking'), '..', '..', 'config', 'phantom', 'phantom_case.yaml')
PROBE_NOISE = 0.0003  # [m]
MEDIAN_NOISE = PROBE_NOISE * np.sqrt(np.pi / 2 / 20)  # of the median of some 20 samples [m]


def tool(package, name, *arguments, text=None):
    return subprocess.run([program(name, package), *arguments], input=text, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          universal_newlines=True, check=False)


def touched(stage):
    """Material coordinates [m] of what the stylus touches at a stage, by label."""
    return {target['label']: target['at'] for target in stage['probe'] if not target.get('lift')}


class DemoCase(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('test_demo_case')
        cls.folder = os.path.dirname(rospy.get_param('/probe/case'))
        with open(CASE, encoding='utf-8') as file:
            cls.described = yaml.safe_load(file)
        run = tool('cortshift_tracking', 'demo_case', CASE, cls.folder)
        assert run.returncode == 0, run.stdout
        cls.case = read_case(cls.folder)
        cls.picks, _ = read_picks(os.path.join(cls.folder, 'picks.csv'))

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def truth(self, first, second):
        """By label: place at the first stage and displacement to the second, in pmr [m]."""
        points = touched(self.described['stages'][0])
        lines = tool('cortshift_stereo', 'phantom_truth', CASE, first, second, '--material',
                     text=''.join('{},{}\n'.format(*at) for at in points.values())).stdout
        table = np.genfromtxt(io.StringIO(lines), delimiter=',', names=True)
        place = np.stack([table[name] for name in ('px_m', 'py_m', 'pz_m')], -1)
        displacement = np.stack([table[name] for name in ('dx_m', 'dy_m', 'dz_m')], -1)
        return dict(zip(points, place)), dict(zip(points, displacement))

    def accuracies(self, field):
        return [surface_accuracy(self.case.stage(key), self.case.points, self.picks) for key in (field.from_key, field.to_key)]

    def test_probe(self):
        names = [stage['name'] for stage in self.described['stages']]
        self.assertEqual([stage.key for stage in self.case.stages], names)
        self.assertEqual(len(self.case.points), 2 + sum(len(touched(stage)) for stage in self.described['stages']))
        gravity = np.array(self.described['gravity_in_pmr']) / np.linalg.norm(self.described['gravity_in_pmr'])
        self.assertLess(np.degrees(np.arccos(self.case.gravity_pmr @ gravity)), 0.5)
        errors = []
        for name in names:
            place, _ = self.truth(name, name)
            errors += [point.position - place[point.label] for point in self.case.points if point.stage == name]
        self.assertTrue(0.6 * MEDIAN_NOISE < np.sqrt(np.mean(np.square(errors))) < 1.5 * MEDIAN_NOISE, errors)

    def test_flow_at_the_probe_points(self):
        errors = []
        for field in self.case.fields:
            _, displacement = self.truth(field.from_key, field.to_key)
            pairs = compare_pair(field, self.case.stage(field.from_key), *self.accuracies(field), self.case.points)
            self.assertEqual({pair.label for pair in pairs}, set(displacement))
            errors += [np.linalg.norm(pair.flow - displacement[pair.label]) for pair in pairs]
        print(f'flow against truth at {len(errors)} probe points: mean {np.mean(errors) * 1000:.3f} mm, '
              f'largest {np.max(errors) * 1000:.3f} mm')
        self.assertLessEqual(np.mean(errors), 0.00005)

    def differences(self, points):
        """Probe less flow (N, 3) [m] of all pairs, along the microscope's axis and across."""
        rows = []
        for field in self.case.fields:
            accuracies = [surface_accuracy(self.case.stage(key), points, self.picks) for key in (field.from_key, field.to_key)]
            rows += compare_pair(field, self.case.stage(field.from_key), *accuracies, points)
        return np.array([row.difference for row in rows])

    def test_what_probe_and_flow_differ_by_is_the_noise_of_the_probe(self):
        found = self.differences(self.case.points)
        expected = MEDIAN_NOISE * np.sqrt(2)
        rms = np.sqrt(np.mean(np.square(found)))
        print(f'probe less flow at {len(found)} points: {rms * 1000:.3f} mm of one coordinate, expected {expected * 1000:.3f} mm')
        self.assertTrue(0.6 * expected < rms < 1.5 * expected, found)
        # A fault would be seen: a stylus tip that is 0.5 mm off along the microscope's axis at one stage.
        first = self.case.stages[0]
        off = 0.0005 * first.T_pmr_left[:3, 2]
        faulty = self.differences([replace(point, position_pmr=tuple(point.position + off)) if point.stage == first.key else point
                                   for point in self.case.points])
        seen = [row for field, count in zip(self.case.fields, [4] * 3) for row in [field.from_key == first.key] * count]
        change = (faulty - found)[seen]
        self.assertLess(np.abs(change - [-0.0005, 0, 0]).max(), 0.00005)

    def test_tables(self):
        second, third = table_2(self.case, self.picks), table_3(self.case)
        self.assertEqual([row[0] for row in second], [row[0] for row in third])
        self.assertEqual(len(second), 3)
        for row in second:
            self.assertEqual(row[1:3], [4, 4])
            self.assertTrue(np.isfinite(row[1:]).all())
        first = self.described['stages'][0]['name']
        for field, row in zip(self.case.fields, third):
            value = dict(zip(TABLE_3_HEADER, row))
            self.assertTrue(np.isfinite([v for name, v in value.items()
                                         if name not in TABLE_3_WORDS and not name.startswith('brain_')]).all(), value)
            # The brain's numbers are there where its outline is known, and on the first stage, whose edge is clear, it is.
            known = not field.summary.outline.startswith('not known')
            self.assertEqual(set(np.isfinite([v for name, v in value.items() if name.startswith('brain_')])), {known}, field.summary.outline)
            self.assertTrue(known or field.from_key != first, field.summary.outline)
            self.assertEqual(value['warnings'], '')
            self.assertTrue(value['gravity_mean_mm'] > 0 > value['normal_mean_mm'])  # it sinks

    def test_shift_from_the_mr_and_the_report_with_it(self):
        self.shift_from_the_mr()
        self.report_with_the_mr()

    def shift_from_the_mr(self):
        """While the graph runs: registered to the first stage, and on to the last one by the flow between them."""
        first, last = self.case.stages[0].key, self.case.stages[-1].key
        tracker = ShiftTracker()
        refused = tracker.compute_shift('pmr', last)
        self.assertFalse(refused.success)
        command = re.search('run `rosrun cortshift_tracking (.*) MR`', refused.message).group(1)
        mr = os.path.join(self.folder, 'pmr.nii')
        for package, name, *arguments in (('cortshift_stereo', 'phantom_mr', CASE, mr, '--voxel', '1'),
                                          ('cortshift_tracking', *shlex.split(command), mr)):
            run = tool(package, name, *arguments)
            self.assertEqual(run.returncode, 0, run.stdout)
        for key in (first, last):
            answer = tracker.compute_shift('pmr', key)
            self.assertTrue(answer.success, answer.message)
            field = field_from_message(tracker.field('pmr', key))
            start, found = (values[::4, ::4].reshape(-1, 3) for values in (field.start, field.displacement))
            known = np.isfinite(found).all(-1)
            lines = tool('cortshift_stereo', 'phantom_truth', CASE, 'undeformed', key,
                         text=''.join('{:.9f},{:.9f},{:.9f}\n'.format(*place) for place in start[known])).stdout
            table = np.genfromtxt(io.StringIO(lines), delimiter=',', names=True)
            true = np.stack([table[name] for name in ('dx_m', 'dy_m', 'dz_m')], -1)
            error = np.linalg.norm(found[known] - true, axis=-1)[table['rim_m'] > 0]
            print(f'pmr to {key}: shift up to {np.linalg.norm(true, axis=-1).max() * 1000:.2f} mm; error median '
                  f'{np.median(error) * 1000:.3f} mm, 90th percentile {np.percentile(error, 90) * 1000:.3f} mm, '
                  f'{len(error) * (4 * field.resolution) ** 2 * 1e4:.1f} cm2')
            self.assertLessEqual(np.median(error), 0.0005)
            self.assertGreater(len(error) * (4 * field.resolution) ** 2, 0.0010)
            self.assertEqual(answer.summary.valid_points, field.valid.sum())
            self.assertTrue(np.isfinite(answer.summary.gravity_mean))

    def report_with_the_mr(self):
        first = self.case.stages[0].key
        run = tool('cortshift_tracking', 'case_report', self.folder, '--no-pdf')
        self.assertEqual(run.returncode, 0, run.stdout)
        path = os.path.join(self.folder, 'report.html')
        self.assertLess(os.path.getsize(path), 20e6)
        with open(path, encoding='utf-8') as file:
            page = file.read()
        pictures = re.findall(r'<img src="(data:image/png;base64,)?', page)
        self.assertEqual(len(pictures), 2 + 4 * 4)  # timeline, MR; per pair overlays, maps, vectors, trust
        self.assertTrue(all(pictures))
        self.assertIn(f'pmr \u2192 {first}', page)
        self.assertIn('built-in phantom, phantom_case.yaml', page)  # the calibration
        self.assertNotIn('Warnings', page)

    def test_missing_stage(self):
        run = tool('cortshift_tracking', 'register_mr', self.folder, 'closing', 'none.nii')
        self.assertEqual(run.returncode, 1)
        self.assertIn('no stage "closing"; there are: dural_opening, early_resection, after_resection', run.stdout)


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'demo_case', DemoCase)
