"""More surfaces without a marker: what `_nothing` and `_clutter` lack, drawn with NumPy and other fonts.

`KINDS` have no disc. `ROUND` have printed discs or what no picture tells from one: full stops, the dots of i, a filled
o, screw heads, highlights out of focus. What is found there is no mistake of the decision; it counts apart.
"""

from __future__ import annotations

import io
import string
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

from _nothing import FINE, LETTERS, SIZE, Canvas, box, places, turned

Array = NDArray[np.float64]
SYMBOLS = "#%&*+-=<>?/\\$@^~{}[]()"
FOLDERS = ("/usr/share/fonts/truetype/liberation", "/usr/share/fonts/truetype/dejavu")


@cache
def fonts() -> tuple[str, ...]:
    """Fonts of the system, else Matplotlib's; those with plain letters."""
    import matplotlib

    own = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    files = sorted(f for folder in FOLDERS for f in Path(folder).glob("*.ttf")) or sorted(own.glob("DejaVu*.ttf"))
    return tuple(str(f) for f in files)


def written(rng: np.random.Generator, radius: float, letters: str) -> Array:
    """Words of some letters, each turned by its own angle, in any font of the system."""
    canvas = Canvas()
    for p in places(rng, 14 * radius + 10):
        font = ImageFont.truetype(str(rng.choice(fonts())), int(radius * rng.uniform(2, 9) * FINE))
        word = "".join(rng.choice(list(letters), rng.integers(1, 5)))
        left, top, right, bottom = font.getbbox(word)
        ink = Image.new("L", (int(right - left) + 8, int(bottom - top) + 8), 0)
        ImageDraw.Draw(ink).text((4 - left, 4 - top), word, fill=round(255 * rng.uniform(0.4, 0.9)), font=font)
        ink = ink.rotate(rng.choice([0.0, 90.0, rng.uniform(0, 360)]), Image.Resampling.BICUBIC, expand=True)
        x, y = p * FINE - np.array(ink.size) / 2
        canvas.image.paste(ink, (int(x), int(y)), ink)
    return canvas.share()


def labels(rng: np.random.Generator, radius: float) -> Array:
    """Letters and symbols without a round dot."""
    return written(rng, radius, LETTERS + "".join(c for c in SYMBOLS if c not in "%?"))


def field(rng: np.random.Generator, slope: float, radius: float, aspect: float = 1.0) -> Array:
    """Noise of unit variance whose power falls off with the frequency, flat below that of ten radii."""
    v, u = np.meshgrid(np.fft.fftfreq(SIZE), np.fft.rfftfreq(SIZE), indexing="ij")
    amplitude = np.maximum(np.hypot(u, v * aspect), 0.05 / radius) ** (-slope / 2)
    out = np.fft.irfft2(np.fft.rfft2(rng.normal(size=(SIZE, SIZE))) * amplitude, s=(SIZE, SIZE))
    return np.asarray((out - out.mean()) / out.std())


def fractal(rng: np.random.Generator, radius: float) -> Array:
    """1/f noise of power 1.5 to 3.5: rough paint, plaster, clouds."""
    return np.clip(0.75 + rng.uniform(0.05, 0.12) * field(rng, rng.uniform(1.5, 3.5), radius), 0.05, 1.3)


def patina(rng: np.random.Generator, radius: float) -> Array:
    """1/f noise cut at a level: patches of every size with fringed outlines."""
    noise = gaussian_filter(field(rng, rng.uniform(2, 3), radius), 0.15 * radius)
    return np.asarray(1 - rng.uniform(0.3, 0.7) / (1 + np.exp(-12 * (noise / noise.std() - rng.uniform(0.8, 1.8)))))


