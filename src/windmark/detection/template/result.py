"""What the template refinement reports: columns of fitted markers, and what their frame has in common."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.template.colour import colour_of
from windmark.detection.template.fit import Fitted
from windmark.detection.template.noise import FrameNoise
from windmark.detection.template.request import Scene
from windmark.detection.template.robust import level

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

BORDER, SATURATED, CONTAMINATED, TOUCHING, ILL = 1, 2, 4, 8, 16  # bits of scene.detections.FLAGS
MANY_SATURATED = 0.02  # share of the window
LEAST_SIGNAL = 16.0  # chi^2 that a disc must explain to be one
ROUNDING = 1e-6  # of the level: no depth
LEAST_AXIS_PX, LEAST_BLUR_PX = 0.51, 0.2501  # just above the bounds of the fit
BLURS_TO_EDGE = 1.0  # blurs that an ellipse keeps from the image's edge if it is not cut


@dataclass(frozen=True)
class Frame:
    """What the markers of one frame say together; hand it on to the next frame of a sequence.

    Parameters
    ----------
    blur_px, blur_spread_px : blur (standard deviation of a Gaussian) and how much it differs over the frame
    noise : noise of the frame; None where too few markers are clean
    """

    blur_px: float
    blur_spread_px: float
    noise: FrameNoise | None


@dataclass(frozen=True)
class TemplateFits:
    """M fitted markers as columns, in the order of the given centres.

    Parameters
    ----------
    xy : (M, 2) centres of the imaged ellipses; the given ones where no fit was possible
    cov : (M, 2, 2) covariance of xy in px^2, NaN where no fit was possible
    axes_px : (M, 2) half axes of the ellipse without blur, largest first
    angle : (M,) direction of the first axis from x towards y, radians in (-pi/2, pi/2]
    blur_px, blur_sigma_px : (M,) blur and the standard deviation of that estimate
    depth : (M,) grey levels that the marker takes away at its centre (adds, if bright): positive for the chosen
        polarity
    depth_sigma : (M,) standard deviation of that estimate in white noise
    background : (M,) grey level at the centre without marker
    slope : (M, 2) of the background: relative per pixel if multiplicative, else grey levels per pixel
    noise : (M,) standard deviation of the residuals, grey levels
    chi2 : (M,) residual variance over the one expected in this frame, about 1; NaN where the frame's noise is unknown
    colour : (M, 2, 2) what the correlation of the frame's noise did to cov, see `template.colour`
    correlation : (M,) of the disc with the window, both without their slope: 1 is a perfect disc, 0 none
    iterations : (M,) evaluations of the model
    converged : (M,)
    flags : (M,) bits of `scene.detections.FLAGS`
    crossed : (M,) a line across the marker, or a shadow's edge, was fitted with it
    frame : what all of them have in common
    """

    xy: Array
    cov: Array
    axes_px: Array
    angle: Array
    blur_px: Array
    blur_sigma_px: Array
    depth: Array
    depth_sigma: Array
    background: Array
    slope: Array
    noise: Array
    chi2: Array
    colour: Array
    correlation: Array
    iterations: Ints
    converged: Bools
    flags: Ints
    crossed: Bools
    frame: Frame

    def __len__(self) -> int:
        return len(self.xy)

    @property
    def contrast(self) -> Array:
        """Depth over background (M,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.depth / self.background)

    @property
    def radius_px(self) -> Array:
        """Radius (M,) of the disc with the ellipse's area."""
        return np.asarray(np.sqrt(self.axes_px.prod(axis=1)))

    def take(self, index: ArrayLike) -> TemplateFits:
        """The markers of a boolean mask or an index array, in that order."""
        i = np.asarray(index)
        columns = {f.name: getattr(self, f.name)[i] for f in fields(self) if f.name != "frame"}
        return TemplateFits(**columns, frame=self.frame)


