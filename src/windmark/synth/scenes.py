"""Flat scenes with known markers, for judging detectors: clean, cluttered, infrared.

A scene has no camera and no model: ellipses at random places of an image, seen by a lens and a sensor. The clean
and the cluttered kind are paint, I = L(x) T(x), with uneven light L and everything on the surface multiplied into the
transmission T; the infrared kind adds warm discs to a smooth background. Markers are rendered exactly (blur and
pixel as one integral over sub-pixels of the product), clutter by its coverage of pixels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.synth.degrade import gaussian_blur, quantise
from windmark.synth.discs import disc_image
from windmark.synth.marks import Marks, distance, draw, join
from windmark.synth.scene_parts import Light, draw_all, scene_clutter, warm_background

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rng = np.random.Generator

KINDS = ("clean", "cluttered", "infrared")
SUBPIXELS = 7
TOUCH_PX = 1.0  # clutter that comes this near to a marker's border shifts its centre


@dataclass(frozen=True)
class Scene:
    """An image and the truth about its N markers.

    Parameters
    ----------
    image : (H, W) uint8 or uint16
    kind : one of `KINDS`
    polarity : "dark" or "bright", as `detect` wants it
    xy : (N, 2) centres of the ellipses in pixels
    axes_px, angle : (N, 2), (N,) half axes, large first, and its direction from x towards y, radians
    radius_px, tilt_deg : (N,) radius of the disc and the angle at which it is seen
    blur_px : (N,) standard deviation of the blur at the marker (it grows by a tenth towards the corners)
    contrast : (N,) share of the light that the marker takes away (infrared: adds)
    depth, noise : (N,) grey levels: that light, and the standard deviation of one pixel of the surface round the
        marker (sensor, rounding and fixed pattern; not the texture of the paint)
    texture : (N,) grey levels, standard deviation of the paint's texture, which is correlated over some 1.5 px
    slope : (N, 2) relative slope of the light at the marker, 1/px
    contaminated : (N,) bool, clutter touches the marker or its border up to `TOUCH_PX`
    border : (N,) bool, the image's border cuts the marker
    """

    image: NDArray[np.uint8] | NDArray[np.uint16]
    kind: str
    polarity: str
    xy: Array
    axes_px: Array
    angle: Array
    radius_px: Array
    tilt_deg: Array
    blur_px: Array
    contrast: Array
    depth: Array
    noise: Array
    texture: Array
    slope: Array
    contaminated: Mask
    border: Mask

    def __len__(self) -> int:
        return len(self.xy)


@dataclass(frozen=True)
class _Discs:
    """The markers' shapes, before there is light: columns as in `Scene`."""

    xy: Array
    axes_px: Array
    angle: Array
    radius_px: Array
    tilt_deg: Array
    blur_px: Array


