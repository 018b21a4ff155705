"""What a picture's candidates say of each other: how many are discs, and which of them belong together.

How often a thing is a disc before its pixels are asked is another number in a picture of markers than in one of text.
Where hundreds of candidates are another thing for certain, the few of them that look least like it are the tail of
their kind, not markers. The share of discs is estimated from all that is to be judged: a mixture of two laws whose
ratio is known at each candidate (Dempster, Laird and Rubin, J. R. Stat. Soc. B 39, 1977).

Discs too small to show their shape would all be lost beside other things. But markers are of one size and one contrast,
letters, splinters and flakes of any: what lies closer together in both than the other things do is a family, and its
members have that for them, too. A picture may have several.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

RIVAL_NATS = 3.4  # by which the pixels must speak for another thing: of what comes so far 30 times as much are discs
WORTH = 8.0  # candidates that this is worth beside those of the picture
TAIL = 3.0  # other things, over those of them that are beyond doubt, at most: the rest is the tail of their kind
STEPS, STILL = 60, 1e-3  # of the shares' estimates
MOST_NATS = 40.0  # what says more says no more
ALIKE = 0.07, 0.25  # standard deviation, at least and at most, of log size and log contrast in a family
BEYOND = 0.1  # share of a family that is beyond this: worn, in a shadow, at a grazing angle
FIRST_ODDS = 1.0, 4.0  # of other things, where a family is looked for
FAMILIES = 2  # that are looked for with each of them
WIDTH, BIN, BINS = 0.15, 0.05, 128  # of the density of the other things over log size and log contrast; its raster
ANYWHERE = 0.25  # density of what is like no other thing: one over a range of e^2 in size and contrast


def are_others(nats: Array, size: Array, contrast: Array, asked: Flags) -> Flags:
    """Candidates (K,) that are no discs.

    Parameters
    ----------
    nats : (K,) by which the pixels speak for another thing; NaN where they say nothing
    size, contrast : (K,) what markers have in common
    asked : (K,) of which the company is asked; the others speak for themselves alone
    """
    with np.errstate(invalid="ignore"):
        other, doubtful = nats > RIVAL_NATS, asked & (nats > odds_of_discs(nats[asked]))
    if not (doubtful & ~other).any():
        return np.asarray(other)
    known = np.flatnonzero(np.isfinite(nats) & asked)
    with np.errstate(divide="ignore", invalid="ignore"):
        place = np.stack([np.log(size[known]), np.log(contrast[known])], axis=1)
    place = np.where(np.isfinite(place), place, -MOST_NATS)
    other[known] |= doubtful[known] & ~of_families(np.clip(nats[known], -MOST_NATS, MOST_NATS), place)
    return np.asarray(other)


def odds_of_discs(nats: Array) -> float:
    """Logarithm of the odds that a candidate is a disc, by what the pixels say of all (K,); at most `RIVAL_NATS`.

    Where nothing is another thing beyond doubt, what all look like a little is how these discs are printed or seen.
    """
    nats = nats[np.isfinite(nats)]
    against = np.exp(np.clip(nats, -MOST_NATS, MOST_NATS))
    most = 1.0 / (1.0 + np.exp(-RIVAL_NATS))
    least = 1.0 - TAIL * float((nats > RIVAL_NATS).sum()) / (len(nats) + WORTH)
    share = most
    for _ in range(STEPS):
        before, discs = share, share / (share + (1.0 - share) * against)
        share = min(max(float((discs.sum() + WORTH * most) / (len(against) + WORTH)), least), most)
        if abs(share - before) <= STILL * min(share, 1.0 - share):
            break
    return float(np.log(share / (1.0 - share)))


def of_families(nats: Array, place: Array) -> Flags:
    """Candidates (K,) that are likelier a disc of a family than another thing.

    Parameters
    ----------
    nats : (K,) as of `are_others`, none missing
    place : (K, 2) log size and log contrast
    """
    raster, members = _Raster(place), np.zeros(len(nats), dtype=bool)
    for odds in FIRST_ODDS:
        first = 1.0 / (1.0 + odds * np.exp(nats))
        gain = raster.spread(first) - raster.spread(1.0 - first) * max(first.sum() / (1.0 - first).sum(), 0.2)
        for _ in range(FAMILIES):
            middle = place[int(gain.argmax())]
            members |= _family(nats, place, raster, first, middle) >= 0.5
            gain = np.where((np.abs(place - middle) < 3.0 * ALIKE[0]).all(axis=1), -np.inf, gain)
            if not np.isfinite(gain).any():
                break
    return members


def _family(nats: Array, place: Array, raster: _Raster, member: Array, middle: Array) -> Array:
    """Probability (K,) of being a disc of the family about a place, which is moved to its middle."""
    most, spread, share = 1.0 / (1.0 + np.exp(-RIVAL_NATS)), np.full(2, 1.5 * ALIKE[0]), 0.5
    for _ in range(STEPS):
        away = np.square((place - middle) / spread).sum(axis=1)
        like = (1.0 - BEYOND) * np.exp(-0.5 * away) / (2.0 * np.pi * spread.prod()) + BEYOND * ANYWHERE
        other = (raster.spread(1.0 - member) + ANYWHERE) / (1.0 + (1.0 - member).sum())
        against = (1.0 - share) / share * np.exp(np.clip(nats, -MOST_NATS, MOST_NATS)) * other / like
        before, member = member, 1.0 / (1.0 + against)
        share = min(float((member.sum() + 0.5) / (len(nats) + 1.0)), most)
        core = member * np.exp(-away / 18.0)
        if member.sum() < 1.5 or np.abs(member - before).max() <= STILL:
            break
        middle = core @ place / core.sum()
        spread = np.clip(np.sqrt(core @ np.square(place - middle) / core.sum()), *ALIKE)
    return np.asarray(member)


class _Raster:
    """Density of weighted candidates at each of them but for itself, by a raster over log size and log contrast."""

    def __init__(self, place: Array) -> None:
        cell = np.rint((place - np.median(place, axis=0)) / BIN).astype(np.int64) + BINS // 2
        self.x, self.y = np.clip(cell, 0, BINS - 1).T
        self.own = BIN**2 / (2.0 * np.pi * WIDTH**2)

    def spread(self, weight: Array) -> Array:
        """Sum (K,) of the others' weights, each over an area of about `WIDTH` squared."""
        from scipy.ndimage import gaussian_filter

        table = np.zeros((BINS, BINS))
        np.add.at(table, (self.x, self.y), weight)
        table = gaussian_filter(table, WIDTH / BIN, mode="constant")
        return np.asarray(np.maximum(table[self.x, self.y] - self.own * weight, 0.0) / BIN**2)
