"""One pass of template fits over the markers of an image: windows, weights, priors."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.request import Neighbours, Request, Scene

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

BATCH_PIXELS = 200_000  # of the patches of one batch: they stay in the cache
ROUGH = 0.05  # chi^2 of the last step of a rough fit: a fifth of a sigma in the direction that is known worst
SHAPE_SPREAD = 0.6  # prior of the second moments, relative to those of a round disc of the given radius
TUKEY = 4.685  # cut of Tukey's weights in units of the noise: 95 % efficient on Gaussian noise


@dataclass(frozen=True)
class Fitted:
    """K fits as columns; grey levels times the scene's sign; `params` as in `disc_model`, relative to `pixel`.

    Parameters
    ----------
    pixel : (K, 2) middle of the patches
    params, cov : (K, 10), (K, 10, 10) parameters and their covariance in white noise; NaN where the fit failed
    states : (K, 10) to start another fit from, relative to the request's xy
    table : (K, 8) columns `_kernels.fit.FITS`
    usable : (K,) share of the disc's pixels within the image, but for saturated ones, that could be used
    saturated : (K,) share of the window's pixels that are saturated
    """

    pixel: Ints
    params: Array
    cov: Array
    states: Array
    table: Array
    usable: Array
    saturated: Array

    @staticmethod
    def empty(count: int) -> Fitted:
        """Columns for so many markers, all NaN or zero."""
        from windmark.detection.template._kernels.fit import FITS

        nan = np.full
        return Fitted(
            np.zeros((count, 2), np.int64), nan((count, 10), np.nan), nan((count, 10, 10), np.nan),
            nan((count, 10), np.nan), nan((count, len(FITS)), np.nan), np.zeros(count), np.zeros(count),
        )  # fmt: skip

    def take(self, index: Ints | Flags) -> Fitted:
        """The fits of an index."""
        return Fitted(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    def put(self, index: Ints | Flags, other: Fitted) -> None:
        """Overwrite the fits at an index."""
        for f in fields(self):
            getattr(self, f.name)[index] = getattr(other, f.name)

    def column(self, name: str) -> Array:
        """A column of the table by its name."""
        from windmark.detection.template._kernels.fit import FITS

        return np.asarray(self.table[:, FITS.index(name)])


@dataclass(frozen=True)
class Batch:
    """Fits of markers whose windows have one size, with the images that the noise model needs.

    Parameters
    ----------
    index : (B,) of the markers in the request
    images : (B, 4, S, S) influence of a pixel on x and on y, residual, model; 0 where a pixel was not used
    weighted : (B,) fitted with Tukey's weights
    """

    index: Ints
    images: Array
    weighted: Flags


def fit_all(
    scene: Scene, request: Request, others: Neighbours, *, images: bool = False, gone: Ints | None = None,
    rough: bool | Flags = False,
) -> tuple[Fitted, list[Batch]]:  # fmt: skip
    """Fit all markers of a request, by one kernel for all sizes, and their images where these are wanted.

    `rough`, all or (K,): they end within `ROUGH`, for what only starts other fits, or says how far a centre moves (with
    weights that follow the residuals steps are small far from the end, too). `gone` (K,): a quarter of each window, as
    of `leave_out`, without which it is fitted; None: nothing is left out.
    """
    from windmark.detection.template._kernels.fit import STILL, cut_and_fit

    done, start = _unfitted(request)
    starts, *known = _start(scene, request, done, start)
    reach, share = request.reach(), np.empty((len(start), 2))
    half = np.ceil(reach + 0.5).astype(np.int64)
    order = np.argsort(half, kind="stable")  # those of one size share their scratch
    numbers = 4 * (2 * half[order] + 1) ** 2 if images else np.zeros(len(half), np.int64)
    still = np.where(np.broadcast_to(rough, len(half)), ROUGH, STILL)
    flat, gone = np.zeros(numbers.sum()), np.full(len(half), -1) if gone is None else gone
    cut_and_fit(
        *scene.measured(), done.pixel, half, order, starts, reach, others.xy, others.radius, others.margin,
        others.index, gone, done.states, *known, still, share, done.table, done.params,
        done.cov, flat,
    )  # fmt: skip
    done.usable[:], done.saturated[:] = _of_measured(scene, request, done.pixel, start, share[:, 0]), share[:, 1]
    done.states[:, :2] -= start
    weighted, batches, first = np.isfinite(request.scale), [], 0
    for size in np.unique(half) if images else ():
        index, side = order[half[order] == size], 2 * int(size) + 1
        count = -(-index.size * side**2 // BATCH_PIXELS)
        for part in np.array_split(index, count):
            last = first + part.size * 4 * side**2
            batches.append(Batch(part, flat[first:last].reshape(-1, 4, side, side), weighted[part]))
            first = last
    return done, batches


@dataclass(frozen=True)
class Windows:
    """Windows of one size, cut from the image, and what fits to them start from.

    Parameters
    ----------
    index : (B,) of the markers in the request
    done : columns to be filled; the states (B, 10) to start from are relative to the patches' middles
    start : (B, 2) places in the patches
    patches, weights : (B, S, S)
    starts, known : of `_start`
    """

    index: Ints
    done: Fitted
    start: Array
    patches: Array
    weights: Array
    starts: Array
    known: tuple[Array, Array, Flags, Array, float]

    def fit(self, rows: Ints, states: Array, patches: Array) -> Fitted:
        """Fits (R,) of some of the windows from states (R, 10) as `Fitted` has them, to patches (R, S, S)."""
        from windmark.detection.template._kernels.fit import fit_discs

        priors, stiff, fixed, cut, multiplicative = self.known
        again = replace(self.done.take(rows), states=states.copy())
        again.states[:, :2] += self.start[rows]
        fit_discs(
            patches, self.weights[rows], self.starts[rows], again.states, priors[rows], stiff[rows], fixed, cut[rows],
            multiplicative, again.table, again.params, again.cov,
        )  # fmt: skip
        again.states[:, :2] -= self.start[rows]
        return again


def sized_windows(scene: Scene, request: Request, others: Neighbours) -> list[Windows]:
    """The windows of all markers of a request, those of one size together."""
    sizes = np.ceil(request.reach() + 0.5).astype(np.int64)
    groups = []
    for half in np.unique(sizes):
        index = np.flatnonzero(sizes == half)
        one = request.take(index)
        done, start, patches, weights = windows(scene, one, others.take(index), int(half))
        starts, *known = _start(scene, one, done, start)
        groups.append(Windows(index, done, start, patches, weights, starts, tuple(known)))  # type: ignore[arg-type]
    return groups


def _start(
    scene: Scene, request: Request, done: Fitted, start: Array
) -> tuple[Array, Array, Array, Flags, Array, float]:
    """What the kernels start from: places, radii and blurs (K, 4), priors, their stiffness, what is held, Tukey's cut,
    1 where paint multiplies the light; `done.states` become relative to the pixels.
    """
    priors, stiff, fixed = _priors(request)
    done.states[:, :2] += start
    if request.shape is not None:
        done.states[:, 2:6] = priors[:, 2:6]
    starts = np.column_stack([start, request.radius, request.blur])
    return starts, priors, stiff, fixed, 1.0 / (TUKEY * request.scale) ** 2, float(scene.multiplicative)


def _unfitted(request: Request) -> tuple[Fitted, Array]:
    """Columns to be filled, and the places (K, 2) in the patches."""
    done = replace(
        Fitted.empty(len(request.xy)), pixel=np.rint(request.xy).astype(np.int64), states=request.states.copy()
    )
    return done, request.xy - done.pixel


def windows(scene: Scene, request: Request, others: Neighbours, half: int) -> tuple[Fitted, Array, Array, Array]:
    """What a fit starts from: columns to be filled, places (K, 2) in the patches, patches and weights (K, S, S)."""
    from windmark.detection.template._kernels.cut import cut_windows

    done, start = _unfitted(request)
    size = 2 * half + 1
    patches, weights = np.empty((len(start), size, size)), np.empty((len(start), size, size))
    share = np.empty((len(start), 2))
    cut_windows(
        *scene.measured(), done.pixel, start, request.radius, request.blur, request.reach(), others.xy, others.radius,
        others.margin, others.index, patches, weights, share,
    )  # fmt: skip
    done.usable[:], done.saturated[:] = _of_measured(scene, request, done.pixel, start, share[:, 0]), share[:, 1]
    return done, start, patches, weights


def _of_measured(scene: Scene, request: Request, pixel: Ints, start: Array, share: Array) -> Array:
    """Shares (K,) of the discs' pixels that could be used, of those that were measured: no others can be missing."""
    if scene.lattice is None:
        return share
    measured, every = scene.lattice.within(pixel, start, request.radius + request.blur)
    return np.where(measured > 0, np.rint(share * every) / np.maximum(measured, 1), share)


