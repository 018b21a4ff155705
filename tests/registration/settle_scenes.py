"""Starts for the settle: what cameras saw, and labels and a pose near the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import registration_scenes as scenes

from windmark.geometry import Camera, Pose
from windmark.registration.search.layout import Layout
from windmark.registration.search.plane import Plane
from windmark.registration.settle._kernels.settle import fit_kernel
from windmark.registration.settle._kernels.state import EXCESS
from windmark.registration.settle.settling import copied, settle
from windmark.registration.settle.solution import Solution
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


def of_wrong_lens(seed, k1=0.03):
    """A picture whose lens is not the given one: residuals that are smooth over the image, taken by the excess."""
    rng = np.random.default_rng(seed)
    markers = scenes.wing_and_body(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(45, 50), tilt_max_deg=20)
    true = Camera(camera.size_px, camera.focal_px, k1=k1)
    scene = scenes.image_of(rng, markers, true, pose, noise_px=0.1)
    return scenes.Scene(scene.detections, markers, camera, pose, scene.label)


def of_rough_table(seed, sigma=0.002):
    """A picture of a model whose markers are not quite where the table says: residuals that are random."""
    rng = np.random.default_rng(seed)
    markers = scenes.wing_and_body(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(45, 50), tilt_max_deg=20)
    off = scenes.MarkerSet.make(
        markers.name, markers.xyz + rng.normal(0, sigma, markers.xyz.shape), normal=markers.normal
    )
    scene = scenes.image_of(rng, off, camera, pose, noise_px=0.1)
    return scenes.Scene(scene.detections, markers, camera, pose, scene.label)


def of_both(seed):
    """A rough table under a lens that is not the given one: residuals of both kinds."""
    scene = of_rough_table(seed)
    true = Camera(scene.camera.size_px, scene.camera.focal_px, k1=0.015)
    seen = true.project(scene.camera.unproject(scene.detections.xy))[0]
    return replace(scene, detections=Detections.make(seen, sigma_px=0.1))


def with_all_labels(scene):
    """The true labels with the excess of their residuals, whatever the gates would say."""
    views = views_of(scene)
    state = settled(views, scene).state
    state = copied(views, state)
    state.match[:] = labels_of(scene)
    state.numbers[0, EXCESS] = 1.0
    assert fit_kernel(views.sights, state)
    return Solution(views, state)


def unlike_rig(seed, **more):
    """Two unlike cameras: one is curved and may be wrong as its covariance says, both have a free focal length."""
    rig = scenes.rig_scene(seed, "B", 2, hidden=0.3, false=0.5)
    plain = rig.views[0]
    camera = Camera(plain.camera.size_px, plain.camera.focal_px, aspect=1.03, k1=-0.1, p1=1e-3, cov=camera_cov())
    pose = plain.cam_from_model
    true, shown = plain.label >= 0, scenes.visible(plain.markers, camera, pose)[0]
    xy = plain.detections.xy.copy()
    xy[true] += shown[plain.label[true]] - scenes.visible(plain.markers, plain.camera, pose)[0][plain.label[true]]
    first = scenes.Scene(Detections.make(xy, cov=plain.detections.cov), plain.markers, camera, pose, plain.label)
    rig = scenes.RigScene((first, rig.views[1]), rig.cam_from_rig, rig.rig_from_model)
    return rig, views_of_rig(rig, each=({}, {"focal_factors": FREE}), **more)


def camera_cov():
    """(11, 11) of principal point, k1 and tangential distortion, the first two correlated."""
    cov = np.diag([0.0, 1e-6, 9.0, 4.0, 1e-4, 0.0, 1e-8, 0.0, 0.0, 0.0, 0.0])
    cov[2, 3] = cov[3, 2] = 3.0
    return cov


def wide_scene(seed, given=None, noise_px=0.1):
    """A model with depth that fills a wide picture, all of it seen; ``given`` changes the camera that is believed."""
    rng = np.random.default_rng(seed)
    markers = scenes.wing_and_body(rng)
    markers = replace(markers, normal=np.full_like(markers.xyz, np.nan))
    camera = Camera((1280, 1000), 900.0)
    middle = markers.xyz.mean(axis=0)
    pose = Pose.look_at(middle + 1.9 * np.array([0.5, -0.2, 0.8]), middle, rng.normal(size=3))
    scene = scenes.image_of(
        rng, replace(markers, normal=-pose.rotation[2] + 0 * markers.xyz), camera, pose, noise_px=noise_px
    )
    return scenes.Scene(scene.detections, markers, given or camera, pose, scene.label)


def best_of(scene, **more):
    """Views of a scene, and its true solution."""
    views = views_of(scene, **more)
    return views, settled(views, scene)
