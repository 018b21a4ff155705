"""Pictures of a report: small previews that zoom, what was found drawn over them, the pixels of some spots.

A preview is WebP of at most so many bytes: the picture's own pixels while they fit, coarser ones where not. What is
drawn over it is in the picture's own pixels and stays sharp at any zoom.
"""

from __future__ import annotations

import base64
import io as byte_io
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from windmark.app.pictures import stretched
from windmark.scene import Detections
from windmark.scene.plots import round_length

Array = NDArray[np.float64]

QUALITIES = (82, 65, 42)
GIVEN_UP = 4.6
"""A noisy picture takes so many times the bytes at the best quality as at the least: a larger one can never fit, and
one that fits at the least quality keeps its pixels, which are worth more than their last grey levels."""
MOST_PX, SHRINK = 1_600_000, 0.7
"""A preview has at most so many pixels; each further step takes so many times as many a side."""
LEAST_BYTES = 0.045
"""Of a pixel in a preview; with more pixels than fit at this, none need be tried."""
PROBED_PX, BLOCK, EVERY = 300_000, 16, 8
"""From so many pixels on every eighth row of blocks is packed first, to see whether all of them would fit."""
TILE = 16
"""Pixels to either side of a spot that are shown as they are."""


@dataclass(frozen=True)
class Room:
    """How many bytes a picture may take, as it stands in the file.

    Parameters
    ----------
    photo, thumbnail : of a preview and of the index's small one
    tiles : how many spots are shown by their pixels
    wires : of the lines of the grid
    """

    photo: int = 420_000
    thumbnail: int = 6_000
    tiles: int = 12
    wires: int = 24_000


FIRST, FURTHER = Room(), Room(photo=48_000, thumbnail=2_400, tiles=3, wires=5_000)
"""For the first picture of a report, and for each of the others."""


def preview(image: NDArray[np.generic], most: int) -> tuple[str, tuple[int, int]]:
    """A picture as a data URL of at most ``most`` characters (or the smallest tried), and its size in pixels."""
    grey = Image.fromarray(greys(image))
    scale = min(1.0, (min(MOST_PX, most / LEAST_BYTES) / max(grey.width * grey.height, 1)) ** 0.5)
    for _ in range(8):
        size = max(1, round(grey.width * scale)), max(1, round(grey.height * scale))
        small = grey if size == grey.size else grey.resize(size, Image.Resampling.BOX)
        for quality in QUALITIES:
            if _too_large(small, quality, most):
                continue
            url = _url(small, "webp", quality=quality, method=1)
            if len(url) <= most:
                return url, size
            if len(url) > GIVEN_UP * most:  # no quality would do
                break
        scale *= SHRINK
    return _url(small, "webp", quality=QUALITIES[-1], method=1), size


