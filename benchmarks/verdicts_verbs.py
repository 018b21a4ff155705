"""The verdict of `deform`, `psp`, `infrared`, `reconstruct`, `calibrate` with planted faults, and clean.

    python benchmarks/verdicts_verbs.py [--seeds N] [--seed S] [--kinds psp ...] [--faults focal ...] [--json F]

Every job goes through the command line with ``--json``, as a user's does: what is judged is the verdict that it prints,
a refusal's too. Of every seed and kind `windmark simulate` makes one test; each job is a copy of its files with one of
them changed. The clean job of each is the test itself. The main job's faults: `verdicts.py`.

"right" is the cause of the verdict; where none of them names the fault (a dark picture is a file), a word of its reason
too. "silent" is a job with a fault that is called good.
"""

from __future__ import annotations

import argparse
import csv
import json
import re
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

from windmark import io
from windmark.geometry import Pose
from windmark.pipeline.simulate_deforming import simulate_deforming
from windmark.pipeline.simulate_infrared import simulate_infrared
from windmark.pipeline.simulate_photos import simulate_photos
from windmark.pipeline.simulate_psp import simulate_psp

Change = Callable[[Path, np.random.Generator], None]
SIGN = (-1, 1)
EITHER = "is not the one that is given or where cam_from_rig says"
"""Two cameras that contradict each other do not always tell which of them, and what of it, is wrong."""


@dataclass(frozen=True)
class Fault:
    """A change of a job's files, and what the verdict has to say: a cause, or a word of its reason."""

    change: Change
    causes: tuple[str, ...]
    words: tuple[str, ...] = ()

    def named(self, said: dict[str, Any]) -> bool:
        """Whether a verdict names it."""
        reason = said["reason"].lower()
        return said["cause"] in self.causes or any(word in reason for word in self.words)


def cameras(change: Callable[[Any, Pose | None, np.random.Generator], tuple[Any, Pose | None]], name: str) -> Change:
    """Change a camera's file."""

    def planted(folder: Path, rng: np.random.Generator) -> None:
        file = io.read_camera_file(folder / f"{name}.json")
        camera, pose = change(file.camera, file.cam_from_model, rng)
        io.write_camera(folder / f"{name}.json", camera, pose, unit="mm")

    return planted


def longer(camera: Any, pose: Pose | None, rng: np.random.Generator) -> tuple[Any, Pose | None]:
    """A focal length that is 5 to 12 % wrong."""
    return replace(camera, focal_px=camera.focal_px * (1 + rng.uniform(0.05, 0.12) * rng.choice(SIGN))), pose


def knocked(camera: Any, pose: Pose | None, rng: np.random.Generator) -> tuple[Any, Pose | None]:
    """A camera that was turned by 0.3 to 1 deg since it was placed."""
    assert pose is not None
    turn = np.radians(rng.uniform(0.3, 1.0)) * rng.choice(SIGN)
    return camera, Pose.from_rotvec(np.array([0.0, turn, 0.0]), np.zeros(3)) @ pose


def both(*changes: Change) -> Change:
    """Several changes, one after the other."""

    def planted(folder: Path, rng: np.random.Generator) -> None:
        for change in changes:
            change(folder, rng)

    return planted


def table(name: str, change: Callable[[Any, np.random.Generator], Any]) -> Change:
    """Change a table of markers."""

    def planted(folder: Path, rng: np.random.Generator) -> None:
        io.write_markers(folder / name, change(io.read_markers(folder / name, roles=None), rng), length_unit="mm")

    return planted


def inches(markers: Any, rng: np.random.Generator) -> Any:
    """In inches; the file says mm."""
    return replace(markers, xyz=markers.xyz / 25.4, radius=markers.radius / 25.4)


