"""Whether pictures show another focal length than the one that is given as known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from windmark.calibration import Distance, Free
from windmark.calibration.datum import Datum
from windmark.errors import g2
from windmark.scene import Doubt, MarkerSet
from windmark.tasks.reconstruct.interior import FOCAL as FOCAL_LENGTH
from windmark.tasks.reconstruct.other_camera import OtherCamera, refuse_other
from windmark.tasks.reconstruct.structure import Structure, adjusted
from windmark.tasks.reconstruct.task import Refused, Task

FOCAL = "focal_px"
VIEWS = 3
"""Two pictures hardly show a focal length; with known markers in them they do."""
SIGMAS = 6.0
"""By so much it is another one; lens models that miss something move it, too, by a few of the sigmas of clean marks."""
GROSS = 0.01
"""Part by which it is off from which nothing is to be had with it: links fail, groups fall apart. `register`
refuses from there on, too."""


@dataclass(frozen=True)
class OtherFocal:
    """Of a camera: the focal length that is given, the one that its pictures show, and its sigma, pixels."""

    camera: str
    given: float
    seen: float
    sigma: float

    def __str__(self) -> str:
        return str(self.doubt)

    @property
    def doubt(self) -> Doubt:
        """Of a result that was adjusted with the given one."""
        words = (f"the pictures of {{}} show a focal length of {self.seen:.5g} +- {g2(self.sigma)} px, the given focal "
                 f"length of {self.given:.5g} px does not fit")  # fmt: skip
        return Doubt((self.camera,), words, "focal")


def refuse_gross(task: Task, structure: Structure, words: str = "", **known: Any) -> list[OtherFocal]:
    """`other_focals`; `Refused` where the given one is grossly off by a structure's pictures; ``words`` are added."""
    found = other_focals(task, structure, **known)
    gross = [f for f in found if abs(f.seen / f.given - 1) > GROSS]
    if gross:
        # Held at what is wrong, a lens or a principal point shows as a focal length.
        refuse_other(task, structure, str(gross[0]), focal=False, **known)
        raise Refused("focal", f"{gross[0]}{words}; give the right one, or free `{FOCAL}`")
    return found


def other_focals(
    task: Task, structure: Structure, datum: Datum | None = None, names: Sequence[str] | None = None,
    table: MarkerSet | None = None, distances: Sequence[Distance] = (),
) -> list[OtherFocal]:  # fmt: skip
    """Cameras whose given focal length the pictures contradict, by an adjustment of everything with it free.

    Parameters
    ----------
    structure : adjusted with the given ones
    datum, names, table, distances : see `adjusted`; by default the points hold the frame
    """
    free = datum is None or isinstance(datum, Free)
    if FOCAL in task.free or len(structure.poses) < (VIEWS if free else 2):
        return []
    result = adjusted(task, structure, datum or Free(), (*task.free, FOCAL), names, table, distances)
    if not isinstance(result, tuple):
        return []
    out = []
    for name, camera in result[1].cameras.items():
        given = task.cameras[name]
        known = 0.0 if given.cov is None else float(given.cov[0, 0])
        sigma = result[1].sigma(name, FOCAL)
        if abs(camera.focal_px - given.focal_px) > SIGMAS * np.sqrt(sigma**2 + known):
            out.append(OtherFocal(name, given.focal_px, camera.focal_px, sigma))
    return sorted(out, key=lambda f: -abs(f.seen - f.given) / f.sigma)


def with_focals(focals: Sequence[OtherFocal], other: OtherCamera) -> tuple[Doubt, ...]:
    """Doubts of focal lengths, and of what else of the cameras may be wrong: of each camera what explains most.

    A focal length that is off with all else held may be what another lens or principal point makes of it.
    """
    likeliest = {s.camera: s.things == (FOCAL_LENGTH,) for s in other.shown}
    own = [f for f in focals if likeliest.get(f.camera, True)]
    said = {f.camera for f in own}
    more = (d for s, d in zip(other.shown, other.doubts, strict=True) if s.camera not in said)
    return (*(f.doubt for f in own), *more)