def columns(
    scene: Scene, start: Array, done: Fitted, *, cov: Array, white: Array, chi2: Array, flags: Ints, crossed: Bools,
    frame: Frame,
) -> TemplateFits:  # fmt: skip
    """Fits as they are reported; `flags` are those that the caller knows of."""
    p = done.params
    fitted = (done.column("status") >= 0) & np.isfinite(cov).all(axis=(1, 2)) & np.isfinite(p).all(axis=1)
    axes, angle = ellipses(p[:, 2:5])
    light = 1.0 + (p[:, 8:] * p[:, :2]).sum(axis=1)
    ramp = p[:, 7] * light if scene.multiplicative else p[:, 7] + light - 1.0
    signal, cost = done.column("signal"), done.column("cost")
    depth = p[:, 6] * (light if scene.multiplicative else 1.0)
    bound = (axes[:, 1] < LEAST_AXIS_PX) | (p[:, 5] < LEAST_BLUR_PX)
    flat = ~(np.abs(depth) > ROUNDING * np.abs(ramp))
    nothing = flat | ~(signal > LEAST_SIGNAL * done.column("noise2"))
    if scene.multiplicative and scene.sign > 0:
        # Paint takes away no more light than there is: where noise says so, the disc is larger and takes the same.
        excess = np.where((depth > ramp) & (ramp > 0.0), depth / np.maximum(ramp, 1e-300), 1.0)
        depth, axes = depth / excess, axes * np.sqrt(excess)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = p[:, 8:] / light[:, None] if scene.multiplicative else scene.sign * p[:, 8:]
        correlation = np.where(flat, 0.0, np.sign(p[:, 6]) * np.sqrt(signal / (signal + cost)))
    xy = np.where(fitted[:, None], done.pixel + p[:, :2], start)
    converged = fitted & (done.column("status") == 1)
    bits = flags | np.where(_cut(scene, xy, p), BORDER, 0) | np.where(~converged | bound | nothing, ILL, 0)
    bits |= np.where(done.saturated > MANY_SATURATED, SATURATED, 0) | np.where(done.usable < 1.0, CONTAMINATED, 0)
    return TemplateFits(
        xy=xy,
        cov=np.where(fitted[:, None, None], cov, np.nan),
        axes_px=axes,
        angle=angle,
        blur_px=p[:, 5].copy(),
        blur_sigma_px=np.sqrt(done.cov[:, 5, 5]),
        depth=depth,
        depth_sigma=np.sqrt(done.cov[:, 6, 6]) * (np.abs(light) if scene.multiplicative else 1.0),
        background=scene.sign * ramp,
        slope=slope,
        noise=np.sqrt(done.column("noise2")),
        chi2=chi2,
        colour=colour_of(cov, white),
        correlation=correlation,
        iterations=done.column("evaluations").astype(np.int64),
        converged=converged,
        flags=bits.astype(np.int64),
        crossed=crossed,
        frame=frame,
    )


def white_covariance(done: Fitted, frame: Frame) -> Array:
    """Covariances (K, 2, 2) of the centres in white noise as strong as the frame and the markers say."""
    if frame.noise is None:
        return done.cov[:, :2, :2].copy()
    factor = frame.noise.factor(done.column("noise2"), level(done.params))
    return np.asarray(done.cov[:, :2, :2] * factor[:, None, None])


def ellipses(shape: Array) -> tuple[Array, Array]:
    """Half axes (K, 2), largest first, and direction (K,) of the first from L_xx, L_xy, L_yy (K, 3)."""
    xx, xy, yy = shape.T
    mean, half = 0.5 * (xx + yy), 0.5 * np.hypot(xx - yy, 2.0 * xy)
    return np.column_stack([mean + half, mean - half]), 0.5 * np.arctan2(2.0 * xy, xx - yy)


def _cut(scene: Scene, xy: Array, params: Array) -> Bools:
    """Ellipses (K,) that are cut by the image's edge."""
    height, width = scene.image.shape
    reach = np.column_stack([np.hypot(params[:, 2], params[:, 3]), np.hypot(params[:, 3], params[:, 4])])
    reach += BLURS_TO_EDGE * params[:, 5:6]
    low, high = xy - reach, xy + reach
    return np.asarray((low < -0.5).any(axis=1) | (high[:, 0] > width - 0.5) | (high[:, 1] > height - 0.5))
