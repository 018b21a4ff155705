"""Every example of a --help runs as it is written, where files of these names lie in the folder.

An example that a page of the documentation has, too, with or without its folder of data, runs there
(`test_documented_run`).
"""

import csv
import glob
import os
import re
import shlex
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from windmark import io

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs"))
sys.path.insert(0, str(ROOT / "tests" / "io"))

from camera_files import write_cine  # noqa: E402
from make_reference import every_command, examples  # noqa: E402

PAGES = [ROOT / "README.md", *ROOT.glob("docs/*.md"), *ROOT.glob("docs/tutorial/*.md")]
REMARK = re.compile(r"\s+\(.*\)$")
"""What an example says behind itself."""
ELSEWHERE = {
    "windmark view project.toml": "serves until it is stopped (test_view_job)",
    "windmark warmup": "compiles for minutes where nothing is compiled (test_warmup)",
}
SMALLER = {
    "windmark simulate my-board --board 8": "windmark simulate my-board --board 4",
    "windmark simulate my-rig --cameras 3": "windmark simulate my-rig --cameras 2",
    "windmark study --radius 3 --radius 5 --noise-percent 10 --output noisy-markers":
        "windmark study --radius 3 --radius 5 --noise-percent 10 --output noisy-markers --steps 3 --markers 36",
}  # fmt: skip
"""The same with fewer pictures, cameras, markers, for time."""
MAY_BE_1 = {"windmark doctor --json"}
"""Exit code 1 tells of the machine, not of the command."""
DESKS = {
    "photos": ("windmark calibrate", "windmark reconstruct", "windmark epipolar"),
    "wing": ("windmark deform", "windmark laws", "windmark init my-wing"),
    "film": ("windmark track",),
}
"""Whose files an example names; all others are those of the virtual tunnel."""


def help_lines():
    documented = {line for page in PAGES for line in page.read_text(encoding="utf-8").splitlines()}
    documented |= {re.sub(r"\bmy-[a-z]+/", "", line) for line in documented}
    lines = [line for _, command in every_command() for line in examples(command.epilog or "")]
    return [line for line in lines if line not in ELSEWHERE and line not in documented]


def tunnel(desk, windmark):
    shutil.copytree(desk, desk / "my-test", ignore=shutil.ignore_patterns("my-test"))
    for name, of in {"run12": "wind-off", "run13": "wind-on", "off": "wind-off", "on": "wind-on", "a": "wind-off",
                     "b": "wind-on"}.items():  # fmt: skip
        shutil.copy(desk / f"{of}.tif", desk / f"{name}.tif")
    shutil.copy(desk / "model.grid", desk / "wing.grid")
    os.chdir(desk)
    for line in ("register run12.tif -m markers.csv -c camera.json -r 4 --unit mm", "detect run12.tif -r 4",
                 "convert camera.json camera.xml", "convert markers.csv targets.tgts --unit mm --to-unit in",
                 "run my-test/project.toml"):  # fmt: skip
        assert windmark(*line.split()).code == 0, line
    rows = [
        f"{m} {x:.4f} {y:.4f} {z:.4f} 12 0.03" for m, (x, y, z) in enumerate(io.read_markers(desk / "markers.csv").xyz)
    ]
    (desk / "targets.txt").write_text("\n".join(["point X Y Z rays rms", *rows]), encoding="utf-8")
    posed, other = "run12-registration/run12/camera.json", "my-test/truth/wind-on-camera.json"
    shutil.copy(desk / "camera.json", desk / "interior.json")
    shutil.copy(desk / posed, desk / "posed.json")
    shutil.copy(desk / other, desk / "other.json")
    levels = np.stack([np.asarray(io.read_image(desk / f"{n}.tif"))[::4, ::4] >> 4 for n in ("run12", "run13")] * 60)
    write_cine(desk / "run.cine", levels.astype(np.uint16), 16, packing=1024, times=1e9 + 0.01 * np.arange(len(levels)),
               trigger_s=1e9)  # fmt: skip


