"""Dirt on a disc that no single pixel and no sum of squares shows: what is left of the fit is looked through for it.

A patch of dirt at the rim is half taken for a part of the disc: centre, size and shape give way, and what is left over is
small. But it is left at one place. The residuals are compared with the images of spots at all places in and round the
disc, of two sizes: with g the image of a spot, M what the fit leaves of an image (the projection beside the ten unknowns),
and s^2 the noise of a pixel, a = g.r / (g.M g) is the amplitude of a spot there, t = a sqrt(g.M g) / s its significance,
and d = C J^T g / s^2 how far an amplitude of one moves the centre that was fitted without it. What is beyond chance is
dirt. What may be chance as well counts by its evidence: with amplitudes that are normal, of a spread A, the likelihood of
a spot there over that of none is exp(t^2 / 2 * A^2 / (A^2 + v)) / sqrt(1 + A^2 / v), v = s^2 / (g.M g) (Bayesian model
averaging; the share of the markers that have dirt on them is found from all of the frame, by EM), and its variance
E[a^2] d d^T is added to the centre's. Of a clean frame that is nothing.

Noise that is correlated, rough prints and what the model does not know leave residuals that look like spots everywhere: how
much such t scatter over the frame's markers is what they are compared with.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.fit import BATCH_PIXELS, Fitted, Windows, sized_windows
from windmark.detection.template.request import Neighbours, Request, Scene
from windmark.geometry.order import median

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

PIXEL = 1.0 / 12.0  # px^2, variance of a pixel's box
SIZES = 0.25, 0.5  # radii of the spots in those of the disc
LEAST_PX = 0.8  # radius of a spot
PLACES = 0.45, 0.75, 1.0, 1.25, 1.55  # distances from the centre in half axes
APART = 1.2  # standard deviations of a spot's image between places along the ellipse
BLOCK = 0.6  # standard deviations of a spot's image, side of the squares of pixels that are taken together
NORMAL = 1.4826  # standard deviation over the median of what is normal, without its sign
LEAST_REST = 1e-3  # of a spot's image that is left beside the ten unknowns
SEEN = 0.5  # share of a spot's image in pixels that are used
SURE = 4.8  # standard deviations that are no chance: of some hundred places 1 in 1000 discs has one
LEAST_SCATTER = 0.5  # of what the variance says: dirt on many of the markers is in it
AMPLITUDE = 0.4  # of the disc's depth, standard deviation of the spots'
DIRTY, ONES = 0.01, 20.0  # share of markers with dirt as known beforehand, as if from so many markers
NEAR, OFTEN = 3.7, 0.02  # what is asked of each marker; or of all where more than such a share of them has dirt
NEAREST, FARTHEST, RINGS = 0.3, 2, 32  # half axes from the centre, places at first; steps of one
SAMPLE = 3  # markers of a size that are typical
FAR = 60.0  # square of a distance in standard deviations: smaller numbers are dear to multiply
NOTHING, LARGE = -50.0, 500.0  # nats: no dirt, and what is as good as sure
ROUNDS = 60  # of EM, which gains half of what is left in each


@dataclass(frozen=True)
class Spots:
    """What is left of K markers, as spots.

    Parameters
    ----------
    most : (K,) significance of the clearest spot, standard deviations; 0 where nothing could be asked
    nats : (K,) evidence of a spot somewhere over none
    spread : (K, 2, 2) E[a^2] d d^T, if there is one
    """

    most: Array
    nats: Array
    spread: Array

    @property
    def sure(self) -> NDArray[np.bool_]:
        """Markers (K,) that have dirt on them beyond chance."""
        return np.asarray(self.most > SURE)

    def beyond(self, dirty: int) -> Array:
        """Covariances (K, 2, 2) to be added to the centres'; so many other markers are known to have dirt on them."""
        share, chance = DIRTY, np.zeros(len(self.nats))
        for _ in range(ROUNDS):
            odds = np.exp(np.minimum(self.nats + np.log(share / (1.0 - share)), LARGE))
            chance = odds / (1.0 + odds)
            share = float((chance.sum() + dirty + DIRTY * ONES) / (len(chance) + dirty + ONES))
        return np.asarray(chance[:, None, None] * self.spread)


