"""`windmark calibrate` on the DICe stereo rig, from the pictures of its dot board, in one command.

14 pairs of a printed grid of discs, pitch 3.5 mm, three of them rings; no camera, no coordinates. The print is off by
some hundredths of a millimetre, so the discs are measured with the cameras; the grid is the start and the datum.
Published: nothing but the pitch; the source's own test asks for 0.75 px. Printed: 2-D RMS of the residuals of each
camera with and without gross errors left out and, to compare, with the grid held as it should be.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from _real_truth import DATA
from windmark import io
from windmark.app.cli import app

FOLDER = DATA / "dice-stereo-dots"
COMMAND = (
    "--board", "3.5", "--board-marks", "holes:0,0:5,0:0,-3", "--unit", "mm", "--rig", "--images-of", "left=*_0",
    "--images-of", "right=*_1", "--free", "focal_px,cx,cy,k1",
)  # fmt: skip
RADIUS_PX = 46.0
CASES = {"gross errors left out": (), "all marks": ("--no-reject",), "grid held, all marks": (
    "--no-reject", "--datum", "fixed", "--max-sigma0", "50")}  # fmt: skip


def smaller(work: Path, block: int, which: slice = slice(None)) -> list[Path]:
    """The pictures (or ``which`` of the sorted ones), so many pixels averaged to one along each side, 16 bits."""
    paths = []
    for path in sorted((FOLDER / "images").iterdir())[which]:
        image = io.read_grey(path)
        height, width = (n // block * block for n in image.shape)
        small = image[:height, :width].reshape(height // block, block, width // block, block).mean(axis=(1, 3))
        paths.append(work / f"{path.stem}.png")
        io.write_image(paths[-1], np.rint(small * 200).astype(np.uint16))
    return paths


def figures_of(images: list[Path], block: int, options: tuple[str, ...], out: Path) -> dict[str, float]:
    """One run; lengths in pixels of the full pictures."""
    done = CliRunner().invoke(app, [
        "calibrate", *map(str, images), *COMMAND, "-r", f"{RADIUS_PX / block:g}", *options, "-o", str(out), "--json",
    ], catch_exceptions=False)  # fmt: skip
    if done.exit_code:
        raise SystemExit(done.output)
    told = json.loads(done.stdout)
    table = io.read_table(
        out / "residuals.csv", required=(), known=("image", "name", "x", "y", "dx", "dy", "test", "used")
    )
    square = (table.numbers("dx") ** 2 + table.numbers("dy") ** 2) * block**2
    used, right = table.numbers("used") > 0, np.char.endswith(np.array(table.text("image")), "_1")
    (rig,) = told["rig"]
    return {
        "views": told["views"], "marks": told["marks"], "left_out": told["left_out"],
        "rms_left_px": float(np.sqrt(square[used & ~right].mean())),
        "rms_right_px": float(np.sqrt(square[used & right].mean())), "rms_px": float(np.sqrt(square[used].mean())),
        "distance_mm": rig["distance"]["value"], "distance_sigma": rig["distance"]["sigma"],
        "angle_deg": rig["angle_deg"]["value"], "angle_sigma": rig["angle_deg"]["sigma"],
        "split": told["halves"].get("ratio", float("nan")),  # too few pictures for halves
        **{f"focal_{k}": c["focal_px"]["value"] * block for k, c in told["cameras"].items()},
        **{f"focal_sigma_{k}": c["focal_px"]["sigma"] * block for k, c in told["cameras"].items()},
    }  # fmt: skip


def main(quick: bool = False) -> dict[str, object]:
    """Measure, print one table, return its rows."""
    if not FOLDER.is_dir():
        print("calibration_rig: the real pictures are not here")
        return {}
    figures: dict[str, object] = {}
    with tempfile.TemporaryDirectory() as place:
        work = Path(place)
        block = 4 if quick else 1
        images = smaller(work, block) if quick else sorted((FOLDER / "images").iterdir())
        print("                         views  marks  left out   left  right   both px  apart mm          turned deg"
              "           split")  # fmt: skip
        for name, options in CASES.items():
            r = figures_of(images, block, options, work / "out")
            figures[name] = r
            print(f"{name:24s} {r['views']:5.0f} {r['marks']:6.0f} {r['left_out']:9.0f} {r['rms_left_px']:6.3f}"
                  f" {r['rms_right_px']:6.3f} {r['rms_px']:9.3f}  {r['distance_mm']:.3f} ({r['distance_sigma']:.3f})"
                  f"  {r['angle_deg']:.4f} ({r['angle_sigma']:.4f}) {r['split']:6.2f}", flush=True)  # fmt: skip
    return figures


if __name__ == "__main__":
    main("--quick" in sys.argv)
