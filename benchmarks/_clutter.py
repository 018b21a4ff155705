"""What is no marker, drawn by OpenCV and Pillow on a grid `FINE` times finer than the pixels.

A scene is the share of the light that the surface throws back (1 is bare paint). Every painter darkens it; nothing that
it draws is a filled ellipse of the markers' size: squares, letters (no font with round dots), rings, crosses, boards,
gratings, streaks, specks, screws, rivets, chips of paint, grain.
"""

from __future__ import annotations

import string
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from _sensor import grain

Array = NDArray[np.float64]
Picture = NDArray[np.float32]
FINE = 4
FONTS = ("DejaVuSans", "DejaVuSans-Bold", "DejaVuSerif", "DejaVuSansMono", "DejaVuSans-Oblique")
CHARACTERS = string.ascii_letters + string.digits + "%&#@+-=,.:;()!?"
STROKED = "".join(c for c in string.ascii_letters + string.digits + "+-=()#" if c not in "ij")  # no round dots


def _fill(fine: Picture, corners: Array, contrast: float) -> None:
    """A polygon (N, 2) in px, darkened."""
    points = np.rint((corners + 0.5) * FINE * 16 - 8).astype(np.int32)
    low = np.clip(((corners.min(axis=0) - 2) * FINE).astype(int), 0, len(fine))
    high = np.clip(((corners.max(axis=0) + 3) * FINE).astype(int), 0, len(fine))
    part = fine[low[1] : high[1], low[0] : high[0]]
    mask = np.zeros(part.shape, np.uint8)
    cv2.fillPoly(mask, [points - (low * 16).astype(np.int32)], 1, shift=4)
    part *= 1 - np.float32(contrast) * mask


def _turned(points: Array, xy: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[c, s], [-s, c]]) + xy)


def _round(radius: float, count: int = 60) -> Array:
    t = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return radius * np.stack([np.cos(t), np.sin(t)], axis=1)


def _box(width: float, height: float) -> Array:
    return np.array([[-width, -height], [width, -height], [width, height], [-width, height]]) / 2


def _squares(fine: Picture, xy: Array, radius: float, rng: np.random.Generator) -> None:
    for p in xy:
        side = 1.77 * radius * rng.uniform(0.8, 1.25)
        _fill(fine, _turned(_box(side, side * rng.choice([1, 1, 0.7])), p, rng.uniform(0, np.pi)), 0.7)


def _rings(fine: Picture, xy: Array, radius: float, rng: np.random.Generator) -> None:
    for p in xy:
        outer = radius * rng.uniform(0.8, 1.8)
        inner = outer * rng.uniform(0.5, 0.8)
        tilt = np.array([1, rng.uniform(0.5, 1)])
        ring = np.concatenate([_round(outer) * tilt, _round(outer)[:1] * tilt, _round(inner)[:1] * tilt,
                               _round(inner)[::-1] * tilt])  # fmt: skip
        _fill(fine, _turned(ring, p, rng.uniform(0, np.pi)), 0.7)


def _crosses(fine: Picture, xy: Array, radius: float, rng: np.random.Generator) -> None:
    for p in xy:
        length, turn = radius * rng.uniform(1.6, 4), rng.uniform(0, np.pi)
        width, skew = max(length * rng.uniform(0.12, 0.33), 1.0), rng.uniform(1.2, 1.9)
        arm = _box(length, width)
        _fill(fine, _turned(arm, p, turn), 0.7)
        _fill(fine, _turned(arm, p, turn + skew), 0.7)


def _checkers(fine: Picture, xy: Array, radius: float, rng: np.random.Generator) -> None:
    size = len(fine)
    for x0, y0 in np.ndindex(2, 2):
        cell, turn = radius * rng.uniform(1.8, 6), rng.uniform(0, np.pi)
        half = size // 2
        odd = (_wave(half, turn, 2 * cell) > 0) != (_wave(half, turn + np.pi / 2, 2 * cell) > 0)
        fine[y0 * half : (y0 + 1) * half, x0 * half : (x0 + 1) * half] *= 1 - np.float32(0.6) * odd


