"""A line across a marker: pen strokes, scratches and joints are fitted together with the disc.

A line that crosses a disc moves the centre of a least-squares fit by tenths of a pixel, and weights that leave out what
does not fit help only half: where the line meets the rim it looks like rim. Fitted as what it is, a straight stroke of
some width that takes away a part of the light (or adds a constant), it does no harm: the centre is again as good as
its covariance. Unknown are the stroke's direction, place, strength and width beside the ten of the disc. It is searched
through all directions and places in what a plain round disc leaves over, then all fourteen are fitted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.fit import Fitted, windows
from windmark.detection.template.request import Neighbours, Request, Scene

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
_Lines = tuple[Array, Array, NDArray[np.float32], NDArray[np.float32]]

DIRECTIONS = 12  # that are tried, and all places in steps of a pixel
HALF_WIDTH, WIDTH_SPREAD = 0.8, 0.5  # px, and standard deviation of its logarithm
PIXEL = 0.29  # px, standard deviation of a pixel's box
BESIDE = 1.3  # radii from the centre, from where on only the stroke is seen
INEXACT = 0.03  # px, what is left because a product of blurred images is not the blurred product
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

    def model(self, v: Array) -> tuple[Array, Array]:
        """Image (S, S) of disc and stroke, and its derivatives (14, S, S)."""
        from windmark.detection.template._kernels.stroke import COUNT, model

        size = len(self.patch)
        jac, image, flat = np.empty((COUNT, size, size)), np.empty((size, size)), np.zeros((2, size, size))
        flat[1] = 1.0
        model(v, self.blur, self.scale, float(self.multiplicative), flat, np.empty((8, size + 6)),
              np.empty((4, size, size)), jac, image)  # fmt: skip
        return image, jac

    def fit(self, v: Array) -> tuple[Array, Array, float] | None:
        """From a start (14,): unknowns, normal matrix and cost in units of the noise; None if it does not converge."""
        from windmark.detection.template._kernels.stroke import COUNT, fit_stroke

        known = np.array([[5.0, self.blur, self.blur_spread], [13.0, np.log(HALF_WIDTH), WIDTH_SPREAD]])
        v, matrix, hopeless = v.copy(), np.empty((COUNT, COUNT)), HOPELESS * GOOD * self.weight.sum()
        cost = fit_stroke(self.patch, self.weight, v, known, self.noise, self.scale, float(self.multiplicative),
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
        size = len(patches[0])
        if size not in tried:
            tried[size] = _candidates(size, window.blur)
        first = _start(window, start[0], float(radius[k]), contrast, tried[size])
        found = None if first is None else window.fit(first)
        if found is None:
            continue
        v, matrix, cost = found
        chi2 = cost / (pixels - 14.0)
        before = plain.column("noise2")[k] / noise[k] ** 2
        moved = np.hypot(*(done.pixel[0] + v[:2] - request.xy[k]))
        believed[k] = chi2 < min(BETTER * before, GOOD) and moved < MOVED * radius[k]
        if believed[k]:
            done.params[0], done.cov[0] = _centred(v, np.linalg.inv(matrix) * max(chi2, 1.0), scene)
            done.cov[0, [0, 1], [0, 1]] += INEXACT**2
            done.table[0] = plain.table[k]
            done.table[0, [FITS.index("cost"), FITS.index("status")]] = cost * noise[k] ** 2, 1.0
            out.put(np.array([k]), done)
    return out, believed


def _start(
    window: _Window, place: Array, radius: float, contrast: float, candidates: _Lines
) -> Array | None:
    """A round disc as given, and the stroke that explains most of what is beside it; None if there is none."""
    size = len(window.patch)
    x = np.arange(size) - size // 2
    used = window.weight > 0
    outside = used & (np.hypot(x[None, :] - place[0], x[:, None] - place[1]) > BESIDE * radius)
    if not outside.any():
        return None
    level = float(np.median(window.patch[outside]))
    v = np.zeros(14)
    v[:2], v[2], v[4], v[5], v[6], v[7] = place, radius, radius, window.blur, abs(level) * contrast, level
    v[13] = np.log(HALF_WIDTH)
    disc, _ = window.model(v)
    carrier = (disc if window.multiplicative else np.full_like(disc, window.scale)) * outside
    left = (disc - window.patch) * outside
    (directions, offsets, lines, squares), weight = candidates, carrier.ravel().astype(np.float32)
    along = (lines @ (weight * left.ravel().astype(np.float32))).astype(float)
    power = (squares @ np.square(weight)).astype(float)
    gain = np.sign(along) * along**2 / np.maximum(power, 1e-300)
    k = int(gain.argmax())
    v[10:13] = directions[k], offsets[k], min(along[k] / max(power[k], 1e-300), 0.9)
    return v if gain[k] > 0.0 else None


def _candidates(size: int, blur: float) -> _Lines:
    """Directions and places (N,) of strokes across a patch, their images (N, S S) with rims that fall linearly, and the
    squares of these; single precision is more than enough to choose one.
    """
    x = (np.arange(size) - size // 2).astype(np.float32)
    turns, places = np.arange(DIRECTIONS) * np.pi / DIRECTIONS, np.arange(1.5 - size // 2, size // 2 - 1.0)
    slope = np.float32(1.0 / (np.sqrt(2.0 * np.pi) * np.hypot(blur, PIXEL)))
    across = np.cos(turns)[:, None, None] * x + np.sin(turns)[:, None, None] * x[:, None]
    lines = slope * (across[:, None].astype(np.float32) - places[None, :, None, None].astype(np.float32))
    np.abs(lines, out=lines)
    np.subtract(np.float32(0.5 + HALF_WIDTH * slope), lines, out=lines)
    np.clip(lines, 0.0, 1.0, out=lines)
    lines = lines.reshape(turns.size * places.size, -1)
    return np.repeat(turns, places.size), np.tile(places, turns.size), lines, np.square(lines)


def _centred(v: Array, cov: Any, scene: Scene) -> tuple[Array, Array]:
    """Parameters (10,) and covariance (10, 10) of the disc, with its own centre."""
    from windmark.detection.template._kernels.centre import center_map

    params, block, shift, rows = v[:10].copy(), np.ascontiguousarray(cov[:10, :10]), np.empty((2, 1)), np.empty((2, 10))
    center_map(params, float(scene.multiplicative), shift, block, rows)
    params[:2] += shift[:, 0]
    return params, block
