"""Displacements of a printed board before a stereo rig, on real pictures (DICe's 14 pairs).

The rig is calibrated on every second pair, from the pictures; in the others the discs are triangulated. From one of
these to the next the board moves as a rigid body by an unknown amount. Truth is that it is rigid: what a rigid motion
leaves of the discs' displacements, against their stated sigma (`marker_places`, `displacements`), and how much the
distance of neighbours differs from pair to pair.

SIGMA_PX is what `calibration_rig.py` leaves of the same pictures per coordinate, in pixels of full size; ``--quick``
takes pictures of a quarter of the size.
"""

from __future__ import annotations

import sys
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import calibration_rig
from _real_truth import DATA
from windmark import io
from windmark.deformation import MarkerPlaces, displacements, marker_places
from windmark.geometry import Camera, Pose
from windmark.geometry.similarity import align
from windmark.scene import MarkerSet, Observations, View

BOARD = DATA / "dice-stereo-dots"
SIGMA_PX = 0.03
PITCH_MM = 3.5


def board_figures(work: Path, block: int, calibrated: Path, pictures: list[Path]) -> dict[str, float]:
    """Pairs of pictures, ``block`` times smaller than they were, measured by a rig that others have ``calibrated``."""
    calibration_rig.figures_of(pictures, block, (), work / "marks")
    rig = io.read_json(calibrated / "rig.json")["cam_from_rig"]
    cameras = {n: io.read_camera(calibrated / f"camera-{n}.json")[0] for n in rig}
    views = [
        View(n, n, "", Pose(np.array(r["rotation"]), np.array(r["translation"]))) for n, r in rig.items()
    ]  # fmt: skip
    table = io.read_table(
        work / "marks" / "residuals.csv", required=(), known=("image", "name", "x", "y", "dx", "dy", "test", "used")
    )
    image, name = np.array(table.text("image")), np.array(table.text("name"))
    xy = np.column_stack([table.numbers("x"), table.numbers("y")])
    used = table.numbers("used") > 0
    names = sorted(set(name.tolist()))
    markers = MarkerSet.make(names, np.zeros((len(names), 3)))
    pairs = sorted({i[:-2] for i in image.tolist()})
    at = [_pair_places(pair, image, name, xy, used, markers, cameras, views, SIGMA_PX / block) for pair in pairs]
    rest, moves, z = [], [], []
    for before, after in pairwise(at):
        moved = displacements(before, after)
        row = [np.searchsorted(p.marker, moved.marker) for p in (before, after)]
        a, b = before.xyz[row[0]], after.xyz[row[1]]
        body = align(a, b, scale=False)
        left = b - body.apply(a)
        rest.append(left)
        moves.append(np.linalg.norm(moved.vector, axis=1).mean())
        z.append(np.einsum("ki,kij,kj->k", left, np.linalg.inv(moved.cov), left).sum() / (3 * len(left) - 6))
    every = np.concatenate(rest)
    pitch = [_neighbours(p) for p in at]
    return {
        "pairs": len(at), "discs": float(np.mean([len(r) for r in rest])), "moved_mm": float(np.mean(moves)),
        "left_rms_mm": float(np.sqrt((every**2).sum(axis=1).mean())),
        "left_in_depth_mm": float(np.sqrt((every[:, 2] ** 2).mean())), "z": float(np.sqrt(np.mean(z))),
        "distance_spread_mm": float(np.sqrt(np.mean(np.concatenate(_spread(pitch)) ** 2))),
    }  # fmt: skip


def _pair_places(
    pair: str, image: np.ndarray, name: np.ndarray, xy: np.ndarray, used: np.ndarray, markers: MarkerSet,
    cameras: dict[str, Camera], views: list[View], sigma_px: float,
) -> MarkerPlaces:  # fmt: skip
    """The discs of one pair of pictures, triangulated."""
    order = {str(n): k for k, n in enumerate(markers.name)}
    view, point, seen = [], [], []
    for v, end in enumerate(("_0", "_1")):
        for k in np.flatnonzero(used & (image == pair + end)):
            view.append(v)
            point.append(order[str(name[k])])
            seen.append(xy[k])
    cov = np.tile(sigma_px**2 * np.eye(2), (len(seen), 1, 1))
    return marker_places(Observations(np.array(view), np.array(point), np.array(seen), cov), markers, cameras, views)


def _neighbours(places: MarkerPlaces) -> dict[tuple[int, int], float]:
    """Distances between discs that are next to each other, by their indices."""
    good = places.reason == ""
    xyz, marker = places.xyz[good], places.marker[good]
    pairs = cKDTree(xyz).query_pairs(1.2 * PITCH_MM)
    return {(int(marker[a]), int(marker[b])): float(np.linalg.norm(xyz[a] - xyz[b])) for a, b in pairs}


def _spread(pitch: list[dict[tuple[int, int], float]]) -> list[np.ndarray]:
    """Each distance less its mean over the pairs of pictures."""
    keys = {k for p in pitch for k in p}
    values = [np.array([p[k] for p in pitch if k in p]) for k in keys]
    return [v - v.mean() for v in values if len(v) > 1]


def main(quick: bool = False) -> dict[str, float]:
    """Measure, print, return the figures."""
    if not BOARD.is_dir():
        print("deformation_board: the real pictures are not here")
        return {}
    with tempfile.TemporaryDirectory() as place:
        block = 4 if quick else 1
        pictures = calibration_rig.smaller(Path(place), block) if quick else sorted((BOARD / "images").iterdir())
        even = [p for k in range(0, len(pictures), 4) for p in pictures[k : k + 2]]
        calibration_rig.figures_of(even, block, (), Path(place) / "rig")
        others = [p for p in pictures if p not in even]
        figures = board_figures(Path(place), block, Path(place) / "rig", others)
    print("DICe board: " + ", ".join(f"{k} {v:.3g}" for k, v in figures.items()), flush=True)
    return figures


if __name__ == "__main__":
    main("--quick" in sys.argv)
