"""What is no paint (markers, taps, drawn polygons) taken out of a field and filled from round it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import DataError
from windmark.paint import NodeField, disc_nodes, fill_patches, polygon_nodes, stranded
from windmark.scene import Mesh

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def patched(
    rest: Mesh, field: NodeField, discs: tuple[Array, Array, Array], polygons: Sequence[Array], remarks: list[str]
) -> tuple[NodeField, Mask]:
    """The field with what is no paint filled from round it, where that was seen; and (V,) where it was filled.

    Parameters
    ----------
    discs : centres (D, 3), radii (D,), outward normals (D, 3) or NaN
    polygons : corners (K, 3) of each
    """
    patch, seen = _discs(rest, field, discs)
    for k, corners in enumerate(polygons):
        inside = polygon_nodes(rest, corners)
        if not inside.any():
            remarks.append(f"polygon {k + 1} of the patches covers no node")
        rim = rest.triangles[inside[rest.triangles].any(axis=1)].ravel()
        patch[inside] = len(discs[0]) + k
        if not (field.known[rim] & ~inside[rim]).any():
            seen[inside] = False
    # A patch that nothing was seen round is not asked for: it has no value, as what is round it.
    blind = (patch >= 0) & ~seen
    field = replace(field, value=np.where(blind, np.nan, field.value))
    patch[blind] = -1
    return _filled(rest, field, patch, remarks)


def _filled(rest: Mesh, field: NodeField, patch: NDArray[np.int64], remarks: list[str]) -> tuple[NodeField, Mask]:
    """`patched` by numbers (V,) of the patches, -1 for none."""
    if not (patch >= 0).any():
        return field, np.zeros(len(field), bool)
    try:
        done = fill_patches(rest, field, patch)
    except DataError as error:
        # A marker at the rim of what is seen may be near to nodes of another part only: the others are filled still.
        alone = stranded(rest, field, patch >= 0)
        if alone.any():
            patch[alone] = -1
            return _filled(rest, replace(field, value=np.where(alone, np.nan, field.value)), patch, remarks)
        remarks.append(f"markers, taps and polygons are left without values: {error}")
        return replace(field, value=np.where(patch >= 0, np.nan, field.value)), np.zeros(len(field), bool)
    return done.field, np.asarray(done.filled)


def _discs(rest: Mesh, field: NodeField, discs: tuple[Array, Array, Array]) -> tuple[NDArray[np.int64], Mask]:
    """(V,) which disc covers a node, -1 for none; and whether anything was seen near it."""
    centres, radii, normals = discs
    if not len(centres):
        return np.full(len(field), -1, np.int64), np.ones(len(field), bool)
    patch, near = disc_nodes(rest, centres, radii, normals), disc_nodes(rest, centres, 2 * radii, normals)
    return patch, np.isin(patch, np.unique(near[(near >= 0) & field.known]))
