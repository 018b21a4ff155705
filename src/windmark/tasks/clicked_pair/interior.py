"""What the cameras' interior parameters do to the pose that matches of two pictures give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g1
from windmark.geometry import PARAMETERS, Camera, Pose
from windmark.geometry.two_view import epipolar_distance

Array = NDArray[np.float64]
Cameras = tuple[Camera, Camera]

TURN, PART = 1e-6, 0.1
"""Steps of the numerical slopes: of the pose (the baseline being 1), and of the interior in its sigmas."""


def distances(a: Array, b: Array, cameras: Cameras, pose: Pose) -> tuple[Array, Array]:
    """Distances of matches (K, 2), (K, 2) from their epipolar lines (K,) in px, and their slopes by the pose (K, 6)."""
    here = epipolar_distance(a, b, *cameras, pose).sampson_px
    there = [epipolar_distance(a, b, *cameras, Pose.exp(TURN * d) @ pose).sampson_px for d in np.eye(6)]
    return here, (np.stack(there, axis=1) - here[:, None]) / TURN


def moved(
    a: Array, b: Array, cameras: Cameras, pose: Pose, which: Sequence[int], sigmas: Mapping[str, float]
) -> Array:  # fmt: skip
    """(K, P) what one sigma of each parameter of the cameras ``which`` adds to the distances."""
    here, columns = epipolar_distance(a, b, *cameras, pose).sampson_px, []
    for name, sigma in sigmas.items():
        other = [replace(c, **{name: getattr(c, name) + PART * sigma}) if k in which else c
                 for k, c in enumerate(cameras)]  # fmt: skip
        columns.append((epipolar_distance(a, b, other[0], other[1], pose).sampson_px - here) / PART)
    return np.stack(columns, axis=1)


def groups(cameras: Cameras) -> tuple[tuple[int, ...], ...]:
    """The pictures of each camera: both of one, or one of each of two."""
    first, second = cameras
    one = first is second or ((first.lens, first.size_px) == (second.lens, second.size_px)
                              and np.array_equal(first.parameters(), second.parameters()))  # fmt: skip
    return ((0, 1),) if one else ((0,), (1,))


def share(a: Array, b: Array, cameras: Cameras, pose: Pose) -> Array:
    """(6, 6) what `Camera.cov` adds to the covariance of the pose of matches (K, 2), (K, 2); zero where there is none.

    To first order, all matches weighing the same. The length of the baseline moves nothing and has no variance.
    """
    total = np.zeros((6, 6))
    for which in groups(cameras):
        cov = cameras[which[0]].cov
        sigma = np.zeros(len(PARAMETERS)) if cov is None else np.sqrt(np.diag(cov))
        if cov is None or not (named := np.flatnonzero(sigma > 0)).size:
            continue
        step = _made_up(a, b, cameras, pose, which, {PARAMETERS[k]: float(sigma[k]) for k in named})
        total += step @ (cov[np.ix_(named, named)] / np.outer(sigma[named], sigma[named])) @ step.T
    return total


def unknown_words(a: Array, b: Array, cameras: Cameras, pose: Pose) -> str:
    """What cameras without a covariance may do to the pose; empty where all have one."""
    blind = [which for which in groups(cameras) if cameras[which[0]].cov is None]
    if not blind:
        return ""
    turned = []
    for name, of_all in (("focal_px", cameras[blind[0][0]].focal_px), ("aspect", 1.0)):
        steps = [_made_up(a, b, cameras, pose, which, {name: 0.01 * of_all})[:3] for which in blind]
        turned.append(float(np.degrees(np.sqrt(sum((step**2).sum() for step in steps)))))
    return (
        "the camera has no covariance, so that of the pose takes it as exact: a focal length 1 % off turns the second "
        f"camera by {g1(turned[0])} deg, an aspect 1 % off by {g1(turned[1])} deg, and the matches may fit as well"
    )


def _made_up(
    a: Array, b: Array, cameras: Cameras, pose: Pose, which: Sequence[int], sigmas: Mapping[str, float]
) -> Array:  # fmt: skip
    """(6, P) the step of the pose with which the matches fit again when a parameter is changed by its sigma."""
    slopes = distances(a, b, cameras, pose)[1]
    size = np.linalg.norm(slopes, axis=0)
    left, value, right = np.linalg.svd(slopes / size, full_matrices=False)
    columns = moved(a, b, cameras, pose, which, sigmas)
    return np.asarray(-(right[:5].T @ ((left[:, :5].T @ columns) / value[:5, None])) / size[:, None])
