"""The paper's digital phantom (section 2.6, Eq. 6-8, Figs. 4-6): errors of the flow, beside the paper's own figures."""
import os
import tempfile
from dataclasses import dataclass

import cv2
import numpy as np

from cortshift_tracking.flow_tool import read_flo, run_flow_tool

WRONG = 0.5        # [px], as drawn in the paper's Figs. 5 and 6
RIM_REACH = 60     # errors further from the rim do not belong to its band [px]

#: What the paper reports (section 3.1, Figs. 5-6); None: not given.
PAPER = {'outward': {'share_below_005': 'majority', 'rim_band': 40.0, 'patch_largest': None},
         'inward': {'share_below_005': 'majority', 'rim_band': 3.0, 'patch_largest': 1.2}}


@dataclass(frozen=True)
class PhantomErrors:
    """Endpoint errors [px]; core: inside the craniotomy without the 40 px rim band and the patch; shares 0-1."""
    core_median: float
    core_percentile_95: float
    share_below_005: float
    rim_band: float        # mean width of the band at the rim that is wrong by more than WRONG
    patch_largest: float   # in the featureless, saturated patch
    craniotomy_mean: float


def phantom_errors(flow, truth, craniotomy, core, patch):
    """PhantomErrors from flows (H, W, 2) and masks (H, W) bool."""
    error = np.linalg.norm(flow - truth, axis=-1)
    inside = cv2.distanceTransform(np.pad(craniotomy, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    contours = cv2.findContours(craniotomy.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[-2]
    rim_length = sum(cv2.arcLength(c, True) for c in contours)
    band = craniotomy & (inside < RIM_REACH) & ~patch & (error > WRONG)
    return PhantomErrors(float(np.median(error[core])), float(np.percentile(error[core], 95)), float((error[core] < 0.05).mean()),
                         float(band.sum() / rim_length), float(error[patch].max()) if patch.any() else float('nan'),
                         float(error[craniotomy].mean()))


def measure(case, presets, seed=1):
    """PhantomErrors of each preset of cortshift_flow, by its name, on the phantom `case` ('outward' or 'inward')."""
    errors = {}
    with tempfile.TemporaryDirectory() as folder:
        run_flow_tool('make_phantom', case, folder, str(seed))
        at = {name: os.path.join(folder, name) for name in ('first.png', 'second.png', 'flow.flo', 'settings.yaml')}
        masks = [cv2.imread(os.path.join(folder, f'{name}.png'), cv2.IMREAD_GRAYSCALE) > 0 for name in
                 ('craniotomy', 'core', 'patch')]
        truth = read_flo(os.path.join(folder, 'truth.flo'))
        for preset in presets:
            with open(at['settings.yaml'], 'w', encoding='utf-8') as file:
                file.write(f'%YAML:1.0\n---\npreset: {preset}\n')
            run_flow_tool('flow_pair', at['first.png'], at['second.png'], at['flow.flo'], '--settings', at['settings.yaml'])
            errors[preset] = phantom_errors(read_flo(at['flow.flo']), truth, *masks)
    return errors


def table(presets=('default', 'ji2014'), seed=1):
    """The comparison as lines of text."""
    lines = [f'{"case":8} {"flow":10} {"core median":>12} {"95th pct":>9} {"< 0.05 px":>10} {"rim band > 0.5 px":>18} '
             f'{"patch largest":>14} {"whole mean":>11}']
    for case, paper in PAPER.items():
        for preset, e in measure(case, presets, seed).items():
            lines.append(f'{case:8} {preset:10} {e.core_median:9.4f} px {e.core_percentile_95:6.3f} px {100 * e.share_below_005:8.1f} %'
                         f' {e.rim_band:15.1f} px {e.patch_largest:11.2f} px {e.craniotomy_mean:8.3f} px')
        largest = f'{paper["patch_largest"]:11.2f} px' if paper['patch_largest'] is not None else f'{"-":>14}'
        lines.append(f'{case:8} {"paper":10} {"-":>12} {"-":>9} {paper["share_below_005"]:>10} {paper["rim_band"]:15.1f} px {largest} '
                     f'{"-":>11}')
    return lines
