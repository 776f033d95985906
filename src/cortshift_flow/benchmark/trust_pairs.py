"""Pairs of images with known flow, from photographs of Debian's packages and planar phantoms: three sets that share no photograph.

`fit` is what script/fit_trust flow fits on, `choose` what its kinds of evidence were chosen on, `judge` what BENCHMARK.md reports.
"""
import importlib.util
import pathlib
import subprocess
import zlib

import cv2
import numpy as np

OPENCV = pathlib.Path('/usr/share/doc/opencv-doc/examples')
PHOTOGRAPHS = {
    'fit': ('camera.png', 'brick.png', 'gravel.png', 'moon.png', 'rocket.jpg', 'hubble_deep_field.jpg', 'cell.png', 'messi5.jpg',
            'starry_night.jpg', 'stuff.jpg', 'orange.jpg', 'squirrel_cls.jpg', 'ela_original.jpg', 'basketball1.png',
            'scenetext01.jpg', 'scenetext03.jpg', 'left.jpg', 'aero1.jpg'),
    'choose': ('butterfly.jpg', 'building.jpg', 'grass.png', 'ihc.png', 'leuvenA.jpg', 'coins.png', 'apple.jpg', 'board.jpg'),
    'judge': ('retina.jpg', 'coffee.png', 'chelsea.png', 'astronaut.png', 'graf1.png', 'fruits.jpg', 'baboon.jpg', 'home.jpg'),
}
PHANTOMS = {'fit': (11,), 'choose': (21,), 'judge': (31,)}   # seeds
PHANTOM_CASES = ('outward', 'outward_all', 'inward_overlaid', 'inward_tissue', 'noise2', 'noise5', 'gain', 'vignette', 'blood')
KINDS = ('clean', 'noise', 'gain', 'vignette', 'jpeg', 'blur', 'glints', 'layers', 'layers', 'bumps', 'bumps', 'large')
PER_PHOTOGRAPH = 3   # pairs
WIDTH, HEIGHT = 480, 360
STEEPEST = 0.3   # slope of a field [px / px]: nothing folds


def find(name):
    """The path of a photograph of opencv-doc or python3-skimage."""
    skimage = importlib.util.find_spec('skimage')
    places = [OPENCV / 'data', OPENCV / 'text'] + ([pathlib.Path(skimage.origin).parent / 'data'] if skimage else [])
    for place in places:
        if (place / name).exists():
            return place / name
    raise FileNotFoundError(f'{name}: the photographs come with opencv-doc and python3-skimage')


def grid():
    return np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).astype(np.float32)


def smooth_field(random, amplitude, wavelength):
    """(H, W, 2) [px]: a sum of waves of about that length."""
    at = grid()
    field = np.zeros_like(at)
    for _ in range(4):
        angle, phase, length = random.uniform(0, 2 * np.pi), random.uniform(0, 2 * np.pi), wavelength * random.uniform(0.7, 1.5)
        wave = np.sin((at[..., 0] * np.cos(angle) + at[..., 1] * np.sin(angle)) * 2 * np.pi / length + phase)
        direction = random.normal(size=2)
        field += (amplitude / 2 * wave[..., None] * direction / np.hypot(*direction)).astype(np.float32)
    steepest = max(np.abs(np.diff(field, axis=0)).max(), np.abs(np.diff(field, axis=1)).max())
    return field * np.float32(min(1, STEEPEST / steepest))


class Photograph:
    """A photograph that fills more than the view; its colours at points of the view."""

    def __init__(self, name):
        image = cv2.imread(str(find(name))).astype(np.float32)
        scale = max(1.35 * WIDTH / image.shape[1], 1.35 * HEIGHT / image.shape[0])
        method = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        self._image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=method)
        self._corner = ((self._image.shape[1] - WIDTH) / 2, (self._image.shape[0] - HEIGHT) / 2)

    def at(self, points):
        return cv2.remap(self._image, (points + self._corner).astype(np.float32), None, cv2.INTER_LANCZOS4,
                         borderMode=cv2.BORDER_REFLECT_101)


def blob(random):
    """A function of points: inside a random smooth outline or not."""
    centre = np.array([random.uniform(0.3, 0.7) * WIDTH, random.uniform(0.3, 0.7) * HEIGHT])
    radius, waves = random.uniform(50, 110), random.uniform(-0.15, 0.15, (4, 2))

    def inside(points):
        x, y = np.moveaxis(points - centre, -1, 0)
        angle = np.arctan2(y, x)
        limit = 1 + sum(a * np.cos((k + 1) * angle) + b * np.sin((k + 1) * angle) for k, (a, b) in enumerate(waves))
        return np.hypot(x, y) < radius * limit
    return inside