def cut_patches(scene: Scene, pixel: Ints, half: int) -> tuple[Array, Array]:
    """Patches (K, S, S) round pixels as float64 holes and their weights 0 or 1, as `cut_patch` makes them."""
    from windmark.detection.template._kernels.cut import cut_windows

    patches, weights = np.empty((2, len(pixel), 2 * half + 1, 2 * half + 1))
    none, far = np.zeros(len(pixel)), np.full(len(pixel), np.inf)
    nobody, nowhere = np.zeros((len(pixel), 0), np.int64), np.zeros((0, 2))
    cut_windows(
        *scene.measured(), pixel, np.zeros((len(pixel), 2)), none, none, far, nowhere, none[:0], none[:0], nobody,
        patches, weights, np.empty((len(pixel), 2)),
    )  # fmt: skip
    return patches, weights


def _priors(request: Request) -> tuple[Array, Array, Flags]:
    """Prior states (K, 10), their inverse variances, and which unknowns are held."""
    mean, stiff, fixed = np.zeros((len(request.xy), 10)), np.zeros((len(request.xy), 10)), np.zeros(10, dtype=bool)
    blur2 = request.blur**2
    usual = 0.25 * request.radius**2 + blur2
    mean[:, 2], mean[:, 4], mean[:, 5] = usual, usual, blur2
    stiff[:, 2:5] = (SHAPE_SPREAD * usual[:, None]) ** -2.0
    stiff[:, 5] = (2.0 * request.blur * request.blur_spread) ** -2.0
    if request.shape is not None:
        xx, xy, yy = request.shape.T
        mean[:, 2], mean[:, 3], mean[:, 4] = (
            0.25 * (xx**2 + xy**2) + blur2,
            0.25 * xy * (xx + yy),
            0.25 * (xy**2 + yy**2) + blur2,
        )
        fixed[2:6] = True
    return mean, stiff, fixed
