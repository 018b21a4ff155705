"""The geometry of a pair of pictures from correspondences, some of them wrong: `estimate_two_view`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.camera import Camera
from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.two_view.candidates import Candidates, find_candidates
from windmark.geometry.two_view.choice import choose, on_a_line
from windmark.geometry.two_view.pairs import Pairs, pairs_of_pixels
from windmark.geometry.two_view.report import essential_view, plane_view, rotation_view
from windmark.geometry.two_view.result import TwoView

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_FEWEST = 4


def estimate_two_view(
    xy_a: ArrayLike,
    xy_b: ArrayLike,
    camera_a: Camera,
    camera_b: Camera | None = None,
    *,
    cov_a: ArrayLike | None = None,
    cov_b: ArrayLike | None = None,
    seed: int | np.random.Generator = 0,
    max_log10_nfa: float = -2.0,
    max_trials: int = 1000,
) -> TwoView:
    """Relative pose of two pictures, or their rotation, from pairs of spots of which some may be wrong.

    Essential matrices of five pairs and homographies of four are drawn at random, optimised locally and compared by
    likelihood-ratio tests from the simplest model up: a rotation (no baseline that shows), a plane (its homography
    gives the pose, often two), points in space. The chosen model is refined on all pairs that agree with it.

    Parameters
    ----------
    xy_a, xy_b : (N, 2) pixels as taken, row by row one point; rows with NaN are left out
    camera_a, camera_b : interior parameters; None for the same camera
    cov_a, cov_b : covariances of the spots in px^2, (N, 2, 2) or one (2, 2); give both, or none: then one sigma for all
        is estimated, starting from 1 px, and no pose that leaves an rms of 0.1 px or less is refuted by a better one.
        They should hold what the lens model leaves, too: noise counts as white, and between the two readings of a
        nearly flat scene small systematic errors may choose the wrong one
    seed : of the random search
    max_log10_nfa : a model is accepted only if chance gives one as good less often than this (decimal logarithm);
        infinity for pairs that are known to be right
    max_trials : minimal sets of five that are drawn at most; 1000 are enough where 40 % of the pairs are right, fewer
        are drawn where many agree

    Returns
    -------
    TwoView
        False with a ``reason`` where there is no model: fewer than four pairs, all points on a line, too few pairs
        agree. ``reason`` and ``weak`` name what a found model leaves open: a plane with two readings, a tiny baseline.

    Raises
    ------
    ValueError
        Shapes that do not fit, one covariance of two, covariances that are not positive definite.

    References
    ----------
    `windmark.geometry.two_view.search`, `choice` and `refine` name their sources.
    """
    if (cov_a is None) != (cov_b is None):
        raise ValueError("estimate_two_view: give both cov_a and cov_b, or none of them")
    every = pairs_of_pixels(xy_a, xy_b, camera_a, camera_b or camera_a, cov_a, cov_b)
    use, known, rng = every.finite, cov_a is not None, np.random.default_rng(seed)
    view = _estimate(every[use], None if known else 1.0, rng, max_log10_nfa, max_trials)
    if not known and view and np.isfinite(view.sigma0) and view.sigma0 > 0:
        sigma = _robust_sigma(view)
        again = _estimate(every[use].scaled(sigma), sigma, rng, max_log10_nfa, max_trials)
        view = replace(again, sigma0=sigma * again.sigma0)
    return _of_all(view, use)


def _estimate(
    pairs: Pairs, sigma_px: float | None, rng: np.random.Generator, max_log10_nfa: float, max_trials: int
) -> TwoView:
    """With known covariances (``sigma_px`` None), or with such of one sigma for all."""
    n = len(pairs)
    if n < _FEWEST:
        return _nothing(
            n, f"too few pairs: {n}, at least {_FEWEST} are needed for a rotation, 5 for a plane, 6 in space"
        )
    if on_a_line(pairs):
        return _nothing(n, "all points are on a line: the relative pose is not determined", ("relative pose",))
    found = find_candidates(pairs, rng, max_trials)
    try:
        model = choose(found, pairs, sigma_px is None, max_log10_nfa == np.inf)
        view = _view(model, found, pairs, sigma_px)
    except (DegenerateGeometry, np.linalg.LinAlgError) as error:
        return _nothing(n, f"the pairs do not determine the relative pose: {error}", ("relative pose",))
    if view is None:
        return _nothing(n, "too few pairs agree with any model")
    if not view.log10_nfa <= max_log10_nfa:
        agree = int(view.inliers.sum())
        return _nothing(
            n, f"too few pairs agree: {agree} of {n}, chance alone may give that (log10 NFA {view.log10_nfa:.1f})"
        )
    if on_a_line(pairs[view.inliers]):
        return _nothing(
            n, "all points that agree are on a line: the relative pose is not determined", ("relative pose",)
        )
    return view


def _view(model: str, found: Candidates, pairs: Pairs, sigma_px: float | None) -> TwoView | None:
    known = sigma_px is None
    if model == "rotation" and found.rotation is not None:
        return rotation_view(found.rotation, pairs, known)
    if model == "homography-plane" and found.plane is not None:
        return plane_view(found.plane, pairs, known)
    if model == "essential" and found.space:
        return essential_view(found.space, pairs, sigma_px)
    return None


def _nothing(n: int, reason: str, weak: tuple[str, ...] = ()) -> TwoView:
    return TwoView("none", np.zeros(n, dtype=bool), np.full(n, np.nan), reason, weak)


def _robust_sigma(view: TwoView) -> float:
    """From the median error, which few wrong pairs within the gate of 1 px do not move."""
    size = np.median(np.abs(view.distance[view.inliers]))
    median = 0.6745 if view.model == "essential" else 1.1774  # of |normal| and of a 2-D length, sigma 1
    return float(max(size / median, 1e-9))


def _of_all(view: TwoView, use: Mask) -> TwoView:
    """The result for all pairs, those outside the lens model included."""
    inliers, distance = np.zeros(len(use), dtype=bool), np.full(len(use), np.nan)
    inliers[use], distance[use] = view.inliers, view.distance
    return replace(view, inliers=inliers, distance=distance)
