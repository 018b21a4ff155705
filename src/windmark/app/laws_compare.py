"""`windmark laws --compare`: which law, by the evidence of a project's own pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from windmark import io
from windmark.app import console
from windmark.app.alone import not_drawn, write_png
from windmark.app.pictures import BLUE
from windmark.app.progress import progress
from windmark.app.project_place import project_in
from windmark.app.verdict_words import judged
from windmark.errors import UsageError
from windmark.pipeline.deform import load, read_deform_project
from windmark.pipeline.deform.laws import DECISIVE, LawsCompared, candidates, compare_project
from windmark.pipeline.verdict.laws import compared_verdict

GREY, ORANGE = "#9e9e9e", "#ef6c00"
OUTPUT = Path("law-comparison")


def compare(project: Path, laws: Sequence[str], frames: int, folder: Path | None, seed: int, as_json: bool) -> None:
    """Compare, write table and picture, say who wins; exit code 1 where the data cannot tell."""
    loaded = load(read_deform_project(project_in(project, "deform")))
    volumes = candidates(loaded, laws)
    if len(volumes) < 2:
        raise UsageError(
            "nothing to compare: give --law VOLUME/LAW (windmark laws lists them), or [[volume.alternative]] in the "
            "project"
        )
    folder = folder or OUTPUT
    with progress() as show, console.result_folder(folder) as out:
        show("compile and find the first frame")
        result = compare_project(loaded, volumes, frames=frames, seed=seed, say=show)
        failed: list[str] = []
        write_png(out.place / "laws.png", lambda: laws_figure(result), failed)
        columns = [asdict(s) for s in result.scores]
        io.write_table(out.place / "laws.csv", {k: np.array([c[k] for c in columns]) for k in columns[0]})
    record: dict[str, Any] = {
        "winner": result.winner or None, "frames": list(result.frames),
        "frames_lost": list(result.lost), "misfit": float(np.sqrt(result.scale)),
        "laws": [asdict(s) for s in result.scores], "folder": folder, "not_drawn": failed,
    }  # fmt: skip
    verdict = compared_verdict(result)
    said = judged(record, verdict)
    if result.winner or not as_json:
        console.answer(record, as_json, [*_lines(result), *said, *not_drawn(failed), f"table and picture: {folder}"])
    if not result.winner:
        console.refuse(result.verdict, as_json, record, verdict.next_step)


def _lines(result: LawsCompared) -> list[str]:
    width = max(len(s.name) for s in result.scores)
    lines = [f"{'law':{width}}  unknowns   RMS px  chi2/dof  evidence, nats  held out px  chi2"]
    for s in result.scores:
        lines.append(
            f"{s.name:{width}}  {s.reason}" if s.reason else
            f"{s.name:{width}}  {s.parameters:8d} {s.rms_px:8.4f}  {s.chi2 / max(s.dof, 1):8.3f}  {s.evidence:14.1f}  "
            f"{s.held_out_px:11.4f}  {s.held_out_chi2:.3f}"
        )  # fmt: skip
    lines.append(f"{len(result.frames)} frames: {', '.join(result.frames)}; evidence by the Bayesian information "
                 "criterion, relative to the best")  # fmt: skip
    lines += [f"  not used: frame {text}" for text in result.lost]
    return lines


def laws_figure(result: LawsCompared) -> Figure:
    """Evidence and held-out error of every law, best first."""
    good = [s for s in result.scores if not s.reason]
    figure = Figure(figsize=(10.0, 1.5 + 0.42 * len(good)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    place = np.arange(len(good))[::-1]
    behind = np.array([-s.evidence for s in good])
    colours = [BLUE if s.name == result.winner else ORANGE if b < DECISIVE else GREY
               for s, b in zip(good, behind, strict=True)]  # fmt: skip
    left.barh(place, behind, color=colours, height=0.6)
    left.axvline(DECISIVE, color="k", ls="--", lw=1)
    left.set_xscale("symlog", linthresh=10)
    left.set(xlim=(0, max(15 * behind.max(), 60)))
    left.set_xlabel("evidence: nats behind the best\n(dashed: a hundred times less likely)")
    left.set_yticks(place, [f"{s.name}  ({s.parameters})" for s in good])
    for y, b in zip(place, behind, strict=True):
        words = f"{b:.1f}" if b > 0 else "the best" if result.winner else "the best, not clearly"
        left.annotate(words, (b, y), xytext=(4, 0), textcoords="offset points", va="center", fontsize=8)
    held, rms = (np.array([getattr(s, n) for s in good]) for n in ("held_out_px", "rms_px"))
    right.plot(rms, place, "o", color=GREY, label="residuals of the fit")
    right.plot(held, place, "D", color=BLUE, label="markers that the fit has not seen")
    right.set_xscale("log")
    right.set(xlabel="root mean square, px")
    right.grid(axis="x", which="both", alpha=0.3)
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower right", ncols=2, fontsize=8, frameon=False)
    figure.suptitle(f"Deformation laws over {len(result.frames)} frames (in brackets: unknowns per frame)", fontsize=11)
    return figure
