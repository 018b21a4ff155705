"""Form factors on the grid: which part of what a node receives comes from which facet, hidden ones left out.

A facet is a group of neighbouring triangles that face about the same way. Far ones count as one place, near ones by
their halves, down to Lambert's exact contour sum of single triangles; a ray to each says whether something hides it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.scene import Mesh
from windmark.scene.triangle_tree import LEAF, TriangleTree

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

FACETS = 1500
BLOCK = 256
"""Nodes whose factors are in memory at a time."""
TURN = 1.0
"""What a difference of normals counts beside one of places, in sizes of the mesh: facets stay flat."""
INWARD = 0.1
"""Part of the way to the middle of its triangles from which a node looks."""
LEAST = 1e-6
"""Smaller factors are left out."""


@dataclass(frozen=True, eq=False)
class FormFactors:
    """Of a mesh with V nodes and J facets.

    Parameters
    ----------
    matrix : (V, J) sparse: the part of a node's hemisphere (by the cosine) that each facet fills
    facet : (T,) facet of each triangle
    share : (J, V) sparse: the mean of a facet over its nodes, by area
    """

    matrix: Any
    facet: Ints
    share: Any

    @property
    def seen(self) -> Array:
        """(V,) part of a node's hemisphere that other surface fills."""
        return np.asarray(self.matrix.sum(axis=1)).ravel()


def form_factors(mesh: Mesh, *, facets: int = FACETS, nodes: Ints | None = None) -> FormFactors:
    """Form factors of every node towards the facets of its own mesh.

    Parameters
    ----------
    mesh : triangles counter-clockwise from the air
    facets : how many groups of triangles at most; more are finer where surfaces meet, and take longer in proportion
    nodes : indices, in order, of those that are asked for; the others' rows are empty. None: all

    Raises
    ------
    ValueError
        For fewer than one facet or a mesh without triangles.

    Notes
    -----
    One ray decides for a whole far facet, or for a near triangle: shadows have the facets' size.

    Examples
    --------
    >>> import windmark as wm
    >>> corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1]]
    >>> corner = wm.Mesh.make(corners, [[0, 1, 2], [0, 2, 3], [0, 3, 5], [0, 5, 4]])  # floor and wall
    >>> factors = wm.form_factors(corner)
    >>> factors.matrix.shape  # nodes, facets
    (6, 4)
    >>> plate = wm.Mesh.make(corners[:4], [[0, 1, 2], [0, 2, 3]])
    >>> int(wm.form_factors(plate).matrix.nnz)  # a plate does not see itself
    0
    """
    from scipy.sparse import csr_array, vstack

    from windmark.paint._kernels import gather

    t = len(mesh.triangles)
    if facets < 1 or not t:
        raise UsageError(f"form_factors: expected at least one facet and one triangle, got {facets} and {t}")
    facet = _grouped(mesh, facets)
    count = int(facet.max()) + 1
    tree = TriangleTree.of(mesh)
    corners, own = tree.corners, facet[tree.order]
    # Within a facet in the leaves' order, so that halves of it lie together.
    order = np.argsort(own, kind="stable")
    groups = _halved(corners[order].reshape(t, 3, 3), np.searchsorted(own[order], np.arange(count + 1)))
    normals = mesh.vertex_normals()
    points = _seats(mesh, normals)
    asked = np.arange(len(normals)) if nodes is None else np.asarray(nodes)
    parts = []
    for k in range(0, len(asked), BLOCK):
        rows = asked[k : k + BLOCK]
        out = np.empty((len(rows), count))
        gather(points[rows], normals[rows], 1e-5 * mesh.size, count, *groups, order, tree.boxes, tree.leaves, LEAF,
               corners, own, out)  # fmt: skip
        out[out < LEAST] = 0.0
        parts.append(csr_array(out))
    matrix = vstack(parts).tocsr()
    if nodes is not None:
        filled = np.zeros(len(normals) + 1, np.int64)
        filled[asked + 1] = np.diff(matrix.indptr)
        matrix = csr_array((matrix.data, matrix.indices, np.cumsum(filled)), shape=(len(normals), count))
    return FormFactors(matrix, facet, _share(mesh, facet, count))


def _seats(mesh: Mesh, normals: Array) -> Array:
    """(V, 3) where each node looks from: a little towards the middle of its triangles, but not down from its tangent
    plane.

    A node on the edge at which two surfaces meet lies in the other one's plane and would see nothing of it. The middle
    of the triangles of a bulging surface lies below them: from there they would hide everything.
    """
    count = np.bincount(mesh.triangles.ravel(), minlength=len(mesh.vertices))[:, None]
    middle = mesh.vertices[mesh.triangles].mean(axis=1)
    total = np.zeros_like(mesh.vertices)
    for axis in range(3):
        total[:, axis] = np.bincount(mesh.triangles.ravel(), np.repeat(middle[:, axis], 3), len(mesh.vertices))
    step = np.where(count > 0, INWARD * (total / np.maximum(count, 1) - mesh.vertices), 0.0)
    up = np.nan_to_num(normals)
    down = np.minimum(np.einsum("vk,vk->v", step, up), 0.0)
    return np.asarray(mesh.vertices + step - down[:, None] * up)


