"""Surfaces without a marker, drawn by Pillow on a grid `FINE` times finer than the pixels; beside `_clutter`'s.

Nothing here is a disc: no letter that is one or has one as a dot (o, 0, i, j, full stops), no round rivet seen face on
in even light.
"""

from __future__ import annotations

import string
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import gaussian_filter

Array = NDArray[np.float64]
FINE = 4
SIZE = 640  # px along a side
FONTS = ("cmr10", "cmss10", "cmtt10", "cmb10", "STIXGeneral", "STIXGeneralBol", "STIXGeneralItalic", "DejaVuSans",
         "DejaVuSans-Bold", "DejaVuSerif")  # fmt: skip
WITH_ROUND = "oO0ij"  # discs by any measure, or with one as a dot
LETTERS = "".join(c for c in string.ascii_letters + string.digits if c not in WITH_ROUND)


class Canvas:
    """A picture of ink, 0 ... 255 (255 takes all the light)."""

    def __init__(self) -> None:
        self.image = Image.new("L", (SIZE * FINE, SIZE * FINE), 0)
        self.draw = ImageDraw.Draw(self.image)

    def polygon(self, corners: Array, ink: float) -> None:
        """Corners (N, 2) in px."""
        self.draw.polygon([tuple(p) for p in (corners + 0.5) * FINE], fill=round(255 * ink))

    def share(self) -> Array:
        """What the surface throws back, by pixels."""
        fine = 1.0 - np.asarray(self.image, dtype=float) / 255
        return np.asarray(fine.reshape(SIZE, FINE, SIZE, FINE).mean(axis=(1, 3)))