def exchanged_labels(folder: Path, rng: np.random.Generator) -> None:
    """Two names exchanged in one of three pictures whose primaries are labelled by hand."""
    camera = io.read_camera_file(folder / "camera.json").camera
    primary = io.read_markers(folder / "primary.csv", roles=None)
    rows: dict[str, list[Any]] = {"image": [], "name": [], "x": [], "y": []}
    a, b = rng.choice(len(primary), 2, replace=False)
    for k, path in enumerate(sorted((folder / "truth" / "poses").glob("*.json"))[:9:4]):
        pose = io.read_camera_file(path).cam_from_model
        assert pose is not None
        names = primary.name.copy()
        if k == 1:
            names[[a, b]] = names[[b, a]]
        xy = camera.project(pose.apply(primary.xyz))[0] + rng.normal(0, 0.5, (len(primary), 2))
        inside = camera.in_image(xy)
        rows["image"] += [path.stem] * int(inside.sum())
        rows["name"] += names[inside].tolist()
        rows["x"] += xy[inside, 0].round(1).tolist()
        rows["y"] += xy[inside, 1].round(1).tolist()
    io.write_table(folder / "labels.csv", {key: np.array(column) for key, column in rows.items()})


def off(markers: Any, rng: np.random.Generator) -> Any:
    """One marker 8 mm beside its place."""
    xyz = markers.xyz.copy()
    xyz[rng.integers(len(xyz)), :2] += 8 * rng.choice(SIGN, 2) / np.sqrt(2)
    return replace(markers, xyz=xyz)


def seen_off(folder: Path, rng: np.random.Generator) -> None:
    """One marker of the model that a camera looks at 8 mm beside its place."""
    markers = io.read_markers(folder / "markers.csv", roles=None)
    seen = np.zeros(len(markers), bool)
    for file in (io.read_camera_file(p) for p in sorted(folder.glob("cam*.json"))):
        assert file.cam_from_model is not None
        place = file.cam_from_model.apply(markers.xyz)
        facing = (file.cam_from_model.rotate(markers.normal) * place).sum(axis=1) < -0.3 * np.linalg.norm(place, axis=1)
        seen |= facing & file.camera.in_image(file.camera.project(place)[0])
    xyz = markers.xyz.copy()
    xyz[rng.choice(np.flatnonzero(seen & (markers.role == "model"))), :2] += 8 * rng.choice(SIGN, 2) / np.sqrt(2)
    io.write_markers(folder / "markers.csv", replace(markers, xyz=xyz), length_unit="mm")


def blurred(pattern: str) -> Change:
    """Pictures out of focus: blurred by 2.2 to 3 px."""

    def planted(folder: Path, rng: np.random.Generator) -> None:
        far = rng.uniform(2.2, 3.0)
        for path in sorted(folder.glob(pattern)):
            image = np.asarray(io.read_image(path))
            io.write_image(path, gaussian_filter(image.astype(float), far).round().astype(image.dtype))

    return planted


def text(file: str, *pairs: tuple[str, str]) -> Change:
    """Words of a text file that are others."""

    def planted(folder: Path, rng: np.random.Generator) -> None:
        path = folder / file
        said = path.read_text(encoding="utf-8")
        for old, new in pairs:
            assert old in said, f"{file} has no {old!r}"
            said = said.replace(old, new)
        path.write_text(said, encoding="utf-8")

    return planted


def rigid(file: str) -> Change:
    """The bending wing taken as a rigid part."""

    def planted(folder: Path, rng: np.random.Generator) -> None:
        path = folder / file
        lines = path.read_text(encoding="utf-8").splitlines()
        kept = [line for line in lines if not line.startswith(('law = "beam"', "options = { root"))]
        assert len(kept) == len(lines) - 2
        path.write_text("\n".join(kept) + "\n", encoding="utf-8")

    return planted


def column(file: str, name: str, change: Callable[[np.ndarray], np.ndarray]) -> Change:
    """Numbers of a table in another unit than its head says."""

    def planted(folder: Path, rng: np.random.Generator) -> None:
        with (folder / file).open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
        columns = {key: np.array([row[key] for row in rows]) for key in rows[0]}
        columns[name] = change(columns[name].astype(float))
        io.write_table(folder / file, columns)

    return planted


