"""Near-symmetries of a set of markers as a numba kernel: motions that bring many markers onto others.

Private to the registration room. Under such a motion (half a turn of a grid, a shift along a row) the picture hardly
changes, so each of them makes a rival of every solution. With a reflection it tells what the mirrored model could be
taken for. Readable twin: tests/registration/test_layout.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.registration._kernels.cells import celled
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


@nb.njit(cache=True, nogil=True, error_model="numpy")
def symmetries_kernel(
    model: Model, triangles: Ints, least: int, most: int, mirrored: bool
) -> tuple[Ints, Array, Array]:  # fmt: skip
    """Motions that bring the first corner of one of the triangles (T, 3) and its surroundings onto others.

    Parameters
    ----------
    least : markers that must be brought onto others
    most : motions kept, those of most markers
    mirrored : reflections instead of rotations; else the identity is not among them

    Returns
    -------
    (S, N) the marker onto which each one is brought or -1; (S, 3, 3) rotations and (S, 3) translations.
    """
    n = model.xyz.shape[0]
    xyz, normal, near = model.xyz, model.normal, model.near
    reach = min(NEIGHBOURS, near.shape[1])
    image, count, serial = np.full((most, n), -1, np.int32), np.zeros(most, np.int64), np.zeros(most, np.int64)
    rotation, translation = np.zeros((most, 3, 3)), np.zeros((most, 3))
    r, t, onto, found = np.empty((3, 3)), np.empty(3), np.empty(n, np.int32), 0
    one, other = np.empty((3, 3)), np.empty((3, 3))
    first, member, low, per_unit, size = celled(xyz)
    gate2 = np.empty(n)
    for m in range(n):
        gate2[m] = 0.0
        for axis in range(3):
            gate2[m] += NEAR**2 * (xyz[m, axis] - xyz[near[m, 0], axis]) ** 2
    for q in range(triangles.shape[0]):
        i, j, k = triangles[q, 0], triangles[q, 1], triangles[q, 2]
        _axes(xyz, i, j, k, 1.0, one)
        for number in range(n):
            a = _spread(number, n)
            for x in range(reach):
                b = near[a, x]
                if not _alike(xyz, i, j, a, b):
                    continue
                for y in range(reach):
                    c = near[a, y]
                    if y == x or not (_alike(xyz, i, k, a, c) and _alike(xyz, j, k, b, c)):
                        continue
                    _axes(xyz, a, b, c, -1.0 if mirrored else 1.0, other)
                    _motion(xyz, triangles[q], one, (a, b, c), other, r, t)
                    good = 0
                    for o in range(reach):
                        good += _onto(xyz, normal, gate2, first, member, low, per_unit, size, near[i, o], r, t) >= 0
                    if 2 * good < reach:
                        continue
                    worst = _worst(count, serial)
                    brought = _bring(
                        xyz, normal, gate2, first, member, low, per_unit, size, r, t, onto,
                        max(least, count[worst]), mirrored,
                    )  # fmt: skip
                    if brought < least or brought <= count[worst]:
                        continue
                    place = _keep(onto, brought, worst, found + 1, image, count, serial)
                    if place >= 0:
                        found += 1
                        rotation[place], translation[place] = r, t
    order = np.argsort(serial, kind="mergesort")
    order = order[np.argsort(-count[order], kind="mergesort")][: (count > 0).sum()]
    return image[order], rotation[order], translation[order]


@nb.njit(cache=True, nogil=True)
def _spread(number: int, n: int) -> int:
    """A marker for each number below n; of many the next one is far away, so that a few stand for all."""
    if n <= 2 * SAMPLE:
        return number
    return (number * (STRIDES[0] if n % STRIDES[0] else STRIDES[1])) % n


@nb.njit(cache=True, nogil=True)
def _alike(xyz: Array, i: int, j: int, a: int, b: int) -> bool:
    """Whether two sides are about equally long."""
    one, other = 0.0, 0.0
    for axis in range(3):
        one += (xyz[i, axis] - xyz[j, axis]) ** 2
        other += (xyz[a, axis] - xyz[b, axis]) ** 2
    return one < STRETCH**2 * other and other < STRETCH**2 * one


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _axes(xyz: Array, i: int, j: int, k: int, hand: float, out: Array) -> None:
    """Rows: towards j, in the triangle's plane, across it; right-handed or (-1) left-handed."""
    norm, along = 0.0, 0.0
    for q in range(3):
        out[0, q], out[1, q] = xyz[j, q] - xyz[i, q], xyz[k, q] - xyz[i, q]
        norm += out[0, q] ** 2
    norm = math.sqrt(norm)
    for q in range(3):
        out[0, q] /= norm
        along += out[0, q] * out[1, q]
    norm = 0.0
    for q in range(3):
        out[1, q] -= along * out[0, q]
        norm += out[1, q] ** 2
    norm = math.sqrt(norm)
    for q in range(3):
        out[1, q] /= norm
    for q in range(3):
        u, v = (q + 1) % 3, (q + 2) % 3
        out[2, q] = hand * (out[0, u] * out[1, v] - out[0, v] * out[1, u])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _motion(
    xyz: Array, triangle: Ints, one: Array, image: tuple[int, int, int], other: Array, r: Array, t: Array
) -> None:
    """Motion of one triangle with these axes onto another: of its axes, and of its centre."""
    for p in range(3):
        t[p] = (xyz[image[0], p] + xyz[image[1], p] + xyz[image[2], p]) / 3.0
        for q in range(3):
            r[p, q] = other[0, p] * one[0, q] + other[1, p] * one[1, q] + other[2, p] * one[2, q]
            t[p] -= r[p, q] * (xyz[triangle[0], q] + xyz[triangle[1], q] + xyz[triangle[2], q]) / 3.0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _onto(
    xyz: Array, normal: Array, gate2: Array, first: Ints, member: Ints, low: Array, per_unit: float, size: Ints,
    m: int, r: Array, t: Array,
) -> int:  # fmt: skip
    """The marker onto which marker m is brought; -1 if there is none or it faces another way."""
    x = r[0, 0] * xyz[m, 0] + r[0, 1] * xyz[m, 1] + r[0, 2] * xyz[m, 2] + t[0]
    y = r[1, 0] * xyz[m, 0] + r[1, 1] * xyz[m, 1] + r[1, 2] * xyz[m, 2] + t[1]
    z = r[2, 0] * xyz[m, 0] + r[2, 1] * xyz[m, 1] + r[2, 2] * xyz[m, 2] + t[2]
    best, found = gate2[m], -1
    gate = math.sqrt(best)
    u, v, w, d = (x - low[0]) * per_unit, (y - low[1]) * per_unit, (z - low[2]) * per_unit, gate * per_unit
    if not (u + d >= 0.0 and v + d >= 0.0 and w + d >= 0.0):
        return -1
    if u - d >= size[0] or v - d >= size[1] or w - d >= size[2]:
        return -1
    for i in range(int(max(u - d, 0.0)), min(int(u + d), size[0] - 1) + 1):
        for j in range(int(max(v - d, 0.0)), min(int(v + d), size[1] - 1) + 1):
            for k in range(int(max(w - d, 0.0)), min(int(w + d), size[2] - 1) + 1):
                at = (i * size[1] + j) * size[2] + k
                for place in range(first[at], first[at + 1]):
                    o = member[place]
                    d2 = (x - xyz[o, 0]) ** 2 + (y - xyz[o, 1]) ** 2 + (z - xyz[o, 2]) ** 2
                    if d2 < best:
                        best, found = d2, o
    if found < 0:
        return -1
    cosine, known = 0.0, 0.0
    for p in range(3):
        turned = r[p, 0] * normal[m, 0] + r[p, 1] * normal[m, 1] + r[p, 2] * normal[m, 2]
        cosine += turned * normal[found, p]
        known += abs(normal[m, p])
    if known > 0.0 and cosine < TURNED:
        return -1
    return found


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _bring(
    xyz: Array, normal: Array, gate2: Array, first: Ints, member: Ints, low: Array, per_unit: float, size: Ints,
    r: Array, t: Array, onto: Ints, least: int, itself: bool,
) -> int:  # fmt: skip
    """Where every marker is brought, one to one; how many are.

    0 if fewer than ``least`` or (unless ``itself``) most are brought onto themselves.
    """
    n = onto.shape[0]
    if n > 2 * SAMPLE:
        sampled, share = 0, least / n
        for tried in range(1, SAMPLE + 1):
            m = _spread(tried, n)
            sampled += _onto(xyz, normal, gate2, first, member, low, per_unit, size, m, r, t) >= 0
            if tried % (SAMPLE // 8) == 0 and (
                sampled < share * tried - UNLUCKY * math.sqrt(share * (1.0 - share) * tried)
            ):
                return 0
    taken, count, same = np.zeros(n, np.bool_), 0, 0
    for m in range(n):
        onto[m] = _onto(xyz, normal, gate2, first, member, low, per_unit, size, m, r, t)
        if onto[m] >= 0 and taken[onto[m]]:
            onto[m] = -1
        if onto[m] >= 0:
            taken[onto[m]] = True
            count += 1
            same += onto[m] == m
        elif count + n - 1 - m < least:
            return 0
    return count if itself or 2 * same < count else 0


