"""A line or a shadow's edge across a marker: pen strokes, scratches, joints, shadows are fitted with the disc.

A line that crosses a disc moves the centre of a least-squares fit by tenths of a pixel, and weights that leave out what
does not fit help only half: where the line meets the rim it looks like rim. Fitted as what it is, a straight stroke of
some width that takes away a part of the light (or adds a constant), it does no harm: the centre is again as good as
its covariance. Unknown are the stroke's direction, place, strength and width beside the ten of the disc. It is searched
through all directions and places in what a plain round disc leaves over, then all fourteen are fitted.

A shadow is the same with one edge only, and the width of its penumbra instead of the stroke's: taken for a slope of
the light, as without it, it moves the centre by up to a pixel. Which of both it is the surface beside the disc says:
the one that explains more of it is fitted first, and the other where it explains nearly as much.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.fit import Fitted, windows
from windmark.detection.template.request import Neighbours, Request, Scene

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Single = NDArray[np.float32]
_Lines = tuple[Array, Array, Single, Single, Single, Single]

DIRECTIONS = 12  # that are tried, and all places in steps of a pixel
HALF_WIDTH, WIDTH_SPREAD = 0.8, 0.5  # px, and standard deviation of its logarithm
PENUMBRA, PENUMBRA_SPREAD = 0.4, 0.8  # px, standard deviation of a shadow's edge, and that of its logarithm
NEARLY = 0.7  # of what one explains, from which on the other is tried too
PIXEL = 0.29  # px, standard deviation of a pixel's box
BESIDE = 1.3  # radii from the centre, from where on only the stroke is seen
INEXACT = 0.02  # px, what is left because the blurred product is known to first order of the blur's variance
LEAST_PIXELS = 42  # three times the unknowns
WIDEST = 61  # px, of a window: beside larger discs a line is narrow and weights do
BETTER, GOOD = 0.6, 2.0  # believed if it leaves that part of the residual variance, and so much over the noise's
HOPELESS = 3.0  # times what is good: given up early
LIKE = 0.5, 2.0  # contrast over that of clean markers: others are none
MOVED = 0.5  # radii by which it may move the centre


@dataclass(frozen=True)
class _Window:
    """One marker: patch, weights (S, S), what is known of blur and noise, grey level of a stroke of strength 1."""

    patch: Array
    weight: Array
    blur: float
    blur_spread: float
    noise: float
    scale: float
    multiplicative: bool

    def model(self, v: Array, edge: bool = False) -> tuple[Array, Array]:
        """Image (S, S) of disc and stroke, or shadow's edge, and its derivatives (14, S, S)."""
        from windmark.detection.template._kernels.stroke import COUNT, model

        size = len(self.patch)
        jac, image, flat = np.empty((COUNT, size, size)), np.empty((size, size)), np.zeros((2, size, size))
        flat[1] = 1.0
        model(v, edge, self.blur, self.scale, float(self.multiplicative), flat, np.empty((8, size + 6)),
              np.empty((4, size, size)), jac, image, np.empty((size, size)))  # fmt: skip
        return image, jac

    def fit(self, v: Array, edge: bool = False) -> tuple[Array, Array, float] | None:
        """From a start (14,): unknowns, normal matrix and cost in units of the noise; None if it does not converge."""
        from windmark.detection.template._kernels.stroke import COUNT, fit_stroke

        width = [np.log(PENUMBRA), PENUMBRA_SPREAD] if edge else [np.log(HALF_WIDTH), WIDTH_SPREAD]
        known = np.array([[5.0, self.blur, self.blur_spread], [13.0, *width]])
        v, matrix, hopeless = v.copy(), np.empty((COUNT, COUNT)), HOPELESS * GOOD * self.weight.sum()
        cost = fit_stroke(self.patch, self.weight, v, edge, known, self.noise, self.scale, float(self.multiplicative),
                          hopeless, matrix)  # fmt: skip
        return None if np.isnan(cost) else (v, matrix, cost)


