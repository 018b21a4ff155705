"""One point of a paint test: the ratio on the model to pressure, Cp, loads and sections, each with its sigma."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from windmark.errors import DataError
from windmark.paint import (
    InSitu,
    LoadReference,
    Loads,
    NodeField,
    PressureMap,
    SternVolmer,
    TunnelConditions,
    TunnelGain,
    pressure_coefficient,
    recovery_temperature,
    thermocouple_temperature,
    varying,
)
from windmark.paint.filling import stranded
from windmark.scene import Mesh
from windmark.tasks.psp.cuts import SectionLoads, SectionWanted, SurfaceSection, cut_sections, part_words, section_loads
from windmark.tasks.psp.few_modes import gain_pressure, pressure_of
from windmark.tasks.psp.loads import between_incidences, hole_words, seen_loads
from windmark.tasks.psp.patching import patched
from windmark.tasks.psp.plausible import (
    beside_recovery,
    beyond_calibration,
    beyond_stream,
    fitted_level,
    lacking,
    unchecked_level,
)
from windmark.tasks.psp.ratios import MergedRatio
from windmark.tasks.psp.taps import Readings, TapTable, at_taps, in_cp
from windmark.tasks.psp.unlit import unlit_words

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

WALL = 0.1
"""Part of the grid's size over which a wall's temperature keeps about its value, where nothing else is said."""


def no_patches() -> tuple[Array, Array, Array]:
    """Centres, radii and normals of none."""
    return np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class PointTask:
    """What is known of a point besides its pictures.

    Parameters
    ----------
    name : of the point
    law : the paint's calibration; a gain needs ``steady``
    conditions : of the stream
    p_off, t_off : pressure and temperature of the wind-off pictures, in the calibration's units
    recovery : factor of the wall's temperature, where no thermocouple has a reading; None: thermocouples alone say it
    thermocouples : readings in K; None without
    wall_sigma, wall_length : by how much (K) the wall's temperature varies about its mean or differs from recovery, and
        over what distance it keeps about its value; None: a tenth of the grid's size
    taps : readings of pressure; None without
    fit_taps : "offset-slope", "offset", or "compare": the taps are only compared with
    patches : centres (D, 3), radii (D,) and outward normals (D, 3) or NaN, on the model at rest, of what is no paint
    polygons : corners (K, 3) of drawn polygons with what is no paint, on the model at rest
    temperature : of the wall in K, where it is known at the nodes; nodes beside what is no paint are filled, too
    steady : pressure (V) of the steady state whose light the ratio is formed with
    reference : of the loads; None: none are wanted
    least_seen : see `integrate_loads`
    sections : cuts that are wanted
    alpha_apart_deg : by how much the incidence of the loads' axes differs from what the pictures show
    """

    name: str
    law: SternVolmer | TunnelGain
    conditions: TunnelConditions
    p_off: float
    t_off: float
    recovery: float | None = None
    thermocouples: Readings | None = None
    wall_sigma: float = 1.0
    wall_length: float | None = None
    taps: Readings | None = None
    fit_taps: str = "offset-slope"
    patches: tuple[Array, Array, Array] = field(default_factory=no_patches)
    reference: LoadReference | None = None
    least_seen: float = 0.5
    sections: tuple[SectionWanted, ...] = ()
    polygons: tuple[Array, ...] = ()
    temperature: NodeField | None = None
    steady: NodeField | None = None
    alpha_apart_deg: float = 0.0


@dataclass(frozen=True, eq=False)
class ReducedPoint:
    """A point of a paint test.

    Parameters
    ----------
    name : of the point
    mesh : the grid deformed, in the model's frame
    ratio : (V) wind-off / wind-on, patches filled
    temperature, pressure, cp : (V) fields
    flags : (V,) bits of `paint.FLAGS`; filled : (V,) the values are those of their surroundings
    merged : the ratio before patches were taken out, and each camera's
    in_situ : the fit to the taps; None without, ``remarks`` say why
    taps : paint against taps; None without
    loads : of the seen side; None where none were wanted, or ``remarks`` say why
    sections : Cp along cuts
    shown : (V,) nodes of the sides that cameras show, those without a value among them
    remarks : what is to be said of the point
    section_loads : of the same cuts
    """

    name: str
    mesh: Mesh
    ratio: NodeField
    temperature: NodeField
    pressure: NodeField
    cp: NodeField
    flags: NDArray[np.uint8]
    filled: Mask
    merged: MergedRatio
    in_situ: InSitu | None
    taps: TapTable | None
    loads: Loads | None
    sections: tuple[SurfaceSection, ...]
    shown: Mask
    remarks: tuple[str, ...] = ()
    section_loads: tuple[SectionLoads, ...] = ()


def reduce_point(merged: MergedRatio, rest: Mesh, mesh: Mesh, task: PointTask) -> ReducedPoint:
    """From the ratio on the model to pressure, Cp, loads and sections.

    Parameters
    ----------
    merged : see `ratio_of`
    rest, mesh : the grid at rest, and as it was with wind in the model's frame
    task : what is known of the point

    Raises
    ------
    DataError
        Where no node comes to a pressure.

    Notes
    -----
    The order: patches out and filled, temperature, pressure by the calibration (a priori), pressure by the taps (in
    situ), Cp, sections, loads. Errors that nodes share go along as modes (`NodeField`).
    """
    remarks: list[str] = [f"{name} does not count: {why}" for name, why in merged.left_out.items()]
    remarks += unlit_words(rest, merged.unlit, merged.ratio.known)
    ratio, filled = patched(rest, merged.ratio, task.patches, task.polygons, remarks)
    shown = ratio.known | merged.shown if merged.shown.any() else ratio.known
    if merged.unlit.any():  # what lacks a value amid unlit surface is as little shown as that
        shown &= ~stranded(rest, ratio, shown & ~ratio.known)
    temperature = _temperature(rest, ratio.known, task, remarks)
    prior = _pressure(ratio, temperature, task)
    if not prior.field.known.any():
        raise DataError(f"no node has a pressure: {_why(prior.flags, temperature, task.law)}")
    remarks += lacking(ratio, prior, temperature)
    remarks += beyond_calibration(prior, temperature, task.law)
    pressure, fit, taps = at_taps(rest, prior.field, filled, task.taps, task.fit_taps, remarks)
    cp = pressure_coefficient(pressure, task.conditions)
    if impossible := beyond_stream(cp, task.conditions):
        raise DataError(impossible)
    if taps is not None and task.taps is not None:
        taps = in_cp(taps, task.taps, task.conditions, cp, filled, rest)
    if taps is None or not taps.counting.any():
        remarks.append(unchecked_level(task.law, ratio, temperature, task.p_off, task.t_off, task.conditions))
    elif fit is not None:
        remarks += fitted_level(task.law, merged.flicker)
    axes = LoadReference(1.0, 1.0, 1.0) if task.reference is None else task.reference
    taps_at = None if task.taps is None else task.taps.xyz
    sections = cut_sections(rest, cp, task.sections, axes, taps_at, remarks)
    along = section_loads(rest, cp, task.sections, axes, seen=shown)
    remarks += part_words(along)
    loads = None
    if task.reference is not None:
        remarks += hole_words(mesh, shown, ratio.known)
        loads = seen_loads(mesh, cp, task.reference, task.least_seen, remarks, seen=shown)
        if loads is not None:
            loads = between_incidences(loads, task.reference, task.alpha_apart_deg, remarks)
    return ReducedPoint(
        task.name, mesh, ratio, temperature, pressure, cp, prior.flags, filled, merged, fit, taps, loads, sections,
        shown, tuple(remarks), along,
    )  # fmt: skip


def _pressure(ratio: NodeField, temperature: NodeField, task: PointTask) -> PressureMap:
    if isinstance(task.law, SternVolmer):
        return pressure_of(task.law, ratio, temperature, task.p_off, task.t_off)
    if task.steady is None:
        raise DataError("the gain is of changes about a steady pressure, and that is missing")
    return gain_pressure(task.law, ratio, temperature, task.steady)


def _temperature(rest: Mesh, seen: Mask, task: PointTask, remarks: list[str]) -> NodeField:
    """Of the wall: as given at the nodes, by thermocouples where they say it, else by recovery.

    Thermocouples say it at the nodes that are ``seen`` alone: the few columns of its error are for these.
    """
    count = len(rest.vertices)
    if task.temperature is not None:
        return patched(rest, task.temperature, task.patches, task.polygons, [])[0]
    wells = task.thermocouples
    if wells is not None and len(wells.names):
        wall = thermocouple_temperature(
            np.where(seen[:, None], rest.vertices, np.nan), wells.xyz, wells.value, sigma=wells.sigma,
            length=task.wall_length or WALL * rest.size, spread=task.wall_sigma,
            names=wells.names, remarks=remarks,
        )  # fmt: skip
        remarks += beside_recovery(wall, task.conditions, task.recovery, task.wall_sigma)
        return wall
    if task.recovery is None:
        raise DataError("there is no temperature: no thermocouple has a reading and no recovery is given")
    known = {"the Mach number": task.conditions.mach, "T0": task.conditions.t_0}
    if lacking := [name for name, value in known.items() if not np.isfinite(value)]:
        raise DataError(f"the temperature is missing: recovery needs {' and '.join(lacking)}, which nothing gives")
    if wells is not None:
        remarks.append("no thermocouple has a reading: the wall's temperature is that of recovery")
    even = recovery_temperature(task.conditions, count, recovery=task.recovery, t_0_sigma=task.wall_sigma)
    # Real walls differ from recovery by place, too: what feeds heat into them, and where the layer is laminar.
    places = np.where(seen[:, None], rest.vertices, np.nan)
    return varying(even, places, spread=task.wall_sigma, length=task.wall_length or WALL * rest.size)


def _why(flags: NDArray[np.uint8], temperature: NodeField, law: SternVolmer | TunnelGain) -> str:
    from windmark.paint.stern_volmer import FLAGS

    warm = temperature.value[temperature.known]
    if isinstance(law, SternVolmer) and len(warm):
        (low, high), middle = law.t_range, float(np.median(warm))
        if not low - (high - low) <= middle <= high + (high - low):
            return (f"the wall's temperature is {middle:.4g} K (median), the paint's calibration is from {low:.4g} to "
                    f"{high:.4g} K: readings or T0 are in another unit")  # fmt: skip
    return "; ".join(words for bit, words in FLAGS.items() if (flags & bit).any()) or "nothing was seen"
