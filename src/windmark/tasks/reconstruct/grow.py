"""From two views to all: every other picture is registered to the points that are known so far."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.calibration import Free
from windmark.epipolar import PairMatching
from windmark.geometry import DegenerateGeometry, Pose
from windmark.registration import Registration, pose_from_labels, prepare, register
from windmark.scene import MarkerSet
from windmark.tasks.reconstruct.again import asked_again
from windmark.tasks.reconstruct.focal import FOCAL, GROSS, refuse_gross
from windmark.tasks.reconstruct.matched import PairMatcher
from windmark.tasks.reconstruct.seed import FEWEST_POINTS, seeds, settled
from windmark.tasks.reconstruct.structure import Structure, adjusted, compact, linked, point_names
from windmark.tasks.reconstruct.task import Refused, Task

Ints = NDArray[np.int64]

ROUNDS = 6
"""Of registering the pictures that are left and linking all spots anew."""
NEIGHBOURS = 4
"""Posed pictures that one without a pose is matched with."""
VIEWS_FOR_CAMERAS = 5
"""Views that show free interior parameters."""
SURE = 4
"""Views that fit together only where none of them is wrong: a group of pictures, if others do not join it."""
LEAST_COMMON = 6
"""Links to known points that give a pose."""
LONELY = 3
"""Pairs that no other picture joins with which another focal length is tried: two pictures match with almost any, a
third one joins only with the right one."""


def from_nothing(task: Task, views: list[int], match: PairMatcher) -> tuple[Structure, dict[int, str]]:
    """A structure of as many views as can be had, in a frame of its own, and how each was found.

    Raises
    ------
    Refused
        Where no pair of pictures is a beginning.
    """
    best: tuple[Structure, dict[int, str]] | None = None
    covered: set[int] = set()
    lonely = 0
    for seed in seeds(task, views, match, covered):
        if {seed.a, seed.b} <= covered:
            continue
        for start in seed.structures:
            structure = settled(task, start)
            if structure is None or len(structure.xyz) < FEWEST_POINTS:
                continue
            grown, found_by = grow(task, structure, dict.fromkeys((seed.a, seed.b), "pair"), views, match)
            if len(grown.poses) >= SURE:
                covered |= set(grown.poses)
            if best is None or len(grown.poses) > len(best[0].poses):
                best = grown, found_by
            if len(grown.poses) > min(max(len(views) // 2, 2), len(views) - 1) or covered >= set(views):
                return best
            if len(grown.poses) == 2 < len(views) and lonely < LONELY:
                lonely += 1
                other = _with_another_focal(task, start, views, match)
                if other is not None:
                    return other
    if best is None:
        raise Refused("no_pair", "pairs of pictures were matched, but none gives points that fit both pictures")
    return best


def _with_another_focal(
    task: Task, pair: Structure, views: list[int], match: PairMatcher
) -> tuple[Structure, dict[int, str]] | None:
    """What grows from a pair with the focal length that three pictures show together; None where nothing does.

    Which spots of two pictures belong together hardly depends on the focal length, and three pictures with common
    spots show it, from 40 % off.

    Raises
    ------
    Refused
        "focal", where it grows, the given one is grossly off, and it is not to be found.
    """
    for v in sorted(set(views) - set(pair.poses), key=lambda v: min(abs(v - p) for p in pair.poses))[:NEIGHBOURS]:
        for other in pair.posed:
            wider = _from_neighbour(task, pair, v, other, match)
            free = tuple(dict.fromkeys((*task.free, FOCAL)))
            result = None if wider is None else adjusted(task, wider, Free(), free)
            if not isinstance(result, tuple):
                continue
            structure, seen = compact(result[0]), result[1].cameras
            if all(abs(seen[n].focal_px / task.cameras[n].focal_px - 1) < GROSS for n in seen):
                continue  # no other one: nothing grew with it
            cameras = {n: replace(c, focal_px=seen[n].focal_px) if n in seen else c for n, c in task.cameras.items()}
            how = dict.fromkeys(pair.poses, "pair") | {v: "neighbour"}
            grown = grow(replace(task, cameras=cameras), replace(structure, cameras=cameras), how, views, match)
            if len(grown[0].poses) >= min(SURE, len(views)):
                refuse_gross(task, grown[0])
                return grown if FOCAL in task.free else None
    return None


def grow(
    task: Task, structure: Structure, found_by: dict[int, str], views: list[int], match: PairMatcher
) -> tuple[Structure, dict[int, str]]:
    """Views added until no other one fits, and every picture asked again what the points then say of it."""
    structure, found_by = _grown(task, structure, found_by, views, match)
    result = adjusted(task, structure, Free())
    if not isinstance(result, tuple):
        return structure, found_by
    names = point_names(len(result[0].xyz))
    answers = asked_again(task, views, *result, names, found_by, last=False)
    if answers.silent and structure.posed == sorted(views):
        return replace(structure, asked=result[0].links), found_by
    better = refined(task, compact(answers.applied(result[0]))) if answers.changed else None
    if better is None:
        return structure, found_by
    how = found_by | dict.fromkeys(answers.moved, "register")
    return _grown(task, better, {v: how[v] for v in better.poses}, views, match)


def _grown(
    task: Task, structure: Structure, found_by: dict[int, str], views: list[int], match: PairMatcher
) -> tuple[Structure, dict[int, str]]:
    """Views added until no other one fits; after each round all spots are linked anew and everything is adjusted."""
    found_by = dict(found_by)
    for _ in range(ROUNDS):
        left = [v for v in views if v not in structure.poses]
        if not left:
            break
        wider = _registered(task, structure, left)
        how = "register"
        if len(wider.poses) == len(structure.poses):
            wider, how = _by_neighbours(task, structure, left, match), "neighbour"
        new = [v for v in wider.poses if v not in structure.poses]
        found_by.update(dict.fromkeys(new, how))
        if not new:
            break
        better = refined(task, wider)
        if better is None:
            break
        structure = better
        found_by = {v: how for v, how in found_by.items() if v in structure.poses}
    return structure, found_by


def refined(task: Task, structure: Structure) -> Structure | None:
    """The structure adjusted, linked anew, and adjusted again; None where it does not fit together."""
    first = _adjusted(task, structure)
    if first is None:
        return None
    second = _adjusted(task, compact(linked(task, first)))
    return first if second is None else second


def _adjusted(task: Task, structure: Structure) -> Structure | None:
    """With the cameras' free parameters where there are views enough, or else without."""
    free = task.free if len(structure.poses) >= VIEWS_FOR_CAMERAS else ()
    for parameters in dict.fromkeys((free, ())):
        result = adjusted(task, structure, Free(), parameters)
        if isinstance(result, tuple):
            return compact(result[0])
    return None


