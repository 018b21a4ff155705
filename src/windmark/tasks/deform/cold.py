"""Markers without an idea where the model is: cameras that stand still are searched as one, the others after them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.turned import rotated, turns
from windmark.geometry import Camera, Pose
from windmark.registration import NotRegistered, Registration, RigRegistration, register
from windmark.scene import Detections, MarkerSet
from windmark.tasks.deform.spots import Labelled, labelled_spots
from windmark.tasks.deform.task import DeformationTest, Station
from windmark.tasks.deform.walls import LEAST_WALL, off_its_walls, walls_in_place
from windmark.tasks.together import RigView, Together, register_together

Ints = NDArray[np.int64]

STILL = 1e-9
"""Of the markers' extent: what rounding moves them by where the laws are at rest."""

Pairs = tuple[Ints, Ints, int]
"""Spots, their markers, and how many were expected."""


@dataclass(frozen=True)
class Found:
    """What came of the cameras of an instant.

    Parameters
    ----------
    labelled : camera -> its spots, or why there are none
    left_out : cameras that contradict the others -> why; what they show is not to be believed
    """

    labelled: dict[str, Labelled]
    left_out: dict[str, str] = field(default_factory=dict)


def anywhere(
    spots: Mapping[str, Detections | str], test: DeformationTest, in_step: Collection[str], pool: Executor,
    aside: Sequence[int] | Ints = (),
) -> Found:  # fmt: skip
    """All spots of all cameras matched to the model, and of cameras that move to the walls.

    The cameras that stand still and took their picture at the instant are a rig with known places: every one proposes
    where the model is, all judge it (`register_together`). A camera that moves, or whose picture is of another time, is
    searched by itself, first where the others put the model. So are all where the time for all of them was too short:
    cameras whose places are off by more than the spots take longer, and no contradiction is known.

    Parameters
    ----------
    spots : camera -> spots of the whole image, or why there are none
    test : what does not change
    in_step : cameras that took a picture at the instant
    pool : for the cameras that are searched by themselves
    aside : markers that are not looked for
    """
    model = np.setdiff1d(np.flatnonzero(test.markers.role != "wall"), aside)
    placed, options = at_start(test), _model_options(test, model)
    markers = placed.take(model)
    labelled = {name: Labelled.none(why) for name, why in spots.items() if isinstance(why, str)}
    seen = {name: s for name, s in spots.items() if isinstance(s, Detections)}
    off = {n: pool.submit(off_its_walls, s, test, test.station(n), _options(test)) for n, s in seen.items()}
    moved = {name: why for name, job in off.items() if (why := job.result())}
    labelled |= {name: Labelled.none(why) for name, why in moved.items()}
    seen = {name: s for name, s in seen.items() if name not in moved}
    still = [test.station(n) for n in seen if n in in_step and not test.station(n).moves]
    found: RigRegistration | NotRegistered | None = None
    left_out: dict[str, str] = {}
    if still:
        views = [RigView(s.name, seen[s.name], s.camera, s.cam_from_tunnel) for s in still]
        done = register_together(views, markers, priors=(Pose.identity(), None), **options)
        found, left_out = done.answer, _contradicting(done)
        if not (isinstance(found, NotRegistered) and found.cause == "time"):
            labelled |= {s.name: _of_rig(done, s, seen[s.name], model) for s in still}
    at = found.rig_from_model if isinstance(found, RigRegistration) else Pose.identity()
    left = {n: s for n, s in seen.items() if n not in labelled}
    alone = {n: pool.submit(_alone, s, test, placed, test.station(n), at, model) for n, s in left.items()}
    labelled |= {name: job.result() for name, job in alone.items()}
    return Found({n: labelled[n] for n in spots}, left_out | moved)


def reasons(labelled: Mapping[str, Labelled]) -> str:
    """Why no camera has labels; what several have in common is said once."""
    names: dict[str, list[str]] = {}
    for name, spots in labelled.items():
        names.setdefault(spots.reason, []).append(name)
    return "; ".join(f"{', '.join(those)}: {why}" for why, those in names.items())


def _contradicting(done: Together) -> dict[str, str]:
    if isinstance(done.answer, NotRegistered):
        return dict.fromkeys(done.disputed, done.answer.reason)
    others = ", ".join(done.names)
    return {name: f"left out, it contradicts {others}: {why}" for name, why in done.left_out.items()}


