"""Pictures of a lens: its distortion field, its effect magnified, and what its model misses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from windmark.app.photo import Overlay, preview
from windmark.app.pictures import WIDTH_IN, stretched
from windmark.calibration import CorrectedImage, corrected_camera
from windmark.errors import g3
from windmark.geometry import Camera
from windmark.scene.plots import round_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from windmark.calibration.quality import ResidualMap

Array = NDArray[np.float64]

_FIELD, _ARROWS = 161, 21  # samples across the sensor
_SURE = 3.0
_PAPERS, _SEEN = 3.0, 0.04
"""The paper's factor of its Fig. 9; a displacement of this part of the picture's width is well seen."""


def distortion_picture(camera: Camera, title: str = "Distortion") -> Figure:
    """Where the lens moves the picture: distorted − ideal, in pixels, over the sensor.

    Colours and contour lines are its length, arrows (magnified as the title says) its direction; the cross is
    the principal point. White is where the lens model has no inverse.
    """
    x, y, field = _displacement(camera, _FIELD)
    length = np.linalg.norm(field, axis=-1)
    width, height = camera.size_px
    figure = Figure(figsize=(WIDTH_IN * 0.8, WIDTH_IN * 0.8 * 0.78 * height / width + 0.9), layout="constrained")
    axes = figure.add_subplot()
    top = float(np.nanmax(length, initial=0.0))
    step = round_length(max(top, 1e-9) / 5)
    levels = np.arange(0, top + step, step / 4)
    shown = axes.contourf(x, y, length, levels=levels, cmap="YlGnBu")
    lines = axes.contour(x, y, length, levels=np.arange(step, top, step), colors="0.25", linewidths=0.7)
    axes.clabel(lines, fmt=lambda v: f"{v:g}", fontsize=8)
    figure.colorbar(shown, ax=axes, label="length of the displacement, px", ticks=np.arange(0, top + step, step))
    ax, ay, arrows = _displacement(camera, _ARROWS)
    factor = round_length(2.5 * width / _ARROWS / max(top, 1e-9))
    axes.quiver(ax, ay, *np.moveaxis(arrows * factor, -1, 0), angles="xy", scale_units="xy", scale=1, width=0.0018,
                color="#b71c1c")  # fmt: skip
    axes.plot(camera.cx, camera.cy, "+", color="black", ms=12, mew=1.5)
    ideal = "focal length × angle" if camera.lens == "fisheye" else "ideal"
    axes.set_title(f"{title}: up to {g3(top)} px, distorted − {ideal}; arrows × {factor:g}")
    _sensor_axes(axes, camera.size_px)
    return figure


def correction_picture(
    image: NDArray[np.generic],
    camera: Camera,
    corrected: CorrectedImage,
    magnified: CorrectedImage | None = None,
    factor: float = 1.0,
) -> Figure:
    """As taken, corrected, and, where it is given, with the distortion magnified: the paper's Fig. 9, side by side.

    The thin lines are straight in space; dashed ones join their ends, so that the bend can be seen.
    """
    height, width = image.shape[:2]
    panel = WIDTH_IN * 0.4
    everywhere = np.ones((height, width), dtype=bool)
    shown = [(CorrectedImage(image, camera, everywhere), "as taken"), (corrected, "lens undone")]
    if magnified is not None:
        shown.append((magnified, f"distortion × {factor:g}"))
    figure = Figure(figsize=(len(shown) * panel, panel * 0.93 * height / width + 0.8), layout="constrained")
    lines = _straight_rays(camera)
    for axes, (one, words) in zip(figure.subplots(1, len(shown), sharey=True), shown, strict=True):
        grey = stretched(one.image)
        axes.imshow(np.where(one.valid if grey.ndim == 2 else one.valid[..., None], grey, 1.0), cmap="gray", vmin=0,
                    vmax=1, interpolation="antialiased")  # fmt: skip
        for rays in lines:
            xy, seen = one.camera.project(rays)
            axes.plot(*xy.T, color="#00e5ff", lw=0.9)
            if seen.all():
                axes.plot(*xy[[0, -1]].T, color="#ffea00", lw=0.8, ls=(0, (5, 4)))
        axes.set_title(words)
        _sensor_axes(axes, one.camera.size_px)
        axes.label_outer()
    return figure


def correction_photos(
    image: NDArray[np.generic], camera: Camera, corrected: CorrectedImage, magnified: CorrectedImage | None = None,
    factor: float = 1.0, room: int = 140_000,
) -> list[str]:  # fmt: skip
    """`correction_picture` as pictures that zoom to their pixels: one after the other, each of ``room`` bytes."""
    everywhere = np.ones(image.shape[:2], dtype=bool)
    shown = [(CorrectedImage(image, camera, everywhere), "As taken"), (corrected, "The lens undone")]
    if magnified is not None:
        shown.append((magnified, f"Its distortion × {factor:g}"))
    out, lines = [], _straight_rays(camera)
    for one, words in shown:
        over = Overlay((one.image.shape[1], one.image.shape[0]))
        seen = [one.camera.project(rays) for rays in lines]
        over.lines("straight", [xy[good] for xy, good in seen], "straight in space", "#00e5ff")
        over.lines("chords", [xy[[0, -1]] for xy, good in seen if good.all()], "straight in the picture", "#ffea00")
        grey = one.image if one.image.ndim == 2 else one.image.mean(axis=2)
        out.append(over.html(preview(np.where(one.valid, grey, np.nan), room)[0], f"{words}."))
    return out


def visible_factor(camera: Camera) -> float:
    """How many times the distortion must be magnified to be seen: the paper's 3, or more where it is small."""
    top = float(np.nanmax(np.linalg.norm(_displacement(camera, _ARROWS)[2], axis=-1), initial=0.0))
    return max(_PAPERS, round_length(_SEEN * camera.size_px[0] / max(top, 1e-9)))


