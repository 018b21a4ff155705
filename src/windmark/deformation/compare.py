"""Which law? By its evidence; beside it what a law says of markers that it has not seen (cross-validation)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.identify import identify
from windmark.deformation.result import Deformation
from windmark.deformation.volumes import Volume, Volumes
from windmark.errors import UsageError
from windmark.geometry import Camera
from windmark.scene import MarkerSet, Observations, View
from windmark.scene.shown import by_name, check_kinds, list_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LawChoice:
    """One candidate.

    Parameters
    ----------
    name : of the candidate
    parameters : number of free unknowns
    chi2 : sum of squared whitened residuals
    aic, bic : chi2 / s^2 + 2 k and chi2 / s^2 + k ln n (Akaike 1974, Schwarz 1978); the smallest is the best. s is the
        smallest sigma0 of all candidates, at least 1: where spots are less certain than stated no law is to explain it
    cross_px : root mean square length of the prediction error of markers that were left out, in pixels
    cross_chi2 : mean square of that error, whitened by the spots' covariances, per coordinate: 1 at best
    reason : why it could not be identified, "" where it could
    state : the solution with all markers
    """

    name: str
    parameters: int
    chi2: float
    aic: float
    bic: float
    cross_px: float
    cross_chi2: float
    reason: str = ""
    state: Deformation | None = None


def compare_laws(
    candidates: Mapping[str, Sequence[Volume] | Volumes],
    observations: Observations,
    markers: MarkerSet,
    cameras: Mapping[str, Camera] | Camera,
    views: Sequence[View],
    *,
    folds: int = 5,
    seed: int = 0,
    **options: Any,
) -> list[LawChoice]:
    """Identify every candidate and say how well it explains and predicts.

    Parameters
    ----------
    candidates : name -> volumes with their laws
    observations, markers, cameras, views, options : as for `identify`. Gross errors are those of the candidate that
        leaves the fewest: all candidates are judged on the same observations
    folds : parts into which the model's markers are divided; each is predicted from the others
    seed : of the division

    Returns
    -------
    list of LawChoice
        Best first: by BIC, the evidence of a law whose parameters are priced (a law twice as rich cannot win by a
        little), which finds the true law more often than cross-validation does; candidates without a solution last.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> @wm.law(tip={"unit": "mm", "sigma": 20.0})
    ... def bend(xyz, tip):
    ...     return xyz + np.outer((xyz[:, 1] / 400.0) ** 2, [0.0, 0.0, tip])
    >>> x, y = (v.ravel() for v in np.meshgrid([0.0, 40.0, 80.0], np.linspace(50.0, 400.0, 8)))
    >>> markers = wm.MarkerSet.make([f"m{i}" for i in range(24)], np.c_[x, y, 0 * x], volume="wing")
    >>> camera, pose = wm.Camera((640, 480), 800.0), wm.Pose.look_at([300, 200, 700], [40, 200, 0], [0, 1, 0])
    >>> xy, _ = camera.project(pose.apply(bend.function(markers.xyz, 8.0)))
    >>> seen = wm.Observations(np.zeros(24, dtype=int), np.arange(24), xy, np.tile(0.01 * np.eye(2), (24, 1, 1)))
    >>> candidates = {"rigid": [wm.Volume("wing")], "bends": [wm.Volume("wing", bend)]}
    >>> views = [wm.View("cam1", cam_from_model=pose)]
    >>> best, other = wm.compare_laws(candidates, seen, markers, camera, views, free_motion=False)
    >>> best.name, best.cross_px < 0.01, other.cross_px > 1.0
    ('bends', True, True)
    """
    check_kinds(
        "compare_laws", observations=(observations, Observations), markers=(markers, MarkerSet),
        cameras=(cameras, by_name(Camera)), views=(views, list_of(View)),
    )  # fmt: skip
    if folds < 2:
        raise UsageError(f"compare_laws: folds must be at least 2, got {folds}")
    options.setdefault("free_moved", False)  # what a camera explains is not the law's merit
    first = {n: identify(observations, markers, v, cameras, views, **options) for n, v in candidates.items()}
    good = [r.used for r in first.values() if isinstance(r, Deformation)]
    used = max(good, key=np.count_nonzero) if good else np.ones(len(observations), bool)
    kept = _part(observations, used)
    same = {**options, "reject": False}
    moving = np.unique(kept.point[markers.role[kept.point] != "wall"])
    fold = np.random.default_rng(seed).permutation(len(moving)) % folds
    out: list[LawChoice] = []
    nan = float("nan")
    for name, volumes in candidates.items():
        state = identify(kept, markers, volumes, cameras, views, **same)
        if not isinstance(state, Deformation):
            out.append(LawChoice(name, 0, nan, nan, nan, nan, nan, state.reason))
            continue
        px, whitened = _left_out(
            kept, markers, volumes, cameras, views, [moving[fold == f] for f in range(folds)], same
        )
        out.append(LawChoice(name, len(state.names), state.chi2, nan, nan, px, whitened, "", state))
    known = [c.state.sigma0 for c in out if c.state is not None and c.state.redundancy > 0]
    scale = max(min(known, default=1.0), 1.0) ** 2
    return sorted(
        (_priced(c, scale, 2 * len(kept)) for c in out), key=lambda c: c.bic if np.isfinite(c.bic) else np.inf
    )


def _priced(choice: LawChoice, scale: float, count: int) -> LawChoice:
    """With its information criteria, of so many numbers."""
    fit, k = choice.chi2 / scale, choice.parameters
    return replace(choice, aic=fit + 2 * k, bic=fit + k * float(np.log(count)))


def _left_out(
    observations: Observations, markers: MarkerSet, volumes: Any, cameras: Any, views: Sequence[View],
    parts: Sequence[NDArray[np.int64]], options: dict[str, Any],
) -> tuple[float, float]:  # fmt: skip
    """Root mean square prediction error in pixels, and its whitened mean square per coordinate."""
    lengths, squares = [], []
    for part in parts:
        away = np.isin(observations.point, part)
        state = identify(_part(observations, ~away), markers, volumes, cameras, views, **options)
        if not isinstance(state, Deformation):
            return float("nan"), float("nan")
        test = _part(observations, away)
        place = state.place(markers.xyz[test.point], markers.volume[test.point])[0]
        for v, view in enumerate(views):
            own = test.view == v
            seen = state.cam_from_tunnel[view.name].apply(place[own])
            error = state.cameras[view.camera].project(seen)[0] - test.xy[own]
            lengths.append((error**2).sum(axis=1))
            squares.append((error * np.linalg.solve(test.cov[own], error[..., None])[..., 0]).sum(axis=1))
    return float(np.sqrt(np.concatenate(lengths).mean())), float(np.concatenate(squares).mean() / 2)


def _part(observations: Observations, rows: NDArray[np.bool_]) -> Observations:
    return Observations(
        observations.view[rows], observations.point[rows], observations.xy[rows], observations.cov[rows]
    )
