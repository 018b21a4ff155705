"""Starts for the settle: what cameras saw, and labels and a pose near the truth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import registration_scenes as scenes

from windmark.geometry import Camera, Pose
from windmark.registration.search.layout import Layout
from windmark.registration.search.plane import Plane
from windmark.registration.settle.solution import Solution, settle
from windmark.registration.settle.views import Views
from windmark.registration.task import Task
from windmark.scene import Detections

NEAR = Pose.from_rotvec([0.002, -0.001, 0.002], [0.0, 0.0, 0.0])
"""How far off the truth a start is."""
FREE = (0.6, 1.0, 1.6)
"""Factors of a free focal length."""


def curved_scene(seed: int, **options: float) -> scenes.Scene:
    """A wing and body under a curved lens with oblong pixels; every spot with noise of its own covariance."""
    rng = np.random.default_rng(seed)
    markers = scenes.wing_and_body(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(40, 50))
    camera = Camera(camera.size_px, camera.focal_px, aspect=1.05, k1=-0.1, p1=1e-3)
    scene = scenes.image_of(rng, markers, camera, pose, noise_px=0.0, **options)
    root = rng.normal(0, 0.05, (len(scene.detections), 2, 2)) + 0.2 * np.eye(2)
    noise = (root @ rng.normal(size=(len(root), 2, 1)))[..., 0]
    detections = Detections.make(scene.detections.xy + noise, cov=root @ np.swapaxes(root, 1, 2))
    return scenes.Scene(detections, markers, camera, pose, scene.label)


def task_of(scene: scenes.Scene, **more: object) -> Task:
    return Task(scene.markers, scene.camera, scene.detections.xy, scene.detections.cov, 6.0, **more)


def views_of(*views: scenes.Scene, cam_from_rig: tuple[Pose, ...] | None = None, each: tuple[dict, ...] = (), **more):
    """What some cameras saw; ``each`` are the options of each camera's task, ``more`` those of all."""
    layout = Layout(views[0].markers)
    own = each or ({},) * len(views)
    return Views.of([Plane(task_of(v, **more, **o), layout) for v, o in zip(views, own, strict=True)], cam_from_rig)


def views_of_rig(rig: scenes.RigScene, each: tuple[dict, ...] = (), **more) -> Views:
    return views_of(*rig.views, cam_from_rig=rig.cam_from_rig, each=each, **more)


def labels_of(*views: scenes.Scene, keep: Callable[[int, int], bool] = lambda c, m: True) -> np.ndarray:
    """(C, N) the true spots of some markers."""
    match = np.full((len(views), len(views[0].markers)), -1, np.int32)
    for c, view in enumerate(views):
        for spot, marker in enumerate(view.label):
            if marker >= 0 and keep(c, marker):
                match[c, marker] = spot
    return match


def settled(views: Views, seen: scenes.Scene | scenes.RigScene, match: np.ndarray | None = None, **more):
    """From the true pose, a little off, with the true labels or those that are given."""
    rig = isinstance(seen, scenes.RigScene)
    pose = seen.rig_from_model @ NEAR if rig else NEAR @ seen.cam_from_model
    labels = labels_of(*(seen.views if rig else (seen,))) if match is None else match
    return settle(views, *views.layout.frame.unit(pose), labels, **more)


def solution_of(seed: int, **more: object) -> tuple[scenes.Scene, Solution]:
    """A curved scene, settled."""
    scene = curved_scene(seed)
    return scene, settled(views_of(scene, **more), scene)


def bent_views(views: Views, most: float = 0.015) -> Views:
    """With a model whose markers are displaced by so much (1 sigma, as part of its size)."""
    layout = views.layout
    return views.bent(most * layout.size * layout.modes)
