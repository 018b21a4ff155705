"""Seams of a merged surface: where one picture takes over from another, and what their values differ by there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

A_FEW = 5
"""Nodes of a region on a seam: a marker or dirt on one of them does not reach their median."""
_MEDIAN = 0.6744897501960817
"""Median of |x| of a normal deviate."""


@dataclass(frozen=True)
class Seams:
    """The nodes on seams that both pictures see soundly: not where one of them mixes two surfaces at an outline.

    Parameters
    ----------
    node : (S,) of an edge of the grid whose ends have different dominant pictures
    first, second : (S,) these two pictures, first < second
    step : (S,) value of the first less that of the second, gains applied
    sigma : (S,) of the step, by noise, poses and gains; the pictures' systematic difference is not in it
    unchecked : number of such edges of which neither end is seen soundly by both: nothing says how well they fit
    edges : number of all such edges
    noise : (S,) sigma of the step by noise and poses alone: one gain is off alike all along a seam
    """

    node: Ints
    first: Ints
    second: Ints
    step: Array
    sigma: Array
    unchecked: int
    edges: int
    noise: Array

    def __len__(self) -> int:
        return len(self.node)

    @property
    def in_sigmas(self) -> Array:
        """(S,) steps in units of their sigma."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.step == 0, 0.0, self.step / self.sigma)

    def by_region(self, region: Ints, beside: Array) -> dict[tuple[int, int], Array]:
        """Two pictures -> their steps in sigmas of `noise`, the median of each ``region`` (V,) of nodes on their seam.

        ``beside``: (C, V) variance beside steps of the pictures. Of regions with a few nodes at least. A median's error
        is no larger than one node's, however alike the errors.
        """
        out: dict[tuple[int, int], Array] = {}
        with np.errstate(divide="ignore", invalid="ignore"):
            noise = self.noise**2 + beside[self.first, self.node] + beside[self.second, self.node]
            steps = np.where(self.step == 0, 0.0, self.step / np.sqrt(noise))
        for pair in sorted(set(zip(self.first.tolist(), self.second.tolist(), strict=True))):
            on = np.flatnonzero((self.first == pair[0]) & (self.second == pair[1]))
            names, of, count = np.unique(region[self.node[on]], return_inverse=True, return_counts=True)
            out[pair] = np.array([np.median(steps[on[of == k]]) for k in range(len(names)) if count[k] >= A_FEW])
        return out

    def summary(self) -> dict[str, float]:
        """Of the steps in sigmas: mean, mean size, typical size (the median, which markers and dirt do not reach: 1
        where the sigmas are right), root mean square and largest size; NaN without any.
        """
        s = self.in_sigmas
        if not len(s):
            return dict.fromkeys(("mean", "mean_size", "typical", "rms", "max"), float("nan"))
        size = np.abs(s)
        return {
            "mean": float(s.mean()), "mean_size": float(size.mean()), "typical": float(np.median(size) / _MEDIAN),
            "rms": float(np.sqrt(np.mean(s**2))), "max": float(size.max()),
        }  # fmt: skip


def find_seams(triangles: NDArray[np.int32], source: NDArray[np.int8], value: Array, variance: Array,
               sound: NDArray[np.bool_], gain_cov: Array) -> Seams:  # fmt: skip
    """Steps along the seams.

    Parameters
    ----------
    triangles : (T, 3)
    source : (V,) dominant picture of each node, -1 for none
    value, variance : (C, V) calibrated values and their variance, NaN where a picture has none
    sound : (C, V) not at an outline, a border or the obliquity's limit of the picture
    gain_cov : (C, C) covariance of the logarithms of the gains
    """
    edge = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    a, b = source[edge[:, 0]].astype(np.int64), source[edge[:, 1]].astype(np.int64)
    on_seam = (a >= 0) & (b >= 0) & (a != b)
    edge = np.unique(np.sort(edge[on_seam], axis=1), axis=0)
    ends = source[edge].astype(np.int64)
    first, second = ends.min(axis=1, initial=127), ends.max(axis=1, initial=-1)
    known = sound & np.isfinite(value)
    seen = known[first[:, None], edge] & known[second[:, None], edge]
    rows = np.stack([edge, np.broadcast_to(first[:, None], edge.shape), np.broadcast_to(second[:, None], edge.shape)])
    node, i, j = np.unique(rows[:, seen], axis=1)
    step = value[i, node] - value[j, node]
    by_gain = gain_cov[i, i] + gain_cov[j, j] - 2 * gain_cov[i, j]
    level = 0.5 * (value[i, node] + value[j, node])
    noise = variance[i, node] + variance[j, node]
    sigma = np.sqrt(noise + level**2 * by_gain)
    return Seams(node, i, j, step, sigma, int((~seen.any(axis=1)).sum()), len(edge), np.sqrt(noise))