def cells(rng: np.random.Generator, radius: float) -> Array:
    """Cells (Voronoi), each of its own grey, with or without dark walls: hammered paint, foam, pebbles."""
    seeds = rng.uniform(-10, SIZE + 10, (int((SIZE / (radius * rng.uniform(2, 4))) ** 2), 2))
    fine = (np.arange(2 * SIZE) + 0.5) / 2 - 0.5
    grid = np.stack(np.meshgrid(fine, fine), axis=-1).reshape(-1, 2)
    distance, index = cKDTree(seeds).query(grid, k=2)
    wall = np.clip((distance[:, 1] - distance[:, 0]) / (0.3 * radius), 0, 1)
    grey = 0.8 + rng.uniform(0, 0.1) * rng.normal(size=len(seeds))[index[:, 0]]
    out = np.where(rng.random() < 0.5, grey * (0.5 + 0.5 * wall), 1.0 - 0.5 * wall * (index[:, 0] % 3 == 0))
    return np.asarray(np.clip(out, 0.05, 1.3).reshape(SIZE, 2, SIZE, 2).mean(axis=(1, 3)))


def pebbles(rng: np.random.Generator, radius: float) -> Array:
    """Rounded lumps that touch, lit from one side: orange peel, shot-blasted metal."""
    seeds = rng.uniform(-10, SIZE + 10, (int((SIZE / (2.2 * radius)) ** 2), 2))
    grid = np.stack(np.meshgrid(np.arange(SIZE), np.arange(SIZE)), axis=-1).reshape(-1, 2)
    distance = cKDTree(seeds).query(grid)[0].reshape(SIZE, SIZE)
    height = np.sqrt(np.maximum(1 - (distance / (1.6 * radius)) ** 2, 0.0))
    gy, gx = np.gradient(gaussian_filter(height, 0.7))
    sun = rng.uniform(0, 2 * np.pi)
    return np.clip(0.7 + rng.uniform(0.3, 0.8) * (gx * np.cos(sun) + gy * np.sin(sun)), 0.05, 1.3)


def brushed(rng: np.random.Generator, radius: float) -> Array:
    """Brushed metal: long fine grooves in one direction, some deep."""
    out = field(rng, 0.8, radius, aspect=1.0) * 0.02
    for length in (6, 20, 60):
        layer = gaussian_filter(rng.normal(size=(SIZE, SIZE)), (0.5, length))
        out += 0.05 * layer / layer.std()
    deep = gaussian_filter((rng.random((SIZE, SIZE)) < 0.0006).astype(float), (0.15 * radius, 3 * radius))
    return np.asarray(np.clip(0.8 + out - 0.5 * deep / deep.max(), 0.05, 1.3))


def fabric(rng: np.random.Generator, radius: float) -> Array:
    """Plain or twill weave with threads over and under, slightly bent and turned."""
    y, x = np.mgrid[:SIZE, :SIZE].astype(float)
    bend, turn = gaussian_filter(rng.normal(size=(2, SIZE, SIZE)), (0, 30, 30)), rng.uniform(0, np.pi)
    pitch, ply = radius * rng.uniform(1.5, 4), int(rng.integers(2, 5))
    x, y = x + 2 * bend[0] / bend[0].std(), y + 2 * bend[1] / bend[1].std()
    u, v = (x * np.cos(turn) + y * np.sin(turn)) / pitch, (y * np.cos(turn) - x * np.sin(turn)) / pitch
    over = (np.floor(u) + np.floor(v)) % ply == 0
    across = np.where(over, u - np.floor(u), v - np.floor(v)) - 0.5
    along = np.where(over, v - np.floor(v), u - np.floor(u)) - 0.5
    return np.asarray(np.clip(0.85 * (1 - 2.2 * across**2) * (1 - 0.8 * along**2) - 0.15 * over, 0.05, 1.2))


def gaps(rng: np.random.Generator, radius: float) -> Array:
    """Panel gaps: straight and bent dark lines that cross, end and meet, steps of grey beside them, tape."""
    canvas = Canvas()
    for _ in range(40):
        a, length, turn = rng.uniform(0, SIZE, 2), rng.uniform(30, 400), rng.choice([0, np.pi / 2, rng.uniform(0, 3)])
        width = radius * rng.uniform(0.2, 1.6)
        canvas.polygon(turned(box(length, width), turn, a), rng.uniform(0.3, 0.9))
        if rng.random() < 0.5:  # a short stub at an end
            end = a + 0.5 * length * np.array([np.cos(turn), np.sin(turn)])
            canvas.polygon(turned(box(width * rng.uniform(1, 3), width), turn + rng.uniform(0, 3), end), 0.6)
    return canvas.share()