def turned(corners: Array, angle: float, xy: Array) -> Array:
    """Corners turned about the origin and moved."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(corners @ np.array([[c, s], [-s, c]]) + xy)


def places(rng: np.random.Generator, cell: float) -> Array:
    """Jittered places."""
    count = int((SIZE - 20) / cell)
    grid = np.stack(np.meshgrid(np.arange(count), np.arange(count)), axis=-1).reshape(-1, 2)
    return np.asarray(10 + (grid + 0.5) * cell + rng.uniform(-0.15, 0.15, (len(grid), 2)) * cell)


def box(width: float, height: float) -> Array:
    """Corners round the origin."""
    return np.array([[-width, -height], [width, -height], [width, height], [-width, height]]) / 2


def page(rng: np.random.Generator, radius: float) -> Array:
    """Lines of text in one font."""
    import matplotlib

    canvas, y = Canvas(), 8.0
    while y < SIZE - 12:
        height = radius * rng.uniform(2.5, 7)
        file = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / f"{rng.choice(FONTS)}.ttf"
        font = ImageFont.truetype(str(file), int(height * FINE))
        words = " ".join("".join(rng.choice(list(LETTERS), rng.integers(2, 8))) for _ in range(40))
        ink = round(255 * rng.uniform(0.5, 0.85))
        canvas.draw.text((rng.uniform(0, 20) * FINE, y * FINE), words, fill=ink, font=font)
        y += 1.4 * height
    return canvas.share()


def squares(rng: np.random.Generator, radius: float) -> Array:
    """Filled squares and rectangles at any angle."""
    canvas = Canvas()
    for p in places(rng, 5 * radius + 10):
        side = radius * rng.uniform(1.3, 2.4)
        canvas.polygon(turned(box(side, side * rng.uniform(0.65, 1)), rng.uniform(0, np.pi), p), 0.7)
    return canvas.share()


def polygons(rng: np.random.Generator, radius: float) -> Array:
    """Triangles, L, T, stars, arrows, half discs."""
    canvas = Canvas()
    for p in places(rng, 5 * radius + 10):
        size, kind = radius * rng.uniform(0.9, 1.6), rng.integers(5)
        t = np.linspace(0, 2 * np.pi, 13)[:-1]
        shape = (
            np.array([[-1, -0.8], [1, -0.8], [0, 1.1]]),
            np.array([[-1, -1], [1, -1], [1, -0.3], [-0.3, -0.3], [-0.3, 1], [-1, 1]]),
            np.array([[-1, -1], [1, -1], [1, -0.4], [0.35, -0.4], [0.35, 1], [-0.35, 1], [-0.35, -0.4], [-1, -0.4]]),
            np.stack([np.cos(t), np.sin(t)], axis=1) * np.where(np.arange(12) % 2, 0.5, 1.2)[:, None],
            np.stack([np.cos(t[:7]), np.sin(t[:7])], axis=1),
        )[kind]
        canvas.polygon(turned(size * shape, rng.uniform(0, 2 * np.pi), p), rng.uniform(0.4, 0.8))
    return canvas.share()


def scratches(rng: np.random.Generator, radius: float) -> Array:
    """Long thin lines with kinks that cross each other, and short ones."""
    canvas = Canvas()
    for _ in range(220):
        count = int(rng.integers(2, 5))
        steps = rng.uniform(0.5, 12) * radius * np.stack([np.cos(a := rng.uniform(0, 6.3) + rng.normal(0, 0.3, count)),
                                                          np.sin(a)], axis=1)  # fmt: skip
        path = rng.uniform(0, SIZE, 2) + np.cumsum(np.concatenate([[[0, 0]], steps]), axis=0)
        width = max(1, round(radius * rng.uniform(0.2, 0.9) * FINE))
        canvas.draw.line([tuple(p) for p in path * FINE], fill=round(255 * rng.uniform(0.3, 0.8)), width=width)
    return canvas.share()


def chips(rng: np.random.Generator, radius: float) -> Array:
    """Flakes: outlines whose corners are far in and far out."""
    canvas = Canvas()
    for p in places(rng, 5 * radius + 10):
        count = int(rng.integers(5, 9))
        t = np.sort(rng.uniform(0, 2 * np.pi, count))
        far = np.where(np.arange(count) % 2, rng.uniform(0.25, 0.6, count), rng.uniform(0.9, 1.5, count))
        canvas.polygon(turned(radius * far[:, None] * np.stack([np.cos(t), np.sin(t)], axis=1), 0, p),
                       rng.uniform(0.4, 0.8))  # fmt: skip
    return canvas.share()


def crosses(rng: np.random.Generator, radius: float) -> Array:
    """Two bars."""
    canvas = Canvas()
    for p in places(rng, 5 * radius + 10):
        length, turn = radius * rng.uniform(1.8, 3.5), rng.uniform(0, np.pi)
        for angle in (turn, turn + rng.uniform(1.2, 1.9)):
            canvas.polygon(turned(box(length, length * rng.uniform(0.15, 0.33)), angle, p), 0.7)
    return canvas.share()


def checkers(rng: np.random.Generator, radius: float) -> Array:
    """A turned board."""
    canvas, cell, turn = Canvas(), radius * rng.uniform(1.6, 5), rng.uniform(0, np.pi / 2)
    many = int(SIZE / cell)
    for i in range(-many, many):
        for j in range(-many, many):
            if (i + j) % 2:
                canvas.polygon(turned(box(cell, cell) + np.array([i, j]) * cell, turn, np.full(2, SIZE / 2)), 0.6)
    return canvas.share()


def bricks(rng: np.random.Generator, radius: float) -> Array:
    """Bricks with joints, each of its own grey, and grain."""
    canvas, high = Canvas(), radius * rng.uniform(2, 5)
    wide, joint = high * rng.uniform(2, 3), max(0.12 * high, 1.0)
    for row in range(int(SIZE / high) + 1):
        for k in range(-1, int(SIZE / wide) + 2):
            corner = np.array([(k + 0.5 * (row % 2)) * wide, row * high])
            brick = np.array([[joint, joint], [wide, joint], [wide, high], [joint, high]])
            canvas.polygon(corner + brick, rng.uniform(0.2, 0.5))
    grain = gaussian_filter(rng.normal(size=(SIZE, SIZE)), 1.3)
    return canvas.share() * (1 + 0.05 * grain / grain.std())


def wood(rng: np.random.Generator, radius: float) -> Array:
    """Grain along one direction, bent, with streaks."""
    y, x = np.mgrid[:SIZE, :SIZE].astype(float)
    bent = gaussian_filter(rng.normal(size=(SIZE, SIZE)), 40)
    rings = np.sin(2 * np.pi * (y / (radius * rng.uniform(2, 5)) + 0.6 * bent / bent.std() + 0.002 * x))
    fibre = gaussian_filter(rng.normal(size=(SIZE, SIZE)), (0.7, 12))
    return np.asarray(np.clip(0.75 + 0.12 * rings + 0.08 * fibre / fibre.std(), 0.05, 1.3))


def grains(rng: np.random.Generator, radius: float) -> Array:
    """Strong texture: noise of several lengths at once, skewed as rough castings are."""
    total = np.zeros((SIZE, SIZE))
    for length in radius * np.array([0.3, 0.6, 1.2]):
        layer = gaussian_filter(rng.normal(size=(SIZE, SIZE)), length)
        total += layer / layer.std()
    total /= total.std()
    return np.asarray(np.clip(0.75 + 0.1 * total - 0.03 * total**2, 0.05, 1.3))


def moire(rng: np.random.Generator, radius: float) -> Array:
    """Two gratings."""
    y, x = np.mgrid[:SIZE, :SIZE].astype(float)
    out, turn, period = np.ones((SIZE, SIZE)), rng.uniform(0, np.pi), radius * rng.uniform(1.2, 3)
    for _ in range(2):
        out *= 1 - 0.35 * (1 + np.tanh(3 * np.sin(2 * np.pi * (x * np.cos(turn) + y * np.sin(turn)) / period))) / 2
        turn, period = turn + np.radians(rng.uniform(3, 12)), period * rng.uniform(0.92, 1.08)
    return out


def dust(rng: np.random.Generator, radius: float) -> Array:
    """Many small splinters, some of them in heaps."""
    canvas = Canvas()
    for _ in range(1500):
        middle = rng.uniform(0, SIZE, 2)
        for _ in range(1 if rng.random() < 0.7 else 3):
            length = radius * rng.uniform(0.2, 0.8)
            canvas.polygon(turned(box(length, length * rng.uniform(0.15, 0.5)), rng.uniform(0, np.pi),
                                  middle + rng.normal(0, 0.3 * radius, 2)), rng.uniform(0.1, 0.8))  # fmt: skip
    return canvas.share()


def rivets(rng: np.random.Generator, radius: float) -> Array:
    """Domed heads with glare on one side, shade on the other, and a cast shadow."""
    out, sun = np.ones((SIZE, SIZE)), rng.uniform(0, 2 * np.pi)
    y, x = np.mgrid[:SIZE, :SIZE].astype(float)
    light = np.array([np.cos(sun), np.sin(sun), 0.8])
    for p in places(rng, 6 * radius + 12):
        head = radius * rng.uniform(0.8, 1.6)
        j, i = (slice(max(int(c - 3 * head - 4), 0), int(c + 3 * head + 5)) for c in p[::-1])
        u, v = (x[j, i] - p[0]) / head, (y[j, i] - p[1]) / head
        soft = 1 / (1 + np.exp(np.clip(8 * head * (np.hypot(u + 0.5 * light[0], v + 0.5 * light[1]) - 1), -50, 50)))
        inside = 1 / (1 + np.exp(np.clip(8 * head * (np.hypot(u, v) - 1), -50, 50)))
        high = np.sqrt(np.clip(1.2 - u**2 - v**2, 0.05, None))
        shade = (u * light[0] + v * light[1] + high * light[2]) / np.sqrt(u**2 + v**2 + high**2) / np.linalg.norm(light)
        dome = np.clip(0.3 + 0.7 * shade + 0.5 * np.clip(shade, 0, 1) ** 12, 0.05, 1.5)
        out[j, i] = (out[j, i] * (1 - 0.4 * soft)) * (1 - inside) + dome * inside
    return out


KINDS: dict[str, Callable[[np.random.Generator, float], Array]] = {
    "text": page, "squares": squares, "polygons": polygons, "scratches": scratches, "chips": chips, "crosses": crosses,
    "checkers": checkers, "bricks": bricks, "wood": wood, "grains": grains, "moire": moire, "dust": dust,
    "rivets": rivets,
}  # fmt: skip


def picture(
    kind: str, radius: float, seed: int, bright: bool, kinds: dict[str, Callable[..., Array]] = KINDS
) -> NDArray[np.uint8]:
    """Grey levels of a surface of things of about a radius, dark on light or bright on dark."""
    rng = np.random.default_rng([seed, round(1000 * radius), *kind.encode()])
    share = gaussian_filter(kinds[kind](rng, radius), 0.6, mode="nearest")
    y, x = np.mgrid[:SIZE, :SIZE] / SIZE
    uneven = 1 + 0.15 * np.sin(3 * x + rng.uniform(0, 6)) * np.cos(2 * y + rng.uniform(0, 6))
    clean = 60 + 150 * (1 - share) if bright else 180 * share * uneven
    return np.clip(np.rint(clean + rng.normal(0, 2, share.shape)), 0, 255).astype(np.uint8)
