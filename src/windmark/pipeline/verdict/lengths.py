"""The verdict on lengths that a project says itself: none that the model on the grid cannot have, in its unit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import g2, g3
from windmark.pipeline import project_entries
from windmark.pipeline.alike import listed
from windmark.pipeline.psp import entries as psp
from windmark.pipeline.psp.project import PspProject
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding
from windmark.scene import Mesh
from windmark.scene.units import IN_MM, either
from windmark.tasks.likely_unit import Box, model_box

Array = NDArray[np.float64]


Section = psp.SectionEntry | project_entries.SectionEntry


def psp_lengths(mesh: Mesh, project: PspProject) -> list[Finding]:
    """All lengths that the project of a paint test says itself, but for its lamps' places (`lamps_findings`)."""
    unit, loads = project.length_unit, project.loads
    return [
        *([] if loads is None else reference_findings(mesh, loads, unit)),
        *wall_findings(mesh, project.temperature.length, unit),
        *section_findings(mesh, project.section, unit),
    ]


def reference_findings(mesh: Mesh, loads: psp.LoadsEntry, unit: str) -> list[Finding]:
    """References of the loads in another unit than the grid's, by the size of the model and beside each other.

    A length or an area of exactly 1 is asked for by who wants loads over the dynamic pressure: it is none.
    """
    box = model_box(mesh)
    sides = np.sort(box[1] - box[0])
    found = []
    for what, value, own, within, power in (
        ("area", loads.area, float(sides[1] * sides[2]), rules.REFERENCE_AREA, "²"),
        ("chord", loads.chord, float(sides[2]), rules.REFERENCE_CHORD, ""),
        ("span", loads.span or 1.0, float(sides[2]), rules.REFERENCE_SPAN, ""),
    ):
        if value != 1 and not within[0] * own < value < within[1] * own:
            words = f"loads.{what} is {value:.4g} {unit}{power}, the model's own is some {g2(own)} {unit}{power}"
            found.append(Finding(DOUBTFUL, "units", words, f"give loads.{what} in {unit}{power}"))
    if not found:
        found += _beside_each_other(loads, unit)
    return [*found, *_moment_point(box, loads.moment_point, unit)]


def _beside_each_other(loads: psp.LoadsEntry, unit: str) -> Iterator[Finding]:
    """An area that lies in no rectangle of chord and span, where each of them may be the model's."""
    if loads.span is None or 1 in (loads.area, loads.chord, loads.span):
        return
    both = loads.chord * loads.span
    if loads.area > rules.REFERENCE_AREA_TIMES * both:
        words = f"loads.area is {loads.area:.4g} {unit}², loads.chord times loads.span is {both:.4g} {unit}²"
        yield Finding(DOUBTFUL, "units", words, f"give loads.area in {unit}², loads.chord and loads.span in {unit}")


def _moment_point(box: Box, point: Sequence[float], unit: str) -> Iterator[Finding]:
    """A moment point far beside the model; or one at the origin but for a hair, and at the model in another unit."""
    at, size = np.asarray(point, dtype=float), float(np.linalg.norm(box[1] - box[0]))
    said = f"loads.moment_point is ({', '.join(f'{x:.4g}' for x in point)}) {unit}"
    off = float(np.linalg.norm(np.maximum(0, np.maximum(box[0] - at, at - box[1]))))
    if off > rules.MOMENT_POINT[1] * size:
        words = f"{said}, {g2(off)} {unit} from a model of {g2(size)} {unit}"
        yield Finding(DOUBTFUL, "units", words, f"give it in {unit}, in the frame of markers and grid")
    elif float(np.linalg.norm(at)) < rules.MOMENT_POINT[0] * size:
        units = [u for u, times in _larger(unit) if np.linalg.norm(at) * times > rules.MOMENT_AWAY * size
                 and _inside(at * times, box)]  # fmt: skip
        if units:
            words = f"{said}: on a model of {g2(size)} {unit} that is the origin and no place beside it; in "
            words += f"{either(units)} it would be inside it"
            yield Finding(DOUBTFUL, "units", words, f"give loads.moment_point in {unit}")


