"""Deformation on real pictures: a plate moved by known steps.

PIV-E plate     seven positions 1 mm apart before two cameras. Every step is measured with cameras that were calibrated
                on the *other* five positions, so its own 1 mm is nowhere in the cameras. Camera 3 needs an
                aspect ratio and a tilted sensor besides k1, p1, p2 (0.3 px instead of 1 px; the set does not say what
                it looks through): with k1 alone steps come out up to 6 % too small. Marks: the set's own labels, and
                `detect_at` at these. `marker_places` gives single discs; `identify` the plate as a rigid body.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from _matching_real_cases import plate_labels
from _real_truth import DATA
from windmark import io
from windmark.deformation import (
    Deformation,
    MarkerPlaces,
    Volume,
    Volumes,
    displacements,
    identify,
    marker_places,
)
from windmark.deformation.laws import Rigid
from windmark.detection import detect_at
from windmark.geometry import Camera, Pose
from windmark.registration import pose_from_labels
from windmark.scene import MarkerSet, Observations, View

PLATE = DATA / "piv-challenge-e-calib"
LENS = ("focal_px", "aspect", "k1", "p1", "p2", "tilt_x", "tilt_y")
POSITIONS = range(1, 8)
RADIUS_PX = {1: 19.0, 3: 27.0}
LABEL_SIGMA_PX = 0.15

Marks = dict[tuple[int, int], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""(camera, position) -> pixels (K, 2), their covariance (K, 2, 2), places in the plate's own frame (K, 3) in mm."""


# --- PIV-E plate -------------------------------------------------------------------------------
def plate_marks(found: bool) -> Marks:
    """The set's own labels; or windmark's spots at these places."""
    out: Marks = {}
    for camera, radius in RADIUS_PX.items():
        for position in POSITIONS:
            xy, xyz = plate_labels(camera, position)
            cov, good = np.tile(LABEL_SIGMA_PX**2 * np.eye(2), (len(xy), 1, 1)), np.ones(len(xy), bool)
            if found:
                image = io.read_grey(PLATE / f"camera{camera}" / f"E_camera_{camera}_z_{position}.tif")
                spots = detect_at(image, xy, radius_px=radius, polarity="bright", search_px=3.0)
                xy, cov, good = spots.xy, spots.cov, spots.found
            out[camera, position] = xy[good], cov[good], 10.0 * xyz[good]
    return out


def plate_cameras(marks: Marks, positions: Sequence[int], free: Sequence[str] = LENS) -> dict[int, tuple[Camera, Pose]]:
    """Both cameras from labelled discs of some positions, whose depths are given."""
    out = {}
    for camera in RADIUS_PX:
        xy = np.concatenate([marks[camera, p][0] for p in positions])
        xyz = np.concatenate([marks[camera, p][2] + [0.0, 0.0, p - 4.0] for p in positions])
        fit = pose_from_labels(xy, xyz, Camera((1024, 1024), 6000.0), free=free)
        out[camera] = fit.camera, fit.cam_from_model
    return out


def plate_sights(marks: Marks, position: int, names: Sequence[tuple[float, float]]) -> Observations:
    """The discs of ``names`` (x and y on the plate) in one position; view 0 is camera 1, view 1 camera 3."""
    view, point, xy, cov = [], [], [], []
    for v, camera in enumerate(RADIUS_PX):
        seen = marks[camera, position]
        for k, place in enumerate(np.round(seen[2][:, :2], 3).tolist()):
            if tuple(place) in names:
                view.append(v)
                point.append(names.index((place[0], place[1])))
                xy.append(seen[0][k])
                cov.append(seen[1][k])
    return Observations(np.array(view), np.array(point), np.array(xy), np.array(cov))


