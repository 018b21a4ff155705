"""Images of spots of dirt in the windows of fitted discs, and what residuals and fits say of them.

A spot is a small disc whose blurred image is taken for a Gaussian. Spots are tried at places along ellipses round the
disc's centre. Their images are products of a column and a row, so that sums with them are two small matrix products;
where they are wide, pixels are taken together first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.fit import BATCH_PIXELS, Fitted, Windows
from windmark.detection.template.request import Scene
from windmark.geometry.order import median

Array = NDArray[np.float64]

PIXEL = 1.0 / 12.0  # px^2, variance of a pixel's box
SIZES = 0.25, 0.5  # radii of the spots in those of the disc
LEAST_PX = 0.8  # radius of a spot
PLACES = 0.45, 0.75, 1.0, 1.25, 1.55  # distances from the centre in half axes
APART, LEAST_MANY = 1.2, 6  # standard deviations of a spot's image between places along an ellipse; on each at least
BLOCK = 0.6  # standard deviations of a spot's image, side of the squares of pixels that are taken together
LEAST_REST = 1e-3  # of a spot's image that is left beside the ten unknowns
SEEN = 0.5  # share of a spot's image in pixels that are used
NEAREST, FARTHEST, RINGS = 0.3, 2, 32  # half axes from the centre, places at first; steps of one
SAMPLE = 3  # markers of a size that are typical
FAR = 60.0  # square of a distance in standard deviations: smaller numbers are dear to multiply


@dataclass(frozen=True)
class Answers:
    """Of spots of one size at places (B, P) in noise of 1: significance, variance of the amplitude, and how far an
    amplitude of one moves the centre (B, P, 2); 0 and 1 where pixels are missing.
    """

    t: Array
    unit: Array
    moves: Array


def batches(group: Windows, images: int) -> Iterator[Windows]:
    """Windows of one size, so few at once that so many images of each stay in the cache."""
    many = max(BATCH_PIXELS // (images * group.weights[0].size), 1) if len(group.index) else 1
    for first in range(0, len(group.index), many):
        yield group.take(np.arange(first, min(first + many, len(group.index))))


@dataclass(frozen=True)
class Plan:
    """Where spots are looked for in windows of one size.

    Parameters
    ----------
    steps : for each size so many pixels are taken together along either side where spots are wide
    shares : for each size how wide a spot's image is, in radii
    unit : for each size the variance (P,) of the amplitude in noise of 1, of typical markers
    """

    steps: list[int]
    shares: list[float]
    unit: list[Array]

    @staticmethod
    def make(scene: Scene, group: Windows, done: Fitted) -> Plan:
        """The plan of some windows, and what the fits of the first of them have taken of the spots."""
        radius, spots = _spread(done.params)
        steps = [max(1, round(median(s.copy()) / BLOCK)) for s in spots]
        plan = Plan(steps, [median(s / radius) for s in spots], [])
        some = np.arange(min(len(group.index), SAMPLE))
        sizes = plan.answers(scene, group.take(some), done.take(some))
        return replace(plan, unit=[np.median(a.unit, axis=0) for a in sizes])

    def first_looks(self, scene: Scene, group: Windows, done: Fitted, noise: Array) -> list[Array]:
        """For each size significances (B, P) at the windows' pixels, as if the fits had taken as much of the spots as
        typical ones; 0 beyond the places.
        """
        left, pixels = _left(scene, group, done.params), group.weights.shape[1]
        looks = []
        for k, (step, unit) in enumerate(zip(self.steps, self.unit, strict=True)):
            x = _middles(pixels, step)
            blur = np.exp(-0.5 * np.square((x[:, None] - x) / median(_spread(done.params)[1][k].copy())))
            image = blur @ _summed(left[:, None], step)[:, 0] @ blur
            away = _away(done.params, x)
            ring = np.minimum(away * RINGS, RINGS * FARTHEST).astype(np.int64)
            at = np.arange(RINGS * FARTHEST + 1) / RINGS
            known = np.interp(at, PLACES, [np.sqrt(u.mean()) for u in np.split(unit, np.cumsum(self._many(k))[:-1])])
            known[(at < NEAREST) | (at >= FARTHEST)] = 0.0
            looks.append((image * known[ring] / noise[:, None, None]).reshape(len(left), -1))
        return looks

    def answers(self, scene: Scene, windows: Windows, done: Fitted) -> list[Answers]:
        """For each size."""
        jac, left = _linear(scene, windows, done.params)
        images = np.concatenate([jac, left[:, None], windows.weights[:, None]], axis=1)
        cov = done.cov / done.column("noise2")[:, None, None]
        out = []
        for k, spread in enumerate(_spread(done.params)[1]):
            along, across = self._images(k, done.params, left.shape[1], np.dtype(np.float64))
            sums, used = _sums(_summed(images, self.steps[k]), along, across)
            slopes, answer = sums[:, :, :10], sums[:, :, 10]
            moves = slopes @ cov
            rest, whole = used - (moves * slopes).sum(axis=2), np.pi * spread[:, None] ** 2
            good = (used >= SEEN * whole) & (rest > LEAST_REST * whole)
            rest = np.where(good, rest, 1.0)
            out.append(Answers(np.where(good, answer / np.sqrt(rest), 0.0), 1.0 / rest, moves[:, :, :2]))
        return out

    def _many(self, size: int) -> list[int]:
        """How many spots of a size are tried at each of `PLACES`."""
        return [max(LEAST_MANY, int(np.ceil(2.0 * np.pi * f / (APART * self.shares[size])))) for f in PLACES]

    def _images(self, size: int, params: Array, pixels: int, kind: np.dtype[Any]) -> tuple[Any, Any]:
        """Columns and rows (B, P, S) whose products are the images of spots of a size in windows of so many pixels."""
        many = self._many(size)
        turn = np.concatenate([np.arange(n) * (2.0 * np.pi / n) for n in many])
        e = np.repeat(PLACES, many) * np.stack([np.cos(turn), np.sin(turn)])
        at = params[:, :2, None] + np.stack([params[:, 2:4] @ e, params[:, 3:5] @ e], axis=1)
        step = self.steps[size]
        x = _middles(pixels, step)
        scale = _spread(params)[1][size][:, None, None, None]
        away = np.square(((x - at[..., None]) / scale).astype(kind))
        images = np.exp(-0.5 * np.minimum(away, kind.type(FAR)))
        return images[:, 0], images[:, 1]


def _middles(pixels: int, step: int) -> Array:
    """Middles of squares of pixels along a side, from the middle of a window."""
    return np.asarray((np.arange(-(-pixels // step)) + 0.5) * step - 0.5 - pixels // 2)


def _away(params: Array, x: Array) -> Array:
    """Distances (B, S, S) of places x (S,) along either side from the ellipses' centres, in half axes."""
    xx, xy, yy = (params[:, k, None, None] for k in (2, 3, 4))
    dx, dy = x[None, None, :] - params[:, 0, None, None], x[None, :, None] - params[:, 1, None, None]
    return np.asarray(np.hypot(yy * dx - xy * dy, xx * dy - xy * dx) / np.maximum(xx * yy - xy * xy, 1e-6))


