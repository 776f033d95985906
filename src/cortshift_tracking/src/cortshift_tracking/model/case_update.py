"""A case's field through its model: what update_mr and the node brain_model both do, and when they refuse to."""
import json
import os
import time
from dataclasses import asdict, dataclass

import cv2
import numpy as np
from scipy.ndimage import binary_erosion

from cortshift_tracking.case.messages import MR_KEY
from cortshift_tracking.durable import removed_durably, write_durably
from cortshift_tracking.model.brain import ModelError, identity_of
from cortshift_tracking.model.overlay import overlay
from cortshift_tracking.model.structures import left_of, located, structures_of
from cortshift_tracking.model.update import bin_field, update
from cortshift_tracking.model.warp import hole_now, labels_now, warped, warps_of, write_nrrd
from cortshift_tracking.mr.reader import save_nifti
from cortshift_tracking.mr.volume import Volume
from cortshift_tracking.poses import pose_matrix
from cortshift_tracking.software import software_version

NOW_FROM_PMR = 'now_from_pmr: at each point of the preoperative MR the vector to where its tissue is now'
PMR_FROM_NOW = 'pmr_from_now: at each point of now the vector to where its tissue was in the preoperative MR; warps the MR to now'


@dataclass(frozen=True)
class Updated:
    """What came of it. summary: as in summary.json. structures: of the labels, in their order. resected: as it was given."""
    update: object
    mr: Volume
    labels: Volume
    now_from_pmr: object
    pmr_from_now: object
    summary: dict
    structures: list
    resected: object = None


def check_mr(model, volume):
    """Raises ModelError where the model is of another MR."""
    if model.provenance['mr'] != identity_of(volume):
        raise ModelError(f'the model is of another MR ({model.provenance["mr_source"]}) than {volume.source}; prepare one of this MR')


def direction_of(values, given_by):
    """Unit vector of gravity given as three numbers. given_by: by which option, for people. Raises ModelError."""
    values = np.array(values, float)
    length = np.linalg.norm(values)
    if not np.isfinite(length) or length == 0:
        raise ModelError(f'{given_by} {" ".join(f"{value:g}" for value in values)}: is no direction; give that of gravity in pmr, such as 0 0 -1')
    return values / length


def epochs_of(field, stages):
    """Key to epoch of the field's ends, 0 where there is no such stage. stages: that have a key and an epoch. The preoperative MR has none."""
    known = {stage.key: stage.epoch for stage in stages}
    return {key: known.get(key, 0) for key in (field.from_key, field.to_key) if key != MR_KEY}


def check_epochs(model, epochs):
    """Raises ModelError where the stages of a field, key to epoch, are of several patient registrations, or not of the model's.

    0: not known, as in stages of old versions and of stages that are not there. Beside a known one it may be another; where none is
    known, `update_case` warns.
    """
    known = dict(epochs)
    if model.provenance.get('epoch') is not None:   # of a model that was made of no stage there is none
        known['of the model'] = model.provenance['epoch']
    unknown = [key for key, epoch in epochs.items() if not epoch]
    if unknown and any(known.values()):
        raise ModelError(f'the epoch of {" and ".join(unknown)} is not known (the stage is not in the case any more, or is of an old version), so '
                         'that the patient registration may have changed; compute the field between stages that are there')
    if len(set(known.values())) > 1:
        told = ', '.join(f'{key}: {epoch or "not known"}' for key, epoch in known.items())
        raise ModelError(f'patient registration or calibration changed between them (epochs {told}); capture both stages in one epoch, and '
                         'prepare the model from a stage of it')


