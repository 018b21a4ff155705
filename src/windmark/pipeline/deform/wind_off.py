"""The markers where the wind-off frames show them: the zero of a deformation test."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.deformation import zero_markers
from windmark.pipeline.deform.load import Loaded
from windmark.pipeline.deform.names import key_of
from windmark.pipeline.deform.pictures import follow_deformation, read
from windmark.pipeline.deform.project import DeformProject
from windmark.pipeline.deform.timeline import Timeline
from windmark.scene import View
from windmark.tasks.deform.states import identified_again
from windmark.tasks.deform.task import DeformedFrame, FrameImages, Reader
from windmark.tasks.deform.zero import Zero, discs_of, noise_share
from windmark.tasks.likely_unit import likely_unit, model_box

Array = NDArray[np.float64]


def zeroed(
    loaded: Loaded, timeline: Timeline, read: Reader = read
) -> tuple[Loaded, Zero | None, Array | None, list[tuple[DeformedFrame, FrameImages]]]:
    """The test with the markers where the wind-off frames show them, the wind-off state, and these frames."""
    project = loaded.project
    wanted = wind_off_frames(project, timeline)
    if not wanted:
        return loaded, None, None, []
    good, why = [], ""
    shown: set[tuple[tuple[str, int], ...]] = set()
    for key, images in wanted.items():  # each for itself: wind-off frames may be far apart
        frame = next(follow_deformation([images], replace(loaded.test, wind_off=(images.key,)), read=read))
        pictures = tuple((name, sight.picture) for name, sight in frame.cameras.items() if sight.picture)
        if frame.state is None:
            why = f"frame {key}: {frame.reason}"
        elif not pictures or pictures not in shown:  # the same pictures once more are no second measurement
            good.append((frame, images))
            shown.add(pictures)
    if not good:
        _check_units(loaded)
        raise io.FileError(project.path, f"no wind-off frame can be used; {why}", "sequence.zero")
    states, seen = [f.state for f, _ in good if f.state], [f.observations for f, _ in good if f.observations]
    corrected = zero_markers(states, seen, [[View(n, n) for n in f.views] for f, _ in good], loaded.test.markers)
    test = replace(
        loaded.test, markers=corrected.markers, marker_cov=corrected.cov, wind_off=tuple(frame.key for frame, _ in good)
    )  # fmt: skip
    good = [(identified_again(frame, test), images) for frame, images in good]
    test = replace(test, discs_wind_off=discs_of([f.state for f, _ in good if f.state]))
    share = noise_share(loaded.test.markers, corrected.cov, corrected.seen)
    zero = Zero.of([f.state for f, _ in good if f.state], loaded.stations, corrected.markers, share)
    return replace(loaded, test=test), zero, corrected.shift, good


def wind_off_frames(project: DeformProject, timeline: Timeline) -> dict[str, FrameImages]:
    """The wind-off frames by their keys; `FileError` where one of them has no image."""
    known = {f.key: f for f in timeline.frames}
    wanted = list(map(key_of, project.sequence.zero))
    missing = [k for k in wanted if k not in known]
    if missing:
        raise io.FileError(project.path, f"frame {missing[0]} has no image; expected a wind-off frame", "sequence.zero")
    return {k: known[k] for k in wanted}


def _check_units(loaded: Loaded) -> None:
    """`FileError` where the markers lie beside the grid, and on it in another unit: all cameras seem moved then."""
    if loaded.mesh is None:
        return
    project, markers = loaded.project, loaded.test.markers
    units, _ = likely_unit(markers.xyz[markers.role != "wall"], model_box(loaded.mesh), project.length_unit)
    if units:
        words = f"in {project.length_unit} its markers do not fit the grid, in {' or '.join(units)} they would"
        raise io.FileError(project.markers.file, words, "length unit")
