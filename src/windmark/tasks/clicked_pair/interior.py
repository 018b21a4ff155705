"""What the cameras' interior parameters do to the pose that matches of two pictures give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g1
from windmark.geometry import PARAMETERS, Camera, Pose
from windmark.geometry.two_view import epipolar_distance

Array = NDArray[np.float64]
Cameras = tuple[Camera, Camera]

TURN, PART = 1e-6, 0.1
"""Steps of the numerical slopes: of the pose (the baseline being 1), and of the interior in its sigmas."""


class PoseFit:
    """What matches (K, 2), (K, 2) of two pictures leave of their pose, to first order, all weighing the same.

    The length of the baseline moves nothing: five directions of the six.
    """

    def __init__(self, a: Array, b: Array, cameras: Cameras, pose: Pose) -> None:
        self._distance = lambda first, second, at: epipolar_distance(a, b, first, second, at).sampson_px
        self.cameras, self.pose = cameras, pose
        self.distance: Array = self._distance(*cameras, pose)  # (K,) from the epipolar lines, px
        there = [self._distance(*cameras, Pose.exp(TURN * d) @ pose) for d in np.eye(6)]
        slopes = (np.stack(there, axis=1) - self.distance[:, None]) / TURN
        self._size = np.linalg.norm(slopes, axis=0)
        self._slopes = slopes / self._size
        self._left, self._value, self._right = np.linalg.svd(self._slopes, full_matrices=False)

    def moved(self, which: Sequence[int], sigmas: Mapping[str, float]) -> Array:
        """(K, P) what one sigma of each parameter of the cameras ``which`` adds to the distances."""
        columns = []
        for name, sigma in sigmas.items():
            other = [replace(c, **{name: getattr(c, name) + PART * sigma}) if k in which else c
                     for k, c in enumerate(self.cameras)]  # fmt: skip
            columns.append((self._distance(other[0], other[1], self.pose) - self.distance) / PART)
        return np.stack(columns, axis=1)

    def step(self, changes: Array) -> Array:
        """(6, ...) the pose's steps with which the matches fit again after changes (K, ...) of the distances."""
        along = (self._left[:, :5].T @ changes).T / self._value[:5]
        return np.asarray(-((along @ self._right[:5]) / self._size).T)

    def left(self, changes: Array) -> Array:
        """(K - 5, ...) what no step of the pose makes up for."""
        return np.asarray(self._rest.T @ changes)

    @cached_property
    def _rest(self) -> Array:
        """(K, K - 5) directions of the distances that no step has: large, and asked for by the verdict alone."""
        return np.asarray(np.linalg.svd(self._slopes)[0][:, 5:])


def groups(cameras: Cameras) -> tuple[tuple[int, ...], ...]:
    """The pictures of each camera: both of one, or one of each of two."""
    first, second = cameras
    one = first is second or ((first.lens, first.size_px) == (second.lens, second.size_px)
                              and np.array_equal(first.parameters(), second.parameters()))  # fmt: skip
    return ((0, 1),) if one else ((0,), (1,))


def share(fit: PoseFit) -> Array:
    """(6, 6) what `Camera.cov` adds to the covariance of the pose; zero where no camera has one."""
    total = np.zeros((6, 6))
    for which in groups(fit.cameras):
        cov = fit.cameras[which[0]].cov
        sigma = np.zeros(len(PARAMETERS)) if cov is None else np.sqrt(np.diag(cov))
        if cov is None or not (named := np.flatnonzero(sigma > 0)).size:
            continue
        step = fit.step(fit.moved(which, {PARAMETERS[k]: float(sigma[k]) for k in named}))
        total += step @ (cov[np.ix_(named, named)] / np.outer(sigma[named], sigma[named])) @ step.T
    return total


def unknown_words(fit: PoseFit) -> str:
    """What cameras without a covariance may do to the pose; empty where all have one."""
    steps = [
        fit.step(fit.moved(which, {"focal_px": 0.01 * fit.cameras[which[0]].focal_px, "aspect": 0.01}))[:3]
        for which in groups(fit.cameras) if fit.cameras[which[0]].cov is None
    ]  # fmt: skip
    if not steps:
        return ""
    focal, aspect = np.degrees(np.sqrt((np.array(steps) ** 2).sum(axis=(0, 1)))).tolist()
    return (
        "the camera has no covariance, so that of the pose takes it as exact: a focal length 1 % off turns the second "
        f"camera by {g1(focal)} deg, an aspect 1 % off by {g1(aspect)} deg, and the matches may fit as well"
    )
