"""Template fits of a whole frame: learn from its clean markers, fit all, fit the contaminated ones again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.detection.disc_model import patch_model
from windmark.detection.template_fit import TUKEY, Batch, Fitted, Neighbours, Request, Scene, fit_batches
from windmark.detection.template_noise import FrameNoise, frame_noise
from windmark.detection.template_result import CONTAMINATED, TOUCHING, Frame, TemplateFits, columns

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

BLUR_START, BLUR_SPREAD = 0.8, 0.8  # px, blur and its spread where nothing better is known
LEAST_SPREAD = 0.1  # px, least spread of a frame's blur: optics differ over the frame
SAMPLE = 48  # markers that are enough to know a frame
CLEAN = 5  # clean markers needed to say something about the frame
OUTVOTED = 2.5  # a marker is not clean if its residuals exceed the sample's by so many robust standard deviations
WORSE, FAR = 1.4, 4.9  # contaminated: residual variance over the expected one; largest residual in standard deviations
UNUSUAL = 3.2  # the same, in robust standard deviations of the logarithm over the frame
NOTHING = Frame(BLUR_START, BLUR_SPREAD, None)


def frame_blur(fits: TemplateFits) -> tuple[float, float] | None:
    """Blur of a frame and how much it differs over it, from the markers that are clean.

    Weighted median; the weights are the fits' own, without the prior they were made with. None where fewer than five
    markers are clean and know their blur.
    """
    prior = (2.0 * fits.frame.blur_px * fits.frame.blur_spread_px) ** -2.0  # information on blur^2
    with np.errstate(divide="ignore", invalid="ignore"):
        known = (2.0 * fits.blur_px * fits.blur_sigma_px) ** -2.0
        own = known - prior
        square = (known * fits.blur_px**2 - prior * fits.frame.blur_px**2) / own
    good = fits.converged & (fits.flags == 0) & np.isfinite(square) & (own > 0.05 * known) & (square > 0.0)
    if good.sum() < CLEAN:
        return None
    blur, sigma = np.sqrt(square[good]), np.sqrt(1.0 / own[good]) / (2.0 * np.sqrt(square[good]))
    weight = 1.0 / (sigma**2 + LEAST_SPREAD**2)
    middle = _median(blur, weight)
    spread = 1.4826 * _median(np.abs(blur - middle), weight)
    return middle, float(np.hypot(np.sqrt(max(spread**2 - _median(sigma**2, weight), 0.0)), LEAST_SPREAD))


def learn_frame(scene: Scene, request: Request, *, blur: bool, noise: bool) -> tuple[Frame, Request]:
    """Blur and noise of a frame (those asked for) from a first fit of its first markers, and the request with them.

    Markers that were fitted start where that fit ended.
    """
    sample = np.arange(min(len(request.xy), SAMPLE))
    first = request.take(sample)
    frame = Frame(float(request.blur[0]), float(request.blur_spread[0]), None)
    done, batches = _fit(scene, first, Neighbours.find(first), images=noise)
    unknown = np.full(len(sample), np.nan)
    fits = columns(
        scene, first.xy, done, cov=done.cov[:, :2, :2], chi2=unknown, flags=np.zeros(len(sample), np.int64), frame=frame
    )
    clean = fits.converged & (fits.flags == 0) & (fits.depth > 0.0)
    if clean.any():
        logs = np.log(fits.noise, out=np.full(len(sample), np.inf), where=fits.noise > 0)
        clean &= logs - np.median(logs[clean]) < OUTVOTED * max(_scatter(logs[clean]), 0.05)
    found = frame_blur(fits.take(clean)) if blur else None
    if found is not None:
        frame = replace(frame, blur_px=found[0], blur_spread_px=found[1])
    if noise and clean.sum() >= CLEAN:
        frame = replace(frame, noise=_learn_noise(scene, batches, clean))
    new = replace(
        request,
        blur=np.full_like(request.blur, frame.blur_px),
        blur_spread=np.full_like(request.blur, frame.blur_spread_px),
    )
    return frame, _continue(new, sample[fits.converged], done.take(fits.converged), fits.take(fits.converged))


def _continue(request: Request, index: Ints, done: Fitted, fits: TemplateFits) -> Request:
    """The request with some markers placed and sized as they were fitted."""
    xy, radius, states = request.xy.copy(), request.radius.copy(), request.states.copy()
    moved = fits.xy - xy[index]
    xy[index] = fits.xy
    radius[index] = np.clip(fits.axes_px[:, 0], 0.6 * radius[index], 1.6 * radius[index])
    states[index] = done.states
    states[index, :2] -= moved
    return replace(request, xy=xy, radius=radius, states=states)


def _learn_noise(scene: Scene, batches: list[Batch], clean: Bools) -> FrameNoise:
    """Noise of the clean markers; patches of different sizes are filled up with unused pixels."""
    size = max(b.images.shape[-1] for b in batches)
    stack, fitted = [], []
    for b in batches:
        good, pad = clean[b.index], (size - b.images.shape[-1]) // 2
        stack.append(np.pad(b.images[good], ((0, 0), (0, 0), (pad, pad), (pad, pad))))
        fitted.append(b.fitted.take(good))
    images, params = np.concatenate(stack), np.concatenate([f.params for f in fitted])
    pixels = np.concatenate([f.column("pixels") for f in fitted])
    typical = np.argsort(pixels, kind="stable")[pixels.size // 2]
    images[[0, typical]] = images[[typical, 0]]
    lattice = np.arange(size) - size // 2
    photometry = "multiplicative" if scene.multiplicative else "additive"
    _, jacobian = patch_model(lattice, lattice, params[typical], photometry=photometry)
    variance = np.concatenate([f.column("noise2") for f in fitted])
    variance[[0, typical]] = variance[[typical, 0]]
    level = np.abs(images[:, 3]).max((1, 2))
    return frame_noise(images, jacobian * (images[0, 3] != 0), variance, level, scene.multiplicative)


def fit_markers(scene: Scene, request: Request, frame: Frame, *, robust: bool) -> TemplateFits:
    """Fit all markers with what is known of the frame; contaminated ones again with weights."""
    others = Neighbours.find(request)
    coloured = frame.noise is not None and not frame.noise.is_white
    done, batches = _fit(scene, request, others, images=coloured)
    cov, expected = _trust(frame.noise, done, batches)
    chi2 = done.column("noise2") / expected
    flags = np.where(others.touching(), TOUCHING, 0)
    if frame.noise is not None:
        worse = _contaminated(chi2, done, expected, flags)
        flags |= np.where(worse, CONTAMINATED, 0)
        index = np.flatnonzero(worse & (done.column("status") >= 0))
        if robust and index.size:
            again = _fit_robustly(
                scene, request.take(index), done.take(index), others.take(index), np.sqrt(expected[index]), coloured
            )
            better = again[0].column("status") == 1
            done.put(index[better], again[0].take(better))
            cov[index[better]] = _trust(frame.noise, again[0], again[1])[0][better]
    return columns(scene, request.xy, done, cov=cov, chi2=chi2, flags=flags, frame=frame)


def _fit(scene: Scene, request: Request, others: Neighbours, *, images: bool) -> tuple[Fitted, list[Batch]]:
    """Fits in the order of the request, and their batches."""
    batches = fit_batches(scene, request, others, images=images)
    done = Fitted.empty(len(request.xy))
    for b in batches:
        done.put(b.index, b.fitted)
    return done, batches


def _trust(noise: FrameNoise | None, done: Fitted, batches: list[Batch]) -> tuple[Array, Array]:
    """Covariance of the centres and the residual variance that the frame's noise lets expect.

    White noise: least squares' own covariance. Else that of the frame's noise, scaled by the marker's own residuals;
    where weights are used those say nothing, and the frame's noise counts alone.
    """
    cov = done.cov[:, :2, :2].copy()
    if noise is None:
        return cov, np.full(len(cov), np.nan)
    p = done.params
    expected = noise.variance(np.fmax(np.abs(p[:, 7]), np.abs(p[:, 7] - p[:, 6])))
    if not noise.is_white:
        for b in batches:
            variance = np.where(b.weighted, expected[b.index], b.fitted.column("noise2"))
            cov[b.index] = noise.covariance(b.images, variance)
    return cov, expected


def _contaminated(chi2: Array, done: Fitted, expected: Array, flags: Ints) -> Bools:
    """Markers whose residuals are not the frame's noise."""
    usual = np.isfinite(chi2) & (flags == 0) & (done.column("status") == 1)
    limit = WORSE
    if usual.sum() >= 4 * CLEAN:
        logs = np.log(chi2[usual])
        limit = max(limit, float(np.exp(np.median(logs) + UNUSUAL * _scatter(logs))))
    return (chi2 > limit) | (done.column("largest") > FAR * np.sqrt(expected))


