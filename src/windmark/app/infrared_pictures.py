"""Pictures of an infrared run: histories at points, and medians over the frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from numpy.typing import NDArray

from windmark.app.pictures import WIDTH_IN, surface_picture
from windmark.pipeline.infrared import FrameRecord
from windmark.pipeline.surface import surface_view
from windmark.scene import Mesh
from windmark.tasks.infrared import CURVED, LATE, LATERAL

Array = NDArray[np.float64]

CURVES = 8
"""Points of a list whose histories are drawn."""


def histories_picture(names: Sequence[str], time_s: Array, values: Array) -> Figure:
    """Temperature and heat flux over time at points, bands of 2 sigma.

    ``values``: (F, N, 4) temperature, its sigma, heat flux, its sigma.
    """
    with_flux = bool(np.isfinite(values[..., 2]).any())
    figure = Figure(figsize=(WIDTH_IN, 6.4 if with_flux else 3.6), layout="constrained")
    panels = figure.subplots(2 if with_flux else 1, 1, sharex=True, squeeze=False)[:, 0]
    colours = colormaps["viridis"](np.linspace(0, 0.92, min(len(names), CURVES)))
    for k, colour in enumerate(colours):
        for axes, column in zip(panels, (0, 2), strict=False):
            y, s = values[:, k, column], values[:, k, column + 1]
            axes.plot(time_s, y, color=colour, lw=1.2, label=names[k] if column == 0 else None)
            axes.fill_between(time_s, y - 2 * s, y + 2 * s, color=colour, alpha=0.18, lw=0)
    panels[0].set_ylabel("temperature, K")
    if with_flux:
        panels[1].set_ylabel("heat flux, W/m²")
    panels[-1].set_xlabel("time, s")
    for axes in panels:
        axes.grid(alpha=0.3)
    panels[0].legend(fontsize=8, frameon=False, ncols=4)
    return figure


FLAG_KINDS = ("nothing flagged", "the back is felt", "heat flows along the surface", "sharply bent")


def flags_map(
    mesh: Mesh, flags: NDArray[np.integer], shown: Array, title: str, *, direction: Array, up: Array
) -> Figure:
    """Where a heat flux (V,) is doubtful, by `FLAG_KINDS`."""
    value = np.where(np.isfinite(shown), 0.0, np.nan)
    for number, bit in enumerate((LATE, LATERAL, CURVED), start=1):
        value[(flags & bit > 0) & np.isfinite(shown)] = number
    view = surface_view(mesh, value, direction=direction, up=up, focus=mesh.vertices[np.isfinite(shown)],
                        size_px=(1100, 650))  # fmt: skip
    return surface_picture(view.value, view.shade, title, kinds=FLAG_KINDS)


def medians_picture(records: Sequence[FrameRecord], start_s: float | None) -> Figure:
    """Medians over the nodes, and the part of the grid that was seen, over time."""
    figure = Figure(figsize=(WIDTH_IN, 3.2), layout="constrained")
    panels = figure.subplots(1, 3)
    t = np.array([r.time_s if np.isfinite(r.time_s) else r.index for r in records])
    columns = (
        ("temperature, K", [r.median_T for r in records]), ("heat flux, W/m²", [r.median_q for r in records]),
        ("part of the nodes seen", [r.seen for r in records]),
    )  # fmt: skip
    for axes, (label, y) in zip(panels, columns, strict=True):
        axes.plot(t, y, ".-", lw=1, ms=4)
        axes.set(xlabel="time, s", title=label)
        axes.grid(alpha=0.3)
        if start_s is not None:
            axes.axvline(start_s, color="black", lw=0.7, ls=":")
    return figure
