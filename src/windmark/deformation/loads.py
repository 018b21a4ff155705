"""What a series' laws do from instant to instant, in few numbers: what gives way under the load follows them.

A root that gives way, or a bending that the law has no shape for, grows with the load, and the laws' parameters are
what is seen of that. Few of their combinations tell it: first those that move the model most (`Loads`), then of these
the ones that the series shows (`Course`), which leaves out what only noise moves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.volumes import Placed

Array = NDArray[np.float64]

MOST = 3
"""Combinations of the laws' parameters that are kept of a series."""
SEEN = 3.0
"""Sigmas by which one must change, root mean square, to be one that the series shows."""
VARIES = 0.01
"""Part of its mean square by which one must vary: else it is the same in all instants, and tells nothing besides."""

_KNOWN: WeakKeyDictionary[Placed, Array] = WeakKeyDictionary()
"""The same markers are seen in every frame of a series."""


def loads_of(placed: Placed) -> Array:
    """(R, K) combinations of the laws' parameters, each in lengths that the farthest marker moves by."""
    if placed not in _KNOWN:
        # Bound anew: what `placed` was asked for last is kept there.
        by_q = placed.volumes.bind(placed.xyz, placed.names).linearise(placed.volumes.start)[1]
        rates = np.linalg.norm(by_q, axis=1).max(axis=0, initial=0.0)
        moving = np.flatnonzero(rates > 0)
        even = by_q[..., moving].reshape(-1, len(moving)) / rates[moving]
        most = np.eye(len(moving)) if len(moving) <= MOST else np.linalg.svd(even, full_matrices=False)[2][:MOST]
        found = np.zeros((len(most), len(rates)))
        found[:, moving] = most * rates[moving]
        _KNOWN[placed] = found
    return _KNOWN[placed]


@dataclass(frozen=True, eq=False)
class Course:
    """How R loads went in some instants.

    Parameters
    ----------
    moments : (1 + R, 1 + R) sum of the products of 1 and the loads, over instants with wind
    noise : (R, R) sum of the loads' covariances in them
    off : (1 + R,) sum of 1 and the loads over wind-off instants
    largest : (R,) loads where they were farthest from those without wind, of the instants with wind
    """

    moments: Array
    noise: Array
    off: Array
    largest: Array

    @staticmethod
    def none(count: int) -> Course:
        """Of no instant."""
        return Course(np.zeros((count + 1, count + 1)), np.zeros((count, count)), np.zeros(count + 1), np.zeros(count))

    def plus(self, load: Array, cov: Array, wind_off: bool) -> Course:
        """One instant more, of loads (R,) with a covariance (R, R)."""
        own = np.r_[1.0, load]
        if wind_off:
            return replace(self, off=self.off + own)
        farther = np.linalg.norm(load - self.zero) > np.linalg.norm(self.largest - self.zero)
        return replace(
            self, moments=self.moments + np.outer(own, own), noise=self.noise + cov,
            largest=load if farther or not self.moments[0, 0] else self.largest,
        )  # fmt: skip

    @property
    def zero(self) -> Array:
        """(R,) the loads without wind; none where no instant is known to be without."""
        return np.asarray(self.off[1:] / max(self.off[0], 1.0))

    @property
    def factors(self) -> Array:
        """(1 + k, 1 + R) of 1 and the loads: first 1, then the loads' changes since wind-off that the series shows.

        Those are uncorrelated; the largest comes first, and is 1 in the root mean square.
        """
        since = np.eye(len(self.off))[1:]
        since[:, 0] = -self.zero
        size, along = np.linalg.eigh(since @ self.moments @ since.T)
        noise = np.einsum("ik,ij,jk->k", along, self.noise, along)
        mean2 = (along.T @ since @ self.moments[0]) ** 2 / max(self.moments[0, 0], 1.0)
        shown = np.flatnonzero((size > SEEN**2 * noise) & (size - mean2 > VARIES * size) & (size > 0))[::-1]
        scale = np.sqrt(max(self.moments[0, 0], 1.0) / size[shown])[:, None]
        return np.concatenate([np.eye(1, len(self.off)), scale * (along[:, shown].T @ since)])