def _fit_robustly(
    scene: Scene, request: Request, plain: Fitted, others: Neighbours, noise: Array, images: bool
) -> tuple[Fitted, list[Batch]]:
    """Fits with Tukey's weights for a given noise, the better of two starts: the plain fit, and a round disc."""
    wide = np.maximum(0.5 * plain.column("largest") / (TUKEY * noise), 1.0)
    weighted = replace(request, scale=noise)
    best, batches = _narrowed(scene, replace(weighted, states=plain.states), others, wide, images)
    if request.shape is None:
        usual = np.zeros_like(plain.states)
        usual[:, 2] = usual[:, 4] = 0.25 * request.radius**2 + request.blur**2
        usual[:, 5], usual[:, 6] = request.blur**2, plain.params[:, 6] * request.radius**2
        usual[:, 7] = plain.states[:, 7]
        second, _ = _narrowed(scene, replace(weighted, states=usual), others, wide, False)
        better = (second.column("status") == 1) & ~(best.column("cost") <= second.column("cost"))
        if better.any():
            states = np.where(better[:, None], second.states, best.states)
            best, batches = _fit(scene, replace(weighted, states=states), others, images=images)
    return best, batches


def _narrowed(
    scene: Scene, request: Request, others: Neighbours, wide: Array, images: bool
) -> tuple[Fitted, list[Batch]]:
    """Fits with weights that start `wide` times as wide and are halved until they are as asked for."""
    while (wide > 1.0).any():
        done, _ = _fit(scene, replace(request, scale=request.scale * wide), others, images=False)
        request = replace(request, states=np.where((done.column("status") >= 0)[:, None], done.states, request.states))
        wide = np.maximum(0.5 * wide, 1.0)
    return _fit(scene, request, others, images=images)


def _scatter(values: Array) -> float:
    """Robust standard deviation."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


def _median(values: Array, weight: Array) -> float:
    """Weighted median."""
    order = np.argsort(values)
    total = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])
