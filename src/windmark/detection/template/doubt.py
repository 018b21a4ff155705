"""How far a centre hangs on a part of its window: what the covariance of a contaminated marker must not be below.

Dirt, a scratch or a shadow's edge is no noise: it sits at one place and pulls the centre as a whole, while the
covariance of least squares counts every pixel as one more independent witness. What such a thing does shows when its
place is left out. The marker is fitted without each of eight overlapping quarters of its window, from its fit on; the
scatter of the centres is the covariance of the delete-a-group jackknife (Shao and Wu, Annals of Statistics 17, 1989),
right for errors that are independent from quarter to quarter whatever they are within.

Outlines that are rough everywhere (print, hand-painted discs) move such centres too, those of clean markers as much as
those of others: that is how the discs of this frame are, not what lies on one of them. The frame's clean markers are
asked the same, and where their centres hang on quarters more than white noise makes them the contaminated ones' scatter
is taken in proportion.

Nothing is decided by such a covariance, and most contaminated candidates are no markers: it is asked of those that are
kept.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.colour import colour_of
from windmark.detection.template.fit import Fitted, fit_all
from windmark.detection.template.request import Neighbours, Request, Scene
from windmark.detection.template.result import TemplateFits
from windmark.geometry.order import median

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LEFT_TO_GONE = 3.0  # pixels that stay over those left out: the jackknife's factor
IN_WHITE_NOISE = 5.8  # jackknife over covariance, variances: a fit without a quarter loses more than a quarter
ENOUGH = 5  # clean markers that say how discs are in this frame


@dataclass(frozen=True)
class Doubts:
    """Contaminated markers of a frame whose covariances are still those of least squares.

    Parameters
    ----------
    scene, request, done, others : of all K markers; `request.scale` is that of the weights they were fitted with
    white : (K, 2, 2) covariances of their centres in white noise as strong as theirs
    usual, known : (U,), (U, 2, 2) clean ones that say how discs are in this frame, and their covariances
    index : (L,) the contaminated ones
    """

    scene: Scene
    request: Request
    done: Fitted
    others: Neighbours
    white: Array
    usual: Ints
    known: Array
    index: Ints

    def cast(self, fits: TemplateFits, kept: Ints | None = None) -> TemplateFits:
        """The fits of the markers ``kept`` (all K if None, each once), with covariances as large as the doubts."""
        kept = np.arange(len(fits)) if kept is None else kept
        fits, place = fits.take(kept), np.full(len(self.done.params), -1)
        place[kept] = np.arange(len(kept))
        index = self.index[place[self.index] >= 0]
        if not index.size:
            return fits
        every = np.concatenate([self.usual, index])
        scatter = quarters_scatter(self.scene, self.request.take(every), self.done.take(every), self.others.take(every))
        usual, own = np.split(scatter, [self.usual.size])
        row, cov, colour = place[index], fits.cov.copy(), fits.colour.copy()
        cov[row] = larger(cov[row], own / rougher(usual, self.known))
        colour[row] = colour_of(cov[row], self.white[index])
        return replace(fits, cov=cov, colour=colour)


def quarters_scatter(scene: Scene, request: Request, done: Fitted, others: Neighbours) -> Array:
    """The jackknife's covariances (K, 2, 2) of the centres of fits `done`, made as `request` says.

    What is left of a window may not hold the disc: its centre counts as a radius away, in both directions.
    """
    moved = without_quarters(scene, request, done, others)
    far = request.radius[:, None]
    held = np.asarray(np.hypot(*np.moveaxis(moved, -1, 0)) <= far)
    moved = np.where(held[..., None], moved, 0.0)
    scatter = (moved[..., :, None] * moved[..., None, :]).sum(axis=1)
    scatter += np.square(np.where(held, 0.0, far)).sum(axis=1)[:, None, None] * np.eye(2)
    return np.asarray(scatter * LEFT_TO_GONE / moved.shape[1])


def without_quarters(scene: Scene, request: Request, done: Fitted, others: Neighbours) -> Array:
    """Movement (K, 8, 2) of the centres of fits `done` without each quarter of the window; NaN where there is none."""
    from windmark.detection.template._kernels.cut import SECTORS

    row, gone = np.divmod(np.arange(SECTORS * len(request.xy)), SECTORS)
    rough = ~np.isfinite(request.scale)[row]
    again, _ = fit_all(scene, replace(request, states=done.states).take(row), others.take(row), gone=gone, rough=rough)
    moved = again.params[:, :2] - done.params[row, :2]
    moved[again.column("status") != 1] = np.nan
    return np.asarray(moved.reshape(-1, SECTORS, 2))


def rougher(scatter: Array, cov: Array) -> float:
    """By how much (>= 1) the scatter of a frame's clean markers is above white noise's, of covariances (K, 2, 2)."""
    if len(cov) < ENOUGH:
        return 1.0
    ratio = np.trace(np.linalg.solve(cov, scatter), axis1=1, axis2=2) / 2.0
    return max(1.0, median(ratio) / IN_WHITE_NOISE)


def larger(cov: Array, other: Array) -> Array:
    """The covariance (K, 2, 2) that is the larger of both in each of the directions that are common to both.

    With cov = L L^T and L^-1 other L^-T = V diag(e) V^T these are the columns of L V: the result is
    L V diag(max(1, e)) V^T L^T.
    """
    out = cov.copy()
    with np.errstate(invalid="ignore"):
        good = np.isfinite(other).all(axis=(1, 2)) & (cov[:, 0, 0] > 0.0) & (np.linalg.det(cov) > 0.0)
    root = np.linalg.cholesky(cov[good])
    inverse = np.linalg.inv(root)
    size, turn = np.linalg.eigh(inverse @ other[good] @ np.swapaxes(inverse, 1, 2))
    turned = root @ turn
    out[good] = (turned * np.maximum(size, 1.0)[:, None, :]) @ np.swapaxes(turned, 1, 2)
    return out
