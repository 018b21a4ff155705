"""Template fits of a whole frame: fit all markers, part those that touch, fit the contaminated ones again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.colour import coloured
from windmark.detection.template.crlb import window_radius
from windmark.detection.template.doubt import Doubts
from windmark.detection.template.fit import Fitted, fit_all
from windmark.detection.template.hope import have_edges, may_be_discs
from windmark.detection.template.noise import FrameNoise
from windmark.detection.template.request import WINDOW_BLURS, Neighbours, Request, Scene
from windmark.detection.template.result import (
    CONTAMINATED,
    MANY_SATURATED,
    TOUCHING,
    Frame,
    TemplateFits,
    columns,
    ellipses,
    white_covariance,
)
from windmark.detection.template.robust import contaminated, decontaminated, level, median_contrast, trust
from windmark.detection.template.touching import fit_touching

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

NARROW, MOST_LONGER = 1.1, 1.6  # a window is made again if it is so much too small; an ellipse may be so much longer
ASKED = 12  # clean ones that are enough to know how its discs are


def fit_markers(scene: Scene, request: Request, frame: Frame, *, robust: bool) -> TemplateFits:
    """Fit all markers with what is known of the frame; contaminated ones again with weights."""
    fits, doubts = fit_at_first(scene, request, frame, robust=robust)
    return doubts.cast(fits)


def fit_at_first(
    scene: Scene, request: Request, frame: Frame, *, robust: bool, choosy: bool = False
) -> tuple[TemplateFits, Doubts]:
    """`fit_markers`, with the covariances of contaminated ones still as least squares makes them.

    `choosy`: these are candidates, and what can be no disc (`hope`) is not parted from others or fitted again.
    """
    others = Neighbours.find(request)
    images = frame.noise is not None and not frame.noise.is_white
    done, cov, expected = _first_fits(scene, request, others, frame.noise, images)
    radius = request.radius
    if request.shape is None and request.window is None:
        request, index = _widened(request, done)
        if index.size:
            others = Neighbours.find(request)
            wider, batches = fit_all(scene, request.take(index), others.take(index), images=images)
            done.put(index, wider)
            cov[index], expected[index] = trust(frame.noise, wider, batches)
    worth = may_be_discs(done, expected) if choosy else np.ones(len(done.params), dtype=bool)
    if request.shape is None and others.index.size:
        _parted(scene, request, done, others, cov, worth)
    with np.errstate(invalid="ignore"):
        chi2 = done.column("noise2") / expected
    flags, crossed = np.where(others.touching(), TOUCHING, 0), np.zeros(len(done.params), dtype=bool)
    usual, index = np.empty((2, 0), dtype=np.int64)
    if frame.noise is not None:
        worse = contaminated(chi2, done, expected, flags)
        flags |= np.where(worse, CONTAMINATED, 0)
        again = np.flatnonzero(worse & worth & (done.column("status") >= 0)) if robust else np.empty(0, np.int64)
        if choosy:
            again = again[have_edges(scene, request.xy[again], done.take(again), expected[again], frame)]
        crossed, weight = _cleaned(scene, request, done, others, cov, expected, worse, again, radius, frame.noise)
        usual = np.flatnonzero(~worse & (done.column("status") == 1) & np.isfinite(cov).all(axis=(1, 2)))[:ASKED]
        index = np.flatnonzero(worse & (done.column("status") >= 0) & ~crossed)
        request = replace(request, scale=weight)
    white = white_covariance(done, frame)
    fits = columns(scene, request.xy, done, cov=cov, white=white, chi2=chi2, flags=flags, crossed=crossed, frame=frame)
    return fits, Doubts(scene, request, done, others, white, usual, cov[usual], index)


def _cleaned(
    scene: Scene, request: Request, done: Fitted, others: Neighbours, cov: Array, expected: Array, worse: Bools,
    index: Ints, radius: Array, noise: FrameNoise,
) -> tuple[Bools, Array]:  # fmt: skip
    """Fit those (L,) of the contaminated markers again, in `done` and `cov`; which (K,) are fitted with a line, and
    the scales (K,) of the weights that were used.
    """
    weight, crossed = np.full(len(worse), np.inf), np.zeros(len(worse), dtype=bool)
    # A saturated disc has lost its inside: what is left of it does not tell dirt from disc.
    index = index[done.saturated[index] <= MANY_SATURATED]
    if index.size:
        again, trusted, with_stroke = decontaminated(
            scene, request.take(index), done.take(index), others.take(index), expected[index], noise,
            median_contrast(done, worse), radius[index],
        )  # fmt: skip
        better = again.column("status") == 1
        index = index[better]
        done.put(index, again.take(better))
        cov[index], crossed[index], weight[index] = trusted[better], with_stroke[better], np.sqrt(expected[index])
    return crossed, weight


def _parted(scene: Scene, request: Request, done: Fitted, others: Neighbours, cov: Array, worth: Bools) -> None:
    """Fit markers that touch and are worth it together, in `done` and `cov`: as much larger in the frame's noise as
    before.
    """
    white = np.trace(done.cov[:, :2, :2], axis1=1, axis2=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        coloured = np.trace(cov, axis1=1, axis2=2) / white
    index = fit_touching(scene, request, done, others, worth)
    cov[index] = done.cov[index, :2, :2] * np.where(np.isfinite(coloured), coloured, 1.0)[index, None, None]


def _first_fits(
    scene: Scene, request: Request, others: Neighbours, noise: FrameNoise | None, images: bool
) -> tuple[Fitted, Array, Array]:
    """Fits, covariances of their centres and expected residual variances; by images where no colour is known."""
    if not images or request.colour is None:
        done, batches = fit_all(scene, request, others, images=images)
        return done, *trust(noise, done, batches)
    assert noise is not None
    done, _ = fit_all(scene, request, others, images=False)
    levels = level(done.params)
    factor = noise.factor(done.column("noise2"), levels)
    cov = coloured(done.cov[:, :2, :2] * factor[:, None, None], request.colour)
    unknown = np.flatnonzero(~np.isfinite(request.colour).all(axis=(1, 2)))
    if unknown.size:
        again, batches = fit_all(scene, request.take(unknown), others.take(unknown), images=True)
        cov[unknown] = trust(noise, again, batches)[0]
    return done, cov, noise.variance(levels)


def _widened(request: Request, done: Fitted) -> tuple[Request, Ints]:
    """The request with the windows that the fitted ellipses need, and which markers (L,) had clearly smaller ones."""
    axes, _ = ellipses(done.params[:, 2:5])
    need = window_radius(np.minimum(axes[:, 0], MOST_LONGER * request.radius), request.blur, WINDOW_BLURS)
    small = (done.column("status") >= 0) & (need > NARROW * request.reach())
    radius, states = request.radius.copy(), request.states.copy()
    radius[small], states[small] = np.minimum(axes[small, 0], MOST_LONGER * radius[small]), done.states[small]
    return replace(request, radius=radius, states=states), np.flatnonzero(small)
