"""Windows of the template fits, cut from the image: pixels, weights, what is missing. Private."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from windmark.geometry._jit import nb

MOSTLY = 0.5  # share of saturated pixels from which on they are used
UNKNOWN, KNOWN, SATURATED = 0, 1, 2  # kinds of pixels
SECTORS = 8  # of a window, round the centre: two that are next to each other are a quarter


class Pixels(NamedTuple):
    """A picture's grey levels (H, W) in the type that holds it, (0, 0) in the others: kernels are compiled once."""

    uint8: Any
    uint16: Any
    float32: Any
    float64: Any


@nb.njit(cache=True, nogil=True, error_model="numpy")
def grey_row(image: Any, y: int, x0: int, row: Any) -> Any:
    """Grey levels (S,) from (x0, y) on, NaN beyond the picture: first and last + 1 of those within it."""
    a, b, c, d = image
    height = a.shape[0] + b.shape[0] + c.shape[0] + d.shape[0]
    width = a.shape[1] + b.shape[1] + c.shape[1] + d.shape[1]
    first, last = max(0, -x0), min(len(row), width - x0)
    if not 0 <= y < height or last <= first:
        row[:] = np.nan
        return 0, 0
    row[:first], row[last:] = np.nan, np.nan
    if a.shape[0] > 0:
        for i in range(first, last):
            row[i] = a[y, x0 + i]
    elif b.shape[0] > 0:
        for i in range(first, last):
            row[i] = b[y, x0 + i]
    elif c.shape[0] > 0:
        for i in range(first, last):
            row[i] = c[y, x0 + i]
    else:
        for i in range(first, last):
            row[i] = d[y, x0 + i]
    return first, last


@nb.njit(cache=True, nogil=True, error_model="numpy")
def cut_patch(
    image: Any, usable: Any, sign: float, saturation: float, x0: int, y0: int, patch: Any, weight: Any, kind: Any
) -> None:
    """Patch from (x0, y0) as a hole, weights 0 or 1, kinds of pixels.

    `image` as `Pixels`; `usable` (H, W) or (0, 0). Where most of a patch is saturated, that is the level of the paint
    (white drawings, clipped light): all is used.
    """
    known = saturated = 0
    for j in range(patch.shape[0]):
        row = patch[j]
        first, last = grey_row(image, y0 + j, x0, row)
        for i in range(patch.shape[1]):
            over = row[i] >= saturation
            kind[j, i] = UNKNOWN if i < first or i >= last else SATURATED if over else KNOWN
            saturated += over
        known += last - first
    most = saturated > MOSTLY * known
    for j in range(patch.shape[0]):
        for i in range(patch.shape[1]):
            use = (kind[j, i] == KNOWN or (most and kind[j, i] == SATURATED)) and math.isfinite(patch[j, i])
            if use and usable.shape[0] > 0:
                use = usable[y0 + j, x0 + i]
            weight[j, i] = 1.0 if use else 0.0
            patch[j, i] = sign * patch[j, i] if use else 0.0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def cut_windows(
    image: Any, usable: Any, sign: float, saturation: float, pixel: Any, start: Any, radius: Any, blur: Any,
    reach: Any, xy: Any, radii: Any, margin: Any, others: Any, patches: Any, weights: Any, share: Any,
) -> None:  # fmt: skip
    """Patches (K, S, S) round pixels (K, 2), weights 1 within `reach` of the places `start` in the patches.

    Weight 0 have pixels that a neighbour's disc reaches and that are nearer to its rim than to the own: `xy` (N, 2),
    `radii`, `margin` (N,) are all markers, `others` (K, L) indices into them, -1 for none. `share` (K, 2): of the
    disc's pixels that are known and not saturated those that could be used; of the window's those that are saturated.
    """
    kind = np.empty(patches.shape[1:], np.uint8)
    for k in range(len(pixel)):
        share[k, 0], share[k, 1] = cut_window(
            image, usable, sign, saturation, pixel[k], start[k], radius[k], blur[k], reach[k], xy, radii, margin,
            others[k], patches[k], weights[k], kind,
        )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy")
def cut_window(
    image: Any, usable: Any, sign: float, saturation: float, pixel: Any, start: Any, radius: float, blur: float,
    reach: float, xy: Any, radii: Any, margin: Any, others: Any, patch: Any, weight: Any, kind: Any,
) -> tuple[float, float]:  # fmt: skip
    """One of `cut_windows`: patch, weights (S, S), and the two shares; `kind` (S, S) is scratch."""
    size = patch.shape[0]
    x0, y0 = pixel[0] - size // 2, pixel[1] - size // 2
    cut_patch(image, usable, sign, saturation, x0, y0, patch, weight, kind)
    cx, cy = start[0] + size // 2, start[1] + size // 2
    reach2, disc2 = reach**2, (radius + blur) ** 2
    disc = used = seen = over = 0
    for j in range(size):
        for i in range(size):
            d2 = (i - cx) ** 2 + (j - cy) ** 2
            within, good = d2 <= reach2, d2 <= disc2 and kind[j, i] == KNOWN
            weight[j, i] = weight[j, i] if within else 0.0
            disc += good
            used += good and weight[j, i] > 0.0
            seen += within and kind[j, i] != UNKNOWN
            over += within and kind[j, i] == SATURATED
    for n in others:
        if n >= 0:
            near_x, near_y = xy[n, 0] - x0, xy[n, 1] - y0
            for j in range(size):
                for i in range(size):
                    rim = math.hypot(i - near_x, j - near_y) - radii[n]
                    if rim < margin[n] and rim < math.hypot(i - cx, j - cy) - radius:
                        weight[j, i] = 0.0
    return used / max(disc, 1), over / max(seen, 1)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def sector_of(x: float, y: float) -> int:
    """Which of eight equal sectors a direction lies in, from x towards y."""
    steep = 1 if abs(y) > abs(x) else 0
    if y >= 0.0:
        return steep if x > 0.0 else 3 - steep
    return 4 + steep if x <= 0.0 else 7 - steep


@nb.njit(cache=True, nogil=True, error_model="numpy")
def leave_out(weight: Any, xy: Any, quarter: int) -> None:
    """Weights (S, S) of 0 in a quarter of a window: that centred on the direction quarter * pi / 4 from a place."""
    half = weight.shape[0] // 2
    for j in range(weight.shape[0]):
        for i in range(weight.shape[0]):
            s = sector_of(i - half - xy[0], j - half - xy[1])
            if s == quarter or s == (quarter + SECTORS - 1) % SECTORS:
                weight[j, i] = 0.0