def marker_scene(
    seed: int,
    kind: str = "clean",
    *,
    size_px: tuple[int, int] | None = None,
    markers: int | None = None,
    radius_px: tuple[float, float] = (2.5, 5.0),
    max_tilt_deg: float = 60.0,
    blur_px: tuple[float, float] = (0.5, 1.2),
    bits: int | None = None,
    texture: float | None = None,
) -> Scene:
    """One random scene; the same arguments give the same bytes.

    Parameters
    ----------
    seed : of everything random
    kind : "clean": dark markers, at least 10 times as deep as the noise, on textured paint in uneven light (lamps,
        shadow edges of 1.5 to 4 % per pixel);
        "cluttered": the same with lines, scratches, fittings, text, tape, 500 specks and a black block, and lines
        or scratches through 6 % of the markers; "infrared": warm markers of 10 to 29 times the noise on a smooth
        background with warm spots and an edge, with fixed-pattern noise and a few bad pixels
    size_px : (width, height), by default (2048, 2048), infrared (640, 512)
    markers : how many, by default 150 (infrared 60) at the default size and as many per area at others
    radius_px, max_tilt_deg : ranges of the discs' radii and of their viewing angles (from 0), uniform
    blur_px : range from which the scene's blur is drawn
    bits : grey-level depth; by default the seed chooses 8, 12 or 16 (infrared 14 or 16)
    texture : standard deviation of the paint as a fraction of the light, correlated over some 1.5 px; by default
        the seed chooses 0.003 to 0.01

    Raises
    ------
    ValueError
        An unknown kind, an empty range, or more markers than the image has room for.
    """
    if kind not in KINDS:
        raise UsageError(f"kind must be one of {', '.join(KINDS)}, got {kind!r}")
    if not (0 < radius_px[0] <= radius_px[1] and 0 < blur_px[0] <= blur_px[1] and 0 <= max_tilt_deg < 90):
        raise UsageError(f"radius_px, blur_px, max_tilt_deg: got {radius_px}, {blur_px}, {max_tilt_deg}")
    infrared = kind == "infrared"
    usual, number = ((640, 512), 60) if infrared else ((2048, 2048), 150)
    width, height = usual if size_px is None else size_px
    share = width * height / (usual[0] * usual[1])
    count = max(1, round(number * share)) if markers is None else markers
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    discs = _discs(rng, (width, height), count, radius_px, max_tilt_deg, blur_px)
    if infrared:
        return _infrared(rng, discs, (width, height), bits or int(rng.choice([14, 16])))
    clutter = scene_clutter(rng, (width, height), discs.xy, discs.axes_px, share) if kind == "cluttered" else join([])
    bits = bits or int(rng.choice([8, 12, 16]))
    grain = float(rng.uniform(0.003, 0.01)) if texture is None else texture
    return _painted(rng, kind, discs, clutter, (width, height), bits, grain)


def _discs(
    rng: Rng, size: tuple[int, int], count: int, radii: tuple[float, float], tilt: float, blurs: tuple[float, float]
) -> _Discs:
    """Random discs, far enough from each other that no window sees two; the image's border may cut them."""
    radius, angles = rng.uniform(*radii, count), rng.uniform(0, tilt, count)
    axes = radius[:, None] * np.stack([np.ones(count), np.cos(np.radians(angles))], axis=1)
    blur, apart = rng.uniform(*blurs), 4 * radii[1] + 6
    xy = np.empty((0, 2))
    for _ in range(200 * count):
        if len(xy) == count:
            break
        p = rng.uniform(-0.5, np.array(size) - 0.5)
        if not len(xy) or np.hypot(*(xy - p).T).min() > apart:
            xy = np.vstack([xy, p])
    if len(xy) < count:
        raise UsageError(f"markers: {count} of them, {apart:.0f} px apart, have no room in {size[0]} x {size[1]} px")
    middle = (np.array(size) - 1) / 2
    outward = ((xy - middle) ** 2).sum(axis=1) / (middle**2).sum()
    return _Discs(xy, axes, rng.uniform(0, np.pi, count), radius, angles, blur * (1 + 0.1 * outward))


def _painted(
    rng: Rng, kind: str, discs: _Discs, clutter: Marks, size: tuple[int, int], bits: int, grain: float
) -> Scene:
    """Dark markers: light times transmission, then the sensor."""
    light, n = Light.random(rng, size), len(discs.xy)
    contrast = np.clip(rng.uniform(0.5, 0.85) * rng.uniform(0.85, 1.1, n), 0, 0.95)
    x, y = np.arange(size[0], dtype=float), np.arange(size[1], dtype=float)[:, None]
    base = gaussian_blur(draw_all(light.level(x, y), clutter), float(np.median(discs.blur_px)))
    touched = np.zeros(n, dtype=bool)
    for k in range(n):
        near = _touching(clutter, discs, k)
        touched[k] = len(near) > 0
        _add(base, -contrast[k], *_seen(discs, k, light.level, near))
    base *= 1 + _texture(rng, base.shape, grain, 1.2) + _texture(rng, base.shape, 0.5 * grain, 8.0)
    here = light.level(*discs.xy.T)
    shot, read = _sensor(rng, contrast * here, here)
    seen = base + np.sqrt(shot * np.maximum(base, 0) + read) * _normal(rng, base.shape)
    noise = np.sqrt((shot * here + read) * (2**bits - 1) ** 2 + 1 / 12)
    levels = here * (2**bits - 1)
    columns = (contrast, contrast * levels, noise, np.hypot(grain, 0.5 * grain) * levels)
    return _scene(quantise(seen, bits), kind, discs, columns, light.slope(*discs.xy.T), touched)


