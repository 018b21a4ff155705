"""The whole way from two pictures to a ratio and Cp on NASA's camera 5 (1280 x 800), beside the known field.

    python benchmarks/paint_nasa.py [--folder KEEP] [--values footprint]

There is one picture of that camera: it is the wind-off one. The wind-on picture is made of it: every pixel that sees
the surface is divided by the ratio that a known Cp gives there by a known calibration; both get noise of their own (16
bit, 10 electrons per grey level). `windmark psp` then reduces the pair by its project, which knows the interior
parameters, the target table, the grid of 309,062 nodes, the cell's table and the conditions: markers are found, both
poses registered, the ratio is formed on the model. Printed: errors, the part within 1.96 sigma, seconds of every stage
(the first run may compile, the second counts). What the figures leave out: background light, which the real picture has
and which nobody knows, is taken as the paint's in both pictures alike.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from windmark import io
from windmark.resection import map_pixels
from windmark.synth.pressure_paint import TYPICAL

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "nasa-upsp-cam5"
P_INF, Q_INF, P_OFF, T_OFF, T_0, MACH = 70_000.0, 25_000.0, 100_000.0, 293.0, 300.0, 0.7
DEEPER, GAIN, READ_NOISE = 16, 10.0, 1.0
Z = 1.959964

_PROJECT = """\
title = "NASA camera 5 with a made wind-on picture"
length_unit = "in"
[points]
table = "points.csv"
max_alpha_error_deg = 90
[[camera]]
name = "cam5"
file = "{data}/camera05_35_6.json"
[markers]
file = "{data}/fml_tc3_volume.tgts"
[grid]
file = "{data}/fml_tc3_volume.grid"
[look]
radius_px = 3
[[volume]]
name = "model"
[radiometry]
black = 0
gain = {gain}
read_noise = {read_noise}
[paint]
cell = "cell.csv"
[temperature]
recovery = 1.0
sigma_K = 0.1
[sampling]
values = "{values}"
[output]
folder = "out"
"""


def cp_at(xyz: np.ndarray) -> np.ndarray:
    """A known field: waves, and a rise over some tenths of an inch across the plate."""
    x, y = xyz[..., 0], xyz[..., 1]
    return np.asarray(0.4 * np.sin(x / 3) * np.cos(y / 2) - 0.5 / (1 + np.exp((x - 3 - 0.3 * y) / 0.1)))


def ratio_at(xyz: np.ndarray) -> np.ndarray:
    """Wind-off over wind-on light of that field."""
    on, off = TYPICAL.ratio(P_INF + Q_INF * cp_at(xyz), T_0), TYPICAL.ratio(P_OFF, T_OFF)
    return np.asarray(on / off)


def write_pair(folder: Path, values: str) -> None:
    """Pictures, tables and project."""
    camera, pose = io.read_camera(DATA / "camera05_35_6.json")
    assert pose is not None
    seen = io.read_image(DATA / "CAM5.png").astype(float) * DEEPER
    xyz = map_pixels(io.read_mesh(DATA / "fml_tc3_volume.grid"), camera, pose).xyz()
    part = np.nan_to_num(ratio_at(xyz), nan=1.0)
    rng = np.random.default_rng(8)
    for name, light in (("off", seen), ("on", seen / part)):
        noisy = rng.poisson(GAIN * light) / GAIN + READ_NOISE * rng.standard_normal(light.shape)
        io.write_image(folder / f"{name}.tif", np.clip(np.rint(noisy), 0, 65535).astype(np.uint16))
    p, t = np.meshgrid(np.linspace(30_000, 110_000, 9), np.linspace(283, 313, 4))
    rows = "".join(f"{a:.1f},{b:.2f},{r:.6f},0.0005\n" for a, b, r in
                   zip(p.ravel(), t.ravel(), TYPICAL.ratio(p, t).ravel(), strict=True))  # fmt: skip
    (folder / "cell.csv").write_text("pressure_Pa,temperature_K,ratio,sigma\n" + rows)
    (folder / "points.csv").write_text(
        "point,alpha_deg,p_inf_Pa,q_inf_Pa,p_off_Pa,T_off_K,mach,T0_K,on,off\n"
        f"p1,0,{P_INF},{Q_INF},{P_OFF},{T_OFF},{MACH},{T_0},on.tif,off.tif\n"
    )
    text = _PROJECT.format(data=DATA.as_posix(), gain=GAIN, read_noise=READ_NOISE, values=values)
    (folder / "psp.toml").write_text(text)


def reduced(folder: Path) -> dict[str, Any]:
    """The record of the point, by the command."""
    command = [sys.executable, "-m", "windmark.app.cli", "psp", str(folder / "psp.toml"), "-o", str(folder / "out"),
               "--json"]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"paint_nasa: {done.stderr}")
    return dict(json.loads(done.stdout))


def compared(folder: Path) -> None:
    """Print errors of the fields against what was put in, at nodes whose pixels all show paint."""
    fields = {k: np.asarray(v, float) for k, v in io.read_nodes_netcdf(folder / "out" / "p1" / "fields.nc")[1].items()}
    rest = io.read_mesh(DATA / "fml_tc3_volume.grid").vertices
    on = np.isfinite(fields["cp"]) & (fields["filled"] == 0)
    for name, true in (("ratio", ratio_at(rest)), ("cp", cp_at(rest))):
        off, sigma = (fields[name] - true)[on], fields[f"sigma_{name}"][on]
        print(f"{name}: {on.sum()} nodes, error RMS {np.sqrt(np.mean(off**2)):.4f}, median "
              f"{np.median(np.abs(off)):.4f}, stated {np.median(sigma):.4f} (median), within 1.96 sigma "
              f"{100 * np.mean(np.abs(off) < Z * sigma):.1f} %")  # fmt: skip


def main() -> None:
    """Make the pair, reduce it twice, compare."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--values", default="footprint")
    options = parser.parse_args()
    if not DATA.is_dir():
        print("skipped: NASA's test data are not beside the checkout (shared/data/nasa-upsp-cam5)")
        return
    with contextlib.ExitStack() as stack:
        folder = options.folder or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        write_pair(folder, options.values)
        reduced(folder)
        point = reduced(folder)["results"][0]
        print(f"residuals {point['rms_px']:.2f} px; seconds: "
              + ", ".join(f"{name} {value:.2f}" for name, value in point["seconds"].items()))  # fmt: skip
        compared(folder)


if __name__ == "__main__":
    main()
