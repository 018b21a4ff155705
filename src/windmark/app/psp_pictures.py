"""Pictures of a paint test: Cp on the surface, along sections with taps, loads over incidence, taps' residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from numpy.typing import NDArray

from windmark.app.pictures import WIDTH_IN, surface_picture
from windmark.pipeline.psp import PointRecord
from windmark.pipeline.surface import surface_view
from windmark.scene import Mesh

Array = NDArray[np.float64]

CURVES = 6
"""Points whose sections are drawn."""


def cp_map(mesh: Mesh, cp: Array, title: str, label: str, *, direction: Array, up: Array) -> Figure:
    """A field on the surface, as a camera of the test looks at it."""
    shown = surface_view(
        mesh, cp, direction=direction, up=up, focus=mesh.vertices[np.isfinite(cp)], size_px=(1100, 650)
    )
    return surface_picture(shown.value, shown.shade, title, label)


def section_picture(records: Sequence[PointRecord], name: str) -> Figure:
    """Cp along one section for some points: curves with bands of 2 sigma, taps as rings; negative upwards."""
    figure = Figure(figsize=(WIDTH_IN, 4.6), layout="constrained")
    axes = figure.add_subplot()
    index = np.unique(np.linspace(0, len(records) - 1, min(CURVES, len(records))).astype(int))
    colours = colormaps["viridis"](np.linspace(0, 0.9, len(index)))
    for colour, r in zip(colours, [records[i] for i in index], strict=True):
        one = next((s for s in r.sections if s.name == name), None)
        if one is None:
            continue
        label: str | None = f"{r.name}, {r.alpha_deg:g}°"
        for line in np.unique(one.line):
            for side in (True, False):
                own = np.flatnonzero((one.line == line) & (one.upper == side) & np.isfinite(one.cp))
                if not len(own):
                    continue
                own = own[np.argsort(one.x_c[own], kind="stable")]
                x, cp, s = one.x_c[own], one.cp[own], one.sigma[own]
                axes.plot(x, cp, color=colour, lw=1.1, label=label)
                axes.fill_between(x, cp - 2 * s, cp + 2 * s, color=colour, alpha=0.15, lw=0)
                label = None
        if len(one.tap_x_c):
            axes.errorbar(one.tap_x_c, one.tap_cp, 2 * one.tap_sigma, ls="", marker="o", ms=4, mfc="none", color=colour)
    axes.invert_yaxis()
    axes.set(xlabel="x / c", ylabel="Cp", title=f"Section {name}")
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, frameon=False)
    return figure


def loads_picture(records: Sequence[PointRecord]) -> Figure:
    """Lift, drag and pitching moment over incidence, by volume, with error bars of 2 sigma."""
    figure = Figure(figsize=(WIDTH_IN, 3.8), layout="constrained")
    panels = figure.subplots(1, 3)
    volumes = list(dict.fromkeys(v for r in records for v in r.loads))
    for axes, name in zip(panels, ("CL", "CD", "Cm"), strict=True):
        for volume in volumes:
            own = [(r.alpha_deg, *r.loads[volume][name]) for r in records if volume in r.loads]
            x, y, s = np.array(sorted(own)).T
            axes.errorbar(x, y, 2 * s, marker=".", lw=1.1, capsize=2, label=volume)
        axes.set(xlabel="incidence, °", title=name)
        axes.grid(alpha=0.3)
    panels[0].legend(fontsize=8, frameon=False)
    return figure


def taps_picture(records: Sequence[PointRecord]) -> Figure:
    """Paint less tap in Cp, tap by tap, with error bars of 2 sigma; taps that do not count as crosses."""
    figure = Figure(figsize=(WIDTH_IN, 4.2), layout="constrained")
    axes = figure.add_subplot()
    names = list(dict.fromkeys(
        n for r in records if r.taps is not None for n, p in zip(r.taps.names, r.taps.paint, strict=True) if p == p
    ))  # fmt: skip
    place = {n: k for k, n in enumerate(names)}
    for k, (colour, r) in enumerate(zip(colormaps["viridis"](np.linspace(0, 0.9, len(records))), records, strict=True)):
        if r.taps is None:
            continue
        t = r.taps
        on = np.flatnonzero(np.isfinite(t.paint))
        x = np.array([place[t.names[j]] for j in on]) + 0.5 * (k / max(len(records), 1) - 0.5)
        good = np.array([not t.words[j] for j in on], bool)
        off, size = (t.paint - t.cp)[on], 2 * np.hypot(t.paint_sigma, t.cp_sigma)[on]
        axes.errorbar(x[good], off[good], size[good], ls="", marker=".", color=colour, lw=0.8,
                      label=f"{r.name}, {r.alpha_deg:g}°")  # fmt: skip
        axes.plot(x[~good], off[~good], "x", color=colour)
    axes.axhline(0, color="black", lw=0.6)
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    axes.set(ylabel="Cp of paint − tap")
    axes.grid(alpha=0.3)
    if len(records) <= 12:
        axes.legend(fontsize=8, frameon=False, ncols=3)
    return figure
