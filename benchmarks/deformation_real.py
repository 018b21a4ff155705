"""Deformation on real pictures: a plate moved by known steps, a swaying building.

PIV-E plate     seven positions 1 mm apart before two cameras. Every step is measured with cameras that were calibrated
                on the *other* five positions, so its own 1 mm is nowhere in the cameras. Camera 3 needs an
                aspect ratio and a tilted sensor besides k1, p1, p2 (0.3 px instead of 1 px; the set does not say what
                it looks through): with k1 alone steps come out up to 6 % too small. Marks: the set's own labels, and
                `detect_at` at these. `marker_places` gives single discs; `identify` the plate as a rigid body.
frame sway      28 discs of a building in 41 pictures (55 are missing after the first), followed by one nominal camera:
                every storey is a rigid body. Checked against a chain of nearest neighbours over detections of each
                picture by itself. Steps are up to 51 px. Distances of neighbours in a row vary by 0.7 px, in these
                detections as well, and not by noise: a row's scale follows its shift (r^2 0.85 to 0.96, the storeys do
                not sway in the picture's plane). With each row's perspective taken off (shift, scale, gradient of the
                scale) they keep 0.09 px, in the base 0.03 px. Across the rows single discs move by up to 1 px in step
                with the sway: the beams bend.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

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
    law,
    marker_places,
)
from windmark.deformation.laws import Rigid
from windmark.detection import detect, detect_at
from windmark.geometry import Camera, Pose
from windmark.pipeline.deform import DeformationTest, FrameImages, LookOptions, Station, follow_deformation
from windmark.registration import pose_from_labels
from windmark.scene import MarkerSet, Observations, View

PLATE, SWAY = DATA / "piv-challenge-e-calib", DATA / "frame-sway-1cam"
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


# --- frame sway --------------------------------------------------------------------------------
@law(x="px", y="px", depth="px", turn="deg", yaw="deg")
def storey(xyz, x, y, depth, turn, yaw, *, height=0.0):
    """A storey that shifts, and turns in the picture's plane and about the vertical."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    u, v = xyz[:, 0], xyz[:, 1] - height
    along, across = c * u - s * v, s * u + c * v
    near = xyz[:, 2] + depth + along * np.sin(np.radians(yaw))
    return np.column_stack([along * np.cos(np.radians(yaw)) + x, across + height + y, near])


def sway_pictures() -> list[Path]:
    """All pictures in order; the last number of a name is that of its frame."""
    return sorted((SWAY / "images").iterdir())


def sway_start() -> tuple[np.ndarray, np.ndarray]:
    """The first picture's 28 spots (28, 2), and the storey of each."""
    table = io.read_table(SWAY / "targets_initial.csv", required=(), known=("id", "u_px", "v_px", "row"))
    nominal = np.column_stack([table.numbers("u_px"), table.numbers("v_px")])
    spots = detect(io.read_grey(sway_pictures()[0]), radius_px=(9.0, 11.0))
    return spots.xy[cKDTree(spots.xy).query(nominal)[1]], np.array(table.text("row"))


def sway_test(xy: np.ndarray, row: np.ndarray) -> DeformationTest:
    """The building as the first picture shows it, flat before a nominal camera; the base stands still."""
    camera = Camera((1300, 2046), 3000.0)
    flat = np.column_stack([xy - [camera.cx, camera.cy], np.zeros(len(xy))])
    names = [f"{r}-{k % 7}" for k, r in enumerate(row)]
    markers = MarkerSet.make(names, flat, radius=10.5, normal=np.tile([0.0, 0.0, -1.0], (len(xy), 1)),
                             volume=row.tolist())  # fmt: skip
    storeys = [
        Volume(str(r), storey.with_options({"height": float(flat[row == r, 1].mean())}))
        for r in dict.fromkeys(row.tolist()) if r != "base"
    ]  # fmt: skip
    pose = Pose(np.eye(3), np.array([0.0, 0.0, camera.focal_px]))
    return DeformationTest(
        (Station("cam", camera, pose),), markers, Volumes.of([Volume("base"), *storeys]), free_motion=False,
        look=LookOptions(radius_px=(9.0, 11.0)),
    )  # fmt: skip


