"""One point from its pictures: read, corrected, the model found in every one of them, reduced."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.compiling import working_time
from windmark.deformation import Deformation
from windmark.errors import DataError
from windmark.paint import LoadReference, TunnelConditions, correct_picture
from windmark.pipeline.deform.pictures import follow_deformation, read
from windmark.pipeline.psp.load import PspTest
from windmark.pipeline.psp.sensors import pictures_named
from windmark.pipeline.psp.table import WIND_OFF, WIND_ON, PointRow, SensorTable
from windmark.pipeline.psp.wall import wall_of
from windmark.tasks.deform.task import FrameImages
from windmark.tasks.psp import (
    MergedRatio,
    ModelPicture,
    Patches,
    PointTask,
    Readings,
    ReducedPoint,
    Sampling,
    SectionWanted,
    moved_grid,
    no_patches,
    ratio_of,
    reduce_point,
    two_colours,
)

Array = NDArray[np.float64]
Image = NDArray[np.generic]
@dataclass(frozen=True, eq=False)
class Found:
    """The pictures of a kind in which the model was found.

    Parameters
    ----------
    pictures : with pose and deformation
    states : of the instants, in order
    rms_px : residuals of each instant
    troubles : picture or instant -> what was wrong
    """

    pictures: tuple[ModelPicture, ...]
    states: tuple[Deformation, ...]
    rms_px: tuple[float, ...]
    troubles: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class PointOutcome:
    """A point with its result.

    Parameters
    ----------
    reduced : what came of it
    alpha_seen_deg : the incidence that the wind-on pictures show
    on, off : the pictures
    seconds : for each stage
    task : what was known besides the pictures
    """

    reduced: ReducedPoint
    alpha_seen_deg: float
    on: Found
    off: Found
    seconds: Mapping[str, float]
    task: PointTask


def run_point(test: PspTest, row: PointRow) -> PointOutcome:
    """Reduce a point.

    Raises
    ------
    DataError, FileError
        With one sentence that says what is missing or wrong; nothing else is touched by it.
    """
    clock = _Clock()
    stream = row.conditions()
    if not np.isfinite(row.t_off):
        raise DataError(f"T_off is missing in the table of points (line {row.line})")
    _check_paint(test, row)
    raw = {kind: read_pictures(test, kind, pattern) for kind, pattern in ((WIND_ON, row.on), (WIND_OFF, row.off))}
    clock.lap("read")
    on, off = (the_model_in(test, kind, raw[kind]) for kind in (WIND_ON, WIND_OFF))
    clock.lap("find the model")
    alpha = _incidence(test, row, on)
    ratio = _ratio(test, on, off)
    clock.lap("ratio on the model")
    others = {name: channel_ratio(test, row, name) for name in row.channels}
    if others:
        clock.lap("other colours")
    if "reference" in others:
        ratio = two_colours(ratio, others["reference"])
    wall = wall_of(test, row, others)
    state = on.states[0]
    task = replace(point_task(test, row, stream), temperature=wall.temperature)
    reduced = reduce_point(ratio, test.mesh, state.mesh(test.mesh, frame="model"), task)
    change = () if ratio.self_lit is None else (str(ratio.self_lit),)
    reduced = replace(reduced, remarks=(*reduced.remarks, *wall.remarks, *change))
    clock.lap("pressure and loads")
    return PointOutcome(reduced, alpha, on, off, clock.laps, task)


def _ratio(test: PspTest, on: Found, off: Found) -> MergedRatio:
    return ratio_of(on.pictures, off.pictures, how=sampling_of(test), lamps=test.lamps, reflecting=test.reflecting)


def channel_ratio(test: PspTest, row: PointRow, name: str) -> MergedRatio:
    """The ratio wind-off / wind-on of another colour, in whose pictures the model is found anew."""
    found = {}
    for kind, pattern in zip((WIND_ON, WIND_OFF), row.channels[name], strict=True):
        what = f"{kind} {name}"
        if not pattern:
            raise DataError(f"the table of points names {name} pictures, but none {kind} (line {row.line})")
        found[kind] = the_model_in(test, what, read_pictures(test, what, pattern))
    return _ratio(test, found[WIND_ON], found[WIND_OFF])


class _Clock:
    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = working_time()

    def lap(self, name: str) -> None:
        now = working_time()
        self.laps[name], self._last = now - self._last, now


def _check_paint(test: PspTest, row: PointRow) -> None:
    """The wind-off state has to be one that the paint was calibrated at: otherwise a unit is wrong."""
    law = test.paint.law
    asked = (("p_off", row.p_off, law.p_range, "Pa"), ("T_off", row.t_off, law.t_range, "K"))
    for what, value, (low, high), unit in asked:
        if not low <= value <= high:
            raise DataError(
                f"{what} is {value:g} {unit}, outside the paint's calibration ({low:g} to {high:g} {unit}): its unit "
                f"is another one, or the cell is wrong (line {row.line} of the table of points)"
            )


def read_pictures(test: PspTest, kind: str, pattern: str) -> dict[str, list[tuple[str, Image]]]:
    """Camera -> name and grey levels of its pictures."""
    if not pattern:
        missing = ": the reference is missing" if kind == WIND_OFF else ""
        raise DataError(f"the table of points names no {kind} pictures{missing}")
    out = {}
    for station in test.deforming.test.stations:
        files = pictures_named(test.project, pattern, station.name)
        out[station.name] = [(file.name, read(file, station)) for file in files]
    if not any(out.values()):
        missing = "the reference is missing: " if kind == WIND_OFF else ""
        raise DataError(f"{missing}no {kind} picture matches {pattern!r} beside the project")
    return {name: pictures for name, pictures in out.items() if pictures}


def the_model_in(test: PspTest, kind: str, raw: Mapping[str, Sequence[tuple[str, Image]]]) -> Found:
    """The model in the pictures of a kind: those of one number, of all cameras, are of one instant."""
    light = {}
    for name, pictures in raw.items():
        for file, image in pictures:
            light[name, file] = _corrected(test, kind, name, file, image)
    count = max(len(p) for p in raw.values())
    frames = [FrameImages(f"{k}", float(k), {n: p[k][1] for n, p in raw.items() if k < len(p)}) for k in range(count)]
    seen: list[ModelPicture] = []
    states, rms, troubles = [], [], {}
    for k, frame in enumerate(follow_deformation(frames, test.deforming.test)):
        state = frame.state
        if state is None:
            troubles[f"{kind} picture {k + 1}"] = f"the model was not found: {frame.reason}"
            continue
        if not state.fits:
            troubles[f"{kind} picture {k + 1}"] = "; ".join(state.warnings[:2])
        states.append(state)
        rms.append(state.rms_px)
        mesh, moves = moved_grid(state, test.mesh)
        for name in frame.views:
            file = raw[name][k][0]
            station = test.deforming.test.station(name)
            value, variance, lasting = light[name, file]
            lens = state.cameras.get(name, station.camera)
            pose = state.cam_from_tunnel.get(name, station.cam_from_tunnel)
            seen.append(ModelPicture(f"{kind} {file}", name, value, variance, lens, pose, mesh, moves, lasting))
    if not states:
        raise DataError(f"no {kind} picture can be used; {next(iter(troubles.values()))}")
    return Found(tuple(seen), tuple(states), tuple(rms), troubles)


def _corrected(test: PspTest, kind: str, camera: str, file: str, image: Image) -> tuple[Array, Array, Array]:
    """Light and variance of a picture, NaN where a pixel cannot be used; and the variance that all pictures share."""
    how = test.project.radiometry
    try:
        done = correct_picture(image, test.sensors[camera].model, most_saturated=how.max_saturated)
    except DataError as error:
        raise DataError(f"{kind} picture {file} of {camera}: {error}") from None
    value, variance = (np.where(done.usable, v, np.nan) for v in (done.value, done.variance))
    return value, variance, done.lasting


def _incidence(test: PspTest, row: PointRow, on: Found) -> float:
    """The incidence that the pictures show; DataError where the table has another one.

    Where the laws do not explain what the markers show that is said too: a bent wing that may not bend looks turned.
    """
    entry = test.project.points
    pitch = float(np.degrees(np.arcsin(on.states[0].tunnel_from_model.rotation[0, 2])))
    seen = entry.alpha_at_rest_deg + pitch
    if abs(seen - row.alpha_deg) > entry.max_alpha_error_deg:
        also = next(iter(on.troubles.values()), "")
        raise DataError(
            f"its pictures show an incidence of {seen:.2f} degrees, the table of points says {row.alpha_deg:g}: rows "
            "and pictures were exchanged, or points.alpha_at_rest_deg is not that of markers and grid"
            + (f"; and the markers say: {also}" if also else "")
        )
    return seen


def sampling_of(test: PspTest) -> Sampling:
    """How the project wants pictures sampled."""
    entry = test.project.sampling
    patches = Patches(test.mesh, *_patches(test), test.polygons)
    return Sampling(entry.max_obliquity_deg, entry.edge_px, entry.values, patches)


def point_task(test: PspTest, row: PointRow, stream: TunnelConditions) -> PointTask:
    """What is known of a point besides its pictures."""
    project = test.project
    warm, loads = project.temperature, project.loads
    reference = None if loads is None else LoadReference(
        loads.area, loads.chord, loads.span or loads.chord, np.array(loads.moment_point), row.alpha_deg,
        float(np.nan_to_num(row.beta_deg)),
    )  # fmt: skip
    return PointTask(
        row.name, test.paint.law, stream, row.p_off, row.t_off, warm.recovery,
        _readings(test.wells, test.readings, row.name), warm.sigma_K, warm.length,
        _readings(test.taps, test.pressures, row.name),
        "compare" if project.taps is None else project.taps.in_situ, _patches(test), reference,
        0.5 if loads is None else loads.least_seen,
        tuple(SectionWanted(s.name, s.point, s.normal, s.volume) for s in project.section), test.polygons,
    )  # fmt: skip


def _readings(places: io.PointList | None, table: SensorTable | None, point: str) -> Readings | None:
    """The sensors that have a place and a reading at a point."""
    if places is None or table is None:
        return None
    value, sigma = table.at(point, places.name.tolist())
    good = np.isfinite(value) & np.isfinite(places.xyz).all(axis=1)
    return Readings(
        tuple(places.name[good].tolist()), places.xyz[good], places.normal[good], value[good], sigma[good]
    )  # fmt: skip


def _patches(test: PspTest) -> tuple[Array, Array, Array]:
    """Centres, radii and normals of what is no paint: markers and the holes of taps."""
    clear, markers, taps = test.project.patches.clear, test.deforming.test.markers, test.taps
    own = (markers.role != "wall") & (markers.radius > 0)
    centres, radii, normals = [markers.xyz[own]], [markers.radius[own]], [markers.normal[own]]
    if taps is not None and test.project.taps is not None and test.project.taps.radius is not None:
        place = np.isfinite(taps.xyz).all(axis=1)
        centres.append(taps.xyz[place])
        normals.append(taps.normal[place])
        radii.append(np.full(int(place.sum()), test.project.taps.radius))
    if not clear:
        return no_patches()
    rim = test.project.patches.edge_px * _pixel(test)
    return np.concatenate(centres), clear * np.concatenate(radii) + rim, np.concatenate(normals)


def _pixel(test: PspTest) -> float:
    """Size of a pixel on the model at rest, in length units, of the camera that sees it least finely."""
    nodes = test.mesh.vertices[test.mesh.used]
    sizes = [np.median(s.cam_from_tunnel.apply(nodes)[:, 2]) / s.camera.focal_px for s in test.deforming.test.stations]
    return float(max(sizes))