def _grouped(mesh: Mesh, most: int) -> Ints:
    """(T,) groups of triangles, halved along their widest direction of places and normals until there are enough."""
    import heapq

    n = mesh.triangle_normals()
    length = np.linalg.norm(n, axis=1, keepdims=True)
    place = mesh.vertices[mesh.triangles].mean(axis=1) / (mesh.size or 1.0)
    at = np.column_stack([place, TURN * n / np.where(length > 0, length, 1.0)])
    heap: list[tuple[float, int, Ints]] = []
    count = 0

    def push(which: Ints) -> None:
        nonlocal count
        # The widest direction, more of it where there is more area.
        spread = float(np.ptp(at[which], axis=0).max()) * float(np.sqrt(length[which].sum()))
        heapq.heappush(heap, (-spread if len(which) > 1 else 0.0, count, which))
        count += 1

    push(np.arange(len(at)))
    while len(heap) < most and heap[0][0] < 0:
        which = heapq.heappop(heap)[2]
        axis = int(np.argmax(np.ptp(at[which], axis=0)))
        along = np.argsort(at[which, axis], kind="stable")
        half = len(which) // 2
        push(which[along[:half]])
        push(which[along[half:]])
    out = np.empty(len(at), np.int64)
    for k, (_, _, which) in enumerate(sorted(heap, key=lambda item: item[1])):
        out[which] = k
    return out


def _halved(corner: Array, first: Ints) -> tuple[Array, Array, Array, Ints, Ints]:
    """Groups of triangles: the J facets, their halves, the halves of these, down to `LEAF` triangles.

    Parameters
    ----------
    corner : (T, 3, 3) facet by facet, neighbours near each other
    first : (J + 1,) where each facet begins

    Returns
    -------
    middle (G, 3), area vector (G, 3), reach (G,), triangles from and to (G, 2), first of its two halves (G,) or -1
    """
    vector = 0.5 * np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    size = np.linalg.norm(vector, axis=1)
    size = size + 1e-9 * max(float(size.mean()), 1e-300)  # of collapsed triangles, too, there is a middle
    sums = np.concatenate([np.zeros((1, 7)), np.cumsum(np.column_stack([
        size, size[:, None] * corner.mean(axis=1), vector]), axis=0)])  # fmt: skip
    low, high = corner.min(axis=1), corner.max(axis=1)
    ends = np.stack([first[:-1], first[1:]], axis=1)
    parts, done = [], 0
    while len(ends):
        total = sums[ends[:, 1]] - sums[ends[:, 0]]
        box = [of.reduceat(a, ends.ravel())[::2] for of, a in ((np.minimum, _padded(low)), (np.maximum, _padded(high)))]
        # Differences of long sums round off: the middle stays in the box.
        middle = np.clip(total[:, 1:4] / total[:, :1], *box)
        radius = np.linalg.norm(np.maximum(middle - box[0], box[1] - middle), axis=1)
        split = np.diff(ends, axis=1)[:, 0] > LEAF
        child = np.full(len(ends), -1, np.int64)
        child[split] = done + len(ends) + 2 * np.arange(int(split.sum()))
        parts.append((middle, total[:, 4:], radius, ends, child))
        done += len(ends)
        half = ends[split].mean(axis=1).astype(np.int64)
        ends = np.stack([ends[split][:, 0], half, half, ends[split][:, 1]], axis=1).reshape(-1, 2)
    middle, area, radius, ends, child = (np.concatenate(p) for p in zip(*parts, strict=True))
    return middle, area, radius, ends, child


def _padded(values: Array) -> Array:
    """With one more row, at which a group that ends at the last triangle may end."""
    return np.concatenate([values, values[-1:]])


def _share(mesh: Mesh, facet: Ints, count: int) -> Any:
    """(J, V) mean of a facet over its nodes: a third of each triangle's area to each corner."""
    from scipy.sparse import coo_array, diags_array

    area = np.repeat(np.linalg.norm(mesh.triangle_normals(), axis=1) + 1e-300, 3)
    both = coo_array((area, (np.repeat(facet, 3), mesh.triangles.ravel())), shape=(count, len(mesh.vertices))).tocsr()
    return (diags_array(1 / np.asarray(both.sum(axis=1)).ravel()) @ both).tocsr()
