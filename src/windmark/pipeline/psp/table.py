"""The run/point table of a paint test, and the readings of its sensors: units are in the names of columns."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.errors import DataError, WindmarkError
from windmark.io.csvtable import Table
from windmark.paint import TunnelConditions
from windmark.pipeline.psp.columns import check_columns, check_units, in_unit, temperatures
from windmark.pipeline.psp.stream import FROZEN_K, PRESSURE, TEMPERATURE, contradiction, dynamic_pressure, joined
from windmark.pipeline.psp.wtd import read_wtd
from windmark.pipeline.settings import unusable_name

Array = NDArray[np.float64]

STEPS_K = {unit: factor for unit, (factor, _) in TEMPERATURE.items()}
"""Kelvin of a difference of one degree."""
WIND_ON, WIND_OFF = "wind-on", "wind-off"
OWN = ("points.csv", "loads.csv", "polar.pvd")
"""Files of the results beside the points' folders."""
CHANNELS = ("reference", "temperature")
"""Other colours of the same paint: one that does not answer to pressure, one that answers to temperature alone."""
MIXED = 0.05
"""q of the table and 0.7 M^2 p differ by less than this part where both are in the units that they say."""


@dataclass(frozen=True)
class ReferencePart:
    """Pictures that a point's reference is made of beside others.

    Parameters
    ----------
    name : in words
    alpha_deg : at which they were taken
    share : of the parts
    pattern, channels : of the pictures, and of those in other colours
    p_off, t_off : pressure and temperature there, wind-off; NaN where it is another point of a run
    """

    name: str
    alpha_deg: float
    share: float
    pattern: str
    channels: Mapping[str, str] = field(default_factory=dict)
    p_off: float = float("nan")
    t_off: float = float("nan")


@dataclass(frozen=True)
class PointRow:
    """A row of the table; NaN where a cell is empty. Pascals and kelvin.

    Parameters
    ----------
    name : of the point
    alpha_deg, beta_deg : incidence and sideslip
    mach, p_inf, q_inf, t_0 : of the stream
    p_off, t_off : of the wind-off pictures
    on, off : patterns of pictures, see `project.CAMERA`
    sigma_p, sigma_q : of static and dynamic pressure
    line : in the file
    channels : "reference" or "temperature" -> patterns of its pictures with wind and without
    conditions_file : that says what the table's own cells do not; None without
    trouble : why the point cannot be reduced, in a sentence
    remarks : what is to be said of its conditions
    run : that it belongs to
    parts : of its reference, where that is not its own wind-off pictures
    own : its reference is the mean of its run: ``parts`` are the other points, its own pictures are one part, too
    """

    name: str
    alpha_deg: float
    beta_deg: float
    mach: float
    p_inf: float
    q_inf: float
    t_0: float
    p_off: float
    t_off: float
    on: str
    off: str
    sigma_p: float
    sigma_q: float
    line: int
    channels: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    conditions_file: Path | None = None
    trouble: str = ""
    remarks: tuple[str, ...] = ()
    run: str = ""
    parts: tuple[ReferencePart, ...] = ()
    own: bool = False

    @property
    def patterns(self) -> dict[str, str]:
        """What kind of pictures -> their pattern, "" where none are named."""
        out = {WIND_ON: self.on} | ({} if self.parts else {WIND_OFF: self.off})
        for name, (on, off) in self.channels.items():
            out |= {f"{WIND_ON} {name}": on} | ({} if self.parts else {f"{WIND_OFF} {name}": off})
        for part in self.parts:
            for name in ("", *self.channels):
                out[reference_kind(name, part)] = part.channels.get(name, "") if name else part.pattern
        return out

    @property
    def contradiction(self) -> float:
        """See `stream.contradiction`."""
        return contradiction(self.mach, self.p_inf, self.q_inf, self.sigma_p, self.sigma_q)

    def conditions(self) -> TunnelConditions:
        """The stream.

        Raises
        ------
        DataError
            For what is missing, and for pressures that do not fit each other: their units are mixed.
        """
        if self.trouble:
            raise DataError(self.trouble)
        needed = {"alpha": self.alpha_deg, "p_inf": self.p_inf, "q_inf": self.q_inf, "p_off": self.p_off}
        for what, value in needed.items():
            if not np.isfinite(value) and not (self.own and what == "p_off"):
                raise DataError(f"{what} is missing in the table of points (line {self.line})")
        self._check_wind()
        for what, value in (("T0", self.t_0), ("T_off", self.t_off)):
            if value <= FROZEN_K:
                raise DataError(f"{what} is {value:g} K, expected above {FROZEN_K:g} K: is it in the unit of its "
                                f"name? (line {self.line} of the table of points)")  # fmt: skip
        if not abs(self.contradiction) < MIXED:
            by_mach = dynamic_pressure(self.mach, self.p_inf)
            raise DataError(
                f"q_inf is {self.q_inf:g} Pa, but Mach {self.mach:g} and p_inf {self.p_inf:g} Pa give {by_mach:g} "
                f"Pa: units are mixed, or a cell is wrong (line {self.line} of the table of points)"
            )
        cov = np.diag([np.nan_to_num(self.sigma_p) ** 2, np.nan_to_num(self.sigma_q) ** 2])
        # One of the three is wrong, and nothing says which: as if each were it in a third of all cases.
        cov += np.diag([self.p_inf, self.q_inf]) ** 2 * self.contradiction**2 / 3
        return TunnelConditions(
            self.p_inf, self.q_inf, cov if cov.any() else None, mach=self.mach, t_0=self.t_0
        )  # fmt: skip

    def _check_wind(self) -> None:
        """Refuse what no stream has, a row without wind among it: Cp is a pressure over q_inf."""
        where = f"(line {self.line} of the table of points)"
        if self.p_inf <= 0:
            raise DataError(f"p_inf is {self.p_inf:g} Pa: expected an absolute pressure, above 0 {where}")
        for what, value, unit in (("q_inf", self.q_inf, " Pa"), ("Mach", self.mach, "")):
            if value <= 0:
                raise DataError(f"{what} is {value:g}{unit}: nothing has a Cp without wind; leave a tare point out of "
                                f"the table, or correct the cell {where}")  # fmt: skip


