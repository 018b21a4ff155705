"""Which spots are taken for which markers, for the search kernel: quads by their key, triplets by neighbourhood.

- Local quads ("hash"): four neighbouring spots meet the quads of markers that look like them (`_kernels.quad`).
- Triplets ("ransac", the paper's): a marker and two of its neighbours meet every spot and two of its neighbours.
- In full: where spots are few, three of them far apart meet all triplets of markers. Where most markers are hidden,
  four neighbouring ones are hardly ever seen as neighbours; but if nearly all spots are markers, nearly all must be
  explained.
"""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from windmark.registration._kernels.hypothesis import Model, Picture
from windmark.registration._kernels.match import Links
from windmark.registration._kernels.near import nearest
from windmark.registration._kernels.quad import Table, spot_quads_kernel
from windmark.registration.search.layout import interior_angles

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

MIN_ANGLE_DEG = 10.0
"""Interior angles of a marker triplet lie within 90 +- 80 degrees (AIAA 2005-5007, section III.C)."""
FLAT_COSINE = 0.8
"""A triplet whose plane is this close to its markers' surface is seen from the markers' side only."""
MOST_GROWN, ANY = 24, 1_000_000
"""Solutions grown from four spots, and from three that are tried in full."""
EVEN, ODD = ((0, 1, 2), (1, 2, 0), (2, 0, 1)), ((0, 2, 1), (2, 1, 0), (1, 0, 2))
"""Orders of three that turn one way round, and the other."""


def quad_links(picture: Picture, table: Table, low: int, high: int, check: float) -> Links:
    """A spot and three of its ``high`` nearest ones, not all among the ``low`` nearest, rarest key first."""
    spots, cells = spot_quads_kernel(picture.p, picture.near, low, min(high, picture.near.shape[1]), table.first)
    return _anchored(spots, cells, table, check)


def compact_links(picture: Picture, spots: Ints, neighbours: int, most: int, table: Table, check: float) -> Links:
    """Quads among some spots: for each of (at most so many) anchors the one with the rarest key."""
    p = picture.p[spots]
    near = nearest(p, min(neighbours, len(p) - 1))[0]
    quads, cells = spot_quads_kernel(p, near, 0, near.shape[1], table.first)
    rarest = np.full(len(p), len(quads))
    rarest[quads[::-1, 0]] = np.arange(len(quads))[::-1]  # of quads of one anchor the first one stays
    chosen = np.sort(rarest[rarest < len(quads)])[:most]
    cells = cells[chosen]
    return _anchored(spots[quads[chosen]], cells, table, check)


def in_turn(near: Links, far: Links) -> Links:
    """Quads of both: the first one of every anchor, then the next one of every anchor, ...; each time rarest first.

    Where one quad of a spot holds a false one the others hardly do better, so it is the next spot's turn. Of an anchor
    those that are ``far`` come after those that are ``near``, rarest first.
    """
    spots, first, last = (np.concatenate(pair) for pair in zip(near[:3], far[:3], strict=True))
    order = np.argsort(spots[:, 0], kind="stable")
    anchor, turn = spots[order, 0], np.empty(len(spots), dtype=np.int64)
    turn[order] = np.arange(len(order)) - np.searchsorted(anchor, anchor)
    order = np.lexsort((last - first, turn))
    return near._replace(spots=spots[order], first=first[order], last=last[order])


def _anchored(spots: Ints, cells: Ints, table: Table, check: float) -> Links:
    """Spots (Q, 4) against the quads of their cells (Q,)."""
    first, last = table.first[cells], table.first[cells + 1]
    return Links(spots, first, last, table.entry, table.quad, table.shape, check, MOST_GROWN)


def triplet_links(model: Model, picture: Picture, triplets: Ints, anchors: Ints, reach: int) -> Links:
    """Marker triplets (T, 3) against each anchor and two of its ``reach`` nearest spots."""
    second, third = np.array(list(permutations(range(min(reach, picture.near.shape[1])), 2)), dtype=np.int32).T
    near = picture.near[anchors]
    head = np.broadcast_to(anchors[:, None], (len(anchors), len(second)))
    spots = np.stack([head, near[:, second], near[:, third]], axis=-1).reshape(-1, 3)
    return _faced(picture.p, spots, triplets, turns_of(model, triplets))


