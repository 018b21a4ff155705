"""Registration of real pictures from windmark's own detections: labels right, wrong, missing, or refused.

The data lie beside the checkout (`../shared/data`). NASA camera 5 with the usual and with loose detection limits; the
three views of a regular ridge block (480 equal dots; interior parameters fitted to the labels) without a prior and with
one.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark.detection import detect
from windmark.geometry import Camera, Pose
from windmark.io import read_camera, read_image, read_markers
from windmark.registration import Registration, pose_from_labels, prepare, register
from windmark.scene import Detections, MarkerSet

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
Array = NDArray[np.float64]


@dataclass(frozen=True)
class RealCase:
    """A picture's spots, and where every marker is in it (NaN: not seen or not known) to within ``gate_px``."""

    name: str
    detections: Detections
    markers: MarkerSet
    camera: Camera
    true_xy: Array
    gate_px: float
    prior: Pose | None = None


def nasa() -> Iterator[RealCase]:
    """Camera 5: 15 dots in view."""
    folder = DATA / "nasa-upsp-cam5"
    camera, pose = read_camera(folder / "camera05_35_6.json")
    assert pose is not None
    markers = read_markers(folder / "fml_tc3_volume.tgts")
    markers = markers.take(np.char.startswith(markers.name, "st"))
    image = read_image(folder / "CAM5.png")
    true = camera.project(pose.apply(markers.xyz))[0]
    for merit in (0.7, 1.0, 1.3, 1.6):
        spots = detect(image, radius_px=3.0, merit_max=merit)
        yield RealCase(f"NASA camera 5, merit {merit}", spots, markers, camera, true, 4.0)


def ridge() -> Iterator[RealCase]:
    """MyPTV's block."""
    folder = DATA / "myptv-ridge-3cam"
    for view in (1, 2, 3):
        table = np.loadtxt(folder / f"cam{view}_cal_points")
        xy, xyz = table[:, :2], table[:, 2:]
        fit = pose_from_labels(xy, xyz, Camera((1024, 1024), 3000.0), free=("focal_px", "k1", "cx", "cy", "p1", "p2"))
        markers = MarkerSet.make([f"d{i}" for i in range(len(xyz))], xyz)
        spots = detect(read_image(folder / f"cam{view}.tif"), radius_px=(1.2, 1.5, 2.0, 2.6), polarity="bright")
        turn = Pose.from_rotvec(np.radians([3.0, -3.0, 5.0]), np.zeros(3)).rotation @ fit.cam_from_model.rotation
        centre = xyz.mean(axis=0)
        near = Pose(turn, fit.cam_from_model.apply(centre) - turn @ centre)
        for prior, word in ((None, ""), (near, ", prior")):
            yield RealCase(f"MyPTV ridge {view}{word}", spots, markers, fit.camera, xy, 3.0, prior)


def main(quick: bool = False) -> dict[str, dict[str, float]]:
    """Measure, print one table, return its rows."""
    figures: dict[str, dict[str, float]] = {}
    print(
        f"{'':28s} {'spots':>6s} {'markers':>7s} {'right':>6s} {'wrong':>6s} {'missed':>6s} {'rms px':>7s} {'ms':>7s}"
    )
    for source in (nasa,) if quick else (nasa, ridge):
        for case in source():
            figures[case.name] = measure(case)
    return figures


def measure(case: RealCase) -> dict[str, float]:
    """Register one picture and count."""
    layout = prepare(case.markers).ready()
    start = time.thread_time()
    result = register(case.detections, case.markers, case.camera, prior=case.prior, layout=layout)
    register_ms = 1e3 * (time.thread_time() - start)
    row = {"spots": len(case.detections), "markers": len(case.markers), "register_ms": register_ms}
    words = f"{case.name:28s} {row['spots']:7d} {row['markers']:7d}"
    if not isinstance(result, Registration):
        print(f"{words} refused ({result.cause}) {register_ms:7.1f}: {result.reason}", flush=True)
        return {**row, "registered": 0}
    match = result.matching
    offset = np.linalg.norm(case.detections.xy[match.detection] - case.true_xy[match.marker], axis=1)
    right, wrong = int((offset < case.gate_px).sum()), int((offset > case.gate_px).sum())
    nearest = np.linalg.norm(case.true_xy[:, None] - case.detections.xy[None], axis=2).min(axis=1)
    missed = int((nearest < case.gate_px).sum()) - right
    print(f"{words} {right:7d} {wrong:7d} {missed:7d} {result.rms_px:7.3f} {register_ms:7.1f}", flush=True)
    return {**row, "registered": 1, "right": right, "wrong": wrong, "missed": missed, "rms_px": result.rms_px}


if __name__ == "__main__":
    main()