def _sensor(rng: Rng, depth: Array, light: Array) -> tuple[float, float]:
    """Variance per light (shot noise) and constant variance: depth / noise has a median of 15 to 40, but is >= 10."""
    part = rng.uniform(0.5, 0.95)  # of the variance at the median light that is shot noise
    shape = part * light / np.median(light) + 1 - part
    ratio = depth / np.sqrt(shape)
    variance = min(np.median(ratio) / rng.uniform(15, 40), ratio.min() / 10) ** 2
    return float(part * variance / np.median(light)), float((1 - part) * variance)


def _infrared(rng: Rng, discs: _Discs, size: tuple[int, int], bits: int) -> Scene:
    """Warm markers added to a smooth background; fixed pattern of pixels and columns, a few bad pixels."""
    top, n = float(2**bits - 1), len(discs.xy)
    background, light = warm_background(rng, size)
    sigma = rng.uniform(0.0008, 0.002)  # of full scale, one pixel, in time
    pixel_rms, column_rms = 0.5 * sigma, 0.3 * sigma
    total = np.sqrt(sigma**2 + pixel_rms**2 + column_rms**2)
    depth = total * rng.uniform(12, 25) * rng.uniform(0.85, 1.15, n)
    image = gaussian_blur(background, float(np.median(discs.blur_px)))
    for k in range(n):
        _add(image, depth[k], *_seen(discs, k, lambda u, v: np.ones((len(v), u.size)), join([])))
    image += pixel_rms * _normal(rng, image.shape) + column_rms * rng.standard_normal(size[0])
    image += sigma * _normal(rng, image.shape)
    bad = rng.uniform(0, 1, (8, 2)) * size
    image[bad[:, 1].astype(int), bad[:, 0].astype(int)] += sigma * rng.uniform(-40, 40, len(bad))
    wrong = Marks.make(np.floor(bad), outer=0.5, contrast=1.0)
    touched = np.array([len(_touching(wrong, discs, k)) > 0 for k in range(n)])
    columns = (depth / light.level(*discs.xy.T), depth * top, np.full(n, total * top), np.zeros(n))
    return _scene(quantise(image, bits), "infrared", discs, columns, light.slope(*discs.xy.T), touched)


def _scene(
    image: NDArray[np.uint8] | NDArray[np.uint16],
    kind: str,
    discs: _Discs,
    columns: tuple[Array, Array, Array, Array],
    slope: Array,
    touched: Mask,
) -> Scene:
    """Put the columns (contrast, depth, noise, texture) together; the extents of the ellipses tell what is cut."""
    c, s = np.cos(discs.angle), np.sin(discs.angle)
    a, b = discs.axes_px.T
    extent = np.stack([np.hypot(a * c, b * s), np.hypot(a * s, b * c)], axis=1)
    size = np.array(image.shape[::-1])
    cut = ((discs.xy - extent < -0.5) | (discs.xy + extent > size - 0.5)).any(axis=1)
    return Scene(
        image, kind, "bright" if kind == "infrared" else "dark", discs.xy, discs.axes_px, discs.angle, discs.radius_px,
        discs.tilt_deg, discs.blur_px, *columns, slope, touched, cut,
    )  # fmt: skip


