"""Parts without thickness that the grid has twice, one sheet for each side: which triangles lie on each other, and
which of the sheets is which side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.scene import Mesh

Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

WHOLE = 0.9
"""Part of a sheet's area that lies on another one, from which both are the sides of one thin part; less is the overlap
of two zones."""
AGREED = 0.9
"""Part of the other zones' area that the file winds alike, from which its windings tell which side a sheet is."""


@dataclass(frozen=True)
class Edges:
    """The sides of all triangles, those on one edge one after the other.

    Parameters
    ----------
    owner : (E,) triangle of each side; ``forward``: it runs from the lower to the higher of its nodes
    edge : (E,) number of its edge; ``count``: (E,) how many triangles meet there
    raw : (E,) number of the edge in the file's own nodes, before those at one place were made one
    """

    owner: Ints
    forward: Mask
    edge: Ints
    count: Ints
    raw: Ints

    @staticmethod
    def of(corners: Ints, nodes: NDArray[np.integer]) -> Edges:
        """Of triangles (T, 3) by nodes numbered alike where they coincide, and by the file's own."""
        tail, head = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
        owner = np.repeat(np.arange(len(corners)), 3)
        real = np.flatnonzero(tail != head)
        tail, head, owner = tail[real], head[real], owner[real]
        one, two = nodes.ravel()[real].astype(np.int64), np.roll(nodes, -1, axis=1).ravel()[real]
        low, high = np.minimum(tail, head), np.maximum(tail, head)
        order = np.lexsort((high, low))
        changes = (np.diff(low[order]) != 0) | (np.diff(high[order]) != 0)
        edge = np.cumsum(np.append(False, changes)) if len(order) else np.zeros(0, np.int64)
        raw = np.minimum(one, two) * (int(nodes.max(initial=0)) + 1) + np.maximum(one, two)
        return Edges(owner[order], (tail < head)[order], edge, np.bincount(edge)[edge], raw[order])

    def pairs(self, which: Mask, *keys: Ints) -> tuple[Ints, Ints]:
        """Sides, chosen by ``which`` (E,), that alone have their edge and ``keys`` (E,) in common, two and two."""
        some = np.flatnonzero(which)
        columns = [key[some] for key in (*keys, self.edge)]
        order = np.lexsort(columns) if keys else np.arange(len(some))
        differs = np.any([np.diff(c[order]) != 0 for c in columns], axis=0) if len(some) else np.zeros(0, bool)
        begins = np.flatnonzero(np.append(True, differs)) if len(some) else np.zeros(0, np.int64)
        first = begins[np.diff(np.append(begins, len(some))) == 2]
        return some[order[first]], some[order[first + 1]]


def neighbours(edges: Edges, part: Ints, overlap: Mask) -> tuple[Ints, Ints]:
    """Pairs of sides whose triangles go on into each other: those that alone have an edge; where more meet, the two
    that alone have its nodes in the file, or of one ``part`` (T,) of the grid (see `Mesh.parts`).

    ``overlap``: (T,) cells that two parts have; they do not go on into each other at their common rim.
    """
    first, second = edges.pairs(edges.count == 2)
    if overlap.any():
        t, u = edges.owner[first], edges.owner[second]
        apart = overlap[t] & overlap[u] & (part[t] != part[u])
        first, second = first[~apart], second[~apart]
    many = edges.count > 2
    if not many.any():
        return first, second
    by_nodes = edges.pairs(many, edges.raw)
    left = many.copy()
    left[np.concatenate(by_nodes)] = False
    by_part = edges.pairs(left, part[edges.owner])
    return np.concatenate([first, by_nodes[0], by_part[0]]), np.concatenate([second, by_nodes[1], by_part[1]])


@dataclass(frozen=True)
class Twins:
    """Triangles that lie on each other as the two sides of a thin part.

    Parameters
    ----------
    first, second : (N,) triangles of two sheets that cover one cell; ``alike``: the file winds them alike
    overlap : (T,) triangles that lie on others that are no other side: of zones that overlap
    """

    first: Ints
    second: Ints
    alike: Mask
    overlap: Mask

    def mask(self, count: int) -> Mask:
        """(T,) triangles that have such another one."""
        out = np.zeros(count, bool)
        out[self.first] = out[self.second] = True
        return out


def twins(mesh: Mesh, corners: Ints, edges: Edges) -> Twins:
    """Cells, of one triangle or of two, that are in the grid twice on the same corners (T, 3).

    Of parts that lie on each other nearly as a whole, and are open: zones that overlap by some cells, and a closed body
    that is there twice, are no two sides; nor is a triangle that one part has twice, wound alike.
    """
    sides = [_of_cells(edges, corners, edges.owner, np.full(len(edges.owner), -1))]
    many = np.zeros(len(corners), bool)
    many[edges.owner[edges.count > 2]] = True
    if many.any():
        a, b = edges.pairs(edges.count == 2, edges.raw)  # the diagonal of a cell: only its own two triangles meet there
        mate = np.concatenate([edges.owner[b], edges.owner[a]])
        sides.append(_of_cells(edges, corners, np.concatenate([edges.owner[a], edges.owner[b]]), mate))
    first, second = (np.concatenate([s[k] for s in sides]) for k in (0, 1))
    t, u = edges.owner[first], edges.owner[second]
    alike = edges.forward[first] == edges.forward[second]
    keep = _are_sides(mesh, edges, t, u) if len(t) else np.zeros(0, bool)
    keep &= (mesh.parts[t] != mesh.parts[u]) | ~alike
    overlap = np.zeros(len(corners), bool)
    overlap[t[~keep]] = overlap[u[~keep]] = True
    return Twins(t[keep], u[keep], alike[keep], overlap)


