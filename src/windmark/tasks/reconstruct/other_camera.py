"""What a reconstruction says of a camera that is not the given one: in place of what that brings about."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from windmark.calibration import Calibration
from windmark.calibration.changed_scene import CAUSE as SCENE
from windmark.calibration.view_changes import MATTERS
from windmark.errors import g1, g2, g3
from windmark.geometry import Camera
from windmark.scene import Doubt
from windmark.tasks.reconstruct import interior
from windmark.tasks.reconstruct.interior import FOCAL, THINGS, Freed, Shown, freed, others
from windmark.tasks.reconstruct.structure import Structure
from windmark.tasks.reconstruct.task import Refused, Task

CAUSE = "lens"
KNOWN = ("control", "table")
"""Causes of doubts about what is known beforehand."""


@dataclass(frozen=True)
class OtherCamera:
    """What is said of the cameras of a finished reconstruction.

    Parameters
    ----------
    shown, doubts : cameras that are others, and each in words
    calibration : without the doubts that another camera explains
    unchecked : what a camera that goes unnoticed would do, in words; "" where that is little, or one is doubted
    scene : the scene changed between the pictures, whatever the camera: nothing is asked of that then
    """

    shown: tuple[Shown, ...]
    doubts: tuple[Doubt, ...]
    calibration: Calibration
    unchecked: str = ""
    scene: bool = False

    @property
    def may_be_focal(self) -> bool:
        """Whether a focal length may be what is wrong of a camera, or nothing was found to be."""
        return not self.scene and (not self.shown or any(FOCAL in s.all for s in self.shown))


def judged(task: Task, structure: Structure, done: Calibration, **frame: Any) -> OtherCamera:
    """The cameras of a structure that was adjusted with the given ones, in its ``frame`` (see `freed`)."""
    of, unit = freed(task, structure, **frame), task.primary.length_unit
    if of is None:
        return OtherCamera((), (), done)
    if all(any(d.cause == SCENE for d in result.doubts) for result in (done, of.result)):
        # With another camera it did, too: what that camera seems to explain is the change.
        return OtherCamera((), (), done, scene=True)
    left = {(d.cause, d.names) for d in of.result.doubts}
    gone = [d for d in done.doubts if (d.cause, d.names) not in left]
    shift, times = interior.moved(of, done)
    found = others(of, done.sigma0) if gone or times > interior.MOVES else []
    if not found:
        return OtherCamera((), (), done, _unchecked(of, done, unit))
    alone = _by_pictures(task, structure, frame)
    if not alone:
        # As well it may be that known markers are off: what was said of them stays.
        gone = [d for d in gone if d.cause not in KNOWN]
    stays = tuple(d for d in done.doubts if d not in gone)
    suspect = {n for d in stays for n in d.names}
    calmed = replace(done, doubts=stays, suspect=tuple(n for n in done.suspect if n in suspect))
    far = f"; with one that fits the markers are some {g2(shift)} {unit}".rstrip()
    far += f" elsewhere, {g2(times)} of their sigmas (rms)" if shift > 0 else ""
    doubts = tuple(_doubt(s, of.given[s.camera], of, alone, far if shift > 0 else "") for s in found)
    return OtherCamera(tuple(found), doubts, calmed)


def refuse_other(task: Task, structure: Structure, reason: str, *, focal: bool = True, **frame: Any) -> None:
    """`Refused`, if the pictures show another camera than the given one, which explains what failed for a ``reason``.

    Without ``focal`` only where it cannot be the focal length.
    """
    of = freed(task, structure, **frame)
    found = [] if of is None else others(of)
    if of is not None and found and (focal or FOCAL not in found[0].all):
        alone = not frame or _by_pictures(task, structure, frame)
        doubt = _doubt(found[0], of.given[found[0].camera], of, alone, "")
        raise Refused(doubt.cause, f"{doubt} (with the given one: {reason})")


def _by_pictures(task: Task, structure: Structure, frame: dict[str, Any]) -> bool:
    """Whether the pictures show another camera without what is known beforehand."""
    of = freed(task, structure, names=frame.get("names"))
    return of is not None and bool(others(of))


def _doubt(shown: Shown, given: Camera, of: Freed, alone: bool, far: str) -> Doubt:
    """Of a camera that is another one."""
    joined = " and ".join(_named(t, shown, given) for t in shown.things)
    if shown.instead:
        joined += f" (or another {' or '.join(shown.instead)}: nothing here tells these apart)"
    free = of.result.redundancy
    falls = f"sigma0 falls from {g3(np.sqrt((of.squares + shown.fall) / max(free, 1)))} to {g3(of.result.sigma0)}"
    or_else = "" if alone else "; or known markers are not where their table says, which so few pictures do not tell"
    words = f"the pictures show another camera than the file of {{}}: {joined}: {falls} with it{far}{or_else}"
    return Doubt((shown.camera,), words, "focal" if shown.all == (FOCAL,) else CAUSE)


def _named(thing: str, shown: Shown, given: Camera) -> str:
    """One thing that is another one, in figures."""
    off = {n: shown.steps.get(n, 0.0) for n in THINGS[thing]}
    to = {n: getattr(given, n) + step for n, step in off.items()}
    if thing == "principal point":
        return f"principal point at ({to['cx']:.1f}, {to['cy']:.1f}), not ({given.cx:.1f}, {given.cy:.1f}) px"
    if thing == FOCAL:
        return f"focal length of {to['focal_px']:.5g}, not {given.focal_px:.5g} px"
    if thing == "aspect ratio":
        return f"aspect ratio of {to['aspect']:.5f}, not {given.aspect:.5f}"
    half = float(np.hypot(*(np.array(given.size_px) / 2)))
    far = half / given.focal_px
    shift = abs(off["k1"] * far**2 + off["k2"] * far**4) * half
    none = "; the file has none" if not any(given.parameters()[4:]) else ""
    return f"lens distortion, by some {g1(shift)} px at the corners{none}"


def _unchecked(of: Freed, done: Calibration, unit: str) -> str:
    """How far a camera that goes unnoticed may carry a marker, where that is more than its sigma says."""
    reach, times = interior.unnoticed(of, done)
    if times < MATTERS:
        return ""
    length = f"{g2(reach)} {unit}".rstrip()
    return (
        "the camera file is taken as exact, and an error of its lens, principal point, aspect ratio or focal length "
        f"that would mostly go unnoticed here moves a marker by up to {length}, {g2(times)} of its sigmas"
    )
