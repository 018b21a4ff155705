"""Self-calibration of real pictures: the DBAT sheet, from the published marks and from windmark's own.

The sheet: 21 hand-held views of 100 discs with a consumer camera. Published: sigma0 0.1615 px with four control points
held (backward lens model). Marks have that sigma here, sigma0 is shown in pixels per coordinate. "own": windmark's
centres (template fit, green channel) next to the published marks. "split": two halves of the views against each other;
1 would mean that the covariance tells the whole story. The last columns are differences to PhotoModeler's coordinates.
"""

from __future__ import annotations

import csv
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from _real_truth import DATA, photomodeler_points
from windmark.calibration import Fixed, Free, self_calibrate
from windmark.calibration.quality import SplitHalf, residual_map, split_half
from windmark.detection import detect
from windmark.geometry import Camera
from windmark.geometry.similarity import align
from windmark.io import read_grey
from windmark.scene import MarkerSet, Observations, View

SIZE = (2272, 1704)
CONTROL = ("1001", "1002", "1003", "1004")
ROUGH_MM = 5.0
MARK_PX = 0.1615
BROWN = ("focal_px", "aspect", "cx", "cy", "k1", "k2", "p1", "p2")
LENSES = {"k1 k2 p1 p2": BROWN, "+ k3": (*BROWN, "k3"), "+ tilts": (*BROWN, "tilt_x", "tilt_y")}


@dataclass(frozen=True)
class Sheet:
    """Marks, the discs' published coordinates in mm, and views."""

    observations: Observations
    markers: MarkerSet
    views: tuple[View, ...]


def published(folder: Path) -> Sheet:
    """The 2074 published marks."""
    marks = np.loadtxt(folder / "markpts.txt", delimiter=",", comments="#")
    points = photomodeler_points(folder / "photomodeler_3dpts.txt")
    names = sorted({int(k) for k in marks[:, 1]})
    index = {name: n for n, name in enumerate(names)}
    xyz = 1000 * np.array([points[n] for n in names])
    with (folder / "camcal-fixed.txt").open() as file:
        for row in csv.reader(line for line in file if not line.startswith("#")):
            xyz[index[int(row[0])]] = [1000 * float(v) for v in row[-3:]]
    view, point = marks[:, 0].astype(int) - 1, np.array([index[int(k)] for k in marks[:, 1]])
    cov = np.broadcast_to(MARK_PX**2 * np.eye(2), (len(marks), 2, 2)).copy()
    return Sheet(
        Observations(view, point, marks[:, 2:4] - 0.5, cov), MarkerSet.make([str(n) for n in names], xyz),
        tuple(View(f"{v + 1:02d}") for v in range(int(view.max()) + 1)),
    )  # fmt: skip


def own(folder: Path, sheet: Sheet) -> Sheet:
    """Windmark's centres of the same marks."""
    obs, keep = sheet.observations, np.zeros(len(sheet.observations), bool)
    xy = obs.xy.copy()
    for v, path in enumerate(sorted((folder / "images").iterdir())):
        mine = np.flatnonzero(obs.view == v)
        found = detect(read_grey(path, channel="green"), radius_px=(10.0, 13.0, 17.5, 23.0)).xy
        spot, mark = _pairs(found, obs.xy[mine])
        xy[mine[mark]], keep[mine[mark]] = found[spot], True
    marks = Observations(obs.view[keep], obs.point[keep], xy[keep], obs.cov[keep])
    return Sheet(marks, sheet.markers, sheet.views)


def _pairs(found: NDArray, marks: NDArray) -> tuple[NDArray, NDArray]:
    """Nearest spot within 3 px of each mark, one to one."""
    distance = np.linalg.norm(found[:, None] - marks[None], axis=2)
    spot = distance.argmin(axis=0)
    mark = np.arange(len(marks))
    good = (distance[spot, mark] < 3.0) & (distance[spot].argmin(axis=1) == mark)
    return spot[good], mark[good]


def row(sheet: Sheet, free: tuple[str, ...], held: bool, reject: bool, seed: int = 0) -> dict[str, float]:
    """One calibration from coordinates that are off by 5 mm, without poses, focal length 10 % off."""
    rng = np.random.default_rng(seed)
    true = sheet.markers.xyz
    control = np.isin(sheet.markers.name, CONTROL)
    rough = np.where((control & held)[:, None], true, true + rng.normal(0, ROUGH_MM, true.shape))
    markers = MarkerSet.make(sheet.markers.name, rough)
    camera = Camera(SIZE, 0.9 * 7.457 / 7.25301 * SIZE[0])
    datum = Fixed(CONTROL) if held else Free()
    result = self_calibrate(
        sheet.observations, markers, {"camera": camera}, sheet.views, datum=datum, free=free, reject=reject
    )
    if not result:
        raise SystemExit(f"calibration_real: {result.reason}")
    place = {name: n for n, name in enumerate(sheet.markers.name)}
    known = true[[place[name] for name in result.markers.name]]
    fit = align(result.markers.xyz, known, scale=not held)
    off = result.markers.xyz - known if held else fit.apply(result.markers.xyz) - known
    half = split_half(result)
    found = result.cameras["camera"]
    return {
        "sigma0_px": result.sigma0 * MARK_PX, "left_out": int((~result.used).sum()), "focal_px": found.focal_px,
        "focal_sigma": result.sigma("camera", "focal_px"), "map_excess": residual_map(result, "camera").excess,
        "split": half.comparison.ratio if isinstance(half, SplitHalf) else np.nan,
        **{f"rms_{axis}_mm": float(np.sqrt((off[:, n] ** 2).mean())) for n, axis in enumerate("xyz")},
    }  # fmt: skip


def main(quick: bool = False) -> dict[str, object]:
    """Measure, print one table, return its rows."""
    folder = DATA / "dbat-camcal"
    if not folder.is_dir():
        print("calibration_real: the real pictures are not here")
        return {}
    sheet = published(folder)
    sheets = {"published": sheet} if quick else {"published": sheet, "own": own(folder, sheet)}
    figures: dict[str, object] = {}
    print(f"{'marks':10s} {'lens':12s} {'datum':8s} {'gross':9s} sigma0 px  left out  focal px  sigma   map  split  "
          "x, y, z off PhotoModeler mm")  # fmt: skip
    for name, marks in sheets.items():
        for lens, free in LENSES.items():
            for held in (True, False):
                for reject in (False, True):
                    r = row(marks, free, held, reject)
                    datum, gross = ("4 held" if held else "free"), ("left out" if reject else "kept")
                    figures[f"{name} {lens} {datum} {gross}"] = r
                    print(f"{name:10s} {lens:12s} {datum:8s} {gross:9s} {r['sigma0_px']:9.4f} {r['left_out']:9.0f}"
                          f" {r['focal_px']:9.2f} {r['focal_sigma']:6.2f} {r['map_excess']:5.2f} {r['split']:6.2f}"
                          f"  {r['rms_x_mm']:.3f} {r['rms_y_mm']:.3f} {r['rms_z_mm']:.3f}", flush=True)  # fmt: skip
    return figures


if __name__ == "__main__":
    main("--quick" in sys.argv)
