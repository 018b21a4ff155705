"""A wheel of windmark that brings its kernels compiled, for this system and this version of Python.

    python packaging/compiled_wheel.py [dist]

The sources are copied, the kernels are compiled there for x86-64-v3 (see ``windmark.geometry._shipped``) by a job of
every verb, and go into the wheel. Takes some seven minutes. To be run by the Python whose packages windmark uses;
setuptools comes from where pip finds it.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("src", "docs", "examples", "pyproject.toml", "README.md", "CHANGELOG.md", "LICENSE")
JOBS = """
warmup
demo demo
simulate rig --cameras 3
run rig/project.toml
simulate film --sequence 5
track film/frames/*.tif -m film/markers.csv -c film/camera.json -r 4 --unit mm --roles model
simulate polar --psp 2
psp polar/psp.toml
simulate heat --infrared 8
infrared heat/infrared.toml
simulate wing --deforming 6
deform wing/deform.toml
simulate photos --photos 12
calibrate photos/photos/*.tif -c photos/camera.json -m photos/rough.csv -r 2.7 --datum free --unit mm
reconstruct photos/photos/*.tif -c photos/camera.json -p photos/primary.csv --unit mm --radius 2.7
simulate board --board 6
calibrate board/board/left_*.tif --board 3.5 --unit mm -r 9 -o lens
"""
"""What the documentation has its readers do, on data that windmark makes: one of every verb that measures."""


def copied(folder: Path) -> Path:
    """The sources without anything that was compiled; the package's folder."""
    leave = shutil.ignore_patterns("__pycache__", "*.egg-info", "compiled", "_build")
    for part in PARTS:
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, folder / part, ignore=leave)
        else:
            shutil.copy2(ROOT / part, folder / part)
    return folder / "src" / "windmark"


def pin_numba(folder: Path) -> None:
    """Another version of numba could not use what it brings: the wheel asks for this one."""
    import numba

    path = folder / "pyproject.toml"
    loose, text = re.compile(r'"numba>=[0-9.]+"'), path.read_text(encoding="utf-8")
    if len(loose.findall(text)) != 1:
        raise SystemExit("pyproject.toml: expected one dependency numba>=VERSION")
    path.write_text(loose.sub(f'"numba=={numba.__version__}"', text), encoding="utf-8")


def compile_kernels(package: Path) -> None:
    """As a first use does it, in processes whose target is not this processor."""
    from windmark.geometry._shipped import PROCESSOR

    name, features = PROCESSOR
    env = {**os.environ, "PYTHONPATH": str(package.parent), "NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": features}
    env.pop("NUMBA_CACHE_DIR", None)  # they are to be beside the sources
    run = [sys.executable, "-c", "from windmark.app.cli import main; main()"]
    with tempfile.TemporaryDirectory() as scratch:
        for job in JOBS.strip().splitlines():
            print(f"windmark {job}", flush=True)
            subprocess.run([*run, *job.split()], env=env, cwd=scratch, check=True, stdout=subprocess.DEVNULL)


def take_along(package: Path) -> int:
    """Move what numba kept to where the package looks for it; how many functions."""
    from windmark.geometry._jit import kernel_sources
    from windmark.geometry._shipped import FOLDER, NAME, manifest

    target = package / FOLDER
    count = 0
    for path in sorted(package.rglob("__pycache__/*.nb[ic]")):
        place = target / path.parent.parent.relative_to(package)
        place.mkdir(parents=True, exist_ok=True)
        path.rename(place / path.name)
        count += path.suffix == ".nbi"
    (target / NAME).write_text(json.dumps(manifest(kernel_sources(package)), indent=1), encoding="utf-8")
    return count


def build(folder: Path, to: Path) -> None:
    """The wheel, whose name says for which Python and system it is."""
    tags = f"--python-tag=cp{sys.version_info[0]}{sys.version_info[1]} --plat-name={_platform()}"
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--wheel-dir", str(to), str(folder)]
    subprocess.run([*command, f"--config-settings=--build-option={tags}"], check=True)


def _platform() -> str:
    return sysconfig.get_platform().replace("-", "_").replace(".", "_")


def main() -> None:
    """Build it."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("to", nargs="?", type=Path, default=ROOT / "dist", help="folder of the wheel (dist)")
    to = ask.parse_args().to
    if platform.machine().lower() not in ("x86_64", "amd64"):
        raise SystemExit(f"kernels are compiled for x86-64 alone, this is {platform.machine()}: use `pip wheel .`")
    with tempfile.TemporaryDirectory(prefix="windmark-wheel-") as place:
        folder = Path(place)
        package = copied(folder)
        pin_numba(folder)
        compile_kernels(package)
        count = take_along(package)
        build(folder, to)
    print(f"{count} compiled functions; wheel in {to}")


if __name__ == "__main__":
    main()
