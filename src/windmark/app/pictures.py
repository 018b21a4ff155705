"""Pictures of a result: what was found, how well it fits, where the grid lies.

Every function returns a matplotlib `Figure` (no pyplot, no global state, no display needed); `png`
turns it into bytes.
"""

from __future__ import annotations

import io as byte_io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from matplotlib.image import imsave
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter, FuncFormatter
from numpy.typing import NDArray

from windmark.scene.plots import round_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from windmark.pipeline.results import SectionValues, ViewImage
    from windmark.scene import Detections

Array = NDArray[np.float64]

MATCHED, SPARE, MISSING = "#00c853", "#ff9100", "#ff1744"
WIDTH_IN = 11.0
BLUE, RED, DARK = "#1565c0", "#d50000", "#263238"
_OUTLINE = [withStroke(linewidth=1.6, foreground="black")]


def png(figure: Figure, dpi: int = 110) -> bytes:
    """The figure as PNG bytes."""
    stream = byte_io.BytesIO()
    _names_are_no_formulas(figure)
    figure.set_dpi(dpi)
    # Drawn once: `Figure.savefig` draws all of a figure with a layout twice, the first time to find its places.
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    # Camera noise does not compress: the default level takes three times as long for 5 % less.
    imsave(stream, canvas.buffer_rgba(), format="png", origin="upper", dpi=dpi, pil_kwargs={"compress_level": 3})
    return stream.getvalue()


def _names_are_no_formulas(figure: Figure) -> None:
    """Dollar signs in names of images, views and markers are dollar signs; only numbers of axes are typeset."""
    texts = figure.findobj(Text)
    scales = [axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)
              if not isinstance(axis.get_major_formatter(), FixedFormatter | FuncFormatter)]  # fmt: skip
    # The ticks that there are: asking for them would place them all, which drawing does anyway.
    ticks = {label for axis in scales for tick in (*axis.majorTicks, *axis.minorTicks)
             for label in (tick.label1, tick.label2)}  # fmt: skip
    for text in texts:
        if text not in ticks:
            text.set_parse_math(False)


