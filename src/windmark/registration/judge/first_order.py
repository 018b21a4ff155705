"""What unknowns would gain that a solution does not have, to first order: from its normal equations alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from windmark.registration.settle._kernels.doubt import gain_kernel, reduce_kernel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FirstOrder:
    """Normal equations with unknowns that are asked about, each with a unit normal prior, and others beside them.

    Parameters
    ----------
    normal, side : (P, P) J'WJ and (P,) J'W(seen - projected), without priors
    asked : (M,) the unknowns asked about; those before the others' end are nuisances: six of the pose, then with priors
    """

    normal: Array
    side: Array
    asked: NDArray[np.int64]

    @cached_property
    def _reduced(self) -> tuple[Array, Array]:
        """The same for the unknowns that are asked about alone, the others eliminated."""
        return reduce_kernel(self.normal, self.side, self.asked)

    def gain(self, first: int, last: int) -> float:
        """What those from ``first`` to ``last`` gain (nats): what the residuals lose, less what the freedom costs
        (Occam factor).
        """  # fmt: skip
        return float(gain_kernel(*self._reduced, first, last))

    @cached_property
    def _told(self) -> list[float]:
        """What the spots tell of each of them alone: the information beside that of its prior."""
        return [max(told, 0.0) for told in self._reduced[0].diagonal().tolist()]

    def gains(self, sigmas: Array) -> Array:
        """(S,) what all of them gain together with priors of so many sigmas (S,) in place of one."""
        value, vector = np.linalg.eigh(self._reduced[0])
        variance, pull2 = np.square(sigmas)[:, None], (self._reduced[1] @ vector) ** 2
        gained = variance * (pull2 / (1 + variance * value)) - np.log1p(variance * np.maximum(value, 0.0))
        return np.asarray(0.5 * gained.sum(axis=1))

    def shown(self, k: int, margin: float) -> float:
        """How large (in prior sigmas) one of them must be to lead by a margin (nats)."""
        information = 1.0 + self._told[k]
        return math.sqrt(2 * (margin + 0.5 * math.log(information)) / information)
