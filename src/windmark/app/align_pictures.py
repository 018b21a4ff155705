"""Pictures of a 2D alignment: residuals on the reference, and the ratio before and after."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from windmark.app.pictures import MISSING, SPARE, WIDTH_IN, image_axes
from windmark.scene.plots import round_length
from windmark.tasks.align2d import ImageAlignment

Array = NDArray[np.float64]
ARROW, MOTION, HULL = "#ffd600", "#40c4ff", "#00c853"


def residual_map(reference: NDArray[np.generic], answer: ImageAlignment, name: str) -> Figure:
    """Held-out residuals (mapped − seen) magnified, motion of the markers, their hull, and rejected pairs."""
    figure, axes = image_axes(reference)
    axes.images[0].set_alpha(0.75)
    axes.set_facecolor("black")
    place, held, shift = answer.reference_xy, answer.held_out, answer.shift_px
    factor = _factor(held, reference.shape[1])
    times = _factor(shift - np.median(shift, axis=0), reference.shape[1], 0.04)
    if len(answer.hull) > 2:
        axes.add_patch(Polygon(answer.hull, closed=True, fill=False, edgecolor=HULL, lw=1.2, ls="--"))
    axes.plot(*place.T, "o", ms=3.5, mfc="none", mec="white", mew=0.8)
    _arrows(axes, place, shift - np.median(shift, axis=0), times, MOTION)
    _arrows(axes, place, held, factor, ARROW)
    wrong = answer.reference_spots.xy[answer.rejected[:, 0]]
    axes.plot(*wrong.T, "x", ms=9, mew=2, color=MISSING)
    walls = answer.reference_spots.xy[answer.still[:, 0]]
    axes.plot(*walls.T, "s", ms=8, mew=1.2, mfc="none", color=SPARE)
    entries = [
        (ARROW, "-", f"held-out residual, {factor:g} times (RMS {answer.held_out_px:.3f} px)"),
        (MOTION, "-", f"motion less its median ({np.median(shift[:, 0]):+.1f}, {np.median(shift[:, 1]):+.1f} px), "
                      f"{times:g} times"),
        (HULL, "--", "hull of the markers: outside it is extrapolated"),
    ]  # fmt: skip
    handles = [axes.plot([], [], color=c, ls=s, lw=1.6, label=t)[0] for c, s, t in entries]
    if len(wrong):
        handles += axes.plot([], [], "x", ms=8, mew=2, color=MISSING, label=f"{len(wrong)} rejected")
    if len(walls):
        handles += axes.plot(
            [], [], "s", ms=7, mew=1.2, mfc="none", color=SPARE, label=f"{len(walls)} stand still: left out"
        )
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    axes.set_title(f"{name} on the reference: {len(place)} markers, {answer.kind}")
    return figure


def ratio_picture(before: NDArray[np.float32], after: NDArray[np.float32], answer: ImageAlignment, name: str) -> Figure:
    """Ratio reference by image, as taken and aligned, on one scale."""
    height, width = before.shape
    figure = Figure(figsize=(WIDTH_IN, 0.45 * WIDTH_IN * height / width + 0.9), layout="constrained")
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    inside = ~answer.extrapolated()
    known = after[inside & np.isfinite(after)]
    half = float(np.percentile(np.abs(known - 1), 99)) if known.size else 0.1
    half = min(max(half * 1.5, 0.01), 1.0)
    for axes, ratio, title in ((left, before, "as taken"), (right, after, f"aligned ({answer.kind})")):
        shown = axes.imshow(ratio, cmap="RdBu_r", vmin=1 - half, vmax=1 + half, interpolation="nearest")
        axes.set_facecolor("0.8")
        if len(answer.hull) > 2:
            axes.add_patch(Polygon(answer.hull, closed=True, fill=False, edgecolor="black", lw=0.9, ls="--"))
        axes.set(title=f"{name} {title}", xlabel="x, px")
    left.set_ylabel("y, px")
    figure.colorbar(shown, ax=[left, right], label="reference by image, by its median", extend="both")
    return figure


def _arrows(axes: Axes, place: Array, vector: Array, factor: float, colour: str) -> None:
    axes.quiver(*place.T, *(factor * vector).T, color=colour, angles="xy", scale_units="xy", scale=1, width=0.002,
                headwidth=4, headlength=5)  # fmt: skip


def _factor(vectors: Array, width: int, share: float = 0.03) -> float:
    """A round factor that makes the RMS length this share of the picture's width."""
    rms = float(np.sqrt((vectors**2).sum(axis=1).mean()))
    return round_length(share * width / rms) if rms > 1e-6 else 1.0