def _seen(discs: _Discs, k: int, source: Callable[[Array, Array], Array], clutter: Marks) -> tuple[int, int, Array]:
    """What pixels see of ``source(x, y)`` inside a marker, through the clutter on it: column, row, patch.

    Sub-pixels hold the share that the ellipse covers; blur and pixel are one weight (a difference of normal
    distribution functions), so that light, clutter and marker are multiplied before they are blurred.
    """
    from scipy.special import ndtr

    m, blur = SUBPIXELS, discs.blur_px[k]
    half = int(np.ceil(discs.axes_px[k, 0] + 6 * blur + 1))
    n = 2 * half + 1
    column, row = np.floor(discs.xy[k] + 0.5).astype(int) - half
    corner = np.array([column, row])
    fine = (discs.xy[k] - corner + 0.5) * m - 0.5
    cover = 1 - disc_image(
        (m * n, m * n), fine, discs.axes_px[k] * m, discs.angle[k], level=1.0, depth=1.0, subpixels=1
    )
    fine_clutter = Marks(
        (clutter.center - corner + 0.5) * m - 0.5, clutter.angle, clutter.half * m, clutter.outer * m,
        clutter.inner * m, clutter.contrast,
    )  # fmt: skip
    cover = draw(cover, fine_clutter, subpixels=1)
    x = (np.arange(m * n) + 0.5) / m - 0.5
    d = x - np.arange(n)[:, None]
    weight = (ndtr((d + 0.5) / blur) - ndtr((d - 0.5) / blur)) / m
    return int(column), int(row), weight @ (cover * source(column + x, row + x[:, None])) @ weight.T


def _add(image: Array, factor: float, column: int, row: int, patch: Array) -> None:
    """Add the part of a patch that lies in the image, times a factor."""
    n, (height, width) = len(patch), image.shape
    x0, y0, x1, y1 = max(column, 0), max(row, 0), min(column + n, width), min(row + n, height)
    image[y0:y1, x0:x1] += factor * patch[y0 - row : y1 - row, x0 - column : x1 - column]


def _touching(marks: Marks, discs: _Discs, k: int) -> Marks:
    """The marks whose drawn part comes within `TOUCH_PX` of an ellipse."""
    a, b = discs.axes_px[k] + TOUCH_PX
    near = _some(marks, np.hypot(*(marks.center - discs.xy[k]).T) < marks.reach + a)
    t, rho = np.linspace(0, 2 * np.pi, 48, endpoint=False), np.linspace(0, 1, 8)[:, None]
    u, v = (rho * a * np.cos(t)).ravel(), (rho * b * np.sin(t)).ravel()
    c, s = np.cos(discs.angle[k]), np.sin(discs.angle[k])
    d = distance(near, discs.xy[k] + np.stack([c * u - s * v, s * u + c * v], axis=1))
    reach = np.maximum(near.outer, 0.35)  # the points are that far apart
    return _some(near, np.any((d <= reach) & (d >= near.inner), axis=0))


def _some(marks: Marks, chosen: NDArray[np.bool_]) -> Marks:
    return Marks(*(getattr(marks, f.name)[chosen] for f in fields(Marks)))


def _texture(rng: Rng, shape: tuple[int, int], sigma: float, scale_px: float) -> Array:
    """Gaussian texture of standard deviation sigma: white noise smoothed over ``scale_px``, repeating every 512 px."""
    from scipy.ndimage import gaussian_filter

    tile = gaussian_filter(rng.standard_normal((512, 512)), scale_px, mode="wrap")
    tile *= sigma / tile.std()
    return np.tile(tile, [-(-n // 512) for n in shape])[: shape[0], : shape[1]]


def _normal(rng: Rng, shape: tuple[int, int]) -> NDArray[np.float32]:
    return rng.standard_normal(shape, dtype=np.float32)
