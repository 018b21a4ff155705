"""Weighted least squares of pose and deformation together, in the search plane.

The deformation's coefficients have a unit normal prior: a mode that this view cannot see stays where it is, with its
full uncertainty, and few labelled markers do not make it wild. The normal equations give the covariance of any
projection, of labelled markers and of others: the gate in which a marker must be looked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve

from windmark.geometry.rotations import exp_so3

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

STEPS = 12
"""Most Gauss-Newton steps of a fit."""
AT_REST = 1e-4
"""Expected decrease of twice the cost at which a fit is done: a hundredth of a sigma."""


@dataclass(frozen=True)
class Setting:
    """What does not change during a registration.

    Parameters
    ----------
    xyz, sigma : (N, 3) markers of the unit model and their 1 sigma, 0 where unknown
    modes : (K, N, 3) displacements by 1 sigma of the prior
    focal_start, focal_weight : centre and 1 / variance of the prior of the logarithm of the focal length; a weight of
        0 means that it is known
    """

    xyz: Array
    sigma: Array
    modes: Array
    focal_start: float
    focal_weight: float

    @property
    def pose_size(self) -> int:
        """Parameters before the coefficients: rotation, translation, logarithm of a free focal length."""
        return 7 if self.focal_weight > 0 else 6


@dataclass
class Bent:
    """A deformed model in front of the camera, changed in place.

    Parameters
    ----------
    rotation, translation, focal : pose of the unit model and focal length in px
    q : (K,) coefficients of the modes
    factor : (P, P) lower Cholesky factor of the normal equations [rotation, translation, (log focal), q]
    steps, cost_start, cost : Gauss-Newton steps so far, and half the weighted squares of the last fit
    """

    rotation: Array
    translation: Array
    focal: float
    q: Array
    factor: Array
    steps: int = 0
    cost_start: float = 0.0
    cost: float = 0.0


@dataclass(frozen=True)
class Seen:
    """Projections of n markers.

    Parameters
    ----------
    uv : (n, 2) in the search plane
    by_all : (n, 2, P) derivative by all parameters
    table : (n, 3) covariance xx, xy, yy by the markers' own sigma
    """

    uv: Array
    by_all: Array
    table: Array


def project(setting: Setting, bent: Bent, marker: Ints) -> Seen:
    """Projections of some markers, with derivatives."""
    modes, size = setting.modes[:, marker], setting.pose_size
    turned = (setting.xyz[marker] + np.tensordot(bent.q, modes, 1)) @ bent.rotation.T
    x, y, z = (turned + bent.translation).T
    s = bent.focal / z
    uv = np.stack([s * x, s * y], axis=1)
    by_place = np.zeros((len(marker), 2, 3))
    by_place[:, 0, 0], by_place[:, 1, 1] = s, s
    by_place[:, :, 2] = -uv / z[:, None]
    by_all = np.empty((len(marker), 2, size + len(bent.q)))
    # A turn by w moves the point a by w x a.
    a, (bx, by, bz) = turned.T[:, :, None], by_place.transpose(2, 0, 1)
    by_all[:, :, 0] = bz * a[1] - by * a[2]
    by_all[:, :, 1] = bx * a[2] - bz * a[0]
    by_all[:, :, 2] = by * a[0] - bx * a[1]
    by_all[:, :, 3:6] = by_place
    if size == 7:
        by_all[:, :, 6] = uv
    by_xyz = by_place @ bent.rotation
    by_all[:, :, size:] = by_xyz @ modes.transpose(1, 2, 0)
    return Seen(uv, by_all, _packed(by_xyz * setting.sigma[marker, None, :]))


def fit(setting: Setting, bent: Bent, marker: Ints, spot: Array, cov: Array) -> bool:
    """Gauss-Newton for labelled markers at ``spot`` (n, 2) of covariance (n, 3); False if it is singular or runs away.

    ``cov`` holds all but that of the markers' own sigma.
    """
    size = setting.pose_size
    for step_ in range(STEPS):
        seen = project(setting, bent, marker)
        j, e = _whitened(seen.by_all, spot - seen.uv, cov + seen.table)
        h, g = j.T @ j, j.T @ e
        bent.steps, bent.cost = bent.steps + 1, 0.5 * float(e @ e + bent.q @ bent.q)
        if step_ == 0:
            bent.cost_start = bent.cost
        h[range(size, len(h)), range(size, len(h))] += 1.0
        g[size:] -= bent.q
        if size == 7:
            h[6, 6] += setting.focal_weight
            g[6] += setting.focal_weight * np.log(setting.focal_start / bent.focal)
        try:
            bent.factor = np.asarray(np.linalg.cholesky(h), dtype=np.float64)
        except np.linalg.LinAlgError:
            return False
        step = cho_solve((bent.factor, True), g, check_finite=False)
        if not step[:3] @ step[:3] < 1.0:
            return False
        bent.rotation = exp_so3(step[:3]) @ bent.rotation
        bent.translation = bent.translation + step[3:6]
        bent.q = bent.q + step[size:]
        if size == 7:
            bent.focal *= float(np.exp(np.clip(step[6], -0.3, 0.3)))
        if not (bent.translation[2] + setting.xyz @ bent.rotation[2] > 0).all():
            return False
        if g @ step < AT_REST:
            return True
    return False


def spread_of(bent: Bent, by_all: Array) -> Array:
    """(n, 3) covariance xx, xy, yy of what has the derivative (n, 2, P), by that of pose and deformation."""
    n = len(by_all)
    # The library's triangular solution starts threads for these few numbers; the product does not.
    half = by_all.reshape(2 * n, -1) @ np.linalg.inv(bent.factor).T
    return _packed(half.reshape(n, 2, -1))


def _packed(half: Array) -> Array:
    """(n, 3) xx, xy, yy of ``half @ half.T``, (n, 2, any)."""
    u, v = half[:, 0], half[:, 1]
    return np.stack([(u * u).sum(axis=1), (u * v).sum(axis=1), (v * v).sum(axis=1)], axis=1)


def _whitened(by_all: Array, off: Array, cov: Array) -> tuple[Array, Array]:
    """Derivatives (2 n, P) and residuals (2 n) divided by the lower Cholesky factor of each covariance."""
    a = np.sqrt(cov[:, 0])
    b = cov[:, 1] / a
    c = np.sqrt(cov[:, 2] - b * b)
    j, e = np.empty_like(by_all), np.empty_like(off)
    j[:, 0], e[:, 0] = by_all[:, 0] / a[:, None], off[:, 0] / a
    j[:, 1] = (by_all[:, 1] - b[:, None] * j[:, 0]) / c[:, None]
    e[:, 1] = (off[:, 1] - b * e[:, 0]) / c
    return j.reshape(2 * len(off), -1), e.ravel()
