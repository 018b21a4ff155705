"""Whether points that belong on a surface lie on it, and if not, what motion or size of the surface brings it to them.

A grid in another frame than the table of markers maps every picture beside its place, and no residual of the markers
tells: they never touch the grid. Distances from the surface do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import permutations, product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.geometry import Pose, Similarity
from windmark.resection.facets import bulge
from windmark.resection.mirrored import Mirrored, mirrored
from windmark.resection.nearest import Search, nearest_weights
from windmark.scene import Mesh

Array = NDArray[np.float64]

ROUNDING = 2e-5
"""Part of the surface's size below which distances are those of its facets and of five-digit files."""
FAR = 0.25
"""Part of its size beyond which it does not matter how far off a point is."""
NEAR = 0.02
"""Points farther than this part of its size from the surface belong to something else, and do not move it."""
LEAST = 8
"""Points that tell a motion (six numbers) from scatter."""
STEPS, FREE = 12, 0.1
"""Steps of the fit; what it may move the surface by is of the order of this part of its size, in each direction."""
SCALE, SHIFT = 0.1, 0.1
"""A fit that needs another size, or moves the surface, by a larger part is none: it slid away."""
OFF = 1e-3
"""Part of its size from which most points are not on the surface: a pixel of a thousand across it."""
STRAIGHT, ALIKE = 0.95, 0.5
"""A point is above or below a surface where the way to it and the surface's normal have at least this cosine (else it
is beside the surface's end: a grid may be of a part), and where its own normal and the surface's have that (else it is
on what stands on the surface, or on a thin part's other side, which is not in the grid)."""
MOST = 400
"""Points that are asked, evenly taken from more."""
ASKED = 40
"""Points that are asked whether exchanged axes bring them onto it."""


@dataclass(frozen=True)
class Seat:
    """How N points lie on a surface of a size.

    Parameters
    ----------
    distance : (N,) of each point from the surface; of some of them where there are very many. Where that asks for a
        reason, from what is between its facets and the curved surface that they stand for
    size : of the surface, `Mesh.size`
    moved : brings the surface to the points; None where no motion explains their distances better than scatter
    lead : nats by which it does
    shift : root mean square length by which it moves the surface at the points, as far as they tell
    left : root mean square distance of the points near the surface once it is moved
    axes : exchange of axes (3, 3) of the surface that brings the points onto it, mirrored (determinant -1) where no
        turn does; None where none does
    off : points, of those given, that are above or below the surface on which they should be
    by : how much, for each of them
    hanging : points, of those given, that are far beside the surface: in the air, or on what the grid has not
    apart : how far, for each of them; a quarter of the size for all that are farther
    mirror : the mirror image of the surface that goes through those which it is beside; None where none does
    """

    distance: Array
    size: float
    moved: Similarity | None = None
    lead: float = 0.0
    shift: float = 0.0
    left: float = 0.0
    axes: NDArray[np.int64] | None = None
    off: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    by: Array = field(default_factory=lambda: np.zeros(0))
    hanging: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    apart: Array = field(default_factory=lambda: np.zeros(0))
    mirror: Mirrored | None = None

    @property
    def most(self) -> float:
        """Distance beyond which three quarters of the points are: a grid may be of a part of the model only."""
        return float(np.quantile(self.distance, 0.25))


