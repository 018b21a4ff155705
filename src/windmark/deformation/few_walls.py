"""Markers on walls that alone hold cameras which move: what three of them say nothing checks.

With all cameras free the model and they are one body, which the walls' markers hold in the tunnel. Three do that; where
one of them has been displaced the triangle does not fit, one spot is left out for it, and which one is chance: whether
the first, the second or the third is displaced, the pictures are explained. So each is asked whether it is the one, its
place being known as badly as the spot that was left out says; where several explain them as well, that is said, and the
covariance has what they differ by (the mixture's second moment).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.lost import residuals_of_all
from windmark.deformation.outliers import critical
from windmark.deformation.result import NotIdentified
from windmark.deformation.sighting import LAW, MOTION, in_tunnel, pose_block
from windmark.deformation.solve import Solved, solve
from windmark.geometry import DegenerateGeometry, Pose
from windmark.scene import Doubt, Observations

Array = NDArray[np.float64]

HELD = 3
"""Markers that hold a body; each beyond tells of the others."""
UNSEEN = 2.0
"""A displaced marker may be so many times as far off as the spots show that it contradicts."""
MATTERS = 3.0
"""Sigmas by which a displaced marker must move what is free, for it to be said where a gross error explains it, too."""
LIKELIER = 2 * np.log(100.0)
"""As `attached.LIKELIER`: one explanation is the better one when it is a hundred times likelier."""


def walls_alone(solved: Solved) -> NDArray[np.int64]:
    """Markers on walls that are seen where nothing but they hold the model in the tunnel; none where more does."""
    task = solved.task
    held = not task.free_motion or task.motion_cov is not None or len(task.free_poses) < len(task.views)
    return np.flatnonzero(task.wall & task.seen & (not held))


def unchecked_walls(solved: Solved) -> list[Doubt]:
    """That the markers on walls are too few to check each other."""
    walls = walls_alone(solved)
    if not 0 < len(walls) <= HELD:
        return []
    names = tuple(str(n) for n in solved.task.markers.name[walls])
    listed = ", ".join(["{}"] * len(names))
    words = (
        f"whether a marker on a wall ({listed}) was displaced would go unnoticed here, or which one: all cameras move, "
        "and no more than these hold them, so they cannot check each other (a fourth would); no sigma contains it"
    )
    return [Doubt(names, words, "marker")]


def displaced_wall(solved: Solved) -> tuple[Doubt, Array] | None:
    """That a marker on a wall, or one of several, is displaced, and (F, F) what that adds to the covariance.

    None where no spot of theirs was left out, where none explains it, or where all spots of the one that does were.
    """
    task, walls = solved.task, walls_alone(solved)
    out = ~solved.used & task.wall[task.observations.point]
    if not len(walls) or not out.any():
        return None
    far = UNSEEN * _how_far(solved, out)
    healed = {n: other for n in walls.tolist() if (other := _loosened(solved, n, far)) is not None}
    least = min((other.chi2 for other in healed.values()), default=np.inf)
    blamed = task.observations.point[out]  # by chance, perhaps: the spot that went first took the others' part
    alike = [n for n, other in healed.items() if other.chi2 < least + LIKELIER or n in blamed]
    # A place is three unknowns, and takes the spots back that were left out.
    taken_back = critical(len(solved.used)) * int(out.sum()) - 3 * np.log(2 * len(solved.used))
    if not alike or least > solved.chi2 + taken_back + LIKELIER:
        return None
    steps = [_step(solved, healed[n]) for n in alike]
    # Left out as a gross error of its own, a spot leaves its marker's others to pull, which matters where little holds.
    if len(alike) == 1 and not (np.abs(steps[0]) > MATTERS * np.sqrt(np.diag(solved.cov))).any():
        return None
    second = np.mean([np.outer(s, s) + healed[n].cov for s, n in zip(steps, alike, strict=True)], axis=0)
    names = tuple(str(n) for n in task.markers.name[alike])
    listed = " or ".join(["{}"] * len(names))
    which = "and these pictures hardly tell which" if len(names) > 1 else "or one of its spots is something else's"
    words = (
        f"{listed} is not where its table has it, {which}: all cameras move, and {len(walls)} markers on walls are all "
        "that holds them; the sigmas hold what that would change"
    )
    return Doubt(names, words, "marker"), second - solved.cov


def _how_far(solved: Solved, out: NDArray[np.bool_]) -> float:
    """The largest distance from its place at which the ray of a spot that was left out passes a marker."""
    task, values = solved.task, solved.values
    point, view = (a[out] for a in task.slots)
    place = in_tunnel(task.placed.place(values[LAW]), task.wall, values[MOTION])
    off = residuals_of_all(solved)[point[:, None], 2 * view[:, None] + np.arange(2)]
    far = 0.0
    for n, v, each in zip(point, view, off, strict=True):
        seen = task.views[v]
        depth = float(np.linalg.norm(values[pose_block(seen.name)].apply(place[n])))
        far = max(far, float(np.linalg.norm(each)) * depth / task.cameras[seen.camera].focal_px)
    return far


def _loosened(solved: Solved, n: int, far: float) -> Solved | None:
    """The instant with the place of a marker known to ``far`` only, and no spot of a wall left out; None for none."""
    task, every = solved.task, solved.task.observations
    kept = solved.used | task.wall[every.point]
    seen = Observations(every.view[kept], every.point[kept], every.xy[kept], every.cov[kept])
    cov = np.zeros((len(task.markers), 3, 3)) if task.place_cov is None else task.place_cov.copy()
    cov[n] = cov[n] + far**2 * np.eye(3)
    try:
        other = replace(task, place_cov=cov, observations=seen)
        found = solve(other, dict(solved.values), solved.shift[kept], False, near=False)
    except DegenerateGeometry:
        return None
    return None if isinstance(found, NotIdentified) else found


def _step(solved: Solved, other: Solved) -> Array:
    """(F,) from one solution of an instant to another one."""
    out = np.zeros(len(solved.cov))
    for key, where in solved.problem.slices.items():
        before: Any = solved.values[key]
        after: Any = other.values[key]
        if key == LAW:
            out[where] = after - before
        elif isinstance(before, Pose):
            out[where] = (after @ before.inverse()).log()
    return out
