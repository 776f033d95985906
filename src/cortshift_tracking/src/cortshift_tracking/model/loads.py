"""What moves the brain: gravity where the fluid that bore it has drained, and swelling."""
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from cortshift_tracking.model.elasticity import DENSITY, GRAVITY, swelling, weights_of_nodes

DURA = ('falx', 'tentorium')


@dataclass(frozen=True)
class LoadSettings:
    """Mean and standard deviation before anything is measured. Lengths [m]."""
    drained: tuple = (0.7, 0.7)      # buoyancy that has gone, over softness
    softest: float = 5.0             # softness of the brain over that of MATERIALS: 584 Pa, Taylor & Miller 2004 (J Biomech 37:1263)
    level: float = 0.4               # the same of a layer across gravity, beside the rest: how high the fluid stands is not known
    layers: int = 4
    swelling: float = 0.13           # volume strain of all: 10 mmHg more pressure in the skull, over the bulk modulus of MATERIALS
    oedema: float = 0.2              # the same of a part, beside the rest: what white matter with 75 % of water for 70 % has
    around: tuple = (0.01, 0.02, 0.033)   # what is near a tumour: oedema around it reaches one to three centimetres
    near: float = 0.04               # what is near the craniotomy


@dataclass(frozen=True)
class Loads:
    """forces (3N, n) [N] of each load of 1; mean (n,) and covariance (n, n) before anything is measured; limits (n, 2) of what can be.

    gravity: whether they are of gravity, or else of swelling. swells: what is taken to swell, for people.
    """
    forces: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    limits: np.ndarray
    gravity: bool
    swells: str


def loads_of(model, gravity, bulges, left, settings=LoadSettings()):
    """Loads of a brain that bulges through the craniotomy, or else sags. gravity: its direction, or None; left (T,): what weighs and swells.

    One that bulges presses outwards, so that nothing has drained; one that sags does so under gravity, or, where that is not known, as if it
    had lost fluid.
    """
    mesh = model.mesh
    middles = mesh.nodes[mesh.tetrahedra].mean(1)
    if not bulges and gravity is not None:
        height = middles @ gravity
        layer = np.clip((height - height.min()) / np.ptp(height) * settings.layers, 0, settings.layers - 1).astype(int)
        weights = [weights_of_nodes(mesh.nodes, mesh.tetrahedra, 1.0 * (left & (layer == number))) for number in range(settings.layers)]
        forces = np.stack([(DENSITY * GRAVITY * weight[:, None] * gravity).ravel() for weight in weights], -1)
        covariance = np.full((settings.layers,) * 2, settings.drained[1] ** 2) + np.eye(settings.layers) * settings.level ** 2
        return Loads(forces, np.full(settings.layers, settings.drained[0]), covariance, np.array([(0.0, settings.softest)] * settings.layers),
                     True, '')
    names = np.array(model.tissues)[model.tissue]
    brain = left & ~np.isin(names, ('ventricles', *DURA))   # neither fluid nor dura swells
    parts, swells = _parts(model, names, middles, settings) if bulges else ([], '')
    forces = np.stack([swelling(mesh.nodes, mesh.tetrahedra, model.lame, 1.0 * (brain & part))
                       for part in (np.ones(len(middles), bool), *parts)], -1)
    sd = np.array([settings.swelling] + [settings.oedema] * len(parts))
    limits = np.array([(0.0, np.inf) if bulges else (-np.inf, 0.0)] * len(sd))
    return Loads(forces, np.zeros(len(sd)), np.diag(sd ** 2), limits, False, swells)


def _parts(model, names, middles, settings):
    """Parts (T,) bool that may swell more than the rest, and what they are called."""
    if 'oedema' in model.tissues:
        return [names == 'oedema'], 'the tissue of the label "oedema"'
    tumour = names == 'tumour'
    if not tumour.any():
        return [np.linalg.norm(middles - model.craniotomy, axis=1) < settings.near], 'the tissue near the craniotomy'
    away = cKDTree(middles[tumour]).query(middles)[0]
    return [~tumour & (away < reach) for reach in settings.around], 'the tissue around the tumour'
