"""Pictures of detection: spots with the rejected candidates, and the merit map."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from windmark.app.pictures import MATCHED, WIDTH_IN, draw_legend, draw_spots, image_axes

if TYPE_CHECKING:
    from windmark.detection import Rejected
    from windmark.scene import Detections

COLOURS = (
    "#ff1744", "#ff9100", "#ffea00", "#00b0ff", "#d500f9", "#ff80ab", "#8d6e63", "#b0bec5", "#1de9b6", "#ffab91",
    "#9e9d24", "#5c6bc0", "#f4511e", "#006064",
)  # fmt: skip
"""Of the reasons, in the order of their codes; green is for what was taken."""


def explained_picture(image: NDArray[np.generic], spots: Detections, rejected: Rejected, title: str) -> Figure:
    """The image with every spot, and every rejected candidate in the colour of its reason (see the legend)."""
    from windmark.detection import REASONS

    figure, axes = image_axes(image)
    entries = [(MATCHED, "o", f"marker ({len(spots)})")]
    for (code, words), colour in zip(REASONS.items(), COLOURS, strict=True):
        some = rejected.take(rejected.reason == code)
        if not len(some):
            continue
        size = 2 * np.clip(np.nan_to_num(some.radius_px, nan=3.0) * 1.8, 5.0, 0.05 * min(image.shape))
        axes.add_collection(
            EllipseCollection(
                size, size, np.zeros(len(some)), units="xy", offsets=some.xy, offset_transform=axes.transData,
                facecolors="none", edgecolors=colour, linewidths=1.6, linestyles=":",
            )
        )  # fmt: skip
        entries.append((colour, "o", f"{words.split(':')[0]} ({len(some)})"))
    draw_spots(axes, spots)
    axes.set_title(f"{title}: {len(spots)} spots, {len(rejected)} candidates rejected")
    draw_legend(axes, entries)
    return figure


def merit_picture(merit: NDArray[np.float32], limit: float, title: str) -> Figure:
    """The merit of every pixel on a log scale: dark is a good hole, light none; the limit is marked on the scale.

    Parameters
    ----------
    merit : (H, W), inf where there is no hole, NaN where it is not known (grey)
    limit : the largest merit of a marker
    """
    from matplotlib import colormaps
    from matplotlib.colors import LogNorm

    height, width = merit.shape
    figure = Figure(figsize=(WIDTH_IN, np.clip(WIDTH_IN * height / width + 0.9, 3.0, 14.0)), layout="constrained")
    axes = figure.add_subplot()
    colours = colormaps["magma"].with_extremes(bad="0.6")
    scale = LogNorm(0.1, 10.0, clip=True)
    shown = axes.imshow(np.minimum(merit, 1e3), cmap=colours, norm=scale, interpolation="nearest")
    axes.set(xlabel="x, px", ylabel="y, px", title=title)
    label = "merit m, below 0.1 a perfect inverse top-hat; line: limit of a marker"
    bar = figure.colorbar(shown, ax=axes, shrink=0.7, extend="both", label=label)
    bar.ax.axhline(limit, color="#00e5ff", lw=2)
    return figure
