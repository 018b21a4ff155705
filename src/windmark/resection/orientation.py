"""Turn the triangles of a mesh outward, block by block, whatever the file's habits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.resection.chains import weld
from windmark.resection.visibility import checked_tolerance
from windmark.scene import Mesh

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

# A sheet whose normals cancel to less than this part of its size has no inside of its own.
_FLAT = 1e-6


def orient_outward(mesh: Mesh, *, outside: ArrayLike | None = None, tolerance: float | None = None) -> Mesh:
    """A mesh whose triangles are counter-clockwise seen from outside, as `Mesh` promises.

    Structured files give each block an orientation of its own. Triangles that meet at an edge are
    turned alike (across blocks too, where they meet within ``tolerance``), so each connected sheet has
    one orientation left to choose: a sheet is turned so that it encloses positive volume, an open one
    (a half model) as seen from its own centroid.

    Parameters
    ----------
    mesh : any orientation
    outside : (3,) a point in the air, such as a camera's station. It decides for sheets that enclose
        nothing (a flat plate); without it they keep the orientation that most of their area has
    tolerance : distance at which nodes of different blocks are the same; 1e-5 of the mesh's diagonal

    Returns
    -------
    Mesh with the same nodes, blocks and order of triangles; some triangles have their second and third
    node exchanged. Sheets with only one side (a Moebius strip) are left as they are. Edges in which more than two
    triangles meet do not connect. A shell inside another is turned outward by itself.
    """
    if not len(mesh.triangles):
        return mesh
    toward = None if outside is None else np.asarray(outside, dtype=float)
    if toward is not None and (toward.shape != (3,) or not np.isfinite(toward).all()):
        raise ValueError(f"orient_outward: outside must be three finite numbers, got {outside!r}")
    number, _ = weld(np.nan_to_num(mesh.vertices), checked_tolerance(tolerance, mesh, "orient_outward"))
    sheet, turned = _consistent(number[mesh.triangles])
    flip = turned ^ _inward(mesh, sheet, turned, toward)[sheet]
    triangles = mesh.triangles.copy()
    triangles[flip, 1], triangles[flip, 2] = mesh.triangles[flip, 2], mesh.triangles[flip, 1]
    return replace(mesh, triangles=triangles)


def _consistent(corners: Ints) -> tuple[Ints, NDArray[np.bool_]]:
    """Sheet number (T,) of each triangle, and whether it must be turned to agree with its sheet.

    Each triangle is two nodes of a graph, as it is and turned; neighbours connect the copies that
    agree. A sheet then shows up as two mirrored components; a one-sided sheet as a single one.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(corners)
    first, second, opposed = _neighbours(corners)
    # Triangles that run through their common edge in opposite directions agree as they are.
    other = np.where(opposed, second, second + count)
    mirror = np.where(opposed, second + count, second)
    rows, columns = np.concatenate([first, first + count]), np.concatenate([other, mirror])
    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(2 * count, 2 * count))
    _, label = connected_components(graph, directed=False)
    as_is, flipped = label[:count], label[count:]
    _, sheet = np.unique(np.minimum(as_is, flipped), return_inverse=True)
    return sheet, as_is > flipped


def _neighbours(corners: Ints) -> tuple[Ints, Ints, NDArray[np.bool_]]:
    """Pairs of triangles that alone share an edge, and whether they run through it in opposite directions."""
    tail, head = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    owner = np.repeat(np.arange(len(corners)), 3)
    real = np.flatnonzero(tail != head)
    tail, head, owner = tail[real], head[real], owner[real]
    forward = tail < head
    low, high = np.where(forward, tail, head), np.where(forward, head, tail)
    order = np.lexsort((high, low))
    low, high, owner, forward = low[order], high[order], owner[order], forward[order]
    begins = np.flatnonzero(np.append(True, (np.diff(low) != 0) | (np.diff(high) != 0)))
    pair = begins[np.diff(np.append(begins, len(low))) == 2]
    return owner[pair], owner[pair + 1], forward[pair] != forward[pair + 1]


def _inward(mesh: Mesh, sheet: Ints, turned: NDArray[np.bool_], outside: Array | None) -> NDArray[np.bool_]:
    """Per sheet: whether it is inside out once its triangles agree."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    sign = np.where(turned, -1.0, 1.0)
    normal = 0.5 * np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    middle = (a + b + c) / 3

    def total(values: Array) -> Array:
        return np.bincount(sheet, weights=values).astype(float)

    size = total(area)
    safe = np.where(size > 0, size, 1.0)
    center = np.stack([total(area * middle[:, k]) for k in range(3)], axis=1) / safe[:, None]
    volume = total(sign * np.einsum("tk,tk->t", normal, middle - center[sheet])) / 3
    flat = np.abs(volume) <= _FLAT * size**1.5
    # What encloses nothing follows the point in the air, or else the majority of its own area.
    plain = total(sign * area)
    if outside is not None:
        facing = total(sign * np.einsum("tk,tk->t", normal, outside - middle))
        plain = np.where(facing != 0, facing, plain)
    return np.where(flat, plain < 0, volume < 0)
