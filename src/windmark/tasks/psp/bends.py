"""A ratio that is bent within the cell of a node (behind a shock, say): how much, and taken off.

The light of a coarse cell is bent by the paint's grain and by the lamps in the pictures of both kinds alike, and most
of that is not in their ratio. Taking it off every picture costs noise (the bend comes from the neighbours, with theirs)
and gains nothing; only where the ratio itself is bent, neighbours say so beyond doubt, and it counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.resection import FootprintPlanes, plane_bend

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Cells:
    """What is known of the cells of V nodes in the pictures of a kind and camera; NaN where a node has none.

    Parameters
    ----------
    xy : (V, 2) the nodes in the first picture
    slope : (V, 2) of the light per pixel, part of the light
    unit, moments : (V, 3, 3) and (V, 3), see `FootprintPlanes`
    noise : (V,) variance of a pixel of the mean picture, part of the light squared
    """

    xy: Array
    slope: Array
    unit: Array
    moments: Array
    noise: Array


def mean_cells(planes: Sequence[FootprintPlanes], xy: Array, excess: float) -> Cells:
    """Of pictures of one kind; ``excess``: by which they scatter more than their noise says."""
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = np.mean([p.slope / p.value[:, None] for p in planes], axis=0)
        noise = np.mean([p.noise / p.value**2 for p in planes], axis=0) / len(planes)
    unit, moments = (np.mean([getattr(p, of) for p in planes], axis=0) for of in ("unit", "moments"))
    return Cells(xy, slope, unit, moments, noise * max(excess, 1.0) ** 2)


def joined_cells(parts: Sequence[Cells], share: Array) -> Cells:
    """Of several sets of pictures that a mean is made of by shares (P, V); a part without share need know nothing."""

    def total(of: str, by: Array) -> Array:
        values = [getattr(p, of) for p in parts]
        return np.asarray(sum(np.where(_to(s != 0, v), _to(s, v) * v, 0.0) for s, v in zip(by, values, strict=True)))

    even = np.abs(share) / np.where(np.abs(share).sum(axis=0) > 0, np.abs(share).sum(axis=0), 1.0)
    none = np.abs(share).sum(axis=0) == 0
    slope, moments, unit = (np.where(_to(none, v), np.nan, v) for v in
                            (total("slope", even), total("moments", even), total("unit", even)))  # fmt: skip
    return Cells(parts[0].xy, slope, unit, moments, np.where(none, np.nan, total("noise", share**2)))


def _to(per_node: NDArray[np.generic], like: Array) -> NDArray[np.generic]:
    """(V,) in the shape of (V, ...)."""
    return per_node.reshape(-1, *(1,) * (like.ndim - 1))


def bend_of_ratio(ratio: Array, off: Cells, on: Cells, triangles: NDArray[np.integer]) -> tuple[Array, Array]:
    """What is to be taken off a ratio wind-off / wind-on (V,), and the variance that it adds; 0 where nothing is.

    Notes
    -----
    A bend counts where it is beyond sqrt(2 ln n) of its sigmas, n the nodes that tell one: noise alone does not come so
    far (Donoho and Johnstone, Biometrika 81, 1994). What was taken off is as unsure as it is large, for the second
    derivatives are those of the cell's neighbourhood.
    """
    taken, added = np.zeros(len(ratio)), np.zeros(len(ratio))
    # Of wind-on light in units of wind-off light: pixels add light up, so that a cell's mean is linear in it.
    with np.errstate(divide="ignore"):
        light = 1 / ratio
    slope = light[:, None] * (on.slope - off.slope)
    noise = light**2 * (off.noise + on.noise)
    unit, moments = 0.5 * (off.unit + on.unit), 0.5 * (off.moments + on.moments)
    told = np.isfinite(slope).all(axis=1) & np.isfinite(noise) & np.isfinite(unit).all(axis=(1, 2))
    nodes = np.flatnonzero(told & np.isfinite(light) & np.isfinite(on.xy).all(axis=1))
    if len(nodes) < 3:
        return taken, added
    number = np.full(len(ratio), -1, np.int64)
    number[nodes] = np.arange(len(nodes))
    plane = FootprintPlanes(
        light[nodes], noise[nodes], slope[nodes], unit[nodes], noise[nodes], noise[nodes], moments[nodes]
    )  # fmt: skip
    bend = plane_bend(plane, number[np.asarray(triangles)], on.xy[nodes])
    sigma = np.sqrt(bend.variance)
    z = np.abs(bend.value) / np.where(sigma > 0, sigma, np.inf)
    sure = (z > np.sqrt(2 * np.log(len(nodes)))) & (bend.value < 0.5 * light[nodes])
    off_by = ratio[nodes] - 1 / np.where(sure, light[nodes] - bend.value, light[nodes])
    extra = np.maximum(bend.variance - 2 * bend.with_value, 0.0) * ratio[nodes] ** 4 + off_by**2
    taken[nodes], added[nodes] = np.where(sure, off_by, 0.0), np.where(sure, extra, 0.0)
    return taken, added
