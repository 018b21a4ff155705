"""The picture of a followed sequence: point of view against the frame, and how many markers were matched."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from windmark.app.pictures import WIDTH_IN
from windmark.pipeline.track_results import POV, PoseRow

Array = NDArray[np.float64]

COLOURS = ("#0072b2", "#d55e00", "#009e73")
LOST, AGAIN = "#b3261e", "#e69f00"


def motion_picture(rows: list[PoseRow], unit: str) -> Figure:
    """Angles, distances and matched markers against the frame; lost frames red, those found again amber.

    Angles and distances are less those of the first pose, which the titles say; bands are 1 sigma.
    """
    figure = Figure(figsize=(WIDTH_IN, 8.0), layout="constrained")
    angles, places, counts = figure.subplots(3, 1, sharex=True, height_ratios=(2, 2, 1.2))
    instant = np.array([row.instant for row in rows])
    pov = np.array([row.pov for row in rows]).reshape(-1, 6)
    sigma = np.array([row.sigma for row in rows]).reshape(-1, 6)
    good = np.isfinite(pov).all(axis=1)
    first = pov[np.argmax(good)] if good.any() else np.zeros(6)
    change = pov - first
    change[:, :3] = (change[:, :3] + 180) % 360 - 180
    for axes, part, what in ((angles, slice(0, 3), "angle, degrees"), (places, slice(3, 6), f"distance, {unit}")):
        for k, colour in zip(range(6)[part], COLOURS, strict=True):
            name = POV[k].removesuffix("_deg")
            axes.plot(instant, change[:, k], color=colour, marker=".", ms=4, lw=1.2, label=name)
            axes.fill_between(
                instant, change[:, k] - sigma[:, k], change[:, k] + sigma[:, k], color=colour, alpha=0.25, lw=0
            )
        start = ", ".join(f"{POV[k].removesuffix('_deg')} {first[k]:z.3f}" for k in range(6)[part])
        axes.set(ylabel=f"change of {what}")
        if good.any():
            axes.set_title(f"first pose: {start} {what.rpartition(' ')[2]}", fontsize=9, loc="left")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize=8, frameon=False)
    counts.step(instant, [row.expected for row in rows], where="mid", color="0.6", lw=1.0, label="expected")
    counts.step(instant, [row.matched for row in rows], where="mid", color=COLOURS[0], lw=1.4, label="matched")
    counts.set(ylabel="markers", xlabel="frame", ylim=(0, None))
    _mark(figure, rows, instant)
    counts.legend(
        *_once(counts.get_legend_handles_labels()),
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=4,
        fontsize=8,
        frameon=False,
    )
    return figure


def _mark(figure: Figure, rows: list[PoseRow], instant: Array) -> None:
    """Stripes through all panels where the pose was lost, lines where it was found again."""
    for axes in figure.axes:
        axes.grid(alpha=0.3)
        axes.margins(x=0.02)
        for row, t in zip(rows, instant, strict=True):
            if row.status == "lost":
                axes.axvspan(t - 0.5, t + 0.5, color=LOST, alpha=0.18, lw=0, label="lost")
            elif row.status == "reacquired":
                axes.axvline(t, color=AGAIN, lw=1.2, ls="--", label="found again")


def _once(legend: tuple[list, list[str]]) -> tuple[list, list[str]]:
    """Every label of a legend once."""
    by_label = dict(zip(legend[1], legend[0], strict=True))
    return list(by_label.values()), list(by_label)
