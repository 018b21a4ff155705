"""Pictures of a 2D alignment: residuals on the reference, and the ratio before and after."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from windmark.app.photo import FIRST, Overlay, preview
from windmark.app.pictures import MISSING, SPARE, WIDTH_IN
from windmark.scene.plots import round_length
from windmark.tasks.align2d import ImageAlignment

Array = NDArray[np.float64]
ARROW, MOTION, HULL = "#ffd600", "#40c4ff", "#00c853"


def residual_photo(reference: NDArray[np.generic], answer: ImageAlignment, name: str) -> str:
    """The reference with held-out residuals (mapped − seen) and the motion of the markers, magnified, their hull, and
    rejected pairs.
    """
    over = Overlay((reference.shape[1], reference.shape[0]))
    place, held, shift = answer.reference_xy, answer.held_out, answer.shift_px
    median = np.median(shift, axis=0)
    factor, times = _factor(held, reference.shape[1]), _factor(shift - median, reference.shape[1], 0.04)
    notes = [f"x {x:.2f}, y {y:.2f} px; held-out residual {dx:+z.3f}, {dy:+z.3f} px; motion {u:+z.2f}, {v:+z.2f} px"
             .replace("-", "−") for (x, y), (dx, dy), (u, v) in zip(*(a.tolist() for a in (place, held, shift)),
                                                                    strict=True)]  # fmt: skip
    over.rings(place, np.full(len(place), 6.0), np.ones(len(place), bool), notes, (f"marker ({len(place)})", ""))
    over.lines("motion", _vectors(place, shift - median, times),
               f"motion less its median ({median[0]:+z.1f}, {median[1]:+z.1f} px) × {times:g}", MOTION)  # fmt: skip
    over.lines("residuals", _vectors(place, held, factor),
               f"held-out residual × {factor:g} (RMS {answer.held_out_px:.3f} px)", ARROW)  # fmt: skip
    if len(answer.hull) > 2:
        over.lines("hull", [np.concatenate([answer.hull, answer.hull[:1]])], "hull: outside it is extrapolated", HULL)
    for layer, pairs, words, colour in (("rejected", answer.rejected, "rejected", MISSING),
                                        ("still", answer.still, "stand still: left out", SPARE)):  # fmt: skip
        if len(pairs):
            crosses = _crosses(answer.reference_spots.xy[pairs[:, 0]])
            over.lines(layer, crosses, f"{len(pairs)} {words}", colour, key="cross")
    return over.html(preview(reference, FIRST.photo)[0],
                     f"{name} on the reference: {len(place)} markers, {answer.kind}.")  # fmt: skip


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


def _vectors(place: Array, vector: Array, factor: float) -> list[Array]:
    return list(np.stack([place, place + factor * vector], axis=1))


def _crosses(place: Array, half: float = 7.0) -> list[Array]:
    """Two strokes each."""
    strokes = np.array([[[-half, -half], [half, half]], [[-half, half], [half, -half]]])
    return list((place[:, None, None] + strokes).reshape(-1, 2, 2))


def _factor(vectors: Array, width: int, share: float = 0.03) -> float:
    """A round factor that makes the RMS length this share of the picture's width."""
    rms = float(np.sqrt((vectors**2).sum(axis=1).mean()))
    return round_length(share * width / rms) if rms > 1e-6 else 1.0
