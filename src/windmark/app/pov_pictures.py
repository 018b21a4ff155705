"""The picture of a point of view: the paper's Fig. 5 with the numbers of a real camera."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, FancyArrowPatch
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from windmark.app.pictures import DARK, WIDTH_IN
from windmark.errors import g2, g3
from windmark.geometry import Camera, Pose
from windmark.pipeline.surface import surface_view
from windmark.pipeline.views import frame_view

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from windmark.app.pov_verb import Viewpoint
    from windmark.scene import Mesh

Array = NDArray[np.float64]

COLOURS = ("#c62828", "#2e7d32", "#1565c0")
STEP = "#ef6c00"
_HALO = [withStroke(linewidth=2.5, foreground="white")]
_SIZE, _FOV = (1100, 760), 12.0
_FARTHEST = 3.0
"""A camera farther away than so many times the model's size is drawn nearer."""
_TURNS = (("rx", "y", "z"), ("ry", "z", "x"), ("rz", "x", "y"))
"""Angle, the axis it starts from and the one it goes to."""


def pov_picture(view: Viewpoint, mesh: Mesh | None = None, points: Array | None = None) -> Figure:
    """Camera and model in space with the three distances, the three angles as dials, and the numbers.

    Parameters
    ----------
    view : the point of view
    mesh : drawn shaded
    points : (N, 3) drawn as dots: markers
    """
    figure = Figure(figsize=(WIDTH_IN * 1.15, WIDTH_IN * 0.62))
    _scene(figure.add_axes((0.01, 0.04, 0.69, 0.88)), view, mesh, points)
    pov = view.pov
    for k, (name, first, second) in enumerate(_TURNS):
        axes = figure.add_axes((0.71, 0.665 - 0.275 * k, 0.13, 0.235))
        _dial(axes, getattr(pov, f"{name}_deg"), name, first, second)
    _numbers(figure, view)
    figure.suptitle(f"Point of view: {view.name}", fontsize=11, y=0.975)
    return figure


def _scene(axes: Axes, view: Viewpoint, mesh: Mesh | None, points: Array | None) -> None:
    body = np.zeros((1, 3)) if mesh is None else mesh.vertices[mesh.used]
    if points is not None and len(points):
        body = np.concatenate([body, points])
    size = float(np.linalg.norm(np.ptp(body, axis=0)))
    pose, nearer = _nearer(view.pose, size)
    station, (right, down, ahead) = pose.center, pose.rotation
    distance = float(np.linalg.norm(pose.translation)) or 1.0
    arm = max(0.12 * distance, 0.35 * size) if size > 0 else 0.2 * distance
    corners = _frustum(view.camera, pose, 0.9 * arm)
    legs = [d * axis for d, axis in zip(pose.translation, pose.rotation, strict=True)]
    steps = station + np.cumsum([np.zeros(3), *legs], axis=0)
    own, small = arm * np.eye(3), station + 0.6 * arm * pose.rotation
    focus = np.concatenate([body, corners, steps, own, small])
    # From the camera's right, a little from above and behind, with the camera's own top at the top.
    direction = -right + 0.35 * down + 0.3 * ahead
    camera, scene = frame_view(focus, direction=direction, up=-down, size_px=_SIZE, fov_deg=_FOV)
    if mesh is not None:
        values = np.zeros(len(mesh.vertices))
        shown = surface_view(mesh, values, direction=direction, up=-down, focus=focus, size_px=_SIZE, fov_deg=_FOV)
        axes.imshow(0.45 + 0.5 * shown.shade, cmap="gray", vmin=0, vmax=1, interpolation="bilinear")

    def at(xyz: Array) -> Array:
        return camera.project(scene.apply(xyz))[0]

    if points is not None and len(points):
        axes.plot(*at(points).T, ".", color=DARK, ms=4)
    _draw_camera(axes, at(corners))
    _draw_steps(axes, at(steps))
    if nearer > 1:
        words = f"not to scale: dz is drawn {g3(nearer)} times shorter"
        axes.text(0.02, 0.98, words, transform=axes.transAxes, va="top", color=STEP, fontsize=9)
    for k, (capital, letter) in enumerate(zip("XYZ", "xyz", strict=True)):
        _arrow(axes, at(np.zeros((1, 3)))[0], at(own[k : k + 1])[0], COLOURS[k], capital)
        _arrow(axes, at(station[None])[0], at(small[k : k + 1])[0], COLOURS[k], letter)
    _name(axes, at(np.zeros((1, 3)))[0], "O", (-9, 8))
    _name(axes, at(station[None])[0], "o", (-9, 8))
    axes.set(xlim=(0, _SIZE[0]), ylim=(_SIZE[1], 0), aspect="equal")
    axes.axis("off")


def _nearer(pose: Pose, size: float) -> tuple[Pose, float]:
    """The pose with its camera so near that a model of this size can still be seen, and how many times nearer."""
    dx, dy, dz = pose.translation
    most = _FARTHEST * size
    if size == 0 or abs(dz) <= most:
        return pose, 1.0
    return Pose(pose.rotation, np.array([dx, dy, np.copysign(most, dz)])), float(abs(dz) / most)


def _frustum(camera: Camera, pose: Pose, reach: float) -> Array:
    """(5, 3): the station and the corners of the image so far away, in the model's frame."""
    width, height = camera.size_px
    corner = np.array([[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]])
    rays = np.column_stack([(corner - [camera.cx, camera.cy]) / [camera.focal_px, camera.focal_px * camera.aspect],
                            np.ones(4)])  # fmt: skip
    rays *= reach / np.linalg.norm(rays, axis=1, keepdims=True)
    return np.concatenate([pose.center[None], pose.center + rays @ pose.rotation])


