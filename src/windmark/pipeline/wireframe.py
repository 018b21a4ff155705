"""Lines of the surface grid as the camera sees them, for drawing over the image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.resection import NodeView
from windmark.scene import Block, Mesh

Array = NDArray[np.float64]


def grid_lines(mesh: Mesh, nodes: NodeView, *, per_block: int = 24, edges: int = 20_000) -> list[Array]:
    """Polylines (n, 2) in pixels along visible grid lines.

    Structured blocks give every so many i and j lines (at most ``per_block`` each way, borders
    always); an unstructured mesh gives the edges of its visible triangles, thinned to ``edges``.
    """
    if mesh.blocks:
        return [line for block in mesh.blocks for line in _block_lines(block, nodes, per_block)]
    visible = nodes.visible[mesh.triangles].all(axis=1)
    t = mesh.triangles[visible]
    pairs = np.unique(np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1), axis=0)
    return list(nodes.xy[pairs[:: max(1, len(pairs) // edges)]])


def _block_lines(block: Block, nodes: NodeView, per_block: int) -> list[Array]:
    ni, nj = (n for n in (*block.shape_ijk, 1, 1) if n > 1) if sum(n > 1 for n in block.shape_ijk) == 2 else (1, 1)
    span = slice(block.first, block.first + ni * nj)
    xy = nodes.xy[span].reshape(nj, ni, 2)
    seen = nodes.visible[span].reshape(nj, ni)
    lines = []
    for j in _every(nj, per_block):
        lines += _visible_runs(xy[j], seen[j])
    for i in _every(ni, per_block):
        lines += _visible_runs(xy[:, i], seen[:, i])
    return lines


def _every(n: int, most: int) -> NDArray[np.int64]:
    """At most ``most`` of 0..n-1, evenly spread, both ends in."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.int64))


def _visible_runs(xy: Array, seen: NDArray[np.bool_]) -> list[Array]:
    """The pieces of one grid line whose nodes are seen, two nodes at least."""
    cuts = np.flatnonzero(np.diff(seen.astype(np.int8))) + 1
    pieces = zip(np.split(xy, cuts), np.split(seen, cuts), strict=True)
    return [line for line, flags in pieces if len(line) > 1 and flags[0]]
