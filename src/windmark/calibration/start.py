"""Where every picture was taken from, found from rough marker coordinates: the start of a calibration.

P3P on wide triplets of markers gives poses; a pose is judged by the median residual of all its marks, so rough
coordinates, an uncorrected lens and a third of wrong labels do no harm. An unknown focal length is scanned: the one
that serves all pictures of a camera best.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose, p3p

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

TRIPLETS, DRAWN = 24, 200
"""Triplets tried per picture, the widest of so many drawn at random."""
FACTORS = tuple(np.geomspace(0.5, 2.0, 13))
"""Focal lengths tried, relative to the given one; 1 is among them."""
SCANNED, SCANNED_MARKS = 8, 30
"""Pictures that the focal lengths are tried on, those with the most marks, spread over all; and marks of each, or up
to twice as many."""
LEAST = 4
"""Marks that a picture needs: three give up to four poses."""


def start_poses(
    camera: Camera, marks: list[tuple[Array, Array]], *, scan_focal: bool, rng: np.random.Generator
) -> tuple[Camera, list[Pose | None], Array]:
    """A pose of every picture of one camera.

    Parameters
    ----------
    camera : start values
    marks : for each picture (xy (K, 2), xyz (K, 3)), rough coordinates
    scan_focal : try other focal lengths, too
    rng : for the choice of triplets

    Returns
    -------
    camera : with the best focal length of those tried
    poses : a pose for each picture, None where there is none
    median_px : median residual of each picture, inf without a pose
    """
    triplets = [_wide_triplets(xy, xyz, rng) if len(xy) >= LEAST else None for xy, xyz in marks]
    if scan_focal:
        some = _scanned([len(xy) for xy, _ in marks])
        trials = [replace(camera, focal_px=camera.focal_px * float(factor)) for factor in FACTORS]
        asked = [(*_thinned(*marks[m]), _wide_triplets(*_thinned(*marks[m]), rng)[::2]) for m in some]
        camera = min(trials, key=lambda trial: _misfit([_best_pose(trial, *each)[0] for each in asked]))
    found = [_best_pose(camera, *m, t) for m, t in zip(marks, triplets, strict=True)]
    return camera, [f[1] for f in found], np.array([f[0] for f in found])


def _scanned(count: list[int]) -> list[int]:
    """Numbers of the pictures that the focal lengths are tried on, from how many marks each has."""
    full = np.flatnonzero(np.array(count) >= max(np.median(count), LEAST))
    return full[np.unique(np.linspace(0, len(full) - 1, SCANNED).round().astype(int))].tolist() if len(full) else []


def _thinned(xy: Array, xyz: Array) -> tuple[Array, Array]:
    """Some of the marks, taken evenly."""
    step = max(1, len(xy) // SCANNED_MARKS)
    return xy[::step], xyz[::step]


def _misfit(median: list[float]) -> float:
    """Of the median residuals of some pictures, those without a pose left out."""
    # Relative to the focal length a longer one would not gain by shrinking the picture of errors.
    finite = [m for m in median if np.isfinite(m)]
    return float(np.median(finite)) if finite else np.inf


def _wide_triplets(xy: Array, xyz: Array, rng: np.random.Generator) -> Ints:
    """(T, 3) triplets that are wide both in the picture and on the model."""
    k = len(xy)
    drawn = np.sort(np.argsort(rng.random((DRAWN, k)), axis=1)[:, :3], axis=1)
    u, v = (xy[drawn[:, n]] - xy[drawn[:, 0]] for n in (1, 2))
    a, b = (xyz[drawn[:, n]] - xyz[drawn[:, 0]] for n in (1, 2))
    area = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    width = np.sqrt(area) * np.linalg.norm(np.cross(a, b), axis=1)
    return drawn[np.argsort(-width, kind="stable")[: 2 * TRIPLETS : 2]]


def _best_pose(camera: Camera, xy: Array, xyz: Array, triplets: Ints | None) -> tuple[float, Pose | None]:
    """The pose of the smallest median residual among those of all triplets."""
    if triplets is None:
        return np.inf, None
    rays = camera.directions(xy)
    if not np.isfinite(rays).all():
        bare = replace(camera, k1=0, k2=0, k3=0, p1=0, p2=0, k4=0, k5=0, k6=0)
        rays = np.where(np.isfinite(rays), rays, bare.directions(xy))
    solutions = p3p(rays[triplets], xyz[triplets])
    there = solutions.valid
    rotation, translation = solutions.rotation[there], solutions.translation[there]
    if not len(rotation):
        return np.inf, None
    seen, valid = camera.project(xyz @ rotation.transpose(0, 2, 1) + translation[:, None])
    distance = np.where(valid, np.linalg.norm(seen - xy, axis=2), np.inf)
    median = np.median(distance, axis=1)
    n = int(median.argmin())
    return float(median[n]), Pose(rotation[n], translation[n]) if np.isfinite(median[n]) else None
