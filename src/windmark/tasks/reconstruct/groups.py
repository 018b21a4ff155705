"""Groups of pictures that share no markers: each reconstructed by itself, joined where the primary markers do it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from windmark.scene import MarkerSet
from windmark.tasks.reconstruct.begin import beginning
from windmark.tasks.reconstruct.focal import refuse_gross
from windmark.tasks.reconstruct.frame import Held, holding
from windmark.tasks.reconstruct.free import transformed
from windmark.tasks.reconstruct.grow import from_nothing, refined
from windmark.tasks.reconstruct.matched import PairMatcher
from windmark.tasks.reconstruct.other_camera import refuse_other
from windmark.tasks.reconstruct.primaries import Located, locate
from windmark.tasks.reconstruct.structure import Structure
from windmark.tasks.reconstruct.task import Refused, Task

MOST_GROUPS = 4
NAMED = 6
"""Pictures of a group that are named."""


@dataclass(frozen=True)
class Group:
    """Pictures that share markers: their structure, and how each was found."""

    structure: Structure
    found_by: dict[int, str]

    @property
    def views(self) -> list[int]:
        """The pictures, in order."""
        return self.structure.posed


@dataclass(frozen=True)
class Framed:
    """What the result is made of.

    Parameters
    ----------
    group : in the primaries' frame
    located : its primaries; None where there are none and its frame is a free one, or that of given poses
    others : groups that are not connected with it
    """

    group: Group
    located: Located | None
    others: tuple[Group, ...]


def framed(task: Task, rough: MarkerSet | None) -> Framed:
    """All pictures that can be had in the frame of the primaries.

    Raises
    ------
    Refused
        Where nothing can be reconstructed, or the primaries are in no group; "unconnected" where there are several.
    """
    groups = _groups(task, rough)
    if not len(task.primary):
        return Framed(groups[0], None, tuple(groups[1:]))
    found: list[tuple[Group, Located]] = []
    refusals: list[Refused] = []
    for group in groups:
        try:
            located = locate(task, group.structure)
        except Refused as refusal:
            refusals.append(refusal)
            continue
        found.append((replace(group, structure=transformed(group.structure, located.frame)), located))
    posed = sum(v in task.given for v in groups[0].views)
    if not found and posed >= 2 and refusals[0].cause == "not_found":
        return Framed(groups[0], None, tuple(groups[1:]))  # the poses hold the frame
    if not found:
        raise _refused(task, groups, refusals[0])
    (best, located), others = found[0], [g for g in groups if all(g.views != f.views for f, _ in found)]
    for group, its in found[1:]:
        joined = _joined(task, best, located, group, its)
        if joined is None:
            others.append(group)
        else:
            best, located = joined
    return Framed(best, located, tuple(others))


def why_left(task: Task, others: tuple[Group, ...], view: int) -> str:
    """With which other pictures one is connected that is not in the result; "" for none."""
    for group in others:
        if view in group.views:
            rest = [v for v in group.views if v != view]
            return f"connected with {_names(task, rest)}, but with none of the pictures that have the primary markers"
    return ""


def _groups(task: Task, rough: MarkerSet | None) -> list[Group]:
    """The largest group first."""
    match = PairMatcher(task)
    groups = [Group(*beginning(task, rough, match))]
    while len(groups) < MOST_GROUPS:
        left = sorted(set(task.usable) - {v for g in groups for v in g.views})
        try:
            groups.append(Group(*from_nothing(task, left, match)))
        except Refused:
            break
    return sorted(groups, key=lambda g: -len(g.views))


def _refused(task: Task, groups: list[Group], refusal: Refused) -> Refused:
    """Why no group has the primaries: they share nothing with each other, or other pictures could not be connected.

    A focal length, or another thing of a camera, that the largest group contradicts explains both.
    """
    refuse_gross(task, groups[0].structure, f" (by {_names(task, groups[0].views)}; {refusal.reason})")
    refuse_other(task, groups[0].structure, refusal.reason)
    if refusal.nearly is not None:
        # Taken for the right ones: would they be with another camera?
        structure = transformed(groups[0].structure, refusal.nearly.frame)
        frame = Held(task, structure, refusal.nearly)
        structure, names = frame.prepared(structure)
        refuse_other(task, structure, refusal.reason, **holding(frame, names))
    alone = sorted(set(task.usable) - {v for g in groups for v in g.views})
    if len(groups) > 1:
        words = "; ".join(_names(task, g.views) for g in groups)
        return Refused(
            "unconnected", f"{len(groups)} groups of pictures share no markers with each other ({words}), and in none "
            f"of them alone the primary markers were recognised (in the first: {refusal.reason}); take pictures that "
            "show markers of both",
        )  # fmt: skip
    if refusal.cause == "not_found" and len(alone) > 1:
        return Refused(
            "unconnected", f"{len(alone)} pictures ({_names(task, alone)}) could not be connected with the others "
            f"({_names(task, groups[0].views)}), and in these alone the primary markers were not recognised: "
            f"{refusal.reason}", alone,
        )  # fmt: skip
    return refusal


def _names(task: Task, views: list[int]) -> str:
    some = ", ".join(task.views[v].name for v in views[:NAMED])
    return some if len(views) <= NAMED else f"{some} and {len(views) - NAMED} more"


def _joined(
    task: Task, group: Group, located: Located, other: Group, its: Located
) -> tuple[Group, Located] | None:  # fmt: skip
    """Two groups as one, by the primaries that both have; None where they do not fit together."""
    a, b = group.structure, other.structure
    mine = dict(zip(located.primary.tolist(), located.point.tolist(), strict=True))
    number = len(a.xyz) + np.arange(len(b.xyz))
    for primary, point in zip(its.primary.tolist(), its.point.tolist(), strict=True):
        number[point] = mine.get(primary, number[point])
    both = Structure(
        np.concatenate([a.xyz, b.xyz]), np.concatenate([a.point, number[b.point]]), np.concatenate([a.view, b.view]),
        np.concatenate([a.spot, b.spot]), {**a.poses, **b.poses}, {}, a.cameras,
    )  # fmt: skip
    structure = refined(task, both)
    if structure is None or set(structure.poses) != set(both.poses):
        return None
    try:
        located = locate(task, structure)
    except Refused:
        return None
    joined = Group(transformed(structure, located.frame), {**group.found_by, **other.found_by})
    return joined, located