def fit_strokes(
    scene: Scene, request: Request, plain: Fitted, others: Neighbours, noise: Array, contrast: float, radius: Array
) -> tuple[Fitted, Bools]:
    """Fits of disc and stroke, and for which markers (K,) they are to be believed.

    Parameters
    ----------
    plain : fits without stroke, by least squares
    noise : (K,) standard deviation that the frame lets expect
    contrast : depth over background of the frame's clean markers
    radius : (K,) radii to start from; those of the request may follow a line
    """
    from windmark.detection.template._kernels.fit import FITS

    out, believed = plain.take(np.arange(len(noise))), np.zeros(len(noise), dtype=bool)
    tried: dict[int, _Lines] = {}
    for k in range(len(noise)):
        one = request.take(np.array([k]))
        done, start, patches, weights = windows(
            scene, one, others.take(np.array([k])), int(np.ceil(one.reach()[0] + 0.5))
        )
        window = _Window(
            patches[0], weights[0], float(one.blur[0]), float(one.blur_spread[0]), float(noise[k]),
            abs(float(plain.params[k, 6])), scene.multiplicative,
        )  # fmt: skip
        pixels = float(weights[0].sum())
        with np.errstate(divide="ignore", invalid="ignore"):
            like = plain.params[k, 6] / np.abs(plain.params[k, 7]) / contrast
        if pixels < LEAST_PIXELS or len(patches[0]) > WIDEST or not LIKE[0] < like < LIKE[1]:
            continue
        size, before = len(patches[0]), float(plain.column("noise2")[k] / noise[k] ** 2)
        if size not in tried:
            tried[size] = _candidates(size, window.blur)
        found = None
        for first, edge in _starts(window, start[0], float(radius[k]), contrast, tried[size]):
            found = _good(window.fit(first, edge), pixels, before, request.xy[k] - done.pixel[0], float(radius[k]))
            if found is not None:
                break
        if found is not None:
            believed[k], (v, matrix, chi2) = True, found
            done.params[0], done.cov[0] = _centred(v, np.linalg.inv(matrix) * max(chi2, 1.0), scene)
            done.cov[0, [0, 1], [0, 1]] += INEXACT**2
            done.table[0] = plain.table[k]
            done.table[0, [FITS.index("cost"), FITS.index("status")]] = chi2 * (pixels - 14.0) * noise[k] ** 2, 1.0
            out.put(np.array([k]), done)
    return out, believed


def _good(
    fit: tuple[Array, Array, float] | None, pixels: float, before: float, place: Array, radius: float
) -> tuple[Array, Array, float] | None:
    """Unknowns, normal matrix and chi^2 per pixel of a fit that is to be believed; None for others.

    `before`: chi^2 per pixel without stroke; `place` (2,) where the disc was looked for.
    """
    if fit is None:
        return None
    v, matrix, cost = fit
    chi2 = cost / (pixels - 14.0)
    good = chi2 < min(BETTER * before, GOOD) and np.hypot(*(v[:2] - place)) < MOVED * radius
    return (v, matrix, chi2) if good else None


