"""`windmark calibrate` on the DBAT sheet, from the pictures, in one command.

21 hand-held pictures of a regular sheet of 10 x 10 discs. Rough coordinates: PhotoModeler's with 4 mm of noise, which
leaves nothing that tells the sheet from itself turned by 90 degrees; so the disc 1001 is labelled in three pictures, to
a pixel. Printed: pictures and marks that were matched, marks that were matched wrongly (farther than 4 px from the
published mark of that name), and the coordinates less PhotoModeler's after a fit (shift, turn, scale).
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from _real_truth import DATA
from calibration_real import published
from windmark import io
from windmark.app.cli import app
from windmark.geometry.similarity import align
from windmark.scene import MarkerSet

ROUGH_MM, LABELLED, LABEL, WRONG_PX = 4.0, (0, 6, 12), "1001", 4.0
RADII = ("10", "13", "17.5", "23")


def main(seed: int = 20) -> dict[str, object]:
    """Measure, print, return the figures."""
    folder = DATA / "dbat-camcal"
    if not folder.is_dir():
        print("calibration_pictures: the real pictures are not here")
        return {}
    sheet = published(folder)
    obs, true = sheet.observations, sheet.markers.xyz
    names = sheet.markers.name
    images = sorted((folder / "images").iterdir())
    marks = {(images[v].stem, str(names[p])): xy for v, p, xy in zip(obs.view, obs.point, obs.xy, strict=True)}
    rough = true + np.random.default_rng(seed).normal(0, ROUGH_MM, true.shape)
    normal = np.tile([0.0, 0.0, 1.0], (len(names), 1))
    with tempfile.TemporaryDirectory() as place:
        work = Path(place)
        io.write_markers(work / "rough.csv", MarkerSet.make(names, rough, normal=normal))
        labels = [
            f"{images[v].stem}:{LABEL}={x:.0f},{y:.0f}" for v in LABELLED for x, y in [marks[images[v].stem, LABEL]]
        ]
        done = CliRunner().invoke(app, [
            "calibrate", *map(str, images), "-m", str(work / "rough.csv"), "--unit", "mm", "--datum", "free",
            "--channel", "green", *(a for r in RADII for a in ("-r", r)), *(a for t in labels for a in ("--label", t)),
            "-o", str(work / "out"),
        ], catch_exceptions=False)  # fmt: skip
        print(done.output)
        if done.exit_code:
            raise SystemExit(done.exit_code)
        found = io.read_markers(work / "out" / "markers.csv")
        table = io.read_matches(work / "out" / "matches.csv")
    known = true[[names.tolist().index(n) for n in found.name]]
    off = align(found.xyz, known, scale=True).apply(found.xyz) - known
    keys = zip(table.image.tolist(), table.name.tolist(), table.xy, strict=True)
    apart = [float(np.linalg.norm(marks[i, n] - xy)) for i, n, xy in keys if (i, n) in marks]
    figures: dict[str, object] = {
        "pictures": len(set(table.image.tolist())), "marks": len(table), "published": len(apart),
        "wrong": sum(d > WRONG_PX for d in apart), "markers": len(found),
        **{f"rms_{a}_mm": float(np.sqrt((off[:, k] ** 2).mean())) for k, a in enumerate("xyz")},
    }  # fmt: skip
    print(figures)
    return figures


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
