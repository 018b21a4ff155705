"""Interior parameters that were held at a value which the pictures contradict, all of them alike.

What is wrong in all pictures of a camera does not stay alike in them: the network's unknowns take what they can, and
each picture seems to ask for something of its own (`view_changes`). So the common part is a hypothesis as well: one
unknown for all pictures of a camera, beside which those of single ones have to explain more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from windmark.calibration.agreement import FALSE
from windmark.calibration.hypotheses import chance_beside
from windmark.calibration.setup import Job
from windmark.calibration.solve import Solved
from windmark.calibration.view_changes import Equations
from windmark.errors import g1
from windmark.geometry import PARAMETERS
from windmark.scene import Doubt

Array = NDArray[np.float64]

USUAL = {"focal_px": 0, "cx": 1, "cy": 2, "aspect": 4, "k1": 5}
"""Parameters that are free by default, and which change of the views (`view_changes.Equations`) is theirs."""
SHEAR = {"shear": 3}
"""Held by default, as no sensor has it: asked for only where the pictures differ, which it may explain."""
LEFT = 1e-5
"""Share of a change of all pictures that the network's unknowns leave over, below which it is not told: a principal
point beside a free decentering leaves some 5e-5. That the derivatives are of first order makes up to 2e-6."""
CAUSE = "camera"
WORDS = {"focal_px": " px", "cx": " px", "cy": " px"}


@dataclass(frozen=True)
class Wrong:
    """Parameters held wrongly.

    Parameters
    ----------
    found : of each the camera, the parameter, its value, and by how much it is another one, with 1 sigma
    lead : as of `view_changes.Asked`
    """

    found: tuple[tuple[str, str, float, float, float], ...]
    lead: float

    def doubt(self) -> Doubt:
        """In words."""
        listed = "; ".join(
            f"{{}} was held at {value:.6g}{WORDS.get(name, '')}, all pictures of {{}} ask for "
            f"{change:+.3g} +- {g1(sigma)}{WORDS.get(name, '')}"
            for _, name, value, change, sigma in self.found
        )
        names = tuple(n for camera, name, *_ in self.found for n in (name, camera))
        moving = " (a rolling shutter that moves alike in all pictures makes a shear, too)"
        shear = moving if any(name == "shear" for _, name, *_ in self.found) else ""
        return Doubt(names, f"{listed}: free it, or give its right value{shear}", CAUSE)


def held_wrongly(job: Job, solved: Solved, equations: Equations, *, differ: bool) -> Wrong | None:
    """What was held wrongly in all pictures alike, if anything; ``differ``: the pictures seem to ask for other values.

    One parameter after the other, as long as each explains more than chance beside those before it. Where nothing else
    is wrong, what a camera's own covariance leaves open of its value is no contradiction.
    """
    views, asked = len(equations.views), USUAL | (SHEAR if differ else {})
    camera = solved.problem.network.view_camera[equations.views]
    names, pick = list[tuple[int, str]](), list[Array]()
    for c, (name, k) in ((c, item) for c in range(len(job.cameras)) for item in asked.items()):
        held = solved.problem.layout.columns.camera[c, PARAMETERS.index(name)] < 0
        mine = camera == c
        if held and mine.any() and not equations.free[mine, k].any():
            names.append((c, name))
            pick.append((mine[:, None] & (np.arange(equations.score.shape[1]) == k)).ravel())
    if not names:
        return None
    of = np.array(pick, dtype=float)
    power = of @ equations.every.reshape(views * equations.score.shape[1], -1) @ of.T
    score = of @ equations.score.ravel()
    size = np.sqrt(of @ np.diagonal(equations.power, axis1=1, axis2=2).ravel())
    units = np.array([_unit(solved, c, name) for c, name in names])
    given = list(job.cameras.values())
    known = np.array([0.0 if differ else _variance(given[c].cov, name) for c, name in names]) / units**2

    def explained(some: list[int]) -> tuple[float, Array, Array]:
        """What some explain, and these with their covariance."""
        block = power[np.ix_(some, some)]
        if np.linalg.eigvalsh(block / np.outer(size[some], size[some]))[0] <= LEFT:
            return 0.0, np.zeros(len(some)), np.eye(len(some))
        inverse = np.linalg.inv(block)
        change = -inverse @ score[some]
        return float(change @ np.linalg.solve(inverse + np.diag(known[some]) / solved.scale, change)), change, inverse

    some, test = list[int](), 0.0
    while len(some) < len(names):
        others = {h: explained([*some, h])[0] for h in range(len(names)) if h not in some}
        best = max(others, key=lambda h: others[h])
        if not chance_beside(others[best] - test, 1, solved) < FALSE / len(names):
            break
        some, test = [*some, best], others[best]
    if not some:
        return None
    _, change, cov = explained(some)
    n, m = len(names), len(some)
    sets = gammaln(n + 1) - gammaln(m + 1) - gammaln(n - m + 1)
    lead = test / solved.scale - m * np.log(2 * solved.used.sum()) - 2 * sets
    sigma, called = np.sqrt(solved.scale * np.diagonal(cov)) * units[some], list(job.cameras)
    found = []
    for i, h in enumerate(some):
        c, name = names[h]
        value = float(getattr(solved.state.cameras[c], name))
        found.append((called[c], name, value, float(change[i] * units[h]), float(sigma[i])))
    return Wrong(tuple(found), float(lead))


def _unit(solved: Solved, c: int, name: str) -> float:
    """A parameter's change for a change of the views by 1: a focal length's and an aspect's are relative."""
    return float(getattr(solved.state.cameras[c], name)) if name in ("focal_px", "aspect") else 1.0


def _variance(cov: Array | None, name: str) -> float:
    k = PARAMETERS.index(name)
    return 0.0 if cov is None else max(float(cov[k, k]), 0.0)