def _of_cells(edges: Edges, corners: Ints, triangle: Ints, mate: Ints) -> tuple[Ints, Ints]:
    """Pairs of sides on edges where more than two triangles meet whose cells have the same corners.

    ``triangle``, ``mate`` : (N,) the cells; -1 where the triangle is one by itself
    """
    many = np.flatnonzero(edges.count > 2)
    if not len(many):
        return many, many
    there = np.zeros(len(corners), bool)
    there[edges.owner[many]] = True
    some = np.unique(np.stack([triangle, mate], axis=1)[there[triangle]], axis=0)
    last = np.where((some[:, 1] < 0)[:, None], corners[some[:, 0]], corners[some[:, 1]])
    nodes = np.sort(np.concatenate([corners[some[:, 0]], last], axis=1), axis=1)
    cell = np.unique(nodes, axis=0, return_inverse=True)[1].reshape(-1)
    # A triangle may be of several cells: its sides are asked with each of them.
    begin, end = np.searchsorted(some[:, 0], edges.owner[many]), np.searchsorted(some[:, 0], edges.owner[many], "right")
    side = np.repeat(many, end - begin)
    which = np.arange(len(side)) - np.repeat(np.cumsum(end - begin) - (end - begin), end - begin)
    key = cell[np.repeat(begin, end - begin) + which]
    order = np.lexsort((key, edges.edge[side]))
    side, key = side[order], key[order]
    begins = np.flatnonzero(np.append(True, (np.diff(key) != 0) | (np.diff(edges.edge[side]) != 0)))
    begins = begins[np.diff(np.append(begins, len(side))) == 2] if len(side) else begins[:0]
    return side[begins], side[begins + 1]


def _are_sides(mesh: Mesh, edges: Edges, t: Ints, u: Ints) -> Mask:
    """Whether of the pairs (N,) one's whole part lies on the other's, and neither part is closed by itself."""
    part, area = mesh.parts, np.linalg.norm(mesh.triangle_normals(), axis=1)
    part = np.unique(part, return_inverse=True)[1].reshape(-1)
    count = int(part.max()) + 1
    # A triangle counts once with each part that it lies on, however many of that one's triangles it meets.
    lies = np.concatenate([np.stack([t, part[u]], axis=1), np.stack([u, part[t]], axis=1)])
    triangle, other = np.unique(lies, axis=0).T
    covered = np.zeros((count, count)) if count < 1000 else None
    if covered is None:
        return np.zeros(len(t), bool)  # a soup of loose triangles has no sides
    np.add.at(covered, (part[triangle], other), area[triangle])
    whole = covered > WHOLE * np.bincount(part, weights=area, minlength=count)[:, None]
    own, times = np.unique(edges.edge * count + part[edges.owner], return_counts=True)
    rim = np.zeros(count, bool)
    rim[own[times == 1] % count] = True
    return np.asarray((whole | whole.T)[part[t], part[u]] & rim[part[t]] & rim[part[u]])


def unknown_sides(mesh: Mesh, turned: Mesh, corners: Ints) -> tuple[tuple[str, str], ...]:
    """Volumes that are the two sides of a thin part where nothing tells which is which.

    The file's windings of ``mesh`` tell it where they oppose each other, and those of all other zones agree: with what
    ``turned`` has (see `orient_outward`). ``corners``: (T, 3) nodes numbered alike where they coincide.
    """
    edges = Edges.of(corners, mesh.triangles)
    found = twins(mesh, corners, edges)
    if not len(found.first):
        return ()
    told = agreed(mesh, found.mask(len(corners)), (mesh.triangles != turned.triangles).any(axis=1)) is not None
    doubted = found.alike | (not told)
    pairs = np.stack([found.first, found.second], axis=1)[doubted]
    some = np.unique(np.sort(mesh.parts[pairs], axis=1), axis=0, return_index=True)[1]
    return tuple((_zone(mesh, a), _zone(mesh, b)) for a, b in pairs[np.sort(some)])


def _zone(mesh: Mesh, triangle: int) -> str:
    """The name of the zone that a triangle is of; of a grid without zones that of its volume."""
    if not mesh.blocks:
        return str(mesh.volume[triangle])
    block = np.searchsorted([b.first for b in mesh.blocks], mesh.triangles[triangle, 0], side="right") - 1
    return mesh.blocks[int(block)].name


def agreed(mesh: Mesh, thin: Mask, flip: Mask) -> bool | None:
    """Whether the file winds all that is no thin part (T,) inward; None where some of it is and some is not.

    ``flip``: (T,) triangles that had to be turned. Without any other part the file is taken to be right.
    """
    area = np.where(thin, 0.0, np.linalg.norm(mesh.triangle_normals(), axis=1))
    if not (total := float(area.sum())) > 0:
        return False
    inward = float(area[flip].sum()) / total
    return True if inward > AGREED else False if inward < 1 - AGREED else None