def find_spots(scene: Scene, request: Request, done: Fitted, others: Neighbours, variance: Array) -> Spots:
    """Look for spots in what fits `done` of a request leave; `variance` (K,) of a pixel's noise.

    What is left is compared with the spots first; what the fits have taken of these is asked of some markers and taken
    for all. Where that comes near to dirt, and everywhere if there is much of it in the frame, it is asked of each.
    """
    count, noise = len(variance), np.sqrt(variance)
    out = Spots(np.zeros(count), np.full(count, NOTHING), np.zeros((count, 2, 2)))
    groups = sized_windows(scene, replace(request, states=done.states), others)
    plans = [_Plan.make(scene, g, done.take(g.index)) for g in groups]
    first = [p.first_looks(scene, g, done.take(g.index), noise[g.index]) for p, g in zip(plans, groups, strict=True)]
    spread = _scatter(first)
    most = np.zeros(count)
    for g, t in zip(groups, first, strict=True):
        most[g.index] = np.max([np.abs(one).max(axis=1) / s for one, s in zip(t, spread, strict=True)], axis=0)
    near = most > (NEAR if (most > SURE).mean() <= OFTEN else 0.0)
    for plan, g in zip(plans, groups, strict=True):
        for part in _batches(g.take(np.flatnonzero(near[g.index])), 11):
            sizes = plan.answers(scene, part, done.take(part.index))
            _weigh(out, part.index, sizes, noise[part.index], spread, done.params[part.index, 6])
    return out


def _weigh(out: Spots, index: Ints, sizes: list[_Answers], noise: Array, spread: list[float], depth: Array) -> None:
    """Significance, evidence and moments of the spots of some markers (B,), put to `out`."""
    scale = [noise[:, None] * s for s in spread]
    t = np.concatenate([a.t / s for a, s in zip(sizes, scale, strict=True)], axis=1)
    v = np.concatenate([a.unit * s**2 for a, s in zip(sizes, scale, strict=True)], axis=1)
    d = np.concatenate([a.moves for a in sizes], axis=1)
    wide = np.square(AMPLITUDE * depth)[:, None]
    gain, seen = wide / (wide + v), t != 0.0
    nats = np.where(seen, 0.5 * t**2 * gain - 0.5 * np.log1p(wide / v), NOTHING)
    top = nats.max(axis=1, keepdims=True)
    weight = np.exp(nats - top)
    total = weight.sum(axis=1)
    out.most[index] = np.abs(t).max(axis=1)
    out.nats[index] = top[:, 0] + np.log(total / np.maximum(seen.sum(axis=1), 1))
    square = (weight / total[:, None]) * v * gain * (t**2 * gain + 1.0)
    out.spread[index] = np.einsum("kn,kni,knj->kij", square, d, d)


@dataclass(frozen=True)
class _Answers:
    """Of spots of one size at places (B, P) in noise of 1: significance, variance of the amplitude, and how far an
    amplitude of one moves the centre (B, P, 2); 0 and 1 where pixels are missing.
    """

    t: Array
    unit: Array
    moves: Array


def _scatter(significances: list[list[Array]]) -> list[float]:
    """By how much the significances (B, P) of spots of each size scatter more (or less) than the noise says."""
    out = []
    for size in range(len(SIZES)):
        every = np.concatenate([t[size].ravel() for t in significances])
        every = np.abs(every[every != 0.0])
        out.append(max(LEAST_SCATTER, NORMAL * median(every)) if every.size else 1.0)
    return out


def _batches(group: Windows, images: int) -> Iterator[Windows]:
    """Windows of one size, so few at once that so many images of each stay in the cache."""
    many = max(BATCH_PIXELS // (images * group.weights[0].size), 1) if len(group.index) else 1
    for first in range(0, len(group.index), many):
        yield group.take(np.arange(first, min(first + many, len(group.index))))


@dataclass(frozen=True)
class _Plan:
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
    def make(scene: Scene, group: Windows, done: Fitted) -> _Plan:
        """The plan of some windows, and what the fits of the first of them have taken of the spots."""
        radius, spots = _spread(done.params)
        steps = [max(1, round(median(s.copy()) / BLOCK)) for s in spots]
        plan = _Plan(steps, [median(s / radius) for s in spots], [])
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

    def answers(self, scene: Scene, windows: Windows, done: Fitted) -> list[_Answers]:
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
            out.append(_Answers(np.where(good, answer / np.sqrt(rest), 0.0), 1.0 / rest, moves[:, :, :2]))
        return out

    def _many(self, size: int) -> list[int]:
        """How many spots of a size are tried at each of `PLACES`."""
        return [max(6, int(np.ceil(2.0 * np.pi * f / (APART * self.shares[size])))) for f in PLACES]

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
