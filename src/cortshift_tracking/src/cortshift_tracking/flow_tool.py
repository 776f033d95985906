"""The flow of cortshift_flow by its tools, and the files that they write."""
import os
import subprocess
import tempfile

import cv2
import numpy as np

from cortshift_tracking.errors import CortshiftError


def run_flow_tool(tool, *arguments):
    """Run a tool of cortshift_flow. Raises CortshiftError with what it said where it fails or is not there."""
    try:
        run = subprocess.run(['rosrun', 'cortshift_flow', tool, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                             universal_newlines=True, check=False)
    except FileNotFoundError as error:
        raise CortshiftError('rosrun is not on the path; source the workspace') from error
    if run.returncode != 0:
        raise CortshiftError(f'{tool} failed: {run.stdout.strip()}')


def read_flo(path):
    """Middlebury flow (H, W, 2) [px]."""
    with open(path, 'rb') as file:
        magic = np.fromfile(file, np.float32, 1)
        if magic.size != 1 or magic[0] != np.float32(202021.25):
            raise CortshiftError(f'{path}: not a .flo file')
        width, height = np.fromfile(file, np.int32, 2)
        return np.fromfile(file, np.float32, 2 * width * height).reshape(height, width, 2)


def flow_between(first, second, **settings):
    """Flow (H, W, 2) [px] from the first to the second image, (H, W, 3) 0-1, by flow_pair with FlowSettings of these names."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [os.path.join(folder, name) for name in ('first.png', 'second.png', 'flow.flo', 'settings.yaml')]
        for path, image in zip(paths, (first, second)):
            cv2.imwrite(path, np.clip(image * 65535, 0, 65535).astype(np.uint16))
        with open(paths[3], 'w', encoding='utf-8') as file:
            file.write('%YAML:1.0\n---\n' + ''.join(f'{name}: {value}\n' for name, value in settings.items()))
        run_flow_tool('flow_pair', *paths[:3], '--settings', paths[3])
        return read_flo(paths[2])