def reference_kind(colour: str, part: ReferencePart | None = None) -> str:
    """What pictures of a reference are called: of a colour, "" for the paint's own."""
    words = f"{WIND_OFF} {colour}".rstrip()
    return words if part is None else f"{words} ({part.name})"


def read_points_table(
    path: Path, constants: Mapping[str, float] | None = None, *, references: bool = False
) -> tuple[PointRow, ...]:
    """The rows of a CSV table ``point,alpha_deg,p_inf_UNIT,q_inf_UNIT,p_off_UNIT,T_off_UNIT,on,off[,...]``.

    May have: ``wtd``, a file for each point that says what its own cells do not (`wtd.read_wtd`; columns that such
    files say may be missing), ``beta_deg``, ``mach``, ``T0_UNIT``, ``sigma_p_inf_UNIT``, ``sigma_q_inf_UNIT``, ``run``,
    and pictures in other colours, ``on_reference, off_reference, on_temperature, off_temperature``; other columns are
    left out. An empty cell is missing for its point alone. Units of pressures: `PRESSURE`; of temperatures:
    `TEMPERATURE`.

    Parameters
    ----------
    constants : of all points, for what neither cells nor files say (`stream.constants_of`); what they say may have no
        column
    references : the project has some, so that no wind-off pictures need be named

    Raises
    ------
    FileError
        For a missing column, a quantity whose unit is missing or not known, a cell that is no number, a point twice or
        with a name that no folder can have, or no point at all.
    """
    needed, constants = ("point", "on") if references else ("point", "on", "off"), constants or {}
    table = io.read_table(path, required=needed, known=None)
    by_file = "wtd" in table
    if not by_file and "alpha_deg" not in table and "alpha_deg" not in constants:
        raise io.FileError(path, "has no column alpha_deg", "header")
    names = table.text("point")
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice or "" in names:
        why = f"point {twice[0]!r} is there more than once" if twice else "a point has no name"
        raise io.FileError(path, why, "point")
    if not names:
        raise io.FileError(path, "has no points; expected a row for each")
    if (reason := unusable_name([*OWN, *names])) is not None:
        raise io.FileError(path, f"a point's results go into a folder of its name, and {reason}", "point")
    check_units(table, {"alpha": "alpha_deg", "beta": "beta_deg", "mach": "mach", **{
        q: f"{q}_UNIT" for q in ("p_inf", "q_inf", "p_off", "T0", "T_off", "sigma_p_inf", "sigma_q_inf")
    }})  # fmt: skip
    cells = _cells(table, {*constants, *(("p_inf", "q_inf") if by_file else ()),
                           *(("p_off", "t_off") if references else ())})  # fmt: skip
    off, files, runs = (table.text(c) if c in table else [""] * len(names) for c in ("off", "wtd", "run"))
    out = []
    for k, (channels, line) in enumerate(zip(_channels(table, references), table.lines.tolist(), strict=True)):
        own, trouble, file = {key: float(column[k]) for key, column in cells.items()}, "", path.parent / files[k]
        said: list[tuple[str, Mapping[str, float]]] = [("its row", own)]
        try:
            said += [("its file of conditions", read_wtd(file))] if files[k] else []
        except WindmarkError as error:
            trouble = f"its conditions cannot be read (line {line} of the table of points): {error}"
        found, remarks = joined([*said, ("the project", constants)])
        values: dict[str, Any] = dict(found)
        out.append(PointRow(
            name=names[k], on=table.text("on")[k], off=off[k], line=line, channels=channels, trouble=trouble,
            conditions_file=file if files[k] and not trouble else None, remarks=remarks, run=runs[k], **values,
        ))  # fmt: skip
    return tuple(out)


