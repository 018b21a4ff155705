"""Attack 12: pictures at one time by the cameras of a rig; all that can be hard about them, and cameras elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import _attack_models as models
from _attack_models import bent_scenes, scenes
from _attack_pictures import Array, RigTrial, Trial, picture, rigid_fits, seen_by, trial_of, view
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet

Bools = NDArray[np.bool_]
APART_DEG = (20.0, 60.0)
"""Between the directions from which two cameras look."""
FOCAL_OFF, LABELS = 0.1, 2
"""Largest error (relative) of a focal length that is to be found; how many labels of one camera are given."""
THING, THING_FAR = 0.12, 0.3
"""Radius of what hides a part of the model from a camera, and its distance from it, as parts of the model's size."""
TURNS_DEG, SHIFTS = (0.1, 20.0), (0.002, 0.3)
"""Displacements of a camera: about its eye, and along any direction as part of its distance."""


@dataclass(frozen=True)
class Scene:
    """A model and where the cameras that see it are.

    Parameters
    ----------
    real : (N, 3) where its markers are; ``root`` (N,) those that stand still
    """

    markers: MarkerSet
    real: Array
    root: Bools
    cameras: tuple[Camera, ...]
    poses: tuple[Pose, ...]


def _scene(rng: np.random.Generator, seed: int, cameras: int, tip: float) -> Scene:
    """By either generator of scenes; of the registration tests' one models may be bent."""
    if tip or rng.random() < 0.5:
        kind = "AB"[rng.integers(2)]
        made = scenes.rig_scene(seed, kind, cameras)
        markers, real = made.views[0].markers, made.views[0].markers.xyz
        if tip:
            bend = bent_scenes.Bend(rng.choice([-1, 1]) * tip, str(rng.choice(bent_scenes.SHAPES)), rng.integers(2))
            real = bent_scenes.bent_xyz(markers, kind, bend)
        root = (real == markers.xyz).all(axis=1)
        views = made.views
        return Scene(markers, real, root, tuple(v.camera for v in views), tuple(v.cam_from_model for v in views))
    markers = models.some(rng, models.SOLID)
    taken: list[tuple[Camera, Pose]] = []
    while len(taken) < cameras:
        camera, pose = view(rng, markers, least=20)
        if all(_apart(markers, pose, other) for _, other in taken):
            taken.append((camera, pose))
    chosen, poses = zip(*taken, strict=True)
    return Scene(markers, markers.xyz, np.ones(len(markers), bool), chosen, poses)


def _apart(markers: MarkerSet, one: Pose, other: Pose) -> bool:
    a, b = (pose.center - markers.xyz.mean(axis=0) for pose in (one, other))
    low, high = np.cos(np.radians(APART_DEG[::-1]))
    return bool(low < a @ b / (np.linalg.norm(a) * np.linalg.norm(b)) < high)


def _things(rng: np.random.Generator, scene: Scene) -> tuple[Array, float]:
    """(C, 3) middles and the radius of balls beside the model, one before each camera."""
    size = float(np.linalg.norm(np.ptp(scene.markers.xyz, axis=0)))
    aims = scene.markers.xyz[rng.integers(len(scene.markers), size=len(scene.poses))]
    towards = np.array([pose.center for pose in scene.poses]) - aims
    return aims + THING_FAR * size * towards / np.linalg.norm(towards, axis=1)[:, None], THING * size


def _unhidden(xyz: Array, eye: Array, things: Array, radius: float) -> Bools:
    """(N,) the points that no ball hides from an eye."""
    ray = xyz - eye
    along = np.clip(np.einsum("nk,ck->nc", ray, things - eye) / (ray * ray).sum(axis=1)[:, None], 0, 1)
    nearest = eye + along[..., None] * ray[:, None, :]
    return np.asarray((np.linalg.norm(nearest - things, axis=2) > radius).all(axis=1))


