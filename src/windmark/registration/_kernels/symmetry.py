"""Near-symmetries of a set of markers: motions that bring many markers onto others, with a numba kernel.

Private to the registration room. Under such a motion (half a turn of a grid, a shift along a row) the picture hardly
changes, so each of them makes a rival of every solution. With a reflection it tells what the mirrored model could be
taken for. Tests: tests/registration/test_layout.py.
"""

from __future__ import annotations

import math
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry._jit import nb
from windmark.registration._kernels.hypothesis import Model

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

NEAR = 0.3
"""A marker is brought onto another one that is within this part of the distance to its nearest neighbour."""
STRETCH = 1.2
"""Largest ratio of the sides of two alike triangles."""
NEIGHBOURS = 8
"""Neighbours that the corners of a triangle are taken from, and that have to agree first (half of them)."""
TURNED = 0.7
"""Cosine of the angle within which normals must agree."""
SAMPLE, UNLUCKY = 128, 4.0
"""Of more than twice so many markers a motion must bring about as large a part of so many as of all: it is given up
when it brings so many sigma fewer, asked after every eighth of the sample."""
STRIDES = (7919, 7907)
"""From one marker of a sample to the next: primes, so that the rows of a regular layout are sampled evenly."""
CELLS_PER_MARKER = 4
"""Cells at most for each marker."""


class Field(NamedTuple):
    """Markers by the cell of a grid: those of cell c are ``member[first[c]:first[c + 1]]``.

    A scan along one axis would meet a whole column of a regular layout.
    """

    xyz: Array  # (N, 3)
    normal: Array  # (N, 3), zero where unknown
    gate: Array  # (N,) how near another one must be to be the one it is brought onto
    first: Ints
    member: Ints
    low: Array  # (3,) the grid's corner
    per_unit: float  # cells per unit of length
    size: Ints  # (3,) cells along each axis


class Motions(NamedTuple):
    """The best distinct motions; ``brought`` is 0 where there is none."""

    onto: Ints  # (S, N) the marker onto which each one is brought or -1
    brought: NDArray[np.int64]  # (S,) number of these markers
    serial: NDArray[np.int64]  # (S,) in order of their finding


def alike_triangles(model: Model, triangles: Ints) -> list[tuple[Ints, Ints]]:
    """Triangles (K, 3) of neighbours that look like some of those given (T, 3), and which ones (K, 3), in batches."""
    xyz, near, order = model.xyz, model.near[:, :NEIGHBOURS], _order(len(model.xyz))
    second, third = (way.ravel() for way in np.nonzero(~np.eye(near.shape[1], dtype=bool)))
    a, b, c = np.repeat(order, len(second)), near[order][:, second].ravel(), near[order][:, third].ravel()
    images, found = np.stack([a, b, c], axis=1).astype(np.int32), []
    for some in np.array_split(triangles, 1 if len(xyz) <= 2 * SAMPLE else len(triangles)):
        of, row = np.nonzero(_alike(xyz, some, images))
        found.append((images[row], some[of]))
    return found


