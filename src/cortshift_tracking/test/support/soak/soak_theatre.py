"""What stands before the graph: the phantom's driver alone, or cameras in software and a tracker that show a phantom case."""
import contextlib
import os
import pathlib
import signal
import subprocess
import threading
import time

import cv2
import numpy as np
import rosbag
import yaml
from cortshift_tracking.poses import rotation_from_message
from igtl_client import Client
from programs import program

SIZE = (320, 240)     # of an image, which the camera in software sends in one burst: it has to fit into a socket's buffer
RATE = 50.0           # Hz of the tracker
TREMBLE = 1e-5        # m, standard deviation of a coordinate
DROPOUT = 1.0         # s
TOOLS = (('PatientToReference', 'reference', 'pmr'), ('MicroscopeToRef', 'reference', 'microscope'))


class CamerasAndTracker:
    """Two GigE Vision cameras in software, and a tracker that is a client of the bridge: a phantom case, a stage at a time.

    The cameras have addresses of the loopback interface that this adds to it, for which one must be root.
    """

    def __init__(self, folder, case, igtl_port, dropouts, cleanup):
        self.folder, self._port = folder, igtl_port
        self._dropouts, self._cameras, self._client = dropouts, {}, None
        self._random, self._ending = np.random.default_rng(1), threading.Event()
        self._addresses = {side: f'127.{100 + os.getpid() % 100}.{os.getpid() // 100 % 250}.{n}' for n, side in ((3, 'left'), (4, 'right'))}
        folder.mkdir()
        self._read(case)
        self.set_stage(next(iter(self._stages)))
        for side, address in self._addresses.items():
            subprocess.run(['ip', 'address', 'add', address + '/8', 'dev', 'lo'], check=True)
            cleanup.callback(subprocess.run, ['ip', 'address', 'delete', address + '/8', 'dev', 'lo'], check=False)
            self._start(side)
        cleanup.callback(self._end)
        self._thread = threading.Thread(target=self._track, daemon=True)
        self._thread.start()

    def _read(self, case):
        """Calibration, images and poses of the case."""
        path = str(self.folder / 'case.bag')
        subprocess.run([program('phantom_bag', 'cortshift_stereo'), '--case', case, '--output', path, '--first-pairs', '1'], check=True,
                       stdout=subprocess.DEVNULL)
        names = [stage['name'] for stage in yaml.safe_load(pathlib.Path(case).read_text())['stages']]
        images, edges = {'left': [], 'right': []}, {}
        with rosbag.Bag(path) as bag:
            for topic, message, _ in bag:
                side = topic.split('/')[2] if topic.startswith('/stereo/') else ''
                if topic.endswith('compressed'):
                    grey = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_GRAYSCALE)
                    assert grey.shape[::-1] == SIZE
                    images[side].append((message.header.stamp, grey))
                elif topic.endswith('camera_info'):
                    self._write_calibration(side, message)
                for edge in getattr(message, 'transforms', []):
                    edges.setdefault((edge.header.frame_id, edge.child_frame_id), []).append(edge)
        self._write_hand_eye(edges['microscope', 'left_optical'][0].transform)
        self._stages = {}
        for number, name in enumerate(names):
            stamp = images['left'][number][0]
            poses = {device: self._pose(edges, parent, child, stamp) for device, parent, child in TOOLS}
            self._stages[name] = poses, {side: images[side][number][1].tobytes() for side in images}

    @staticmethod
    def _pose(edges, parent, child, stamp):
        """(4, 4) in mm, of the sample nearest to the stamp; the bag may have the edge the other way round."""
        turned = (parent, child) not in edges
        samples = edges[(child, parent) if turned else (parent, child)]
        nearest = min(samples, key=lambda edge: abs((edge.header.stamp - stamp).to_sec())).transform
        t, q = nearest.translation, nearest.rotation
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation_from_message(q).as_matrix(), [t.x, t.y, t.z]
        matrix = np.linalg.inv(matrix) if turned else matrix
        matrix[:3, 3] *= 1000
        return matrix

    def _write_calibration(self, side, info):
        lines = {'image_width': info.width, 'image_height': info.height, 'camera_name': side, 'distortion_model': info.distortion_model}
        for name, rows, columns, data in (('camera_matrix', 3, 3, info.K), ('distortion_coefficients', 1, len(info.D), info.D),
                                          ('rectification_matrix', 3, 3, info.R), ('projection_matrix', 3, 4, info.P)):
            lines[name] = {'rows': rows, 'cols': columns, 'data': [float(x) for x in data]}
        (self.folder / f'{side}.yaml').write_text(yaml.safe_dump(lines))

    def _write_hand_eye(self, transform):
        t, q = transform.translation, transform.rotation
        (self.folder / 'hand_eye.yaml').write_text(yaml.safe_dump({
            'parent_frame': 'microscope', 'child_frame': 'left_optical', 'translation': [t.x, t.y, t.z], 'rotation': [q.x, q.y, q.z, q.w]}))

    def site(self, recordings):
        """As config/site.yaml."""
        cameras = {'pixel_format': 'Mono8', 'packet_socket': False, 'packet_size': 1400, 'frame_retention': 0.5, 'exposure': 0.005,
                   'sync_tolerance': 0.02}
        for side, address in self._addresses.items():
            cameras[side] = {'device': address, 'trigger_source': 'Software', 'features': [f'Width={SIZE[0]}', f'Height={SIZE[1]}']}
        tools = [{'device': device, 'parent': parent, 'child': child, 'latency': 0.0} for device, parent, child in TOOLS]
        return {'stereo_driver': {'source': 'aravis', 'calibration_left': str(self.folder / 'left.yaml'),
                                  'calibration_right': str(self.folder / 'right.yaml'), 'hand_eye': str(self.folder / 'hand_eye.yaml'),
                                  'aravis': cameras},
                'igtl_bridge': {'tools': tools}, 'case_recorder': recordings}

    def _start(self, side):
        self._cameras[side] = subprocess.Popen([program('fake_gige_camera', 'cortshift_stereo'), self._addresses[side], f'SOAK{side}',
                                                str(self.folder / f'{side}.raw')])
        with contextlib.suppress(PermissionError):   # a real camera exposes when it is triggered, however busy the computer is
            os.sched_setscheduler(self._cameras[side].pid, os.SCHED_FIFO, os.sched_param(10))

    def _end(self):
        self._ending.set()
        self._thread.join()
        for camera in self._cameras.values():
            camera.kill()
            camera.wait()

    def set_stage(self, name):
        """What the cameras and the tracker show from now on."""
        self._poses, pictures = self._stages[name]
        for side, picture in pictures.items():
            (self.folder / f'{side}.new').write_bytes(picture)
            os.replace(self.folder / f'{side}.new', self.folder / f'{side}.raw')

    def camera_gone(self, side, seconds):
        """For so long it has no power."""
        self._cameras[side].send_signal(signal.SIGKILL)
        self._cameras[side].wait()
        time.sleep(seconds)
        self._start(side)

    def _track(self):
        silent_until = 0.0
        while not self._ending.wait(1 / RATE):
            now = time.monotonic()
            if now < silent_until:
                continue
            if self._random.random() < self._dropouts / RATE:
                silent_until = now + DROPOUT
            try:
                if self._client is None or not self._client.is_connected():
                    self._client = Client('127.0.0.1', self._port)
                for device, matrix in self._poses.items():
                    trembling = matrix.copy()
                    trembling[:3, 3] += 1000 * TREMBLE * self._random.standard_normal(3) * (device != 'PatientToReference')
                    self._client.transform(device, trembling, time.time())
            except OSError:
                self._client = None
                self._ending.wait(0.5)