def _draw_camera(axes: Axes, xy: Array) -> None:
    for corner in xy[1:]:
        axes.plot(*np.stack([xy[0], corner]).T, color=DARK, lw=0.9)
    ring = xy[[1, 2, 3, 4, 1]]
    axes.fill(*ring.T, color="#90a4ae40", lw=0)
    axes.plot(*ring.T, color=DARK, lw=0.9)


def _draw_steps(axes: Axes, xy: Array) -> None:
    """The way from the camera to the model's origin along the camera's axes: dx, dy, dz."""
    for k, name in enumerate(("dx", "dy", "dz")):
        a, b = xy[k], xy[k + 1]
        axes.plot(*np.stack([a, b]).T, color=STEP, lw=1.4, ls=(0, (5, 2.5)))
        if np.linalg.norm(b - a) > 0.05 * _SIZE[0]:
            axes.annotate(name, (a + b) / 2, xytext=(0, 6), textcoords="offset points", ha="center", color=STEP,
                          fontsize=11, fontweight="bold", path_effects=_HALO)  # fmt: skip


def _arrow(axes: Axes, start: Array, end: Array, colour: str, name: str) -> None:
    if np.linalg.norm(end - start) < 6:  # it points at the viewer
        return
    axes.add_patch(FancyArrowPatch(_pair(start), _pair(end), arrowstyle="-|>", mutation_scale=11, color=colour, lw=1.7,
                                   shrinkA=0, shrinkB=0, path_effects=_HALO))  # fmt: skip
    ahead = (end - start) / np.linalg.norm(end - start)
    _name(axes, end, name, (11 * ahead[0], -11 * ahead[1]), colour)


def _pair(xy: Array) -> tuple[float, float]:
    return float(xy[0]), float(xy[1])


def _name(axes: Axes, xy: Array, text: str, offset: tuple[float, float], colour: str = DARK) -> None:
    axes.annotate(text, _pair(xy), xytext=offset, textcoords="offset points", ha="center", va="center", color=colour,
                  fontsize=12, fontweight="bold", path_effects=_HALO)  # fmt: skip


def _dial(axes: Axes, angle: float, name: str, first: str, second: str) -> None:
    """One angle, looking against the axis it turns about: from the axis ``first`` toward ``second``."""
    colour = {letter: COLOURS["xyz".index(letter)] for letter in "xyz"}
    axes.add_patch(Circle((0, 0), 1, fill=False, color="#b0bec5", lw=0.8))
    low, high = sorted((0.0, angle))
    axes.add_patch(Arc((0, 0), 0.9, 0.9, theta1=low, theta2=high, color=STEP, lw=2.2))
    for k, letter in enumerate((first, second)):
        plain = np.array([1 - k, k])
        turn = np.radians(angle + 90 * k)
        axes.plot(*np.stack([[0, 0], plain]).T, color="#b0bec5", lw=1, ls=":")
        axes.annotate("", (np.cos(turn), np.sin(turn)), (0, 0),
                      arrowprops={"arrowstyle": "-|>", "color": colour[letter], "lw": 1.5})  # fmt: skip
        if abs((angle + 180) % 360 - 180) > 15:  # else the turned axis' name is in its place
            axes.text(1.17 * plain[0], 1.17 * plain[1], letter, ha="center", va="center", fontsize=9, color="#78909c")
        axes.text(1.3 * np.cos(turn), 1.3 * np.sin(turn), letter + "′", ha="center", va="center", fontsize=10,
                  color=colour[letter], path_effects=_HALO)  # fmt: skip
    axes.set(xlim=(-1.45, 1.45), ylim=(-1.45, 1.45), aspect="equal")
    axes.set_title(f"{name} = {round(angle, 4) + 0.0:.4f}°", fontsize=10, pad=1, color=DARK)
    axes.axis("off")


def _numbers(figure: Figure, view: Viewpoint) -> None:
    pov, unit, sigma = view.pov, view.unit or "", view.sigma

    def line(name: str, what: str) -> str:
        known = "" if sigma is None or not np.isfinite(getattr(sigma, name)) else f"\n   ± {g2(getattr(sigma, name))}"
        return f"{name.removesuffix('_deg'):3s} {round(getattr(pov, name), 9) + 0.0:.5g} {what}{known}"

    rows = [line(n, "°") for n in ("rx_deg", "ry_deg", "rz_deg")]
    rows += [line(n, unit) for n in ("dx", "dy", "dz")] + [line("fov_deg", "°")]
    station = "\n".join(f"  {v:.5g}" for v in view.pose.center)
    text = "\n".join(rows) + f"\n\nstation o in the\nmodel's frame, {unit}\n{station}"
    figure.text(0.865, 0.9, text, va="top", fontsize=9.5, family="monospace", color=DARK)
    figure.text(
        0.02, 0.012,
        "Model axes X Y Z at O, camera axes x (right) y (down) z (ahead) at o. The model is turned about the camera's x"
        " by rx, then y by ry, then z by rz;\nthen its origin is put dx, dy, dz along the camera's axes."
        " Dials: seen against the axis; ± is one sigma.",
        fontsize=8.5, color=DARK,
    )  # fmt: skip
