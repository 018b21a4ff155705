"""Dirt on a disc that no single pixel and no sum of squares shows: what is left of the fit is looked through for it.

A patch of dirt at the rim is half taken for a part of the disc: centre, size and shape give way, and what is left over
is little. But it is left at one place. The residuals r are compared with the images of spots at all places in and round
the disc, of two sizes (`dirt_images`): with g the image of a spot, M g what the fit leaves of it (M the projection
beside the ten unknowns) and s^2 the noise of a pixel, a = g.r / (g.M g) is the amplitude of a spot there, v = s^2 /
(g.M g) its variance, t = a / sqrt(v) its significance, and d = C J^T g / s^2 how far an amplitude of one moves the
centre that was fitted without it.

What is beyond chance is dirt. What may be chance as well counts by its evidence: where amplitudes are normal, of a
spread A, the likelihood of a spot there over that of none is exp(t^2 / 2 * A^2 / (A^2 + v)) / sqrt(1 + A^2 / v), and
E[a^2] d d^T, averaged over all places and times the chance that there is dirt at all, is added to the centre's
covariance (Bayesian model averaging: Hoeting et al., Statistical Science 14, 1999). What share of the markers has dirt
on it all of them say together, by EM: in a clean frame nothing is added.

Noise that is correlated, rough prints and what the model does not know leave residuals that look like spots everywhere:
how much such significances scatter over the frame's markers is what they are compared with.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.dirt_images import SIZES, Answers, Plan, batches
from windmark.detection.template.fit import Fitted, sized_windows
from windmark.detection.template.request import Neighbours, Request, Scene
from windmark.geometry.order import median

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SURE = 4.8  # standard deviations that are no chance: of some hundred places 1 in 3000 clean discs has one
AMPLITUDE = 0.4  # of the disc's depth, standard deviation of the spots'
DIRTY, ONES = 0.01, 20.0  # share of markers with dirt as known beforehand, as if from so many markers
NEAR, OFTEN = 3.7, 0.02  # what is asked of each marker; or of all where more than such a share of them has dirt
ROUNDS = 60  # of EM, which gains half of what is left in each
NORMAL = 1.4826  # standard deviation over the median of what is normal, without its sign
LEAST_SCATTER = 0.5  # of what the variance says: dirt on many of the markers is in it
NOTHING, LARGE = -50.0, 500.0  # nats: no dirt, and what is as good as sure


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
    plans = [Plan.make(scene, g, done.take(g.index)) for g in groups]
    first = [p.first_looks(scene, g, done.take(g.index), noise[g.index]) for p, g in zip(plans, groups, strict=True)]
    spread = _scatter(first)
    most = np.zeros(count)
    for g, t in zip(groups, first, strict=True):
        most[g.index] = np.max([np.abs(one).max(axis=1) / s for one, s in zip(t, spread, strict=True)], axis=0)
    near = most > (NEAR if (most > SURE).mean() <= OFTEN else 0.0)
    for plan, g in zip(plans, groups, strict=True):
        for part in batches(g.take(np.flatnonzero(near[g.index])), 12):
            sizes = plan.answers(scene, part, done.take(part.index))
            _weigh(out, part.index, sizes, noise[part.index], spread, done.params[part.index, 6])
    return out


def _weigh(out: Spots, index: Ints, sizes: list[Answers], noise: Array, spread: list[float], depth: Array) -> None:
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


def _scatter(significances: list[list[Array]]) -> list[float]:
    """By how much the significances (B, P) of spots of each size scatter more (or less) than the noise says."""
    out = []
    for size in range(len(SIZES)):
        every = np.concatenate([t[size].ravel() for t in significances])
        every = np.abs(every[every != 0.0])
        out.append(max(LEAST_SCATTER, NORMAL * median(every)) if every.size else 1.0)
    return out