def residual_map_picture(seen: ResidualMap, title: str = "Residuals over the sensor") -> Figure:
    """Mean residuals in cells of the sensor, radial and tangential, one scale for both.

    Dots mark cells whose mean is more than three of its sigma away from zero: one in 370 if the lens model is
    right and cells hold many marks, patterns of them if it is not. Grey cells hold fewer than two marks.
    """
    width, height = seen.x[-1] - seen.x[0], seen.y[-1] - seen.y[0]
    figure = Figure(figsize=(WIDTH_IN, WIDTH_IN * 0.385 * height / width + 1.0), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    known = np.isfinite(seen.sigma)
    values = np.abs(np.stack([seen.radial, seen.tangential])[:, known])
    top = float(values.max(initial=0.0)) or 1e-9
    middle = np.meshgrid((seen.x[1:] + seen.x[:-1]) / 2, (seen.y[1:] + seen.y[:-1]) / 2)
    names = ("radial (outwards)", "tangential (clockwise)")
    for axes, mean, words in zip(panels, (seen.radial, seen.tangential), names, strict=True):
        shown = axes.pcolormesh(seen.x, seen.y, np.where(known, mean, np.nan), cmap="RdBu_r", vmin=-top, vmax=top)
        with np.errstate(invalid="ignore"):
            sure = known & (np.abs(mean) > _SURE * seen.sigma)
        axes.plot(middle[0][sure], middle[1][sure], "o", color="black", ms=3)
        axes.set_facecolor("0.8")
        axes.set_title(f"{words}: {int(sure.sum())} of {int(known.sum())} cells beyond 3 sigma", fontsize=10)
        _sensor_axes(axes, (int(width), int(height)))
    panels[1].set_ylabel("")
    figure.colorbar(shown, ax=list(panels), label="mean residual, projected − detected, px")
    figure.suptitle(title)
    return figure


def _straight_rays(camera: Camera) -> list[Array]:
    """Straight lines through the scene that run near the borders of the corrected picture and through its middle."""
    width, height = camera.size_px
    plain = corrected_camera(camera)
    x, y = (np.array([0.06, 0.5, 0.94]) * side for side in (width, height))
    t = np.linspace(0, 1, _FIELD)
    across = [np.stack([x[0] + t * (x[2] - x[0]), np.full_like(t, value)], axis=1) for value in y]
    down = [np.stack([np.full_like(t, value), y[0] + t * (y[2] - y[0])], axis=1) for value in x]
    return [plain.unproject(line) for line in (*across, *down)]


def _displacement(camera: Camera, columns: int) -> tuple[Array, Array, Array]:
    """Distorted − ideal pixels at a grid of pixels: x (C), y (R), (R, C, 2).

    Ideal is a pinhole's picture; a fisheye lens' is that of one whose image radius is the angle times the focal length.
    """
    width, height = camera.size_px
    rows = max(3, round(columns * height / width))
    x, y = np.linspace(0, width - 1, columns), np.linspace(0, height - 1, rows)
    pixels = np.stack(np.meshgrid(x, y), axis=-1)
    if camera.lens == "fisheye":
        bare = Camera(camera.size_px, camera.focal_px, camera.aspect, camera.cx, camera.cy, lens="fisheye")
        return x, y, pixels - bare.project(camera.directions(pixels))[0]
    return x, y, pixels - corrected_camera(camera).project(camera.unproject(pixels))[0]


def _sensor_axes(axes: Axes, size_px: Sequence[int]) -> None:
    axes.set(xlabel="x, px", ylabel="y, px", xlim=(-0.5, size_px[0] - 0.5), ylim=(size_px[1] - 0.5, -0.5),
             aspect="equal")  # fmt: skip
