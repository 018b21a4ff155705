"""Law parameters that ended at a bound: whether the images ask for more, and what that would do to all else.

The adjustment holds them there, so its covariance has them as known. The images say otherwise (`Equations.added`): how
far beyond the bound each would lie, how well that is told, and how everything that was free would follow. With its
second moment the covariances contain both, whether the bound is right or not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from windmark.deformation.equations import Equations
from windmark.deformation.sighting import LAW
from windmark.errors import g3
from windmark.scene import Doubt

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Bounds:
    """What holding the parameters at their bounds, or near what is known beforehand, may have done.

    Parameters
    ----------
    doubts : where the images contradict a bound, or what is known
    follow : (F, m) how all that was free would follow one unit of each of the m parameters
    second : (m, m) second moment of how far each is beyond its bound, or what is known of it is off
    test, rank : by so much the sum of squares would fall without that, and so many of these are told
    """

    doubts: tuple[Doubt, ...]
    follow: Array
    second: Array
    test: float
    rank: int


def at_bounds(equations: Equations, false: float) -> Bounds | None:
    """Of an adjusted instant; None where no parameter ended at a bound.

    ``false``: probability that a bound is called contradicted which is right.
    """
    solved = equations.solved
    volumes, held = solved.task.volumes, solved.at_bound
    if not held:
        return None
    which = np.array([k for k, n in enumerate(volumes.names) if n in held], dtype=np.int64)
    added = equations.held(which)
    every = np.arange(len(which))
    fall, told, beyond, cov = added.fitted(every)
    follow = added.follow.copy()
    follow[which] = np.eye(len(which))
    doubts = []
    for k, index in enumerate(which.tolist()):
        test, rank, _, _ = added.fitted(every[k : k + 1])
        if not rank or chdtrc(rank, test) >= false:
            continue
        value, parameter = float(solved.values[LAW][index]), volumes.parameters[index]
        unit = f" {parameter.unit}" if parameter.unit else ""
        words = f"{{}} ended at its bound {g3(value)}{unit}: the images ask for about {g3(value + beyond[k])}{unit}"
        doubts.append(Doubt((volumes.names[index],), f"{words}, and all else follows the bound", "bound"))
    return Bounds(tuple(doubts), follow, np.outer(beyond, beyond) + cov, fall, told)