def update_case(model, volume, field, gravity, labels, resected=None, epochs=None):
    """Updated of a Field. labels: name to Volume; gravity in pmr, or None.

    resected: Volume, > 0.5 where tissue has gone, or None. There the updated MR has its darkest value and no label is.
    """
    began = time.monotonic()
    check_mr(model, volume)
    check_epochs(model, epochs or {})
    confidence = np.nan_to_num(field.confidence)
    # Bone and drape do not pull: the brain slides below them.
    start = np.where(((confidence > 0) & field.on_brain(field.start))[..., None], field.start, np.nan).reshape(-1, 3)
    uncertainty, common = field.uncertainty, getattr(field.summary, 'common_sd', 0.0)
    pulls = bin_field(model, start, field.displacement.reshape(-1, 3), None if uncertainty is None else uncertainty.ravel(),
                      common=float(common) if np.isfinite(common) else 0.0)
    gone = np.zeros(len(model.tissue), bool)
    if resected is not None:
        gone = np.nan_to_num(resected.sample(model.mesh.nodes[model.mesh.tetrahedra].mean(1))) > 0.5
        if not gone.any():
            raise ModelError(f'{resected.source}: the resected part holds nothing of the brain; give a volume in the space of the MR')
    result = update(model, pulls, gravity, gone, exposed=field.in_opening)
    now_from_pmr, pmr_from_now = warps_of(model, result, volume)
    moved, hole = warped(volume, pmr_from_now), None
    left, share = dict(labels), {}
    if resected is not None:
        hole = hole_now(volume, pmr_from_now, resected)
        moved[hole] = volume.data.min()
        for name, label in labels.items():
            left[name], share[name] = left_of(label, resected)
    warnings = [*(f'MR: {text}' for text in volume.warnings), *(f'resected: {text}' for text in (resected.warnings if resected else ())),
                *(() if field.summary is None else field.summary.warnings), *result.warnings]
    if not field.brain and field.from_mr:   # whose vectors are none of bone
        warnings.append('a field from the MR does not say the outline of the exposed brain: the skull holds nothing within the model\'s craniotomy')
    elif not field.brain:
        warnings.append('the outline of the exposed brain is not known: vectors of bone and drape pull too; draw it with set_outline')
    if epochs and not any(epochs.values()):
        warnings.append('the epochs of the stages are not known, so that it is not checked whether the patient registration changed')
    if not field.from_mr:
        warnings.append(f'the field begins at stage "{field.from_key}": what the brain moved from the MR until then is not in it')
    if now_from_pmr.least_stretch() <= 0 or pmr_from_now.least_stretch() <= 0:
        warnings.append('the warp folds somewhere: the motion is too large or too uneven for the model')
    if resected is None:
        warnings.append('no resected part was given: tissue that was taken out counts as there')
    length = np.linalg.norm(result.displacement, axis=1) * 1000
    summary = {'from_key': field.from_key, 'to_key': field.to_key, 'seconds': round(time.monotonic() - began, 3),
               'drained_fraction': _number(result.drained), 'swelling': _number(result.swelling),
               'residual_at_surface_mm': _number(result.residual * 1000), 'largest_displacement_mm': _number(length.max()),
               'resected_mm3': _number(model.mesh.volumes[gone].sum() * 1e9), 'skull_patches_pressing': _number(result.pressing),
               'labels': {name: {'value': number, **moved_label(model, result, label), **({'resected': _number(share[name])} if share else {})}
                          for number, (name, label) in enumerate(left.items(), 1)},
               'warnings': warnings, 'model': model.provenance,
               'made_with': {'software': software_version(), 'field': asdict(field.provenance)}}
    return Updated(result, Volume(moved, volume.T_pmr_voxel, volume.axes, volume.source), labels_now(volume, pmr_from_now, labels, hole),
                   now_from_pmr, pmr_from_now, summary, structures_of(model, result, now_from_pmr, labels, left), resected)


def _number(value):
    return None if not np.isfinite(value) else round(float(value), 4)


def moved_label(model, result, label, most=4000):
    """Shift of a labelled structure's centre and border [mm], each with its standard deviation."""
    inside = label.data > 0.5
    voxels = np.argwhere(inside)
    border = np.argwhere(inside & ~binary_erosion(inside))
    told = {}
    for name, chosen in (('centre', voxels), ('border', border)):
        points = label.to_pmr(chosen[::max(1, len(chosen) // most)])
        now, sd, known = located(model, result, points)
        if known.any():
            shift = now[known] - points[known]
            told[f'{name}_shift_mm'] = _number(np.linalg.norm(shift.mean(0) if name == 'centre' else shift, axis=-1).mean() * 1000)
            told[f'{name}_sd_mm'] = _number(np.sqrt((sd[known] ** 2).mean()) * 1000)
    return told


def overlay_of(updated, field, stage):
    """Picture of the stage at which the field ends, with the structures as they were and are. Raises ModelError where there is none."""
    taken_out = getattr(field.summary, 'surround_correction', None)   # messages of earlier versions have none
    return overlay(updated.structures, stage, None if taken_out is None else pose_matrix(taken_out.pose))


def write_update(updated, folder, picture=None):
    """The files of the contract, each durably; picture: of overlay_of, to overlay.png.

    summary.json goes first and comes last: a folder that has one is whole, and of one update.
    """
    os.makedirs(folder, exist_ok=True)
    for name in ('summary.json', 'overlay.png'):
        removed_durably(os.path.join(folder, name))
    save_nifti(updated.mr, os.path.join(folder, 'updated_mr.nii.gz'), level=1)
    save_nifti(updated.labels, os.path.join(folder, 'labels_now.nii.gz'), np.uint8, level=1)
    write_nrrd(updated.now_from_pmr, os.path.join(folder, 'now_from_pmr.nrrd'), NOW_FROM_PMR)
    write_nrrd(updated.pmr_from_now, os.path.join(folder, 'pmr_from_now.nrrd'), PMR_FROM_NOW)
    if picture is not None:
        write_durably(os.path.join(folder, 'overlay.png'), cv2.imencode('.png', picture)[1].tobytes())
    write_durably(os.path.join(folder, 'summary.json'), json.dumps(updated.summary, indent=1) + '\n')
