"""The verdict on jobs with planted faults: is the right cause named, and are clean jobs left alone?

    python benchmarks/verdicts.py [--seeds N] [--clean N] [--seed S] [--json FILE] [--show]

Every job is one that a user could have: files in a folder, read and run by the verbs behind the command line
(`read_project`, `run_project`; of a calibration from named marks `from_table`, `calibrate_marks`), then judged. Of
every seed a wind tunnel is rendered (two cameras, 1000 x 800 px, 29 or so markers of some 3 px radius in view) and
each fault is planted in it: a focal length 5 to 12 % wrong, two named markers exchanged (in a picture's labels; in a
table of marks to calibrate from), a camera of a rig moved, a table in inches that says millimetres, a picture blurred
by 2.2 to 3 px, a wing bent by 2 to 4 % of its span, half of the markers painted over, a focal length 0.8 to 1.5 % and
a principal point 15 to 30 px wrong (a crop that the camera's file does not know), a mirrored picture. Clean jobs are
as many again, of other seeds.

"right" is the cause of the verdict, not one somewhere in its list. A clean job that is not "good" is a false alarm.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

from windmark import io, synth
from windmark.calibration import Free
from windmark.errors import WindmarkError
from windmark.geometry import Pose
from windmark.pipeline.calibrate import CalibrateSettings, calibrate_marks, from_table
from windmark.pipeline.clock import Clock, silent
from windmark.pipeline.job import run_project
from windmark.pipeline.project import read_project
from windmark.pipeline.verdict import Verdict
from windmark.pipeline.verdict.errors import error_verdict
from windmark.pipeline.verdict.network import calibrate_verdict
from windmark.pipeline.verdict.run import run_verdict
from windmark.scene import MarkerSet

SIZE = (1000, 800)
RIGHT = {
    "focal": ("focal",), "swapped": ("swapped",), "swapped marks": ("swapped",), "moved": ("moved",),
    "units": ("units",), "blurred": ("blurred",), "bent": ("bent",), "hidden": ("missing",),
    "focal 1 %": ("lens", "focal", "camera"), "cropped": ("lens", "camera"), "mirrored": ("mirrored",), "clean": ("",),
}  # fmt: skip
"""Fault -> causes that are right."""

_CAMERA = """\
[[camera]]
name = "{name}"
file = "{name}.json"
[[image]]
file = "{name}.tif"
camera = "{name}"
labels = {{ {labels} }}
"""
_PROJECT = """\
title = "planted"
length_unit = "mm"
{cameras}
{rig}
[markers]
file = "markers.csv"
roles = ["model"]
[grid]
file = "model.grid"
[detect]
radius_px = 3
"""


def tunnel(seed: int, cameras: int = 1, **options: Any) -> synth.TunnelTest:
    """A small virtual test."""
    return synth.wind_tunnel(seed, size_px=SIZE, nodes=4000, stations=cameras, **options)


def job(folder: Path, test: synth.TunnelTest, shots: list[synth.Shot], **changed: Any) -> Verdict:
    """Files of a test with what is ``changed`` in them, run and judged as the verb `run` does it."""
    markers: MarkerSet = changed.get("markers", test.markers)
    cameras = changed.get("cameras", test.cameras)
    io.write_markers(folder / "markers.csv", markers, length_unit="mm")
    io.write_mesh(folder / "model.grid", test.mesh)
    text = []
    for shot in shots:
        name = shot.view.camera
        io.write_camera(folder / f"{name}.json", cameras[name])
        io.write_image(folder / f"{name}.tif", changed.get("images", {}).get(name, shot.image))
        labels = ", ".join(f"{k} = [{x}, {y}]" for k, (x, y) in changed.get("labels", {}).items())
        text.append(_CAMERA.format(name=name, labels=labels))
    rig = ""
    if len(shots) > 1:
        first = test.cam_from_tunnel["cam1"].inverse()
        places = {s.view.camera: changed.get("places", test.cam_from_tunnel)[s.view.camera] @ first for s in shots}
        io.write_rig(folder / "rig.json", places, unit="mm")
        rig = '[rig]\nfile = "rig.json"\n'
    project = folder / "project.toml"
    project.write_text(_PROJECT.format(cameras="".join(text), rig=rig))
    try:
        return run_verdict(run_project(read_project(project), workers=1))
    except WindmarkError as error:
        return error_verdict(error)


def planted(seed: int, folder: Path) -> dict[str, Verdict]:
    """Every fault in one wind tunnel."""
    rng = np.random.default_rng([seed, 99])
    test = tunnel(seed, 2, tip_fraction=rng.uniform(0.02, 0.04))
    off, on = test.shot("wind-off"), test.shot("wind-on")
    camera, markers = test.cameras["cam1"], test.markers
    factor = 1 + rng.uniform(0.05, 0.12) * rng.choice([-1, 1])
    small = replace(markers, xyz=markers.xyz / 25.4, radius=markers.radius / 25.4)
    blurred = gaussian_filter(off.image.astype(float), rng.uniform(2.2, 3.0)).round().astype(off.image.dtype)
    seen = np.flatnonzero(off.perfect.markers.visible & (markers.role == "model"))
    a, b, *more = rng.choice(seen, 5, replace=False)
    place = off.perfect.markers.ellipse_xy
    labels = {str(markers.name[k]): place[k] for k in more}
    labels |= {str(markers.name[a]): place[b], str(markers.name[b]): place[a]}
    turn = np.radians(rng.uniform(0.3, 1.0)) * rng.choice([-1, 1])
    knocked = Pose.from_rotvec(np.array([0.0, turn, 0.0]), np.zeros(3)) @ test.cam_from_tunnel["cam2"]
    little, crop = 1 + rng.uniform(0.008, 0.015) * rng.choice([-1, 1]), rng.uniform(15, 30) * rng.choice([-1, 1])
    both = [off, test.shot("wind-off", "cam2")]
    return {
        "focal": job(folder, test, [off], cameras={"cam1": replace(camera, focal_px=camera.focal_px * factor)}),
        "focal 1 %": job(folder, test, [off], cameras={"cam1": replace(camera, focal_px=camera.focal_px * little)}),
        "cropped": job(folder, test, [off], cameras={"cam1": replace(camera, cx=camera.cx + crop)}),
        "mirrored": job(folder, test, [off], images={"cam1": off.image[:, ::-1]}),
        "swapped": job(folder, test, [off], labels=labels),
        "swapped marks": calibration(seed, folder, swapped=True),
        "moved": job(folder, test, both, places={**test.cam_from_tunnel, "cam2": knocked}),
        "units": job(folder, test, [off], markers=small),
        "blurred": job(folder, test, [off], images={"cam1": blurred}),
        "bent": job(folder, test, [on]),
        "hidden": job(folder, test, [off], images={"cam1": painted_over(off, rng.permutation(seen)[::2], rng)}),
    }


def painted_over(shot: synth.Shot, which: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The picture with paint over some markers: pixels from round each of them, noise and all."""
    image = shot.image.copy()
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    for k in which:
        x, y = shot.perfect.markers.xy[k]
        far = np.hypot(columns - x, rows - y)
        disc, ring = far <= 6, (far > 6.5) & (far < 9)
        if disc.any() and ring.any():
            image[disc] = rng.choice(image[ring], int(disc.sum()))
    return image


