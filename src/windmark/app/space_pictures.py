"""Pictures of a calibration in space: stations, markers and their error ellipsoids."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.special import chdtri

from windmark.app.pictures import BLUE, DARK, WIDTH_IN
from windmark.errors import g2
from windmark.scene.plots import round_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from windmark.calibration import Calibration

Array = NDArray[np.float64]

RADIUS = float(np.sqrt(chdtri(3, 0.05)))
"""Semi-axis of a 95 % ellipsoid, in sigma."""
_PLANES = ((0, 1), (0, 2), (1, 2))
_NAMED = 40
"""Markers are named up to so many."""
_SHARE, _USUAL, _LARGEST = 0.8, 0.035, 0.2
"""An ellipsoid larger than this share of all is drawn with a semi-axis of this part of the model; the largest with no
more than that."""


def magnification(cov: Array, size: float) -> tuple[float, float, float]:
    """Semi-axes of the usual and of the largest 95 % ellipsoid, and the factor by which they are drawn."""
    longest = RADIUS * np.sqrt(np.maximum(np.linalg.eigvalsh(cov)[:, -1], 0.0))
    usual, top = float(np.quantile(longest, _SHARE)), float(longest.max())
    room = min(_USUAL * size / max(usual, 1e-12 * size), _LARGEST * size / max(top, 1e-12 * size))
    return usual, top, round_length(room) if top > 0 else 1.0


def _magnified(usual: float, top: float, factor: float, unit: str) -> str:
    return (f"95 % error ellipsoids × {factor:g}: {100 * _SHARE:.0f} % have semi-axes below {g2(usual)} {unit}, "
            f"the largest is {g2(top)} {unit}")  # fmt: skip


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
    usual, top, factor = magnification(cov, float(np.ptp(xyz, axis=0).max()))
    spans = np.ptp(xyz, axis=0) + 2.2 * factor * usual + 1e-9
    grown = [max(float(s), 0.25 * float(spans.max())) for s in spans]
    figure = Figure(figsize=(WIDTH_IN, WIDTH_IN * (grown[1] + grown[2]) / (grown[0] + grown[1]) + 1.0),
                    layout="constrained")  # fmt: skip
    grid = figure.add_gridspec(2, 2, width_ratios=grown[:2], height_ratios=(grown[1], grown[2]))
    for place, (a, b) in (((0, 0), (0, 1)), ((1, 0), (0, 2)), ((1, 1), (1, 2))):
        axes = figure.add_subplot(grid[place])
        shapes = [_outline(cov[k][np.ix_([a, b], [a, b])] * (RADIUS * factor) ** 2) + xyz[k, [a, b]]
                  for k in range(len(xyz))]  # fmt: skip
        axes.add_collection(PolyCollection(shapes, facecolors="#90caf980", edgecolors=BLUE, linewidths=0.6))
        axes.plot(xyz[:, a], xyz[:, b], ".", color=DARK, ms=3)
        _limits(axes, xyz[:, [a, b]], (grown[a], grown[b]))
        axes.set(xlabel=f"{'xyz'[a]}, {unit}", ylabel=f"{'xyz'[b]}, {unit}")
        axes.grid(alpha=0.25)
        if len(xyz) <= _NAMED and (a, b) == (0, 1):
            for name, p in zip(result.markers.name, xyz, strict=True):
                axes.annotate(str(name), (p[a], p[b]), xytext=(4, 4), textcoords="offset points", fontsize=7)
    figure.suptitle(_magnified(usual, top, factor, unit))
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