def _of_rig(done: Together, station: Station, spots: Detections, model: Ints) -> Labelled:
    """A still camera's spots, by the registration of all of them."""
    answer, pose = done.of(station.name), station.cam_from_tunnel
    if answer is not None:
        return _labelled(spots, [_pairs(answer, model)], pose)
    if isinstance(done.answer, NotRegistered):
        return replace(Labelled.none(f"model: {done.answer.reason}"), pose=pose)
    return replace(Labelled.none(_contradicting(done)[station.name]), pose=pose)


def _alone(
    spots: Detections, test: DeformationTest, placed: MarkerSet, station: Station, tunnel_from_model: Pose, model: Ints
) -> Labelled:  # fmt: skip
    """The spots of one camera by itself: walls where it moves, then the model's markers. ``placed`` : of `at_start`."""
    pose, pairs = station.cam_from_tunnel, []
    wall = np.flatnonzero(placed.role == "wall")
    if station.moves and len(wall) >= LEAST_WALL:
        answer = register(spots, placed.take(wall), station.camera, prior=pose, **_options(test))
        if isinstance(answer, Registration):
            pose = answer.cam_from_model
            pairs.append(_pairs(answer, wall))
    answer = _model(spots, placed.take(model), station.camera, pose @ tunnel_from_model, _model_options(test, model))
    if not isinstance(answer, Registration):
        return replace(Labelled.none(f"model: {answer.reason}"), pose=pose)
    pairs.append(_pairs(answer, model))
    if station.moves and station.pose_cov is None and len(pairs) == 1:
        # Nothing else holds the pose, and few walls among many spots are no pattern: where the file has the camera.
        pairs.append(walls_in_place(spots, placed, wall, station, pairs[0][0]))
    return _labelled(spots, pairs, pose)


def at_start(test: DeformationTest) -> MarkerSet:
    """The markers where the laws are at their start: a part that is set against its table is looked for as it is set.

    The test's own ones where that is nothing.
    """
    markers = test.markers
    placed = test.volumes.bind(markers.xyz, np.where(markers.role == "wall", "", markers.volume))
    xyz, size = placed.place(test.volumes.start), float(np.ptp(markers.xyz, axis=0).max(initial=0.0))
    moved = np.linalg.norm(xyz - markers.xyz, axis=1) > STILL * size
    if not moved.any():
        return markers
    turned = turns(placed, test.volumes.start, markers.normal)
    normal, form = rotated(turned, markers.normal), rotated(turned, markers.curvature)
    return replace(markers, xyz=xyz, normal=normal, curvature=form)


def _model(
    spots: Detections, markers: MarkerSet, camera: Camera, prior: Pose, options: dict[str, Any]
) -> Registration | NotRegistered:
    """Register the model's markers, first near a pose, then anywhere."""
    answer = register(spots, markers, camera, prior=prior, **options)
    return answer if answer else register(spots, markers, camera, **options)


def _pairs(answer: Registration, which: Ints) -> Pairs:
    return answer.matching.detection, which[answer.matching.marker], answer.n_expected


def _labelled(spots: Detections, pairs: list[Pairs], pose: Pose) -> Labelled:
    """Labels from several searches, each of its part of the markers; a spot that two want is the first one's."""
    spot, marker = (np.concatenate([p[k] for p in pairs]) for k in (0, 1))
    _, once = np.unique(spot, return_index=True)
    return labelled_spots(spots, spot[once], marker[once], sum(p[2] for p in pairs), pose)


def _options(test: DeformationTest) -> dict[str, Any]:
    look = test.look
    return {"max_time_s": look.max_time_s, "max_table_error": look.max_table_error, "seed": look.seed}


def _model_options(test: DeformationTest, model: Ints) -> dict[str, Any]:
    """Options of `register` for the markers of the model (their indices)."""
    every = test.visible

    def visible(pose: Pose, camera: Camera) -> NDArray[np.bool_]:
        assert every is not None
        return every(pose, camera)[model]

    deformation = test.look.max_deformation
    return {**_options(test), "max_deformation": deformation, "visible": None if every is None else visible}
