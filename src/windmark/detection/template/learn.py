"""What a frame's clean markers say of it: its blur and its noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.detection.quantile import weighted_quantile
from windmark.detection.template.blocks import in_blocks
from windmark.detection.template.fit import Batch, Fitted, fit_all
from windmark.detection.template.noise import FrameNoise, frame_noise
from windmark.detection.template.odd import odd_ratio
from windmark.detection.template.request import Neighbours, Request, Scene
from windmark.detection.template.result import SATURATED, Frame, TemplateFits, columns, white_covariance
from windmark.detection.template.robust import CLEAN, level, scatter

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

BLUR_START, BLUR_SPREAD = 0.8, 0.5  # px, blur and its spread where nothing better is known
LEAST_SPREAD = 0.1  # px, least spread of a frame's blur: optics differ over the frame
LEAST_BLUR = 0.25  # px, as in the fits
LEAST_SHARE = 0.01  # of what is known of a marker's blur that must come from the marker itself
MEDIAN_VARIANCE = np.pi / 2.0  # of a median over that of a mean
BLUR_PASSES, SAME_BLUR = 4, 0.03  # the frame's blur is found when it moves by less, px
SURE_BLUR, WEAK_BLUR = 0.1, 0.14  # px, typical uncertainty of a marker's blur: one pass is enough; ask all together
BLURS = np.array([0.3, 0.4, 0.52, 0.66, 0.82, 1.0, 1.2, 1.43, 1.7, 2.0])  # px
HELD_SPREAD = 0.02  # px, of a blur that is tried
OUTVOICED = 9.0  # chi^2 by which one marker can speak against a blur
SAMPLE = 48  # markers that are enough to know a frame
OUTVOTED = 2.5  # a marker is not clean if its residuals exceed the sample's by so many robust standard deviations


def frame_blur(fits: TemplateFits) -> tuple[float, float] | None:
    """Blur of a frame and how much it differs over it, from the markers that are clean.

    Weighted median of the squared blurs that the markers show by themselves, without the prior they were fitted with;
    also such squares may be negative, to leave them out would make the blur larger. None where fewer than five markers
    are clean and know their blur.
    """
    prior = (2.0 * fits.frame.blur_px * fits.frame.blur_spread_px) ** -2.0  # information on blur^2
    with np.errstate(divide="ignore", invalid="ignore"):
        known = (2.0 * fits.blur_px * fits.blur_sigma_px) ** -2.0
        own = known - prior
        square = (known * fits.blur_px**2 - prior * fits.frame.blur_px**2) / own
    good = fits.converged & (fits.flags & ~SATURATED == 0) & np.isfinite(square) & (own > LEAST_SHARE * known)
    if good.sum() < CLEAN:
        return None
    square, variance = square[good], 1.0 / own[good]
    weight = 1.0 / (variance + (2.0 * fits.frame.blur_px * LEAST_SPREAD) ** 2)
    middle = float(weighted_quantile(square, weight, 0.5))
    blur = np.sqrt(max(middle, LEAST_BLUR**2))
    width = 1.4826 * float(weighted_quantile(np.abs(square - middle), weight, 0.5))
    scatter = width**2 - float(weighted_quantile(variance, weight, 0.5))
    unsure = MEDIAN_VARIANCE / weight.sum()
    return float(blur), float(np.hypot(np.sqrt(max(scatter, 0.0) + unsure) / (2.0 * blur), LEAST_SPREAD))


def learn_frame(scene: Scene, request: Request, *, blur: bool, noise: bool) -> tuple[Frame, Request]:
    """Blur and noise of a frame (those asked for) from fits of its first markers, and the request with them.

    The fits are done again with the frame's blur until it stays the same: where size, blur and depth are confused, a
    fit that does not know the blur is biased. Clean markers start where the last of the fits ended.
    """
    sample = np.arange(min(len(request.xy), SAMPLE))
    frame = Frame(float(request.blur[0]), float(request.blur_spread[0]), None)
    left = BLUR_PASSES if blur else 0
    while True:
        done, batches, fits = _fit_sample(scene, request.take(sample), frame, images=noise)
        clean = _clean(fits)
        request = _continue(request, sample[clean], done.take(clean), fits.take(clean))
        found, unsure = (frame_blur(fits.take(clean)), _unsure(fits.take(clean))) if left else (None, 0.0)
        if left and clean.sum() >= CLEAN and unsure > WEAK_BLUR:
            found, left = joint_blur(scene, request.take(sample[clean]), fits.noise[clean]), 1
        if found is None:
            break
        left = 0 if unsure < SURE_BLUR or abs(found[0] - frame.blur_px) < SAME_BLUR else left - 1
        frame = replace(frame, blur_px=found[0], blur_spread_px=found[1])
        request = _with_blur(request, frame)
        if not left and unsure < WEAK_BLUR:
            break
    if noise and clean.sum() >= CLEAN:
        frame = replace(frame, noise=_learn_noise(scene, done, batches, clean))
    return frame, request


def _fit_sample(
    scene: Scene, first: Request, frame: Frame, *, images: bool
) -> tuple[Fitted, list[Batch], TemplateFits]:
    """Fits that know the frame's blur but not its noise."""
    done, batches = fit_all(scene, first, Neighbours.find(first), images=images)
    count = len(first.xy)
    fits = columns(
        scene, first.xy, done, cov=done.cov[:, :2, :2], white=white_covariance(done, frame),
        chi2=np.full(count, np.nan), flags=np.zeros(count, np.int64), crossed=np.zeros(count, dtype=bool), frame=frame,
    )  # fmt: skip
    return done, batches, fits


