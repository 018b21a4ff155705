"""What unknowns would gain that a solution does not have, to first order: from its normal equations alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.registration.cached import cached_property
from windmark.registration.settle._kernels.doubt import gain_kernel, look_kernel, reduce_kernel
from windmark.registration.settle.solution import Solution

Array = NDArray[np.float64]

PRIOR = 0.3
"""1 sigma of the prior of a deformation, as part of the largest one allowed."""


class Look(NamedTuple):
    """What else the residuals of a solution speak for, and what they do not show.

    Parameters
    ----------
    bending, camera : what a bent model and another camera gain (nats); -inf where the model cannot bend
    bow, turn : largest displacement of a matched marker beyond a rigid motion (part of the model's size), and largest
        turn of a part that may be the root against the pose (radians), without a bent model that leads by the margin
    told : (C, 5) what the spots tell of the cameras' doubted columns, each alone
    """

    bending: float
    camera: float
    bow: float
    turn: float
    told: Array


def look_at(best: Solution, bend: float, margin: float) -> Look:
    """``bend`` is 1 sigma of the deformation that the model may have, in sizes of the unit model; 0: none."""
    layout = best.views.layout
    bending, camera, bow, turn, told = look_kernel(
        best.views.sights, best.state, layout.modes_of_each, layout.stiff_bows_of_each, layout.stiff_turns_of_each,
        layout.walls, bend, math.sqrt(2 * margin), bend / PRIOR,
    )  # fmt: skip
    return Look(bending, camera, bow / layout.size, turn, told)


def shown(told: float, margin: float) -> float:
    """How large (in prior sigmas) an unknown of which the spots tell so much must be to lead by a margin (nats)."""
    information = 1.0 + told
    return math.sqrt(2 * (margin + 0.5 * math.log(information)) / information)


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
        return shown(self._told[k], margin)

    def pull(self, first: int, last: int, most: float, margin: float) -> tuple[float, float]:
        """What those from ``first`` to ``last`` do to the pose while they gain less than a margin (nats).

        They are taken as known to ``most``: of d with d'd / most^2 + d'Td / (2 margin) = 1, where T is what the spots
        tell of them, that one which moves the pose most (external reliability: Baarda 1968).

        Returns
        -------
        The change of the pose in units of its sigma, and the size of d.
        """
        rest = np.setdiff1d(np.arange(len(self.normal)), self.asked)
        own = self.normal[np.ix_(rest, rest)] + np.diag(np.r_[np.zeros(6), np.ones(len(rest) - 6)])
        moved = -np.linalg.solve(own, self.normal[np.ix_(rest, self.asked[first:last])])[:6]
        known = np.linalg.inv(np.linalg.inv(own)[:6, :6])
        told = self._reduced[0][first:last, first:last]
        unseen = np.linalg.inv(np.linalg.cholesky(told / (2 * margin) + np.eye(last - first) / most**2))
        effect2, along = np.linalg.eigh(unseen @ moved.T @ known @ moved @ unseen.T)
        return float(np.sqrt(max(effect2[-1], 0.0))), float(np.linalg.norm(unseen.T @ along[:, -1]))

    def along(self, direction: Array) -> tuple[float, float]:
        """How far all of them want to go together in one direction (M,), without a prior, and what is told of that."""
        told = float(direction @ self._reduced[0] @ direction)
        return (float(direction @ self._reduced[1]) / told, told) if told > 0 else (0.0, 0.0)