def scaled(file: str, factors: dict[str, float]) -> Change:
    """Numbers of a project's keys in another unit."""

    def planted(folder: Path, rng: np.random.Generator) -> None:
        path = folder / file
        lines = path.read_text(encoding="utf-8").splitlines()
        for k, line in enumerate(lines):
            key, equals, value = line.partition(" = ")
            if equals and key in factors:
                for number in re.findall(r"[-+0-9.e]+", value):
                    value = value.replace(number, f"{float(number) * factors[key]:g}", 1)
                lines[k] = f"{key} = {value}"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")

    return planted


def readings(change: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Change:
    """Readings of the taps that are others': ``change`` of points and numbers (N,)."""

    def planted(folder: Path, rng: np.random.Generator) -> None:
        with (folder / "tap-pressures.csv").open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
        columns = {key: np.array([row[key] for row in rows]) for key in rows[0]}
        columns["pressure_Pa"] = change(columns["point"], columns["pressure_Pa"])
        io.write_table(folder / "tap-pressures.csv", columns)

    return planted


def of_the_other(point: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """Readings of two points exchanged."""
    first = point == point[0]
    out = pressure.copy()
    out[first], out[~first] = pressure[~first], pressure[first]
    return out


def of_the_next(point: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """The row below each name: those of every point by one."""
    return np.concatenate([np.roll(pressure[point == name], -1) for name in dict.fromkeys(point)])


def cameras_exchanged(folder: Path, rng: np.random.Generator) -> None:
    """Each of two cameras has the other's pictures."""
    for path in sorted(folder.glob("images/**/*cam1*")):
        other = path.with_name(path.name.replace("cam1", "cam2"))
        spare = path.with_name("spare")
        path.rename(spare)
        other.rename(path)
        spare.rename(other)


def pixels(pattern: str, change: Callable[[np.ndarray, np.random.Generator], np.ndarray], part: float = 0.0) -> Change:
    """Pictures whose levels are others, from a part of the series on."""

    def planted(folder: Path, rng: np.random.Generator) -> None:
        paths = sorted(folder.glob(pattern))
        assert paths, pattern
        for path in paths[round(part * len(paths)) :]:
            image = np.asarray(io.read_image(path))
            light = change(image.astype(float), rng)
            io.write_image(path, np.clip(light.round(), 0, np.iinfo(image.dtype).max).astype(image.dtype))

    return planted


def darker(factor: float, black: float = 64.0) -> Callable[[np.ndarray, np.random.Generator], np.ndarray]:
    """So much of the light, over the simulation's level without any."""
    return lambda light, _: black + factor * (light - black)


def oil(light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A spot in the middle that takes 15 % of the light."""
    rows, columns = np.mgrid[: light.shape[0], : light.shape[1]]
    far = np.hypot(rows - light.shape[0] / 2, columns - light.shape[1] / 2) / (0.06 * light.shape[1])
    return light * (1 - 0.15 * (far < 1))


def warmer(light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A shutter that was calibrated anew: 8 % of the scene's contrast more on all pixels, some kelvin tenths."""
    return light + 0.08 * float(np.ptp(np.quantile(light, [0.01, 0.99])))


def celsius(kelvin: np.ndarray) -> np.ndarray:
    """Kelvin as degrees Celsius."""
    return np.round(kelvin - 273.15, 3)


EXCHANGED = Fault(cameras_exchanged, ("moved",), ("exchanged",))
FOCAL, MOVED = Fault(cameras(longer, "cam1"), ("focal",), (EITHER,)), Fault(cameras(knocked, "cam2"), ("moved",))
UNITS = Fault(table("markers.csv", inches), ("units",))
SERIES = {"focal": FOCAL, "moved": MOVED, "units": UNITS, "exchanged": EXCHANGED}
FAULTS: dict[str, dict[str, Fault]] = {
    "deform": {
        **SERIES,
        "marker": Fault(seen_off, ("marker",)),
        "blurred": Fault(blurred("images/*.tif"), ("blurred",)),
        "bent": Fault(rigid("deform.toml"), ("bent",)),
    },
    "psp": {
        **SERIES,
        "blurred": Fault(blurred("images/*/o*.tif"), ("blurred",)),
        "bent": Fault(rigid("psp.toml"), ("bent",)),
        "dark": Fault(text("psp.toml", ('dark = "calibration/dark', 'dark = "calibration/flat')), (), ("dark",)),
        "taps hPa": Fault(column("tap-pressures.csv", "pressure_Pa", lambda p: p / 100), ("taps", "units")),
        "taps of the other point": Fault(readings(of_the_other), ("taps",)),
        "taps of the next row": Fault(readings(of_the_next), ("taps",)),
        "exposure of cam2": Fault(pixels("images/*/on-cam2*.tif", darker(0.8)), ("cameras", "taps")),
        "oil": Fault(pixels("images/*/on-*.tif", oil), ("cameras",)),
        "clipped": Fault(
            pixels("images/*/off-*.tif", lambda x, _: np.minimum(x, np.quantile(x, 0.97))), ("saturated",)
        ),
        "taps compared, lamps": Fault(
            both(text("psp.toml", ("[taps]", '[taps]\nin_situ = "compare"')),
                 pixels("images/*/on-*.tif", darker(0.97))), ("taps",),
        ),
        "lamps cm": Fault(scaled("psp.toml", {"position": 0.1}), ("lamps", "units")),
        "loads in m": Fault(scaled("psp.toml", {"area": 1e-6, "chord": 1e-3}), ("units",), ("area", "chord")),
        "wall in C": Fault(
            column("thermocouple-readings.csv", "temperature_K", celsius), ("units",), ("temperature", "thermocouple")
        ),
    },
    "infrared": {
        **SERIES,
        "blurred": Fault(blurred("images/*.tif"), ("blurred",)),
        "bent": Fault(rigid("infrared.toml"), ("bent",)),
        "out of focus later": Fault(
            pixels("images/*cam1*.tif", lambda x, _: gaussian_filter(x, 2.5), 0.5), ("blurred",)
        ),
        "shutter of cam1": Fault(pixels("images/*cam1*.tif", warmer, 0.5), ("cameras",)),
        "unit": Fault(text("infrared.toml", ('unit = "K"', 'unit = "degC"')), ("units",), ("temperature", "unit")),
    },
    "reconstruct": {
        "focal": Fault(cameras(longer, "camera"), ("focal",)),
        # Names of primaries are those of the table: exchanged there they are so in the result, and nothing else is.
        "swapped": Fault(exchanged_labels, ("swapped",), ("exchanged",)),
        "marker": Fault(table("primary.csv", off), ("control", "marker")),
        "blurred": Fault(blurred("photos/*.tif"), ("blurred",)),
    },
    "calibrate": {
        "marker": Fault(table("markers.csv", off), ("marker",)),
        "blurred": Fault(blurred("photos/*.tif"), ("blurred",)),
    },
}  # fmt: skip
"""By verb: what is planted."""


def make(kind: str, folder: Path, seed: int) -> None:
    """A small test of a verb."""
    if kind == "deform":
        simulate_deforming(folder, seed, 4, (640, 400))
    elif kind == "psp":
        simulate_psp(folder, seed, 2)
    elif kind == "infrared":
        simulate_infrared(folder, seed, 14)
    else:
        simulate_photos(folder, seed, 12)
        shutil.copy(folder / "truth" / "markers.csv", folder / "markers.csv")


def command(kind: str, folder: Path) -> list[str]:
    """The job of a folder."""
    if kind in ("deform", "psp", "infrared"):
        return [kind, str(folder / f"{kind}.toml")]
    photos = [*map(str, sorted((folder / "photos").glob("*.tif"))), "-c", str(folder / "camera.json")]
    more = ["-p", str(folder / "primary.csv")] if kind == "reconstruct" else ["-m", str(folder / "markers.csv")]
    more += ["--datum", "weighted=0.05"] if kind == "calibrate" else []
    more += ["--labels", str(folder / "labels.csv")] if (folder / "labels.csv").exists() else []
    return [kind, *photos, *more, "--unit", "mm", "--radius", "2.7"]


def judged(kind: str, folder: Path) -> dict[str, Any]:
    """The verdict that a job prints."""
    from typer.testing import CliRunner

    from windmark.app.cli import app

    done = CliRunner().invoke(app, [*command(kind, folder), "-o", str(folder / "out"), "--json"])
    last = done.stdout.strip().splitlines()[-1:] or ["{}"]
    try:
        record = json.loads(done.stdout if done.stdout.lstrip().startswith("{") else last[0])
    except json.JSONDecodeError:
        record = json.loads(last[0])
    verdict: dict[str, Any] = record.get("verdict") or {"word": "none", "cause": "NONE", "reason": done.output[-300:]}
    return verdict


def run(seeds: range, kinds: list[str], faults: list[str] | None = None) -> dict[str, Any]:
    """All jobs; counts by verb and fault, and what was said wrong."""
    said: dict[str, Counter[str]] = {}
    wrong: list[str] = []
    for seed in seeds:
        for kind in kinds:
            with tempfile.TemporaryDirectory() as place:
                base = Path(place) / "base"
                base.mkdir()
                make(kind, base, seed)
                for name, fault in {"clean": None, **FAULTS[kind]}.items():
                    if faults and name not in faults:
                        continue
                    folder = Path(place) / name.replace(" ", "-")
                    shutil.copytree(base, folder)
                    if fault is not None:
                        fault.change(folder, np.random.default_rng([seed, 98]))
                    verdict = judged(kind, folder)
                    right = verdict["word"] == "good" if fault is None else fault.named(verdict)
                    what = "right" if right else "SILENT" if verdict["word"] == "good" else verdict["cause"]
                    said.setdefault(f"{kind} {name}", Counter())[what] += 1
                    line = f"{kind} {name} {seed}: {verdict['word']}, {verdict['cause']}: {verdict['reason'][:220]}"
                    print("    " if right else "  ! ", line, flush=True)
                    if not right:
                        wrong.append(line)
                    shutil.rmtree(folder)
    return {"said": {k: dict(v) for k, v in said.items()}, "wrong": wrong}


def report(figures: dict[str, Any]) -> None:
    """The table."""
    print(f"\n{'verb, planted':26s}{'jobs':>5s}{'right':>6s}   else")
    jobs, good = Counter[bool](), Counter[bool]()
    for name, said in figures["said"].items():
        count, clean = sum(said.values()), name.endswith(" clean")
        jobs[clean] += count
        good[clean] += said.get("right", 0)
        other = ", ".join(f"{c} {n}" for c, n in said.items() if c != "right")
        print(f"{name:26s}{count:5d}{said.get('right', 0):6d}   {other}")
    print(f"right cause in {good[False]} of {jobs[False]} planted faults; {jobs[True] - good[True]} false alarms in "
          f"{jobs[True]} clean jobs")  # fmt: skip


def main(quick: bool = False) -> dict[str, Any]:
    """For `benchmarks/run.py`."""
    figures = run(range(3100, 3101 if quick else 3106), list(FAULTS))
    report(figures)
    return figures


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--seed", type=int, default=3100)
    parser.add_argument("--kinds", nargs="+", choices=list(FAULTS), default=list(FAULTS))
    parser.add_argument("--faults", nargs="+")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    done = run(range(asked.seed, asked.seed + asked.seeds), asked.kinds, asked.faults)
    report(done)
    if asked.json:
        asked.json.write_text(json.dumps(done, indent=1))
    sys.exit(0)
