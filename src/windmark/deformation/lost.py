"""What was left out together: exchanged labels, a marker that stands elsewhere, a view against the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc, chdtrc

from windmark.adjust import exchanged_pairs
from windmark.deformation.misfit import length_unit
from windmark.deformation.own_state import own_state
from windmark.deformation.sighting import LAW, MOTION, by_place, in_tunnel
from windmark.deformation.solve import Solved
from windmark.errors import g2
from windmark.scene import Doubt

Array = NDArray[np.float64]

FALSE = 1e-3
"""Probability that marks that are right, or gross errors that have nothing in common, are taken for the other."""
SINGLE = 3
"""Markers of a volume that are said to stand elsewhere one by one."""
PART = 0.1
"""A volume that lost so many of its marks, and far more than the others."""
QUARTER = 0.25
"""A view that lost so many of its marks, and far more than the others, is named."""


def lost(solved: Solved) -> list[Doubt]:
    """Markers and views whose marks were left out together."""
    if solved.used.all():
        return []
    swapped = _exchanged(solved)
    named = {n for doubt in swapped for n in doubt.names}
    elsewhere = {n: off for n, off in _elsewhere(solved).items() if solved.task.markers.name[n] not in named}
    beside = _beside(solved, elsewhere)
    named |= {n for doubt in beside for n in doubt.names}
    return [*swapped, *beside, *_gone(solved, named), *_views(solved)]


def _exchanged(solved: Solved) -> list[Doubt]:
    """Markers of which one view took each for the other, by pairs; the views that did are in the sentence."""
    task, bad = solved.task, np.flatnonzero(~solved.used)
    point, view = task.slots
    seen = task.observations.xy[bad] - solved.shift[bad]
    there = seen + residuals_of_all(solved)[point[bad, None], 2 * view[bad, None] + np.arange(2)]
    sigma = np.sqrt(np.trace(task.observations.cov[bad], axis1=1, axis2=2) / 2)
    found: dict[tuple[str, str], list[str]] = {}
    for v in np.unique(view[bad]):
        own = np.flatnonzero(view[bad] == v)
        for a, b in exchanged_pairs(seen[own], there[own], sigma[own]):
            names = task.markers.name[point[bad[own[[a, b]]]]]
            found.setdefault((str(names[0]), str(names[1])), []).append(task.views[int(v)].name)
    words = "labels of {} and {} are exchanged in "
    return [Doubt(pair, words + ", ".join(views), "swapped") for pair, views in found.items()]


def residuals_of_all(solved: Solved) -> Array:
    """(P, 2 V) projected - observed of all observations, those left out, too."""
    term = solved.sighting
    if not solved.used.all():
        sights = solved.task.sights(solved.shift, np.ones(len(solved.used), bool))
        term = replace(term, sights=sights, _last=[])
    raw = term.raw(solved.values)
    assert raw is not None  # what was left out has been predicted for its test
    return raw


def _elsewhere(solved: Solved) -> dict[int, float]:
    """How far off markers are whose two marks or more are all wrong, and agree with each other on another place."""
    task, values = solved.task, solved.values
    point, view = task.slots
    wrong = np.flatnonzero(_marks_lost(solved) > 1)
    if not len(wrong):
        return {}
    place = in_tunnel(task.placed.place(values[LAW]), task.wall, values[MOTION])
    residual = residuals_of_all(solved)
    by = by_place(task.sights(solved.shift, np.ones(len(point), bool)), values, place)
    out = {}
    for n in wrong.tolist():
        own = np.flatnonzero(point == n)
        rows = (2 * view[own, None] + np.arange(2)).ravel()
        half = np.linalg.inv(np.linalg.cholesky(task.observations.cov[own]))
        e = (half @ residual[n, rows].reshape(-1, 2, 1)).ravel()
        a = (half @ by[n, rows].reshape(-1, 2, 3)).reshape(-1, 3)
        off = np.linalg.lstsq(a, -e, rcond=None)[0]
        if chdtrc(len(e) - 3, float(((e + a @ off) ** 2).sum())) > FALSE:
            out[n] = float(np.linalg.norm(off))
    return out


def _marks_lost(solved: Solved) -> NDArray[np.int64]:
    """(N,) how many marks were left out of a marker that lost all of them; 0 for the others."""
    point, count = solved.task.observations.point, len(solved.task.markers)
    every, left = np.bincount(point, minlength=count), np.bincount(point[~solved.used], minlength=count)
    return np.where(left == every, left, 0)


def _listed(count: int, volume: str) -> str:
    """Places for the names of the first `SINGLE` of more markers of a volume, and how many there are besides."""
    return ", ".join(["{}"] * SINGLE) + f" and {count - SINGLE} more markers" + (f" of {volume}" if volume else "")


def _beside(solved: Solved, off: Mapping[int, float]) -> list[Doubt]:
    """Such markers one by one; of a volume that has more than `SINGLE` of them, all in one sentence."""
    task, unit, out = solved.task, length_unit(solved.task.volumes), []
    volume = {n: str(task.placed.names[n]) for n in off}
    for name in dict.fromkeys(volume.values()):
        own = sorted((n for n in off if volume[n] == name), key=lambda n: -off[n])
        if len(own) > SINGLE:
            size = f"{g2(off[own[-1]])} to {g2(off[own[0]])} {unit}".rstrip()
            names = tuple(str(task.markers.name[n]) for n in own)
            out.append(Doubt(names, f"{_listed(len(own), name)} are {size} from where their table has them", "marker"))
            continue
        for n in own:
            words = f"{{}} is {g2(off[n])} {unit}".rstrip() + " from where its table has it"
            out.append(Doubt((str(task.markers.name[n]),), words, "marker"))
    return out


def _gone(solved: Solved, named: set[str]) -> list[Doubt]:
    """Markers of a volume, not ``named`` yet, that lost all their marks while its rest, and other volumes, lost few.

    One mark says nothing of another place; that they are so many of one volume does: of another part in the table, say.
    """
    task, out = solved.task, []
    volume = np.where(task.wall, "", task.placed.names)
    lost_all = (_marks_lost(solved) > 0) & ~np.isin(task.markers.name, [*named])
    for name in dict.fromkeys(volume[lost_all & (volume != "")].tolist()):
        names = tuple(task.markers.name[lost_all & (volume == name)].tolist())
        if len(names) > SINGLE and _many(~solved.used, volume[task.observations.point] == name, PART):
            out.append(Doubt(names, f"{_listed(len(names), name)} are not where the rest of it says: they stand "
                             "elsewhere, or move with another part", "marker"))  # fmt: skip
    return out


def _views(solved: Solved) -> list[Doubt]:
    """Views that lost a quarter of their marks or more, or most of those on walls, beside what the others lost."""
    task, view, bad = solved.task, solved.task.observations.view, ~solved.used
    wall = task.wall[task.observations.point]
    out = []
    for n, name in enumerate(v.name for v in task.views):
        own, on_wall = view == n, (view == n) & wall
        if _many(bad, on_wall, 0.5) and not _many(bad, own & ~wall, QUARTER):
            # The model's own motion takes up what a camera is off, and leaves the walls alone with it.
            gone, every = int((bad & on_wall).sum()), int(on_wall.sum())
            words = f"{gone} of the {every} spots of {{}} on walls are beside their places, its others are not: it "
            out.append(Doubt((name,), f"{words}is not where it is said to be, or the walls' markers are not", "moved"))
        elif _many(bad, own, QUARTER):
            words = f"{{}} lost {int((bad & own).sum())} of its {int(own.sum())} spots: "
            words += "it moved, or has wrong labels" if (state := own_state(solved, n)) is None else state.words
            out.append(Doubt((name,), words, "picture"))
    return out


def _many(bad: NDArray[np.bool_], own: NDArray[np.bool_], part: float) -> bool:
    """Whether some marks lost as large a part as ``part``, and far more than all others did."""
    gone, every = int((bad & own).sum()), int(own.sum())
    if gone < 2 or gone < part * every or every == len(bad):
        return False
    usual = (bad.sum() - gone + 1) / (len(bad) - every + 1)
    return bool(bdtrc(gone - 1, every, min(usual, 1.0)) < FALSE)
