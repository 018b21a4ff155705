"""Curves of a deforming model: against the span, against time or angle of attack, and their spectrum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from windmark.app.pictures import WIDTH_IN
from windmark.pipeline.deform import FrameRecord

Array = NDArray[np.float64]

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
LOST = "#b3261e"
CURVES = 8
"""Frames that are drawn against the span."""
LEAST_SPECTRUM = 16
"""Frames without a gap that a spectrum needs."""


def span_picture(rows: Sequence[FrameRecord], eta: Array, unit: str) -> Figure:
    """Bending and twist at the stations with error bars of 2 sigma, for some frames from first to last."""
    figure = Figure(figsize=(WIDTH_IN, 4.4), layout="constrained")
    bending, twist = figure.subplots(1, 2)
    index = np.unique(np.linspace(0, len(rows) - 1, min(CURVES, len(rows))).astype(int))
    colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(index)))
    for colour, row in zip(colours, (rows[i] for i in index), strict=True):
        style = {"color": colour, "marker": ".", "ms": 4, "lw": 1.2, "capsize": 2, "label": row.key}
        bending.errorbar(eta, row.bending, 2 * row.bending_sigma, **style)
        twist.errorbar(eta, row.twist, 2 * row.twist_sigma, **style)
    bending.set(xlabel="station", ylabel=f"bending, {unit}")
    twist.set(xlabel="station", ylabel="twist, degrees (nose up)")
    for axes in (bending, twist):
        axes.grid(alpha=0.3)
    twist.legend(title="frame", fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def history_picture(rows: Sequence[FrameRecord], x: Array, label: str, unit: str) -> Figure:
    """Tip, rigid motion and quality against time, frame or another quantity; bands are 2 sigma, lost frames red."""
    spanned = any(len(r.twist) for r in rows)
    figure = Figure(figsize=(WIDTH_IN, 9.5 if spanned else 6.5), layout="constrained")
    panels = figure.subplots(5 if spanned else 3, 1, sharex=True)
    first = 0
    if spanned:
        for axes, name, what in zip(panels[:2], ("bending", "twist"), (f"bending, {unit}", "twist, °"), strict=True):
            value, size = (np.array([_last(getattr(r, n)) for r in rows]) for n in (name, f"{name}_sigma"))
            _band(axes, x, value, size, COLOURS[0], "")
            axes.set_ylabel(f"tip {what}")
        first = 2
    motion, sigma = np.array([r.motion for r in rows]), np.array([r.motion_sigma for r in rows])
    for k, axes in enumerate(panels[first : first + 2]):
        for n, name in enumerate("xyz"):
            _band(axes, x, motion[:, 3 * k + n], sigma[:, 3 * k + n], COLOURS[n], name)
        axes.set_ylabel((f"model's shift, {unit}", "model's turn, °")[k])
        axes.legend(ncols=3, fontsize=8, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.98))
    quality = panels[first + 2]
    quality.plot(x, [r.rms_px for r in rows], ".-", color=COLOURS[0], ms=4, lw=1.0)
    quality.set(ylabel="RMS residual, px", xlabel=label, ylim=(0, None))
    lost = [v for v, r in zip(x, rows, strict=True) if r.status == "lost"]
    for axes in panels:
        axes.grid(alpha=0.3)
        axes.margins(x=0.02)
        for v in lost:
            axes.axvline(v, color=LOST, lw=1.0, alpha=0.6)
    return figure


def parameter_picture(
    rows: Sequence[FrameRecord], names: Sequence[str], units: Sequence[str], x: Array, label: str
) -> Figure:
    """Every law parameter, at most twelve, against time or another quantity; bands are 2 sigma."""
    shown = min(len(names), 12)
    columns = min(shown, 3)
    lines = -(-shown // columns)
    figure = Figure(figsize=(WIDTH_IN, 2.3 * lines + 0.4), layout="constrained")
    panels = figure.subplots(lines, columns, sharex=True, squeeze=False).ravel()
    for k in range(shown):
        value, sigma = np.array([r.q[k] for r in rows]), np.array([r.q_sigma[k] for r in rows])
        _band(panels[k], x, value, sigma, COLOURS[k % len(COLOURS)], "")
        panels[k].set_title(names[k] + (f", {units[k]}" if units[k] else ""), fontsize=9)
        panels[k].grid(alpha=0.3)
    for axes in panels[shown:]:
        axes.set_visible(False)
    for axes in panels[max(shown - columns, 0) : shown]:
        axes.set_xlabel(label)
        axes.tick_params(labelbottom=True)
    return figure


def spectrum_picture(rows: Sequence[FrameRecord], rate_hz: float | None, unit: str) -> Figure | None:
    """Amplitude of the tip's bending and twist against frequency; None where frames are few or missing."""
    value = np.array([[_last(r.bending), _last(r.twist)] for r in rows])
    steps = np.diff([r.instant for r in rows])
    if len(rows) < LEAST_SPECTRUM or not np.isfinite(value).all() or not np.allclose(steps, steps[0]):
        return None
    rate = (rate_hz or 1.0) / float(steps[0])
    window = np.hanning(len(rows))
    frequency = np.fft.rfftfreq(len(rows), 1 / rate)
    amplitude = 2 * np.abs(np.fft.rfft((value - value.mean(axis=0)) * window[:, None], axis=0)) / window.sum()
    figure = Figure(figsize=(WIDTH_IN, 3.6), layout="constrained")
    for axes, column, what in zip(
        figure.subplots(1, 2), amplitude.T, (f"bending, {unit}", "twist, degrees"), strict=True
    ):
        axes.semilogy(frequency[1:], np.maximum(column[1:], 1e-12), color=COLOURS[0], lw=1.2)
        axes.set(xlabel="frequency, Hz" if rate_hz else "frequency, 1 / frame", ylabel=f"amplitude of the tip's {what}")
        axes.grid(alpha=0.3, which="both")
    return figure


def _band(axes: Axes, x: Array, value: Array, sigma: Array, colour: str, name: str) -> None:
    axes.plot(x, value, ".-", color=colour, ms=4, lw=1.2, label=name)
    axes.fill_between(x, value - 2 * sigma, value + 2 * sigma, color=colour, alpha=0.25, lw=0)


def _last(values: Array) -> float:
    return float(values[-1]) if len(values) else float("nan")
