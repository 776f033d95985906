#!/usr/bin/python3
"""The node brain_model in a namespace, beside a shift_tracker that is played: updates, draws, answers where points are now, and refuses with its reason."""
import os
import re
import subprocess
import sys
import tempfile
import threading
import unittest

import cv2
import numpy as np
import rosbag
import rospy
import rostest
from cortshift_msgs.msg import DisplacementField, ShiftSummary, StageInfo, UpdatedMr
from cortshift_msgs.srv import ListStages, ListStagesResponse, Locate, UpdateModel
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point
from sensor_msgs.msg import CameraInfo, Image

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'support'), os.path.join(HERE, '..', 'support', 'mr')]
import model_head as head  # noqa: E402
from cortshift_tracking.case.field_bag import to_message  # noqa: E402
from cortshift_tracking.case.messages import Field  # noqa: E402
from cortshift_tracking.model.brain import save_model  # noqa: E402
from cortshift_tracking.model.prepare import ModelSettings, prepare_model  # noqa: E402
from cortshift_tracking.mr.reader import load_volume, save_nifti  # noqa: E402
from cortshift_tracking.poses import pose_message  # noqa: E402
from graph import wait_until  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402
from synthetic_case import cloud, packed  # noqa: E402

NS = '/or1'    # everything of the graph lies in it
SIZE, FOCAL = (480, 640), 1800.0   # of the stage's picture [px]
STAGES = {'first': (1, 1), 'second': (2, 1), 'third': (2, 2)}   # key to exposure [s] and epoch


class BrainModelTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node('brain_model_node_test')
        cls.folder = tempfile.TemporaryDirectory()
        path = os.path.join(cls.folder.name, 'mr.nii')
        mr, brain, tumour = head.volumes(step=0.003)
        save_nifti(mr, path)
        save_nifti(tumour, os.path.join(cls.folder.name, 'tumour.nii'))
        points, frame = head.surface_grid()
        cls.frame = frame
        model = prepare_model(load_volume(path), brain, head.CRANIOTOMY, points[np.isfinite(points[..., 0])], {'tumour': tumour},
                              ModelSettings(elements=6000, samples=16), provenance={'epoch': 1})
        save_model(model, os.path.join(cls.folder.name, 'model.npz'))
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = frame, head.CRANIOTOMY
        cls.points, cls.moved = points, head.sag(points)
        cls.write_stage('second')
        cls.stages = dict(STAGES)
        rospy.Service(f'{NS}/shift_tracker/list_stages', ListStages,
                      lambda _: ListStagesResponse([StageInfo(key=key, stamp=rospy.Time(at), epoch=epoch)
                                                    for key, (at, epoch) in cls.stages.items()]))
        cls.publisher = rospy.Publisher(f'{NS}/shift/field', DisplacementField, queue_size=5)
        cls.node = subprocess.Popen([sys.executable, os.path.join(HERE, '..', '..', 'scripts', 'brain_model'), f'_case:={cls.folder.name}',
                                     f'_model:={cls.folder.name}/model.npz', f'_gravity:={(-head.OUTWARD).tolist()}'],
                                    env={**os.environ, 'ROS_NAMESPACE': NS})
        rospy.wait_for_service(f'{NS}/brain_model/update', timeout=120)
        cls.update = rospy.ServiceProxy(f'{NS}/brain_model/update', UpdateModel)
        cls.locate = rospy.ServiceProxy(f'{NS}/brain_model/locate', Locate)
        wait_until(lambda: cls.publisher.get_num_connections() > 0, 60, 'a connection of the node to shift/field')
        cls.T_pmr_projection = T
        for to_key in ('second', 'third'):
            cls.publish(to_key, cls.moved)

    @classmethod
    def publish(cls, to_key, moved, at=2.0):
        """Publish a field from first, exposed at 1 s, to a stage exposed at `at` [s]."""
        summary = ShiftSummary(from_key='first', to_key=to_key)
        summary.surround_correction.pose.orientation.w = 1.0   # none was taken out
        field = Field('first', to_key, 1.0, at, cls.T_pmr_projection, 0.0005, cls.points, moved, np.full(cls.points.shape, 128, np.uint8),
                      np.where(np.isfinite(cls.points[..., 0]), 0.9, np.nan), None)
        cls.publisher.publish(to_message(field, summary))

    @classmethod
    def write_stage(cls, key):
        """A stage that looks at the tumour from 0.3 m, aslant, so that sagging shows; its picture is grey."""
        T = np.eye(4)
        T[:3, :3] = cls.frame @ Rotation.from_rotvec([0.6, 0, 0]).as_matrix() @ np.diag([1, -1, -1])
        T[:3, 3] = head.TUMOUR - 0.3 * T[:3, 2]
        cls.T_left_pmr = np.linalg.inv(T)
        rows, columns = SIZE
        stamp = rospy.Time(2)
        header = rospy.Header(frame_id='pmr', stamp=stamp)
        grid = np.zeros((rows, columns, 3), np.float32) + head.CRANIOTOMY
        info = CameraInfo(width=columns, height=rows, R=list(np.eye(3).ravel()), P=[FOCAL, 0, columns / 2, 0, 0, FOCAL, rows / 2, 0, 0, 0, 1, 0])
        info.header.frame_id = 'left_optical'
        with rosbag.Bag(os.path.join(cls.folder.name, f'{key}.bag'), 'w') as bag:
            bag.write('/stage/info', StageInfo(key=key, stamp=stamp, epoch=1, camera_pose=pose_message(T)), stamp)
            bag.write('/surface/points', cloud(header, **dict(zip('xyz', np.moveaxis(grid, -1, 0))), rgb=packed(np.full(SIZE, 0.4))), stamp)
            bag.write('/stereo/left/camera_info', info, stamp)

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
        self.assertIn('warning: no resected part was given: tissue that was taken out counts as there', answer.message)
        self.assertNotIn('no overlay', answer.message)
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

    def test_5_the_tumour_is_drawn_where_it_was_and_is(self):
        image = rospy.wait_for_message(f'{NS}/brain_model/overlay', Image, 30)   # latched
        self.assertEqual((image.encoding, image.header.frame_id, image.header.stamp), ('bgr8', 'left_optical', rospy.Time(2)))
        picture = np.frombuffer(image.data, np.uint8).reshape(*SIZE, 3)
        kept = cv2.imread(os.path.join(self.folder.name, 'brain_model', 'first__second', 'overlay.png'))
        np.testing.assert_array_equal(kept, picture)
        now = self.locate([Point(*head.TUMOUR)]).now[0]
        for middle, colour in ((head.TUMOUR, (60, 60, 255)), (np.array([now.x, now.y, now.z]), (60, 220, 60))):
            seen = self.T_left_pmr[:3, :3] @ middle + self.T_left_pmr[:3, 3]
            rows, columns = np.nonzero((picture[:SIZE[0] * 9 // 10] == colour).all(-1))
            found = np.array([np.ptp(columns), np.ptp(rows)]) / 2 * seen[2] / FOCAL
            self.assertLess(np.abs(found - head.TUMOUR_RADIUS).max(), 0.0015, found)   # voxels of 3 mm
            centre = np.array([columns.min() + columns.max(), rows.min() + rows.max()]) / 2
            self.assertLess(np.abs(centre - FOCAL * seen[:2] / seen[2] - np.array(SIZE[::-1]) / 2).max(), 4)

    def test_6_the_update_goes_to_the_link(self):
        message = rospy.wait_for_message(f'{NS}/brain_model/updated_mr', UpdatedMr, 30)   # latched
        volume = load_volume(os.path.join(self.folder.name, 'brain_model', 'first__second', 'updated_mr.nii.gz'))
        self.assertEqual((message.from_key, message.to_key, message.header.frame_id), ('first', 'second', 'pmr'))
        self.assertEqual([label.name for label in message.labels], ['tumour'])
        np.testing.assert_allclose(np.reshape(message.T_pmr_voxel, (4, 4)), volume.T_pmr_voxel, atol=1e-7)
        voxels = np.stack([np.frombuffer(s.data, '<f4').reshape(s.height, s.width).T for s in message.slices], -1)
        np.testing.assert_array_equal(voxels, volume.data)

    def test_7_a_field_of_another_capture_is_refused_and_one_of_this_taken(self):
        self.stages['second'] = (9, 1)   # deleted and captured again
        answer = self.update('first', 'second')
        self.assertFalse(answer.success)
        self.assertIn('the field first -> second is of another capture of "second"; compute it again', answer.message)
        threading.Timer(0.5, self.publish, ('second', 0.25 * self.moved, 9.0)).start()
        answer = self.update('first', 'second')
        self.assertTrue(answer.success, answer.message)

    def test_8_a_field_on_its_way_replaces_the_older_one(self):
        """compute_shift has answered, and its field arrives after the request."""
        self.stages['second'] = (9, 1)
        self.publish('second', 0.25 * self.moved, 9.0)
        largest = []
        for moved in (self.moved, 0.25 * self.moved):
            threading.Timer(0.3, self.publish, ('second', moved, 9.0)).start()
            answer = self.update('first', 'second')
            self.assertTrue(answer.success, answer.message)
            largest.append(float(re.search(r'largest displacement ([0-9.]+) mm', answer.message)[1]))
        self.assertGreater(largest[0], 2 * largest[1])

    def test_9_what_was_resected_is_a_hole_and_a_refusal_is_seen(self):
        self.stages['second'] = (9, 1)
        self.publish('second', self.moved, 9.0)
        rospy.set_param(f'{NS}/brain_model/resected', os.path.join(self.folder.name, 'tumour.nii'))
        answer = self.update('first', 'second')
        self.assertTrue(answer.success, answer.message)
        self.assertNotIn('no resected part', answer.message)
        self.assertEqual(bytes(self.locate([Point(*head.TUMOUR)]).known), b'\0')
        rospy.set_param(f'{NS}/brain_model/resected', os.path.join(self.folder.name, 'none.nii'))
        answer = self.update('first', 'second')
        self.assertFalse(answer.success)
        self.assertRegex(answer.message, 'none.nii: no such file.*; ~locate answers from first -> second$')
        said = []
        subscriber = rospy.Subscriber('/diagnostics', DiagnosticArray, lambda message: said.extend(message.status))
        wait_until(lambda: said, 60, 'diagnostics of brain_model')
        subscriber.unregister()
        self.assertEqual((said[-1].level, said[-1].values[-1].value), (DiagnosticStatus.WARN, 'first -> second'))
        rospy.set_param(f'{NS}/brain_model/resected', '')

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