def calibration(seed: int, folder: Path, *, swapped: bool) -> Verdict:
    """Hand-held pictures of 40 markers as a table of marks; two names exchanged in one of them."""
    rng = np.random.default_rng([seed, 7])
    xyz = np.column_stack([rng.uniform(0, 400, (40, 2)), rng.uniform(0, 60, 40)])
    markers = MarkerSet.make([f"m{k:02d}" for k in range(40)], xyz, length_unit="mm")
    camera = synth.default_stations(rng, 1, SIZE)[0][0]
    rows: dict[str, list[Any]] = {"image": [], "name": [], "x": [], "y": []}
    for v in range(14):
        eye = np.array([200, 200, 0]) + 900 * np.array([np.sin(v) * 0.7, np.cos(1.7 * v) * 0.7, 1.0])
        pose = Pose.look_at(eye, [200.0, 200.0, 30.0], [np.sin(2.1 * v), np.cos(2.1 * v), 0.0])
        xy, good = camera.project(pose.apply(xyz))
        here = np.flatnonzero(good & camera.in_image(xy))
        xy = xy + rng.normal(0, 0.1, xy.shape)
        names = markers.name.copy()
        if swapped and v == 5:
            i, j = rng.choice(here, 2, replace=False)
            names[[i, j]] = names[[j, i]]
        for k in here:
            for key, value in zip(rows, (f"p{v:02d}", str(names[k]), *xy[k]), strict=True):
                rows[key].append(value)
    io.write_table(folder / "marks.csv", {key: np.array(value) for key, value in rows.items()})
    rough = replace(markers, xyz=xyz + rng.normal(0, 1.0, xyz.shape))
    start = {"camera": replace(camera, focal_px=camera.focal_px * 1.03, k1=0.0, k2=0.0, p1=0.0, p2=0.0)}
    marks = from_table(io.read_matches(folder / "marks.csv"), rough, start, sigma_px=0.1)
    return calibrate_verdict(calibrate_marks(marks, CalibrateSettings(Free()), Clock(silent)), "mm")


