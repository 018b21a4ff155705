"""Dark things that are not markers: specks, scratches, rings, lettering, tape, blocks.

One primitive draws them all: the points whose distance to a rectangle (half sides a, b; a point or
a segment when zero) lies between two radii. It is used flat in an image (`draw`) and, placed in
tangent planes, as paint on the model (`decals`). Sizes are relative to the marker's radius.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Rng = np.random.Generator


@dataclass(frozen=True)
class Marks:
    """K marks in a plane (pixels, or lengths in a tangent plane), as columns.

    Parameters
    ----------
    center : (K, 2)
    angle : (K,) direction of the rectangle's first side, radians from x to y
    half : (K, 2) half sides of the rectangle
    outer, inner : (K,) radii; a point belongs to the mark where inner <= distance <= outer
        (inner < 0: filled)
    contrast : (K,) the light falls to 1 - contrast; negative for bright marks
    """

    center: Array
    angle: Array
    half: Array
    outer: Array
    inner: Array
    contrast: Array

    @staticmethod
    def make(
        center: ArrayLike,
        *,
        outer: ArrayLike,
        contrast: ArrayLike,
        angle: ArrayLike = 0.0,
        half: ArrayLike = (0.0, 0.0),
        inner: ArrayLike = -1.0,
    ) -> Marks:
        """Marks from what differs between them; scalars are repeated."""
        c = np.asarray(center, dtype=float).reshape(-1, 2)
        k = len(c)
        angles, outers, inners, contrasts = (
            np.array(np.broadcast_to(np.asarray(v, dtype=float), (k,))) for v in (angle, outer, inner, contrast)
        )
        halves = np.array(np.broadcast_to(np.asarray(half, dtype=float), (k, 2)))
        return Marks(c, angles, halves, outers, inners, contrasts)

    def __len__(self) -> int:
        return len(self.center)

    def turned(self, angle: float, shift: ArrayLike) -> Marks:
        """Turned about the origin by an angle in radians, then shifted."""
        c, s = np.cos(angle), np.sin(angle)
        center = self.center @ np.array([[c, s], [-s, c]]) + np.asarray(shift, dtype=float)
        return Marks(center, self.angle + angle, self.half, self.outer, self.inner, self.contrast)

    @property
    def reach(self) -> Array:
        """(K,) radius of the circle round the centre that holds the mark."""
        return np.hypot(self.half[:, 0], self.half[:, 1]) + self.outer


def join(marks: Sequence[Marks]) -> Marks:
    """Several sets as one."""
    if not marks:
        return Marks.make(np.zeros((0, 2)), outer=0.0, contrast=0.0)
    return Marks(*(np.concatenate([getattr(m, f.name) for m in marks]) for f in fields(Marks)))


# --- one item of each kind, round the origin; r is the marker's radius ------------------------


def speck(rng: Rng, r: float) -> Marks:
    """A grain of dirt or a drop of paint, up to the size of a small marker."""
    return Marks.make([0, 0], outer=r * rng.uniform(0.08, 0.45), contrast=rng.uniform(0.2, 0.85))


def bright_speck(rng: Rng, r: float) -> Marks:
    """A grain that shines."""
    return Marks.make([0, 0], outer=r * rng.uniform(0.08, 0.3), contrast=-rng.uniform(0.2, 0.8))


def scratch(rng: Rng, r: float) -> Marks:
    """A thin straight line."""
    length, width = r * rng.uniform(4, 16), r * rng.uniform(0.05, 0.2)
    return Marks.make([0, 0], half=(length / 2, 0), outer=width / 2, contrast=rng.uniform(0.15, 0.6))


def ring(rng: Rng, r: float) -> Marks:
    """A pressure fitting: a ring with a tap in its middle."""
    radius, width = r * rng.uniform(1.0, 2.2), r * rng.uniform(0.15, 0.35)
    contrast = rng.uniform(0.25, 0.6)
    outer, inner = np.array([radius, 0.25 * radius]), np.array([radius - width, -1.0])
    return Marks.make(np.zeros((2, 2)), outer=outer, inner=inner, contrast=contrast)


def word(rng: Rng, r: float) -> Marks:
    """Strokes that look like a few letters written with a pen."""
    height, pen, letters = r * rng.uniform(2.5, 5.0), r * rng.uniform(0.15, 0.3), int(rng.integers(3, 7))
    box = np.array([0.55 * height, height])
    a, b = rng.uniform(-0.5, 0.5, (2, 3 * letters, 2)) * box
    # Letters are made of long strokes: one end is pushed to the border of the letter's box.
    a[:, 1] = np.where(a[:, 1] > b[:, 1], 0.5, -0.5) * height
    shift = np.repeat((np.arange(letters) - (letters - 1) / 2) * 0.85 * height, 3)
    center = 0.5 * (a + b) + np.stack([shift, np.zeros_like(shift)], axis=1)
    d = b - a
    half = np.stack([0.5 * np.hypot(d[:, 0], d[:, 1]), np.zeros(len(d))], axis=1)
    return Marks.make(center, angle=np.arctan2(d[:, 1], d[:, 0]), half=half, outer=pen / 2, contrast=0.7)


def tape(rng: Rng, r: float) -> Marks:
    """A strip of tape: slightly darker, with sharp dark edges."""
    length, width, edge = r * rng.uniform(15, 40), r * rng.uniform(3, 6), 0.08 * r
    center = np.array([[0, 0], [0, width / 2], [0, -width / 2]])
    half = np.array([[length / 2, width / 2], [length / 2, 0], [length / 2, 0]])
    return Marks.make(center, half=half, outer=edge, contrast=[rng.uniform(0.08, 0.2), 0.35, 0.35])


def block(rng: Rng, r: float) -> Marks:
    """A dark rectangle, such as an unpainted insert."""
    half = r * rng.uniform(4, 9, 2)
    return Marks.make([0, 0], half=half, outer=0.05 * r, contrast=rng.uniform(0.75, 0.92))


@dataclass(frozen=True)
class Clutter:
    """How many things of each kind."""

    specks: int = 60
    bright_specks: int = 20
    scratches: int = 8
    rings: int = 6
    words: int = 2
    tapes: int = 1
    blocks: int = 0

    def items(self, rng: Rng, radius: float) -> list[Marks]:
        """The items round the origin, large ones first."""
        kinds: list[tuple[Callable[[Rng, float], Marks], int]] = [
            (block, self.blocks), (tape, self.tapes), (word, self.words), (ring, self.rings),
            (scratch, self.scratches), (bright_speck, self.bright_specks), (speck, self.specks),
        ]  # fmt: skip
        return [kind(rng, radius) for kind, count in kinds for _ in range(count)]


# --- in an image ------------------------------------------------------------------------------


def scatter(
    items: Sequence[Marks],
    size_px: tuple[int, int],
    rng: Rng,
    *,
    keep_clear: ArrayLike = (),
    clearance_px: float = 0.0,
) -> Marks:
    """Items at random places and angles of an image, as one set of marks.

    An item that would come nearer than ``clearance_px`` (border to point) to one of the points
    ``keep_clear`` (N, 2) is tried again up to 50 times and then left out.
    """
    clear = np.asarray(keep_clear, dtype=float).reshape(-1, 2)
    placed = []
    for item in items:
        for _ in range(50):
            m = item.turned(rng.uniform(0, 2 * np.pi), rng.uniform(0, 1, 2) * np.array(size_px) - 0.5)
            if not len(clear) or (distance(m, clear) - m.outer).min() >= clearance_px:
                placed.append(m)
                break
    return join(placed)


def distance(marks: Marks, xy: Array) -> Array:
    """Distance of points (..., 2) to the rectangles of K marks, negative inside: (..., K)."""
    d = xy[..., None, :] - marks.center
    c, s = np.cos(marks.angle), np.sin(marks.angle)
    qx = np.abs(d[..., 0] * c + d[..., 1] * s) - marks.half[:, 0]
    qy = np.abs(d[..., 1] * c - d[..., 0] * s) - marks.half[:, 1]
    return np.hypot(np.maximum(qx, 0), np.maximum(qy, 0)) + np.minimum(np.maximum(qx, qy), 0)


def draw(image: ArrayLike, marks: Marks, *, subpixels: int = 5) -> Array:
    """The image with the marks in it: multiplied by 1 - contrast * coverage for each, in order.

    Coverage is the mean over ``subpixels`` x ``subpixels`` of steps one sub-pixel wide.
    """
    out = np.array(image, dtype=float)
    if out.ndim != 2:
        raise ValueError(f"draw: image must be (H, W), got {out.shape}")
    height, width = out.shape
    offset = (np.arange(subpixels) + 0.5) / subpixels - 0.5
    for k in range(len(marks)):
        one = Marks(*(getattr(marks, f.name)[k : k + 1] for f in fields(Marks)))
        reach = one.reach[0] + 1.0
        x0, y0 = np.maximum(np.floor(one.center[0] - reach), 0).astype(int)
        x1, y1 = np.minimum(np.ceil(one.center[0] + reach), [width - 1, height - 1]).astype(int)
        if x1 < x0 or y1 < y0:
            continue
        x = (np.arange(x0, x1 + 1)[:, None] + offset).ravel()
        y = (np.arange(y0, y1 + 1)[:, None] + offset).ravel()
        d = distance(one, np.stack(np.meshgrid(x, y), axis=-1))[..., 0]
        across = d + 2 * one.half[0].min()
        inside = _strip(one.outer[0] - d, one.outer[0] + across, subpixels)
        if one.inner[0] >= 0:
            inside -= _strip(one.inner[0] - d, one.inner[0] + across, subpixels)
        coverage = inside.reshape(y1 - y0 + 1, subpixels, x1 - x0 + 1, subpixels).mean(axis=(1, 3))
        out[y0 : y1 + 1, x0 : x1 + 1] *= 1 - one.contrast[0] * coverage
    return out


def _strip(near: Array, far: Array, per_px: int) -> Array:
    """Share of a sub-pixel between two edges, steps one sub-pixel wide: thin strokes need both edges."""
    return np.maximum(np.clip(0.5 + near * per_px, 0, 1) + np.clip(0.5 + far * per_px, 0, 1) - 1, 0)
