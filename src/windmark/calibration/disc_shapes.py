"""Normals and radii of discs from the ellipses that they are imaged as, in all pictures together.

A disc of radius r with the normal n has the second moments Q = r^2 (I - n n^T), four times those of a uniform disc.
Where the image is x(X) with the derivative J, those of its image, half axes squared, are J Q J^T to within (r / d)^2: a
linear equation for Q. Two directions determine it, up to the sign of n; one leaves the disc and its mirror image.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.discs import tangent
from windmark.geometry.similarity import Similarity

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUNDS = 12
"""Rounds of the robust fit."""
TAIL = 3.0
"""Misfit, in units of the ellipses' own scatter, from which a mark counts less (an edge cut by dirt or shadow)."""
LEAST_MARKS = 3
SAME, DOUBT = float(np.radians(3.0)), 5.0
"""Two solutions farther apart than this are told apart by a misfit that differs by so many sigma."""
ROUND = 0.1
"""Median misfit of the squared half axes, as part of them, from which a marker is no disc."""
ALIKE, MOST_ALIKE, LEAST_ALIKE = 0.05, 0.75, 4
"""Radii within so large a part of their median are one radius, where that many of all, and at least so many, are."""
ROOT2 = float(np.sqrt(2.0))
MEDIAN = 1.538
"""Median length of three numbers with unit sigma."""


@dataclass(frozen=True)
class Discs:
    """What the ellipses tell of N markers; NaN, and sigma inf, of those they tell nothing of.

    Parameters
    ----------
    normal, radius : (N, 3) unit vectors towards the cameras, (N,); a disc and its mirror image have one radius
    sigma : (N,) standard deviation of the normal's direction (the worse one), radians
    """

    normal: Array
    radius: Array
    sigma: Array

    def moved(self, fit: Similarity) -> Discs:
        """The same in another frame."""
        return Discs(self.normal @ fit.rotation.T, self.radius * fit.scale, self.sigma)


def shape_matrices(ellipses: Array) -> Array:
    """(O, 2, 2) matrices with the squared half axes, from (O, 3): half axes and direction of the first in radians."""
    c, s = np.cos(ellipses[:, 2]), np.sin(ellipses[:, 2])
    turn = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    return np.asarray((turn * ellipses[:, None, :2] ** 2) @ turn.transpose(0, 2, 1))