def full_links(model: Model, p: Array, corners: Ints, bound: Ints) -> Links:
    """Spots (Q, 3) against all triplets of markers that have these (3,) where they are not -1."""
    some = np.array(list(combinations(range(len(model.xyz)), 3)), dtype=np.int32)
    turns = turns_of(model, some)
    triplets = np.concatenate([some[:, order] for order in (*EVEN, *ODD)])
    turns = np.repeat([turns, -turns], 3, axis=0).ravel()
    if (bound >= 0).any():
        kept = ((triplets == bound) | (bound < 0)).all(axis=1)
        triplets, turns = triplets[kept], turns[kept]
    return _faced(p, corners, triplets, turns, ANY)


def _faced(p: Array, spots: Ints, triplets: Ints, turns: NDArray[np.int8], most: int = MOST_GROWN) -> Links:
    """Spots (Q, 3) against the marker triplets (T, 3) that can be seen turning the way they do."""
    one, two = p[spots[:, 1]] - p[spots[:, 0]], p[spots[:, 2]] - p[spots[:, 0]]
    clockwise = one[:, 0] * two[:, 1] > one[:, 1] * two[:, 0]
    first = np.where(clockwise, (turns < 0).sum(), 0).astype(np.int32)
    last = np.where(clockwise, len(turns), (turns <= 0).sum()).astype(np.int32)
    entry, markers = np.argsort(turns, kind="stable").astype(np.int32), _unanchored(triplets)
    return Links(_unanchored(spots), first, last, entry, markers, np.zeros((0, 8)), np.inf, most)


def _unanchored(triplets: Ints) -> Ints:
    """(T, 4) as the kernel wants three without an anchor: their first one, round which it looks first, is the last."""
    return np.ascontiguousarray(np.pad(triplets[:, [1, 2, 0]], ((0, 0), (1, 0)), constant_values=-1), dtype=np.int32)


def wide_triplets(p: Array, count: int) -> Ints:
    """(count, 3) of the spots (M, 2), none in two of them, widest first."""
    triplets = np.array(list(combinations(range(len(p)), 3)), dtype=np.int32)
    one, two = p[triplets[:, 1]] - p[triplets[:, 0]], p[triplets[:, 2]] - p[triplets[:, 0]]
    area = np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
    chosen: list[Ints] = []
    for n in np.argsort(-area, kind="stable"):
        if len(chosen) < count and not np.isin(triplets[n], chosen).any():
            chosen.append(triplets[n])
    return np.array(chosen, dtype=np.int32)


def marker_triplets(model: Model, neighbours: int, *, every_corner: bool = False) -> Ints:
    """Triplets (T, 3) of a marker and two of its nearest neighbours, with sound interior angles.

    A triplet comes once, headed by the corner nearest to the other two; with ``every_corner`` once for each
    marker that has the others as neighbours.
    """
    k = min(neighbours, model.near.shape[1])
    first, second = np.triu_indices(k, 1)
    head = np.repeat(np.arange(len(model.xyz), dtype=np.int32), len(first))
    triplets = np.stack([head, model.near[:, first].ravel(), model.near[:, second].ravel()], axis=1)
    corners = model.xyz[triplets]
    triplets = triplets[interior_angles(corners).min(axis=1, initial=np.pi) >= np.radians(MIN_ANGLE_DEG)]
    if every_corner or not len(triplets):
        return np.ascontiguousarray(triplets)
    corners = model.xyz[triplets]
    spread = np.linalg.norm(corners[:, 1:] - corners[:, :1], axis=2).sum(axis=1)
    triplets = triplets[np.argsort(spread, kind="stable")]
    _, once = np.unique(np.sort(triplets, axis=1), axis=0, return_index=True)
    return np.ascontiguousarray(triplets[np.sort(once)])


def turns_of(model: Model, triplets: Ints) -> NDArray[np.int8]:
    """(T,) sign of a triplet's area in the image (y down) when seen from the side its markers face, 0 if unsure."""
    corners = model.xyz[triplets]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    cosine = (normal[:, None, :] * model.normal[triplets]).sum(axis=2)
    return np.where((cosine > FLAT_COSINE).all(axis=1), -1, np.where((cosine < -FLAT_COSINE).all(axis=1), 1, 0)).astype(
        np.int8
    )
