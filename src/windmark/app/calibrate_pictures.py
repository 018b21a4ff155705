"""Pictures of a calibration: residuals, uncertainty over the image, stations and markers in space."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import chi2

from windmark.app.pictures import WIDTH_IN, round_length
from windmark.calibration import Calibration
from windmark.calibration.quality import Comparison, projection_sigma
from windmark.calibration.snooping import LIMIT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

BLUE, RED, DARK = "#1565c0", "#d50000", "#263238"
_PLANES = ((0, 1), (0, 2), (1, 2))
_NAMED = 40
"""Markers are named up to so many."""


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
        axes.plot(*xy[~used].T, "x", color=RED, ms=5, label=f"left out ({int((~used).sum())})")
        axes.legend(loc="upper right", fontsize=8)
    axes.set(xlim=(-0.5, size[0] - 0.5), ylim=(size[1] - 0.5, -0.5), xlabel="x, px", ylabel="y, px", aspect="equal")
    axes.set_title(f"{int(used.sum())} residuals, projected − observed, × {factor:g}; RMS length {rms:.3f} px")
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
    test = np.minimum(result.test, 1.5 * LIMIT)
    edges = np.linspace(0, 1.5 * LIMIT, 43)
    axes.hist(test, edges.tolist(), color="#90caf9", edgecolor="white", lw=0.4, label=f"{len(test)} marks")
    expected = len(test) * np.diff(chi2.cdf(edges, 2))
    axes.step(edges, np.append(expected, expected[-1]), where="post", color=DARK, lw=1.2, label="chi-square (2)")
    axes.axvline(LIMIT, color=RED, lw=1, ls="--", label=f"limit {LIMIT:.1f}: 1 in 1000 by chance")
    axes.set_yscale("log")
    axes.set(ylim=(0.5, None), xlim=(0, 1.5 * LIMIT), xlabel="test value (last bar: this and larger)", ylabel="marks")
    axes.legend(fontsize=8)
    axes.set_title(f"{int((~result.used).sum())} of {len(test)} marks left out")
    return figure


def stations_picture(result: Calibration, unit: str) -> Figure:
    """Where the pictures were taken from, and the markers, from above and from two sides, on one scale."""
    poses = [result.pose(v.name) for v in result.views]
    at = np.stack([p.center for p in poses])
    both = np.concatenate([at, result.markers.xyz])
    figure = Figure(figsize=(WIDTH_IN, 4.6), layout="constrained")
    reach = 0.12 * float(np.ptp(both, axis=0).max())
    colours = _camera_colours(result)
    for axes, (a, b) in zip(figure.subplots(1, 3), _PLANES, strict=True):
        axes.plot(result.markers.xyz[:, a], result.markers.xyz[:, b], ".", color=DARK, ms=3)
        for view, pose in zip(result.views, poses, strict=True):
            corners = _frustum(result, view.camera, pose.rotation, pose.center, reach)[:, [a, b]]
            axes.add_collection(PolyCollection([corners[[0, 1, 2]], corners[[0, 2, 3]], corners[[0, 3, 4]],
                                                corners[[0, 4, 1]]], facecolors="none",
                                               edgecolors=colours[view.camera], linewidths=0.6))  # fmt: skip
        for name, colour in colours.items():
            mine = np.array([v.camera == name for v in result.views])
            axes.plot(at[mine, a], at[mine, b], "o", color=colour, ms=3.5, label=name)
        axes.set(xlabel=f"{'xyz'[a]}, {unit}", ylabel=f"{'xyz'[b]}, {unit}", aspect="equal")
        axes.margins(0.08)
        axes.autoscale_view()
        axes.tick_params(labelsize=8)
        axes.grid(alpha=0.25)
    if len(colours) > 1:
        figure.axes[0].legend(fontsize=8)
    figure.suptitle(f"{len(poses)} stations (pyramids: viewing directions) and {len(result.markers)} markers (dots)")
    return figure


def _camera_colours(result: Calibration) -> dict[str, str]:
    palette = ("#c62828", "#1565c0", "#2e7d32", "#ef6c00", "#6a1b9a")
    return {name: palette[k % len(palette)] for k, name in enumerate(result.cameras)}


def _frustum(result: Calibration, camera: str, rotation: Array, center: Array, reach: float) -> Array:
    """(5, 3) the station and the corners of its image, so far away."""
    found = result.cameras[camera]
    width, height = found.size_px
    x, y = (np.array([-1, 1, 1, -1]) * width / 2, np.array([-1, -1, 1, 1]) * height / 2)
    rays = np.stack([x, y, np.full(4, found.focal_px)], axis=1)
    rays *= reach / np.linalg.norm(rays, axis=1, keepdims=True)
    return np.concatenate([center[None], center + rays @ rotation])


def markers_picture(result: Calibration, unit: str) -> Figure:
    """Markers with their 95 % error ellipsoids, magnified, from above and from two sides."""
    xyz, cov = result.markers.xyz, result.marker_cov
    top = float(np.sqrt(np.linalg.eigvalsh(cov)[:, -1].max(initial=0.0)))
    size = float(np.ptp(xyz, axis=0).max())
    radius = float(np.sqrt(chi2.ppf(0.95, 3)))
    factor = round_length(0.04 * size / max(radius * top, 1e-12 * size)) if top > 0 else 1.0
    spans = np.ptp(xyz, axis=0) + 2.2 * factor * radius * top + 1e-9
    grown = [max(float(s), 0.25 * float(spans.max())) for s in spans]
    figure = Figure(figsize=(WIDTH_IN, WIDTH_IN * (grown[1] + grown[2]) / (grown[0] + grown[1]) + 1.0),
                    layout="constrained")  # fmt: skip
    grid = figure.add_gridspec(2, 2, width_ratios=grown[:2], height_ratios=(grown[1], grown[2]))
    for place, (a, b) in (((0, 0), (0, 1)), ((1, 0), (0, 2)), ((1, 1), (1, 2))):
        axes = figure.add_subplot(grid[place])
        shapes = [_outline(cov[k][np.ix_([a, b], [a, b])] * (radius * factor) ** 2) + xyz[k, [a, b]]
                  for k in range(len(xyz))]  # fmt: skip
        axes.add_collection(PolyCollection(shapes, facecolors="#90caf980", edgecolors=BLUE, linewidths=0.6))
        axes.plot(xyz[:, a], xyz[:, b], ".", color=DARK, ms=3)
        _limits(axes, xyz[:, [a, b]], (grown[a], grown[b]))
        axes.set(xlabel=f"{'xyz'[a]}, {unit}", ylabel=f"{'xyz'[b]}, {unit}")
        axes.grid(alpha=0.25)
        if len(xyz) <= _NAMED and (a, b) == (0, 1):
            for name, p in zip(result.markers.name, xyz, strict=True):
                axes.annotate(str(name), (p[a], p[b]), xytext=(4, 4), textcoords="offset points", fontsize=7)
    figure.suptitle(f"Markers and their 95 % error ellipsoids × {factor:g}; the largest semi-axis is "
                    f"{radius * top:.2g} {unit}")  # fmt: skip
    return figure


def _limits(axes: Axes, points: Array, span: tuple[float, float]) -> None:
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    axes.set(xlim=middle[0] + np.array([-0.53, 0.53]) * span[0], ylim=middle[1] + np.array([-0.53, 0.53]) * span[1],
             aspect="equal")  # fmt: skip


def _outline(cov: Array) -> Array:
    """(37, 2) ellipse of a 2 x 2 covariance, one sigma."""
    value, vector = np.linalg.eigh(cov)
    angle = np.linspace(0, 2 * np.pi, 37)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray((circle * np.sqrt(np.maximum(value, 0.0))) @ vector.T)


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
    figure.suptitle(f"{words}: {found.rms:.3g} {unit} RMS, {found.ratio:.2f} times the combined sigma")
    return figure
