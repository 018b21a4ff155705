"""Markers, taps, screws and damage: their nodes are masked, filled from their surroundings, and less sure.

How wrong the fill is, is measured on the surface itself: patches of the same size are laid on sound paint next to each
patch, filled in the same way, and compared with what is there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.paint.filling import fill_smoothly
from windmark.paint.modes import NodeField
from windmark.paint.surface import Surface, joined_surface
from windmark.scene import Mesh
from windmark.scene.shown import check_kinds

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

BESIDE = 2.5
"""Distance of a test patch from its patch, in radii of the two together: clear of it and of its rim."""
TESTS = 6
"""Test patches that are laid round each patch."""
ALIKE = 12
"""Nearest test patches, by place, that say how wrong a patch's fill is."""


@dataclass(frozen=True, eq=False)
class FilledField:
    """A field whose patches were filled.

    Parameters
    ----------
    field : values everywhere; of filled nodes the variance of the fill itself is in ``white``
    filled : (V,) bool, nodes that were filled in
    misfit : (V,) standard deviation of the continuation's own error, 0 where nothing was filled
    tested : test patches on sound paint that the misfit comes from; 0: none could be laid, and the misfit is the
        scatter of the surroundings
    """

    field: NodeField
    filled: Mask
    misfit: Array
    tested: int


def disc_nodes(mesh: Mesh, centres: ArrayLike, radii: ArrayLike, normals: ArrayLike | None = None) -> Ints:
    """Which of D discs on the surface covers each node.

    Parameters
    ----------
    centres, radii : (D, 3) and (D,) or one number; a node within the radius of the centre is covered
    normals : (D, 3) outward; nodes whose own normal points away from it (the other side of a thin wing) are not covered

    Returns
    -------
    (V,) number of the disc, the nearest by its radius, -1 for none
    """
    from scipy.spatial import cKDTree

    c = np.asarray(centres, dtype=float).reshape(-1, 3)
    r = np.broadcast_to(np.asarray(radii, dtype=float), (len(c),))
    if not ((r > 0) & np.isfinite(r)).all() or not np.isfinite(c).all():
        raise UsageError("disc_nodes: centres must be finite and radii above zero")
    out, least = np.full(len(mesh.vertices), -1, np.int64), np.full(len(mesh.vertices), np.inf)
    if not len(c):
        return out
    own = mesh.vertex_normals() if normals is not None else None
    facing = None if normals is None else np.asarray(normals, dtype=float).reshape(-1, 3)
    used = mesh.used
    for k, near in enumerate(cKDTree(mesh.vertices[used]).query_ball_point(c, r)):
        node = used[np.asarray(near, dtype=np.int64)]
        if own is not None and facing is not None and np.isfinite(facing[k]).all():
            node = node[own[node] @ facing[k] > 0]
        distance = np.linalg.norm(mesh.vertices[node] - c[k], axis=1) / r[k]
        nearer = distance < least[node]
        out[node[nearer]], least[node[nearer]] = k, distance[nearer]
    return out


def polygon_nodes(mesh: Mesh, corners: ArrayLike, *, depth: float | None = None) -> Mask:
    """Nodes inside of a polygon drawn on the surface.

    Parameters
    ----------
    corners : (K, 3) in order, K at least 3, about in a plane
    depth : how far from that plane nodes may be; None: half the polygon's mean radius. Nodes whose normal points
        against that of the side on which most of the covered surface lies do not count
    """
    p = np.asarray(corners, dtype=float)
    if p.ndim != 2 or p.shape[1] != 3 or len(p) < 3 or not np.isfinite(p).all():
        raise UsageError(f"polygon_nodes: corners must be (K, 3) finite numbers with K at least 3, got {p.shape}")
    centre = p.mean(axis=0)
    _, size, axes = np.linalg.svd(p - centre)
    if not size[1] > 1e-9 * size[0]:
        raise UsageError("polygon_nodes: the corners lie on one line")
    reach = 0.5 * float(np.linalg.norm(p - centre, axis=1).mean()) if depth is None else depth
    node = mesh.used
    local = (mesh.vertices[node] - centre) @ axes.T
    inside = _inside(local[:, :2], ((p - centre) @ axes.T)[:, :2]) & (np.abs(local[:, 2]) <= reach)
    out = np.zeros(len(mesh.vertices), bool)
    towards = mesh.vertex_normals()[node] @ axes[2]
    near = inside & (np.abs(local[:, 2]) <= 0.5 * reach)
    side = np.sign(np.nansum(towards[near])) or 1.0
    out[node[inside & ~(towards * side <= 0)]] = True
    return out