def joint_blur(scene: Scene, request: Request, noise: Array) -> tuple[float, float] | None:
    """Blur and its uncertainty for markers none of which knows it well: the blur that suits all of them best.

    Maximum likelihood of one blur for all, by fits with each of `BLURS`; a marker's say is limited. None where the
    best is the last of those.
    """
    others = Neighbours.find(request)
    request = replace(request, states=np.full_like(request.states, np.nan), window=request.reach())
    cost = np.empty((len(BLURS), len(request.xy)))
    for k, blur in enumerate(BLURS):
        frame = Frame(blur, HELD_SPREAD, None)
        cost[k] = fit_all(scene, _with_blur(request, frame), others, images=False)[0].column("cost")
    good = np.isfinite(cost).all(axis=0)
    cost = cost[:, good]
    rise = np.minimum((cost - cost.min(axis=0)) / noise[good] ** 2, OUTVOICED).sum(axis=1)
    k = int(rise.argmin())
    if not 0 < k < len(BLURS) - 1:
        return None
    curve = np.polyfit(BLURS[k - 1 : k + 2], rise[k - 1 : k + 2], 2)
    if not curve[0] > 0.0:
        return None
    return float(-0.5 * curve[1] / curve[0]), float(np.hypot(1.0 / np.sqrt(curve[0]), LEAST_SPREAD))


def _unsure(fits: TemplateFits) -> float:
    """Typical uncertainty of the blur of a marker that is not told the frame's, in pixels."""
    prior = (2.0 * fits.frame.blur_px * fits.frame.blur_spread_px) ** -2.0
    with np.errstate(divide="ignore", invalid="ignore"):
        own = np.maximum((2.0 * fits.blur_px * fits.blur_sigma_px) ** -2.0 - prior, 0.0)
        return float(np.median(0.5 / (np.sqrt(own) * fits.blur_px))) if len(fits) else np.inf


def _with_blur(request: Request, frame: Frame) -> Request:
    blur, spread = np.full_like(request.blur, frame.blur_px), np.full_like(request.blur, frame.blur_spread_px)
    return replace(request, blur=blur, blur_spread=spread)


def _clean(fits: TemplateFits) -> Bools:
    """Markers whose residuals are not much larger than those of most."""
    clean = fits.converged & (fits.flags & ~SATURATED == 0) & (fits.depth > 0.0)
    if clean.any():
        logs = np.log(fits.noise, out=np.full(len(fits), np.inf), where=fits.noise > 0)
        clean &= logs - np.median(logs[clean]) < OUTVOTED * max(scatter(logs[clean]), 0.05)
    return clean


def _continue(request: Request, index: Ints, done: Fitted, fits: TemplateFits) -> Request:
    """The request with some markers placed and sized as they were fitted."""
    xy, radius, states = request.xy.copy(), request.radius.copy(), request.states.copy()
    moved = fits.xy - xy[index]
    xy[index] = fits.xy
    radius[index] = np.clip(fits.axes_px[:, 0], 0.6 * radius[index], 1.6 * radius[index])
    states[index] = done.states
    states[index, :2] -= moved
    return replace(request, xy=xy, radius=radius, states=states)


def _learn_noise(scene: Scene, done: Fitted, batches: list[Batch], clean: Bools) -> FrameNoise:
    """Noise of the clean markers; patches of different sizes are filled up with unused pixels."""
    from windmark.detection.template._kernels.touching import derivatives

    size = max(b.images.shape[-1] for b in batches)
    stack, fitted = [], []
    for b in batches:
        good, pad = clean[b.index], (size - b.images.shape[-1]) // 2
        stack.append(np.pad(b.images[good], ((0, 0), (0, 0), (pad, pad), (pad, pad))))
        fitted.append(done.take(b.index[good]))
    images, params = np.concatenate(stack), np.concatenate([f.params for f in fitted])
    pixels = np.concatenate([f.column("pixels") for f in fitted])
    typical = np.argsort(pixels, kind="stable")[pixels.size // 2]
    images[[0, typical]] = images[[typical, 0]]
    used, jacobian = (images[0, 3] != 0).astype(float), np.empty((10, size, size))
    derivatives(used, params[typical], float(scene.multiplicative), np.empty(10), np.empty((8, size + 6)),
                np.empty((size, size)), jacobian)  # fmt: skip
    variance = np.concatenate([f.column("noise2") for f in fitted])
    variance[[0, typical]] = variance[[typical, 0]]
    params[[0, typical]] = params[[typical, 0]]
    noise = frame_noise(images, jacobian, variance, level(params), scene.multiplicative)
    if noise.is_white:
        return replace(noise, odd=odd_ratio(images, params[:, :2], variance))
    pixel = np.concatenate([f.pixel for f in fitted])
    pixel[[0, typical]] = pixel[[typical, 0]]
    # Compression in blocks is seen between neighbours; a mosaic's lattice has none, and is a sensor's own.
    if scene.lattice is None and in_blocks(images[:, 2], images[:, 3] != 0, pixel):
        noise = replace(noise, odd=odd_ratio(images, params[:, :2], variance, smooth=True))
    return noise
