"""A camera that should stand still and does not: tested by freeing its pose, named with how far it went.

A camera that moved looks like much else: a law that lacks something, gross errors, a motion of the model. Explanations
are therefore compared by what they leave: the sum of squares, a price for each spot left out (the value at which it
is), and for each unknown (Schwarz 1978).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from windmark.adjust import chance
from windmark.deformation.equations import Equations
from windmark.deformation.misfit import length_unit
from windmark.deformation.outliers import critical
from windmark.deformation.patterns import Pattern
from windmark.deformation.result import NotIdentified
from windmark.deformation.setup import Task
from windmark.deformation.sighting import pose_block
from windmark.deformation.solve import Solved, solve
from windmark.errors import g1, g2
from windmark.geometry import DegenerateGeometry, Pose
from windmark.scene import Doubt

Array = NDArray[np.float64]

FALSE = 2.5e-4
"""Probability that a camera that stands still is said to have moved."""
LEAST = 4
"""Spots of a camera that are needed to tell how it stands."""


def price(solved: Solved, pattern: Pattern | None = None) -> float:
    """What an explanation leaves and what it costs; the smallest is the best."""
    count = len(solved.used)
    unknowns = solved.problem.size + (pattern.rank if pattern else 0)
    out = int((~solved.used).sum())
    return solved.chi2 - (pattern.test if pattern else 0.0) + critical(count) * out + np.log(2 * count) * unknowns


def candidates(equations: Equations, suspect: tuple[str, ...]) -> list[str]:
    """Views whose pose the residuals ask for, and those among ``suspect``."""
    solved = equations.solved
    found = []
    for v, name in _fixed(solved.task):
        added = equations.added(equations.by_pose(v))
        test, rank, _, _ = added.fitted(np.arange(6))
        asked = chance(test, rank, solved.chi2, solved.redundancy) < FALSE / len(solved.task.views)
        if asked or name in suspect:
            found.append(name)
    return found


def moved(solved: Solved, names: list[str], best: float) -> tuple[Solved, Doubt] | NotIdentified | None:
    """The instant with the pose free that explains it; None where none does better than ``best``.

    Where several would do equally well a refusal that names them.
    """
    margin = -2 * np.log(FALSE)
    healed = {name: other for name in names if (other := _freed(solved, name)) is not None}
    costs = {name: price(other) for name, other in healed.items()}
    if not costs or min(costs.values()) + margin > best:
        return None
    least = min(costs.values())
    alike = [name for name, cost in costs.items() if cost < least + margin]
    words = {name: _how_far(healed[name], name) for name in alike}
    if len(alike) > 1:
        return NotIdentified(
            "a camera taken as fixed is not where it should be: " + " or ".join(f"{n} {w}" for n, w in words.items())
            + "; these cameras alone do not tell which (markers on walls, or a third camera, would)", "moved",
            tuple(alike),
        )  # fmt: skip
    (name,) = alike
    said = "{} is taken as fixed and is not where it should be: it " + words[name]
    return healed[name], Doubt((name,), said, "moved")


def _fixed(task: Task) -> list[tuple[int, str]]:
    """Views with a fixed pose that can be told: beside others, or by what stands still."""
    view = task.observations.view
    alone = len(task.views) == 1 and not task.wall[task.observations.point].any()
    return [] if alone else [
        (v, view_.name) for v, view_ in enumerate(task.views)
        if view_.name not in task.free_poses and (view == v).sum() >= LEAST
    ]  # fmt: skip


def _freed(solved: Solved, name: str) -> Solved | None:
    """The instant with one more pose free."""
    task = solved.task
    freed = replace(task, free_poses=tuple(v.name for v in task.views if v.name in (*task.free_poses, name)))
    try:
        found = solve(freed, dict(solved.values), solved.shift, True, near=False)
    except DegenerateGeometry:
        return None
    if isinstance(found, NotIdentified) or chdtrc(max(found.redundancy, 1), found.chi2) < FALSE:
        return None  # then it is something else as well, or instead
    return found


def _how_far(solved: Solved, name: str) -> str:
    """By how much a camera turned and how far its station moved, with 1 sigma."""
    view = next(v for v in solved.task.views if v.name == name)
    assert view.cam_from_model is not None
    now: Pose = solved.values[pose_block(name)]
    delta = (now @ view.cam_from_model.inverse()).log()
    own = solved.cov[solved.problem.slices[pose_block(name)], solved.problem.slices[pose_block(name)]]
    return how_far(delta, own, length_unit(solved.task.volumes))


def how_far(delta: Array, cov: Array, unit: str) -> str:
    """A pose's change (6,), rotation and translation, and its covariance (6, 6) in words, with 1 sigma."""
    sigma = [np.sqrt(np.maximum(_along(delta[k]) @ cov[k, k] @ _along(delta[k]), 0.0)) for k in
             (slice(0, 3), slice(3, 6))]  # fmt: skip
    turn, shift = (float(np.linalg.norm(part)) for part in (delta[:3], delta[3:]))
    far = f"turned by {g2(np.degrees(turn))} ± {g1(np.degrees(sigma[0]))} deg and moved by {g2(shift)} ± {g1(sigma[1])}"
    return f"{far} {unit}".rstrip()


def _along(delta: Array) -> Array:
    return delta / max(float(np.linalg.norm(delta)), 1e-30)
