"""Whether normals at points of a surface point out of the body that it encloses, told by what lies behind and before.

The winding of a grid's triangles does not tell: structured grids have any. The other side of the body does: a line
through a point of its surface meets it on the way in, and nothing on the way out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.scene import Mesh

Array = NDArray[np.float64]

THICK = 1e-3
"""Part of the surface's size: what is nearer to the point than that is the surface that it is on."""


def outward(mesh: Mesh, xyz: Array, normal: Array) -> NDArray[np.int64]:
    """(N,) 1 where a normal (N, 3) points out of the surface at its point (N, 3), -1 into it, 0 where nothing tells.

    On either way along the normal the triangles are counted that the line meets. The way with fewer of them leads out:
    a wall all round is met on both. On a sheet without a thickness both are alike, and without a normal (NaN) as well.
    """
    corner = mesh.vertices[mesh.triangles]
    first, along, across = corner[:, 0], corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    out = np.zeros(len(xyz), np.int64)
    for k in np.flatnonzero(np.isfinite(normal).all(axis=1)):
        away = _crossings(first, along, across, xyz[k], normal[k] / np.linalg.norm(normal[k]))
        away = away[np.abs(away) > THICK * mesh.size]
        out[k] = np.sign((away < 0).sum() - (away > 0).sum())
    return out


def _crossings(first: Array, along: Array, across: Array, point: Array, direction: Array) -> Array:
    """Places on a line, from a point of it, where it goes through triangles (T, 3): Moeller and Trumbore, Journal of
    Graphics Tools 2 (1997).
    """
    upright = np.cross(direction, across)
    scale = np.einsum("tk,tk->t", along, upright)
    with np.errstate(divide="ignore", invalid="ignore"):
        from_first = point - first
        u = np.einsum("tk,tk->t", from_first, upright) / scale
        turned = np.cross(from_first, along)
        v = turned @ direction / scale
        met = (u >= 0) & (v >= 0) & (u + v <= 1) & (scale != 0)
        return np.asarray((np.einsum("tk,tk->t", across, turned) / scale)[met])
