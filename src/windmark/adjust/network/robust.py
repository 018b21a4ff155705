"""Values that wrong observations do not pull: Cauchy weights whose scale follows the residuals down."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.levenberg_marquardt import SolveOptions, minimise
from windmark.adjust.loss import DEFAULT_SCALE, Loss
from windmark.adjust.network.model import Network
from windmark.adjust.network.problem import NetworkProblem
from windmark.adjust.network.state import NetworkState
from windmark.errors import DataError

Array = NDArray[np.float64]

RAYLEIGH = float(np.sqrt(2 * np.log(2.0)))
"""Median length of a residual with unit sigma per coordinate."""


def graduated(
    network: Network, state: NetworkState, options: SolveOptions, *, stages: int, settled: float,
    least: float = 0.0, shift: Array | None = None,
) -> tuple[NetworkProblem, NetworkState, float]:  # fmt: skip
    """Adjust in stages, each with a Cauchy loss of the scale that the median residual of the last one asks for.

    Neither a rough start nor a third of wrong observations leads astray: far residuals count while all are large, and
    fade as the scale falls (graduated non-convexity: Blake and Zisserman, "Visual Reconstruction", 1987).

    Parameters
    ----------
    network, state : what is observed and where to start; the network's own loss is not used
    options : of each stage
    stages : at most so many
    settled : a stage that lowers the scale by less than this factor is the last one
    least : the loss does not become narrower than for this scale, in sigma
    shift : as of `NetworkProblem`

    Returns
    -------
    problem : of the last stage, with its loss
    values : where the last stage ended
    scale : of the residuals, in sigma

    Raises
    ------
    ValueError
        When the start has no image of a point.
    """
    plain = NetworkProblem(network, state, shift)
    problem, scale = plain, np.inf
    for _ in range(stages):
        residual = plain.residual(state)
        if residual is None:
            raise DataError("start: a marker is behind a camera or beyond its lens")
        now = max(float(np.median(np.linalg.norm(residual, axis=1))) / RAYLEIGH, 1e-12)
        if now > settled * scale:
            break
        scale = now
        problem = plain.with_loss(Loss("cauchy", DEFAULT_SCALE["cauchy"] * max(scale, least)))
        state = minimise(problem, state, options)[0]
    return problem, state, scale
