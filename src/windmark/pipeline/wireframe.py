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
    rows, columns = _every(nj, per_block), _every(ni, per_block)
    across = _visible_runs(np.swapaxes(xy[:, columns], 0, 1), seen[:, columns].T)
    return _visible_runs(xy[rows], seen[rows]) + across


def _every(n: int, most: int) -> NDArray[np.int64]:
    """At most ``most`` of 0..n-1, evenly spread, both ends in."""
    return np.linspace(0, n - 1, min(n, most)).round().astype(np.int64)  # a step is one at least: none comes twice


def _visible_runs(xy: Array, seen: NDArray[np.bool_]) -> list[Array]:
    """The pieces of grid lines (L, n, 2) whose nodes are seen (L, n), two nodes at least, line by line."""
    step = np.diff(np.pad(seen.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    line, first = np.nonzero(step > 0)
    last = np.nonzero(step < 0)[1]  # in the same order: every piece that begins ends in its line
    return [xy[k, a:b] for k, a, b in zip(line.tolist(), first.tolist(), last.tolist(), strict=True) if b - a > 1]