def _left(scene: Scene, windows: Windows, params: Array) -> Array:
    """What fits of parameters (B, 10) leave of their windows (B, S, S)."""
    from windmark.detection.template._kernels.touching import take_away

    left = windows.patches.copy()
    take_away(left, windows.weights, np.arange(len(left)), params, float(scene.multiplicative))
    x = _middles(left.shape[1], 1)
    ramp = params[:, 8, None, None] * x + params[:, 9, None, None] * x[:, None]
    level = params[:, 7, None, None]
    return np.asarray(windows.weights * (left - (level * (1.0 + ramp) if scene.multiplicative else level + ramp)))


def _sums(images: Array, along: Array, across: Array) -> tuple[Array, Array]:
    """Sums (B, P, 11) of all but the last images (B, 12, S, S) with the spots, and of the last with their squares."""
    count, many, size, _ = images.shape
    rows = np.ascontiguousarray(images[:, :-1].transpose(0, 2, 3, 1)).reshape(count, size, -1)
    sums = np.empty((*along.shape[:2], many - 1))
    for k in range(count):  # one at a time stays in the cache
        np.einsum("ps,psn->pn", along[k], (across[k] @ rows[k]).reshape(-1, size, many - 1), out=sums[k])
    return sums, np.einsum("bps,bps->bp", np.square(across) @ images[:, -1], np.square(along))


def _spread(params: Array) -> tuple[Array, Array]:
    """Radii (B,) of discs, and how wide the images of spots (SIZES, B) are as Gaussians."""
    radius = np.sqrt(np.maximum(params[:, 2] * params[:, 4] - params[:, 3] ** 2, 0.25))
    own = np.maximum(np.outer(SIZES, radius), LEAST_PX)
    return radius, np.sqrt(params[:, 5] ** 2 + PIXEL + 0.25 * np.square(own))


def _summed(images: Array, step: int) -> Array:
    """Images (B, N, S, S) as sums over squares of `step` pixels."""
    if step == 1:
        return images
    more = -images.shape[2] % step
    images = np.pad(images, ((0, 0), (0, 0), (0, more), (0, more)))
    rows = np.sum([images[:, :, k::step] for k in range(step)], axis=0)
    return np.asarray(np.sum([rows[..., k::step] for k in range(step)], axis=0))


def _linear(scene: Scene, windows: Windows, params: Array) -> tuple[Array, Array]:
    """Derivatives (B, 10, S, S) by the parameters (B, 10), and what fits leave (B, S, S)."""
    from windmark.detection.template._kernels.touching import derivatives

    count, size, _ = windows.weights.shape
    jac, over = np.empty((count, 10, size, size)), np.empty((count, size, size))
    scratch, table = np.empty(10), np.empty((8, size + 6))
    for k in range(count):
        derivatives(windows.weights[k], params[k], float(scene.multiplicative), scratch, table, over[k], jac[k])
    return jac, windows.weights * (windows.patches - windows.weights) + over  # `over` is that of a patch of ones
