"""Markers on walls that alone hold cameras which move: what three of them say nothing checks.

With all cameras free the model and they are one body, which the walls' markers hold in the tunnel. Three do that; where
one of them has been displaced the triangle does not fit, one spot is left out for it, and which one is chance: whether
the first, the second or the third is displaced, the pictures are explained. So each is asked whether it is the one, its
place being known as badly as the spot that was left out says; where several explain them as well, that is said, and the
covariance has what they differ by (the mixture's second moment). Of four to six any two may be displaced as well, where
no single one explains it: two against two tell no more than one against two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import chance
from windmark.deformation.equations import Added, Equations
from windmark.deformation.lost import residuals_of_all
from windmark.deformation.outliers import critical
from windmark.deformation.result import NotIdentified
from windmark.deformation.setup import Task
from windmark.deformation.sighting import LAW, MOTION, in_tunnel, pose_block
from windmark.deformation.solve import Solved, solve
from windmark.geometry import DegenerateGeometry, Pose
from windmark.scene import Doubt, Observations

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

HELD = 3
"""Markers that hold a body; each beyond tells of the others."""
MOST = 6
"""Of so many any two are asked; of more the others outvote them spot by spot."""
FALSE = 2.5e-4
"""Probability that a marker that is where it should be is said to contradict the others."""
BENT = 0.05
"""Part by which linear equations may have too little of what a displaced marker explains."""
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
    """That a marker on a wall, or one of several, or two of them are displaced, and (F, F) what the covariance lacks.

    None where no spot of theirs was left out and none of their places contradicts the others; where no place explains
    it, or where all spots of the one that does were left out.
    """
    task, walls = solved.task, walls_alone(solved)
    out = ~solved.used & task.wall[task.observations.point]
    if not len(walls):
        return None
    off = _contradicted(Equations(solved), walls) if solved.redundancy >= 1 else {}
    if not out.any() and not off:
        return None
    far = UNSEEN * max(_how_far(solved, out) if out.any() else 0.0, *off.values(), 0.0)
    healed = _healed(solved, [(n,) for n in walls.tolist()], far)
    least = min((other.chi2 for other in healed.values()), default=np.inf)
    blamed = task.observations.point[out]  # by chance, perhaps: the spot that went first took the others' part
    alike = [s for s, other in healed.items() if other.chi2 < least + LIKELIER or s[0] in blamed]
    # A place is three unknowns, and takes the spots back that were left out.
    place = 3 * np.log(2 * len(solved.used))
    taken_back = critical(len(solved.used)) * int(out.sum()) - place
    explained = bool(alike) and least <= solved.chi2 + taken_back + LIKELIER
    if HELD < len(walls) <= MOST and (pairs := _pairs(solved, healed, walls, far, place)):
        healed, explained = pairs, True
        score = {s: other.chi2 + place * len(s) for s, other in healed.items()}
        alike = [s for s in healed if score[s] < min(score.values()) + LIKELIER]
    if not explained:
        return None
    steps = [_step(solved, healed[s]) for s in alike]
    # Left out as a gross error of its own, a spot leaves its marker's others to pull, which matters where little holds.
    if len(alike) == 1 and not (np.abs(steps[0]) > MATTERS * np.sqrt(np.diag(solved.cov))).any():
        return None
    second = np.mean([np.outer(s, s) + healed[n].cov for s, n in zip(steps, alike, strict=True)], axis=0)
    return _doubt(task, alike, len(walls)), second - solved.cov


def _pairs(
    solved: Solved, healed: Mapping[tuple[int, ...], Solved], walls: Ints, far: float, place: float
) -> dict[tuple[int, ...], Solved]:
    """The instant with any two displaced, beside each by itself, ``healed``; empty where one explains it as well.

    ``place`` is what one place more has to explain (Schwarz 1978). Where the best one leaves another one in
    contradiction with the rest, it explains nothing.
    """
    every = list(combinations(walls.tolist(), 2))
    least = min((other.chi2 for other in healed.values()), default=np.inf)
    best = next((s for s, other in healed.items() if other.chi2 == least), None)
    if best is None or _contradicted(Equations(healed[best]), walls):
        return _healed(solved, every, far)
    asked = _likely(solved, best, healed[best], every, walls, place)
    if not any(other.chi2 + place < least for other in _healed(solved, asked, far).values()):
        return {}
    return {**healed, **_healed(solved, every, far)}


def _likely(
    solved: Solved, best: tuple[int, ...], other: Solved, sets: list[tuple[int, int]], walls: Ints, place: float
) -> list[tuple[int, int]]:
    """Those of some sets that may explain ``place`` more than the best marker by itself, by linear equations."""
    beside = _by_places(Equations(other), walls)
    none = _loosened(solved, (), 0.0)
    if none is None:
        return sets
    alone = _by_places(Equations(none), walls)
    index = {n: 3 * k + np.arange(3) for k, n in enumerate(walls.tolist())}
    out = []
    for a, b in sets:
        if best[0] in (a, b):
            more = beside.fitted(index[b if a == best[0] else a])[0]
        else:
            test = alone.fitted(np.concatenate([index[a], index[b]]))[0]
            more = other.chi2 - none.chi2 + test * (1 + BENT)
        if more > place:
            out.append((a, b))
    return out


def _contradicted(equations: Equations, walls: Ints) -> dict[int, float]:
    """How far off the places of markers on walls are that the others contradict, each by itself."""
    task, squares, redundancy = equations.solved.task, equations.solved.chi2, equations.solved.redundancy
    added, off = _by_places(equations, walls), {}
    for k, n in enumerate(walls.tolist()):
        if task.seen[n]:
            test, rank, value, _ = added.fitted(3 * k + np.arange(3))
            if chance(test, rank, max(squares, redundancy + test), redundancy) < FALSE / len(walls):
                off[n] = float(np.linalg.norm(value))
    return off


def _by_places(equations: Equations, walls: Ints) -> Added:
    """The places of some markers as unknowns, three each."""
    return equations.added(columns_of(equations, walls))


def columns_of(equations: Equations, walls: Ints) -> Array:
    """(P, 2 V, 3 W) derivatives of the pixels by the places of some markers."""
    by = equations.by_place
    columns = np.zeros((*by.shape[:2], len(walls), 3))
    columns[walls, :, np.arange(len(walls))] = by[walls]
    return columns.reshape(*by.shape[:2], -1)


def _healed(solved: Solved, sets: Sequence[tuple[int, ...]], far: float) -> dict[tuple[int, ...], Solved]:
    """The instant with each of some sets of markers displaced, as far as there is a solution."""
    return {s: other for s in sets if (other := _loosened(solved, s, far)) is not None}


def _doubt(task: Task, sets: Sequence[tuple[int, ...]], walls: int) -> Doubt:
    """What is said of some sets of markers of which one is displaced."""
    which, listed = displaced_words(sets)
    names = tuple(str(n) for n in task.markers.name[which])
    held = (f": all cameras move, and {walls} markers on walls are all that holds them; the sigmas hold what that "
            "would change")  # fmt: skip
    if all(len(s) == 1 for s in sets):
        more = "and these pictures hardly tell which" if len(names) > 1 else "or one of its spots is something else's"
        return Doubt(names, f"{listed} is not where its table has it, {more}{held}", "marker")
    more = ", and these pictures hardly tell which" if len(sets) > 1 else ""
    return Doubt(names, f"{listed} are not where their table has them{more}{held}", "marker")


def displaced_words(sets: Sequence[tuple[int, ...]]) -> tuple[list[int], str]:
    """Some sets of markers of which one is displaced, as words with a place for the name of each of the first."""
    which = list(dict.fromkeys(n for s in sets for n in s))
    if all(len(s) == 1 for s in sets):
        return which, " or ".join(["{}"] * len(which))
    if len(sets) > 2:
        count = "two" if all(len(s) == 2 for s in sets) else "one or two"
        return which, f"{count} of {', '.join(['{}'] * (len(which) - 1))} and {{}}"
    listed = ", or ".join(" and ".join(["{}"] * len(s)) for s in sets) + "," * (len(sets) - 1)
    return [n for s in sets for n in s], listed


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


def _loosened(solved: Solved, which: tuple[int, ...], far: float) -> Solved | None:
    """The instant with some markers' places known to ``far`` only, and no spot of a wall left out; None for none."""
    task, every = solved.task, solved.task.observations
    kept = solved.used | task.wall[every.point]
    seen = Observations(every.view[kept], every.point[kept], every.xy[kept], every.cov[kept])
    cov = np.zeros((len(task.markers), 3, 3)) if task.place_cov is None else task.place_cov.copy()
    cov[list(which)] += far**2 * np.eye(3)
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
