"""How values get from pixels to nodes: error, stated noise and cost of each way; cameras merged; edges in motion.

    python benchmarks/paint_sampling.py [--seeds 401 402] [--incidences 2] [--json FILE]

The virtual painted wing of `simulate_psp`, 20,000 nodes, about 17 pixels each; two cameras. Scored is the ratio against
its truth:

sampling    the nearest pixel, bilinear, cubic (Catmull-Rom), and a plane through all pixels of a node ("footprint"):
            error, scatter between neighbours, its stated value, both relative to the ratio; thread time of one picture
merged      footprint, nodes that both cameras show: error of each camera alone and of both
seam        step of the merged ratio from one camera's side to the other's, mean along the seam, over a node's noise;
            scatter of such steps over their stated noise, and of those between neighbours of one camera
edges       nodes within 12 px of an outline: error of the ratio where the model moves by up to 20 px at its tip between
            wind-off and wind-on (``--moves`` times what the test usually does), over that where it stands still in both
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from windmark import io
from windmark.pipeline.psp import PspTest, load_psp, read_psp_project
from windmark.pipeline.psp.point import (
    WIND_OFF,
    WIND_ON,
    Found,
    point_task,
    read_pictures,
    sampling_of,
    the_model_in,
)
from windmark.pipeline.psp.table import PointRow
from windmark.pipeline.simulate_psp import simulate_psp
from windmark.resection import inside_px
from windmark.tasks.psp import MergedRatio, ratio_of, reduce_point

WAYS = ("nearest", "linear", "cubic", "footprint")
NEAR_PX = 12.0

Point = tuple[PspTest, PointRow, Mapping[str, Found], np.ndarray]
Rows = dict[str, list[float]]


def points_of(seed: int, incidences: int, moves: float) -> list[Point]:
    """Test, row, pictures with the model found, true ratio of every point."""
    out: list[Point] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        simulate_psp(folder, seed, incidences, moves=moves)
        test = load_psp(read_psp_project(folder / "psp.toml"))
        for row in test.rows:
            truth = np.asarray(io.read_nodes_netcdf(folder / "truth" / f"{row.name}.nc")[1]["ratio"], float)
            found = {kind: the_model_in(test, kind, read_pictures(test, kind, pattern))
                     for kind, pattern in ((WIND_ON, row.on), (WIND_OFF, row.off))}  # fmt: skip
            out.append((test, row, found, truth))
    return out


def rms(values: np.ndarray) -> float:
    """Root mean square of those that there are."""
    return float(np.sqrt(np.nanmean(values**2)))


def robust(values: np.ndarray) -> float:
    """Standard deviation by the median of the absolute values."""
    return 1.4826 * float(np.nanmedian(np.abs(values)))


def sound_of(point: Point, ratio: MergedRatio) -> np.ndarray:
    """Nodes with paint that was seen, and not filled in."""
    test, row, found, truth = point
    mesh = found[WIND_ON].states[0].mesh(test.mesh, frame="model")
    done = reduce_point(ratio, test.mesh, mesh, point_task(test, row, row.conditions()))
    return np.asarray(np.isfinite(truth) & ratio.ratio.known & ~done.filled)


def pairs_of(test: PspTest, sound: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Neighbours, both of them sound."""
    edges = test.mesh.triangles[:, [0, 1, 1, 2]].reshape(-1, 2)
    i, j = edges[sound[edges].all(axis=1)].T
    return i, j


def sampled(point: Point, rows: dict[str, Rows]) -> None:
    """Score the ways of a point."""
    test, _, found, truth = point
    on, off = found[WIND_ON], found[WIND_OFF]
    for way in WAYS:
        begun = time.thread_time()
        ratio = ratio_of(on.pictures, off.pictures, how=replace(sampling_of(test), values=way), lamps=test.lamps)
        spent = (time.thread_time() - begun) / (len(on.pictures) + len(off.pictures))
        sound = sound_of(point, ratio)
        error = np.where(sound, ratio.ratio.value / truth - 1, np.nan)
        stated = np.sqrt(ratio.ratio.white) / truth
        i, j = pairs_of(test, sound)
        for name, value in (
            ("error RMS %", 100 * rms(error)), ("error median %", 100 * float(np.nanmedian(np.abs(error)))),
            ("scatter %", 100 * robust(error[i] - error[j]) / np.sqrt(2)),
            ("stated %", 100 * float(np.median(stated[sound]))),
            ("scatter / stated", robust((error[i] - error[j]) / np.hypot(stated[i], stated[j]))),
            ("ms", 1e3 * spent),
        ):  # fmt: skip
            rows[way].setdefault(name, []).append(value)
        if way == "footprint":
            merged(point, ratio, sound, rows["merged"])