def _trial(
    rng: np.random.Generator, scene: Scene, hidden: float, false: float, occlusion: bool
) -> tuple[list[Trial], dict[str, Any]]:
    """Each camera's picture; with ``occlusion`` things hide parts of the model."""
    there, views = models.moved(scene.markers, scene.real), []
    things, radius = _things(rng, scene) if occlusion else (np.zeros((0, 3)), 0.0)
    for camera, pose in zip(scene.cameras, scene.poses, strict=True):
        keep, seen = _unhidden(there.xyz, pose.center, things, radius), seen_by(there, camera, pose)[1]
        # What the things hide is a part of what is hidden.
        beside = max(0.0, 1 - (1 - hidden) * seen.sum() / max((seen & keep).sum(), 1))
        shot = picture(rng, there, camera, pose, keep=keep, hidden=beside, false=false)
        counted, poses = shot.seen, (pose,)
        if not scene.root.all():
            # Of a wing on a body the pose is the body's; of a wing alone it may be any that a rigid one stands for.
            body = scene.root.sum() >= len(scene.root) / 3
            poses = (pose,) if body else rigid_fits(camera, pose, scene.markers.xyz, scene.real, shot.seen)[:2]
            counted = scene.root if body else shot.seen
        views.append(trial_of(shot, scene.markers, real=scene.real, poses=poses, counted=counted))

    def visible(cam_from_model: Pose, camera: Camera) -> Bools:
        return _unhidden(scene.markers.xyz, cam_from_model.center, things, radius)

    return views, {"visible": visible} if occlusion else {}


def rig(
    seed: int, *, cameras: int = 3, hidden: float = 0.7, false: float = 1.0, tip: float = 0.0, free: bool = False,
    labels: bool = False, occlusion: bool = False,
) -> RigTrial:  # fmt: skip
    """A rig as it should be, with any of what is hard.

    Parameters
    ----------
    tip : of bent wings, as part of the span
    free : the focal length of one camera is to be found
    labels : some labels of one camera are given
    occlusion : something hides a part of the model from each camera, and that is known
    """
    rng = np.random.default_rng(seed)
    scene = _scene(rng, seed, cameras, tip)
    views, options = _trial(rng, scene, hidden, false, occlusion)
    if free:
        one = int(rng.integers(cameras))
        options["free_focal"] = [c == one for c in range(cameras)]
        given = views[one].camera
        given = replace(given, focal_px=given.focal_px * (1 + rng.uniform(-FOCAL_OFF, FOCAL_OFF)))
        views[one] = replace(views[one], camera=given)
    if labels:
        one = int(rng.integers(cameras))
        label = views[one].truth.label
        spots = rng.permutation(np.flatnonzero(label >= 0))[:LABELS]
        options["fixed"] = [{int(s): int(label[s]) for s in spots} if c == one else None for c in range(cameras)]
    return RigTrial(tuple(views), _in_rig(rng, scene.poses), "", options)


def displaced(seed: int, *, cameras: int = 3, how: str = "turned", hidden: float = 0.3, false: float = 0.5) -> RigTrial:
    """One camera is turned about its eye (or ``how`` = "shifted") against what the rig says, from hardly to grossly."""
    rng = np.random.default_rng(seed)
    scene = _scene(rng, seed, cameras, 0.0)
    views, options = _trial(rng, scene, hidden, false, occlusion=False)
    poses, moved, axis = list(_in_rig(rng, scene.poses)), int(rng.integers(cameras)), rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    low, high = np.log(TURNS_DEG if how == "turned" else SHIFTS)
    size = float(np.exp(rng.uniform(low, high)))
    if how == "turned":
        poses[moved] = Pose.from_rotvec(np.radians(size) * axis, np.zeros(3)) @ poses[moved]
    else:
        distance = np.linalg.norm(scene.poses[moved].apply(scene.markers.xyz.mean(axis=0)))
        poses[moved] = Pose(np.eye(3), axis * distance * size) @ poses[moved]
    return RigTrial(tuple(views), tuple(poses), f"camera {moved}", options)


def exchanged(seed: int, *, cameras: int = 3, hidden: float = 0.3, false: float = 0.5) -> RigTrial:
    """Two cameras' places in the rig are exchanged, as two folders of pictures are."""
    rng = np.random.default_rng(seed)
    scene = _scene(rng, seed, cameras, 0.0)
    views, options = _trial(rng, scene, hidden, false, occlusion=False)
    poses = list(_in_rig(rng, scene.poses))
    one, other = rng.permutation(cameras)[:2].tolist()
    poses[one], poses[other] = poses[other], poses[one]
    return RigTrial(tuple(views), tuple(poses), "exchanged", options)


def _in_rig(rng: np.random.Generator, poses: tuple[Pose, ...]) -> tuple[Pose, ...]:
    model_from_rig = Pose.from_rotvec(rng.normal(size=3), rng.normal(size=3))
    return tuple(pose @ model_from_rig for pose in poses)
