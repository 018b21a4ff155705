"""The state of one instant by the spots of all cameras, what is free in it, and what is no state of the model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Deformation, NotIdentified, identify
from windmark.deformation.ends import NO_PLACE
from windmark.deformation.solve import Solved
from windmark.geometry import Pose
from windmark.scene import Doubt, Observations, View
from windmark.scene.units import CommonRatio
from windmark.tasks.deform.spots import Labelled
from windmark.tasks.deform.task import DeformationTest, DeformedFrame, Station
from windmark.tasks.deform.zero import since_wind_off

Array = NDArray[np.float64]

MOST_RMS_PX = 4.0
"""A state that leaves such residuals is no state of this model: tables and lenses are off by less."""
MOST_OUT = 0.2
"""A tracked frame with more outliers than this part is looked at again without expectations."""
_LACKS = "too simple: what is left"
"""Words of a doubt that a law cannot do what the model does."""


def identified_again(frame: DeformedFrame, test: DeformationTest) -> DeformedFrame:
    """A frame's spots as another test explains them: the same cameras and names of markers, other places of these.

    Where that gives nothing, the frame as it was.
    """
    assert frame.observations is not None
    poses = {n: test.station(n).cam_from_tunnel for n in frame.views}
    known = None if frame.state is None or frame.state.other_discs is None else frame.state.other_discs.size
    answer = state_of(frame.observations, poses, test, frame.state, test.marker_cov, disc_size=known)
    return replace(frame, state=answer) if isinstance(answer, Deformation) else frame


def state_of(
    observations: Observations, poses: dict[str, Pose], test: DeformationTest, start: Deformation | None,
    marker_cov: Array | None, eccentricity: Array | None = None, free_moved: bool = True,
    keep: Callable[[Solved], None] | None = None, disc_size: CommonRatio | None = None,
) -> Deformation | NotIdentified:  # fmt: skip
    """The state of one instant; ``poses`` of its views, in the order of ``observations.view``.

    ``eccentricity`` (O, 2) as ``start`` has it; None works it out. ``keep``, ``disc_size``: see `identify`.
    """
    stations = [test.station(n) for n in poses]
    answer = identify(
        observations, test.markers, test.volumes, {s.name: s.camera for s in stations},
        [View(n, n, "", pose) for n, pose in poses.items()], **what_is_free(test, tuple(poses)), marker_cov=marker_cov,
        start=start, eccentricity=eccentricity, free_moved=free_moved, disc_size=disc_size,
        keep=keep,
    )  # fmt: skip
    if isinstance(answer, NotIdentified):
        return answer
    return since_wind_off(answer, test.discs_wind_off, test.markers.length_unit)


def what_is_free(test: DeformationTest, names: tuple[str, ...]) -> dict[str, Any]:
    """Options of `identify` that say what is free besides the laws, for the cameras of an instant."""
    stations = [test.station(n) for n in names]
    return {
        "free_motion": test.free_motion, "free_poses": [s.name for s in stations if s.moves],
        "pose_cov": {s.name: s.pose_cov for s in stations if s.moves and s.pose_cov is not None},
        "free_focal": [s.name for s in stations if s.free_focal],
    }  # fmt: skip


def doubted(state: Deformation, *doubts: Doubt) -> Deformation:
    """A state with more doubts."""
    names = tuple(dict.fromkeys((*state.suspect, *(n for d in doubts for n in d.names))))
    return replace(state, doubts=(*state.doubts, *doubts), suspect=names) if doubts else state


def start_pose(station: Station, spots: Labelled) -> Pose:
    """Where a station is looked for from: as its own spots say, if it moves."""
    return spots.pose if station.moves and spots.pose is not None else station.cam_from_tunnel


def implausible(state: Deformation) -> str | None:
    """Why this is no state of the model, or None."""
    if state.rms_px > MOST_RMS_PX:
        return f"the laws leave residuals of {state.rms_px:.1f} px"
    out = int((~state.used).sum())
    if out <= MOST_OUT * len(state.used):
        return None
    many = f"{out} of {len(state.used)} spots contradict the others"
    # What a camera or a law lacks leaves out spots until the rest fits, whose pattern still tells it. Where a camera is
    # at fault the model seems to bend, too.
    told = next((some for causes in (("moved", "picture"), ("bent",))
                 if (some := [str(doubt) for doubt in state.doubts if doubt.cause in causes])), [])  # fmt: skip
    return f"{'; '.join(told)} ({many})" if told else many


def both_reasons(tracked: str, cold: str) -> str:
    """Why neither look, near the last frame and anywhere, gave a state; once where a law lacks something, or ends."""
    return "; ".join(part for part in ("" if _LACKS in cold or NO_PLACE in cold else tracked, cold) if part)