def photos(desk, windmark):
    """Markers A, B, C, D of the tables are four that every picture shows."""
    primary = io.read_markers(desk / "primary.csv", roles=None)
    new = dict(zip(primary.name[:4].tolist(), "ABCD", strict=True))
    for table in ("rough.csv", "primary.csv"):
        rows = (desk / table).read_text(encoding="utf-8").splitlines()
        cut = [line.split(",", 1) for line in rows]
        (desk / table).write_text("\n".join(",".join([new.get(c[0], c[0]), *c[1:]]) for c in cut) + "\n", "utf-8")
    for k, path in enumerate(sorted((desk / "photos").glob("*.tif")), start=1):
        image = np.asarray(io.read_image(path))
        if k < 3:
            shutil.copy(path, desk / f"P{k:02d}.tif")
        Image.fromarray(image if image.dtype == np.uint8 else (image >> 8).astype(np.uint8)).save(
            desk / "photos" / f"IMG{k:02d}.jpg", quality=97
        )
    os.chdir(desk)
    given = sorted(glob.glob("photos/*.tif"))
    done = windmark("calibrate", *given, "-m", "rough.csv", "-c", "camera.json", "-r", "2.7", "--datum", "free",
                    "--unit", "mm", "-o", "first")  # fmt: skip
    assert done.code == 0, done.err
    with (desk / "first" / "matches.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    # As a larger sensor behind the lens sees it.
    for axis, (old, wide) in {"x": (1024, 3004), "y": (768, 2000)}.items():
        columns[axis] = (columns[axis].astype(float) - (old - 1) / 2) * 2.6 + (wide - 1) / 2
    for name in columns:
        if name.startswith("sigma"):
            columns[name] = columns[name].astype(float) * 2.6
    io.write_table(desk / "matches.csv", columns)


def wing(desk, _):
    shutil.copytree(desk, desk / "my-wing", ignore=shutil.ignore_patterns("my-wing"))
    (desk / "my-wing" / "deform.toml").unlink()
    shutil.copytree(desk / "images", desk / "incoming")
    shutil.copy(desk / "my_law.py", desk / "wing.py")


def film(desk, _):
    for k, path in enumerate(sorted((desk / "frames").glob("*.tif"))):
        shutil.copy(path, desk / f"run12-{k:03d}.tif")


MAKERS = {
    "tunnel": (("--seed", 7), tunnel),
    "photos": (("--photos", 5), photos),
    "wing": (("--deforming", 4, "--seed", 3), wing),
    "film": (("--sequence", 3), film),
}
"""What each kind of examples is simulated with, and what is made of that."""


@pytest.fixture(scope="module")
def desks(tmp_path_factory, windmark, simulated):
    """``desks(name)``: a folder with the files of a kind of examples, made once."""
    made = {}

    def desk(name):
        if name not in made:
            options, make = MAKERS[name]
            made[name] = shutil.copytree(simulated(*options), tmp_path_factory.mktemp(name), dirs_exist_ok=True)
            make(made[name], windmark)
        return made[name]

    return desk


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")  # reports are drawn in the tests of their verbs
@pytest.mark.parametrize("line", help_lines())
def test_example_of_a_help_runs(line, desks, simulated, windmark, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if line.startswith("windmark simulate"):
        simulated(*shlex.split(SMALLER.get(line, line))[3:])
        return
    name = next((n for n, verbs in DESKS.items() if line.startswith(verbs)), "tunnel")
    shutil.copytree(desks(name), tmp_path / "desk")
    monkeypatch.chdir(tmp_path / "desk")
    if line.startswith("windmark pov camera.json"):  # of a registered picture
        shutil.copy("posed.json" if "--label" not in line else "interior.json", "camera.json")
    if line.startswith("windmark init my-test"):
        Path("my-test/project.toml").unlink()
    if "--poses" in line or line.startswith("windmark convert camera.xml"):
        Path("camera.json").unlink()
    words = shlex.split(REMARK.sub("", SMALLER.get(line, line)), comments=True)[1:]
    given = [w for word in words for w in (sorted(glob.glob(word)) or [word])]
    done = windmark(*given)
    assert done.code == 0 or (done.code == 1 and line in MAY_BE_1), f"{line}\n{done.out[-800:]}\n{done.err[-1500:]}"


def test_exceptions_are_still_examples():
    every = {x for _, command in every_command() for x in examples(command.epilog or "")}
    assert set(ELSEWHERE) | set(SMALLER) | MAY_BE_1 <= every
