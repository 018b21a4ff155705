"""Attacks 6, 8 and 9: a camera that is not as stated, one that is uncertain, and a model that is bent."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import _attack_models as models
from _attack_models import bent_scenes
from _attack_pictures import Trial, bent, clutter_of, picture, rigid_fits, trial_of, view
from windmark.geometry import PARAMETERS, Camera
from windmark.scene import MarkerSet

NAMES = {
    "focal": ("focal length", "scale"),
    "principal": ("principal point",),
    "lens": ("lens",),
    "aspect": ("aspect",),
}
"""Fault of the camera -> what a result says that owns up to it."""
KINDS = {"solid": models.SOLID, "flat": models.FLAT, "deep field": (models.field,)}
"""Models before a camera with a fault."""
FOCAL_OFF = (0.02, 0.05, 0.1, 0.2)
WIDE_DEG = (30.0, 75.0)
"""Fields of view in which a lens with k1 = -0.15 can be seen."""


def misstated(rng: np.random.Generator, true: Camera, fault: str) -> tuple[Camera, Camera]:
    """The camera that takes the picture and the one that is given, which has the fault."""
    if fault == "focal":
        off = rng.choice(FOCAL_OFF) * rng.choice([-1, 1])
        return true, replace(true, focal_px=true.focal_px * (1 + off))
    if fault == "principal":
        turn, far = rng.uniform(0, 2 * np.pi), rng.uniform(50, 300)
        return true, replace(true, cx=true.cx + far * np.cos(turn), cy=true.cy + far * np.sin(turn))
    if fault == "lens":
        return replace(true, k1=true.k1 - 0.15), true
    return true, replace(true, aspect=true.aspect * (1 + 0.02 * rng.choice([-1, 1])))


def wrong_camera(seed: int, *, fault: str, kind: str, rigid: bool) -> Trial:
    """A model before a camera that is not as stated; what the picture cannot show must be said."""
    rng = np.random.default_rng(seed)
    markers = models.some(rng, KINDS[kind])
    true, pose = view(rng, markers, fov_deg=WIDE_DEG if fault == "lens" else None)
    taken, given = misstated(rng, true, fault)
    shot = picture(rng, markers, taken, pose, **clutter_of(rng))
    options: dict[str, Any] = {"max_deformation": 0.0} if rigid else {}
    return trial_of(shot, markers, camera=given, unseen=NAMES[fault], options=options)


def uncertain(seed: int, *, table_sigma: float = 0.0, tip: float = 0.0) -> Trial:
    """A camera known to 1 px and 0.2 %, and it says so; also with errors of the table, or a bent model.

    Parameters
    ----------
    table_sigma : errors of the table, stated, as part of the model's size
    tip : of bent wings beside a body (kind B), as part of the span
    """
    rng = np.random.default_rng(seed)
    markers = models.scenes.wing_and_body(rng) if tip else models.some(rng, models.SOLID)
    true, pose = view(rng, markers, least=16)
    sigma = np.zeros(len(PARAMETERS))
    sigma[:] = [{"focal_px": 0.002 * true.focal_px, "cx": 1.0, "cy": 1.0}.get(name, 0.0) for name in PARAMETERS]
    stated = true.with_parameters(true.parameters() + rng.normal(0, 1, len(sigma)) * sigma, np.diag(sigma**2))
    size = table_sigma * float(np.linalg.norm(np.ptp(markers.xyz, axis=0)))
    real, counted = markers.xyz, np.ones(len(markers), dtype=bool)
    if tip:
        real = bent_scenes.bent_xyz(markers, "B", bent_scenes.Bend(rng.choice([-1, 1]) * tip))
        counted = (real == markers.xyz).all(axis=1)
    shot = picture(rng, models.moved(markers, real), true, pose, hidden=rng.choice([0.0, 0.3]), honest=True)
    given = markers
    if size:
        given = MarkerSet.make(
            markers.name, markers.xyz + rng.normal(0, size, markers.xyz.shape), normal=markers.normal, sigma=size
        )
    return trial_of(shot, given, real=real, camera=stated, counted=counted)


def bent_body(seed: int, *, tip: float, rigid: bool = False) -> Trial:
    """Bent wings on a body (or a tower on its foot) that stands still; the pose is that of what stands still."""
    rng = np.random.default_rng(seed)
    if rng.random() < 0.5:
        markers = models.scenes.wing_and_body(rng)
        wings = str(rng.choice(["both", "right"]))
        shape = str(rng.choice(bent_scenes.SHAPES))
        bend = bent_scenes.Bend(rng.choice([-1, 1]) * tip, shape, float(rng.integers(2)), wings)
        real = bent_scenes.bent_xyz(markers, "B", bend)
    else:
        markers = models.building(rng)
        real, _ = bent(markers.xyz, rng.choice([-1, 1]) * tip, root=0.25)
    counted = np.linalg.norm(real - markers.xyz, axis=1) < 1e-9
    camera, pose = view(rng, markers, least=16)
    shot = picture(rng, models.moved(markers, real), camera, pose, **clutter_of(rng))
    options: dict[str, Any] = {"max_deformation": 0.0} if rigid else {}
    return trial_of(shot, markers, real=real, counted=counted, unseen=("deformation", "bending"), options=options)


def bent_wing(seed: int, *, tip: float, rigid: bool = False) -> Trial:
    """A bent wing alone: the pose may be that of its root, of least squares in space, or in the picture."""
    rng = np.random.default_rng(seed)
    markers = models.some(rng, models.FLAT)
    bend = bent_scenes.Bend(rng.choice([-1, 1]) * tip, str(rng.choice(bent_scenes.SHAPES)), float(rng.integers(2)))
    real = bent_scenes.bent_xyz(markers, "A", bend)
    camera, pose = view(rng, markers, least=16)
    shot = picture(rng, models.moved(markers, real), camera, pose, **clutter_of(rng))
    poses = rigid_fits(camera, pose, markers.xyz, real, shot.seen)
    options: dict[str, Any] = {"max_deformation": 0.0} if rigid else {}
    return trial_of(shot, markers, real=real, poses=poses, unseen=("deformation", "bending"), options=options)
