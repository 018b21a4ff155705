"""The grid as a surface for sums and neighbours: nodes that lie together count as one, areas, edges, operators."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.scene import Mesh
from windmark.scene.mesh import TOGETHER

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh with the nodes of blocks that meet joined.

    Parameters
    ----------
    place : (V,) the number of each node's place; -1 for nodes in no triangle
    first : (P,) a node at each place
    xyz : (P, 3) where they are
    triangles : (T, 3) in places
    """

    place: Ints
    first: Ints
    xyz: Array
    triangles: Ints

    def edges(self) -> tuple[Ints, Ints]:
        """(E, 2) edges between places, and how many triangles each has (1: border; 2; more where sheets meet)."""
        t = self.triangles
        both = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1)
        both = both[both[:, 0] != both[:, 1]]
        key, count = np.unique(both[:, 0] * np.int64(len(self.first)) + both[:, 1], return_counts=True)
        return np.stack(np.divmod(key, np.int64(len(self.first))), axis=1), count

    @cached_property
    def border(self) -> NDArray[np.bool_]:
        """(P,) places at an edge that only one triangle has."""
        edges, count = self.edges()
        out = np.zeros(len(self.first), bool)
        out[edges[count == 1].ravel()] = True
        return out

    @cached_property
    def laplacian(self) -> tuple[Any, Array]:
        """On places: (P, P) sparse L with (L u)_i = sum w_ij (u_j - u_i), and each place's area (P,).

        Cotangent weights (Pinkall and Polthier, Experimental Mathematics 2, 1993), negative ones of obtuse pairs cut
        off: fills then stay between their neighbours. Divide by the areas for the Laplacian itself.
        """
        from scipy.sparse import coo_array

        t, n = self.triangles, len(self.first)
        corner = self.xyz[t]
        area2 = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
        rows, columns, weights = [], [], []
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            dot = np.einsum("tk,tk->t", corner[:, a] - corner[:, k], corner[:, b] - corner[:, k])
            half = np.divide(0.5 * dot, area2, out=np.zeros(len(t)), where=area2 > 0)
            rows += [t[:, a], t[:, b]]
            columns += [t[:, b], t[:, a]]
            weights += [half, half]
        w = coo_array((np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), shape=(n, n)).tocsr()
        # A weight of zero would cut a node off where all its triangles are degenerate or obtuse.
        w.data = np.maximum(w.data, 1e-6)
        w.setdiag(0.0)
        diagonal = coo_array((-np.asarray(w.sum(axis=1)).ravel(), (np.arange(n), np.arange(n))), shape=(n, n)).tocsr()
        return w + diagonal, np.asarray(np.bincount(t.ravel(), np.repeat(area2 / 6, 3), minlength=n), dtype=float)


def joined_surface(mesh: Mesh) -> Surface:
    """The surface of a mesh: nodes within `TOGETHER` of its size, of different blocks or not, are one place."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    used = mesh.used
    place = np.full(len(mesh.vertices), -1, np.int64)
    if not len(used):
        return Surface(place, np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    pairs = cKDTree(mesh.vertices[used]).query_pairs(TOGETHER * (mesh.size or 1.0), output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(len(used),) * 2)
    count, number = connected_components(graph, directed=False)
    place[used] = number
    first = np.empty(count, np.int64)
    first[number[::-1]] = used[::-1]
    return Surface(place, first, mesh.vertices[first], place[mesh.triangles])
