"""Pictures of a reconstruction: two images with the epipolar lines of their markers, and the views of each marker."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from windmark.app.pictures import BLUE, MISSING, stretched
from windmark.tasks.reconstruct.pair import PairLines, Side

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Image = NDArray[np.generic]

COLOURS = ("#40c4ff", "#ffea00", "#00e676", "#ff9100", "#ea80fc", "#7c8cff")
"""Of markers that both pictures have, in turn; none is like that of the lines without a marker."""
PAIR_WIDTH_IN = 14.0
NAMED = 80
"""Markers are named up to so many."""


@dataclass(frozen=True)
class PairWords:
    """How the picture of a pair calls what both pictures have, one and many, and what one alone has.

    ``missed`` is what is said of a line without a spot; "" where no such lines are drawn.
    """

    one: str = "marker in both pictures"
    many: str = "markers"
    alone: str = "marker in this picture alone"
    missed: str = "its line in the other one, where it has no spot"


MARKERS = PairWords()


def pair_picture(lines: PairLines, image_a: Image, image_b: Image, *, words: PairWords = MARKERS) -> Figure:
    """Two images side by side; a marker and its line in the other image have one colour (AIAA 2005-5007, Fig. 12).

    The line of a marker that the other image has not is red and dashed there, and its spot is a red square.
    """
    shape = np.maximum(image_a.shape[:2], image_b.shape[:2])
    figure = Figure(figsize=(PAIR_WIDTH_IN, PAIR_WIDTH_IN / 2 * shape[0] / shape[1] + 1.1), layout="constrained")
    for axes, image, side in zip(figure.subplots(1, 2), (image_a, image_b), (lines.a, lines.b), strict=True):
        _draw_side(axes, image, side, lines.names, words)
    alone = len(lines.a.alone) + len(lines.b.alone)
    handles = [
        Line2D([], [], color=COLOURS[0], marker="o", mfc="none", ms=8, mew=1.4,
               label=f"{words.one} ({len(lines.names)}), and its epipolar line in the same colour"),
        Line2D([], [], ls="", marker="s", mfc="none", mec=MISSING, ms=8, mew=1.4, label=f"{words.alone} ({alone})"),
    ]  # fmt: skip
    if words.missed:
        handles.append(Line2D([], [], color=MISSING, ls="--", lw=1.4, label=words.missed))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    figure.suptitle(
        f"Epipolar lines: the spots of {len(lines.names)} {words.many} are {lines.rms_px:.3f} px RMS from their lines"
    )
    return figure


def _draw_side(axes: Axes, image: Image, side: Side, names: tuple[str, ...], words: PairWords) -> None:
    height, width = image.shape[:2]
    # Darker than it is, so that lines show on paper; wide percentiles, as markers are a small part of the pixels.
    axes.imshow(0.6 * stretched(image, 0.02, 99.98), cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    for curve in side.missed:
        axes.plot(*curve.T, color=MISSING, ls=(0, (5, 3)), lw=0.8)
    for k, (xy, curve) in enumerate(zip(side.spots, side.curves, strict=True)):
        colour = COLOURS[k % len(COLOURS)]
        axes.plot(*curve.T, color=colour, lw=0.7)
        axes.plot(*xy, "o", mfc="none", mec=colour, ms=7, mew=1.3)
    if len(side.alone):
        axes.plot(*side.alone.T, "s", mfc="none", mec=MISSING, ms=7, mew=1.3)
    if len(names) <= NAMED:
        for k, (xy, name) in enumerate(zip(side.spots, names, strict=True)):
            right = xy[0] > 0.94 * width
            axes.annotate(
                name, xy, xytext=(-7 if right else 7, 5), textcoords="offset points", fontsize=7,
                ha="right" if right else "left", color=COLOURS[k % len(COLOURS)],
                path_effects=[withStroke(linewidth=1.0, foreground="black")],
            )  # fmt: skip
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="x, px", ylabel="y, px")
    markers, missed = len(side.spots) + len(side.alone), len(side.missed)
    said = f"{markers} markers, lines without a spot: {missed}" if words.missed else f"{markers} spots"
    axes.set_title(f"{side.name}: {said}", fontsize=10)


def views_picture(count: NDArray[np.int64]) -> Figure:
    """How many markers are seen in how many pictures."""
    figure = Figure(figsize=(6.2, 3.2), layout="constrained")
    axes = figure.add_subplot()
    views, markers = np.unique(count, return_counts=True)
    bars = axes.bar(views, markers, width=0.8, color=BLUE)
    axes.bar_label(bars, fontsize=8)
    axes.set(xlabel="pictures that a marker is seen in", ylabel="markers", ylim=(0, 1.15 * markers.max()))
    axes.set_title(f"{len(count)} markers, median {np.median(count):g} pictures each")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure
