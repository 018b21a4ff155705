"""How wrong the fill of what was not seen of a volume may be: measured where it was seen, as deep from its rim."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.paint.filling import fill_smoothly
from windmark.paint.modes import NodeField
from windmark.paint.surface import Surface
from windmark.scene import Mesh

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DEEPEST = 30
"""Nodes in a row from a gap's rim to its middle up to which a rim as wide is hidden and filled, to compare."""
MOST = 0.5
"""Part of a volume's seen nodes that may be hidden for it."""


def guesses_of(mesh: Mesh, cp: NodeField, own: Mask, surface: Surface) -> Array:
    """(V, 4) errors of the filled nodes of a volume, each column one sigma: in common, and linear along x, y and z.

    Parameters
    ----------
    own : (T,) the volume's triangles
    surface : of the mesh

    Notes
    -----
    Each column has a quarter of the variance: a gap along an edge is wrong by nearly the same everywhere, as the field
    rises or falls towards it all along. The variance is what the seen nodes nearest to the gap show, when as many of
    them in a row as the gap is deep are hidden and filled with it; where that would be most of the volume, or the gap
    has no end, the volume's own scatter of Cp, which is never exceeded.
    """
    nodes = np.zeros(len(cp), bool)
    nodes[mesh.triangles[own].ravel()] = True
    out = np.zeros((len(cp), 4))
    missing = nodes & ~cp.known
    if not missing.any():
        return out
    off = mesh.vertices[missing] - mesh.vertices[missing].mean(axis=0)
    spread = np.sqrt((off**2).mean(axis=0))
    shape = np.column_stack([np.ones(len(off)), off / np.where(spread > 1e-9 * mesh.size, spread, np.inf)])
    scatter = float(np.std(cp.value[nodes & cp.known])) if (nodes & cp.known).any() else 0.0
    out[missing] = 0.5 * min(_by_the_rim(mesh, cp, own, missing, surface), scatter) * shape
    return out


def _by_the_rim(mesh: Mesh, cp: NodeField, own: Mask, missing: Mask, surface: Surface) -> float:
    """Root mean square error, noise in it, of a fill as deep as the missing nodes; infinite where none can be tried."""
    at, t = surface.place, surface.triangles[own]
    gap, seen = np.zeros(len(surface.first), bool), np.zeros(len(surface.first), bool)
    gap[at[missing]] = True
    seen[at[cp.known & (at >= 0)]] = True
    gap &= ~seen
    reached, hidden = seen, gap
    for _ in range(DEEPEST):
        if not (gap & ~reached).any():
            break
        reached, hidden = _grown(t, reached), _grown(t, hidden)
    else:
        return float("inf")
    ours = np.zeros(len(seen), bool)
    ours[t.ravel()] = True
    hidden &= seen & ours
    left = seen & ours & ~hidden
    if not hidden.any() or left.sum() < (1 - MOST) * (seen & ours).sum():
        return float("inf")
    # What has no seen node left beside it (a strip between two gaps) is not tried.
    joined = left
    for _ in range(2 * DEEPEST):
        joined = _grown(t, joined) & (left | hidden | gap)
    test, asked = (np.where(at >= 0, of[at], False) for of in (hidden & joined, (hidden | gap) & joined))
    test &= cp.known
    if not test.any():
        return float("inf")
    seen_less = replace(cp, value=np.where(np.where(at >= 0, hidden[at], False), np.nan, cp.value))
    got = fill_smoothly(mesh, seen_less, asked, surface=surface)
    return float(np.sqrt(np.mean((got.value - cp.value)[test] ** 2)))


def _grown(triangles: NDArray[np.int64], places: Mask) -> Mask:
    """With all that lie in a triangle with one of them."""
    out = places.copy()
    out[triangles[places[triangles].any(axis=1)].ravel()] = True
    return out
