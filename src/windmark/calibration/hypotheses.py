"""What may be wrong besides single marks, tested in the adjusted network: a prior; what a test needs.

A hypothesis adds an unknown to the network: a column b to its equations. Whether that unknown is there is told without
solving again (Baarda 1967; Teunissen, "Testing theory", 2000, ch. 4): with the residuals r, their cofactors
Q = 1 - J C J^T, the unknown is -b^T r / (b^T Q b), and the sum of squares would fall by T = (b^T r)^2 / (b^T Q b).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import chance
from windmark.adjust.network.linear import gather
from windmark.adjust.network.problem import camera_columns
from windmark.calibration.agreement import FALSE
from windmark.calibration.setup import Job
from windmark.calibration.solve import Solved
from windmark.geometry import PARAMETERS

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

CHECKED = 1e-4
"""Share of a hypothesis that the network's own unknowns leave over, below which it cannot be told from them."""


def contradicted(job: Job, solved: Solved) -> dict[str, tuple[float, float]]:
    """Priors of interior parameters that the pictures contradict: by name, how far off, and in how many sigmas."""
    columns = [entry for entry in camera_columns(solved.problem.layout) if entry[1] in job.prior_sigma]
    units, given = solved.problem.units(solved.state).camera, list(job.cameras.values())
    found: dict[str, tuple[float, float]] = {}
    for c, name, column in columns:
        sigma, step = job.prior_sigma[name], float(units[c][PARAMETERS.index(name)])
        off = float(getattr(solved.state.cameras[c], name) - getattr(given[c], name))
        left = sigma**2 - float(solved.covariance.dense[column, column]) * step**2
        if left <= CHECKED * sigma**2:
            continue  # nothing but the prior tells it
        if chance_beside(off**2 / left, 1, solved) < FALSE / len(columns):
            found[name] = (off, float(np.sqrt(off**2 / left)))
    return found


def gathered(
    solved: Solved, b: Array, group: Ints, count: int, factor: Array | None = None, of: Ints | None = None
) -> Array:
    """(D + E b, count, K M) J^T b, summed over the marks of each group, of which those of none (-1) have no part.

    ``b`` is b (O, 2, K) times each of the M factors (N, M) in the row ``of`` (O,), of one where none are given.
    """
    lay, rows = solved.problem.layout, solved.problem.jacobian(solved.state)
    if factor is None or of is None:
        factor, of = np.ones((1, 1)), np.zeros(len(b), dtype=np.int64)
    out = np.zeros((lay.dense + lay.blocks * lay.size, count, b.shape[2] * factor.shape[1]))
    gather(*rows, b, factor, of, group, out[: lay.dense], out[lay.dense :])
    return out


def chance_beside(test: float, dof: int, solved: Solved) -> float:
    """`chance` beside the residuals of the network."""
    return chance(test, dof, solved.sigma0**2 * solved.redundancy, solved.redundancy)
