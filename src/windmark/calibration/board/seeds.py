"""Where to begin: spots in the middle of nine that form a lattice."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

NEAR = 17  # neighbours looked at, the spot itself included: enough for one false spot per dot and 60 degrees of tilt
_OPPOSITE = 0.25  # two steps are opposite if their sum is at most so long, in parts of the step
_MATCH = 0.22  # a spot is where the lattice says if it is so near, in parts of the shorter step
_MIN_SINE = 0.4  # two steps of a lattice seen at random are never closer in direction, once the shortest are taken
_MIN_HITS = 6  # of the eight neighbours
_AROUND = np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1], [1, -1], [-1, 1]])


class Seed(NamedTuple):
    """A spot, the two steps of the lattice round it (pixels), and how many spots a cell holds there."""

    spot: int
    steps: Array
    crowd: float


def find_seeds(xy: Array, tree: cKDTree, spots: Ints) -> list[Seed]:
    """Seeds among the given spots, those with the smallest cells for the density of spots first.

    A spot is a seed where at least six of its eight neighbours on a lattice are there. Of the lattices that would do,
    one with the smallest cell is taken, the others leave out dots; of the steps that make it, the shortest.

    Parameters
    ----------
    xy : (N, 2) spots
    tree : of all spots
    spots : indices of those that may be seeds
    """
    if len(xy) < NEAR:
        near = tree.query(xy[spots], k=np.arange(1, len(xy) + 1))[1]
    else:
        near = tree.query(xy[spots], k=np.arange(1, NEAR + 1))[1]
    found = []
    for spot, others in zip(spots.tolist(), near[:, 1:], strict=True):
        seed = _seed(xy, tree, spot, xy[others] - xy[spot])
        if seed is not None:
            found.append(seed)
    return sorted(found, key=lambda s: s.crowd)


def _seed(xy: Array, tree: cKDTree, spot: int, around: Array) -> Seed | None:
    steps = _straight(around)
    first, second = np.triu_indices(len(steps), 1)
    a, b = steps[first], steps[second]
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    shorter = np.minimum(np.hypot(*a.T), np.hypot(*b.T))
    keep = np.abs(cross) > _MIN_SINE * np.hypot(*a.T) * np.hypot(*b.T)
    a, b, cross, shorter = a[keep], b[keep], np.abs(cross[keep]), shorter[keep]
    if not len(a):
        return None
    places = xy[spot] + _AROUND[:, :1] * a[:, None] + _AROUND[:, 1:] * b[:, None]
    hits = (tree.query(places)[0] < _MATCH * shorter[:, None]).sum(axis=1)
    good = np.flatnonzero(hits >= _MIN_HITS)
    if not len(good):
        return None
    good = good[cross[good] < 1.4 * cross[good].min()]
    best = good[np.argmin((a[good] ** 2 + b[good] ** 2).sum(axis=1))]
    return Seed(spot, np.stack([a[best], b[best]]), float(cross[best] * len(around) / (around**2).sum(axis=1).max()))


def _straight(around: Array) -> Array:
    """Steps that are found in both directions, each once, from the shortest."""
    length = np.hypot(*around.T)
    gap = np.hypot(*(around[:, None] + around[None]).transpose(2, 0, 1))
    k, m = np.nonzero(np.triu(gap < _OPPOSITE * np.minimum(length[:, None], length[None]), 1))
    return np.asarray((around[k] - around[m]) / 2)