def run(seeds: range, clean: range, show: bool = False) -> dict[str, Any]:
    """All jobs; counts by fault, and what was said wrong."""
    said: dict[str, Counter[str]] = {fault: Counter() for fault in RIGHT}
    wrong: list[str] = []

    def take(fault: str, seed: int, verdict: Verdict) -> None:
        said[fault][verdict.cause or "good"] += 1
        if verdict.cause not in RIGHT[fault]:
            wrong.append(f"{fault} {seed}: {verdict.word}, {verdict.cause}: {verdict.reason}")
        if show:
            print(f"{fault:14s}{seed} {verdict.word:9s}{verdict.cause:10s}{verdict.reason[:110]}", flush=True)

    for seed in seeds:
        with tempfile.TemporaryDirectory() as place:
            for fault, verdict in planted(seed, Path(place)).items():
                take(fault, seed, verdict)
    for seed in clean:
        with tempfile.TemporaryDirectory() as place:
            if seed % 4 == 3:
                take("clean", seed, calibration(seed, Path(place), swapped=False))
            else:
                test = tunnel(seed, 1 + (seed % 4 == 2))
                shots = [s for s in test.shots if s.view.frame == "wind-off"]
                take("clean", seed, job(Path(place), test, shots))
    return {"said": {k: dict(v) for k, v in said.items()}, "wrong": wrong}


def report(figures: dict[str, Any]) -> None:
    """The table."""
    print(f"{'planted':16s}{'jobs':>6s}{'right':>7s}   what else was said")
    total = good = 0
    for fault, said in figures["said"].items():
        jobs = sum(said.values())
        right = sum(n for cause, n in said.items() if cause in [r or "good" for r in RIGHT[fault]])
        other = ", ".join(f"{c} {n}" for c, n in said.items() if c not in [r or "good" for r in RIGHT[fault]])
        print(f"{fault:16s}{jobs:6d}{right:7d}   {other}")
        if fault != "clean":
            total, good = total + jobs, good + right
    print(f"right cause in {good} of {total} planted faults ({100 * good / max(total, 1):.1f} %)")
    for line in figures["wrong"]:
        print("  ", line)


def main(quick: bool = False) -> dict[str, Any]:
    """For `benchmarks/run.py`."""
    figures = run(range(500, 502 if quick else 525), range(900, 904 if quick else 1000))
    report(figures)
    return figures


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--seeds", type=int, default=25, help="wind tunnels, eleven faults in each")
    parser.add_argument("--clean", type=int, default=100)
    parser.add_argument("--seed", type=int, default=500)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--show", action="store_true")
    asked = parser.parse_args()
    start = asked.seed
    done = run(range(start, start + asked.seeds), range(start + 400, start + 400 + asked.clean), asked.show)
    report(done)
    if asked.json:
        asked.json.write_text(json.dumps(done, indent=1))