def fixed(rng: np.random.Generator, radius: float) -> Array:
    """An infrared camera's fixed pattern, as its own correction smears it: columns, rows, dead and hot pixels alone and
    in clusters of 2 to 9.
    """
    out = 0.85 + 0.02 * rng.normal(size=(1, SIZE)) + 0.01 * rng.normal(size=(SIZE, 1))
    out = out + 0.03 * rng.normal(size=(SIZE, SIZE)) + 0.05 * field(rng, 3.0, 8 * radius)
    for _ in range(600):
        x, y = rng.integers(2, SIZE - 6, 2)
        shape = rng.choice([1, 1, 1, 2, 3], 2)
        out[y : y + shape[0], x : x + shape[1]] -= rng.uniform(0.1, 0.7) * rng.choice([-1, 1])
    return np.asarray(np.clip(out, 0.02, 1.3))


def vignette(rng: np.random.Generator, radius: float) -> Array:
    """The edge of a porthole, brackets and cables in front of the picture."""
    y, x = np.mgrid[:SIZE, :SIZE] / SIZE - 0.5
    far = np.hypot(x - rng.uniform(-0.1, 0.1), y - rng.uniform(-0.1, 0.1))
    out = 1 / (1 + np.exp((far - rng.uniform(0.3, 0.5)) * SIZE / (0.3 * radius))) * 0.9 + 0.06
    canvas = Canvas()
    for _ in range(12):
        path = rng.uniform(0, SIZE, 2) + np.cumsum(rng.normal(0, 12, (30, 2)) + rng.normal(0, 10, 2), axis=0)
        canvas.draw.line([tuple(p) for p in path * FINE], fill=200, width=int(radius * rng.uniform(0.5, 3) * FINE),
                         joint="curve")  # fmt: skip
    return out * (0.15 + 0.85 * canvas.share()) * (1 + 0.03 * field(rng, 2.0, radius))


def reflections(rng: np.random.Generator, radius: float) -> Array:
    """Glare on wavy lacquer: caustics of a random height field."""
    height = gaussian_filter(rng.normal(size=(SIZE, SIZE)), radius * rng.uniform(1.2, 3))
    gy, gx = np.gradient(height / height.std())
    y, x = np.mgrid[:SIZE, :SIZE].astype(float)
    throw, hits = radius**2 * rng.uniform(0.8, 3), np.zeros((SIZE, SIZE))
    for dx, dy in np.ndindex(3, 3):
        i = np.rint(x + dx / 3 + throw * map_coordinates(gx, [y + dy / 3, x + dx / 3], order=1, mode="nearest"))
        j = np.rint(y + dy / 3 + throw * map_coordinates(gy, [y + dy / 3, x + dx / 3], order=1, mode="nearest"))
        good = (i >= 0) & (i < SIZE) & (j >= 0) & (j < SIZE)
        np.add.at(hits, (j[good].astype(int), i[good].astype(int)), 1 / 9)
    return np.clip(1.1 - 0.18 * gaussian_filter(hits, 0.5), 0.05, 1.1)


def blotches(rng: np.random.Generator, radius: float) -> Array:
    """Water stains, oil: overlapping soft spots of every depth, elongated."""
    out = np.zeros((SIZE, SIZE))
    for stretch in rng.uniform(1.7, 3, 6):
        drops = np.where(rng.random((SIZE, SIZE)) < 0.0015, rng.exponential(1.0, (SIZE, SIZE)), 0.0)
        width = radius * rng.uniform(0.5, 1.2)
        layer = gaussian_filter(drops, (width, width * stretch))
        out += layer * width * width * stretch
    return np.asarray(np.clip(1 - 1.5 * out, 0.1, 1.0))


