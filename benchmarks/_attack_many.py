"""Attacks 10 and 12: many pictures at once, in a row by one camera, or at one time by a rig."""

from __future__ import annotations

import numpy as np

import _attack_models as models
from _attack_models import scenes
from _attack_pictures import RigTrial, SequenceTrial, Trial, Truth, picture, trial_of, view
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


def _views(rng: np.random.Generator, seed: int, hidden: float, false: float) -> tuple[list[Trial], list[Pose]]:
    """Three pictures at one time, and where their cameras are in the rig's frame; by either generator of scenes."""
    if rng.random() < 0.5:
        made = scenes.rig_scene(seed, "AB"[seed % 2], 3, hidden=hidden, false=false)
        views = []
        for one in made.views:
            _, seen = scenes.visible(one.markers, one.camera, one.cam_from_model)
            truth = Truth(one.camera, (one.cam_from_model,), one.markers.xyz, one.label, seen)
            views.append(Trial(one.detections, one.markers, one.camera, truth))
        return views, list(made.cam_from_rig)
    markers = models.some(rng, models.SOLID)
    model_from_rig = Pose.from_rotvec(rng.normal(size=3), rng.normal(size=3))
    views, poses = [], []
    for _ in range(3):
        camera, pose = view(rng, markers, least=20)
        views.append(trial_of(picture(rng, markers, camera, pose, hidden=hidden, false=false), markers))
        poses.append(pose @ model_from_rig)
    return views, poses


def rig(seed: int, *, hidden: float = 0.7, false: float = 1.0, displaced: str = "") -> RigTrial:
    """Three cameras; with ``displaced`` one of them is turned by 0.3 to 10 degrees, or shifted by 1 to 10 %."""
    rng = np.random.default_rng(seed)
    views, poses = _views(rng, seed, hidden, false)
    moved, axis = int(rng.integers(3)), rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    if displaced == "turned":
        angle = np.radians(np.exp(rng.uniform(np.log(0.3), np.log(10.0))))
        poses[moved] = Pose.from_rotvec(angle * axis, np.zeros(3)) @ poses[moved]
    elif displaced == "shifted":
        far = np.linalg.norm(views[moved].truth.poses[0].apply(views[moved].markers.xyz.mean(axis=0)))
        poses[moved] = Pose(np.eye(3), axis * far * np.exp(rng.uniform(np.log(0.01), np.log(0.1)))) @ poses[moved]
    return RigTrial(tuple(views), tuple(poses), f"camera {moved}" if displaced else "")
