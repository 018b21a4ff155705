"""Small charts as SVG: sharp at any size, light and dark with the page, a few kB."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LINE_COLOURS = ("#1f77b4", "#e07b00", "#2a9d3a", "#c2185b", "#7e57c2", "#00838f", "#8d6e63", "#6b7a00")
LETTER, WIDE_LETTER = 7.2, 11.0
"""Widths of letters in pixels of a chart."""
MOST_POINTS = 1500
"""Points of a curve that are drawn: more than there are pixels."""


@dataclass
class Chart:
    """Axes with ticks and labels; what is drawn is put into ``parts``.

    Parameters
    ----------
    x, y : (low, high) of the axes; y may fall upwards
    labels : of the axes, with units
    title : above
    size : width and height in CSS pixels
    equal : one unit is as long along both axes
    """

    x: tuple[float, float]
    y: tuple[float, float]
    labels: tuple[str, str]
    title: str = ""
    size: tuple[int, int] = (900, 300)
    equal: bool = False
    parts: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.left, self.right, self.top, self.bottom = 68, 14, 28, 44
        self.x, self.y = _proper(self.x), _proper(self.y)
        if self.equal:
            wide, high = self.size[0] - self.left - self.right, self.size[1] - self.top - self.bottom
            per = max(abs(self.x[1] - self.x[0]) / wide, abs(self.y[1] - self.y[0]) / high)
            self.x, self.y = _grown(self.x, per * wide), _grown(self.y, per * high)

    def at(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Pixels of the chart."""
        width, height = self.size
        u = (np.asarray(x, dtype=float) - self.x[0]) / (self.x[1] - self.x[0])
        v = (np.asarray(y, dtype=float) - self.y[0]) / (self.y[1] - self.y[0])
        return (self.left + u * (width - self.left - self.right),
                height - self.bottom - v * (height - self.top - self.bottom))  # fmt: skip

    def curve(self, x: Array, y: Array, colour: str, name: str = "") -> None:
        """A line with gaps where a number is missing, thinned to what can be seen."""
        step = -(-len(x) // MOST_POINTS)
        u, v = self.at(x[::step], y[::step])
        good, words, pen = np.isfinite(u) & np.isfinite(v), [], "M"
        for a, b, drawn in zip(u.tolist(), v.tolist(), good.tolist(), strict=True):
            if not drawn:
                pen = "M"
                continue
            words.append(f"{pen}{a:.1f} {b:.1f}")
            pen = "L"
        tip = f"<title>{escape(name)}</title>" if name else ""
        self.parts.append(f'<path class="curve" stroke="{colour}" d="{"".join(words)}">{tip}</path>')

    def dots(self, x: Array, y: Array, notes: Sequence[str], names: Sequence[str] = ()) -> None:
        """Dots that say what they are under the cursor; ``names`` are written beside them where there is room."""
        u, v = (part.tolist() for part in self.at(x, y))
        taken = [(a - 3, b - 3, a + 3, b + 3) for a, b in zip(u, v, strict=True)]
        for k, (a, b) in enumerate(zip(u, v, strict=True)):
            self.parts.append(f'<circle class="dot" cx="{a:.1f}" cy="{b:.1f}" r="3.5"><title>{escape(notes[k])}</title>'
                              "</circle>")  # fmt: skip
            if k < len(names):
                self._name(a, b, names[k], taken)

    def _name(self, a: float, b: float, name: str, taken: list[tuple[float, float, float, float]]) -> None:
        """A name at one of the four corners of a dot: the first where it lies over no other name or dot, else none."""
        wide = sum(WIDE_LETTER if letter in "mwMW" else LETTER for letter in name)
        for right, above in ((True, True), (True, False), (False, True), (False, False)):
            left, top = a + 5 if right else a - 5 - wide, b - 13 if above else b + 2
            box = (left, top, left + wide, top + 11)
            inside = self.left < box[0] and box[2] < self.size[0] - self.right
            inside &= self.top < box[1] and box[3] < self.size[1] - self.bottom
            if inside and not any(o[0] < box[2] and box[0] < o[2] and o[1] < box[3] and box[1] < o[3] for o in taken):
                taken.append(box)
                self.parts.append(f'<text x="{left:.1f}" y="{top + 9:.1f}">{escape(name)}</text>')
                return

    def circle(self, radius: float) -> None:
        """A circle round the origin, for axes of equal scale."""
        (a, b), (c, _) = (self.at(np.array(r), np.array(0.0)) for r in (0.0, radius))
        self.parts.append(f'<circle class="ring" cx="{a:.1f}" cy="{b:.1f}" r="{abs(c - a):.1f}"/>')

    def legend(self, entries: Sequence[tuple[str, str]]) -> None:
        """Names with their colours, in the upper right corner."""
        for k, (colour, name) in enumerate(entries):
            y = self.top + 12 + 14 * k
            x = self.size[0] - self.right - 10
            self.parts.append(f'<text x="{x - 22}" y="{y}" text-anchor="end">{escape(name)}</text>'
                              f'<path d="M{x - 17} {y - 4}h17" stroke="{colour}" stroke-width="2"/>')  # fmt: skip

    def svg(self) -> str:
        """The whole drawing."""
        width, height = self.size
        low, high = height - self.bottom, self.top
        out = [f'<svg class="chart" viewBox="0 0 {width} {height}" width="{width}" height="{height}" role="img" '
               f'aria-label="{escape(self.title)}">']  # fmt: skip
        about = max(3, (width - self.left) // 110), max(3, (height - self.top) // 55)
        marks = ticks(*self.x, about[0])
        for t, text in zip(marks, tick_texts(marks), strict=True):
            a = float(self.at(np.array(t), np.array(self.y[0]))[0])
            out.append(f'<path class="grid" d="M{a:.1f} {low}V{high}"/><text x="{a:.1f}" y="{low + 16}" '
                       f'text-anchor="middle">{text}</text>')  # fmt: skip
        marks = ticks(min(self.y), max(self.y), about[1])
        for t, text in zip(marks, tick_texts(marks), strict=True):
            b = float(self.at(np.array(self.x[0]), np.array(t))[1])
            out.append(f'<path class="grid" d="M{self.left} {b:.1f}H{width - self.right}"/><text x="{self.left - 6}" '
                       f'y="{b + 4:.1f}" text-anchor="end">{text}</text>')  # fmt: skip
        out.append(f'<rect class="axis" x="{self.left}" y="{high}" width="{width - self.left - self.right}" '
                   f'height="{low - high}"/>')  # fmt: skip
        middle = (self.left + width - self.right) / 2
        out.append(f'<text x="{middle}" y="{height - 8}" text-anchor="middle">{escape(self.labels[0])}</text>')
        across = (low + high) / 2
        out.append(f'<text transform="translate(14 {across}) rotate(-90)" text-anchor="middle">'
                   f"{escape(self.labels[1])}</text>")  # fmt: skip
        out.append(f'<text class="title" x="{middle}" y="17" text-anchor="middle">{escape(self.title)}</text>')
        return "".join((*out, *self.parts, "</svg>"))


def ticks(low: float, high: float, about: int = 6) -> list[float]:
    """Round numbers from low to high: 1, 2, 5 times a power of ten apart, about so many and at least two."""
    span = high - low
    if not np.isfinite(span) or span <= 0:
        return [low]
    power = 10.0 ** np.floor(np.log10(span / about))
    step = next(m for m in (1, 2, 5, 10) if m * power >= span / about * (1 - 1e-9)) * power
    first, last = int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9))
    return [float(k * step) for k in range(first, last + 1)] if last > first else ticks(low, high, about + 1)


