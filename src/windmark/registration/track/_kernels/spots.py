"""The spots of one frame as the settle wants them, as numba kernels; twin: tests/registration/test_track_kernels.py."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.registration._kernels.near import nearest_kernel
from windmark.registration.settle._kernels.state import Sights

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

NEIGHBOURS = 4
"""The density of spots is taken from so many neighbours, as in the search (`search.plane`)."""
LEAST_TOLERANCE, TOLERANCE, SPACING = 0.5, 0.004, 0.2
"""Neighbourhood in pixels, as part of the image's diagonal and of the spots' spacing, as in `register`."""
FIXED = 3
"""Pairs that determine a pose."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def sights_of(
    xyz: Array, normal: Array, near: Ints, sigma: Array, camera: Array, loose: Array, size: Array, xy: Array,
    cov: Array, radius: Array, given_tolerance: float, rough: float, least_density: float,
) -> Sights:  # fmt: skip
    """One camera's sight of rigid markers; its spots are (M, 2), with (M, 2, 2) covariance, of (M,) radius.

    A ``given_tolerance`` of 0 takes the usual one, for a table with so much `roughness`.
    """
    m = xy.shape[0]
    by_x, average = np.argsort(xy[:, 0], kind="mergesort"), max(m / (size[0] * size[1]), least_density)
    distance, density, packed = nearest_kernel(xy, min(NEIGHBOURS, m - 1))[1], np.empty(m), np.empty((m, 3))
    k = distance.shape[1]
    for s in range(m):
        density[s] = max(average, k / (math.pi * max(distance[s, k - 1], 1e-3) ** 2))
        packed[s, 0], packed[s, 1], packed[s, 2] = cov[s, 0, 0], cov[s, 0, 1], cov[s, 1, 1]
    tolerance = given_tolerance
    if not tolerance > 0.0:
        wanted = TOLERANCE * math.hypot(size[0], size[1])
        if rough > 0.0:
            wanted = max(wanted, rough * np.median(distance[:, k - 1]))
        tolerance = max(LEAST_TOLERANCE, min(wanted, SPACING * np.median(distance[:, 0])))
    known = radius[np.isfinite(radius)]
    return Sights(
        xyz, normal, near, sigma, np.zeros((0, xyz.shape[0], 3)), np.eye(3).reshape(1, 3, 3), np.zeros((1, 3)),
        np.array([0, m]), xy, packed, density, np.array([[m]]), density.reshape(1, m), np.zeros((1, 1)),
        np.array([FIXED]), by_x, xy[by_x, 0], size.reshape(1, 2),
        np.array([np.median(known) if known.size else 0.0]), np.array([tolerance]),
        camera.reshape(1, camera.size), loose,
    )  # fmt: skip
