"""One point from its pictures: read, corrected, the model found in every one of them, reduced."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.compiling import working_time
from windmark.errors import DataError, WindmarkError, g2, g3
from windmark.paint import LoadReference, TunnelConditions, TunnelGain
from windmark.pipeline.psp.incidence import apart_deg, at_incidence, of_one_state, unsaid_sideslip
from windmark.pipeline.psp.load import PspTest
from windmark.pipeline.psp.once import Once
from windmark.pipeline.psp.pictures import Found, read_pictures, the_model_in
from windmark.pipeline.psp.places import without_places
from windmark.pipeline.psp.stream import contradiction_words
from windmark.pipeline.psp.table import WIND_OFF, WIND_ON, PointRow, SensorTable, reference_kind
from windmark.pipeline.psp.wall import steady_of, wall_of
from windmark.tasks.psp import (
    MergedRatio,
    Patches,
    PointTask,
    Readings,
    ReducedPoint,
    Reference,
    Sampling,
    SectionWanted,
    mach_of,
    no_patches,
    ratio_of,
    reduce_point,
    two_colours,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PointOutcome:
    """A point with its result.

    Parameters
    ----------
    reduced : what came of it
    alpha_seen_deg, beta_seen_deg : incidence and sideslip that the wind-on pictures show
    on, off : the pictures
    seconds : for each stage
    pictures : content of each of its pictures -> kind, name, camera
    """

    reduced: ReducedPoint
    alpha_seen_deg: float
    beta_seen_deg: float
    on: Found
    off: Found
    seconds: Mapping[str, float]
    pictures: Mapping[bytes, tuple[str, str, str]] = field(default_factory=dict)


def run_point(test: PspTest, row: PointRow) -> PointOutcome:
    """Reduce a point.

    Raises
    ------
    DataError, FileError
        With one sentence that says what is missing or wrong; nothing else is touched by it.
    """
    clock = _Clock()
    stream = row.conditions()
    _check_paint(test, row)
    steady, about = steady_of(test, row)
    once = Once(test.sensors)
    raw = read_pictures(test, WIND_ON, row.on, once)
    clock.lap("read")
    on = the_model_in(test, WIND_ON, raw)
    clock.lap("find the model")
    on, seen = at_incidence(test.project.points, row.alpha_deg, on, beta_deg=row.beta_deg)
    on = of_one_state(test.project.points, on, WIND_ON)
    off = References(test, row, once)
    ratio = _ratio(test, on, off)
    clock.lap("reference, ratio on the model")
    others = {name: channel_ratio(test, row, name, once) for name in row.channels}
    if others:
        clock.lap("other colours")
    if "reference" in others:
        ratio = two_colours(ratio, others["reference"])
    wall = wall_of(test, row, others)
    state = on.states[0]
    apart = apart_deg(test.project.points, row.alpha_deg, on.states)
    task = replace(point_task(test, row, stream), temperature=wall.temperature, steady=steady, alpha_apart_deg=apart)
    reduced = reduce_point(ratio, test.mesh, state.mesh(test.mesh, frame="model"), task)
    said = [*row.remarks, *once.remarks, *wall.remarks, *about]
    said += without_places(test.places, test.mesh, reduced)
    said += unsaid_sideslip(test.project.points, row.beta_deg, seen[1])
    if not np.isfinite(stream.mach):
        said.append(f"no Mach number is given to test the pressures by: p_inf and q_inf are those of Mach "
                    f"{g3(mach_of(stream))}")  # fmt: skip
    said += contradiction_words(row.contradiction, row.p_inf, row.q_inf)
    if (flicker := test.project.radiometry.lamp_flicker) is not None and ratio.flicker > flicker:
        said.append(f"the lamps flicker by {g2(100 * ratio.flicker)} % from picture to picture, which counts, and by "
                    f"{g2(100 * flicker)} % by radiometry.lamp_flicker")  # fmt: skip
    if ratio.self_lit is not None:
        said.append(str(ratio.self_lit))
    reduced = replace(reduced, remarks=(*reduced.remarks, *said))
    clock.lap("pressure and loads")
    return PointOutcome(reduced, *seen, on, off.found, clock.laps,
                        {content: of for content, of in once.pictures.items() if of[0]})  # fmt: skip


def _ratio(test: PspTest, on: Found, off: References) -> MergedRatio:
    return ratio_of(
        on.pictures, off, how=sampling_of(test), lamps=test.lamps, reflecting=test.reflecting, bad=on.bad,
        own=off.row.own, flicker=test.project.radiometry.lamp_flicker,
    )  # fmt: skip


class References:
    """The parts of a point's reference, one after the other: each is read when it is asked for.

    What cannot be used says why, see `ratio_of`.
    """

    def __init__(self, test: PspTest, row: PointRow, once: Once, colour: str = "") -> None:
        self.row, self._test, self._once, self._colour = row, test, once, colour
        self.found = Found((), (), ())

    def __iter__(self) -> Iterator[Reference]:
        row = self.row
        if not row.parts:
            kind = reference_kind(self._colour)
            found = self._part(kind, row.channels[self._colour][1] if self._colour else row.off)
            found = self._kept(of_one_state(self._test.project.points, found, kind))
            yield Reference(found.pictures, 1.0, found.bad)
            return
        for part in row.parts:
            kind = reference_kind(self._colour, part)
            try:
                found = self._part(kind, part.channels.get(self._colour, "") if self._colour else part.pattern)
                table = "table of points" if row.own else "table of references"
                found = self._kept(at_incidence(self._test.project.points, part.alpha_deg, found, table)[0])
            except WindmarkError as error:
                yield Reference((), part.share, (), kind, str(error) if row.own else f"its reference {kind}: {error}")
            else:
                yield Reference(found.pictures, part.share, found.bad, kind)

    def _part(self, kind: str, pattern: str) -> Found:
        """The model in the pictures of a part."""
        return the_model_in(self._test, kind, read_pictures(self._test, kind, pattern, self._once))

    def _kept(self, new: Found) -> Found:
        """A part that counts; without the pictures themselves it is kept."""
        old = self.found
        self.found = Found((), (*old.states, *new.states), (*old.rms_px, *new.rms_px), {**old.troubles, **new.troubles},
                           (*old.bad, *new.bad), (*old.names, *new.names), (*old.followed, *new.followed), (),
                           (*old.several, *new.several))  # fmt: skip
        return new


def channel_ratio(test: PspTest, row: PointRow, name: str, once: Once) -> MergedRatio:
    """The ratio wind-off / wind-on of another colour, in whose pictures the model is found anew."""
    off = [part.channels.get(name, "") for part in row.parts] or [row.channels[name][1]]
    off = [] if row.own else off  # one of a run is left out, see `References`
    for kind, pattern in ((WIND_ON, row.channels[name][0]), *((WIND_OFF, pattern) for pattern in off)):
        if not pattern:
            raise DataError(f"the table of points names {name} pictures, but none {kind} (line {row.line})")
    kind = f"{WIND_ON} {name}"
    on = the_model_in(test, kind, read_pictures(test, kind, row.channels[name][0], once))
    on, _ = at_incidence(test.project.points, row.alpha_deg, on, beta_deg=row.beta_deg)
    return _ratio(test, on, References(test, row, once, name))


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
    if isinstance(law, TunnelGain):  # of changes: no state of the reference is asked for
        return
    if not np.isfinite(row.t_off):
        raise DataError(f"T_off is missing in the table of points (line {row.line})")
    place = f"line {row.line} of the table of points"
    states = [(of.p_off, of.t_off, f"reference {of.name}") for of in row.parts] or [(row.p_off, row.t_off, place)]
    for p_off, t_off, where in states:
        asked = (("p_off", p_off, law.p_range, "Pa"), ("T_off", t_off, law.t_range, "K"))
        for what, value, (low, high), unit in asked:
            if not low <= value <= high:
                raise DataError(
                    f"{what} is {value:g} {unit}, outside the paint's calibration ({low:g} to {high:g} {unit}): its "
                    f"unit is another one, or the cell is wrong ({where})"
                )


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
        loads.area, loads.chord, loads.span_used, np.array(loads.moment_point), row.alpha_deg,
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
