"""Attack 10: many pictures in a row by one camera."""

from __future__ import annotations

import numpy as np

import _attack_models as models
from _attack_pictures import SequenceTrial, picture, trial_of, view
from windmark.geometry import Pose

FRAMES, PERIOD = 16, (8.0, 20.0)
"""Length of a sequence, and of one swing, in frames."""
DRIFT_DEG, DRIFT = 0.05, 0.0005
"""Of the camera from frame to frame, and as part of its distance."""


def sway(seed: int, *, tip: float, hidden: float = 0.0, false: float = 0.0, jitter: float = 0.08) -> SequenceTrial:
    """A tower of 28 discs in four rows of seven that sways, with a rigid table, before a camera that drifts.

    The lowest row stands still: the pose is judged there.

    Parameters
    ----------
    tip : largest displacement of the uppermost row, as part of the height
    hidden, false : of each frame
    jitter : of the places along the rows, as part of their pitch; 0 is an exact pitch
    """
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(7) * 0.1, np.arange(4) * 0.45, indexing="xy")
    xyz = np.stack([x.ravel(), y.ravel(), np.zeros(28)], axis=1)
    xyz[:, :2] += rng.normal(0, 0.1 * jitter, (28, 2)) if jitter else 0.0
    markers = models.table(xyz, np.tile([0.0, 0.0, 1.0], (28, 1)))
    foot = np.arange(28) < 7
    camera, pose = view(rng, markers, tilt_max_deg=40, least=28)
    height = np.clip(xyz[:, 1] / 1.35, 0, None)
    mode = tip * 1.35 * np.where(foot, 0.0, height**1.5)
    aside, period, phase = rng.normal(size=2), rng.uniform(*PERIOD, 2), rng.uniform(0, 2 * np.pi, 2)
    noise, frames = rng.uniform(0.05, 0.3), []
    for k in range(FRAMES):
        wave = np.sin(2 * np.pi * k / period + phase) * aside / np.linalg.norm(aside)
        real = xyz + np.outer(mode, [wave[0], 0.0, wave[1]])
        shot = picture(rng, models.moved(markers, real), camera, pose, hidden=hidden, false=false, noise_px=noise)
        options = {"prior": pose} if not k else {}
        frames.append(trial_of(shot, markers, real=real, counted=foot, options=options))
        middle = pose.apply(xyz.mean(axis=0))
        drift = Pose.from_rotvec(np.radians(DRIFT_DEG) * rng.normal(size=3), np.zeros(3)).rotation
        step = Pose(drift, middle - drift @ middle + DRIFT * middle[2] * rng.normal(size=3))
        pose = step @ pose
    return SequenceTrial(tuple(frames))
