"""Virtual markers in the image plane: the paper's marker study (AIAA 2005-5007, section II.C).

A marker is an ellipse (a tilted disc far from the camera) of any size at any sub-pixel place.
Two ways of making it: counting sub-pixels as the paper does, or the share of each sub-pixel that
the ellipse covers, which is exact to about 1e-4 px and is the better oracle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.synth.degrade import average_blur

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SheetTruth:
    """N virtual markers of one image.

    Parameters
    ----------
    xy : (N, 2) centres in pixels
    axes_px, angle : (N, 2), (N,) half axes, large first, and its direction from x towards y, radians
    radius_px : (N,) radius of the disc before it was tilted
    tilt_deg : (N,) angle of view
    depth, noise : grey levels: light lost on a marker, standard deviation of the noise
    """

    xy: Array
    axes_px: Array
    angle: Array
    radius_px: Array
    tilt_deg: Array
    depth: float
    noise: float

    def __len__(self) -> int:
        return len(self.xy)


def disc_image(
    shape: tuple[int, int],
    xy: ArrayLike,
    axes_px: ArrayLike,
    angle: float = 0.0,
    *,
    level: float = 200.0,
    depth: float = 150.0,
    slope: tuple[float, float] = (0.0, 0.0),
    blur_px: float = 0.0,
    subpixels: int = 11,
    counting: bool = False,
) -> Array:
    """One marker, noise-free: light I = L(x) (1 - c H(x)), blurred, then averaged over each pixel.

    Parameters
    ----------
    shape : (height, width) of the image
    xy : (2,) centre in pixels
    axes_px : (2,) half axes, or one radius
    angle : direction of the first half axis from x towards y, radians
    level, depth : light at the centre without marker, light lost there: c = depth / level.
        A negative depth makes a bright marker
    slope : relative slope of the light per pixel along x and y: L = level (1 + slope . (x - xy))
    blur_px : standard deviation of a Gaussian blur of the scene, before the pixels (exact, not a
        filter on pixels)
    subpixels : sub-pixels along each side of a pixel
    counting : a sub-pixel is inside or not, as in the paper; else it counts by its covered share

    Returns
    -------
    (height, width) float64
    """
    height, width = shape
    center = np.asarray(xy, dtype=float)
    axes = np.broadcast_to(np.asarray(axes_px, dtype=float), (2,))
    if (axes <= 0).any() or subpixels < 1 or blur_px < 0:
        raise ValueError("disc_image: axes_px must be > 0, subpixels >= 1 and blur_px >= 0")
    # The light without marker is linear: blur and pixels leave it alone. What the marker takes away
    # is summed over the pixels that hold the ellipse.
    x, along_x = _pixels(width, center[0], axes.max(), subpixels, blur_px)
    y, along_y = _pixels(height, center[1], axes.max(), subpixels, blur_px)
    dx, dy = x - center[0], (y - center[1])[:, None]
    inside = _coverage(dx, dy, axes, angle, 0.0 if counting else 1.0 / subpixels)
    loss = depth * (1 + slope[0] * dx + slope[1] * dy) * inside
    light = level * (
        1 + slope[0] * (np.arange(width) - center[0]) + slope[1] * (np.arange(height)[:, None] - center[1])
    )
    return light - _weighted(along_y, loss, along_x)


MOST_PIXELS = 200_000_000
"""Of a sheet: 1.6 GB."""


def marker_sheet(
    rng: np.random.Generator,
    *,
    radius_px: float = 3.0,
    grid: tuple[int, int] = (12, 12),
    pitch_px: int | None = None,
    max_tilt_deg: float = 60.0,
    blur_passes: int = 0,
    blur_px: float = 0.0,
    noise: float = 0.0,
    level: float = 200.0,
    depth: float = 150.0,
    slope: tuple[float, float] = (0.0, 0.0),
    subpixels: int = 11,
    counting: bool = True,
) -> tuple[Array, SheetTruth]:
    """A sheet of random markers: by default the paper's 144, made as the paper makes them.

    Parameters
    ----------
    radius_px : radius of all discs, any number
    grid : (columns, rows)
    pitch_px : distance between markers; by default enough for windows of 2 radii and the blur
    max_tilt_deg : viewing angles are uniform in [0, max_tilt_deg], their azimuths all round
    blur_passes : passes of the 3 x 3 average (the paper's blur)
    blur_px : standard deviation of a Gaussian blur before the pixels
    noise : standard deviation of white noise as a fraction of ``depth``
    level, depth, slope, subpixels, counting : see `disc_image`; the slope is round each marker's centre

    Returns
    -------
    image : (rows * pitch, columns * pitch) float64 grey levels, not rounded
    truth : SheetTruth, row by row

    Raises
    ------
    UsageError
        For a sheet of more than 200 million pixels, by its markers, their distance or the blur between them.
    """
    columns, rows = grid
    if not 0 <= max_tilt_deg < 90:
        raise ValueError(f"marker_sheet: max_tilt_deg must be in [0, 90), got {max_tilt_deg}")
    if pitch_px is None:
        pitch_px = int(np.ceil(4 * radius_px + 10 * np.hypot(blur_px, np.sqrt(2 / 3 * blur_passes)) + 6))
    n, pitch = columns * rows, int(pitch_px)
    if n * pitch**2 > MOST_PIXELS:
        sheet = f"{columns} x {rows} markers {pitch} px apart"
        raise UsageError(f"marker_sheet: {sheet} are a picture of over {MOST_PIXELS:.0e} pixels; expected less")
    tilt, azimuth = rng.uniform(0, max_tilt_deg, n), rng.uniform(0, np.pi, n)
    local = (pitch - 1) / 2 + rng.uniform(-0.5, 0.5, (n, 2))
    axes = radius_px * np.stack([np.ones(n), np.cos(np.radians(tilt))], axis=1)
    image = np.empty((rows * pitch, columns * pitch))
    corner = pitch * np.stack([np.arange(n) % columns, np.arange(n) // columns], axis=1)
    for k in range(n):
        x, y = corner[k]
        image[y : y + pitch, x : x + pitch] = disc_image(
            (pitch, pitch), local[k], axes[k], azimuth[k], level=level, depth=depth, slope=slope, blur_px=blur_px,
            subpixels=subpixels, counting=counting,
        )  # fmt: skip
    image = average_blur(image, blur_passes)
    sigma = noise * abs(depth)
    if sigma > 0:
        image += sigma * rng.standard_normal(image.shape)
    return image, SheetTruth(corner + local, axes, azimuth, np.full(n, radius_px), tilt, depth, sigma)


def _coverage(dx: Array, dy: Array, axes: Array, angle: float, cell: float) -> Array:
    """Share of square cells of side ``cell`` inside an ellipse, by the tangent at its border; 0: in or out."""
    c, s = np.cos(angle), np.sin(angle)
    p, q = (c * dx + s * dy) / axes[0], (c * dy - s * dx) / axes[1]
    rho = np.sqrt(p * p + q * q)
    if cell == 0:
        return (rho <= 1).astype(float)
    # Gradient of rho by x and y: rho - 1 over its length is the distance to the border (first order).
    middle = rho < 1e-9
    safe = np.where(middle, 1.0, rho)
    gp, gq = np.where(middle, 1.0, p / safe) / axes[0], q / (axes[1] * safe)
    gx, gy = c * gp - s * gq, s * gp + c * gq
    size = np.sqrt(gx * gx + gy * gy)
    # Within a cell the border bends away from its tangent by curvature * cell^2 / 24 on average.
    sag = cell * cell / (24 * (axes[0] * axes[1]) ** 2 * size**3)
    return _box_share(((1 - rho) / size - sag) / cell, gx / size, gy / size)


def _box_share(distance: Array, gx: Array, gy: Array) -> Array:
    """Share of the unit square on the inner side of a line with this distance from its centre and unit normal."""
    a, b = np.maximum(np.abs(gx), np.abs(gy)), np.minimum(np.abs(gx), np.abs(gy))
    t = np.minimum(np.abs(distance), 0.5 * (a + b))
    corner = 1 - (0.5 * (a + b) - t) ** 2 / np.maximum(2 * a * b, 1e-300)
    share = np.where(t <= 0.5 * (a - b), 0.5 + t / a, corner)
    return np.where(distance >= 0, share, 1 - share)


def _weighted(along_y: Array, loss: Array, along_x: Array) -> Array:
    """along_y @ loss @ along_x.T, of the rows and columns that have any weight.

    Summed by einsum: matrices of this size make BLAS wake its threads, which on a busy machine take 50 times as long.
    """
    rows, columns = along_y.any(axis=1), along_x.any(axis=1)
    out = np.zeros((len(along_y), len(along_x)))
    half = np.einsum("ik,kl->il", along_y[rows], loss)
    out[np.ix_(rows, columns)] = np.einsum("il,jl->ij", half, along_x[columns])
    return out


def _pixels(count: int, center: float, reach: float, subpixels: int, blur_px: float) -> tuple[Array, Array]:
    """Sub-pixels (K,) of the pixels within reach, and the weights (count, K) with which pixels see them.

    The weight is the pixel's box times the Gaussian, by the midpoint rule.
    """
    from scipy.special import ndtr

    first, last = int(np.floor(center - reach)) - 1, int(np.ceil(center + reach)) + 1
    x = first - 0.5 + (np.arange((last - first + 1) * subpixels) + 0.5) / subpixels
    d = x - np.arange(count)[:, None]
    if blur_px > 0:
        return x, (ndtr((d + 0.5) / blur_px) - ndtr((d - 0.5) / blur_px)) / subpixels
    return x, (np.abs(d) < 0.5) / subpixels
