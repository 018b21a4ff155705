"""All pixels of the surface round a node: what they say of the value at the node, and how the value changes there."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.resection.pixelmap import PixelMap
from windmark.resection.visibility import NodeView

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

WORST = 1e-3
"""Pixels whose places' covariance has eigenvalues in a smaller ratio lie on a line: they tell no slope."""


@dataclass(frozen=True, eq=False)
class Footprints:
    """Which pixels belong to which node: each to the nearest corner of the triangle that it sees, none to two nodes.

    Parameters
    ----------
    pixel : (P,) row-major number of each pixel
    node : (P,) its node
    offset : (P, 2) from the node to the pixel's centre in the image
    nodes : V
    size_px : (width, height)
    """

    pixel: Ints
    node: Ints
    offset: Array
    nodes: int
    size_px: tuple[int, int]

    @property
    def count(self) -> Ints:
        """(V,) pixels of each node."""
        return np.bincount(self.node, minlength=self.nodes)


@dataclass(frozen=True, eq=False)
class FootprintValues:
    """A picture at the nodes, each with a plane through its own pixels; NaN where these do not tell one.

    Parameters
    ----------
    value, variance : (V,) at the node, and of its noise
    slope : (V, 2) per pixel
    bent : (V,) part of the value that was taken off because the picture is bent within the cell: a plane through a
        hollow lies above its bottom
    planes : those that they are, where the bend was left in; else None
    """

    value: Array
    variance: Array
    slope: Array
    bent: Array
    planes: FootprintPlanes | None