def speckle(rng: np.random.Generator, radius: float) -> Array:
    """Laser speckle of about the marker's size."""
    wave = gaussian_filter(rng.normal(size=(2, SIZE, SIZE)), (0, 0.5 * radius, 0.5 * radius))
    power = (wave**2).sum(axis=0)
    return np.clip(power / power.mean() * 0.35 + 0.1, 0.05, 1.3)


def strokes(rng: np.random.Generator, radius: float) -> Array:
    """Handwriting: bent pen lines with round ends and loops."""
    canvas, pen = Canvas(), radius * rng.uniform(0.3, 0.9)
    for p in places(rng, 7 * radius + 10):
        t = np.linspace(0, 1, 400)[:, None]
        a, b, c = rng.normal(0, 2.2 * radius, (3, 2))
        path = p + a * t + b * np.sin(np.pi * rng.uniform(0.7, 3) * t) + c * np.cos(np.pi * rng.uniform(0.7, 3) * t)
        ink = round(255 * rng.uniform(0.4, 0.9))
        for x, y in path * FINE:
            h = pen * FINE / 2
            canvas.draw.ellipse((x - h, y - h, x + h, y + h), fill=ink)
    return canvas.share()


def stops(rng: np.random.Generator, radius: float) -> Array:
    """Letters with round dots or round themselves, and punctuation."""
    return written(rng, radius, "oO0ijeac" + ".:;,!?%" + string.digits)


def heads(rng: np.random.Generator, radius: float) -> Array:
    """Screw heads with a slot or a cross of little contrast, seen from above in even light."""
    canvas = Canvas()
    for p in places(rng, 6 * radius + 12):
        head, turn, ink = radius * rng.uniform(0.8, 1.5), rng.uniform(0, np.pi), rng.uniform(0.4, 0.7)
        t = np.linspace(0, 2 * np.pi, 60)
        canvas.polygon(p + head * np.stack([np.cos(t), np.sin(t)], axis=1), ink)
        for angle in (turn, turn + np.pi / 2)[: rng.integers(1, 3)]:
            canvas.polygon(turned(box(1.6 * head, 0.25 * head), angle, p), ink * rng.uniform(0.3, 0.8))
    return canvas.share()


def bokeh(rng: np.random.Generator, radius: float) -> Array:
    """Highlights out of focus: discs of five blades to round, of any brightness, that overlap."""
    layers = [Canvas(), Canvas(), Canvas()]
    for k in range(120):
        blades, size, p = int(rng.choice([5, 6, 7, 40])), radius * rng.uniform(0.7, 2), rng.uniform(0, SIZE, 2)
        t = 2 * np.pi * np.arange(blades) / blades + rng.uniform(0, 6)
        layers[k % 3].polygon(p + size * np.stack([np.cos(t), np.sin(t)], axis=1), rng.uniform(0.2, 0.7))
    return np.asarray(np.clip(1 - sum(1 - layer.share() for layer in layers), 0.1, 1.0))


KINDS: dict[str, Callable[[np.random.Generator, float], Array]] = {
    "labels": labels, "fractal": fractal, "patina": patina, "cells": cells, "pebbles": pebbles, "brushed": brushed,
    "fabric": fabric, "gaps": gaps, "fixed pattern": fixed, "vignette": vignette, "reflections": reflections,
    "blotches": blotches, "speckle": speckle, "strokes": strokes,
}  # fmt: skip
ROUND: dict[str, Callable[[np.random.Generator, float], Array]] = {"stops": stops, "heads": heads, "bokeh": bokeh}


def squeezed(image: NDArray[np.uint8], quality: int = 60) -> NDArray[np.uint8]:
    """The picture after JPEG."""
    file = io.BytesIO()
    Image.fromarray(image).save(file, "JPEG", quality=quality)
    return np.asarray(Image.open(file))
