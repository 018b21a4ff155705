"""Near-symmetries of a set of markers as a numba kernel: motions that bring many markers onto others.

Private to the registration room. Under such a motion (half a turn of a grid, a shift along a row) the picture hardly
changes, so each of them makes a rival of every solution. Readable twin: tests/registration/test_layout.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

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


@nb.njit(cache=True, nogil=True, error_model="numpy")
def symmetries_kernel(model: Model, triangles: Ints, least: int, most: int) -> tuple[Ints, Array, Array]:
    """Motions that bring the first corner of one of the triangles (T, 3) and its surroundings onto others.

    Parameters
    ----------
    least : markers that must be brought onto others
    most : motions kept, those of most markers

    Returns
    -------
    (S, N) the marker onto which each one is brought or -1; (S, 3, 3) rotations and (S, 3) translations.
    """
    n = model.xyz.shape[0]
    reach = min(NEIGHBOURS, model.near.shape[1])
    image, count = np.full((most, n), -1, np.int32), np.zeros(most, np.int64)
    rotation, translation = np.zeros((most, 3, 3)), np.zeros((most, 3))
    r, t, onto = np.empty((3, 3)), np.empty(3), np.empty(n, np.int32)
    by_x = np.argsort(model.xyz[:, 0], kind="mergesort")
    along = model.xyz[by_x, 0]
    for q in range(triangles.shape[0]):
        i, j, k = triangles[q, 0], triangles[q, 1], triangles[q, 2]
        for a in range(n):
            for x in range(reach):
                b = model.near[a, x]
                if not _alike(model.xyz, i, j, a, b):
                    continue
                for y in range(reach):
                    c = model.near[a, y]
                    if y == x or not (_alike(model.xyz, i, k, a, c) and _alike(model.xyz, j, k, b, c)):
                        continue
                    _motion(model.xyz, i, j, k, a, b, c, r, t)
                    if not _agrees(model, by_x, along, i, a, r, t, reach):
                        continue
                    brought = _bring(model, by_x, along, r, t, onto, max(least, count[most - 1]))
                    if brought >= least:
                        _keep(onto, brought, r, t, image, count, rotation, translation)
    used = 0
    while used < most and count[used] > 0:
        used += 1
    return image[:used], rotation[:used], translation[:used]


@nb.njit(cache=True, nogil=True)
def _alike(xyz: Array, i: int, j: int, a: int, b: int) -> bool:
    """Whether two sides are about equally long."""
    one, other = 0.0, 0.0
    for axis in range(3):
        one += (xyz[i, axis] - xyz[j, axis]) ** 2
        other += (xyz[a, axis] - xyz[b, axis]) ** 2
    return one < STRETCH**2 * other and other < STRETCH**2 * one


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _axes(xyz: Array, i: int, j: int, k: int, out: Array) -> None:
    """Rows: towards j, in the triangle's plane, across it."""
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
    out[2] = np.cross(out[0], out[1])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _motion(xyz: Array, i: int, j: int, k: int, a: int, b: int, c: int, r: Array, t: Array) -> None:
    """Motion of one triangle onto another: of its axes, and of its centre."""
    one, other = np.empty((3, 3)), np.empty((3, 3))
    _axes(xyz, i, j, k, one)
    _axes(xyz, a, b, c, other)
    for p in range(3):
        t[p] = (xyz[a, p] + xyz[b, p] + xyz[c, p]) / 3.0
        for q in range(3):
            r[p, q] = other[0, p] * one[0, q] + other[1, p] * one[1, q] + other[2, p] * one[2, q]
            t[p] -= r[p, q] * (xyz[i, q] + xyz[j, q] + xyz[k, q]) / 3.0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _onto(model: Model, by_x: NDArray[np.int64], along: Array, m: int, r: Array, t: Array) -> int:
    """The marker onto which marker m is brought; -1 if there is none or it faces another way."""
    xyz, normal = model.xyz, model.normal
    x = r[0, 0] * xyz[m, 0] + r[0, 1] * xyz[m, 1] + r[0, 2] * xyz[m, 2] + t[0]
    y = r[1, 0] * xyz[m, 0] + r[1, 1] * xyz[m, 1] + r[1, 2] * xyz[m, 2] + t[1]
    z = r[2, 0] * xyz[m, 0] + r[2, 1] * xyz[m, 1] + r[2, 2] * xyz[m, 2] + t[2]
    first = model.near[m, 0]
    best = (xyz[m, 0] - xyz[first, 0]) ** 2 + (xyz[m, 1] - xyz[first, 1]) ** 2 + (xyz[m, 2] - xyz[first, 2]) ** 2
    best, found = NEAR**2 * best, -1
    reach = math.sqrt(best)
    for place in range(np.searchsorted(along, x - reach), along.shape[0]):
        o = by_x[place]
        if along[place] > x + reach:
            break
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
def _agrees(
    model: Model, by_x: NDArray[np.int64], along: Array, i: int, a: int, r: Array, t: Array, reach: int
) -> bool:
    """Whether the motion is none of the identity's and brings half of the neighbours onto others."""
    if i == a and _onto(model, by_x, along, model.near[i, 0], r, t) == model.near[i, 0]:
        return False
    good = 0
    for x in range(reach):
        good += _onto(model, by_x, along, model.near[i, x], r, t) >= 0
    return 2 * good >= reach


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _bring(model: Model, by_x: NDArray[np.int64], along: Array, r: Array, t: Array, onto: Ints, least: int) -> int:
    """Where every marker is brought, one to one; how many are, 0 if fewer than ``least``."""
    taken, count, same = np.zeros(onto.shape[0], np.bool_), 0, 0
    for m in range(onto.shape[0]):
        onto[m] = _onto(model, by_x, along, m, r, t)
        if onto[m] >= 0 and taken[onto[m]]:
            onto[m] = -1
        if onto[m] >= 0:
            taken[onto[m]] = True
            count += 1
            same += onto[m] == m
        elif count + onto.shape[0] - 1 - m < least:
            return 0
    return count if 2 * same < count else 0


@nb.njit(cache=True, nogil=True)
def _keep(
    onto: Ints, brought: int, r: Array, t: Array, image: Ints, count: NDArray[np.int64], rotation: Array,
    translation: Array,
) -> None:  # fmt: skip
    """Insert a motion, most markers first, unless one that brings most markers to the same place is there."""
    most = count.shape[0]
    for s in range(most):
        same = 0
        for m in range(onto.shape[0]):
            same += onto[m] >= 0 and onto[m] == image[s, m]
        if 2 * same > min(brought, count[s]) and count[s] > 0:
            if brought <= count[s]:
                return
            # A better version of the same one: take that out, and insert this.
            for q in range(s, most - 1):
                count[q], image[q] = count[q + 1], image[q + 1]
                rotation[q], translation[q] = rotation[q + 1], translation[q + 1]
            count[most - 1] = 0
            break
    for s in range(most):
        if brought > count[s]:
            for q in range(most - 1, s, -1):
                count[q], image[q] = count[q - 1], image[q - 1]
                rotation[q], translation[q] = rotation[q - 1], translation[q - 1]
            count[s], image[s], rotation[s], translation[s] = brought, onto, r, t
            return
