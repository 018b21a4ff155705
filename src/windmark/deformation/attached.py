"""A volume beside one that moves: is it fixed to that one? Tested by fixing it there, said where it may be.

A flap that bends with its wing and has no ``parent`` is taken to stand with the model's frame: its own parameters take
up what they can of the wing's motion, often without a residual that shows it.
"""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.misfit import length_unit
from windmark.deformation.moved import price
from windmark.deformation.result import NotIdentified
from windmark.deformation.sighting import LAW
from windmark.deformation.solve import Solved, solve
from windmark.deformation.volumes import Placed, Volumes
from windmark.errors import g2
from windmark.geometry import DegenerateGeometry
from windmark.scene import Doubt

Array = NDArray[np.float64]

BEYOND = 6.0
"""A volume moves where its neighbour is when that is so many sigmas."""
TWO = 2.0
"""Sigmas within which most of what may be is."""
LIKELIER = 2 * np.log(100.0)
"""An explanation is taken for the better one when it is a hundred times likelier."""

_KNOWN: WeakKeyDictionary[Placed, tuple[tuple[str, str], ...]] = WeakKeyDictionary()
"""The same volumes are in every frame of a series."""


def unattached(solved: Solved) -> tuple[list[Doubt], list[Doubt]]:
    """Volumes that touch one that moves, and of which the images do not say that they stand still beside it.

    Also, as the second, those of which the images tell neither that nor how far the other one moves there: with little
    known of it (one camera sees it from one side) nothing shows that the law is the wrong one.
    """
    placed, out, unchecked = solved.task.placed, [], []
    if placed not in _KNOWN:
        _KNOWN[placed] = _neighbours(placed)
    for name, beside in _KNOWN[placed]:
        fixed = _attached(solved, name, beside)
        if fixed is None:
            continue
        # What is taken up by the wrong law hides how far it moves there.
        moves = [_motion(s, name, beside) for s in (solved, fixed)]
        far = max(float(np.where(size > BEYOND * sigma, size, 0.0).max(initial=0.0)) for size, sigma in moves)
        lead = price(solved) - price(fixed)
        there = f" (by {g2(far)} {length_unit(solved.task.volumes)}".rstrip() + " there)" if far else ""
        if lead > LIKELIER:
            words = f"{{}} moves with {{}}{there} and is not attached to it: give it that parent"
        elif far > 0.0 and lead > -LIKELIER:
            words = f"{{}} is beside {{}}, which moves{there}: is it attached? Give it that parent if so"
        else:
            if lead > -LIKELIER:
                most = max(float((size + TWO * sigma).max(initial=0.0)) for size, sigma in moves)
                reach = f"{g2(most)} {length_unit(solved.task.volumes)}".rstrip()
                words = (f"whether {{}} moves with {{}} would go unnoticed here, where that moves by up to {reach}; "
                         "its sigmas are those of its own law alone")  # fmt: skip
                unchecked.append(Doubt((name, beside), words, "attached"))
            continue
        out.append(Doubt((name, beside), words, "attached"))
    return out, unchecked


def _neighbours(placed: Placed) -> tuple[tuple[str, str], ...]:
    """Pairs of volumes of which neither carries the other, the second with a law, with markers side by side."""
    parts, names = placed.volumes.parts, np.asarray(placed.names)
    where = {p.name: placed.xyz[names == p.name] for p in parts}
    out = []
    for one in parts:
        for other in parts:
            a, b = where[one.name], where[other.name]
            related = one is other or one.name in _above(placed.volumes, other.name)
            if related or other.law is None or other.name in _above(placed.volumes, one.name):
                continue
            # The larger one carries the smaller one.
            if len(a) < 2 or len(b) < 2 or np.ptp(a, axis=0).max() > np.ptp(b, axis=0).max():
                continue
            if _gaps(a, b).min() <= max(_spacing(a), _spacing(b)):
                out.append((one.name, other.name))
    return tuple(out)


def _above(volumes: Volumes, name: str) -> list[str]:
    """The volumes that carry one."""
    parts, out = {p.name: p for p in volumes.parts}, []
    walk = parts[name].parent
    while walk is not None:
        out.append(walk)
        walk = parts[walk].parent
    return out


def _gaps(a: Array, b: Array) -> Array:
    """(A,) distance of each point to the nearest of the others."""
    return np.asarray(np.linalg.norm(a[:, None] - b[None], axis=2).min(axis=1))


def _spacing(xyz: Array) -> float:
    """The largest distance between a marker and its nearest neighbour."""
    away = np.linalg.norm(xyz[:, None] - xyz[None], axis=2)
    np.fill_diagonal(away, np.inf)
    return float(away.min(axis=1).max())


def _motion(solved: Solved, name: str, beside: str) -> tuple[Array, Array]:
    """How far the law of one volume moves the markers of another one, (k,) and 1 sigma of that."""
    placed, volumes = solved.task.placed, solved.task.volumes
    law = next(p.law for p in volumes.parts if p.name == beside)
    assert law is not None
    own = [k for k, n in enumerate(volumes.names) if n.rsplit(".", 1)[0] == beside]
    xyz, values = placed.xyz[np.asarray(placed.names) == name], np.asarray(solved.values[LAW])
    bound = law.bind(xyz)
    place, slope = bound.linearise(values[own])
    off = place - bound.place(np.array([p.start for p in law.parameters]))
    cov = slope @ solved.cov[np.ix_(own, own)] @ np.swapaxes(slope, 1, 2)
    return np.linalg.norm(off, axis=1), np.sqrt(np.trace(cov, axis1=1, axis2=2))


def _attached(solved: Solved, name: str, beside: str) -> Solved | None:
    """The instant with the volume attached; None without a solution."""
    task = solved.task
    parts = tuple(replace(p, parent=beside, attach=None) if p.name == name else p for p in task.volumes.parts)
    volumes = Volumes.of(parts)
    there = replace(task, volumes=volumes, placed=volumes.bind(task.placed.xyz, task.placed.names))
    try:
        found = solve(there, dict(solved.values), solved.shift, True, near=False)
    except DegenerateGeometry:
        return None
    return None if isinstance(found, NotIdentified) else found