def _inside(xy: Array, polygon: Array) -> Mask:
    """Points (N, 2) inside of a polygon (K, 2), by the number of its edges to their right."""
    inside = np.zeros(len(xy), bool)
    for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if y0 != y1:
            crosses = (xy[:, 1] >= min(y0, y1)) & (xy[:, 1] < max(y0, y1))
            inside ^= crosses & (xy[:, 0] < x0 + (xy[:, 1] - y0) * (x1 - x0) / (y1 - y0))
    return inside


def fill_patches(mesh: Mesh, field: NodeField, patch: ArrayLike) -> FilledField:
    """Take the nodes of patches out and fill them from their surroundings.

    Parameters
    ----------
    field : (V) values; NaN nodes outside of patches stay NaN
    patch : (V,) number of the patch of each node, -1 for none (`disc_nodes`), or a mask

    Returns
    -------
    FilledField. A filled node's sigma holds the noise that comes through the fill, and the misfit that test patches of
    its size nearby show (root mean square over their nodes). The misfit is taken as independent from node to node.

    Raises
    ------
    DataError
        Where a patch hangs together with no node that has a value.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> y, x = np.mgrid[0:10, 0:10]
    >>> i = (np.arange(9) + 10 * np.arange(9)[:, None]).ravel()
    >>> triangles = np.r_[np.c_[i, i + 1, i + 11], np.c_[i, i + 11, i + 10]]
    >>> plate = wm.Mesh.make(np.c_[x.ravel(), y.ravel(), 0 * x.ravel()], triangles)
    >>> marker = ((x == 4) & (y == 5)).ravel()  # one node lies on a marker
    >>> cp = wm.NodeField.make(np.where(marker, 99.0, 0.1 * x.ravel()), 0.01)
    >>> filled = wm.fill_patches(plate, cp, marker)
    >>> filled.field.value[marker].round(2).tolist(), int(filled.filled.sum())
    ([0.4], 1)
    """
    check_kinds("fill_patches", mesh=(mesh, Mesh), field=(field, NodeField))
    number = np.asarray(patch)
    if number.dtype == bool:
        number = np.where(number, 0, -1)
    if number.shape != (len(mesh.vertices),) or len(field) != len(number):
        raise ValueError(f"fill_patches: field and patch must have {len(mesh.vertices)} nodes, got {len(field)}, "
                         f"{number.shape}")  # fmt: skip
    covered = (number >= 0) & (np.bincount(mesh.used, minlength=len(number)) > 0)
    if not covered.any():
        return FilledField(field, covered, np.zeros(len(field)), 0)
    surface = joined_surface(mesh)
    filled = fill_smoothly(mesh, field, covered, surface=surface)
    centre, radius = _sizes(mesh, number, covered)
    misfit, tested = _misfit(mesh, field, covered, surface, centre, radius, number)
    out = replace(filled, white=filled.white + np.where(covered, misfit**2, 0.0))
    return FilledField(out, covered, np.where(covered, misfit, 0.0), tested)


def _sizes(mesh: Mesh, number: Ints, covered: Mask) -> tuple[Array, Array]:
    """Centre (P, 3) and radius (P,) of each patch, those without nodes NaN."""
    count = int(number.max()) + 1
    of = number[covered]
    n = np.maximum(np.bincount(of, minlength=count), 1)
    xyz = mesh.vertices[covered]
    centre = np.stack([np.bincount(of, xyz[:, k], minlength=count) / n for k in range(3)], axis=1)
    radius = np.zeros(count)
    np.maximum.at(radius, of, np.linalg.norm(xyz - centre[of], axis=1))
    # A patch of one node is as large as what that node stands for.
    area = np.bincount(mesh.triangles.ravel(), np.repeat(np.linalg.norm(mesh.triangle_normals(), axis=1) / 6, 3),
                       minlength=len(covered))  # fmt: skip
    np.maximum.at(radius, of, 0.5 * np.sqrt(area[covered]))
    present = np.bincount(of, minlength=count) > 0
    return np.where(present[:, None], centre, np.nan), np.where(present, radius, np.nan)