def _moire(fine: Picture, xy: Array, radius: float, rng: np.random.Generator) -> None:
    turn, period = rng.uniform(0, np.pi), rng.uniform(3.5, 9)
    for _ in range(2):
        fine *= 1 - np.float32(0.4) * (_wave(len(fine), turn, period) > 0)
        turn, period = turn + np.radians(rng.uniform(2, 10)), period * rng.uniform(0.93, 1.07)


def _wave(size: int, turn: float, period: float) -> Picture:
    """A sine of a period in px along a direction; the product formula saves a sine per sub-pixel."""
    place = np.arange(size) * (2 * np.pi / (period * FINE))
    x, y = place * np.cos(turn), place * np.sin(turn)
    one = np.outer(np.cos(y), np.sin(x)) + np.outer(np.sin(y), np.cos(x))
    return np.asarray(one, dtype=np.float32)


def _streaks(fine: Picture, xy: Array, radius: float, rng: np.random.Generator) -> None:
    for p in xy:
        width = radius * rng.uniform(0.3, 0.9)
        length = width * rng.uniform(5, 14)
        ends = _round(0.5, 40) * [length, width]
        _fill(fine, _turned(ends, p, rng.uniform(0, np.pi)), rng.uniform(0.3, 0.8))


def _particles(fine: Picture, xy: Array, radius: float, rng: np.random.Generator) -> None:
    for p in xy:
        for _ in range(3):
            place, small = p + rng.uniform(-15, 15, 2), rng.uniform(0.12, 0.4) * radius
            _fill(fine, _round(small) + place, rng.uniform(0.1, 0.8))


def _chips(fine: Picture, xy: Array, radius: float, rng: np.random.Generator) -> None:
    """Spots of flaked paint, none of which is an ellipse (see `ragged`)."""
    for p in xy:
        _fill(fine, _turned(ragged(radius * rng.uniform(0.7, 1.5), rng), p, rng.uniform(0, np.pi)),
              rng.uniform(0.4, 0.8))  # fmt: skip


def ragged(radius: float, rng: np.random.Generator) -> Array:
    """An outline (N, 2) with 5 to 10 corners that shares less than 0.8 of its area with the ellipse of its moments."""
    while True:
        count = int(rng.integers(5, 11))
        rim = _round(1.0, count) * rng.uniform(0.45, 1.3, count)[:, None] * [1, rng.uniform(0.5, 1)]
        mask, whole = np.zeros((64, 64), np.uint8), np.zeros((64, 64), np.uint8)
        cv2.fillPoly(mask, [np.rint(rim * 20 + 32).astype(np.int32)], 1)
        y, x = np.nonzero(mask)
        spread, turn = np.linalg.eigh(np.cov(x, y))
        angle = np.degrees(np.arctan2(turn[1, 1], turn[0, 1]))
        axes = 2 * np.sqrt(spread)
        cv2.ellipse(whole, ((x.mean(), y.mean()), (2 * axes[1], 2 * axes[0]), float(angle)), 1, -1)
        if (mask & whole).sum() < 0.8 * (mask | whole).sum():
            return np.asarray(radius * rim)


def _screws(fine: Picture, xy: Array, radius: float, rng: np.random.Generator) -> None:
    for p in xy:
        head, turn = radius * rng.uniform(1.6, 3), rng.uniform(0, np.pi)
        _fill(fine, _round(head) + p, 0.5)
        _fill(fine, _round(0.85 * head) + p, -0.7)
        slots = (turn, turn + np.pi / 2) if rng.random() < 0.5 else (turn,)
        for angle in slots:
            _fill(fine, _turned(_box(1.3 * head, 0.3 * head), p, angle), 0.6)


def _rivets(fine: Picture, xy: Array, radius: float, rng: np.random.Generator) -> None:
    """Round heads lit from one side: a bright half, a dark half, and a shadow beside them."""
    sun = rng.uniform(0, 2 * np.pi)
    light = np.array([np.cos(sun), np.sin(sun)])
    for p in xy:
        head = radius * rng.uniform(0.8, 1.6)
        _fill(fine, _round(head) + p - 0.4 * head * light, 0.35)
        reach = int((head + 1) * FINE)
        x, y = (np.rint(p * FINE)).astype(int)
        part = fine[y - reach : y + reach, x - reach : x + reach]
        v, u = (np.mgrid[: len(part), : part.shape[1]] - reach) / (head * FINE)
        dome = np.hypot(u, v) < 1
        part[dome] = (0.95 + 0.4 * (u * light[0] + v * light[1]))[dome]


