"""`windmark calibrate` on the DBAT sheet, from the pictures, with all of them and with few, with and without control.

21 hand-held pictures of a regular sheet of 10 x 10 discs; of 8, 5, 4 and 3 every so many-th. Rough coordinates:
PhotoModeler's with 4 mm of noise, which leaves nothing that tells the sheet from itself turned by 90 degrees; so the
disc 1001 is labelled in three pictures, to a pixel. "free": a free network, fitted to PhotoModeler's coordinates
(shift, turn, scale); "control": the four coded discs at the places that were published for them, no fit. The camera
focused anew for every picture; "focus": every picture has a focal length of its own, within 0.3 %; "principal": and
a principal point of its own, within 10 px.

Printed: pictures and marks that were matched, marks that were matched wrongly (farther than 4 px from the published
mark of that name), RMS of the coordinates less PhotoModeler's, the mean sigma that is stated for them, and z, the RMS
of the differences by their sigmas (PhotoModeler's own errors are in it, and are as large as the differences of all 21
pictures: z tells something where the stated sigmas are larger); the focal length less the published one by its sigma.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from typer.testing import CliRunner

from _real_truth import DATA
from calibration_real import CONTROL, Sheet, published
from windmark import io
from windmark.app.cli import app
from windmark.geometry.similarity import align
from windmark.scene import MarkerSet

ROUGH_MM, LABEL, WRONG_PX = 4.0, "1001", 4.0
RADII = ("10", "13", "17.5", "23")
COUNTS = (21, 8, 5, 4, 3)
PUBLISHED_FOCAL = 7.45700 * 2272 / 7.25301
"""Of the published bundle: mm, and its sensor's width."""
KEYS = "pictures  marks  wrong  rms x      y      z mm   sigma x      y      z mm     z   focal px    by its sigma"


def one(sheet: Sheet, images: list[Path], views: list[int], kind: str, seed: int) -> dict[str, object]:
    """The command on some pictures; what it found, or its refusal."""
    names, true = sheet.markers.name, sheet.markers.xyz
    obs = sheet.observations
    marks = {(images[v].stem, str(names[p])): xy for v, p, xy in zip(obs.view, obs.point, obs.xy, strict=True)}
    rough = true + np.random.default_rng(seed).normal(0, ROUGH_MM, true.shape)
    coded, control = np.isin(names, CONTROL), "control" in kind
    if control:
        rough[coded] = true[coded]
    seen = [v for v in views if (images[v].stem, LABEL) in marks]
    labels = [
        f"{images[v].stem}:{LABEL}={x:.0f},{y:.0f}"
        for v in [seen[k] for k in np.linspace(0, len(seen) - 1, 3).round().astype(int)]
        for x, y in [marks[images[v].stem, LABEL]]
    ]
    with tempfile.TemporaryDirectory() as place:
        work = Path(place)
        normal = np.tile([0.0, 0.0, 1.0], (len(names), 1))
        io.write_markers(work / "rough.csv", MarkerSet.make(names, rough, normal=normal))
        done = CliRunner().invoke(app, [
            "calibrate", *(str(images[v]) for v in views), "-m", str(work / "rough.csv"), "--unit", "mm",
            "--datum", f"fixed:{','.join(CONTROL)}" if control else "free", "--channel", "green",
            *(a for r in RADII for a in ("-r", r)), *(a for t in labels for a in ("--label", t)),
            *(("--free-focal", "all", "--prior-sigma", "focus=0.003") if "focus" in kind else ()),
            *(("--free-principal", "all", "--prior-sigma", "principal=10") if "principal" in kind else ()),
            "-o", str(work / "out"),
        ], catch_exceptions=False)  # fmt: skip
        if done.exit_code:
            lines = done.output.strip().splitlines()
            return {"refused": next((line for line in lines if line.startswith("■")), lines[0])}
        found = io.read_markers(work / "out" / "markers.csv")
        table = io.read_matches(work / "out" / "matches.csv")
        focal = json.loads((work / "out" / "summary.json").read_text())["cameras"]["camera"]["focal_px"]
        said = [line for line in done.output.splitlines() if line.startswith(("●", "▲", "■"))]
    known = true[[names.tolist().index(n) for n in found.name]]
    off = (found.xyz if control else align(found.xyz, known, scale=True).apply(found.xyz)) - known
    free = (found.sigma > 0).all(axis=1)
    keys = zip(table.image.tolist(), table.name.tolist(), table.xy, strict=True)
    apart = [float(np.linalg.norm(marks[i, n] - xy)) for i, n, xy in keys if (i, n) in marks]
    return {
        "pictures": len(set(table.image.tolist())), "marks": len(table), "wrong": sum(d > WRONG_PX for d in apart),
        "rms_mm": _rms(off[free]).tolist(), "sigma_mm": _rms(found.sigma[free]).tolist(),
        "z": float(np.sqrt((off[free] ** 2 / found.sigma[free] ** 2).mean())), "focal_px": focal["value"],
        "focal_by_sigma": (focal["value"] - PUBLISHED_FOCAL) / focal["sigma"], "said": said,
    }  # fmt: skip


def _rms(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.sqrt((values**2).mean(axis=0)))


def main(seed: int = 20) -> dict[str, dict[str, object]]:
    """Measure, print one table, return its rows."""
    folder = DATA / "dbat-camcal"
    if not folder.is_dir():
        print("calibration_pictures: the real pictures are not here")
        return {}
    sheet, images = published(folder), sorted((folder / "images").iterdir())
    rows: dict[str, dict[str, object]] = {}
    print(f"{'':27s} {KEYS}")
    for kind in ("free", "free, focus", "free, focus, principal", "control, focus", "control, focus, principal"):
        for count in COUNTS:
            views = np.linspace(0, len(images) - 1, count).round().astype(int).tolist()
            name = f"{count} {kind}"
            row = rows[name] = one(sheet, images, views, kind, seed)
            print(f"{name:27s} {_words(row)}", flush=True)
    return rows


def _words(row: dict[str, object]) -> str:
    if "refused" in row:
        return str(row["refused"])
    rms, sigma = (" ".join(f"{v:6.3f}" for v in row[k]) for k in ("rms_mm", "sigma_mm"))  # type: ignore[attr-defined]
    return (f"{row['pictures']:8d} {row['marks']:6d} {row['wrong']:6d} {rms}     {sigma}  {row['z']:6.2f} "
            f"{row['focal_px']:10.2f} {row['focal_by_sigma']:12.1f}   {' '.join(row['said'])}")  # type: ignore[arg-type]  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