def footprints(pixels: PixelMap, view: NodeView, use: ArrayLike | None = None) -> Footprints:
    """Give every pixel to the node that it lies nearest to on its triangle.

    Parameters
    ----------
    pixels, view : of the same grid and view; only visible nodes get pixels
    use : (H, W) bool, pixels that may count; None: all that see the surface

    Notes
    -----
    Nearest in the surface's own coordinates (largest barycentric weight): a node's cell is then about its dual cell of
    the grid, and where a coarse grid is seen obliquely it is as oblique. Two nodes never share a pixel, so their noise
    is independent.
    """
    if len(view) != len(pixels.mesh.vertices):
        raise ValueError(f"footprints: view must have {len(pixels.mesh.vertices)} nodes, got {len(view)}")
    good = pixels.valid if use is None else pixels.valid & np.asarray(use, bool)
    number = np.flatnonzero(good)
    second, third = pixels.barycentric.reshape(-1, 2)[number].T
    corner = np.argmax(np.stack([1 - second - third, second, third]), axis=0)
    node = pixels.mesh.triangles[pixels.triangle.ravel()[number], corner].astype(np.int64)
    kept = view.visible[node]
    number, node = number[kept], node[kept]
    width = pixels.camera.size_px[0]
    at = np.stack([number % width, number // width], axis=1)
    return Footprints(number, node, at - view.xy[node], len(view), pixels.camera.size_px)


def footprint_values(
    image: ArrayLike, variance: ArrayLike, cells: Footprints, triangles: ArrayLike, xy: ArrayLike, *,
    straight: bool = False,
) -> FootprintValues:  # fmt: skip
    """Value and slope at the nodes by a plane through each node's pixels, and what neighbours say of its bend.

    Parameters
    ----------
    image, variance : (H, W) values, NaN for pixels that do not count, and the variance of their noise
    cells : see `footprints`
    triangles : (T, 3) of the grid: which nodes are neighbours
    xy : (V, 2) the nodes in the image
    straight : the bend stays in the values, for a ratio of pictures in which light is bent alike

    Returns
    -------
    FootprintValues. Exact for a field that is linear within a cell, whatever the cell's shape and whichever of its
    pixels are missing. NaN for nodes with fewer than three pixels, or whose pixels lie on a line.

    Notes
    -----
    A plane by least squares with equal weights is a weighted sum of the pixels, sum(w v). Of a field with the second
    derivatives H it is off by sum(w o'Ho) / 2, o the pixels' offsets. H follows from the neighbours' values; as it is
    noisy itself the correction c counts by 1 - var c / c^2, not at all below its sigma (the empirical Bayes estimate,
    Efron and Morris, JASA 68, 1973): it costs little noise where nothing bends.
    """
    pixels, noise, shape = np.asarray(image, float), np.asarray(variance, float), cells.size_px[::-1]
    if pixels.shape != shape or noise.shape != shape:
        raise UsageError(f"footprint_values: image and variance must be {shape}, got {pixels.shape} and {noise.shape}")
    plane, nodes = _of_nodes(pixels, noise, cells)
    bent = np.zeros(cells.nodes)
    if not straight:
        number = np.full(cells.nodes, -1, np.int64)
        number[nodes] = np.arange(len(nodes))
        bend = plane_bend(plane, number[np.asarray(triangles)], np.asarray(xy, float)[nodes])
        part = np.maximum(0.0, 1 - bend.scatter / np.where(bend.value == 0, np.inf, bend.value**2))
        more = part**2 * bend.variance - 2 * part * bend.with_value
        plane = replace(plane, value=plane.value - part * bend.value, variance=plane.variance + more)
        bent[nodes] = part * bend.value
    at = {f.name: _spread(getattr(plane, f.name), nodes, cells.nodes)
          for f in fields(FootprintPlanes) if straight or f.name in ("value", "variance", "slope")}  # fmt: skip
    return FootprintValues(
        at["value"], at["variance"], at["slope"], bent, FootprintPlanes(**at) if straight else None
    )  # fmt: skip


def _spread(of: Array, nodes: Ints, count: int) -> Array:
    """Rows of some nodes among those of all, NaN elsewhere."""
    out = np.full((count, *of.shape[1:]), np.nan)
    out[nodes] = of
    return out


def _of_nodes(pixels: Array, noise: Array, cells: Footprints) -> tuple[FootprintPlanes, Ints]:
    """Planes of the nodes with pixels enough alone: where a grid is finer than the pixels those are few of many."""
    v = pixels.ravel()[cells.pixel]
    on = np.isfinite(v)
    nodes = np.flatnonzero(np.bincount(cells.node[on], minlength=cells.nodes) >= 3)
    number = np.full(cells.nodes, -1, np.int64)
    number[nodes] = np.arange(len(nodes))
    on &= number[cells.node] >= 0
    of = number[cells.node[on]]
    return _planes(v[on], noise.ravel()[cells.pixel[on]], of, cells.offset[on], len(nodes)), nodes


@dataclass(frozen=True, eq=False)
class FootprintPlanes:
    """Planes through V nodes' pixels; NaN where there is none.

    Parameters
    ----------
    value, variance : (V,) at the node, and of its noise
    slope : (V, 2)
    unit : (V, 3, 3) covariance of value and slope for pixels of variance 1
    noise, scatter : (V,) variance of a pixel: the mean stated one; as they lie about the plane, grain of the paint too
    moments : (V, 3) sum(w o o'): xx, xy, yy
    """

    value: Array
    variance: Array
    slope: Array
    unit: Array
    noise: Array
    scatter: Array
    moments: Array


def _planes(v: Array, noise: Array, node: Ints, offset: Array, nodes: int) -> FootprintPlanes:
    def total(of: Array | None = None) -> Array:
        return np.bincount(node, of, minlength=nodes).astype(float)

    n = total()
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.stack([total(offset[:, k]) for k in range(2)], axis=1) / n[:, None]
        d = offset - mean[node]
        xx, xy, yy = total(d[:, 0] ** 2), total(d[:, 0] * d[:, 1]), total(d[:, 1] ** 2)
        det = xx * yy - xy**2
        # Ratio of the eigenvalues is about 4 det / trace^2 where it is small.
        bad = ~(4 * det > WORST * (xx + yy) ** 2)
        inverse = np.stack([yy, -xy, -xy, xx], axis=1).reshape(-1, 2, 2) / det[:, None, None]
        inverse[bad] = np.nan
        middle = total(v) / n
        dv = v - middle[node]
        rise = np.stack([total(d[:, k] * dv) for k in range(2)], axis=1)
        slope = np.einsum("nij,nj->ni", inverse, rise)
        weight = 1 / n[node] - np.einsum("pi,pij,pj->p", mean[node], inverse[node], d)
        moments = np.stack([total(weight * offset[:, i] * offset[:, j]) for i, j in ((0, 0), (0, 1), (1, 1))], axis=1)
        grey = total(noise) / n
        left = (total(dv**2) - (slope * rise).sum(axis=1)) / np.maximum(n - 3, 1)
        unit = np.empty((nodes, 3, 3))
        unit[:, 0, 0], unit[:, 1:, 1:] = total(weight**2), inverse
        unit[:, 0, 1:] = unit[:, 1:, 0] = -np.einsum("nij,nj->ni", inverse, mean)
    return FootprintPlanes(
        middle - (slope * mean).sum(axis=1), total(weight**2 * noise), slope, unit, grey,
        np.where(n > 3, np.fmax(left, grey), grey), moments,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class PlaneBend:
    """By how much planes are off at their nodes, (V,) each; 0 where neighbours do not tell.

    Parameters
    ----------
    value, variance : of the noise of the pixels
    with_value : covariance with the plane's value
    scatter : variance by what the pixels scatter, grain of the paint too
    """

    value: Array
    variance: Array
    with_value: Array
    scatter: Array


def plane_bend(plane: FootprintPlanes, triangles: Ints, xy: Array) -> PlaneBend:
    """By how much the planes of V nodes are off at their nodes, as their neighbours (in ``triangles`` (T, 3)) tell.

    v_j - v_i - g_i d = d'Hd / 2 for the neighbours j at the distances d: three unknowns, least squares. What is asked
    of H is one number, so that it is a weighted sum of the left sides, with the weights a.
    """
    known = np.isfinite(plane.value)
    i, j = _neighbours(triangles, known)
    count, d = len(xy), xy[j] - xy[i]
    basis = np.stack([0.5 * d[:, 0] ** 2, d[:, 0] * d[:, 1], 0.5 * d[:, 1] ** 2], axis=1)

    def total(of: Array) -> Array:
        flat = of.reshape(len(i), int(np.prod(of.shape[1:])))
        sums = [np.bincount(i, flat[:, k], minlength=count).astype(float) for k in range(flat.shape[1])]
        return np.stack(sums, axis=1).reshape(count, *of.shape[1:])

    normal = total(basis[:, :, None] * basis[:, None, :])
    told = np.linalg.eigvalsh(normal)[:, 0] > WORST**2 * np.trace(normal, axis1=1, axis2=2)
    asked = np.zeros((count, 3))
    half = plane.moments * [0.5, 1.0, 0.5]
    asked[told] = np.linalg.solve(normal[told], half[told][..., None])[..., 0]
    a = (asked[i] * basis).sum(axis=1)
    rise = plane.value[j] - plane.value[i] - (plane.slope[i] * d).sum(axis=1)
    # By how much c changes with the node's own value and slope; all others' values are independent of these.
    own = -np.column_stack([total(a), total(a[:, None] * d)])
    by_value, by_plane = np.nan_to_num(plane.unit[:, 0]), np.nan_to_num(plane.unit)
    mine, theirs = np.einsum("ni,nij,nj->n", own, by_plane, own), a**2 * by_value[j, 0]
    noise, scatter = np.nan_to_num(plane.noise), np.nan_to_num(plane.scatter)
    return PlaneBend(
        total(a * rise), total(theirs * noise[j]) + mine * noise, (own * by_value).sum(axis=1) * noise,
        total(theirs * scatter[j]) + mine * scatter,
    )  # fmt: skip


def _neighbours(triangles: Ints, known: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """Pairs of nodes (both ways round) with an edge between them, both known; a corner of -1 is no node."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    edges = edges[(edges >= 0).all(axis=1)]
    edges = np.sort(edges[known[edges].all(axis=1)], axis=1)
    number = np.unique(edges[:, 0] * len(known) + edges[:, 1])
    i, j = number // len(known), number % len(known)
    return np.concatenate([i, j]), np.concatenate([j, i])