def _too_large(picture: Image.Image, quality: int, most: int) -> bool:
    """Whether a large picture would be, by every eighth of its rows of blocks, in an eighth of the time.

    By half more than what is asked for: the rows are a sample, and lines between them that do not belong together take
    bytes of their own.
    """
    if picture.width * picture.height < PROBED_PX:
        return False
    rows = np.arange(picture.height)
    some = np.asarray(picture)[rows // BLOCK % EVERY == 0]
    return EVERY * len(_url(Image.fromarray(some), "webp", quality=quality, method=1)) > 1.5 * most


def greys(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    """A picture as it is shown, 8 bits; one of 8 bits that `greys` gave stays as it is."""
    if isinstance(image, _Shown):
        return image
    shown: NDArray[np.uint8] = (255 * np.nan_to_num(stretched(image))).astype(np.uint8)
    return shown.view(_Shown)


class _Shown(np.ndarray):
    """Marks pixels that are stretched already."""


def thumbnail(image: NDArray[np.generic], most: int, side: int = 260) -> str:
    """A small picture for an index."""
    grey = greys(image)
    step = max(1, min(grey.shape[:2]) // side)
    return preview(grey[::step, ::step], most)[0]


NAME_WIDE = 0.8
"""Width of a letter of a name over a picture, by its height: capitals and figures of a bold face."""


@dataclass
class Overlay:
    """What is drawn over a picture of (width, height) pixels; layers that can be switched off.

    ``layers``: name -> (words with their colour, drawing).
    """

    size_px: tuple[int, int]
    layers: dict[str, tuple[str, str]] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    _boxes: list[tuple[float, float, float, float]] = field(default_factory=list)

    def spots(self, spots: Detections, kind: NDArray[np.bool_], notes: Sequence[str], words: tuple[str, str]) -> None:
        """Circles of matched (``kind`` True) and spare spots; ``words`` for the two."""
        self.rings(spots.xy, np.maximum(1.8 * np.nan_to_num(spots.radius_px, nan=3.0), 5.0), kind, notes, words)

    def rings(
        self, xy: Array, radius: Array, kind: NDArray[np.bool_], notes: Sequence[str], words: tuple[str, str]
    ) -> None:  # fmt: skip
        """`spots` at places (K, 2), with the radii (K,) of their circles."""
        drawn = "".join(
            f'<circle class="{"matched" if of else "spare"}" cx="{x:.2f}" cy="{y:.2f}" r="{r:.1f}">'
            f"<title>{escape(note)}</title></circle>"
            for (x, y), r, of, note in zip(xy.tolist(), radius.tolist(), kind.tolist(), notes, strict=True)
        )
        said = _key("#00c853", words[0]) + ("" if kind.all() else _key("#ff9100", words[1]))
        self.layers["spots"] = (said, f'<g class="spots">{drawn}</g>')

    def circles(self, layer: str, xy: Array, radius: Array, notes: Sequence[str], words: str, colour: str) -> None:
        """Broken circles (K,) of a layer of their own, each with its note: candidates, not spots."""
        drawn = "".join(
            f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{r:.1f}"><title>{escape(note)}</title></circle>'
            for (x, y), r, note in zip(xy.tolist(), radius.tolist(), notes, strict=True)
        )
        style = f"stroke: {colour}; stroke-width: 1.5; stroke-dasharray: 4 3"
        self.layers[layer] = _key(colour, words), f'<g style="{style}">{drawn}</g>'

    def missing(self, xy: Array, names: Sequence[str], words: str) -> None:
        """Diamonds where markers were expected."""
        if not len(xy):
            return
        drawn = "".join(
            f'<path class="missing" d="M{x - 7:.1f} {y:.1f}l7 -7 7 7 -7 7z"><title>{escape(n)}: {escape(words)}</title>'
            "</path>" for (x, y), n in zip(xy.tolist(), names, strict=True)
        )  # fmt: skip
        self.layers["missing"] = (_key("#ff1744", words, "diamond"), f'<g class="missings">{drawn}</g>')
        self._name(xy, names, "of-missing")

    def residuals(self, xy: Array, residual: Array, names: Sequence[str], words: str) -> None:
        """Residual vectors, magnified as it is said."""
        rms = float(np.sqrt(np.mean(np.sum(residual**2, axis=1)))) if len(residual) else 0.0
        factor = max(1.0, round_length(0.03 * self.size_px[0] / rms)) if rms > 0 else 1.0
        drawn = "".join(f"M{x:.1f} {y:.1f}l{factor * u:.1f} {factor * v:.1f}"
                        for (x, y), (u, v) in zip(xy.tolist(), residual.tolist(), strict=True))  # fmt: skip
        self.layers["residuals"] = (_key("#c9b800", f"{words} × {factor:g}", "dash"),
                                    f'<path class="residual residuals" d="{drawn}"/>')  # fmt: skip
        self._name(xy, names, "of-matched")

    def lines(
        self, layer: str, lines: Sequence[Array], words: str, colour: str, width: float = 1.4, key: str = "dash"
    ) -> None:
        """Lines (N, 2) of a layer of their own, ``width`` pixels of the screen wide; ``key``: its sign."""
        drawn = "".join("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in line.tolist())
                        for line in lines if np.isfinite(line).all())  # fmt: skip
        style = f"stroke: {colour}; stroke-width: {width:g}"
        self.layers[layer] = (_key(colour, words, key), f'<path class="{layer}" style="{style}" d="{drawn}"/>')

    def together(self, layers: Sequence[str], name: str, words: str) -> None:
        """Several layers as one with one switch, in the first one's place."""
        drawn = "".join(self.layers[layer][1] for layer in layers)
        self.layers = {name if k == layers[0] else k: (_key("#8a94a3", words, "dash"), drawn) if k == layers[0] else v
                       for k, v in self.layers.items() if k not in layers[1:]}  # fmt: skip

    def names_at(self, xy: Array, names: Sequence[str]) -> None:
        """Names beside places (K, 2), in the layer of all names."""
        self._name(xy, names, "of-matched")

    def wires(self, lines: Sequence[Array], words: str, most: int = FIRST.wires) -> None:
        """Lines of the projected grid, as many as fit."""
        for every in (1, 2, 4, 8):
            drawn = "".join(polyline(line, 1.5 * every) for line in lines[::every])
            if len(drawn) <= most:
                break
        if drawn:
            self.layers["wires"] = (_key("#00a3b5", words, "dash"), f'<path class="wires" d="{drawn}"/>')

    def _name(self, xy: Array, names: Sequence[str], style: str) -> None:
        step = self.size_px[0] / 110
        for name, (x, y) in zip(names, xy.tolist(), strict=True):
            right = x > 0.93 * self.size_px[0]
            anchor = ' text-anchor="end"' if right else ""
            base = y - 0.7 * step if y > 2 * step else y + 1.6 * step  # below what is at the upper border
            crowded = self._crowded(x + (-step if right else step), base, len(name), right=right)
            self.names.append(f'<text class="{style}{crowded}" x="{x + (-step if right else step):.1f}" '
                              f'y="{base:.1f}"{anchor}>{escape(name)}</text>')  # fmt: skip

    def _crowded(self, x: float, y: float, letters: int, *, right: bool) -> str:
        """A class for a name that would be written over another one: it is shown when the picture is zoomed."""
        high = self.size_px[0] / 95
        wide = NAME_WIDE * high * letters
        box = (x - wide if right else x, y - 0.8 * high, x if right else x + wide, y + 0.2 * high)
        if any(o[0] < box[2] and box[0] < o[2] and o[1] < box[3] and box[1] < o[3] for o in self._boxes):
            return " crowded"
        self._boxes.append(box)
        return ""

    def html(self, url: str, caption: str) -> str:
        """The whole figure; layers have boxes to switch them, which say what their colour means."""
        layers = dict(self.layers)
        if self.names:
            layers["names"] = ("names", f'<g class="names">{"".join(self.names)}</g>')
        boxes = "".join(f'<label><input type="checkbox" checked data-layer="{name}"> {words}</label>'
                        for name, (words, _) in layers.items())  # fmt: skip
        width, height = self.size_px
        point = "Point at a ring to read its numbers. " if any("<title>" in svg for _, svg in layers.values()) else ""
        drawn = "".join(f'<g data-of="{name}">{svg}</g>' for name, (_, svg) in layers.items())
        return (
            f'<figure class="wm-photo"><div class="wm-layers">{boxes}</div>'
            f'<div class="wm-zoom" tabindex="0" style="--name: {width / 95:.1f}px; --shape: {width / height:.3f}"><div>'
            f'<img alt="{escape(caption)}" src="{url}" width="{width}" height="{height}">'
            f'<svg viewBox="-0.5 -0.5 {width} {height}" preserveAspectRatio="none">{drawn}</svg></div></div>'
            f'<figcaption>{escape(caption)} <span class="wm-screen">{point}Click and turn the wheel, or double-click, '
            "to zoom to the pixel; drag to move; Esc shows all.</span></figcaption></figure>"
        )


def tiles(image: NDArray[np.generic], xy: Array, projected: Array, names: Sequence[str], notes: Sequence[str]) -> str:
    """The pixels round spots (K, 2), as they are: green where the spot is, yellow where its marker should be."""
    grey = greys(image)
    height, width = grey.shape[:2]
    out = []
    for (x, y), (u, v), name, note in zip(xy.tolist(), projected.tolist(), names, notes, strict=True):
        i, j = round(x), round(y)
        x0, x1, y0, y1 = max(i - TILE, 0), min(i + TILE + 1, width), max(j - TILE, 0), min(j + TILE + 1, height)
        if x1 <= x0 or y1 <= y0:
            continue
        url = _url(Image.fromarray(grey[y0:y1, x0:x1]), "png", compress_level=9)
        out.append(
            f'<div><svg viewBox="{i - TILE - 0.5} {j - TILE - 0.5} {2 * TILE + 1} {2 * TILE + 1}">'
            f'<image href="{url}" x="{x0 - 0.5}" y="{y0 - 0.5}" width="{x1 - x0}" height="{y1 - y0}" '
            'preserveAspectRatio="none"/>'
            f'<path d="M{x - 3:.2f} {y:.2f}h6M{x:.2f} {y - 3:.2f}v6"/>'
            f'<path class="projected" d="M{u - 2:.2f} {v - 2:.2f}l4 4M{u - 2:.2f} {v + 2:.2f}l4 -4"/></svg>'
            f"{escape(name)}<br>{escape(note)}</div>"
        )
    return f'<div class="wm-tiles">{"".join(out)}</div>' if out else ""


def scale_bar(size_px: tuple[int, int], units_per_px: float, unit: str, valid: NDArray[np.bool_]) -> str:
    """A bar of a round length in the corner that shows least of the surface."""
    width, height = size_px
    length = round_length(0.2 * width * units_per_px)
    pixels = length / units_per_px
    places = [(x, y) for y in (0.96 * height, 0.08 * height) for x in (0.03 * width, 0.97 * width - pixels)]

    def covered(place: tuple[float, float]) -> float:
        x, y = max(int(place[0]), 0), int(place[1])
        # Of a view of a few pixels it covers one at least.
        rows = slice(max(y - height // 12, 0), max(y + height // 50, y + 1))
        return float(valid[rows, x : max(int(place[0] + pixels), x + 1)].mean())

    x, y = min(places, key=covered)
    return (f'<path class="residual" style="stroke-width: 4" d="M{x:.1f} {y:.1f}h{pixels:.1f}"/>'
            f'<text x="{x:.1f}" y="{y - 0.012 * height:.1f}">{length:g} {escape(unit)}</text>')  # fmt: skip


def polyline(line: Array, step: float) -> str:
    """Relative path of a line, points closer than ``step`` pixels left out, tenths of a pixel."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    kept = np.flatnonzero(np.diff(along // (12 * step), prepend=-1.0, append=np.inf)[:-1] != 0)
    if kept[-1] != len(line) - 1:  # the first one always is
        kept = np.append(kept, len(line) - 1)
    at = np.rint(line[kept] * 10)
    if not np.isfinite(at).all():
        return ""
    moves = np.diff(at, axis=0) / 10
    return f"M{at[0, 0] / 10:g} {at[0, 1] / 10:g}l" + " ".join(f"{u:g} {v:g}" for u, v in moves.tolist())


def _key(colour: str, words: str, shape: str = "") -> str:
    style = f' class="{shape}"' if shape else ""
    return f'<i{style} style="color: {colour}"></i>{escape(words)} '


def _url(picture: Image.Image, kind: str, **how: int) -> str:
    stream = byte_io.BytesIO()
    picture.save(stream, kind, **how)
    return f"data:image/{kind};base64,{base64.b64encode(stream.getvalue()).decode('ascii')}"