def _text(fine: Picture, xy: Array, radius: float, rng: np.random.Generator) -> None:
    import matplotlib
    from PIL import Image, ImageDraw, ImageFont

    size = len(fine)
    for p in xy[:: max(1, len(xy) // 90)]:
        height = radius * rng.uniform(2.5, 8)
        canvas = Image.new("L", (size // 3, size // 10), 0)
        words = "".join(rng.choice(list(CHARACTERS), 8))
        if rng.random() < 0.7:
            file = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / f"{rng.choice(FONTS)}.ttf"
            font = ImageFont.truetype(str(file), max(int(height * FINE), 8))
            ImageDraw.Draw(canvas).text((4, 4), words, fill=255, font=font)
            mask = np.asarray(canvas)
        else:
            mask = np.zeros((size // 10, size // 3), np.uint8)
            words = "".join(rng.choice(list(STROKED), 8))
            thick = max(int(height * FINE / 9), 1)
            cv2.putText(mask, words, (8, int(height * FINE) + 8), int(rng.choice([0, 2, 3])), height * FINE / 22, 255,
                        thick, cv2.LINE_AA)  # fmt: skip
        down, across = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        mask = mask[down[0] : down[-1] + 1, across[0] : across[-1] + 1]
        mask = _rotated(mask, rng.choice([0.0, 0.0, 90.0, rng.uniform(0, 360)]))
        _lay(fine, mask, p * FINE - 20, 0.75)


def _letters(fine: Picture, xy: Array, radius: float, rng: np.random.Generator) -> None:
    import matplotlib
    from PIL import Image, ImageDraw, ImageFont

    for p in xy:
        height = radius * rng.uniform(2.0, 5.0)
        file = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / f"{rng.choice(FONTS)}.ttf"
        font = ImageFont.truetype(str(file), max(int(height * FINE), 8))
        wide = int(1.6 * height * FINE)
        canvas = Image.new("L", (wide, wide), 0)
        letter = str(rng.choice(list("oOeaDQ8B690GCScsxX@%&")))
        ImageDraw.Draw(canvas).text((wide // 5, wide // 8), letter, fill=255, font=font)
        _lay(fine, _rotated(np.asarray(canvas), rng.uniform(0, 360)), p * FINE - wide / 2, 0.75)


def _rotated(mask: NDArray, degrees: float) -> NDArray:
    h, w = mask.shape
    turn = cv2.getRotationMatrix2D((w / 2, h / 2), float(degrees), 1.0)
    side = int(np.hypot(h, w)) + 2
    turn[:, 2] += (np.array([side - w, side - h])) / 2
    return np.asarray(cv2.warpAffine(mask, turn, (side, side)))


def _lay(fine: Picture, mask: NDArray, corner: Array, contrast: float) -> None:
    """A mask of 0 ... 255 laid on the scene with its top left at a place (fine px), as far as it is inside."""
    x, y = np.rint(corner).astype(int)
    x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + mask.shape[1], len(fine)), min(y + mask.shape[0], len(fine))
    if x1 > x0 and y1 > y0:
        part = mask[y0 - y : y1 - y, x0 - x : x1 - x]
        fine[y0:y1, x0:x1] *= 1 - np.float32(contrast / 255) * part


def _texture(fine: Picture, xy: Array, radius: float, rng: np.random.Generator) -> None:
    size = len(fine) // FINE
    paint = 1 + rng.choice([0.05, 0.08, 0.12]) * grain((size, size), rng.choice([1.0, 1.6, 2.4, 3.5]), rng)
    fine *= cv2.resize(paint.astype(np.float32), fine.shape[::-1], interpolation=cv2.INTER_NEAREST)


PAINTERS: dict[str, Callable[[Picture, Array, float, np.random.Generator], None]] = {
    "text": _text, "letters": _letters, "texture": _texture, "squares": _squares, "rings": _rings,
    "crosses": _crosses, "checkers": _checkers, "moire": _moire, "streaks": _streaks, "particles": _particles,
    "chips": _chips, "screws": _screws, "rivets": _rivets,
}  # fmt: skip
OVERALL = ("text", "texture", "checkers", "moire", "particles")
