"""Two faults at once, drawn from all that can be put on one picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import _attack_cameras as cameras
import _attack_models as models
from _attack_pictures import Array, Trial, bent, near, picture, rigid_fits, seen_by, trial_of, view
from windmark.scene import MarkerSet

FAULTS = ("regular", "half hidden", "camera", "ghost", "bent", "table", "clutter", "no normals")


@dataclass
class _Picture:
    """How one picture is taken, and what is given of it."""

    markers: MarkerSet
    false: float = 0.0
    tip: float = 0.0
    table_error: float = 0.0
    unseen: tuple[str, ...] = ()
    camera_fault: str = ""
    ghost_px: float = 0.0
    half: bool = False
    normals: bool = True


def two(seed: int, *, prior: bool = False) -> Trial:
    """A picture with two of the faults; with ``prior`` a pose within 10 degrees is known."""
    rng = np.random.default_rng(seed)
    chosen = [FAULTS[k] for k in rng.permutation(len(FAULTS))[:2]]
    if "regular" in chosen:
        markers = models.grid(int(rng.integers(5, 10)), int(rng.integers(4, 7)))
    else:
        markers = models.some(rng, models.SOLID + models.FLAT)
    made = _Picture(markers)
    made.half, made.normals = "half hidden" in chosen, "no normals" not in chosen
    made.ghost_px = float(np.exp(rng.uniform(np.log(5), np.log(100)))) if "ghost" in chosen else 0.0
    made.tip = rng.choice([-1, 1]) * rng.uniform(0.01, 0.04) if "bent" in chosen else 0.0
    made.table_error = rng.uniform(0.0005, 0.003) if "table" in chosen else 0.0
    made.false = 1.0 if "clutter" in chosen else 0.0
    if "camera" in chosen:
        made.camera_fault = str(rng.choice(list(cameras.NAMES)))
        made.unseen = cameras.NAMES[made.camera_fault]
    return _taken(rng, made, prior)


def _taken(rng: np.random.Generator, made: _Picture, prior: bool) -> Trial:
    """The picture with its faults. Errors of a table are stated at half their size."""
    markers = made.markers
    true, pose = view(rng, markers, least=16)
    taken, given = cameras.misstated(rng, true, made.camera_fault) if made.camera_fault else (true, true)
    real = bent(markers.xyz, made.tip)[0] if made.tip else markers.xyz
    there = models.moved(markers, real)
    xy, seen = seen_by(there, taken, pose)
    across = xy @ rng.normal(size=2)
    keep = np.where(seen, across > np.median(across[seen]), False) if made.half else None
    ghost: Array | None = None
    if made.ghost_px:
        turn = rng.uniform(0, 2 * np.pi)
        ghost = xy[seen] + made.ghost_px * np.array([np.cos(turn), np.sin(turn)])
    shot = picture(rng, there, taken, pose, keep=keep, false=made.false, extra=ghost)
    poses = rigid_fits(taken, pose, markers.xyz, real, shot.seen) if made.tip else (pose,)
    sigma = made.table_error * float(np.linalg.norm(np.ptp(markers.xyz, axis=0)))
    table = MarkerSet.make(
        markers.name, markers.xyz + rng.normal(0, 1, markers.xyz.shape) * sigma, normal=markers.normal,
        sigma=0.5 * sigma if sigma else None,
    )  # fmt: skip
    table = table if made.normals else models.without_normals(table)
    options = {"prior": near(rng, pose, markers.xyz, 10.0, 0.1)} if prior else {}
    return trial_of(shot, table, real=real, camera=given, poses=poses, unseen=made.unseen, options=options)
