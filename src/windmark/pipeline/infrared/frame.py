"""One frame from its pictures: the model as it was found in them, signals, temperatures on the moved grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.compiling import working_time
from windmark.errors import DataError, g3
from windmark.io import FileError
from windmark.paint import dominant
from windmark.pipeline.deform.followed import Followed
from windmark.pipeline.deform.pictures import read
from windmark.pipeline.infrared.load import InfraredRun
from windmark.pipeline.infrared.record import REDUCED, FrameRecord
from windmark.pipeline.infrared.stuck import stuck_pixels, stuck_words
from windmark.tasks.deform.task import DeformedFrame, FrameImages
from windmark.tasks.infrared import (
    BEYOND,
    FLAGS,
    SATURATED,
    UNSEEN,
    CameraTemperature,
    frame_temperatures,
    merged_temperature,
)
from windmark.tasks.psp import ModelPicture, Sampling, moved_grid

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FrameOutcome:
    """A frame with its result: the grid in the tunnel (V, 3), each camera's temperatures, the record."""

    vertices: Array
    cameras: dict[str, CameraTemperature]
    record: FrameRecord


def run_frame(run: InfraredRun, frame: DeformedFrame, images: FrameImages, pictures: dict[str, str]) -> FrameOutcome:
    """Temperatures of a frame in which the model was found.

    Raises
    ------
    DataError, FileError
        With one sentence that says what is missing or wrong; nothing else is touched by it.
    """
    began, state = working_time(), frame.state
    if state is None:
        raise DataError("; ".join([*_saturated(run, images), f"the model was not found: {frame.reason}"]))
    mesh, moves = moved_grid(state, run.mesh)
    entry = run.project.sampling
    how = Sampling(entry.max_obliquity_deg, entry.edge_px, entry.values, run.patches)
    seen, remarks = [], [] if state.fits else list(state.warnings[:2])
    stuck: dict[str, NDArray[np.bool_]] = {}
    for name in frame.views:
        if name in images.shots:
            remarks.append(f"{name}: its nearest picture is of another instant and does not count")
            continue
        station = run.deforming.test.station(name)
        picture = np.asarray(read(images.images[name], station))
        light, variance, _ = run.sensors[name].signal(picture)
        if (hang := stuck_pixels(run, name, frame.index, picture)).any():
            light, variance, stuck[name] = np.where(hang, np.nan, light), np.where(hang, np.nan, variance), hang
        lens = state.cameras.get(name, station.camera)
        pose = state.cam_from_tunnel.get(name, station.cam_from_tunnel)
        seen.append(ModelPicture(name, name, light, variance, lens, pose, mesh, moves))
    radiances = {n: s.radiance for n, s in run.sensors.items()}
    found = frame_temperatures(seen, radiances, run.surface, how=how) if seen else {}
    for one in (s for s in seen if s.name in stuck):
        xy = one.lens.project(one.cam_from_tunnel.apply(mesh.vertices))[0]
        remarks += stuck_words(one.name, stuck[one.name], xy, (found[one.name].flags & UNSEEN) == 0)
    cameras = {name: of for name, of in found.items() if not _refused(run, name, of, remarks)}
    beyond = {name: _range(run, name) for name, of in found.items() if _most_lost(of) == BEYOND}
    merged = merged_temperature(cameras)[0] if cameras else None
    if merged is None:
        raise DataError("; ".join(remarks) or f"no node has a temperature: {_why(found)}")
    field, used = merged.field, run.mesh.used
    known = field.known
    record = FrameRecord(
        frame.key, frame.index, float(run.times[frame.index]), pictures, REDUCED, "", tuple(remarks), state.rms_px,
        float(known[used].mean()), tuple(cameras), float(np.median(field.value[known])),
        float(np.median(field.sigma[known])), apart=merged.apart, causes={"T": dominant(field)},
        followed=Followed.of(frame, f"frame {frame.key}", run.deforming.test), seconds=working_time() - began,
        beyond=beyond,
    )  # fmt: skip
    return FrameOutcome(mesh.vertices, cameras, record)


def _saturated(run: InfraredRun, images: FrameImages) -> list[str]:
    """Which pictures are saturated: their markers cannot be found where they are."""
    out = []
    for name, image in images.images.items():
        try:
            full = run.sensors[name].signal(np.asarray(read(image, run.deforming.test.station(name))))[2]
        except FileError:
            continue  # said already
        if (share := float(full.mean())) > run.project.sampling.max_saturated:
            out.append(f"{name}: {g3(100 * share)} % of its pixels are saturated")
    return out


def _refused(run: InfraredRun, name: str, of: CameraTemperature, remarks: list[str]) -> bool:
    """Whether a camera's picture does not count, and why; a picture that is partly odd is told of."""
    shown = (of.flags & UNSEEN) == 0
    count = int(shown.sum())
    if not count:
        remarks.append(f"{name}: shows no node of the grid")
        return True
    full = float(np.mean((of.flags[shown] & SATURATED) > 0))
    if full > run.project.sampling.max_saturated:
        remarks.append(f"{name}: {g3(100 * full)} % of the nodes that it shows are saturated or on pixels that do not "
                       f"count; at most {100 * run.project.sampling.max_saturated:g} % may be")  # fmt: skip
        return True
    if worst := _most_lost(of):
        share = float(np.mean((of.flags[shown] & worst > 0) & ~of.field.known[shown]))
        why = (f" ({_range(run, name)}): its numbers are not those that the calibration is of, units are mixed, or "
               "the surface reflects less than it is said to") if worst == BEYOND else ""  # fmt: skip
        remarks.append(f"{name}: {100 * share:.0f} % of the nodes that it shows have no temperature: "
                       f"{FLAGS[worst]}{why}")  # fmt: skip
    return not of.field.known.any()


def _most_lost(of: CameraTemperature) -> int:
    """Bit of the reason why most of the nodes that a camera shows have no temperature; 0 where most have one."""
    shown = (of.flags & UNSEEN) == 0
    lost = shown & ~of.field.known
    if not shown.any() or lost.sum() <= 0.5 * shown.sum():
        return 0
    return max(FLAGS, key=lambda bit: int((of.flags[lost] & bit > 0).sum()))


def _range(run: InfraredRun, name: str) -> str:
    low, high = run.sensors[name].radiance.t_range
    return f"{low:.4g} to {high:.4g} K"


def _why(found: dict[str, CameraTemperature]) -> str:
    flags = np.bitwise_or.reduce([f.flags for f in found.values()]) if found else np.full(1, UNSEEN, np.uint16)
    bits = {bit: int((flags & bit > 0).sum()) for bit in FLAGS}
    return FLAGS[max(bits, key=lambda bit: bits[bit])]