def merged(point: Point, ratio: MergedRatio, sound: np.ndarray, rows: Rows) -> None:
    """Score cameras alone and together, and the seam."""
    test, _, _, truth = point
    both = sound & np.all([of.ratio.known & (of.weight > 0) for of in ratio.cameras.values()], axis=0)
    for name, of in ratio.cameras.items():
        rows.setdefault(f"{name} alone, RMS %", []).append(100 * rms((of.ratio.value / truth - 1)[both]))
    rows.setdefault("merged, RMS %", []).append(100 * rms((ratio.ratio.value / truth - 1)[both]))
    i, j = pairs_of(test, sound)
    step = (ratio.ratio.value / truth)[i] - (ratio.ratio.value / truth)[j]
    z = step / np.hypot(*(np.sqrt(ratio.ratio.white[k]) / truth[k] for k in (i, j)))
    across = ratio.source[i] != ratio.source[j]
    side = np.where(ratio.source[i] < ratio.source[j], 1.0, -1.0)
    rows.setdefault("mean step at the seam, sigmas", []).append(abs(float(np.mean((side * z)[across]))) * np.sqrt(2))
    rows.setdefault("scatter at the seam, sigmas", []).append(robust(z[across]))
    rows.setdefault("elsewhere, sigmas", []).append(robust(z[~across]))


def motion_px(point: Point) -> float:
    """Largest motion of a node in the picture from wind-off to wind-on."""
    found, first = point[2], {p.camera: p for p in reversed(point[2][WIND_OFF].pictures)}
    used, most = point[0].mesh.used, 0.0
    for picture in found[WIND_ON].pictures:
        there, here = (p.lens.project(p.cam_from_tunnel.apply(p.mesh.vertices[used]))[0]
                       for p in (picture, first[picture.camera]))  # fmt: skip
        most = max(most, float(np.nanmax(np.linalg.norm(there - here, axis=1))))
    return most


def edges(point: Point) -> float:
    """Error of the ratio (%, RMS) near outlines."""
    test, _, found, truth = point
    ratio = ratio_of(found[WIND_ON].pictures, found[WIND_OFF].pictures, how=sampling_of(test), lamps=test.lamps)
    near = np.zeros(len(truth), bool)
    for picture in {p.camera: p for p in found[WIND_ON].pictures}.values():
        inside = inside_px(picture.mesh, picture.lens, picture.cam_from_tunnel)
        xy, good = picture.lens.project(picture.cam_from_tunnel.apply(picture.mesh.vertices))
        good &= picture.lens.in_image(xy)
        column, row = np.rint(xy[good]).astype(int).T
        near[np.flatnonzero(good)[inside[row, column] <= NEAR_PX]] = True
    sound = sound_of(point, ratio) & near
    return 100 * rms((ratio.ratio.value / truth - 1)[sound])


def main() -> None:
    """Run, print the tables, write the JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, nargs="+", default=[401, 402])
    parser.add_argument("--incidences", type=int, default=2)
    parser.add_argument("--moves", type=float, default=1.4)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows: dict[str, Rows] = defaultdict(dict)
    for seed in options.seeds:
        moving = points_of(seed, options.incidences, options.moves)
        for point in moving:
            sampled(point, rows)
        rows["edges"].setdefault("moves by up to, px", []).append(max(motion_px(p) for p in moving))
        still = points_of(seed, options.incidences, 0.0)
        rows["edges"].setdefault("moving, RMS %", []).extend(edges(p) for p in moving)
        rows["edges"].setdefault("at rest, RMS %", []).extend(edges(p) for p in still)
        print(f"seed {seed} done", flush=True)
    record = {way: {name: float(np.median(values)) for name, values in of.items()} for way, of in rows.items()}
    record["edges"]["moving / at rest"] = float(
        np.median(np.array(rows["edges"]["moving, RMS %"]) / rows["edges"]["at rest, RMS %"])
    )
    for way, of in record.items():
        print(f"{way:10s} " + "  ".join(f"{name} {value:.4g}" for name, value in of.items()))
    if options.json:
        options.json.write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
