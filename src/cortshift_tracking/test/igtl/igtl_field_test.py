#!/usr/bin/python3
"""igtl_bridge to its clients: poses in, fields, surfaces and pictures out, to a micrometre."""
import os
import sys
import tempfile
import time
import unittest
from types import SimpleNamespace

import nibabel
import numpy as np
import rospy
import rostest
import vtk
from cortshift_msgs.msg import UpdatedMr
from cortshift_tracking.model.node import updated_mr_message
from cortshift_tracking.model.structures import Structure, border_of_label
from cortshift_tracking.mr.reader import save_nifti
from cortshift_tracking.mr.volume import Volume
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import Image, PointField
from vtk.util.numpy_support import vtk_to_numpy

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
from graph import wait_until  # noqa: E402
from igtl_bridge import (LPS_OF_RAS, MICROMETRE, BridgeTest, apply, cloud, field, pose_mm, quaternion_matrix,  # noqa: E402
                         rotation)


class IgtlField(BridgeTest, unittest.TestCase):
    def test_landmark_from_tracker_to_client(self):
        T_reference_pmr_mm = pose_mm([3, -1, 2], 0.8, [120.5, -43.25, 17.125])  # patient in LPS
        T_reference_microscope_mm = pose_mm([-1, 2, 0.5], -1.1, [-35.5, 210.75, 260.0])
        landmark_microscope_mm = np.array([11.0, -23.0, 41.0])
        since, sent = len(self.transforms), time.time()
        self.client.transform('PatientToReference', T_reference_pmr_mm, sent)
        self.client.transform('ScopeToReference', T_reference_microscope_mm, sent)
        wait_until(lambda: self.edge('microscope', since), 20, 'tf of the microscope')
        stamp = self.edge('microscope', since)[0].header.stamp
        self.assertLess(abs(stamp.to_sec() - (sent - 0.03)), 2e-6)
        found = self.buffer.lookup_transform('pmr', 'microscope', stamp, rospy.Duration(20)).transform
        T_pmr_microscope = np.eye(4)
        q, t = found.rotation, found.translation
        T_pmr_microscope[:3, :3] = quaternion_matrix([q.x, q.y, q.z, q.w])
        T_pmr_microscope[:3, 3] = t.x, t.y, t.z
        landmark_pmr = apply(T_pmr_microscope, landmark_microscope_mm / 1000)

        truth_lps_mm = apply(np.linalg.inv(T_reference_pmr_mm) @ T_reference_microscope_mm, landmark_microscope_mm)
        self.assertLess(np.abs(LPS_OF_RAS @ landmark_pmr * 1000 - truth_lps_mm).max(), MICROMETRE)

        displacement_lps_mm = np.array([1.5, -2.25, 7.0])
        points = np.full((1, 1, 3), landmark_pmr)
        self.fields.publish(field(points, np.full((1, 1, 3), LPS_OF_RAS @ displacement_lps_mm / 1000)))
        received = self.client.expect('ShiftField')
        error = max(np.abs(received.points[0] - truth_lps_mm).max(),
                    np.abs(received.attributes['displacement'][0] - displacement_lps_mm).max())
        print(f'landmark from tracker to client: {1000 * error:.3f} um')
        self.assertLess(error, MICROMETRE)

    def test_field_arrives_whole(self):
        random_numbers = np.random.default_rng(7)
        projection = np.eye(4)
        projection[:3, :3], projection[:3, 3] = rotation([1, 3, -2], 0.9), [0.05, -0.06, 0.11]
        height, width, resolution = 40, 60, 0.0005
        rows, columns = np.meshgrid(np.arange(height), np.arange(width), indexing='ij')
        local = np.stack([columns * resolution, rows * resolution, random_numbers.normal(0, 0.001, rows.shape)], -1)
        points = apply(projection, local)
        displacement = random_numbers.normal(0, 0.004, points.shape)
        hole = random_numbers.random(rows.shape) < 0.2
        points[hole], displacement[hole] = np.nan, np.nan
        message = field(points, displacement, projection, resolution, ('dura_open', 'resected'))
        self.fields.publish(message)

        since = message.header.stamp.to_sec()
        received = self.client.expect('ShiftField', since=since)
        self.assertAlmostEqual(received.stamp, message.header.stamp.to_sec(), places=5)
        truth_mm = 1000 * points[~hole] @ LPS_OF_RAS
        vectors_mm = 1000 * displacement[~hole] @ LPS_OF_RAS
        self.assertLess(np.abs(received.points - truth_mm).max(), MICROMETRE)
        self.assertLess(np.abs(received.attributes['displacement'] - vectors_mm).max(), MICROMETRE)
        confidence = np.linspace(0, 1, height * width).reshape(height, width)[~hole]
        self.assertLess(np.abs(received.attributes['confidence'][:, 0] - confidence).max(), 1e-6)
        colour = np.stack([rows, columns, np.full_like(rows, 7), np.full_like(rows, 255)], -1)[~hole]
        self.assertLess(np.abs(255 * received.attributes['rgba'] - colour).max(), 1e-3)
        whole = ~(hole[:-1, :-1] | hole[1:, :-1] | hole[:-1, 1:] | hole[1:, 1:])
        self.assertEqual(len(received.polygons), whole.sum())
        corners = received.points[received.polygons]
        sides = np.linalg.norm((corners - np.roll(corners, 1, axis=1)) @ (LPS_OF_RAS @ projection[:3, :2]), axis=-1)
        self.assertLess(np.abs(sides - 0.5).max(), 1e-3)

        texture = self.client.expect('FieldTexture', since=since)
        self.assertEqual(texture.pixels.shape, (1, height, width, 3))
        lps_mm = apply(texture.T_world_ijk, np.stack([columns, rows, 0 * rows], -1))
        grid_mm = 1000 * apply(projection, np.stack([columns, rows, 0 * rows], -1) * resolution) @ LPS_OF_RAS
        self.assertLess(np.abs(lps_mm - grid_mm).max(), MICROMETRE)
        self.assertEqual(texture.axes, 'lps')
        self.assertTrue((texture.pixels[0][~hole][:, :2] == colour[:, :2]).all())
        self.assertTrue((texture.pixels[0][hole] == 0).all())

        text = self.client.expect('ShiftSummary').string
        self.assertIn('dura_open -> resected: magnitude 6.10 +- 1.20 mm, along gravity not known', text)
        values = self.client.expect('ShiftSummaryValues').values
        self.assertEqual(len(values), 22)
        self.assertLess(np.abs(values[[0, 1, 2, 6, 11]] - [12, 0.9, 6.1, -5, 0.7]).max(), 1e-9)
        self.assertTrue(np.isnan(values[4]))

        path = os.path.join(self.folder.name, 'dura_open__resected.vtk')
        wait_until(lambda: os.path.exists(path), 20, 'the vtk file')
        reader = vtk.vtkPolyDataReader()
        reader.SetFileName(path)
        reader.ReadAllColorScalarsOn()
        reader.Update()
        data = reader.GetOutput()
        self.assertLess(np.abs(vtk_to_numpy(data.GetPoints().GetData()) - truth_mm).max(), MICROMETRE)
        arrays = data.GetPointData()
        self.assertLess(np.abs(vtk_to_numpy(arrays.GetArray('displacement')) - vectors_mm).max(), MICROMETRE)
        self.assertTrue((vtk_to_numpy(arrays.GetArray('rgb')) == colour[:, :3]).all())
        self.assertEqual(data.GetNumberOfPolys(), whole.sum())
        self.assertIn('SPACE=LPS', reader.GetHeader())
        self.assertIn(f'by 0.1-2-gabc with parameters {8 * "c"}, calibration {8 * "d"}; 1 WARNINGS', reader.GetHeader())

    def test_updated_mr_arrives_as_its_nifti_says(self):
        """Oblique and left-handed, in the axes of the link (LPS); and the tumour where it is now."""
        random_numbers = np.random.default_rng(8)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = rotation([1, 2, 3], 0.4) @ np.diag([-0.0008, 0.0009, 0.0012]), [0.07, -0.02, 0.01]
        mr = Volume(random_numbers.normal(100, 30, (21, 17, 9)).astype(np.float32), T)
        inside = np.zeros(mr.data.shape, np.float32)
        inside[6:14, 5:11, 2:7] = 1
        was, quads = border_of_label(Volume(inside, T))
        now = was + random_numbers.normal(0, 0.002, was.shape)
        path = os.path.join(self.folder.name, 'updated.nii.gz')
        save_nifti(mr, path)
        made = updated_mr_message(mr, [Structure('tumour', was, now, np.zeros(len(was)), quads)],
                                  SimpleNamespace(from_key='pmr', to_key='after', to_stamp=1700000000.5))
        publisher = rospy.Publisher('/brain_model/updated_mr', UpdatedMr, queue_size=1, latch=True)
        publisher.publish(made)
        received = self.client.expect('UpdatedMr')
        written = nibabel.load(path)
        self.assertEqual(received.axes, 'lps')
        self.assertAlmostEqual(received.stamp, 1700000000.5, places=5)
        np.testing.assert_array_equal(received.pixels[..., 0].transpose(2, 1, 0), np.asarray(written.dataobj))
        corners = np.stack(np.meshgrid([0, 20], [0, 16], [0, 8], indexing='ij'), -1).reshape(-1, 3)
        self.assertLess(np.abs(apply(received.T_world_ijk, corners) - apply(written.affine, corners) @ LPS_OF_RAS).max(), 0.0001)

        tumour = self.client.expect('Now_tumour')
        self.assertLess(np.abs(tumour.points - 1000 * now @ LPS_OF_RAS).max(), MICROMETRE)
        self.assertLess(np.abs(tumour.attributes['displacement'] - 1000 * (now - was) @ LPS_OF_RAS).max(), MICROMETRE)
        np.testing.assert_array_equal(tumour.polygons, quads)

        said = []
        log = rospy.Subscriber('/rosout', Log, lambda message: said.append(message.msg))
        wait_until(lambda: log.get_num_connections() >= 2, 20, 'the log of the bridge')   # our own is one
        made.labels[0].quads[5] = len(was)   # a corner that is not there
        made.header.stamp += rospy.Duration(1)
        publisher.publish(made)
        wait_until(lambda: any("label 'tumour' has a quad at a corner that is not there" in text for text in said), 20, 'its refusal')
        good = updated_mr_message(mr, [], SimpleNamespace(from_key='pmr', to_key='after', to_stamp=1700000002.0))
        publisher.publish(good)
        self.client.expect('UpdatedMr', since=1700000002.0)
        taken_out = Structure('tumour', np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 4), int))
        publisher.publish(updated_mr_message(mr, [taken_out], SimpleNamespace(from_key='pmr', to_key='resected', to_stamp=1700000003.0)))
        self.assertEqual(len(self.client.expect('Now_tumour', since=1700000003.0).points), 0)
        late = self.bridge.client()
        self.addCleanup(late.stop)
        self.assertEqual(len(late.expect('Now_tumour').points), 0)

    def test_late_client_gets_the_last_field(self):
        points = np.zeros((2, 2, 3))
        self.fields.publish(field(points + 0.1, points))
        self.client.expect('ShiftField')
        self.fields.publish(field(points + 0.2, points))
        self.client.expect('ShiftField')
        late = self.bridge.client()
        self.addCleanup(late.stop)
        self.assertAlmostEqual(late.expect('ShiftField').points[0, 2], 200, places=3)

    def test_faulty_field_is_not_sent(self):
        points = np.zeros((2, 2, 3))
        said = []
        log = rospy.Subscriber('/rosout', Log, lambda message: said.append(message.msg))
        wait_until(lambda: log.get_num_connections() >= 2, 20, 'the log of the bridge')   # our own is one
        for fault in ('frame', 'short', 'resolution', 'fields', 'offset'):
            message = field(points, points)
            if fault == 'frame':
                message.points.header.frame_id = 'map'
            elif fault == 'short':
                message.points.data = message.points.data[:-1]
            elif fault == 'resolution':
                message.resolution = 0
            elif fault == 'offset':
                message.points.fields[0].offset = 2 ** 32 - 4   # with its four bytes it ends at 0, in 32 bits
            else:
                message.points.fields[2].datatype = PointField.FLOAT64
            self.fields.publish(message)
            if fault == 'offset':   # before another one takes its place
                wait_until(lambda: any('field x of the cloud is not a float32 within' in text for text in said), 20, 'its refusal')
        self.fields.publish(field(points + 0.3, points))
        wait_until(lambda: self.sees_point(300), 20, 'the good field after the faulty ones')

    def sees_point(self, z_mm):
        message = self.client.take('ShiftField', 1)
        return message is not None and abs(message.points[0, 2] - z_mm) < MICROMETRE

    def test_surface_and_pictures(self):
        points = np.random.default_rng(3).normal(0, 0.02, (30, 40, 3))
        points[4, 8] = np.nan
        self.surfaces.publish(cloud(points))
        received = self.client.expect('Surface')
        kept = points[::4, ::4].reshape(-1, 3)
        kept = kept[np.isfinite(kept[:, 0])]
        self.assertLess(np.abs(received.points - 1000 * kept @ LPS_OF_RAS).max(), MICROMETRE)

        picture = np.random.default_rng(4).integers(0, 256, (33, 50, 3), np.uint8)  # blue green red
        for topic, device in (('overlay_before', 'OverlayBeforePict'), ('overlay_after', 'OverlayAfterPict'),
                              ('magnitude', 'MagnitudePict')):
            publisher = rospy.Publisher('/shift/' + topic, Image, queue_size=1, latch=True)
            publisher.publish(Image(height=33, width=50, encoding='bgr8', step=150, data=picture.tobytes()))
            self.assertTrue((self.client.expect(device).pixels[0] == picture[..., ::-1]).all())


if __name__ == '__main__':
    rostest.rosrun('cortshift_tracking', 'igtl_field', IgtlField)
