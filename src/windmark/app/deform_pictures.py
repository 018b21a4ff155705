"""Pictures of what a deformation does to mapped values (AIAA 2005-5007, Fig. 10)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from windmark.app.pictures import WIDTH_IN
from windmark.geometry import Pose
from windmark.pipeline.deform.values import Compared
from windmark.pipeline.surface import surface_view
from windmark.scene import Mesh

Array = NDArray[np.float64]

WIDTH_PX, HEIGHT_PX = 560, (280, 760)
"""Of one panel; its height fits what is seen."""
MOST_SHOWN, MOST_DIVERGING = 99.0, 97.0
"""Percentile of the values, and of the sizes of errors and differences, that the colours reach."""
NOT_SEEN = 0.72


@dataclass(frozen=True)
class Maps:
    """Values at the nodes of one surface that share a scale.

    Parameters
    ----------
    values : title -> (V,), NaN where there are none
    label : of the colour bar, with the unit
    diverging : colours that diverge from zero: for errors and differences
    """

    values: Mapping[str, Array]
    label: str
    diverging: bool = False

    def colours(self) -> tuple[Normalize, Colormap]:
        """The scale and its colours."""
        finite = np.concatenate([v[np.isfinite(v)] for v in self.values.values()])
        if self.diverging:
            top = float(np.percentile(np.abs(finite), MOST_DIVERGING)) if len(finite) else 1.0
            return Normalize(-top, top), colormaps["coolwarm"]
        low, high = np.percentile(finite, [100 - MOST_SHOWN, MOST_SHOWN]) if len(finite) else (0.0, 1.0)
        return Normalize(float(low), float(max(high, low + 1e-9))), colormaps["viridis"]


def maps_picture(mesh: Mesh, groups: Sequence[Maps], *, direction: ArrayLike, up: ArrayLike) -> Figure:
    """Values on one surface side by side, seen along a direction; grey where there are none."""
    every = [v for g in groups for v in g.values.values()]
    known = np.any([np.isfinite(v) for v in every], axis=0)
    focus = mesh.vertices[known] if known.any() else mesh.vertices[mesh.used]
    wide, high = np.ptp(Pose.look_at(np.zeros(3), np.asarray(direction, dtype=float), up).rotate(focus)[:, :2], axis=0)
    size = WIDTH_PX, int(np.clip(WIDTH_PX * high / max(wide, 1e-12), *HEIGHT_PX))
    across = WIDTH_IN / (len(every) + 0.45 * len(groups))
    figure = Figure(figsize=(WIDTH_IN, across * size[1] / size[0] + 0.7), layout="constrained")
    panels = iter(np.atleast_1d(figure.subplots(1, len(every))))
    for group in groups:
        scale, colours = group.colours()
        own = []
        for title, values in group.values.items():
            axes = next(panels)
            shown = surface_view(mesh, values, direction=direction, up=up, focus=focus, size_px=size)
            light = 0.75 + 0.25 * np.nan_to_num(shown.shade, nan=1.0)[..., None]
            coloured = colours(scale(np.nan_to_num(shown.value)))[..., :3]
            picture = np.where(np.isfinite(shown.value)[..., None], coloured, NOT_SEEN) * light
            axes.imshow(np.where(np.isfinite(shown.shade)[..., None], picture, 1.0), interpolation="nearest")
            axes.set_axis_off()
            axes.set_title(title, fontsize=10)
            own.append(axes)
        figure.colorbar(ScalarMappable(scale, colours), ax=own, label=group.label, extend="both", shrink=0.9)
    return figure


def compared_picture(mesh: Mesh, compared: Compared, *, direction: ArrayLike, up: ArrayLike) -> Figure:
    """The ratio of one frame, mapped with the grid as a whole and with the grid deformed: the paper's Fig. 10."""
    both = {"grid moved as a whole": compared.rigid, "grid deformed": compared.deformed}
    change = {"what that changes": 100 * (compared.rigid / compared.deformed - 1)}
    groups = [Maps(both, "ratio wind-off / wind-on"), Maps(change, "ratio, %", diverging=True)]
    return maps_picture(mesh, groups, direction=direction, up=up)
