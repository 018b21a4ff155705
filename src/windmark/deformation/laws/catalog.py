"""The built-in laws by the names that project files use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.law import Law, LawError
from windmark.deformation.laws.bases import Basis, Powers, Splines, cantilever, powers
from windmark.deformation.laws.beam import Beam
from windmark.deformation.laws.fields import Smooth, TabulatedModes
from windmark.deformation.laws.options import Option, number, one_or_three, read_options, several, whole, word
from windmark.deformation.laws.rigid import SLOPE, Hinge, Rigid, Sting
from windmark.errors import UsageError, WindmarkError

Array = NDArray[np.float64]
Table = tuple[Array, Array]


@dataclass(frozen=True)
class Given:
    """What a law is made from besides its options.

    Parameters
    ----------
    unit : length unit
    points : (M, 3) markers of the volume; None where there are none
    table : nodes (M, 3) and shapes (M, 3, k) of a table of modes; None where there is none
    """

    unit: str
    points: Array | None
    table: Table | None


@dataclass(frozen=True)
class Entry:
    """A built-in law.

    Parameters
    ----------
    kind : its name in a project file
    line : what it is, in one line
    options : what can be set
    make : the law from all its options
    example : options for a half wing of 600 mm span, for the list of laws and its pictures
    """

    kind: str
    line: str
    options: tuple[Option, ...]
    make: Callable[[Mapping[str, Any], Given], Law]
    example: Mapping[str, Any]


def make_law(
    kind: str, options: Mapping[str, Any], *, unit: str, points: Array | None = None, table: Table | None = None
) -> Law:
    """A built-in law by its name.

    Parameters
    ----------
    kind : key of `CATALOG`
    options : as a project file gives them
    unit : length unit, for the parameters' names only
    points : (M, 3) markers of the volume; "smooth" is carried by them
    table : nodes (M, 3) and shapes (M, 3, k), for "modes"

    Raises
    ------
    LawError
        For a name or an option that does not exist, an option that is missing, or values that do not fit.
    """
    if kind not in CATALOG:
        raise LawError(f"law {kind!r}: expected one of {', '.join(CATALOG)}")
    entry = CATALOG[kind]
    values = read_options(f"law {kind}", entry.options, options)
    try:
        return entry.make(values, Given(unit, points, table))
    except WindmarkError as error:
        raise LawError(f"law {kind}: {str(error).removeprefix(f'{kind}: ')}") from None


def _point(name: str, meaning: str, default: Any = ...) -> Option:
    more = {} if default is ... else {"default": default}
    return Option(name, "three numbers x, y, z", several(number, 3), meaning, **more)


def _count(name: str, meaning: str, default: int) -> Option:
    return Option(name, "a whole number", whole, meaning, default)


def _degrees(name: str, meaning: str, default: tuple[int, ...]) -> Option:
    return Option(name, "a list of whole numbers", several(whole), meaning, default)


def _stations(name: str, meaning: str, default: tuple[float, ...]) -> Option:
    return Option(name, "a list of numbers that increase within (0, 1]", several(number), meaning, default)


_AXIS = (
    _point("root", "where the elastic axis meets the clamped section"),
    _point("tip", "where the elastic axis ends"),
    _point("up", "direction of positive bending, made normal to the axis", (0.0, 0.0, 1.0)),
    _point("section", "normal of the sections that keep their shape; by default the axis", None),
)
_WING = {"root": [123.0, 72.0, 5.0], "tip": [361.0, 600.0, 42.0], "section": [0.0, 1.0, 0.0]}


def _beam(o: Mapping[str, Any], given: Given, bend: Basis, twist: Basis, sway: Basis) -> Law:
    law = Beam(o["root"], o["tip"], o["up"], bend, twist, sway, o["section"], given.unit)
    if not law.parameters:
        raise UsageError("bend, twist and sway are all empty: nothing could move")
    return law


def _powers(o: Mapping[str, Any], given: Given) -> Law:
    return _beam(o, given, powers(o["bend"]), powers(o["twist"]), powers(o["sway"]))


def _modal(o: Mapping[str, Any], given: Given) -> Law:
    bend, twist = cantilever(o["bend"], o["twist"])
    return _beam(o, given, bend, twist, powers(()))


def _splines(o: Mapping[str, Any], given: Given) -> Law:
    def basis(name: str, clamped: bool) -> Basis:
        return Splines(o[name], clamped) if o[name] else Powers(())

    return _beam(o, given, basis("bend", True), basis("twist", False), basis("sway", True))


def _modes(o: Mapping[str, Any], given: Given) -> Law:
    if given.table is None:
        raise UsageError(f"table {o['table']}: its nodes and shapes must be handed in, got none")
    return TabulatedModes(*given.table, unit=o["amplitude_unit"])


def _smooth(o: Mapping[str, Any], given: Given) -> Law:
    if given.points is None or not len(given.points):
        raise UsageError("the volume has no markers to carry it")
    return Smooth(given.points, o["amplitude"], o["reach"], given.unit)


_ENTRIES = (
    Entry(
        "rigid", "a rigid motion relative to the parent: a shift and a rotation vector",
        (_point("pivot", "the point that the rotation leaves where it is", (0.0, 0.0, 0.0)),),
        lambda o, given: Rigid(o["pivot"], given.unit),
        {"pivot": [185.0, 0.0, 0.0]},
    ),
    Entry(
        "hinge", "a flap, rudder or aileron that turns about its hinge line",
        (
            _point("start", "a point of the hinge line"),
            _point("end", "another one; the angle is positive by the right-hand rule from start to end"),
        ),
        lambda o, given: Hinge(o["start"], o["end"]),
        {"start": [259.0, 180.0, 14.0], "end": [366.0, 480.0, 37.0]},
    ),
    Entry(
        "sting", "a rigid model on a sting that bends like a cantilever and twists",
        (
            _point("root", "where the sting is clamped"),
            _point("end", "where it enters the model"),
            _point("up", "direction of the first deflection, made normal to the sting", (0.0, 0.0, 1.0)),
            Option("load", " or ".join(SLOPE), word, "what bends it at its end: which slope belongs to a deflection",
                   "force"),
        ),
        lambda o, given: Sting(o["root"], o["end"], o["up"], o["load"], given.unit),
        {"root": [1300.0, 0.0, 0.0], "end": [640.0, 0.0, 0.0]},
    ),
    Entry(
        "beam", "bending and twist along an elastic axis, powers of the station",
        (
            *_AXIS,
            _degrees("bend", "powers of the bending", (2, 3)),
            _degrees("twist", "powers of the twist", (1, 2)),
            _degrees("sway", "powers of the bending in the plane, along axis x up", ()),
        ),
        _powers,
        {**_WING, "sway": [2]},
    ),
    Entry(
        "modal_beam", "bending and twist along an elastic axis, modes of a uniform clamped-free beam",
        (*_AXIS, _count("bend", "how many bending modes", 2), _count("twist", "how many torsion modes", 1)),
        _modal,
        _WING,
    ),
    Entry(
        "spline_beam", "bending and twist along an elastic axis, splines through values at stations",
        (
            *_AXIS,
            _stations("bend", "stations of the bending, as parts of the axis", (0.25, 0.5, 0.75, 1.0)),
            _stations("twist", "stations of the twist", (0.5, 1.0)),
            _stations("sway", "stations of the bending in the plane", ()),
        ),
        _splines,
        _WING,
    ),
    Entry(
        "modes", "mode shapes read from a table: finite elements, or measured ones",
        (
            Option("table", "the name of a CSV file x,y,z,dx_1,dy_1,dz_1,dx_2,...", word, "nodes and their shapes"),
            Option("amplitude_unit", "a text", word, "unit of the amplitudes, by which the shapes are multiplied", ""),
        ),
        _modes,
        {"table": "modes.csv"},
    ),
    Entry(
        "smooth", "any displacement that is smooth, carried by the volume's markers",
        (
            Option("amplitude", "a number or three", one_or_three,
                   "expected size of the displacement, for all axes or x, y, z; 0: none along that axis"),
            Option("reach", "a number > 0", number, "distance over which neighbours move alike"),
        ),
        _smooth,
        {"amplitude": [0.0, 0.0, 10.0], "reach": 500.0},
    ),
)  # fmt: skip
CATALOG: Mapping[str, Entry] = {entry.kind: entry for entry in _ENTRIES}
"""Every built-in law by its name."""
