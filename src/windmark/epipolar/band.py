"""How far spots are from where two-view geometry wants them: epipolar lines, or a homography without a baseline."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera
from windmark.geometry.two_view import TwoView, epipolar_distance, rays_with_cov, transfer
from windmark.scene import Detections

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

GATE = 4.0
"""Spots may be so many sigma off: their own, and that of the geometry."""
LEAST_PX = 0.5
"""And always so many pixels: the lens is never known better."""
TABLE = 300_000
"""Pairs that are looked at together."""


def distance(a: Detections, b: Detections, camera_a: Camera, camera_b: Camera, view: TwoView) -> tuple[Array, Array]:
    """(N,) distance in pixels, signed where it is one to a line, and in sigmas, of pairs row by row."""
    if view.b_from_a is None:
        return _from_homography(a, b, camera_a, camera_b, view, every_pair=False)
    d = epipolar_distance(
        a.xy, b.xy, camera_a, camera_b, view.b_from_a, cov_a=a.cov, cov_b=b.cov, cov_pose=view.cov
    )  # fmt: skip
    return d.sampson_px, d.sigmas


def in_band(a: Detections, b: Detections, camera_a: Camera, camera_b: Camera, view: TwoView) -> Mask:
    """(A, B) pairs of spots that the geometry allows."""
    rows = max(1, TABLE // max(len(b), 1))
    parts = []
    for start in range(0, len(a), rows):
        some = a.take(np.arange(start, min(start + rows, len(a))))
        if view.b_from_a is None:
            px, sigmas = _from_homography(some, b, camera_a, camera_b, view, every_pair=True)
        else:
            d = epipolar_distance(
                some.xy, b.xy, camera_a, camera_b, view.b_from_a,
                cov_a=some.cov, cov_b=b.cov, cov_pose=view.cov, every_pair=True,
            )  # fmt: skip
            px, sigmas = d.sampson_px, d.sigmas
        parts.append(allowed(px, sigmas))
    return np.concatenate(parts) if parts else np.zeros((0, len(b)), np.bool_)


def allowed(px: Array, sigmas: Array) -> Mask:
    """Whether such a distance may be."""
    return np.asarray((np.abs(px) < LEAST_PX) | (np.abs(sigmas) < GATE))


def width_px(px: Array, sigmas: Array) -> float:
    """Half width of the band, from distances of pairs and what they are in sigmas."""
    with np.errstate(invalid="ignore", divide="ignore"):
        sigma = np.nanmedian(np.abs(px / sigmas)) if len(px) else np.nan
    return float(max(LEAST_PX, GATE * sigma)) if np.isfinite(sigma) else LEAST_PX


def _from_homography(
    a: Detections, b: Detections, camera_a: Camera, camera_b: Camera, view: TwoView, *, every_pair: bool
) -> tuple[Array, Array]:
    """Distance from where the homography of a view without a baseline takes a's spots, in px of b and in sigmas."""
    assert view.homography is not None
    rays_a, cov_a = rays_with_cov(camera_a, a.xy, a.cov)
    rays_b, cov_b = rays_with_cov(camera_b, b.xy, b.cov)
    place, seen = transfer(view.homography, rays_a[:, :2]), rays_b[:, :2]
    if every_pair:
        place, cov_a, seen = place[:, None], cov_a[:, None], seen[None]
    gap, cov = np.linalg.norm(seen - place, axis=-1), cov_a + cov_b
    return gap * camera_b.focal_px, gap / np.sqrt(0.5 * np.trace(cov, axis1=-2, axis2=-1))
