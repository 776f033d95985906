#!/usr/bin/python3
"""The node brain_model beside a shift_tracker that is played: updates, answers where points are now, and refuses with its reason."""
import os
import subprocess
import sys
import tempfile
import unittest

import numpy as np
import rospy
import rostest
from cortshift_msgs.msg import DisplacementField, ShiftSummary, StageInfo
from cortshift_msgs.srv import ListStages, ListStagesResponse, Locate, UpdateModel
from geometry_msgs.msg import Point

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'support'), os.path.join(HERE, '..', 'support', 'mr')]
import model_head as head  # noqa: E402
from cortshift_tracking.case.field_bag import to_message  # noqa: E402
from cortshift_tracking.case.messages import Field  # noqa: E402
from cortshift_tracking.model.brain import save_model  # noqa: E402
from cortshift_tracking.model.prepare import ModelSettings, prepare_model  # noqa: E402
from cortshift_tracking.mr.reader import load_volume, save_nifti  # noqa: E402
from graph import wait_until  # noqa: E402

KEYS = {'first': 1, 'second': 1, 'third': 2}   # stage to epoch


class BrainModelTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('brain_model_node_test')
        cls.folder = tempfile.TemporaryDirectory()
        path = os.path.join(cls.folder.name, 'mr.nii')
        mr, brain, tumour = head.volumes(step=0.003)
        save_nifti(mr, path)
        points, frame = head.surface_grid()
        model = prepare_model(load_volume(path), brain, head.CRANIOTOMY, points[np.isfinite(points[..., 0])], {'tumour': tumour},
                              ModelSettings(elements=6000, samples=16), provenance={'epoch': 1})
        save_model(model, os.path.join(cls.folder.name, 'model.npz'))
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = frame, head.CRANIOTOMY
        cls.points, cls.moved = points, head.sag(points)
        rospy.Service('/shift_tracker/list_stages', ListStages,
                      lambda _: ListStagesResponse([StageInfo(key=key, epoch=epoch) for key, epoch in KEYS.items()]))
        cls.publisher = rospy.Publisher('/shift/field', DisplacementField, queue_size=5)
        cls.node = subprocess.Popen([sys.executable, os.path.join(HERE, '..', '..', 'scripts', 'brain_model'), f'_case:={cls.folder.name}',
                                     f'_model:={cls.folder.name}/model.npz', f'_gravity:={(-head.OUTWARD).tolist()}'])
        rospy.wait_for_service('/brain_model/update', timeout=120)
        cls.update = rospy.ServiceProxy('/brain_model/update', UpdateModel)
        cls.locate = rospy.ServiceProxy('/brain_model/locate', Locate)
        wait_until(lambda: cls.publisher.get_num_connections() > 0, 60, 'a connection of the node to /shift/field')
        for to_key in ('second', 'third'):
            valid = np.isfinite(points[..., 0])
            field = Field('first', to_key, 1.0, 2.0, T, 0.0005, points, cls.moved, np.full(points.shape, 128, np.uint8),
                          np.where(valid, 0.9, np.nan), None)
            cls.publisher.publish(to_message(field, ShiftSummary(from_key='first', to_key=to_key)))

    @classmethod
    def tearDownClass(cls):
        cls.node.terminate()
        cls.node.wait(20)
        cls.folder.cleanup()

    def test_1_nothing_is_known_before_an_update(self):
        answer = self.locate([Point(*head.TUMOUR)])
        self.assertEqual(bytes(answer.known), b'\0')
        self.assertTrue(np.isnan(answer.now[0].x) and np.isnan(answer.sd[0]))

    def test_2_a_field_that_is_not_there_is_refused(self):
        answer = self.update('first', 'fourth')
        self.assertFalse(answer.success)
        self.assertIn('no field first -> fourth was published; compute it with shift_tracker/compute_shift', answer.message)

    def test_3_an_epoch_that_differs_is_refused(self):
        answer = self.updated('third')
        self.assertFalse(answer.success)
        self.assertIn('patient registration or calibration changed between them (epochs first: 1, third: 2, of the model: 1)', answer.message)

    def test_4_points_are_where_the_field_took_them(self):
        answer = self.updated('second')
        self.assertTrue(answer.success, answer.message)
        self.assertIn('the field begins at stage "first"', answer.message)
        files = os.listdir(os.path.join(self.folder.name, 'brain_model', 'first__second'))
        self.assertIn('updated_mr.nii.gz', files)
        valid = np.isfinite(self.points[..., 0])
        # 4 mm below the surface: the border of so coarse a mesh cuts corners.
        start, moved = 0.95 * self.points[valid][::40], self.moved[valid][::40]
        located = self.locate([Point(*p) for p in [*start, (0.3, 0, 0)]])
        known = np.frombuffer(bytes(located.known), np.uint8).astype(bool)
        self.assertFalse(known[-1])
        now = np.array([[p.x, p.y, p.z] for p in located.now])[:-1]
        error = np.linalg.norm(now - start - moved, axis=1)[known[:-1]]
        self.assertGreater(known[:-1].mean(), 0.95)
        self.assertLess(np.median(error), 0.0002)

    def updated(self, to_key):
        """The answer to ~update once the field has come to the node."""
        answers = []

        def asked():
            answers.append(self.update('first', to_key))
            return 'was published' not in answers[-1].message
        wait_until(asked, 60, f'the field first -> {to_key} at the node')
        return answers[-1]


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'brain_model_node', BrainModelTest)