def stretched(image: NDArray[np.generic], low: float = 0.5, high: float = 99.5) -> NDArray[np.float32]:
    """Grey levels to 0..1 between two percentiles, NaN kept; for showing only."""
    values = np.asarray(image, dtype=np.float32)
    finite = values[np.isfinite(values)]
    if not finite.size:
        return np.zeros_like(values)
    a, b = np.percentile(finite[:: max(1, finite.size // 200_000)], [low, high])
    return np.clip((values - a) / max(float(b - a), 1e-12), 0, 1)


LEGEND_ROWS, LEGEND_ROW_IN = 2, 0.2
"""Rows of a legend that `image_axes` has room for, and the height of one."""


def image_axes(image: NDArray[np.generic], *, colour_bar_room: bool = False) -> tuple[Figure, Axes]:
    """A figure that shows an image in its own proportions, axes in pixels."""
    height, width = image.shape[:2]
    figure = Figure(figsize=(WIDTH_IN, np.clip(WIDTH_IN * height / width + 0.9, 3.0, 14.0)), layout="constrained")
    axes = figure.add_subplot()
    axes.imshow(stretched(image), cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    axes.set(xlabel="x, px", ylabel="y, px", xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    return figure, axes


def draw_spots(axes: Axes, spots: Detections, keep: NDArray[np.bool_] | None = None, colour: str = MATCHED) -> None:
    """Circles of the spots' own size, widened so that the spot itself stays visible."""
    index = np.arange(len(spots)) if keep is None else np.flatnonzero(keep)
    if not len(index):
        return
    size = 2 * np.maximum(np.nan_to_num(spots.radius_px[index], nan=3.0) * 1.8, 5.0)
    axes.add_collection(
        EllipseCollection(
            size, size, np.zeros(len(index)), units="xy", offsets=spots.xy[index],
            offset_transform=axes.transData, facecolors="none", edgecolors=colour, linewidths=1.2,
        )
    )  # fmt: skip


def spots_picture(image: NDArray[np.generic], spots: Detections, title: str) -> Figure:
    """The image with every detected spot."""
    figure, axes = image_axes(image)
    draw_spots(axes, spots)
    axes.set_title(f"{title}: {len(spots)} spots")
    return figure


def matching_picture(
    image: NDArray[np.generic],
    spots: Detections,
    detection: NDArray[np.int64],
    names: Sequence[str],
    projected: Array,
    missing_xy: Array,
    missing_names: Sequence[str],
    title: str,
    *,
    guided: bool = False,
) -> Figure:
    """Which spot is which marker: names, residual vectors magnified, spare spots, markers not found.

    Parameters
    ----------
    detection, names, projected : per matched marker its spot, its name and its projected place (K, 2)
    missing_xy, missing_names : markers that should be in view but have no spot
    guided : projected places are only where the markers were expected, so the vectors are no residuals
    """
    figure, axes = image_axes(image)
    rms, vector = (
        ("RMS distance to the expected places", "expected − found") if guided else ("reprojection RMS", "residual")
    )
    matched = np.zeros(len(spots), dtype=bool)
    matched[detection] = True
    draw_spots(axes, spots, matched, MATCHED)
    draw_spots(axes, spots, ~matched, SPARE)
    xy = spots.xy[detection]
    residual = projected - xy
    factor = _magnification(residual, image.shape[1])
    ends = np.stack([xy, xy + factor * residual], axis=1)
    axes.add_collection(LineCollection(list(ends), colors="#ffea00", linewidths=1.4))
    if len(missing_xy):
        axes.plot(missing_xy[:, 0], missing_xy[:, 1], "D", mfc="none", mec=MISSING, ms=9, mew=1.3)
    _name_points(axes, xy, names, "white", image.shape)
    _name_points(axes, missing_xy, missing_names, MISSING, image.shape)
    size = f", {rms} {_rms(residual):.3f} px" if len(xy) else ""
    axes.set_title(f"{title}: {len(xy)} markers {'found' if guided else 'matched'}{size}")
    draw_legend(axes, [
        (MATCHED, "o", f"{'marker found' if guided else 'matched spot'} ({len(xy)})"),
        (SPARE, "o", f"spot of no marker ({int((~matched).sum())})"),
        (MISSING, "D", f"marker expected, no spot ({len(missing_xy)})"),
        ("#ffea00", "-", f"{vector} × {factor:g}"),
    ])  # fmt: skip
    return figure


def wireframe_picture(image: NDArray[np.generic], lines: Sequence[Array], title: str) -> Figure:
    """Grid lines (each (n, 2) pixels) over the image."""
    figure, axes = image_axes(image)
    axes.add_collection(LineCollection(list(lines), colors="#00e5ff", linewidths=0.45, alpha=0.75))
    axes.set_title(title)
    return figure


def surface_picture(
    value: NDArray[np.float32], shade: NDArray[np.float32], title: str, label: str = "grey level",
    *, limits: tuple[float, float] | None = None, kinds: Sequence[str] = (),
) -> Figure:  # fmt: skip
    """The mapped surface in 3D: colour = value, light and dark = the surface's shape, grey = not seen.

    Parameters
    ----------
    value : (H, W) value of each pixel, NaN where the surface was not seen
    shade : (H, W) light on the surface 0..1, NaN where there is no surface
    limits : of the colours; by default all values but the outermost
    kinds : what the values 0, 1, 2 ... stand for, where they are no quantity; ``label`` is not used then
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.patches import Patch

    height, width = value.shape
    figure = Figure(figsize=(WIDTH_IN, WIDTH_IN * height / width + 0.6), layout="constrained")
    axes = figure.add_subplot()
    finite = value[np.isfinite(value)]
    if kinds:  # between nodes of two kinds there is no third
        value, limits = np.round(value), (0.0, len(kinds) - 1.0)
    low, high = limits or (np.percentile(finite, [0.5, 99.5]) if finite.size else (0.0, 1.0))
    scale = Normalize(float(low), float(max(high, low + 1e-9)))
    colours = colormaps["viridis"](scale(np.nan_to_num(value, nan=low)))[..., :3]
    colours = np.where(np.isfinite(value)[..., None], colours, 0.72)
    light = np.nan_to_num(shade, nan=1.0)[..., None]
    # Mostly ambient light, so that colours stay those of the colour bar.
    picture = np.where(np.isfinite(shade)[..., None], colours * (0.55 + 0.45 * light), 1.0)
    axes.imshow(picture, interpolation="nearest")
    axes.set_axis_off()
    axes.set_title(title)
    if kinds:
        steps = [Patch(color=colormaps["viridis"](scale(k)), label=name) for k, name in enumerate(kinds)]
        figure.legend(handles=steps, loc="outside lower center", ncols=len(steps), fontsize=9, frameon=False)
    elif finite.size:
        figure.colorbar(ScalarMappable(scale, "viridis"), ax=axes, shrink=0.7, label=label, extend="both")
    return figure


def view_picture(view: ViewImage, length_unit: str) -> Figure:
    """A virtual image with a scale bar."""
    figure, axes = image_axes(view.image)
    axes.set_facecolor("#dde6f0")
    height, width = view.image.shape
    length = round_length(0.2 * width * view.units_per_px)
    pixels = length / view.units_per_px
    x0, y0 = _empty_corner(view.valid, pixels)
    axes.plot([x0, x0 + pixels], [y0, y0], color="#ffea00", lw=3, path_effects=_OUTLINE)
    axes.text(x0, y0 - 0.015 * height, f"{length:g} {length_unit}", color="#ffea00", fontsize=9, va="bottom",
              path_effects=_OUTLINE)  # fmt: skip
    axes.set_title(f"Virtual image “{view.name}”: {view.units_per_px:.4g} {length_unit} per pixel")
    return figure


def section_picture(section: SectionValues, length_unit: str, label: str = "grey level") -> Figure:
    """Values along a cut of the surface against arc length."""
    figure = Figure(figsize=(WIDTH_IN, 3.6), layout="constrained")
    axes = figure.add_subplot()
    lines = [k for k in np.unique(section.line) if np.isfinite(section.value[section.line == k]).any()]
    along = int(np.argmax(np.ptp(section.xyz, axis=0)))  # chordwise coordinate of a chordwise cut
    for k in lines:
        mine = section.line == k
        axes.plot(section.xyz[mine, along], section.value[mine], lw=1.1, label=f"line {k + 1}")
    axes.set(xlabel=f"{'xyz'[along]}, {length_unit}", ylabel=label)
    axes.set_title(f"Section “{section.name}”: gaps are where the camera does not see the surface")
    axes.grid(alpha=0.3)
    if 1 < len(lines) <= 10:
        axes.legend(fontsize=8)
    return figure


def alignment_picture(
    reference: NDArray[np.generic], raw: NDArray[np.generic], aligned: NDArray[np.float32], name: str,
    label: str = "grey level",
) -> Figure:  # fmt: skip
    """Difference to the reference image, as taken and after 3D alignment, on one scale."""
    height, width = reference.shape
    figure = Figure(figsize=(WIDTH_IN, 0.5 * WIDTH_IN * height / width + 0.9), layout="constrained")
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    before = np.where(np.isfinite(aligned), raw - np.asarray(reference, dtype=np.float32), np.nan)
    after = aligned - np.asarray(reference, dtype=np.float32)
    finite = before[np.isfinite(before)]
    top = float(np.percentile(np.abs(finite), 99)) if finite.size else 1.0
    for axes, difference, title in ((left, before, f"{name} as taken"), (right, after, f"{name} aligned")):
        shown = axes.imshow(difference, cmap="coolwarm", vmin=-top, vmax=top, interpolation="nearest")
        axes.set(title=title, xlabel="x, px")
    left.set_ylabel("y, px")
    figure.colorbar(shown, ax=[left, right], label=f"difference to the reference, {label}", extend="both")
    return figure


# --- parts -------------------------------------------------------------------------------


def _rms(residual: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1)))) if len(residual) else float("nan")


def _magnification(residual: Array, width: int) -> float:
    """A round factor (1, 2, 5, 10, ...) that makes the RMS residual about 3 % of the image's width."""
    rms = _rms(residual)
    return 1.0 if not rms > 0 else max(1.0, round_length(0.03 * width / rms))


def _empty_corner(valid: NDArray[np.bool_], length: float) -> tuple[float, float]:
    """Left end of a scale bar of this length in the corner that shows least of the surface."""
    height, width = valid.shape
    left, right = 0.03 * width, 0.97 * width - length
    places = [(x, y) for y in (0.96 * height, 0.08 * height) for x in (left, right)]

    def covered(place: tuple[float, float]) -> float:
        x, y = map(int, place)
        return float(valid[max(y - height // 12, 0) : y + height // 50, max(x, 0) : int(x + length)].mean())

    return min(places, key=covered)


def _name_points(axes: Axes, xy: Array, names: Sequence[str], colour: str, shape: tuple[int, ...]) -> None:
    """Names beside points, inside the picture also at its right border."""
    for name, (x, y) in zip(names, xy, strict=True):
        right = x > 0.94 * shape[1]
        axes.annotate(
            name, (x, y), xytext=(-8 if right else 8, 7), textcoords="offset points", color=colour, fontsize=8,
            ha="right" if right else "left", path_effects=_OUTLINE, annotation_clip=True,
        )  # fmt: skip


def draw_legend(axes: Axes, entries: list[tuple[str, str, str]]) -> None:
    """Legend below the picture, in rows of four; entries are colour, mark ("-" for a line), words.

    `image_axes` leaves room for two rows; for more the figure grows.
    """
    from matplotlib.lines import Line2D

    handles: list[Any] = [
        Line2D([], [], color=c, lw=1.6, label=text) if mark == "-"
        else Line2D([], [], ls="", marker=mark, mfc="none", mec=c, ms=8, mew=1.4, label=text)
        for c, mark, text in entries
    ]  # fmt: skip
    columns = min(len(handles), 4)
    rows, figure = -(-len(handles) // columns), axes.figure
    assert isinstance(figure, Figure)
    figure.set_figheight(figure.get_figheight() + LEGEND_ROW_IN * max(rows - LEGEND_ROWS, 0))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize=8, frameon=False)
