"""Pictures whose focal length, principal point or distortion is not that of the others (focused anew, cut), or that are
sheared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from windmark.calibration.changed_scene import changed_scene
from windmark.calibration.datum import Free
from windmark.calibration.held_interior import CAUSE as HELD
from windmark.calibration.held_interior import held_wrongly
from windmark.calibration.setup import Job
from windmark.calibration.solve import Solved
from windmark.calibration.view_changes import (
    ANEW,
    DISTORTION,
    FOCAL,
    PRINCIPAL_POINT,
    SHEAR,
    Asked,
    Equations,
    Otherwise,
    asked,
    equations_of,
    worst_focal,
    worst_shifts,
)
from windmark.errors import g1, g2
from windmark.scene import Doubt

NAMED = 5
"""Pictures that are named at most."""
THINGS = {
    "focal": "focal length", "principal": "principal point", "sheared": "shear", "distorted": "distortion",
}  # fmt: skip
"""What may be another one in a view, by the cause of its doubt."""
UNITS = {"focal": (100, " %"), "principal": (1, " px"), "sheared": (100, " %"), "distorted": (1, " of k1")}
"""In what its size is said: a factor and the unit."""
FREED = {"focal": "free_focal", "principal": "free_principal"}
"""The option that frees it."""


def changes(job: Job, solved: Solved, found: Equations | None = None) -> dict[str, Asked]:
    """Whether views ask for a focal length, a principal point, ... of their own (Baarda 1968), by `THINGS`."""
    found = equations_of(solved) if found is None else found
    if not len(found.views):
        return dict.fromkeys(THINGS, Asked())
    by_itself = set(job.free_focal) >= {v.name for v in job.views}
    return {
        "focal": asked(job, solved, found, FOCAL, worst_focal),
        "principal": asked(job, solved, found, PRINCIPAL_POINT, worst_shifts if by_itself else None),
        "sheared": asked(job, solved, found, SHEAR, None),
        "distorted": asked(job, solved, found, DISTORTION, None),
    }


def asked_most(asking: Mapping[str, Asked]) -> tuple[str, Asked]:
    """Which of `THINGS` the marks ask for, "" for none: a change of one looks like some of the other."""
    asking = {kind: most for kind, most in asking.items() if most.own or most.together}
    kind = max(asking, key=lambda k: asking[k].lead, default="")
    return kind, asking.get(kind, Asked())


def change_doubts(job: Job, solved: Solved, alone: Solved | None = None, *, misfit: bool = False) -> tuple[Doubt, ...]:
    """What is said of pictures that are not as the others of their camera, or may not be.

    ``alone``: the same pictures without known markers. A table of the wrong shape bends the network, and pictures seem
    to ask for shears or another scene, of which their marks know nothing. ``misfit``: that is known and said already.
    """
    said, asking = _differing(job, solved)
    if said and alone is not None and (own := _differing(replace(job, datum=Free(), distances=()), alone)[0]):
        return own
    if not said or (alone is not None and misfit):
        return _unchecked(job, solved, asking)
    (doubt,) = said
    if alone is None or doubt.cause == HELD:
        return said
    words = (
        "the known markers do not have the shape that the pictures give them, or these are too few to show alone what "
        f"they show beside them; without known places they agree, with them: {doubt.words}"
    )
    return (Doubt(doubt.names, words, "table"),)


def _differing(job: Job, solved: Solved) -> tuple[tuple[Doubt, ...], dict[str, Asked]]:
    """What the marks of pictures say against these, one doubt at most, and what of `changes` they ask for."""
    equations = equations_of(solved)
    asking = changes(job, solved, equations)
    kind, most = asked_most(asking)
    scene = changed_scene(job, solved)
    wrong = held_wrongly(job, solved, equations, differ=bool(kind or scene))
    if wrong is not None and wrong.lead > max(most.lead if kind else 0.0, scene.lead if scene else 0.0):
        return (wrong.doubt(),), asking
    if scene is not None and (not kind or scene.lead > most.lead):
        return (scene.doubt(job.markers.length_unit),), asking
    return ((_said(most, kind),) if kind else ()), asking


def _unchecked(job: Job, solved: Solved, asking: Mapping[str, Asked]) -> tuple[Doubt, ...]:
    """What of the pictures nothing checks."""
    focal, principal = asking["focal"], asking["principal"]
    if focal.worst is not None:
        off = f"{g2(focal.worst.off)} px, {g2(focal.worst.sigmas)} of its sigmas"
        words = (
            f"nothing checks that the pictures have one focus: a focal length {100 * ANEW:g} % off in one of them "
            f"alone would mostly go unnoticed, and the camera's be off by {off}"
        )
        return (Doubt((), words, "focus"),)
    if principal.worst is not None:
        size = ANEW * max(c.focal_px for c in solved.state.cameras)
        length = f"{g2(principal.worst.off)} {job.markers.length_unit}".rstrip()
        off = f"{length}, {g2(principal.worst.sigmas)} of its sigmas"
        words = (
            "nothing checks that the pictures, which all have a focus of their own, have one principal point: "
            f"{size:.0f} px (1 sigma) would mostly go unnoticed, and a marker be off by up to {off}"
        )
        return (Doubt((), words, "focus"),)
    return ()


def _said(most: Asked, kind: str) -> Doubt:
    """What is asked for, in words."""
    by = f" ({FREED[kind]})" if kind in FREED else ""
    if not most.own:
        scale, unit = UNITS[kind]
        size = f"{g2(scale * most.together)}{unit}"
        return Doubt((), f"{THINGS[kind]}s of the pictures differ by {size} (rms){by}", kind)
    worst = most.own[:NAMED]
    listed = ", ".join(f"{{}} ({amount(found, kind)})" for found in worst)
    more = f" and {len(most.own) - NAMED} more" if len(most.own) > NAMED else ""
    words = f"{THINGS[kind]} not that of the other pictures{by}: {listed}{more}"
    return Doubt(tuple(found.view for found in worst), words, kind)


def amount(found: Otherwise, kind: str) -> str:
    """The change of a view with its sigma, in words."""
    scale, unit = UNITS[kind]
    numbers = zip(scale * found.change, scale * found.sigma, strict=True)
    return ", ".join(f"{change:+.2g} +- {g1(sigma)}" for change, sigma in numbers) + unit
