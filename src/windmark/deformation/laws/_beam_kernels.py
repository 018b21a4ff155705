"""Where a bent and twisted beam takes points, and the derivatives. Private to `beam`.

Readable twin: tests/deformation/test_laws.py.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.geometry._jit import nb

STEEP = 1e-6
"""Least squared cosine of a slope: a search may try bendings that no beam can take."""


@nb.njit(cache=True, nogil=True)
def bend(
    q: Any, many_bend: int, many_twist: int, frame: Any, foot: Any, arms: Any, values: Any, slopes: Any, between: Any,
    share: Any, place: Any, by_q: Any,
) -> None:  # fmt: skip
    """Fill places (N, 3) and, unless it is empty, their derivatives (N, 3, K).

    ``q`` (K,): of bending, twist, sway. ``frame`` (3, 3): axis, up, axis x up as rows. ``foot`` (N, 3) on the axis;
    ``arms`` (N, 3, 3): the part of the arm from there along the sections' normal, the part across it, and normal x arm,
    as rows. ``values``, ``slopes`` (N, K) of the shapes there, the twist's in radians, ``between`` (N, G, K) slopes at
    the nodes between root and foot, ``share`` (N, G) their weights.
    """
    axis, up, side = frame[0], frame[1], frame[2]
    count, derive, sway = len(q), by_q.shape[0] > 0, many_bend + many_twist
    back, arm, turned = np.empty(count), np.empty(3), np.empty(3)
    u, ua, uua, ut, uut = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    by_slope, first, second = np.empty((2, 3)), np.empty(3), np.empty(3)
    for n in range(len(foot)):
        w, v, dw, dv, angle = 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(count):
            if k < many_bend:
                w, dw = w + q[k] * values[n, k], dw + q[k] * slopes[n, k]
            elif k < sway:
                angle += q[k] * values[n, k]
            else:
                v, dv = v + q[k] * values[n, k], dv + q[k] * slopes[n, k]
        shorter = shortening(q, many_bend, sway, between[n], share[n], back)
        # Sections lean with the axis, the least rotation: arm + u x arm + u x (u x arm) / (1 + c).
        c = math.sqrt(max(1.0 - dw * dw - dv * dv, STEEP))
        part = 1.0 / (1.0 + c)
        cos, sin = math.cos(angle), math.sin(angle)
        for m in range(3):
            u[m] = dw * side[m] - dv * up[m]
            arm[m] = arms[n, 0, m] + cos * arms[n, 1, m] + sin * arms[n, 2, m]
            turned[m] = cos * arms[n, 2, m] - sin * arms[n, 1, m]
        cross(u, arm, ua)
        cross(u, ua, uua)
        for m in range(3):
            moved = foot[n, m] - shorter * axis[m] + w * up[m] + v * side[m]
            place[n, m] = moved + arm[m] + ua[m] + part * uua[m]
        if not derive:
            continue
        rise = part * part / c  # of `part` with half the squared slope
        for s in range(2):
            for m in range(3):
                first[m] = side[m] if s == 0 else -up[m]
            cross(first, arm, by_slope[s])
            cross(first, ua, second)
            cross(u, by_slope[s], first)
            for m in range(3):
                by_slope[s, m] += part * (first[m] + second[m]) + rise * (dw if s == 0 else dv) * uua[m]
        cross(u, turned, ut)
        cross(u, ut, uut)
        for m in range(3):
            for k in range(count):
                if k < many_bend:
                    by_q[n, m, k] = up[m] * values[n, k] - axis[m] * back[k] + by_slope[0, m] * slopes[n, k]
                elif k < sway:
                    by_q[n, m, k] = (turned[m] + ut[m] + part * uut[m]) * values[n, k]
                else:
                    by_q[n, m, k] = side[m] * values[n, k] - axis[m] * back[k] + by_slope[1, m] * slopes[n, k]


@nb.njit(cache=True, nogil=True)
def shortening(q: Any, many_bend: int, sway: int, between: Any, share: Any, back: Any) -> float:
    """How far the axis comes back at one station; `back` (K,) becomes the derivative, untouched for the twist."""
    shorter = 0.0
    for k in range(len(q)):
        back[k] = 0.0
    for g in range(len(share)):
        a, b = 0.0, 0.0
        for k in range(many_bend):
            a += q[k] * between[g, k]
        for k in range(sway, len(q)):
            b += q[k] * between[g, k]
        left = math.sqrt(max(1.0 - a * a - b * b, STEEP))
        shorter += (1.0 - left) * share[g]
        for k in range(many_bend):
            back[k] += share[g] / left * a * between[g, k]
        for k in range(sway, len(q)):
            back[k] += share[g] / left * b * between[g, k]
    return shorter


@nb.njit(cache=True, nogil=True)
def cross(a: Any, b: Any, out: Any) -> None:
    """Cross product of two vectors."""
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
