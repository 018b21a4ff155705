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
NEAR = 8
"""Nodes of a rim that say the error of a missing node next to them."""
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
    Each column has a quarter of the variance: a gap along an edge is wrong alike all along, as the field rises or falls
    towards it, and by another amount, of another sign, along another edge. So a node's error is what the seen nodes
    next to it show, with their sign, when as many of them in a row as the gap is deep are hidden and filled with it;
    where that would be most of the volume, or the gap has no end, the volume's own scatter of Cp, which is never
    exceeded.
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
    error = _by_the_rim(mesh, cp, own, missing, surface)
    out[missing] = 0.5 * np.clip(scatter if error is None else error, -scatter, scatter).reshape(-1, 1) * shape
    return out


def _by_the_rim(mesh: Mesh, cp: NodeField, own: Mask, missing: Mask, surface: Surface) -> Array | None:
    """(M,) error that the rim next to each missing node shows of a fill as deep as these; None where none can be tried.

    Root mean square of the `NEAR` nearest ones, noise in it, with the sign of their mean.
    """
    from scipy.spatial import cKDTree

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
        return None
    ours = np.zeros(len(seen), bool)
    ours[t.ravel()] = True
    hidden &= seen & ours
    left = seen & ours & ~hidden
    if not hidden.any() or left.sum() < (1 - MOST) * (seen & ours).sum():
        return None
    # What has no seen node left beside it (a strip between two gaps) is not tried.
    joined = left
    for _ in range(2 * DEEPEST):
        joined = _grown(t, joined) & (left | hidden | gap)
    test, asked = (np.where(at >= 0, of[at], False) for of in (hidden & joined, (hidden | gap) & joined))
    test &= cp.known
    if not test.any():
        return None
    seen_less = replace(cp, value=np.where(np.where(at >= 0, hidden[at], False), np.nan, cp.value))
    got = fill_smoothly(mesh, seen_less, asked, surface=surface)
    off = (got.value - cp.value)[test]
    near = cKDTree(mesh.vertices[test]).query(mesh.vertices[missing], k=min(NEAR, len(off)))[1]
    of = off[near.reshape(int(missing.sum()), -1)]
    return np.asarray(np.sqrt((of**2).mean(axis=1)) * np.sign(of.mean(axis=1)))


def _grown(triangles: NDArray[np.int64], places: Mask) -> Mask:
    """With all that lie in a triangle with one of them."""
    out = places.copy()
    out[triangles[places[triangles].any(axis=1)].ravel()] = True
    return out