@nb.njit(cache=True, nogil=True)
def _worst(count: NDArray[np.int64], serial: NDArray[np.int64]) -> int:
    """The place of the motion that the next one takes: that of fewest markers, the latest of these."""
    worst = 0
    for s in range(count.shape[0]):
        if count[s] < count[worst] or (count[s] == count[worst] and serial[s] > serial[worst]):
            worst = s
    return worst


@nb.njit(cache=True, nogil=True)
def _may_be_like(onto: Ints, other: Ints) -> bool:
    """Whether two motions bring one of a few markers to the same place; of alike ones one in 65,000 does not."""
    same = 0
    for tried in range(1, SAMPLE // 8 + 1):
        m = _spread(tried, onto.shape[0])
        same += onto[m] >= 0 and onto[m] == other[m]
    return same > 0


@nb.njit(cache=True, nogil=True)
def _keep(
    onto: Ints, brought: int, worst: int, new: int, image: Ints, count: NDArray[np.int64], serial: NDArray[np.int64]
) -> int:  # fmt: skip
    """Keep a motion with serial number ``new``, instead of worse ones that bring most markers to the same place.

    Its place; -1 if one of those is as good.
    """
    n, place, alike = onto.shape[0], worst, np.zeros(count.shape[0], np.bool_)
    stride = max(1, n // (2 * SAMPLE))
    for s in range(count.shape[0]):
        if count[s] == 0 or (n > 2 * SAMPLE and not _may_be_like(onto, image[s])):
            continue
        same, mine, its = 0, 0, 0
        for m in range(0, n, stride):
            same += onto[m] >= 0 and onto[m] == image[s, m]
            mine += onto[m] >= 0
            its += image[s, m] >= 0
        alike[s] = 2 * same > min(mine, its)
        if alike[s] and brought <= count[s]:
            return -1
    for s in range(count.shape[0]):
        if alike[s]:
            count[s], serial[s], place = 0, 0, s
    count[place], serial[place], image[place] = brought, new, onto
    return place