def inverse(field):
    """At points of the second image, where they were in the first."""
    back = grid()
    for _ in range(30):
        back = grid() - cv2.remap(field, back, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return back


def disturb(random, kind, first, second):
    noise = {'noise': random.uniform(2, 6)}.get(kind, random.uniform(0.3, 1.5))
    at = grid()
    if kind == 'gain':
        second = second * random.uniform(0.75, 1.2, 3) + random.uniform(-12, 12, 3)
    if kind == 'vignette':
        distance = np.hypot(at[..., 0] / WIDTH - 0.5, at[..., 1] / HEIGHT - 0.5) / np.hypot(0.5, 0.5)
        second = second * (1 - random.uniform(0.2, 0.5) * distance ** 2)[..., None]
    if kind == 'blur':
        second = cv2.GaussianBlur(second, None, random.uniform(0.6, 2))
        if random.uniform() < 0.5:
            first = cv2.GaussianBlur(first, None, random.uniform(0.6, 2))
    if kind == 'glints':
        pair = [first.copy(), second.copy()]
        for image in pair:
            for _ in range(random.integers(10, 60)):
                centre = (int(random.uniform(0, WIDTH)), int(random.uniform(0, HEIGHT)))
                cv2.ellipse(image, centre, (int(random.uniform(2, 14)), int(random.uniform(2, 8))), random.uniform(0, 180), 0, 360,
                            (255, 255, 255), -1, cv2.LINE_AA)
        first, second = (cv2.GaussianBlur(image, None, 0.8) for image in pair)
    images = []
    for image in (first, second):
        image = np.clip(np.rint(image + random.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)
        if kind == 'jpeg':
            image = cv2.imdecode(cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, int(random.uniform(75, 95))])[1], 1)
        images.append(image)
    return images


def photograph_pair(name, kind, others):
    """first, second, flow (NaN where it is not known) of one photograph; `others` may move over it."""
    random = np.random.default_rng(zlib.crc32(f'{name} {kind}'.encode()))
    behind = Photograph(name)
    amplitude, wavelength = {'bumps': (random.uniform(2, 6), random.uniform(60, 140)),
                             'large': (random.uniform(15, 30), 900)}.get(kind.split('#', maxsplit=1)[0],
                                                                        (random.uniform(1, 10), random.uniform(250, 700)))
    flow = smooth_field(random, amplitude, wavelength) + random.uniform(-1, 1, 2).astype(np.float32) * amplitude
    end = grid() + flow
    second = behind.at(grid())
    first = behind.at(end)
    known = ((end >= 0) & (end <= [WIDTH - 1, HEIGHT - 1])).all(-1)
    if kind.startswith('layers'):
        front, inside = Photograph(others[random.integers(len(others))]), blob(random)
        moves = smooth_field(random, random.uniform(0.5, 3), 500) + random.uniform(-15, 15, 2).astype(np.float32)
        back = inverse(moves)
        covered, covers = inside(grid()), inside(back)
        first = np.where(covered[..., None], front.at(grid()), first)
        second = np.where(covers[..., None], front.at(back), second)
        hidden = ~covered & (cv2.remap(covers.astype(np.float32), end, None, cv2.INTER_NEAREST) > 0)
        flow = np.where(covered[..., None], moves, flow)
        end = grid() + flow
        known = ((end >= 0) & (end <= [WIDTH - 1, HEIGHT - 1])).all(-1) & ~hidden
    first, second = disturb(random, kind.split('#', maxsplit=1)[0], first, second)
    flow[~known] = np.nan
    return first, second, flow


def read_flow(path):
    with open(path, 'rb') as file:
        file.read(4)
        width, height = np.fromfile(file, '<i4', 2)
        flow = np.fromfile(file, '<f4', 2 * width * height).reshape(height, width, 2)
    flow[np.abs(flow).max(-1) > 1e9] = np.nan
    return flow


def phantom_pair(case, seed, make_phantom, folder):
    subprocess.run([make_phantom, case, folder, str(seed)], check=True)
    first, second, inside = (cv2.imread(str(pathlib.Path(folder) / file)) for file in ('first.png', 'second.png', 'craniotomy.png'))
    flow = read_flow(pathlib.Path(folder) / 'truth.flo')
    flow[inside[..., 0] == 0] = np.nan
    return first, second, flow


def pairs(which, make_phantom, folder):
    """Yields name, first, second, flow of the set `which`."""
    names = PHOTOGRAPHS[which]
    for number, name in enumerate(names):
        for k in range(PER_PHOTOGRAPH):
            kind = KINDS[(number * 5 + k * 7) % len(KINDS)]
            yield (f'{name} {kind}', *photograph_pair(name, f'{kind}#{k}', [other for other in names if other != name]))
    for seed in PHANTOMS[which]:
        for case in PHANTOM_CASES:
            yield (f'phantom {case} {seed}', *phantom_pair(case, seed, make_phantom, folder))