def _misfit(
    mesh: Mesh, field: NodeField, covered: Mask, surface: Surface, centre: Array, radius: Array, number: Ints
) -> tuple[Array, int]:
    """(V,) how wrong the fill of each node is, and how many test patches say so."""
    laid = _tests(mesh, field, covered, surface, centre, radius)
    place = np.flatnonzero(np.isfinite(radius))
    size = np.zeros(len(radius))
    if not laid:
        for k in place:
            near = np.linalg.norm(mesh.vertices - centre[k], axis=1) <= 2 * BESIDE * max(radius[k], 1e-12)
            around = field.value[near & ~covered & field.known]
            size[k] = float(np.std(around)) if len(around) else float(np.nanstd(field.value))
    else:
        at, r, off = (np.array([t[i] for t in laid]) for i in range(3))
        for k in place:
            of_size = 3 * np.abs(np.log(r / max(radius[k], 1e-12)))
            distance = np.linalg.norm(at - centre[k], axis=1) / max(radius[k], 1e-12) + of_size
            near = np.argsort(distance, kind="stable")[:ALIKE]
            size[k] = float(np.sqrt(np.mean(off[near])))
    out = np.zeros(len(covered))
    out[covered] = size[number[covered]]
    return out, len(laid)


def _tests(
    mesh: Mesh, field: NodeField, covered: Mask, surface: Surface, centre: Array, radius: Array
) -> list[tuple[Array, float, float]]:
    """Centre, radius and mean squared misfit beyond noise of test patches on sound paint round the patches.

    They are laid in rounds in which none touches another; each round is one fill.
    """
    from scipy.spatial import cKDTree

    sound = np.flatnonzero(~covered & field.known & (np.bincount(mesh.used, minlength=len(covered)) > 0))
    if not len(sound):
        return []
    tree = cKDTree(mesh.vertices[sound])
    blocked = cKDTree(mesh.vertices[covered | ~field.known])
    border = surface.border[np.maximum(surface.place, 0)]
    normals = mesh.vertex_normals()
    found: list[tuple[Array, float, float]] = []
    # What lies under the patches themselves is no paint.
    clean = replace(field, value=np.where(covered, np.nan, field.value))
    for turn in range(TESTS):
        number, laid = np.full(len(covered), -1, np.int64), list[tuple[Array, float]]()
        for k in np.flatnonzero(radius > 0):
            seat = _seat(mesh, centre[k], radius[k], turn, normals, sound, tree)
            if seat is None or blocked.query(mesh.vertices[seat])[0] < 1.2 * radius[k]:
                continue
            # Test patches that touch would be one patch of another size.
            if (number[sound[tree.query_ball_point(mesh.vertices[seat], 1.5 * radius[k])]] >= 0).any():
                continue
            node = sound[tree.query_ball_point(mesh.vertices[seat], radius[k])]
            if border[node].any():
                continue
            number[node] = len(laid)
            laid.append((mesh.vertices[seat], float(radius[k])))
        if not laid:
            continue
        test = number >= 0
        got = fill_smoothly(mesh, clean, test, surface=surface)
        square = (got.value - field.value)[test] ** 2 - got.white[test] - field.white[test]
        sums = np.bincount(number[test], square, minlength=len(laid))
        count = np.bincount(number[test], minlength=len(laid))
        found += [(*laid[k], max(float(sums[k] / count[k]), 0.0)) for k in range(len(laid)) if count[k]]
    return found


def _seat(mesh: Mesh, centre: Array, radius: float, turn: int, normals: Array, sound: Ints, tree: object) -> int | None:
    """The sound node nearest to where a test patch would lie: beside the patch, in the surface."""
    nearest = int(sound[tree.query(centre)[1]])  # type: ignore[attr-defined]
    n = normals[nearest]
    if not np.isfinite(n).all():
        return None
    first = np.cross(n, np.eye(3)[int(np.argmin(np.abs(n)))])
    first /= np.linalg.norm(first)
    angle = 2 * np.pi * turn / TESTS
    at = centre + BESIDE * radius * (np.cos(angle) * first + np.sin(angle) * np.cross(n, first))
    distance, found = tree.query(at)  # type: ignore[attr-defined]
    node = int(sound[found])
    return node if distance < radius and normals[node] @ n > 0.5 else None
