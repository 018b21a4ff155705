"""Which triplets of markers and of spots are worth a link."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.registration._kernels.hypothesis import Model

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

MIN_ANGLE_DEG = 10.0
"""Interior angles of a marker triplet lie within 90 +- 80 degrees (AIAA 2005-5007, section III.C)."""
FLAT_COSINE = 0.8
"""A triplet whose plane is this close to its markers' surface is seen from the markers' side only."""


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


def interior_angles(corners: Array) -> Array:
    """(T, 3) interior angles in radians of triangles (T, 3, d); 0 for coincident corners."""
    angles = []
    for a in range(3):
        u, v = corners[:, (a + 1) % 3] - corners[:, a], corners[:, (a + 2) % 3] - corners[:, a]
        length = np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
        cosine = np.divide((u * v).sum(axis=1), length, out=np.ones(len(u)), where=length > 0)
        angles.append(np.arccos(np.clip(cosine, -1, 1)))
    return np.stack(angles, axis=1)


def spread_corners(p: Array, spots: Ints, count: int) -> Ints:
    """Up to ``count`` compact triplets (C, 3) of the given spots, spread over the image, with sound angles."""
    if len(spots) < 3:
        return np.zeros((0, 3), dtype=np.int32)
    q = p[spots]
    chosen: list[int] = [int(np.argmin(((q - q.mean(axis=0)) ** 2).sum(axis=1)))]
    far = np.full(len(q), np.inf)
    while len(chosen) < min(count, len(q)):
        far = np.minimum(far, ((q - q[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(np.argmax(far)))
    triplets = [corner for a in chosen if (corner := _compact(q, a)) is not None]
    return np.array([spots[list(t)] for t in triplets], dtype=np.int32).reshape(-1, 3)


def _compact(q: Array, a: int) -> tuple[int, int, int] | None:
    """The nearest two neighbours of point ``a`` that make a triangle with angles of 20 degrees or more."""
    order = np.argsort(((q - q[a]) ** 2).sum(axis=1), kind="stable")[1:8]
    for n in range(1, len(order)):
        corners = np.array([[q[a], q[order[k]], q[order[n]]] for k in range(n)])
        good = np.flatnonzero(interior_angles(corners).min(axis=1) >= np.radians(20.0))
        if good.size:
            return a, int(order[good[0]]), int(order[n])
    return None