def discs_of_ellipses(ellipses: Array, point: Ints, jacobian: Array, towards: Array) -> Discs:
    """Discs from their images.

    Parameters
    ----------
    ellipses : (O, 3) half axes in pixels and direction of each mark's ellipse; NaN where not measured
    point : (O,) whose mark each is, an index into ``towards``
    jacobian : (O, 2, 3) derivative of the image of the marker's centre by its coordinates
    towards : (N, 3) mean direction from each marker to the cameras, which gives the normal its sign
    """
    count = len(towards)
    count = len(towards)
    good = np.isfinite(ellipses).all(axis=1) & np.isfinite(jacobian).all(axis=(1, 2))
    measured = _entries(shape_matrices(ellipses[good]))
    marks = _Marks(measured, np.maximum(measured[:, 0] + measured[:, 1], 1e-12) / 2, point[good], jacobian[good])
    facing = np.where(np.isfinite(towards).all(axis=1, keepdims=True), towards, [0.0, 0.0, 1.0])
    facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-12)
    best = _fitted(marks, *_linear(marks, facing))
    # Turned half round the line of sight a disc looks the same: only other directions tell.
    along = (best.normal * facing).sum(axis=1, keepdims=True)
    other = _fitted(marks, 2 * along * facing - best.normal, best.radius)
    worse = other.cost < best.cost
    best, other = best.where(~worse, other), other.where(~worse, best)
    apart = np.arccos(np.clip(np.abs((best.normal * other.normal).sum(axis=1)), 0, 1))
    open_ = (apart > SAME) & (other.cost - best.cost < DOUBT**2 * best.scale**2)
    round_ = (np.bincount(marks.who, minlength=count) >= LEAST_MARKS) & (best.scale < ROUND)
    known = round_ & ~open_
    variance = np.linalg.inv(best.information + 1e-9 * np.eye(3))[:, :2, :2]
    sigma = np.where(known, best.scale * np.sqrt(np.linalg.eigvalsh(variance)[:, 1]), np.inf)
    normal = best.normal * np.where((best.normal * facing).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    return Discs(np.where(known[:, None], normal, np.nan), np.where(round_, best.radius, np.nan), sigma)


def with_common_radius(radius: Array) -> Array:
    """Radii (N,) with those that are not known (NaN) taken from the others, where nearly all of these have one."""
    known = radius[np.isfinite(radius)]
    if not len(known):
        return radius
    middle = float(np.median(known))
    alike = np.abs(known - middle) < ALIKE * middle
    if alike.sum() < max(LEAST_ALIKE, MOST_ALIKE * len(known)):
        return radius
    return np.where(np.isfinite(radius), radius, np.median(known[alike]))


class _Marks(NamedTuple):
    """Marks: matrix of squared half axes (O, 3), their mean (O,), whose (O,), derivative of the image (O, 2, 3)."""

    measured: Array
    size: Array
    who: Ints
    j: Array


class _Fit(NamedTuple):
    """Discs (N,) with their robust cost, the information on tilts and log radius, and the scatter of their ellipses."""

    normal: Array
    radius: Array
    cost: Array
    information: Array
    scale: Array

    def where(self, mine: NDArray[np.bool_], other: _Fit) -> _Fit:
        """These where ``mine``, else the others."""
        return _Fit(*(np.where(mine.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in zip(self, other, strict=True)))


def _fitted(marks: _Marks, normal: Array, radius: Array) -> _Fit:
    """Robust least squares from start values, Gauss-Newton."""
    count, who = len(normal), marks.who
    for n in range(ROUNDS + 1):
        misfit, slope = _misfit(marks, normal[who], radius[who])
        length = np.linalg.norm(misfit, axis=1)
        scale = max(float(np.median(length)) / MEDIAN, 1e-9) if len(length) else 1.0
        weight = 1 / (1 + (length / (TAIL * scale)) ** 2)
        information, gradient = np.zeros((count, 3, 3)), np.zeros((count, 3))
        np.add.at(information, who, weight[:, None, None] * slope.transpose(0, 2, 1) @ slope)
        if n == ROUNDS:
            break
        np.add.at(gradient, who, weight[:, None] * np.einsum("oij,oi->oj", slope, misfit))
        # A little of one's own: a marker that is only seen face-on has no slope to turn by.
        step = -np.linalg.solve(information + 1e-6 * np.eye(3), gradient[..., None])[..., 0]
        step[:, :2] *= np.minimum(1.0, 0.5 / np.maximum(np.linalg.norm(step[:, :2], axis=1), 1e-12))[:, None]
        u = tangent(normal)
        normal = normal + step[:, :1] * u + step[:, 1:2] * np.cross(normal, u)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        radius = radius * np.exp(np.clip(step[:, 2], -0.5, 0.5))
    total = np.maximum(np.bincount(who, weight, minlength=count), 1e-9)
    own = np.sqrt(np.bincount(who, weight * length**2, minlength=count) / total / 3)
    robust = np.log1p((length / (TAIL * scale)) ** 2) * (TAIL * scale) ** 2
    cost = np.bincount(who, robust, minlength=count).astype(float)
    return _Fit(normal, radius, cost, information, np.maximum(own, scale))


def _entries(matrix: Array) -> Array:
    """(O, 3) entries of symmetric (O, 2, 2) with the Euclidean length of the matrix."""
    return np.stack([matrix[:, 0, 0], matrix[:, 1, 1], ROOT2 * matrix[:, 0, 1]], axis=1)


def _misfit(marks: _Marks, normal: Array, radius: Array) -> tuple[Array, Array]:
    """(O, 3) predicted less measured squared half axes in parts of them, and the slope (O, 3, 3) by tilts and log r."""
    u = tangent(normal)
    v = np.cross(normal, u)
    jn, ju, jv = (np.einsum("oij,oj->oi", marks.j, axis) for axis in (normal, u, v))
    r2 = (radius**2 / marks.size)[:, None]

    def both(a: Array, b: Array) -> Array:
        return np.stack([a[:, 0] * b[:, 0], a[:, 1] * b[:, 1], (a[:, 0] * b[:, 1] + a[:, 1] * b[:, 0]) / ROOT2], axis=1)

    predicted = r2 * (both(ju, ju) + both(jv, jv))
    slope = np.stack([-2 * r2 * both(ju, jn), -2 * r2 * both(jv, jn), 2 * predicted], axis=2)
    return predicted - marks.measured / marks.size[:, None], slope


def _linear(marks: _Marks, facing: Array) -> tuple[Array, Array]:
    """Start values (N, 3), (N,): Q by linear least squares where that is a disc, else one that faces the cameras."""
    count, (measured, size, who, j) = len(facing), marks
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    design = np.empty((len(who), 3, 6))
    for k, (a, b) in enumerate(pairs):
        factor = 1.0 if a == b else 2.0
        design[:, 0, k] = factor * j[:, 0, a] * j[:, 0, b]
        design[:, 1, k] = factor * j[:, 1, a] * j[:, 1, b]
        design[:, 2, k] = ROOT2 * (j[:, 0, a] * j[:, 1, b] + j[:, 0, b] * j[:, 1, a]) * factor / 2
    design /= size[:, None, None]
    matrix, right = np.zeros((count, 6, 6)), np.zeros((count, 6))
    np.add.at(matrix, who, design.transpose(0, 2, 1) @ design)
    np.add.at(right, who, np.einsum("oik,oi->ok", design, measured / size[:, None]))
    q = np.einsum("nij,nj->ni", np.linalg.pinv(matrix, rcond=1e-6, hermitian=True), right)
    full = np.empty((count, 3, 3))
    for k, (a, b) in enumerate(pairs):
        full[:, a, b] = full[:, b, a] = q[:, k]
    value, vector = np.linalg.eigh(full)
    flat = np.minimum(value[:, 1] - 0.3 * value[:, 2], 0.5 * value[:, 1] - np.abs(value[:, 0])) > 0
    normal = np.where(np.reshape(flat, (-1, 1)), vector[:, :, 0], facing)
    scale = np.bincount(who, np.sqrt(size / np.maximum((j**2).sum(axis=(1, 2)) / 2, 1e-300)), minlength=count)
    rough = np.maximum(scale / np.maximum(np.bincount(who, minlength=count), 1), 1e-12)
    return normal, np.where(flat, np.sqrt(np.maximum(value[:, 1:].mean(axis=1), 1e-300)), rough)