def seat(
    mesh: Mesh, xyz: ArrayLike, normal: ArrayLike | None = None, searched: Callable[[], Search] | None = None
) -> Seat:
    """How points (N, 3) lie on the surface that they should lie on.

    Parameters
    ----------
    mesh : the surface
    xyz : (N, 3) at least one point, all finite
    normal : (N, 3) of the surface at the points, NaN where not known; None for none
    searched : makes the search of the surface, where something else wants it, too

    Returns
    -------
    Seat; without a motion for fewer than eight points near the surface, and where they are on it already

    Raises
    ------
    ValueError
        For a wrong shape, or a mesh without triangles.

    Notes
    -----
    Points to planes: each step takes the distance along the normal of the nearest triangle as linear in the motion
    (Chen and Medioni, Image and Vision Computing 10, 1992). A motion, alone and with a scale, has to lead over scatter
    by more than its numbers cost (Schwarz, Ann. Statist. 6, 1978). What slides along a plane or about an axis is told
    by nothing, and stays.
    """
    points = np.asarray(xyz, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise UsageError(f"seat: xyz must be (N, 3) with N at least 1, got {points.shape}")
    facing = np.full(points.shape, np.nan) if normal is None else np.asarray(normal, dtype=float)
    if facing.shape != points.shape:
        raise UsageError(f"seat: normal must be {points.shape} as xyz, got {facing.shape}")
    every, size = -(-len(points) // MOST), mesh.size
    points, facing = points[::every], facing[::every]
    rough = _to_corners(mesh, points)
    if (rough < 2 * ROUNDING * size).all():
        return Seat(rough, size)
    search = Search(mesh) if searched is None else searched()
    distance, place, towards = _onto(search, points, FAR * size)
    off = np.flatnonzero(_is_off(points - place, towards, facing, size))
    close = distance < NEAR * size
    hanging = np.flatnonzero(~close)
    found = Seat(distance, size, off=every * off, by=distance[off], hanging=every * hanging, apart=distance[hanging])
    near, tried = points[close], []
    if len(near) >= LEAST and np.sqrt((distance[close] ** 2).mean()) > 2 * ROUNDING * size:
        tried = [_brought(search, near, size, numbers) for numbers in (6, 7)]
        tried = [one for one in tried if one.lead > 0 and one.left < 0.5 * OFF * size]
    if tried or len(off) or len(hanging) or found.most > OFF * size:
        beyond = _beyond_facets(mesh, search, points, distance)
        if tried:
            best = max(tried, key=lambda t: t.lead)
            before, after = (max(float(np.sqrt((d[close] ** 2).mean())), ROUNDING * size) for d in (distance, beyond))
            if best.lead > len(near) * np.log(before / after):
                return replace(found, moved=best.moved, lead=best.lead, shift=best.shift, left=best.left)
        still = off[beyond[off] > OFF * size]
        found = replace(found, distance=beyond, off=every * still, by=beyond[still])
        found = replace(found, mirror=_mirrored(mesh, search, points, beyond))
    return replace(found, axes=_exchanged(search, points, size)) if found.most > OFF * size else found


def _mirrored(mesh: Mesh, search: Search, points: Array, distance: Array) -> Mirrored | None:
    """See `mirrored`; only what lies off the surface by more than its facets and the table's rounding tells it."""
    size = mesh.size

    def from_it(some: Array) -> Array:
        apart = _onto(search, some, NEAR * size)[0]
        return _beyond_facets(mesh, search, some, apart, NEAR)

    return mirrored(mesh, points, distance > OFF * size, OFF * size, from_it)


def _beyond_facets(mesh: Mesh, search: Search, points: Array, distance: Array, limit: float = FAR) -> Array:
    """(N,) distance from what lies between the facets and the curved surface that they stand for: what is on that one
    is above them, the more the coarser the grid is. Of points farther than a part ``limit`` of the size it is as given.
    """
    asked = np.flatnonzero(distance < limit * mesh.size)
    found = [search.nearest(p, np.full(3, np.nan), "", limit * mesh.size) for p in points[asked]]
    there = np.array([k for k, one in zip(asked, found, strict=True) if one is not None], np.int64)
    at = [one for one in found if one is not None]
    out = distance.copy()
    if not at:
        return out
    triangle, weights, foot = np.array([o[0] for o in at]), np.array([o[1] for o in at]), np.array([o[2] for o in at])
    height = np.einsum("nk,nk->n", points[there] - foot, search.normal[triangle])
    above = bulge(mesh, triangle, weights)
    within = np.where(height * above > 0, np.minimum(np.abs(height), np.abs(above)), 0.0)
    out[there] = np.maximum(distance[there] - within, 0.0)
    return out


def _is_off(way: Array, towards: Array, facing: Array, size: float) -> NDArray[np.bool_]:
    """Whether points (N) are above or below the surface on which they should be.

    ``way`` from the surface, its normal ``towards`` and the points' own, ``facing``, are (N, 3). High above it is what
    the grid may lack; far inside of it is nothing.
    """
    length, height = np.linalg.norm(way, axis=1), np.einsum("nk,nk->n", way, towards)
    known = np.isfinite(facing).all(axis=1)
    alike = np.einsum("nk,nk->n", facing, towards) > ALIKE * np.linalg.norm(facing, axis=1)
    reach = np.where(known & alike & (height < 0), FAR, NEAR) * size
    straight = np.abs(height) > STRAIGHT * length
    return np.asarray((length > OFF * size) & (length < reach) & straight & (alike | ~known))


def _to_corners(mesh: Mesh, points: Array) -> Array:
    """(N,) distance to the triangles at the nearest node: the surface is no farther. Quick where points lie on it."""
    from scipy.spatial import cKDTree

    count = np.bincount(mesh.triangles.ravel(), minlength=len(mesh.vertices))
    used = np.flatnonzero((count > 0) & np.isfinite(mesh.vertices).all(axis=1))
    if not len(used):
        return np.full(len(points), np.inf)
    node = used[cKDTree(mesh.vertices[used], balanced_tree=False, compact_nodes=False).query(points)[1]]
    asked = np.zeros(len(mesh.vertices), bool)
    asked[node] = True
    mine = np.flatnonzero(asked[mesh.triangles].any(axis=1))
    out = np.empty(len(points))
    for k, (p, n) in enumerate(zip(points, node, strict=True)):
        corners = mesh.vertices[mesh.triangles[mine[(mesh.triangles[mine] == n).any(axis=1)]]]
        weights = nearest_weights(corners, p)
        place = np.einsum("nk,nkj->nj", np.column_stack([1 - weights.sum(axis=1), weights]), corners)
        out[k] = np.sqrt(((place - p) ** 2).sum(axis=1).min())
    return out


def _onto(search: Search, points: Array, limit: float) -> tuple[Array, Array, Array]:
    """Distance (N,) to the surface, the nearest place (N, 3) and the normal (N, 3) there; ``limit`` away where none."""
    distance, place, normal = np.full(len(points), limit), points.copy(), np.zeros_like(points)
    for k, p in enumerate(points):
        found = search.nearest(p, np.full(3, np.nan), "", limit)
        if found is not None:
            distance[k], place[k], normal[k] = found[3], found[2], search.normal[found[0]]
    return distance, place, normal


def _brought(search: Search, points: Array, size: float, numbers: int) -> Seat:
    """With the motion (6 numbers), or motion and scale (7), of the surface; no lead where the fit slid away."""
    start, middle = points, points.mean(axis=0)
    total = Similarity(1.0, np.eye(3), np.zeros(3))
    floor = ROUNDING * size
    before = 0.0
    for step in range(STEPS):
        distance, place, normal = _onto(search, points, NEAR * 4 * size)
        if not step:
            before = float(np.sqrt((distance**2).mean()))
        off, arm = np.einsum("nk,nk->n", normal, points - place), points - middle
        slopes = np.column_stack([np.cross(arm, normal) / size, normal, np.einsum("nk,nk->n", arm, normal) / size])
        noise = max(float(np.sqrt((distance**2).mean())), floor)
        design = np.vstack([slopes[:, :numbers] / noise, np.eye(numbers) / (FREE * size)])
        wanted = np.concatenate([-off / noise, np.zeros(numbers)])
        by = np.zeros(7)
        by[:numbers] = np.linalg.lstsq(design, wanted, rcond=None)[0]
        turn, factor = Pose.exp(np.r_[by[:3] / size, np.zeros(3)]).rotation, 1 + by[6] / size
        one = Similarity(factor, turn, middle + by[3:6] - factor * turn @ middle)
        points, total, middle = one.apply(points), one @ total, one.apply(middle)
        if np.abs(by).max() < 1e-7 * size:
            break
    after = float(np.sqrt((_onto(search, points, NEAR * 4 * size)[0] ** 2).mean()))
    n = len(points)
    lead = n * np.log(max(before, floor) / max(after, floor)) - 0.5 * numbers * np.log(n)
    shift = float(np.sqrt(((points - start) ** 2).sum(axis=1).mean()))
    sound = abs(total.scale - 1) < SCALE and shift < SHIFT * size
    return Seat(np.zeros(0), size, total.inverse(), float(lead) if sound else 0.0, shift, after)


def _exchanged(search: Search, points: Array, size: float) -> NDArray[np.int64] | None:
    """The turn of the surface's axes by right angles that brings the points onto it; None where no single one does.

    Two columns that are exchanged leave a mirrored frame: such ones are tried where no turn is right, as of a symmetric
    body both are.
    """
    some = points[:: max(1, len(points) // ASKED)]
    for hand in (1, -1):
        fit = []
        for turn in _turns(hand):
            # The surface is turned by it: the points by its inverse.
            apart = _onto(search, some @ turn, NEAR * size)[0]
            fit.append((float(np.median(apart)), turn))
        fit.sort(key=lambda f: f[0])
        alone = fit[0][0] < 0.5 * fit[1][0] or fit[1][0] < ROUNDING * size  # symmetric bodies: any of them
        if fit[0][0] < OFF * size:
            return fit[0][1] if alone else None
    return None


def _turns(hand: int) -> list[NDArray[np.int64]]:
    """The turns by right angles; with ``hand`` -1 the exchanges of axes with signs that leave a mirrored frame."""
    out = []
    for order in permutations(range(3)):
        for signs in product((1, -1), repeat=3):
            turn = np.eye(3, dtype=np.int64)[list(order)] * np.array(signs)[:, None]
            only_signs = order == (0, 1, 2)  # the frame itself, or mirror images, which `mirrored` has
            if round(np.linalg.det(turn)) == hand and not (only_signs and (hand < 0 or all(s > 0 for s in signs))):
                out.append(turn)
    return out