def wall_findings(mesh: Mesh, length: float | None, unit: str) -> list[Finding]:
    """The distance over which a wall's temperature keeps its value, where it is a grain of the model's size: the errors
    of temperature are then those of single nodes, and loads have next to nothing of them.
    """
    box = model_box(mesh)
    size = float(np.linalg.norm(box[1] - box[0]))
    if length is None or length > rules.WALL_LENGTH * size:
        return []
    words = f"temperature.length is {length:.4g} {unit} on a model of {g2(size)} {unit}: no wall is so uneven"
    return [Finding(DOUBTFUL, "units", words, f"give temperature.length in {unit}")]


def section_findings(mesh: Mesh, sections: Sequence[Section], unit: str) -> list[Finding]:
    """Parallel sections that are all one cut, within a line's thickness, and spread over the model in another unit.

    One alone is no sign of it: a plane just beside that of symmetry is what one takes where nodes lie in that one.
    """
    box = model_box(mesh)
    groups: dict[tuple[float, ...], list[Section]] = {}
    for one in sections:
        n = np.asarray(one.normal, dtype=float) / np.linalg.norm(one.normal)
        n *= np.sign(n[np.argmax(np.abs(n))])
        groups.setdefault(tuple(np.round(n, 6).tolist()), []).append(one)
    found = []
    for normal, own in groups.items():
        places = np.array([np.asarray(one.point) @ normal for one in own])
        low, high = _range(box, normal)
        units = [u for u, times in _larger(unit) if _spread(places * times, low, high)]
        if units and float(np.ptp(np.abs(places))) > 0.1 * float(np.abs(places).max()):
            names = listed("section", [one.name for one in own])
            words = (f"{names} lie within {g2(float(np.ptp(places)))} {unit} beside the origin, the model is "
                     f"{g2(high - low)} {unit} across them; in {either(units)} they would spread over it")  # fmt: skip
            found.append(Finding(DOUBTFUL, "units", words, f"give the sections' points in {unit}"))
    return found


def _larger(unit: str) -> list[tuple[str, float]]:
    """Units in which numbers are at least `rules.OTHER_UNIT` times as long, and how many times."""
    times = {other: IN_MM[other] / IN_MM[unit] for other in IN_MM} if unit in IN_MM else {}
    return sorted(((u, f) for u, f in times.items() if f >= rules.OTHER_UNIT), key=lambda pair: -pair[1])


def _inside(at: Array, box: Box) -> bool:
    return bool(((at >= box[0]) & (at <= box[1])).all())


def _range(box: Box, normal: ArrayLike) -> tuple[float, float]:
    """Lowest and highest place of a box along a direction."""
    n = np.asarray(normal, dtype=float)
    ends = np.stack([box[0] * n, box[1] * n])
    return float(ends.min(axis=0).sum()), float(ends.max(axis=0).sum())


def _spread(places: Array, low: float, high: float) -> bool:
    """Whether all of some planes cut the model, over more than a tenth of it."""
    return bool(((places >= low) & (places <= high)).all() and np.ptp(places) > 0.1 * (high - low))


def lamp_findings(mesh: Mesh, lamps: Sequence[Sequence[float]], unit: str) -> list[Finding]:
    """Lamps that stand where none can: at the model, or so far away that their places are of another unit."""
    low, high = model_box(mesh)
    size = float(np.linalg.norm(high - low))
    nodes = mesh.vertices[mesh.used]
    nodes = nodes[((nodes >= low) & (nodes <= high)).all(axis=1)]
    found = []
    for k, lamp in enumerate(lamps):
        near = float(np.linalg.norm(nodes - np.asarray(lamp, dtype=float), axis=1).min())
        if not rules.LAMP[0] * size < near < rules.LAMP[1] * size:
            found.append(
                Finding(
                    DOUBTFUL,
                    "units",
                    f"lamp {k + 1} stands {g3(near)} {unit} from a model of {g3(size)} {unit}: the light that is taken "
                    "from it is no lamp's",
                    f"give lamp.position in {unit}, in the frame of markers and grid",
                )
            )
    return found