def _registered(task: Task, structure: Structure, left: list[int]) -> Structure:
    """Views that `register` recognises, with the links it gives."""
    markers = MarkerSet.make(point_names(len(structure.xyz)), structure.xyz)
    layout = prepare(markers)
    out = structure
    for v in left:
        camera = structure.cameras[task.views[v].camera]
        answer = register(task.detections[v], markers, camera, layout=layout, max_deformation=0.0, seed=task.seed)
        if isinstance(answer, Registration):
            match = answer.matching
            out = out.with_view(v, answer.cam_from_model, match.detection, match.marker)
    return replace(out, pose_cov={}) if len(out.poses) > len(structure.poses) else out


def _by_neighbours(task: Task, structure: Structure, left: list[int], match: PairMatcher) -> Structure:
    """Views that a pair matching links to known points: where the layout is regular, only closeness tells."""
    for v in left:
        near = sorted(structure.poses, key=lambda p: abs(p - v))[:NEIGHBOURS]
        for other in near:
            added = _from_neighbour(task, structure, v, other, match)
            if added is not None:
                return added
    return structure


def _from_neighbour(task: Task, structure: Structure, v: int, other: int, match: PairMatcher) -> Structure | None:
    cameras = [structure.cameras[task.views[k].camera] for k in (other, v)]
    pair = match(other, v, *cameras)
    if not isinstance(pair, PairMatching):
        return None
    mine = structure.view == other
    point_of = dict(zip(structure.spot[mine].tolist(), structure.point[mine].tolist(), strict=True))
    common = [(int(s), point_of[int(o)]) for o, s in zip(pair.a, pair.b, strict=True) if int(o) in point_of]
    if len(common) < LEAST_COMMON:
        return None
    spot, point = (np.array(c, dtype=np.int64) for c in zip(*common, strict=True))
    pose = _pose(task, structure, v, spot, point)
    return None if pose is None else replace(structure.with_view(v, pose, spot, point), pose_cov={})


def _pose(task: Task, structure: Structure, v: int, spot: Ints, point: Ints) -> Pose | None:
    spots, camera = task.detections[v], structure.cameras[task.views[v].camera]
    try:
        return pose_from_labels(
            spots.xy[spot], structure.xyz[point], camera, cov=spots.cov[spot], loss="cauchy", seed=task.seed
        ).cam_from_model  # fmt: skip
    except DegenerateGeometry:
        return None