def tick_texts(marks: Sequence[float]) -> list[str]:
    """Ticks as text, all with the same number of decimals."""
    step = marks[1] - marks[0] if len(marks) > 1 else abs(marks[0]) or 1.0
    largest = max(abs(t) for t in marks)
    if largest >= 1e6 or 0 < largest < 1e-4:
        digits = max(0, int(np.floor(np.log10(largest))) - int(np.floor(np.log10(step) + 1e-9)))
        return ["0" if t == 0 else f"{t:.{digits}e}".replace("-", "−") for t in marks]
    decimals = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    return [f"{0.0 if abs(t) < 1e-9 * step else t:.{decimals}f}".replace("-", "−") for t in marks]


def _proper(span: tuple[float, float]) -> tuple[float, float]:
    """Axes of a finite length, whatever the data."""
    low, high = (float(v) if np.isfinite(v) else d for v, d in zip(span, (0.0, 1.0), strict=True))
    return (low, high) if low != high else (low - 0.5 * (abs(low) or 1.0), high + 0.5 * (abs(high) or 1.0))


def _grown(span: tuple[float, float], length: float) -> tuple[float, float]:
    middle, sign = (span[0] + span[1]) / 2, 1.0 if span[1] > span[0] else -1.0
    return middle - sign * length / 2, middle + sign * length / 2
