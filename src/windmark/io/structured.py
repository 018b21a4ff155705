"""Structured surface blocks as one triangle mesh."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.scene import Block, Mesh, structured_triangles

Array = NDArray[np.float64]
Volumes = str | Mapping[str, str] | None

# Twice the area over the squared size of a triangle; below this it is a line in float64, whatever its scale.
_LINE = 1e-12


def surface_shape(shape_ijk: tuple[int, int, int]) -> tuple[int, int]:
    """(n_fast, n_slow) of a block that is a surface: the dimensions left when one that is 1 is dropped.

    A volume (all three above 1) has no such shape: ValueError.
    """
    if min(shape_ijk) > 1:
        raise UsageError(f"block of {shape_ijk} nodes is a volume; expected a surface (one of the three is 1)")
    kept = list(shape_ijk)
    kept.reverse()  # the slowest dimension that is 1 goes: (n, m, 1) and (n, 1, 1) keep their first two
    kept.remove(1)
    return kept[1], kept[0]


def zone_names(count: int) -> list[str]:
    """zone01, zone02 ... : names for blocks of files that do not name them (numbered from 1, as ``.tgts`` does)."""
    width = max(2, len(str(count)))
    return [f"zone{k:0{width}d}" for k in range(1, count + 1)]


def structured_mesh(
    vertices: Array,
    blocks: tuple[Block, ...],
    blanked: NDArray[np.bool_] | None = None,
    *,
    volumes: Sequence[str] | None = None,
    reverse: Collection[int] = (),
) -> Mesh:
    """Triangulate structured blocks: two triangles per cell, without collapsed or blanked ones.

    A triangle whose corners lie on a line (the poles and collapsed edges of structured grids) has no
    normal and covers no pixel: it is left out, its nodes stay. The normal of a block is
    d/d(fast index) x d/d(slow index), whatever side of the surface that is: files do not say.

    Parameters
    ----------
    vertices : (V, 3) nodes, block after block
    blocks : the blocks, which cover the V nodes in order
    blanked : (V,) bool, nodes that may be in no triangle
    volumes : the volume of each block; None: the blocks' names
    reverse : indices of the blocks whose triangles are to be turned round
    """
    triangles = []
    for k, block in enumerate(blocks):
        ni, nj = surface_shape(block.shape_ijk)
        xyz = vertices[block.first : block.first + block.size].reshape(nj, ni, 3)
        kept = structured_triangles(ni, nj, block.first, k in reverse)
        has_area = _has_area(xyz)
        if not has_area.all():
            kept = kept[has_area]
        if blanked is not None and blanked[block.first : block.first + block.size].any():
            kept = kept[~blanked[kept].any(axis=1)]
        triangles.append(kept)
    names = [block.name for block in blocks] if volumes is None else volumes
    return Mesh(
        vertices,
        np.concatenate(triangles) if triangles else np.zeros((0, 3), dtype=np.int32),
        np.repeat(np.array(names, dtype=np.str_), [len(t) for t in triangles]),
        blocks,
        blanked,
    )


def _has_area(xyz: Array) -> NDArray[np.bool_]:
    """Which triangles of `structured_triangles` have an area, for nodes (nj, ni, 3)."""
    x, y, z = (np.ascontiguousarray(xyz[..., k]) for k in range(3))
    along = [np.diff(c, axis=1) for c in (x, y, z)]
    across = [np.diff(c, axis=0) for c in (x, y, z)]
    first = _not_a_line([u[:-1] for u in along], [v[:, 1:] for v in across])
    second = _not_a_line([u[1:] for u in along], [v[:, :-1] for v in across])
    return np.concatenate([first.ravel(), second.ravel()])


def _not_a_line(u: list[Array], v: list[Array]) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore", over="ignore"):  # blanked nodes may hold anything
        nx = u[1] * v[2] - u[2] * v[1]
        ny = u[2] * v[0] - u[0] * v[2]
        nz = u[0] * v[1] - u[1] * v[0]
        size = u[0] ** 2 + u[1] ** 2 + u[2] ** 2 + v[0] ** 2 + v[1] ** 2 + v[2] ** 2
        return nx**2 + ny**2 + nz**2 > (_LINE * size) ** 2


def only_named(mesh: Mesh, volumes: Volumes) -> Mesh:
    """The mesh without the triangles of parts that ``volumes``, as a dictionary, does not name; all nodes stay."""
    if not isinstance(volumes, Mapping):
        return mesh
    keep = np.isin(mesh.volume, list(volumes.values()))
    return replace(mesh, triangles=mesh.triangles[keep], volume=mesh.volume[keep])


def rename_volumes(names: Sequence[str], volumes: Volumes) -> Sequence[str]:
    """The project's volume names for those of a file.

    Parameters
    ----------
    names : the names in the file
    volumes : one name for all, or {name in the file: volume}; names not in it stay. None: all stay
    """
    if volumes is None:
        return names
    if isinstance(volumes, str):
        return [volumes] * len(names)
    unknown = sorted(set(volumes) - set(names))
    if unknown:
        there = ", ".join(dict.fromkeys(names))
        raise UsageError(f"volumes: the file has no zone {', '.join(unknown)}; it has {there}")
    return [volumes.get(name, name) for name in names]
