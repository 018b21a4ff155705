"""The epipolar line of a spot in the other picture as taken: a curve where the lens distorts."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.camera import Camera
from windmark.geometry.pose import Pose

Array = NDArray[np.float64]

_SPACING_PX = 4.0
_IN_FRONT = 1e-6  # least depth in camera b, in units of the distance along the ray


def epipolar_curve(
    xy_a: ArrayLike,
    camera_a: Camera,
    camera_b: Camera,
    b_from_a: Pose,
    *,
    depth: tuple[float, float] = (0.0, np.inf),
) -> Array:
    """Where a spot of picture a may lie in picture b, as a polyline to draw.

    Points along the ray of the spot are projected with the full camera model; what falls outside picture b, behind
    camera b or beyond the lens model is left out.

    Parameters
    ----------
    xy_a : (2,) pixels as taken
    depth : range of z in camera a, in the unit of the baseline; the end may be infinite

    Returns
    -------
    (K, 2) pixels as taken, about four pixels apart, from near to far; a row of NaN separates parts where the curve
    leaves the picture and comes back. K = 0 where nothing of it is in the picture.

    Raises
    ------
    ValueError
        ``xy_a`` is not one spot, or ``depth`` is no range.
    """
    p = np.asarray(xy_a, dtype=float)
    near, far = map(float, depth)
    if p.shape != (2,):
        raise ValueError(f"epipolar_curve: xy_a must be one spot (2,), got {p.shape}")
    if not 0 <= near < far:
        raise ValueError(f"epipolar_curve: depth must be 0 <= near < far, got {depth}")
    ends = _ends(b_from_a.rotate(camera_a.unproject(p)), b_from_a.translation, near, far)
    if ends is None:
        return np.empty((0, 2))
    segment = _clip(*ends, _ideal_bounds(camera_b))
    if segment is None:
        return np.empty((0, 2))
    first, last = segment
    length = float(np.linalg.norm(last - first)) * camera_b.focal_px
    share = np.linspace(0, 1, 2 + int(min(length, 1e5) / _SPACING_PX))[:, None]
    ideal = first + share * (last - first)
    xy, _ = camera_b.project(np.column_stack([ideal, np.ones(len(ideal))]))
    return _trimmed(np.where(camera_b.in_image(xy)[:, None], xy, np.nan))


def _ends(ray: Array, t: Array, near: float, far: float) -> tuple[Array, Array] | None:
    """Ideal coordinates of ``z ray + t`` at both ends of the part of the range that is in front of camera b."""
    if not np.isfinite(ray).all():
        return None
    if ray[2] > 0:
        near = max(near, float(-t[2] + _IN_FRONT * np.linalg.norm(t)) / float(ray[2]))
    elif ray[2] < 0:
        far = min(far, float(-t[2] + _IN_FRONT * np.linalg.norm(t)) / float(ray[2]))
    elif t[2] <= 0:
        return None
    if not near < far:
        return None
    first, last = near * ray + t, (ray if np.isinf(far) else far * ray + t)
    return (first[:2] / first[2], last[:2] / last[2]) if first[2] > 0 and last[2] > 0 else None


def _ideal_bounds(camera: Camera) -> Array:
    """Box (2, 2), rows low and high, of ideal coordinates that holds the picture; wide where the lens model ends."""
    w, h = camera.size_px
    x, y = np.linspace(-0.5, w - 0.5, 33), np.linspace(-0.5, h - 0.5, 33)
    border = np.concatenate(
        [np.column_stack([x, 0 * x + v]) for v in y[[0, -1]]] + [np.column_stack([0 * y + u, y]) for u in x[[0, -1]]]
    )
    ideal = camera.unproject(border)[:, :2]
    if not np.isfinite(ideal).all():
        return np.array([[-1.0, -1.0], [1.0, 1.0]]) * 10.0
    low, high = ideal.min(axis=0), ideal.max(axis=0)
    return np.stack([low - 0.02 * (high - low), high + 0.02 * (high - low)])


def _clip(p: Array, q: Array, bounds: Array) -> tuple[Array, Array] | None:
    """Part of the segment p-q in a box (Liang and Barsky); None if there is none."""
    start, stop = 0.0, 1.0
    for k in range(2):
        d = float(q[k] - p[k])
        if d == 0:
            if not bounds[0, k] <= p[k] <= bounds[1, k]:
                return None
            continue
        enter, leave = sorted([float(bounds[0, k] - p[k]) / d, float(bounds[1, k] - p[k]) / d])
        start, stop = max(start, enter), min(stop, leave)
    if not start < stop:
        return None
    return p + start * (q - p), p + stop * (q - p)


def _trimmed(xy: Array) -> Array:
    """Without NaN at the ends and with one row of NaN, not many, in between."""
    known = np.isfinite(xy[:, 0])
    keep = known | np.append(False, known[:-1])
    keep[: int(np.argmax(known))] = False
    xy = xy[keep] if known.any() else np.empty((0, 2))
    return xy[:-1] if len(xy) and np.isnan(xy[-1, 0]) else xy
