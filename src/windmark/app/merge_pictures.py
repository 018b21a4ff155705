"""Pictures of merged images: value, sigma and source on the surface, steps along the seams."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from windmark.app import pictures
from windmark.pipeline.surface import surface_view
from windmark.pipeline.views import frame_view

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from windmark.pipeline.points import MergedTable, PointTable
    from windmark.resection import MergedViews

Array = NDArray[np.float64]

COLOURS = ("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#e377c2", "#bcbd22", "#17becf", "#7f7f7f")
"""Of the images in the picture of sources, repeated when there are more."""
NO_VALUE = 0.82
MOST_SURE = 95.0
"""Percentile of the sigmas up to which their colours differ."""


def direction(merged: MergedViews) -> tuple[Array, Array, Array]:
    """Where the merged surface is looked at from: between the cameras; direction, up, and the nodes to be in view."""
    seen = merged.mesh.vertices[np.isfinite(merged.nodes.value)]
    centres = np.stack([s.picture.cam_from_model.center for s in merged._sources])
    ahead = seen.mean(axis=0) - centres.mean(axis=0)
    up = -merged._sources[merged.gains.reference].picture.cam_from_model.rotation[1]
    return ahead / np.linalg.norm(ahead), up, seen


def value_figure(merged: MergedViews, title: str, label: str = "grey level") -> Figure:
    """The merged values on the surface, looked at from between the cameras."""
    ahead, up, seen = direction(merged)
    shown = surface_view(merged.mesh, merged.nodes.value, direction=ahead, up=up, focus=seen, fov_deg=10.0)
    return pictures.surface_picture(shown.value, shown.shade, title, label)


def sigma_figure(merged: MergedViews) -> Figure:
    """Sigma of the merged values in percent of them."""
    ahead, up, seen = direction(merged)
    with np.errstate(divide="ignore", invalid="ignore"):
        percent = 100 * merged.nodes.sigma / np.abs(merged.nodes.value)
    percent[~np.isfinite(percent)] = np.nan
    shown = surface_view(merged.mesh, percent, direction=ahead, up=up, focus=seen, fov_deg=10.0)
    seen_percent = shown.value[np.isfinite(shown.value)]
    # Outlines are many times less sure than the rest, which would all have one colour.
    limits = tuple(np.percentile(seen_percent, [0.5, MOST_SURE])) if seen_percent.size else None
    return pictures.surface_picture(shown.value, shown.shade, "Sigma of the merged values", "% of the value",
                                    limits=limits)  # fmt: skip


def source_figure(merged: MergedViews) -> Figure:
    """Which image counts most at each node; paler where fewer images see it. Pale grey: none."""
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch

    ahead, up, seen = direction(merged)
    fields = [(merged.nodes.source == k).astype(float) for k in range(len(merged.names))]
    shown = [surface_view(merged.mesh, f, direction=ahead, up=up, focus=seen, fov_deg=10.0) for f in fields]
    shade = shown[0].shade
    colours = np.array([to_rgb(_colour(k)) for k in range(len(fields))])
    weight = np.nan_to_num(np.stack([s.value for s in shown]))
    most = np.argmax(weight, axis=0)
    known = weight.max(axis=0) > 0.3
    flat = np.where(known[..., None], colours[most], NO_VALUE)
    light = np.nan_to_num(shade, nan=1.0)[..., None]
    picture = np.where(np.isfinite(shade)[..., None], flat * (0.55 + 0.45 * light), 1.0)
    height, width = shade.shape
    figure = Figure(figsize=(pictures.WIDTH_IN, pictures.WIDTH_IN * height / width + 0.9), layout="constrained")
    axes = figure.add_subplot()
    axes.imshow(picture, interpolation="nearest")
    axes.set_axis_off()
    axes.set_title("Which image counts most")
    count = [int((merged.nodes.source == k).sum()) for k in range(len(fields))]
    handles: list[Any] = [Patch(color=_colour(k), label=f"{n} ({c} nodes)")
                          for k, (n, c) in enumerate(zip(merged.names, count, strict=True))]  # fmt: skip
    handles.append(Patch(color=str(NO_VALUE), label="no value"))
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.01), ncols=min(len(handles), 6),
                fontsize=9, frameon=False)  # fmt: skip
    return figure


def _colour(k: int) -> str:
    return COLOURS[k % len(COLOURS)]


def seams_figure(merged: MergedViews, unit: str) -> Figure:
    """Where one image takes over from another, with the step there in sigmas, and how the steps are distributed."""
    seams = merged.seams
    ahead, up, seen = direction(merged)
    camera, pose = frame_view(seen, direction=ahead, up=up, size_px=(1400, 800), fov_deg=10.0)
    figure = Figure(figsize=(pictures.WIDTH_IN, 5.2), layout="constrained")
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": (3, 1)})
    every = camera.project(pose.apply(seen))[0]
    place = camera.project(pose.apply(merged.mesh.vertices[seams.node]))[0]
    left.plot(*every.T, ",", color="0.8", zorder=0)
    steps = seams.in_sigmas
    drawn = left.scatter(*place.T, c=steps, s=5, cmap="coolwarm", vmin=-3, vmax=3)
    left.set(aspect="equal", xlim=(0, 1400), ylim=(800, 0))
    left.set_axis_off()
    left.set_title(f"{len(seams)} nodes on seams")
    figure.colorbar(drawn, ax=left, shrink=0.8, label="step / its sigma", extend="both")
    _histogram(right, steps)
    return figure


def _histogram(axes: Axes, steps: Array) -> None:
    bins = np.linspace(-5, 5, 41)
    axes.hist(np.clip(steps, -5, 5), bins=list(bins), density=True, color="#90caf9")
    x = np.linspace(-5, 5, 201)
    axes.plot(x, np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi), color="#0d47a1", lw=1.2, label="noise alone")
    axes.set(xlabel="step / its sigma", ylabel="density")
    axes.legend(fontsize=8)


def line_figure(table: PointTable | MergedTable, unit: str, label: str = "grey level") -> Figure:
    """Values along a line with a band of one sigma."""
    figure = Figure(figsize=(pictures.WIDTH_IN, 3.4), layout="constrained")
    axes = figure.add_subplot()
    arc, value, sigma = table.of.arc, table.values.value, table.values.sigma
    assert arc is not None
    axes.fill_between(arc, value - sigma, value + sigma, color="#90caf9", lw=0, label="± 1 sigma")
    axes.plot(arc, value, lw=1.1, color="#0d47a1", label="value")
    axes.set(xlabel=f"length along the surface, {unit}", ylabel=label, xlim=(arc[0], arc[-1]))
    axes.set_title(f"Line “{table.of.name}”: gaps are where no image sees the surface" if np.isnan(value).any()
                   else f"Line “{table.of.name}”")  # fmt: skip
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return figure
