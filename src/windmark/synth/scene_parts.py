"""What flat scenes (`windmark.synth.scenes`) are made of besides markers: light, warm air, dirt and lettering."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from windmark.synth import marks
from windmark.synth.marks import Marks, distance

Array = NDArray[np.float64]
Rng = np.random.Generator

HAND_PX = 3.5  # "radius of a marker" to which lettering, tape and scratches are scaled
ON_LINES = 0.06  # share of the markers that a line or a scratch crosses


@dataclass(frozen=True)
class Light:
    """Smooth light, the exponential of a sum, so that it is positive and its relative slope is simple.

    Parameters
    ----------
    mean : logarithm of the level
    tilt : (2,) logarithmic slope per pixel over the whole image
    lamps : (K, 4) x, y, width (standard deviation, px), logarithmic strength of Gaussian spots
    edges : (E, 5) x, y of a point, direction (cosine, sine) across, width w of a soft shadow edge, and
        half its logarithmic step: step * tanh(distance / w)
    """

    mean: float
    tilt: Array
    lamps: Array
    edges: Array

    @staticmethod
    def random(rng: Rng, size: tuple[int, int]) -> Light:
        """Lamps and two shadow edges of 1.5 to 4 % per pixel; the brightest place has about 0.85 of full scale."""
        scale, span = np.array(size, dtype=float), float(np.hypot(*size))
        lamps = np.column_stack(
            [
                rng.uniform(0, 1, (4, 2)) * scale,
                np.maximum(span * rng.uniform(0.06, 0.25, 4), 120.0),
                rng.uniform(-0.4, 0.5, 4),
            ]
        )
        step, steepest = 0.5 * np.log(rng.uniform(1.4, 2.2, 2)), rng.uniform(0.015, 0.04, 2)
        turn = rng.uniform(0, 2 * np.pi, 2)
        across = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        edges = np.column_stack([rng.uniform(0.15, 0.85, (2, 2)) * scale, across, step / steepest, step])
        raw = Light(0.0, rng.uniform(-0.35, 0.35, 2) / scale, lamps, edges)
        level = raw.level(np.linspace(0, scale[0], 65), np.linspace(0, scale[1], 65)[:, None])
        return Light(float(np.log(0.85 / level.max())), raw.tilt, lamps, edges)

    def level(self, x: Array, y: Array) -> Array:
        """Light at x, y (they broadcast)."""
        total = self.mean + self.tilt[0] * x + self.tilt[1] * y
        for cx, cy, width, strength in self.lamps:
            # A product of two exponentials: cheap on a whole image, where x is a row and y a column.
            spot = np.exp(-0.5 * ((x - cx) / width) ** 2) * np.exp(-0.5 * ((y - cy) / width) ** 2)
            total = total + strength * spot
        for cx, cy, c, s, width, step in self.edges:
            total = total + step * np.tanh((c * (x - cx) + s * (y - cy)) / width)
        return np.exp(total)

    def slope(self, x: Array, y: Array) -> Array:
        """Gradient of the light over the light, (..., 2) in 1/px."""
        gx, gy = self.tilt[0] + 0 * x, self.tilt[1] + 0 * y
        for cx, cy, width, strength in self.lamps:
            spot = strength / width**2 * np.exp(-0.5 * ((x - cx) ** 2 + (y - cy) ** 2) / width**2)
            gx, gy = gx - spot * (x - cx), gy - spot * (y - cy)
        for cx, cy, c, s, width, step in self.edges:
            steep = step / width * (1 - np.tanh((c * (x - cx) + s * (y - cy)) / width) ** 2)
            gx, gy = gx + c * steep, gy + s * steep
        return np.stack([gx, gy], axis=-1)


def warm_background(rng: Rng, size: tuple[int, int]) -> tuple[Array, Light]:
    """A smooth warm surface in fractions of full scale: spots some 30 px and more wide, and a transition edge."""
    scale = np.array(size, dtype=float)
    lamps = np.column_stack([rng.uniform(0, 1, (5, 2)) * scale, rng.uniform(30, 150, 5), rng.uniform(-0.03, 0.05, 5)])
    turn = rng.uniform(0, 2 * np.pi)
    edge = [
        *(rng.uniform(0.2, 0.8, 2) * scale),
        np.cos(turn),
        np.sin(turn),
        rng.uniform(8, 20),
        rng.uniform(0.01, 0.03),
    ]
    light = Light(float(np.log(0.4)), rng.uniform(-0.1, 0.1, 2) / scale, lamps, np.array([edge]))
    return light.level(np.arange(size[0], dtype=float), np.arange(size[1], dtype=float)[:, None]), light


def scene_clutter(rng: Rng, size: tuple[int, int], xy: Array, axes: Array, share: float) -> Marks:
    """Everything on a cluttered surface that is not a marker; ``share`` scales the numbers of 2048 x 2048 px.

    Specks (radius 0.5 to 1.2 px) and thin scratches fall anywhere; lines and scratches are laid across `ON_LINES` of
    the markers; what would hide a marker (block, tape, lettering, fittings) keeps clear of them.
    """

    def some(number: float) -> int:
        return int(rng.poisson(number * share))

    clear: list[Marks] = [_block(rng) for _ in range(max(1, round(share)))]
    clear += [marks.tape(rng, HAND_PX) for _ in range(some(4))]
    clear += [marks.word(rng, HAND_PX) for _ in range(some(14))]
    clear += [_fitting(rng) for _ in range(some(40))]
    free = [marks.scratch(rng, HAND_PX) for _ in range(some(30))] + [_line(rng) for _ in range(some(3))]
    free += [_speck(rng) for _ in range(round(440 * share))] + [_glint(rng) for _ in range(round(60 * share))]
    out = [m for item in clear if (m := _placed(rng, item, size, xy, axes.max() + 3.0)) is not None]
    out += [m for item in free if (m := _placed(rng, item, size, xy, None)) is not None]
    for k in rng.choice(len(xy), max(1, round(ON_LINES * len(xy))), replace=False):
        item = _line(rng) if rng.uniform() < 0.5 else marks.scratch(rng, HAND_PX)
        turn = rng.uniform(0, 2 * np.pi)
        along, across = rng.uniform(-0.3, 0.3) * 2 * item.half[0, 0], rng.uniform(-0.9, 0.9) * axes[k, 1]
        c, s = np.cos(turn), np.sin(turn)
        out.append(item.turned(turn, xy[k] + along * np.array([c, s]) + across * np.array([-s, c])))
    return marks.join(out)


def _placed(rng: Rng, item: Marks, size: tuple[int, int], xy: Array, clearance: float | None) -> Marks | None:
    """An item at a random place and angle, no nearer to the points than the clearance; None if 50 tries fail."""
    for _ in range(50):
        m = item.turned(rng.uniform(0, 2 * np.pi), rng.uniform(-0.5, np.array(size) - 0.5))
        if clearance is None:
            return m
        near = xy[np.hypot(*(xy - m.center.mean(axis=0)).T) < 2 * m.reach.max() + clearance + 50]
        if not len(near) or (distance(m, near) - m.outer).min() >= clearance:
            return m
    return None


def _speck(rng: Rng) -> Marks:
    return Marks.make([0, 0], outer=rng.uniform(0.5, 1.2), contrast=rng.uniform(0.2, 0.85))


def _glint(rng: Rng) -> Marks:
    return Marks.make([0, 0], outer=rng.uniform(0.4, 1.0), contrast=-rng.uniform(0.1, 0.5))


def _line(rng: Rng) -> Marks:
    """A line drawn with a pen, or a joint: 0.8 to 2.5 px wide, 150 to 900 px long."""
    half = (rng.uniform(75, 450), 0.0)
    return Marks.make([0, 0], half=half, outer=rng.uniform(0.4, 1.25), contrast=rng.uniform(0.2, 0.6))


def _fitting(rng: Rng) -> Marks:
    """A pressure fitting: a ring of radius 4 to 9 px, some with a tap of radius 0.6 to 1.1 px in the middle."""
    radius, contrast = rng.uniform(4, 9), rng.uniform(0.15, 0.5)
    ring = Marks.make([0, 0], outer=radius, inner=radius - rng.uniform(0.7, 1.6), contrast=contrast)
    if rng.uniform() < 0.4:
        return ring
    tap = Marks.make([0, 0], outer=rng.uniform(0.6, 1.1), contrast=rng.uniform(0.4, 0.8))
    return marks.join([ring, tap])


def _block(rng: Rng) -> Marks:
    """An unpainted insert: a black rectangle of 80 to 200 px."""
    return Marks.make([0, 0], half=rng.uniform(40, 100, 2), outer=0.2, contrast=rng.uniform(0.75, 0.9))


def draw_all(image: Array, items: Marks) -> Array:
    """The image with all marks in it; long lines by `draw_line`, whose cost grows with the length, not its square."""
    long = (items.half[:, 0] > 30) & (items.half[:, 1] + items.outer < 5)

    def some(chosen: NDArray[np.bool_]) -> Marks:
        return Marks(*(getattr(items, f.name)[chosen] for f in fields(Marks)))

    out = marks.draw(image, some(~long))
    for k in np.flatnonzero(long):
        out = draw_line(out, some(np.arange(len(items)) == k))
    return out


def draw_line(image: Array, line: Marks, *, subpixels: int = 5) -> Array:
    """As `windmark.synth.marks.draw`, for one long thin mark: only the pixels along it are looked at."""
    height, width = image.shape
    c, s, outer = np.cos(line.angle[0]), np.sin(line.angle[0]), line.outer[0]
    wide = line.half[0, 1] + outer + 1.5
    t = np.arange(-line.half[0, 0] - outer - 1.5, line.half[0, 0] + outer + 1.5, 0.5)[:, None]
    o = np.arange(-wide, wide + 0.5, 0.5)
    x = np.rint(line.center[0, 0] + c * t - s * o).astype(int).ravel()
    y = np.rint(line.center[0, 1] + s * t + c * o).astype(int).ravel()
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    flat = np.unique(y[inside] * width + x[inside])
    sub = (np.arange(subpixels) + 0.5) / subpixels - 0.5
    points = np.stack(
        np.broadcast_arrays((flat % width)[:, None, None] + sub, (flat // width)[:, None, None] + sub[:, None]), axis=-1
    )
    d = distance(line, points)[..., 0]
    # A step one sub-pixel wide on either side of the stroke: thin strokes need both.
    across = d + 2 * line.half[0].min()
    near, far = (np.clip(0.5 + v * subpixels, 0, 1) for v in (outer - d, outer + across))
    out = image.copy()
    out.flat[flat] *= 1 - line.contrast[0] * np.maximum(near + far - 1, 0).mean(axis=(1, 2))
    return out
