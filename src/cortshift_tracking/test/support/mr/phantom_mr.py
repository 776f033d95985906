"""The phantom's MR beside its surfaces: what the tests of the MR and its benchmark share."""
import io
import os
import subprocess

import numpy as np
import yaml
from cortshift_tracking.case.messages import Stage
from cortshift_tracking.mr.cortex import CortexSettings, distances_to_cortex, extract_cortex
from cortshift_tracking.mr.cross_section import sure_points
from cortshift_tracking.mr.reader import load_volume
from pcd import read_pcd
from programs import program

HERE = os.path.dirname(os.path.abspath(__file__))
CASE = os.path.join(HERE, '..', '..', '..', '..', '..', 'config', 'phantom', 'phantom_registration.yaml')


def tool(name, *arguments, text=None):
    return subprocess.run([program(name, 'cortshift_stereo'), *map(str, arguments)], input=text, stdout=subprocess.PIPE,
                          universal_newlines=True, check=True).stdout


def truth(points, start, end, case=CASE):
    """Of points (N, 3) near the surface of `start`: distance from it, distance inside the rim, displacement to `end` [m]."""
    lines = tool('phantom_truth', case, start, end, text=''.join('%.9f,%.9f,%.9f\n' % tuple(p) for p in points))
    table = np.genfromtxt(io.StringIO(lines), delimiter=',', names=True)
    return table['distance_m'], table['rim_m'], np.stack([table[name] for name in ('dx_m', 'dy_m', 'dz_m')], -1)


def reconstructed(folder, name, case=CASE):
    """A stage as stereo makes it of the phantom's images."""
    tool('phantom_surface', case, name, folder / f'{name}.pcd', '--reconstructed')
    return Stage(name, '', 1.0, *read_pcd(folder / f'{name}.pcd'), None, 1.0)


def phantom_mr(folder, voxel_mm, case=CASE, side_mm=95):
    path = folder / f'mr_{voxel_mm}.nii'
    tool('phantom_mr', case, path, '--voxel', voxel_mm, '--side', side_mm)
    return load_volume(path)


def inside_rim(points, case, start='unmoved'):
    """The points (N, 3) within the craniotomy, of an array (..., 3) with NaN."""
    points = points[np.isfinite(points).all(-1)]
    return points[truth(points, start, 'moved', case)[1] > 0]


def another_head(path, seed):
    """The case with other vessels, gyri and another opening."""
    with open(CASE, encoding='utf-8') as file:
        case = yaml.safe_load(file)
    case['head']['seed'] = seed
    case['head']['craniotomy']['seed'] = seed
    path.write_text(yaml.safe_dump(case), encoding='utf-8')
    return path


def describe(distance):
    return (f'median {np.median(distance) * 1000:.3f} mm, 99.9th percentile {np.percentile(distance, 99.9) * 1000:.3f} mm, largest '
            f'{distance.max() * 1000:.3f} mm of {distance.size}')


class Section:
    """The first stage's section beside the cortex of an MR whose voxels resolve the floor of a sulcus (clinical ones would be
    compared with their own partial volume)."""

    def __init__(self, folder, case):
        stage = reconstructed(folder, 'unmoved', case)
        tool('phantom_surface', case, 'unmoved', folder / 'exact.pcd')
        seen = inside_rim(read_pcd(folder / 'exact.pcd')[0], case)
        self.volume = phantom_mr(folder, 0.25, case, 64)
        self.cortex = extract_cortex(self.volume, stage.points, settings=CortexSettings(resolution=0.00015, smoothing=0.00015))
        self.of_the_mr = np.abs(distances_to_cortex(seen, self.cortex))   # of the exact surface, NaN beyond the cortex [m]
        self.sure = sure_points(stage.points, stage.confidence)           # what a report draws
        self.shown = inside_rim(self.sure, case)
        self.share = len(self.shown) / len(seen)                          # of the craniotomy
        self.distance = np.abs(distances_to_cortex(self.shown, self.cortex))


class ShiftError:
    """A field from the MR to the stage `moved` against the truth, inside the craniotomy."""

    def __init__(self, field, folder):
        start = field.start[::6, ::6].reshape(-1, 3)
        estimate = field.displacement[::6, ::6].reshape(-1, 3)
        known = np.isfinite(start).all(-1)
        _, rim, true = truth(start[known], 'undeformed', 'moved')
        inside = rim > 0
        self.error_mm = np.linalg.norm(estimate[known] - true, axis=-1)[inside] * 1000
        self.largest_mm = np.linalg.norm(true[inside], axis=-1).max() * 1000
        self.outside = np.mean(~inside)   # share of the vectors: bone that was taken for brain
        # The craniotomy's area, counted on the same grid over the exact surface.
        tool('phantom_surface', CASE, 'moved', folder / 'exact.pcd')
        sparse = read_pcd(folder / 'exact.pcd')[0][::8, ::8]
        _, rim_all, _ = truth(sparse.reshape(-1, 3), 'moved', 'moved')
        rim_all = rim_all.reshape(sparse.shape[:2])
        cell = np.linalg.norm(np.cross(sparse[1:, :-1] - sparse[:-1, :-1], sparse[:-1, 1:] - sparse[:-1, :-1]), axis=-1)
        self.covered = inside.sum() * (6 * field.resolution) ** 2 / cell[rim_all[:-1, :-1] > 0].sum()
