"""Pictures of a calibration in the image: residuals, their tests, uncertainty; and the comparison of two."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.special import chdtr

from windmark.app.pictures import BLUE, DARK, RED, WIDTH_IN
from windmark.calibration import Calibration
from windmark.calibration.quality import Comparison, projection_sigma
from windmark.calibration.snooping import critical
from windmark.errors import g3
from windmark.scene.plots import round_length

Array = NDArray[np.float64]


def residual_vectors_picture(result: Calibration, camera: str) -> Figure:
    """Residuals of all marks of a camera where they were seen, magnified; gross errors in red, without vectors."""
    size = result.cameras[camera].size_px
    mine = np.array([v.camera for v in result.views])[result.observations.view] == camera
    xy, residual, used = result.observations.xy[mine], result.residuals[mine], result.used[mine]
    figure = Figure(figsize=(WIDTH_IN * 0.8, WIDTH_IN * 0.8 * size[1] / size[0] + 0.9), layout="constrained")
    axes = figure.add_subplot()
    rms = float(np.sqrt((residual[used] ** 2).sum(axis=1).mean()))
    factor = round_length(0.02 * size[0] / max(rms, 1e-9))
    ends = np.stack([xy[used], xy[used] + factor * residual[used]], axis=1)
    axes.add_collection(LineCollection(list(ends), colors=BLUE, linewidths=0.6))
    if (~used).any():
        axes.plot(*xy[~used].T, "x", color=RED, ms=5)
    axes.set(xlim=(-0.5, size[0] - 0.5), ylim=(size[1] - 0.5, -0.5), xlabel="x, px", ylabel="y, px", aspect="equal")
    title = f"{int(used.sum())} residuals, projected − observed, × {factor:g}; RMS length {rms:.3f} px"
    axes.set_title(title + (f"\nleft out, red crosses: {int((~used).sum())}" if (~used).any() else ""))
    return figure


def projection_sigma_picture(result: Calibration, camera: str) -> Figure:
    """How well the calibrated camera knows where a far point is seen."""
    found = result.cameras[camera]
    x, y, sigma = projection_sigma(found)
    width, height = found.size_px
    figure = Figure(figsize=(WIDTH_IN * 0.75, WIDTH_IN * 0.62 * height / width + 0.9), layout="constrained")
    axes = figure.add_subplot()
    levels = _steps(float(np.nanmin(sigma)), float(np.nanmax(sigma)))
    shown = axes.contourf(
        x, y, np.maximum(sigma, levels[0]), levels=levels, norm=LogNorm(levels[0], levels[-1]), cmap="viridis"
    )
    bar = figure.colorbar(shown, ax=axes, label="1 sigma per coordinate, px")
    bar.set_ticks(levels, labels=[f"{v:g}" for v in levels])
    mine = result.used & (np.array([v.camera for v in result.views])[result.observations.view] == camera)
    axes.plot(*result.observations.xy[mine].T, ".", color="white", ms=1.5, alpha=0.5)
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="x, px", ylabel="y, px", aspect="equal")
    axes.set_title("Uncertainty of a direction by the calibration; dots: marks")
    return figure


def _steps(low: float, high: float) -> list[float]:
    """Contour levels 1, 1.4, 2, 3, 5, 7, 10, ... from below ``low`` to above ``high``."""
    low = max(low, 1e-3 * high)
    first = int(np.floor(np.log10(low)))
    every = [m * 10.0**e for e in range(first, int(np.ceil(np.log10(high))) + 2) for m in (1, 1.4, 2, 3, 5, 7)]
    start = max(k for k, v in enumerate(every) if v <= low * (1 + 1e-12))
    end = min(k for k, v in enumerate(every) if v >= high and k > start)
    return every[start : end + 1]


def tests_picture(result: Calibration) -> Figure:
    """The squared standardised residuals beside what they should be: chi-square with two degrees of freedom."""
    figure = Figure(figsize=(WIDTH_IN * 0.55, 3.8), layout="constrained")
    axes = figure.add_subplot()
    limit = critical(len(result.test))
    test = np.minimum(result.test, 1.5 * limit)
    edges = np.linspace(0, 1.5 * limit, 43)
    axes.hist(test, edges.tolist(), color="#90caf9", edgecolor="white", lw=0.4, label=f"{len(test)} marks")
    expected = len(test) * np.diff(chdtr(2, edges))
    axes.step(edges, np.append(expected, expected[-1]), where="post", color=DARK, lw=1.2, label="chi-square (2)")
    axes.axvline(limit, color=RED, lw=1, ls="--", label=f"limit {limit:.1f}: none by chance (95 %)")
    axes.set_yscale("log")
    axes.set(ylim=(0.5, None), xlim=(0, 1.5 * limit), xlabel="test value (last bar: this and larger)", ylabel="marks")
    axes.legend(fontsize=8)
    axes.set_title(f"{int((~result.used).sum())} of {len(test)} marks left out")
    return figure


def comparison_picture(found: Comparison, unit: str, words: str) -> Figure:
    """Differences of two sets of coordinates, marker by marker, beside three sigma of each."""
    figure = Figure(figsize=(WIDTH_IN, 5.2), layout="constrained")
    order = np.arange(len(found.name))
    top = 1.15 * max(float(np.abs(found.difference).max()), float(3 * np.median(found.sigma)))
    for k, axes in enumerate(figure.subplots(3, 1, sharex=True)):
        axes.fill_between(order, -3 * found.sigma[:, k], 3 * found.sigma[:, k], color="#bbdefb", step="mid",
                          label="± 3 sigma of the difference")  # fmt: skip
        axes.plot(order, found.difference[:, k], "o", color=BLUE, ms=3)
        axes.axhline(0, color="0.5", lw=0.6)
        axes.set(ylabel=f"d{'xyz'[k]}, {unit}", ylim=(-top, top))
    figure.axes[0].legend(fontsize=8, loc="upper right")
    every = max(1, len(order) // 40)
    figure.axes[2].set_xticks(order[::every], [str(n) for n in found.name[::every]], rotation=90, fontsize=7)
    figure.axes[2].set(xlabel="marker", xlim=(-0.6, len(order) - 0.4))
    figure.suptitle(f"{words}: {g3(found.rms)} {unit} RMS, {found.ratio:.2f} times the combined sigma")
    return figure