def plate_steps(marks: Marks, free: Sequence[str] = LENS) -> dict[str, np.ndarray]:
    """All six steps: mean and single displacements less the known one, the rigid body's shift and turn, z values."""
    common = set.intersection(*(
        {(float(x), float(y)) for x, y in np.round(m[2][:, :2], 3)} for m in marks.values()
    ))  # fmt: skip
    names = sorted(common)
    flat = np.column_stack([names, np.zeros(len(names))])
    table = MarkerSet.make([f"{x:g},{y:g}" for x, y in names], flat, volume="plate")
    views = [View(str(c), str(c), "", None) for c in RADIUS_PX]
    rows: dict[str, list[np.ndarray]] = {n: [] for n in ("single", "sigma", "shift", "shift_sigma", "turn", "sigma0")}
    for step in range(1, 7):
        fit = plate_cameras(marks, [p for p in POSITIONS if p not in (step, step + 1)], free)
        cameras = {str(c): camera for c, (camera, _) in fit.items()}
        posed = [View(v.name, v.camera, "", fit[int(v.name)][1]) for v in views]
        at = [marker_places(plate_sights(marks, p, names), table, cameras, posed) for p in (step, step + 1)]
        moved = displacements(*at)
        rows["single"].append(moved.vector - [0.0, 0.0, 1.0])
        rows["sigma"].append(np.sqrt(np.einsum("kii->ki", moved.cov)))
        state = _as_body(plate_sights(marks, step + 1, names), table, at[0], cameras, posed)
        rows["shift"].append(state.q[:3] - [0.0, 0.0, 1.0])
        rows["shift_sigma"].append(np.sqrt(np.diag(state.cov))[:3])
        rows["turn"].append(state.q[3:])
        rows["sigma0"].append(np.array(state.sigma0))
    return {n: np.array(v) for n, v in rows.items()}


def _as_body(
    sights: Observations, table: MarkerSet, before: MarkerPlaces, cameras: dict[str, Camera], views: Sequence[View]
) -> Deformation:
    """The plate as a rigid body that turns about its middle, from where its discs were a step before."""
    markers = MarkerSet.make(table.name.tolist(), before.xyz, volume="plate")
    pivot = before.xyz.mean(axis=0)
    body = Volumes.of([Volume("plate", Rigid(tuple(pivot.tolist()), "mm"))])
    state = identify(sights, markers, body, cameras, views, free_motion=False, marker_cov=before.cov)
    if not isinstance(state, Deformation):
        raise SystemExit(f"plate: {state.reason}")
    return state


def plate_figures(steps: dict[str, np.ndarray]) -> dict[str, float]:
    """The row of the table, in mm."""
    single, z = steps["single"], steps["single"] / steps["sigma"]
    mean = single.mean(axis=1)
    return {
        "discs": single.shape[1], "mean_worst": float(np.abs(mean).max()), "mean_rms": float(np.sqrt((mean**2).mean())),
        "single_in_plane": float(np.sqrt((single[..., :2] ** 2).mean())),
        "single_depth": float(np.sqrt((single[..., 2] ** 2).mean())), "z": float(np.sqrt((z**2).mean())),
        "body_worst": float(np.abs(steps["shift"]).max()), "turn_worst_deg": float(np.abs(steps["turn"]).max()),
        "body_sigma": float(steps["shift_sigma"].max()),
    }  # fmt: skip


def main(quick: bool = False) -> dict[str, object]:
    """Measure, print the tables, return their rows."""
    figures: dict[str, object] = {}
    if PLATE.is_dir():
        print("PIV-E plate, 1 mm steps, errors in mm  discs  mean: worst   rms   single: in plane  depth  (z)"
              "   as a body: worst  sigma  turn deg")  # fmt: skip
        for word, found, free in (
            ("labels of the set", False, LENS), ("detected", True, LENS),
            ("detected, k1 only", True, ("focal_px", "k1")),
        ):  # fmt: skip
            r = plate_figures(plate_steps(plate_marks(found), free))
            figures[f"plate, {word}"] = r
            print(f"{word:38s} {r['discs']:5.0f}  {r['mean_worst']:11.4f} {r['mean_rms']:6.4f} "
                  f" {r['single_in_plane']:15.4f} {r['single_depth']:6.4f} {r['z']:4.1f}  {r['body_worst']:16.4f}"
                  f" {r['body_sigma']:6.4f} {r['turn_worst_deg']:9.4f}", flush=True)  # fmt: skip
    if not figures:
        print("deformation_real: the real pictures are not here")
    return figures


if __name__ == "__main__":
    main("--quick" in sys.argv)
