"""The smooth continuation of a field into nodes that have no value, on the surface itself."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.errors import DataError
from windmark.paint.modes import NodeField
from windmark.paint.surface import Surface, joined_surface
from windmark.scene import Mesh

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

PATCH = 400
"""Holes with at most so many known places round them, and none at the surface's border, go on with the slopes of their
surroundings. What is larger is no patch: slopes would lead too far, and the continuation keeps between the values."""
FAINT = 1e-9
"""Weight of the harmonic part that keeps a patch's answer unique where squared Laplacians leave it free."""


def fill_smoothly(mesh: Mesh, field: NodeField, missing: Mask, *, surface: Surface | None = None) -> NodeField:
    """Values of ``missing`` nodes (V,) that continue those round them.

    In small patches inside the surface the field with the smallest sum of squared Laplacians (biharmonic: it goes on
    with the slopes of its surroundings), in other holes the one that is harmonic (it stays between the values round
    it). Both are linear in what is known: modes go through as they are, independent noise by the squares of the
    weights; in other holes that is taken as the mean of the noise round them, which is more than it is.

    Returns
    -------
    NodeField: as given where not missing. Nodes without a value that are not asked for stay without one. The error of
    the continuation itself is *not* in it: see `fill_patches`.

    Raises
    ------
    DataError
        Where missing nodes hang together with no node that has a value.
    """
    surface = joined_surface(mesh) if surface is None else surface
    at = surface.place
    on, wanted = field.known & ~missing & (at >= 0), missing & (at >= 0)
    lap, areas = surface.laplacian
    count = np.bincount(at[on], minlength=len(areas))
    known = count > 0
    places = _sums(np.column_stack([field.value, field.modes]), on, at, len(areas)) / np.maximum(count, 1)[:, None]
    spread = _sums(field.white[:, None], on, at, len(areas))[:, 0] / np.maximum(count, 1) ** 2
    free = np.zeros(len(areas), bool)
    free[at[wanted]] = True
    free &= ~known
    if free.any():
        _solve(surface, lap, areas, free, known, places, spread)
    value, modes, white = field.value.copy(), field.modes.copy(), field.white.copy()
    value[wanted], modes[wanted], white[wanted] = places[at[wanted], 0], places[at[wanted], 1:], spread[at[wanted]]
    return NodeField(value, white, modes, field.names, field.unit)


def _sums(values: Array, on: Mask, at: Ints, count: int) -> Array:
    """(count, K) sums over the nodes of each place."""
    return np.stack([np.bincount(at[on], column[on], minlength=count) for column in values.T], axis=1)


def _solve(surface: Surface, lap: Any, areas: Array, free: Mask, known: Mask, places: Array, spread: Array) -> None:
    """Fill ``places`` (P, 1 + K) and ``spread`` (P,) at the free places."""
    full = _without(lap, ~(free | known))
    f = np.flatnonzero(free)
    part, round_it = _parts(full, f, known)
    if (round_it == 0).any():
        raise DataError(
            f"fill: {int((round_it[part] == 0).sum())} of the missing nodes hang together with no node that has a value"
        )
    border = surface.border
    open_side = np.bincount(part, border[f]) > 0
    small = ((round_it <= PATCH) & ~open_side)[part]
    if small.any():
        _patches(full, areas, f[small], known, places, spread)
    if not small.all():
        _holes(full, f[~small], known, places, spread)


def _parts(full: Any, f: Ints, known: Mask) -> tuple[Ints, Ints]:
    """Which of the free places ``f`` hang together (F,), and how many known places lie round each such part."""
    from scipy.sparse.csgraph import connected_components

    part = connected_components(full[f][:, f], directed=False)[1]
    edge = full[f][:, np.flatnonzero(known)].tocoo()
    ring = np.unique(np.stack([part[edge.row], np.flatnonzero(known)[edge.col]]), axis=1)
    return part, np.bincount(ring[0], minlength=int(part.max()) + 1)


def stranded(mesh: Mesh, field: NodeField, missing: Mask) -> Mask:
    """Which of the ``missing`` nodes (V,) hang together with no node that has a value: `fill_smoothly` refuses them."""
    surface = joined_surface(mesh)
    at, lap = surface.place, surface.laplacian[0]
    known, free = np.zeros((2, lap.shape[0]), bool)
    known[at[field.known & ~missing & (at >= 0)]] = True
    free[at[missing & (at >= 0)]] = True
    free &= ~known
    f, alone = np.flatnonzero(free), np.zeros(lap.shape[0], bool)
    if len(f):
        part, round_it = _parts(_without(lap, ~(free | known)), f, known)
        alone[f] = round_it[part] == 0
    return np.asarray(missing & (at >= 0) & alone[at])


def _without(lap: Any, out: Mask) -> Any:
    """The Laplacian of the surface without some places: what they were is taken off their neighbours' diagonal."""
    from scipy.sparse import diags_array

    keep = diags_array((~out).astype(float))
    cut = (keep @ lap @ keep).tocsr()
    return (cut - diags_array(np.asarray(cut.sum(axis=1)).ravel())).tocsr()


def _holes(lap: Any, f: Ints, known: Mask, places: Array, spread: Array) -> None:
    """Harmonic: every free place is the weighted mean of its neighbours."""
    from scipy.sparse.linalg import splu

    k = np.flatnonzero(known)
    solver = splu((-lap[f][:, f]).tocsc())
    right = lap[f][:, k]
    places[f] = solver.solve(right @ places[k])
    spread[f] = solver.solve(right @ spread[k])


def _patches(lap: Any, areas: Array, f: Ints, known: Mask, places: Array, spread: Array) -> None:
    """Biharmonic, all patches in one sparse system; places of different patches share a column of its right side."""
    from scipy.sparse import diags_array, vstack
    from scipy.sparse.csgraph import connected_components
    from scipy.sparse.linalg import splu

    inside = np.zeros(len(areas), bool)
    inside[f] = True
    near = np.unique(lap[f].indices)
    # A row that holds a free place of a larger hole cannot be used, nor one without area.
    usable = (abs(lap[near]) @ (~(inside | known)).astype(float)) == 0
    rows = near[usable & (areas[near] > 0)]
    # The Laplacian integrated over each place, by the root of its area: sums of squares are integrals.
    root = np.sqrt(np.maximum(areas, areas[areas > 0].min()))
    both = vstack([diags_array(1 / root[rows]) @ lap[rows], diags_array(np.sqrt(FAINT) / root[f]) @ lap[f]]).tocsr()
    own = both[:, f].tocsc()
    normal = (own.T @ own).tocsc()
    part = connected_components(normal, directed=False)[1]
    right = -(own.T @ both[:, np.flatnonzero(known)]).tocoo()
    pairs, column = np.unique(np.stack([part[right.row], np.flatnonzero(known)[right.col]]), axis=1,
                              return_inverse=True)  # fmt: skip
    start = np.searchsorted(pairs[0], np.arange(int(part.max()) + 2))
    rank = np.arange(pairs.shape[1]) - start[pairs[0]]
    ring = np.full((int(part.max()) + 1, int(rank.max()) + 1), -1, np.int64)
    ring[pairs[0], rank] = pairs[1]
    dense = np.zeros((len(f), ring.shape[1]))
    np.add.at(dense, (right.row, rank[column.ravel()]), right.data)
    weights = splu(normal).solve(dense)
    of = ring[part]
    used = of >= 0
    spread[f] = np.where(used, weights**2 * spread[of], 0.0).sum(axis=1)
    for k in range(places.shape[1]):
        places[f, k] = np.where(used, weights * places[of, k], 0.0).sum(axis=1)
