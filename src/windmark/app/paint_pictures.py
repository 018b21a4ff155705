"""Pictures of a paint's calibration: measurements with the law, what is left of them, orders that were tried."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from windmark.app.pictures import WIDTH_IN
from windmark.errors import g3
from windmark.paint import PaintFit, TemperaturePaint
from windmark.pipeline.psp.cell import CellTable

Array = NDArray[np.float64]

CURVES = 10
"""Temperatures whose curves are drawn at most."""
_LINE = np.linspace(0.0, 1.0, 101)


def pressure_picture(cell: CellTable, fit: PaintFit) -> Figure:
    """Ratio over pressure with curves of the law, residuals in per cent, and every order's cross-validation."""
    assert cell.pressure is not None
    figure = Figure(figsize=(WIDTH_IN, 4.0), layout="constrained")
    shown, left, tried = figure.subplots(1, 3, width_ratios=(5, 5, 3))
    law, kPa = fit.law, cell.pressure / 1e3
    scale, colours = Normalize(cell.temperature.min(), cell.temperature.max()), colormaps["viridis"]
    levels = np.unique(np.round(cell.temperature, 1))
    p = law.p_range[0] + (law.p_range[1] - law.p_range[0]) * _LINE
    for t in levels[np.unique(np.linspace(0, len(levels) - 1, min(CURVES, len(levels))).astype(int))]:
        shown.plot(p / 1e3, law.ratio(p, t), color=colours(scale(t)), lw=1.0)
    for axes, y in ((shown, cell.ratio), (left, 100 * fit.residuals / cell.ratio)):
        dots = axes.scatter(kPa, y, c=cell.temperature, cmap=colours, norm=scale, s=9)
    if cell.ratio_sigma is not None:
        size = 200 * cell.ratio_sigma / cell.ratio
        left.errorbar(kPa, 100 * fit.residuals / cell.ratio, size, ls="", color="0.7", lw=0.7, zorder=0)
    left.axhline(0, color="black", lw=0.6)
    shown.set(xlabel="pressure, kPa", ylabel="I_ref / I", title=f"order up to {law.order[0]} in p, {law.order[1]} in T")
    left.set(xlabel="pressure, kPa", ylabel="measured − law, %", title=f"cross-validated RMS {g3(fit.cv_rms)}")
    figure.colorbar(dots, ax=left, label="temperature, K")
    _orders(tried, fit.orders, fit.order)
    return figure


def _orders(axes: Any, orders: Mapping[tuple[int, int], float | str], chosen: tuple[int, int]) -> None:
    """Cross-validated RMS over the order in pressure, a line for each order in temperature; the chosen one ringed."""
    for j in sorted({j for _, j in orders}):
        own = [(k, of) for (k, i), of in sorted(orders.items()) if i == j and not isinstance(of, str)]
        if own:
            axes.plot(*np.array(own).T, marker=".", lw=1.0, label=f"T order {j}")
    axes.plot(chosen[0], orders[chosen], "o", ms=11, mfc="none", color="black")
    axes.set_yscale("log")
    axes.set_xticks(sorted({k for k, _ in orders}))
    axes.set(xlabel="order in pressure", title="cross-validated RMS")
    axes.legend(fontsize=8, frameon=False)
    axes.grid(alpha=0.3, which="both")


def temperature_picture(cell: CellTable, law: TemperaturePaint) -> Figure:
    """Ln ratio over temperature with the law and its band of 2 sigma, and what is left in per cent."""
    figure = Figure(figsize=(WIDTH_IN, 4.0), layout="constrained")
    shown, left = figure.subplots(1, 2)
    t = law.t_range[0] + (law.t_range[1] - law.t_range[0]) * _LINE
    k = np.arange(len(law.coefficients))
    powers = (t - law.t_ref)[:, None] ** k
    sigma = np.zeros(len(t)) if law.cov is None else np.sqrt(np.einsum("nk,kl,nl->n", powers, law.cov, powers))
    shown.plot(t, law.log_ratio(t), lw=1.0)
    shown.fill_between(t, law.log_ratio(t) - 2 * sigma, law.log_ratio(t) + 2 * sigma, alpha=0.2, lw=0)
    shown.plot(cell.temperature, np.log(cell.ratio), ".", color="black", ms=4)
    off = 100 * (np.log(cell.ratio) - law.log_ratio(cell.temperature))
    size = None if cell.ratio_sigma is None else 200 * cell.ratio_sigma / cell.ratio
    left.errorbar(cell.temperature, off, size, ls="", marker=".", color="black", lw=0.7)
    left.axhline(0, color="black", lw=0.6)
    shown.set(xlabel="temperature, K", ylabel="ln(I_ref / I)", title=f"order {len(k) - 1}")
    left.set(xlabel="temperature, K", ylabel="measured − law, %", title=f"cross-validated RMS {g3(law.cv_rms)}")
    return figure