def _starts(
    window: _Window, place: Array, radius: float, contrast: float, candidates: _Lines
) -> Iterator[tuple[Array, bool]]:
    """A round disc as given with the stroke, or shadow's edge (True), that explains most of what is beside it.

    The likelier of both first, see `NEARLY`; none where nothing is beside the disc.
    """
    size = len(window.patch)
    x = np.arange(size) - size // 2
    used = window.weight > 0
    outside = used & (np.hypot(x[None, :] - place[0], x[:, None] - place[1]) > BESIDE * radius)
    if not outside.any():
        return
    level = float(np.median(window.patch[outside]))
    v = np.zeros(14)
    v[:2], v[2], v[4], v[5], v[6], v[7] = place, radius, radius, window.blur, abs(level) * contrast, level
    disc, _ = window.model(v)
    carrier = (disc if window.multiplicative else np.full_like(disc, window.scale)) * outside
    # Squares of 1e-30 are no floats of 32 bits; a power of two changes nothing else.
    unit = -int(np.frexp(np.abs(carrier).max())[1])
    weight, left = (
        np.ldexp(part, unit).astype(np.float32).ravel() for part in (carrier, (disc - window.patch) * outside)
    )
    if not weight.any():
        return
    directions, offsets, lines, squares, edges, edges2 = candidates
    first = _best(lines, squares, weight, left)
    # Where the shadow is half of the window the median is neither its light nor the other's.
    second = _best(edges, edges2, weight, left, level=True)
    most = max(first[1], second[1])
    for (k, gain, strength, dimmed), edge in sorted(((first, False), (second, True)), key=lambda f: -f[0][1]):
        if gain > 0.0 and gain >= NEARLY * most:
            start = v.copy()
            start[6:8] *= 1.0 - (dimmed if window.multiplicative else 0.0)
            start[7] -= 0.0 if window.multiplicative else dimmed * window.scale
            start[10:13] = directions[k], offsets[k], np.clip(strength / (1.0 - min(dimmed, 0.9)), -0.9, 0.9)
            start[13] = np.log(PENUMBRA if edge else HALF_WIDTH)
            yield start, edge


def _best(
    lines: Single, squares: Single, weight: Single, left: Single, level: bool = False
) -> tuple[int, float, float, float]:
    """Which of the images (N, S S) explains most of what is `left` (S S,): its index, the squares it explains, its
    strength, and by what the level differs then (`level`: together with it, and shadows take away or add light; strokes
    that add count less).
    """
    along, power = (lines @ (weight * left)).astype(float), (squares @ np.square(weight)).astype(float)
    if not level:
        gain = np.sign(along) * along**2 / np.maximum(power, 1e-300)
        k = int(gain.argmax())
        return k, float(gain[k]), float(along[k] / max(power[k], 1e-300)), 0.0
    both, alone = (lines @ np.square(weight)).astype(float), float(np.square(weight).sum())
    mean = float(weight @ left) / alone
    along, power = along - both * mean, np.maximum(power - both**2 / alone, 1e-3 * alone)
    gain = along**2 / power
    k = int(gain.argmax())
    strength = float(along[k] / power[k])
    return k, float(gain[k]), strength, float(mean - strength * both[k] / alone)


def _candidates(size: int, blur: float) -> _Lines:
    """Directions and places (N,) of strokes across a patch, their images (N, S S) with rims that fall linearly, the
    squares of these, and the same of shadows' edges there; single precision is more than enough to choose one.
    """
    x = (np.arange(size) - size // 2).astype(np.float32)
    turns, places = np.arange(DIRECTIONS) * np.pi / DIRECTIONS, np.arange(1.5 - size // 2, size // 2 - 1.0)
    slope = np.float32(1.0 / (np.sqrt(2.0 * np.pi) * np.hypot(blur, PIXEL)))
    across = np.cos(turns)[:, None, None] * x + np.sin(turns)[:, None, None] * x[:, None]
    lines = slope * (across[:, None].astype(np.float32) - places[None, :, None, None].astype(np.float32))
    edges = np.clip(np.float32(0.5) + lines, 0.0, 1.0).reshape(turns.size * places.size, -1)
    np.abs(lines, out=lines)
    np.subtract(np.float32(0.5 + HALF_WIDTH * slope), lines, out=lines)
    np.clip(lines, 0.0, 1.0, out=lines)
    lines = lines.reshape(turns.size * places.size, -1)
    return np.repeat(turns, places.size), np.tile(places, turns.size), lines, np.square(lines), edges, np.square(edges)


def _centred(v: Array, cov: Any, scene: Scene) -> tuple[Array, Array]:
    """Parameters (10,) and covariance (10, 10) of the disc, with its own centre."""
    from windmark.detection.template._kernels.centre import center_map

    params, block, shift, rows = v[:10].copy(), np.ascontiguousarray(cov[:10, :10]), np.empty((2, 1)), np.empty((2, 10))
    center_map(params, float(scene.multiplicative), shift, block, rows)
    params[:2] += shift[:, 0]
    return params, block
