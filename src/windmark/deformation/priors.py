"""What is known of law parameters beforehand (their sigma): whether the images contradict it, and what that did to all
else.

With the prior of a parameter q about q0 off by d, its row (q - q0 - d) / s has the derivative -1 / s by d and no image
has any (`equations.Added`): d is (q - q0) / (1 - C_qq / s^2), and all that was free follows by C_xq / s^2 of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from windmark.deformation.bounds import Bounds
from windmark.deformation.equations import Added, Equations
from windmark.deformation.sighting import LAW
from windmark.errors import g3
from windmark.scene import Doubt

Array = NDArray[np.float64]

MATTERS = 1.0
"""A prior that is contradicted and shifts nothing by so many sigmas is outweighed by the images: no harm is done."""


def contradicted(equations: Equations, false: float) -> Bounds | None:
    """Of an adjusted instant without parameters at bounds: the fewest priors without which the rest fits; else None.

    ``false``: probability that a prior is called contradicted which is right. Those that change nothing have no doubt.
    """
    solved = equations.solved
    parameters = solved.task.volumes.parameters
    which = np.array([k for k, p in enumerate(parameters) if np.isfinite(p.sigma)], dtype=np.int64)
    if solved.at_bound or not len(which):
        return None
    added, chosen = _added(equations, which), list[int]()
    fall, told = 0.0, 0
    while len(chosen) < len(which):
        others = [k for k in range(len(which)) if k not in chosen]
        falls = [added.fitted(np.array([*chosen, k])) for k in others]
        best = int(np.argmax([f[0] for f in falls]))
        if not chdtrc(1, falls[best][0] - fall) < false / len(others):
            break
        chosen, (fall, told, off, cov) = [*chosen, others[best]], falls[best]
    if not chosen or chdtrc(max(solved.redundancy - told, 1), max(solved.chi2 - fall, 0.0)) < false:
        return None  # something else is wrong, which priors follow
    follow, sigma, doubts = added.follow[:, chosen], np.sqrt(np.diag(solved.cov)), []
    for k, by, by_one in zip(which[chosen].tolist(), off.tolist(), follow.T, strict=True):
        if np.abs(by * by_one / sigma).max() > MATTERS:
            parameter = parameters[k]
            unit = f" {parameter.unit}" if parameter.unit else ""
            words = (f"{{}} is {g3(parameter.start)} ± {g3(parameter.sigma)}{unit} by its sigma, the images ask for "
                     f"about {g3(parameter.start + by)}{unit}, and all else follows that sigma")  # fmt: skip
            doubts.append(Doubt((solved.task.volumes.names[k],), words, "prior"))
    return Bounds(tuple(doubts), follow, np.outer(off, off) + cov, fall, told)


def _added(equations: Equations, which: NDArray[np.int64]) -> Added:
    """How far the priors of parameters ``which`` are off, as unknowns."""
    solved = equations.solved
    parameters = [solved.task.volumes.parameters[k] for k in which.tolist()]
    sigma, start = (np.array([getattr(p, key) for p in parameters]) for key in ("sigma", "start"))
    weight, cov = 1 / sigma**2, solved.cov[:, which]  # the laws come first
    power = np.diag(weight) - cov[which] * np.outer(weight, weight)
    return Added(-weight * (solved.values[LAW][which] - start), power, 1 / sigma, cov * weight)