def symmetries_of(model: Model, alike: list[tuple[Ints, Ints]], least: int, most: int, *, mirrored: bool) -> Ints:
    """Motions that bring a triangle onto one that is alike, and the markers all round onto others.

    Parameters
    ----------
    alike : from `alike_triangles`
    least : markers that must be brought onto others
    most : motions kept, those of most markers
    mirrored : reflections instead of rotations; else the identity is not among them

    Returns
    -------
    (S, N) the marker onto which each one is brought or -1.
    """
    xyz, field, sample, found = model.xyz, field_of(model), _sample(len(model.xyz)), _room(most, len(model.xyz))
    for image, triangle in alike:
        turn, shift = _of_triangles(xyz, triangle, image, -1.0 if mirrored else 1.0)
        around = model.near[triangle[:, 0], :NEIGHBOURS]
        motions_kernel(field, around, sample, turn, shift, least, mirrored, found)
    # A triangle tells the turn of a large model roughly, so of a motion and the way back (the shift by a row to the
    # right and to the left) one may be found and the other not. A rival needs both.
    onto = found.onto[found.brought > 0]
    if len(onto):
        turn, shift = motions_of(xyz, onto, -1.0 if mirrored else 1.0)
        back = turn.transpose(0, 2, 1)
        turn, shift = np.concatenate([turn, back]), np.concatenate([shift, -np.einsum("sij,sj->si", back, shift)])
        middle = [(m := np.flatnonzero(row >= 0))[len(m) // 2] for row in onto]
        around = model.near[np.concatenate([middle, onto[np.arange(len(onto)), middle]]), :NEIGHBOURS]
        motions_kernel(field, around, sample, turn, shift, least, mirrored, found)
    return _best_first(found)


def symmetries_at(model: Model, marker: int, to: int, least: int, most: int) -> Ints:
    """Motions that bring a marker onto another one, or onto itself, and its neighbours onto that one's.

    Of a regular layout of many markers these are few among hundreds, most of which bring more markers onto others.

    Parameters
    ----------
    marker, to : which one, and onto which
    least, most : see `symmetries_of`

    Returns
    -------
    (S, N) the marker onto which each one is brought or -1; the identity is not among them.
    """
    xyz, field, sample, found = model.xyz, field_of(model), _sample(len(model.xyz)), _room(most, len(model.xyz))
    near, near_to = model.near[marker, :NEIGHBOURS], model.near[to, :NEIGHBOURS]
    triangle = np.array([(marker, *two) for two in combinations(near, 2)], dtype=np.int32).reshape(-1, 3)
    image = np.array([(to, *two) for two in permutations(near_to, 2)], dtype=np.int32).reshape(-1, 3)
    of, row = np.nonzero(_alike(xyz, triangle, image))
    turn, shift = _of_triangles(xyz, triangle[of], image[row], 1.0)
    motions_kernel(field, near[None].repeat(len(of), axis=0), sample, turn, shift, least, False, found)
    if len(onto := found.onto[found.brought > 0]):  # a triangle tells the turn of a large model roughly
        motions_kernel(field, near[None].repeat(len(onto), axis=0), sample, *motions_of(xyz, onto, 1.0), least, False,
                       found)  # fmt: skip
    onto = _best_first(found)
    return onto[onto[:, marker] == to]


def motions_of(xyz: Array, onto: Ints, determinant: float) -> tuple[Array, Array]:
    """Rotations (S, 3, 3) with a determinant of 1 or -1, and translations (S, 3), that bring markers onto others best.

    By least squares (Kabsch 1976): that of the triangle by which a motion was found is less sure far from it.
    """
    used = (onto >= 0).astype(float)
    to, count = xyz[np.maximum(onto, 0)], used.sum(axis=1)[:, None]
    centre, centre_to = used @ xyz / count, np.einsum("sn,sna->sa", used, to) / count
    products = np.einsum("sn,sna,nb->sab", used, to, xyz) - count[:, None] * centre_to[:, :, None] * centre[:, None]
    left, _, right = np.linalg.svd(products)
    left[:, :, 2] *= (determinant * np.linalg.det(left @ right))[:, None]
    turn = left @ right
    return turn, centre_to - np.einsum("sab,sb->sa", turn, centre)


def _alike(xyz: Array, triangles: Ints, images: Ints) -> NDArray[np.bool_]:
    """(T, K) whether triangles (T, 3) and images (K, 3) have sides of about the same lengths, corner by corner."""
    alike = np.ones((len(triangles), len(images)), dtype=bool)
    for one, other in ((0, 1), (0, 2), (1, 2)):
        own = _lengths2(xyz, triangles[:, one], triangles[:, other])[:, None]
        side = _lengths2(xyz, images[:, one], images[:, other])
        alike &= (side < STRETCH**2 * own) & (own < STRETCH**2 * side)
    return alike


def _of_triangles(xyz: Array, triangle: Ints, image: Ints, hand: float) -> tuple[Array, Array]:
    """Rotations (K, 3, 3), or (hand -1) reflections, and translations (K, 3) from triangles (K, 3) to their images."""
    to, corners = xyz[image], xyz[triangle]
    turn = _axes(to, hand).transpose(0, 2, 1) @ _axes(corners, 1.0)
    return turn, to.mean(axis=1) - (turn @ corners.mean(axis=1)[:, :, None])[:, :, 0]


def _room(most: int, n: int) -> Motions:
    return Motions(np.full((most, n), -1, np.int32), np.zeros(most, np.int64), np.zeros(most, np.int64))


def _best_first(found: Motions) -> Ints:
    best = np.lexsort([found.serial, -found.brought])
    return found.onto[best[: (found.brought > 0).sum()]]


def _sample(n: int) -> Ints:
    return _order(n)[int(n > 2 * SAMPLE) :][: SAMPLE if n > 2 * SAMPLE else n].astype(np.int32)


def _order(n: int) -> NDArray[np.int64]:
    """A marker after the other; of many the next one is far away, so that a few stand for all."""
    number = np.arange(n)
    return number if n <= 2 * SAMPLE else number * STRIDES[n % STRIDES[0] == 0] % n


def _lengths2(xyz: Array, a: ArrayLike, b: ArrayLike) -> Array:
    return np.asarray(((xyz[np.asarray(a)] - xyz[np.asarray(b)]) ** 2).sum(axis=-1))


def _axes(corners: Array, hand: float) -> Array:
    """(T, 3, 3) rows: to the second corner, in the triangle's plane, across it; right-handed or (-1) left-handed."""
    along, in_plane = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    in_plane = in_plane - (in_plane * along).sum(axis=1, keepdims=True) * along
    with np.errstate(invalid="ignore"):  # three in a row have no plane and bring nothing anywhere
        in_plane /= np.linalg.norm(in_plane, axis=1, keepdims=True)
    return np.stack([along, in_plane, hand * np.cross(along, in_plane)], axis=1)


def field_of(model: Model) -> Field:
    """The markers by cell."""
    xyz = model.xyz
    low, extent = xyz.min(axis=0), np.ptp(xyz, axis=0)
    side = max(float(extent.max()) / 256.0, 1e-12)
    while np.prod(size := (extent / side).astype(np.int32) + 1) > CELLS_PER_MARKER * len(xyz) + 8:
        side *= 1.25
    cell = np.ravel_multi_index(tuple(np.minimum(((xyz - low) / side).astype(np.int64), size - 1).T), tuple(size))
    first = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=int(np.prod(size))))]).astype(np.int32)
    gate = NEAR * np.sqrt(_lengths2(xyz, np.arange(len(xyz)), model.near[:, 0]))
    member = np.argsort(cell, kind="stable").astype(np.int32)
    return Field(xyz, model.normal, gate, first, member, low, 1.0 / side, size)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def motions_kernel(
    field: Field, around: Ints, sample: Ints, turn: Array, shift: Array, least: int, itself: bool, found: Motions
) -> None:
    """Keep those of the motions (M, 3, 3), (M, 3) that bring enough markers onto others, first those ``around`` (M, K).

    Unless ``itself`` they must not bring most markers onto themselves.
    """
    image, count, serial = found
    n, kept, eighth = image.shape[1], serial.max(), max(sample.shape[0] // 8, 1)
    every, onto, taken = np.arange(n).astype(np.int32), np.empty(n, np.int32), np.empty(n, np.bool_)
    alike = np.empty(count.shape[0], np.bool_)
    for s in range(turn.shape[0]):
        if 2 * _bring(field, around[s], turn[s], shift[s], onto) < around.shape[1]:
            continue
        # The place of the motion that this one takes: that of fewest markers, the latest of these.
        place = 0
        for o in range(count.shape[0]):
            if count[o] < count[place] or (count[o] == count[place] and serial[o] > serial[place]):
                place = o
        sampled, share = 0, max(least, count[place]) / n
        for tried in range(eighth, sample.shape[0] + 1 if sample.shape[0] < n else 0, eighth):
            sampled += _bring(field, sample[tried - eighth : tried], turn[s], shift[s], onto)
            if sampled < share * tried - UNLUCKY * math.sqrt(share * (1.0 - share) * tried):
                sampled = -1
                break
        if sampled < 0:
            continue
        _bring(field, every, turn[s], shift[s], onto)
        taken[:] = False
        brought, same = 0, 0
        for m in range(n):
            if onto[m] >= 0 and taken[onto[m]]:
                onto[m] = -1
            if onto[m] >= 0:
                taken[onto[m]] = True
                brought += 1
                same += onto[m] == m
        if brought < least or brought <= count[place] or (2 * same >= brought and not itself):
            continue
        # Instead of worse ones that bring most markers to the same place; not at all if one of those is as good.
        better = False
        for o in range(count.shape[0]):
            both, mine, its = 0, 0, 0
            for m in sample:
                both += onto[m] >= 0 and onto[m] == image[o, m]
                mine += onto[m] >= 0
                its += image[o, m] >= 0
            alike[o] = count[o] > 0 and 2 * both > min(mine, its)
            better = better or (alike[o] and brought <= count[o])
        if better:
            continue
        for o in range(count.shape[0]):
            if alike[o]:
                count[o], serial[o], place = 0, 0, o
        kept += 1
        count[place], serial[place], image[place] = brought, kept, onto


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _bring(field: Field, some: Ints, r: Array, t: Array, onto: Ints) -> int:
    """The marker onto which each of some is brought, -1 if there is none or it faces another way; how many are."""
    xyz, normal, gates, first, member, low = field.xyz, field.normal, field.gate, field.first, field.member, field.low
    per_unit, (rows, columns, layers), count = field.per_unit, (field.size[0], field.size[1], field.size[2]), 0
    for m in some:
        onto[m] = -1
        x = r[0, 0] * xyz[m, 0] + r[0, 1] * xyz[m, 1] + r[0, 2] * xyz[m, 2] + t[0]
        y = r[1, 0] * xyz[m, 0] + r[1, 1] * xyz[m, 1] + r[1, 2] * xyz[m, 2] + t[1]
        z = r[2, 0] * xyz[m, 0] + r[2, 1] * xyz[m, 1] + r[2, 2] * xyz[m, 2] + t[2]
        u, v, w, d = (x - low[0]) * per_unit, (y - low[1]) * per_unit, (z - low[2]) * per_unit, gates[m] * per_unit
        if not (u + d >= 0.0 and v + d >= 0.0 and w + d >= 0.0):
            continue
        best, found = gates[m] ** 2, -1
        for i in range(int(max(u - d, 0.0)), min(int(min(u + d, 1e9)), rows - 1) + 1):
            for j in range(int(max(v - d, 0.0)), min(int(min(v + d, 1e9)), columns - 1) + 1):
                for k in range(int(max(w - d, 0.0)), min(int(min(w + d, 1e9)), layers - 1) + 1):
                    at = (i * columns + j) * layers + k
                    for place in range(first[at], first[at + 1]):
                        o = member[place]
                        d2 = (x - xyz[o, 0]) ** 2 + (y - xyz[o, 1]) ** 2 + (z - xyz[o, 2]) ** 2
                        if d2 < best:
                            best, found = d2, o
        if found < 0:
            continue
        cosine, known = 0.0, 0.0
        for p in range(3):
            turned = r[p, 0] * normal[m, 0] + r[p, 1] * normal[m, 1] + r[p, 2] * normal[m, 2]
            cosine += turned * normal[found, p]
            known += abs(normal[m, p])
        if known == 0.0 or cosine >= TURNED:
            onto[m] = found
            count += 1
    return count
