"""Attacks 7 and 11: the model in the picture more than once, and hardly there at all."""

from __future__ import annotations

import numpy as np

import _attack_models as models
from _attack_pictures import Array, Bools, Picture, Trial, picture, seen_by, trial_of, view
from windmark.geometry import Pose

NOISE_PX = 0.2
"""1 sigma of all spots."""
LEAST_LEFT = 5
"""So many markers of the model are left in view at least, before it is thinned."""
THINNED = (0.0, 0.1)
"""Part of the copy, and of the model, that is hidden at random."""
SAYS = ("copy", "second copy")


def _half(rng: np.random.Generator, xy: Array, hidden: bool) -> Bools:
    """(N,) bool: all of it, or the half on one side of the picture."""
    across = xy @ rng.normal(size=2)
    return np.asarray(across > np.median(across)) if hidden else np.ones(len(xy), dtype=bool)


def _scene(seed: int) -> tuple[np.random.Generator, models.MarkerSet, Picture]:
    """A model before a camera; what is hidden of it is not yet."""
    rng = np.random.default_rng(seed)
    markers = models.some(rng, models.SOLID + models.FLAT)
    camera, pose = view(rng, markers, least=16)
    return rng, markers, picture(rng, markers, camera, pose, noise_px=NOISE_PX, honest=True)


def _with(rng: np.random.Generator, markers: models.MarkerSet, shot: Picture, copy: Array, hidden: bool) -> Trial:
    """The picture with the spots of a copy in it, half of the true ones hidden or none; either may lack some.

    Where hardly a marker of the half that is left is in view it is the other one: the model must be there.
    """
    xy, seen = seen_by(markers, shot.camera, shot.pose)
    keep = _half(rng, xy, hidden)
    if (keep & seen).sum() < LEAST_LEFT:
        keep = ~keep
    copy = copy[rng.random(len(copy)) >= rng.choice(THINNED)]
    made = picture(rng, markers, shot.camera, shot.pose, keep=keep, hidden=rng.choice(THINNED),
                   false=rng.choice([0.0, 0.3]), extra=copy, noise_px=NOISE_PX)  # fmt: skip
    return trial_of(made, markers, unseen=SAYS)


def reflection(seed: int, *, hidden: bool = False) -> Trial:
    """The model's mirror image beside it or over it, as in a window or a polished wall."""
    rng, markers, shot = _scene(seed)
    xy, seen = seen_by(markers, shot.camera, shot.pose)
    turn = rng.uniform(0, np.pi)
    axis = np.array([np.cos(turn), np.sin(turn)])
    centre = xy[seen].mean(axis=0)
    copy = xy[seen] - 2 * np.outer((xy[seen] - centre) @ axis, axis)
    copy += axis * rng.uniform(-1, 1) * np.ptp(xy[seen] @ axis)
    return _with(rng, markers, shot, copy, hidden)


def ghost(seed: int, *, hidden: bool = False) -> Trial:
    """The same spots once more, 5 to 100 px away: a double exposure, or a second surface of a window."""
    rng, markers, shot = _scene(seed)
    xy, seen = seen_by(markers, shot.camera, shot.pose)
    turn, far = rng.uniform(0, 2 * np.pi), np.exp(rng.uniform(np.log(5), np.log(100)))
    return _with(rng, markers, shot, xy[seen] + far * np.array([np.cos(turn), np.sin(turn)]), hidden)


def second_model(seed: int, *, hidden: bool = False, part: float = 1.0) -> Trial:
    """Another model of the same table in view, elsewhere and turned; so large a part of it, in one piece."""
    rng, markers, shot = _scene(seed)
    xy = np.full((len(markers), 2), np.nan)
    seen = np.zeros(len(markers), dtype=bool)
    for _ in range(40):
        axis = rng.normal(size=3)
        turn = Pose.from_rotvec(axis / np.linalg.norm(axis) * np.radians(rng.uniform(3, 40)), np.zeros(3)).rotation
        centre = markers.xyz.mean(axis=0)
        place = shot.pose.apply(centre) * rng.uniform(0.8, 1.3)
        aside = rng.uniform(-0.4, 0.4, 2) * shot.camera.size_px * place[2] / shot.camera.focal_px
        rotation = shot.pose.rotation @ turn
        other = Pose(rotation, place + np.append(aside, 0.0) - rotation @ centre)
        xy, seen = seen_by(markers, shot.camera, other)
        if seen.sum() > 0.7 * shot.seen.sum():
            break
    across = xy[seen] @ rng.normal(size=2)
    return _with(rng, markers, shot, xy[seen][across >= np.quantile(across, 1 - part)], hidden)


# --- 11: sparse but right ---------------------------------------------------------------------


def sparse(seed: int, *, count: int, kind: str) -> Trial:
    """So many spots of a wing (24 markers) or of wing and body (60), no false one; these must be accepted."""
    rng = np.random.default_rng(seed)
    markers = models.scenes.wing(rng) if kind == "A" else models.scenes.wing_and_body(rng)
    camera, pose = view(rng, markers, least=2 * count)
    seen = rng.permutation(np.flatnonzero(seen_by(markers, camera, pose)[1]))
    keep = np.isin(np.arange(len(markers)), seen[:count])
    return trial_of(picture(rng, markers, camera, pose, keep=keep, honest=True), markers, must=True)


def wall(seed: int) -> Trial:
    """Four markers of a wall, all in view, no false spot, and the exact pose as a prior."""
    rng = np.random.default_rng(seed)
    flat = models.scattered(rng, 4, (2.0, 1.5))
    markers = models.table(np.column_stack([flat, np.zeros(4)]), np.tile([0.0, 0.0, 1.0], (4, 1)))
    camera, pose = view(rng, markers, least=4)
    shot = picture(rng, markers, camera, pose, honest=True)
    exact = {"prior": pose, "prior_max_angle_deg": 3.0, "prior_max_scale": 1.05}
    return trial_of(shot, markers, must=True, options=exact)