def sway_followed(pictures: Sequence[Path]) -> tuple[np.ndarray, list[str]]:
    """(T, 28, 2) where the follower has every disc, NaN where not; how each frame was found."""
    test = sway_test(*sway_start())
    frames = [FrameImages(p.stem, float(p.stem[3:]), {"cam": p}) for p in pictures]
    out, status = np.full((len(frames), 28, 2), np.nan), []
    for frame in follow_deformation(frames, test):
        status.append(frame.status)
        if frame.observations is not None:
            out[frame.index, frame.observations.point] = frame.observations.xy
    return out, status


def sway_chained(pictures: Sequence[Path]) -> np.ndarray:
    """(T, 28, 2) the nearest of all detected spots to the disc's place in the picture before."""
    last, out = sway_start()[0], []
    for path in pictures:
        spots = detect(io.read_grey(path), radius_px=(9.0, 11.0))
        last = spots.xy[cKDTree(spots.xy).query(last)[1]]
        out.append(last)
    return np.array(out)


def row_gaps(places: np.ndarray, degree: int | None) -> np.ndarray:
    """(4, 6) standard deviation over frames of the distances of neighbours in a row.

    degree : what is taken off each row and frame first: None nothing; a polynomial along the row of its change since
        the mean frame, 1 its scale, 2 its perspective
    """
    rows = places.reshape(-1, 4, 7, 2)
    if degree is None:
        return np.linalg.norm(np.diff(rows, axis=2), axis=-1).std(axis=0)
    out = np.empty((4, 6))
    for r in range(4):
        along = rows[:, r, :, 0]
        mean = along.mean(axis=0)
        design = np.vander((mean - mean.mean()) / np.ptp(mean), degree + 1)
        change = along - mean
        out[r] = np.diff(change - change @ np.linalg.pinv(design).T @ design.T, axis=1).std(axis=0)
    return out


def scale_per_shift(places: np.ndarray) -> np.ndarray:
    """(3, 2) of each storey but the base: relative change of its row's length per px of its shift, and r^2."""
    rows = places.reshape(-1, 4, 7, 2)[..., 0]
    out = []
    for r in range(1, 4):
        shift, length = rows[:, r].mean(axis=1), np.ptp(rows[:, r], axis=1)
        slope = np.polyfit(shift, length / length.mean(), 1)[0]
        out.append([slope, np.corrcoef(shift, length)[0, 1] ** 2])
    return np.array(out)


def sway_figures(followed: np.ndarray, chained: np.ndarray, status: list[str]) -> dict[str, float]:
    """Frames, discs lost and swapped; distances in a row; motion."""
    away = np.linalg.norm(followed - chained, axis=2)
    gaps = {n: row_gaps(followed, d) for n, d in (("gap", None), ("gap_less_scale", 1), ("gap_less_perspective", 2))}
    gaps["gap_chained"] = row_gaps(chained, None)
    sway = (followed - followed[0]).reshape(-1, 4, 7, 2)[..., 0].mean(axis=2)
    slope = scale_per_shift(followed)
    return {
        "frames": len(status), "frames_lost": status.count("lost"), "discs_lost": int(np.isnan(away).sum()),
        "swapped": int((away > 5).sum()), "apart_rms": float(np.sqrt(np.nanmean(away**2))),
        "most_sway": float(np.abs(sway).max()), "most_step": float(np.abs(np.diff(followed, axis=0)).max()),
        **{f"{n}_worst": float(v.max()) for n, v in gaps.items()},
        "scale_per_px_least": float(slope[:, 0].min()), "scale_per_px_most": float(slope[:, 0].max()),
        "scale_r2_least": float(slope[:, 1].min()),
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
    if SWAY.is_dir():
        pictures = sway_pictures()[:5] if quick else sway_pictures()
        followed, status = sway_followed(pictures)
        r = sway_figures(followed, sway_chained(pictures), status)
        figures["frame sway"] = r
        print("frame sway: " + ", ".join(f"{k} {v:.3g}" for k, v in r.items()), flush=True)
    if not figures:
        print("deformation_real: the real pictures are not here")
    return figures


if __name__ == "__main__":
    main("--quick" in sys.argv)