def _cells(table: Table, elsewhere: Collection[str]) -> dict[str, Array]:
    """`stream.KEYS` -> column in base units, NaN for empty cells; what is said ``elsewhere`` may have no column."""
    none = np.full(len(table), np.nan)
    plain = ("alpha_deg", "beta_deg", "mach")
    out = {key: table.numbers(key, optional=True) if key in table else none for key in plain}
    for key in ("p_inf", "q_inf", "p_off"):
        out[key] = in_unit(table, key, PRESSURE, optional=key in elsewhere)
    out["t_0"], out["t_off"] = (temperatures(table, name, optional=may) for name, may in
                                (("T0", True), ("T_off", "t_off" in elsewhere)))  # fmt: skip
    for key in ("p", "q"):
        out[f"sigma_{key}"] = in_unit(table, f"sigma_{key}_inf", PRESSURE, optional=True)
    return out


def _channels(table: Table, references: bool) -> list[dict[str, tuple[str, str]]]:
    """Of each row: other colours of which it names pictures."""
    out: list[dict[str, tuple[str, str]]] = [{} for _ in range(len(table))]
    for name in CHANNELS:
        there = [c for c in (f"on_{name}", f"off_{name}") if c in table]
        if len(there) == 1 and not (references and there[0].startswith("on")):
            raise io.FileError(Path(table.path), f"has {there[0]} alone; expected on_{name} and off_{name}", "header")
        for row, pair in enumerate(zip(*(table.text(c) for c in there), strict=True)):
            if any(pair):
                out[row][name] = (pair[0], pair[1] if len(pair) > 1 else "")
    return out


@dataclass(frozen=True)
class SensorTable:
    """Readings of sensors: point -> name -> (value, sigma)."""

    path: Path
    of: Mapping[str, Mapping[str, tuple[float, float]]] = field(default_factory=dict)

    def at(self, point: str, names: Sequence[str]) -> tuple[Array, Array]:
        """(N,) values and sigmas of a point, NaN for sensors without a reading."""
        own = self.of.get(point, {})
        pairs = np.array([own.get(n, (np.nan, np.nan)) for n in names], dtype=float).reshape(-1, 2)
        return pairs[:, 0], pairs[:, 1]


def read_sensors(path: Path, quantity: str, sigma: float) -> SensorTable:
    """A CSV table ``point,name,QUANTITY_UNIT[,sigma_UNIT]`` of pressures (Pa) or temperatures (K).

    Parameters
    ----------
    quantity : "pressure" or "temperature"
    sigma : of readings whose table says none, in Pa or K

    Raises
    ------
    FileError
        As in `read_points_table`; for a column that is not known, a sensor that is there twice at a point, a sigma that
        is not above 0, a temperature that no air has.
    """
    table = io.read_table(path, required=("point", "name"), known=None)
    check_columns(table, ("point", "name"), ("pressure", "temperature", "sigma"))
    warm = quantity == "temperature"
    value = temperatures(table, quantity) if warm else in_unit(table, quantity, PRESSURE)
    if warm:
        table.check(~(value <= FROZEN_K), f"the temperature must be above {FROZEN_K:g} K: is it in the column's unit?")
    sigmas = np.nan_to_num(in_unit(table, "sigma", STEPS_K if warm else PRESSURE, optional=True), nan=sigma)
    table.check(sigmas > 0, "sigma must be > 0, or empty where unknown")
    out: dict[str, dict[str, tuple[float, float]]] = {}
    for row, (point, name) in enumerate(zip(table.text("point"), table.text("name"), strict=True)):
        own = out.setdefault(point, {})
        if name in own:
            table.fail(row, f"{name!r} is there more than once for point {point!r}")
        own[name] = (float(value[row]), float(sigmas[row]))
    return SensorTable(path, out)
