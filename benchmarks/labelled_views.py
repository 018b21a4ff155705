"""Pose and residual from given labels, no start pose: MyPTV's three views and PIV Challenge E, camera 1.

Both were taken through walls or with lenses that a pinhole does not describe exactly, so the table shows
the fit with focal length, aspect and k1 free, and with the principal point, p1 and p2 free as well (such a
principal point is no property of the lens: judge that fit by its residuals).
"""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from windmark.geometry import Camera
from windmark.registration import pose_from_labels

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
LENS = ("focal_px", "aspect", "k1")
MODELS = {"f, aspect, k1": LENS, "+ cx, cy, p1, p2": (*LENS, "cx", "cy", "p1", "p2")}
START_FOCAL_PX = 4000.0


def main(quick: bool = False) -> dict[str, object]:
    """Print one table; return residuals and poses."""
    if not DATA.is_dir():
        print("skipped: the real data are not beside the checkout (shared/data)")
        return {"skipped": "no data"}
    print(f"{'view':12s}{'free':18s}{'points':>7s}{'RMS px':>9s}{'focal px':>10s}{'sigma':>8s}   angles deg; distances")
    figures: dict[str, object] = {}
    for name, (xy, xyz) in labelled_sets().items():
        for words, free in MODELS.items():
            camera = Camera((1024, 1024), START_FOCAL_PX)
            fit = pose_from_labels(xy, xyz, camera, free=free)
            pov = fit.cam_from_model.to_pov()
            place = "{:.2f} {:.2f} {:.2f}; {:.2f} {:.2f} {:.2f}".format(*list(vars(pov).values())[:6])
            sigma = fit.sigma("focal_px") * fit.sigma0
            print(
                f"{name:12s}{words:18s}{len(xy):7d}{fit.rms_px:9.3f}{fit.camera.focal_px:10.1f}{sigma:8.1f}   {place}"
            )
            figures[f"{name}: {words}"] = {
                "rms_px": fit.rms_px, "focal_px": fit.camera.focal_px, "focal_sigma_px": sigma, "pov": vars(pov)
            }  # fmt: skip
    return figures


def labelled_sets() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Labelled pixels (N, 2), 0-based, and coordinates (N, 3) of each view."""
    sets = {}
    for k in (1, 2, 3):
        table = np.loadtxt(DATA / "myptv-ridge-3cam" / f"cam{k}_cal_points")
        sets[f"MyPTV cam{k}"] = table[:, :2], table[:, 2:]
    rows = []
    for path in sorted((DATA / "piv-challenge-e-calib" / "camera1").glob("img_*.xml")):
        rows += [list(map(float, point.text.split())) for point in ET.parse(path).iter("PointCoord")]
    piv = np.array(rows)
    sets["PIV-E cam1"] = piv[:, 3:5] - 1.0, piv[:, :3]  # the files count pixels from 1
    return sets


if __name__ == "__main__":
    main("--quick" in sys.argv)
