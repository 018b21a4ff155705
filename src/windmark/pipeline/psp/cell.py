"""A paint's calibration from its table of cell measurements, with errors that name file, line and expectation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.io.csvtable import Table
from windmark.io.point_tables import LABELS
from windmark.paint import NotFitted, PaintFit, TemperaturePaint, fit_paint, fit_temperature_paint
from windmark.pipeline.psp.columns import check_columns, in_unit, temperatures
from windmark.pipeline.psp.stream import FROZEN_K
from windmark.pipeline.psp.table import PRESSURE, STEPS_K

Array = NDArray[np.float64]

INVERTED = "; expected I_ref / I, which rises with pressure (not I / I_ref)"


@dataclass(frozen=True, eq=False)
class CellTable:
    """Measurements in a calibration cell: (M,) each, pascals and kelvin; rows that are the same count once.

    Parameters
    ----------
    path : the file
    pressure : None where it was not asked for
    temperature, ratio : of the cell, and I_ref / I there
    ratio_sigma : None where the table states none
    pressure_sigma, temperature_sigma : 0 where the table states none
    remarks : what is to be said of its rows
    """

    path: Path
    pressure: Array | None
    temperature: Array
    ratio: Array
    ratio_sigma: Array | None
    pressure_sigma: Array
    temperature_sigma: Array
    remarks: tuple[str, ...] = ()


def read_cell(path: Path, *, pressure: bool = True) -> CellTable:
    """A CSV table ``pressure_UNIT,temperature_UNIT,ratio[,sigma][,sigma_pressure_UNIT][,sigma_temperature_UNIT]``.

    ``run``, ``time`` and ``note`` may be beside them: rows that agree in all columns are one measurement.

    Parameters
    ----------
    pressure : False for a temperature paint, whose table needs none

    Raises
    ------
    FileError
        For a missing column, one that is not known, an unknown unit, a cell that is no number, and values that no cell
        has.
    """
    table = io.read_table(path, required=("ratio",), known=None)
    if not len(table):
        raise io.FileError(path, "has no rows; expected a measurement in each")
    of_unit = ("pressure", "temperature", "sigma_pressure", "sigma_temperature")
    check_columns(table, ("ratio", "sigma", *LABELS), of_unit)
    p = in_unit(table, "pressure", PRESSURE) if pressure else None
    t, ratio = temperatures(table, "temperature"), table.numbers("ratio")
    if p is not None:
        table.check(p > 0, "the pressure must be a number above zero")
    table.check(t > FROZEN_K, f"the temperature must be above {FROZEN_K:g} K: is it in the column's unit?")
    table.check(ratio > 0, "the ratio I_ref / I must be above zero")
    sigma = None
    if "sigma" in table:
        sigma = table.numbers("sigma")
        table.check(sigma > 0, "sigma, that of the ratio, must be above zero; leave the column out where it is unknown")
    p_sigma, t_sigma = _sigma(table, "sigma_pressure", PRESSURE), _sigma(table, "sigma_temperature", STEPS_K)
    rows, remarks = _once(table)
    return CellTable(path, None if p is None else p[rows], t[rows], ratio[rows], None if sigma is None else sigma[rows],
                     p_sigma[rows], t_sigma[rows], remarks)  # fmt: skip


def _once(table: Table) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """The rows without those that repeat an earlier one in every cell, also of columns that are not known.

    Noise makes two measurements differ: a copy is none, and counted as one it makes the law's sigma too small.
    """
    first: dict[tuple[str, ...], int] = {}
    of = [first.setdefault(row, k) for k, row in enumerate(zip(*map(table.text, table.columns), strict=True))]
    copies = [k for k, earlier in enumerate(of) if earlier != k]
    if not copies:
        return np.arange(len(table)), ()
    k = copies[0]
    return np.array(sorted(first.values())), (
        f"{len(copies)} of {len(table)} rows of {Path(table.path).name} are the same as earlier ones and count once; "
        f"the first: line {table.lines[k]} is line {table.lines[of[k]]}",
    )


def _sigma(table: Table, column: str, units: dict[str, float]) -> Array:
    out = np.nan_to_num(in_unit(table, column, units, optional=True), nan=0.0)
    table.check(out >= 0, f"{column} must be at least 0")
    return out


def calibrate_paint(
    cell: CellTable, *, p_ref_Pa: float, t_ref_K: float, orders: tuple[int, int] | None = None, key: str | None = None
) -> PaintFit:
    """The paint's law of pressure and temperature, see `paint.fit_paint`.

    Parameters
    ----------
    key : of the project that names the table, for messages

    Raises
    ------
    FileError
        Where the table does not determine a law, or that does not rise with pressure.
    """
    assert cell.pressure is not None
    fit = fit_paint(
        cell.pressure, cell.temperature, cell.ratio, p_ref=p_ref_Pa, t_ref=t_ref_K, ratio_sigma=cell.ratio_sigma,
        pressure_sigma=cell.pressure_sigma, temperature_sigma=cell.temperature_sigma, order=orders,
    )  # fmt: skip
    if isinstance(fit, NotFitted):
        falls = "does not rise" in fit.reason
        raise io.FileError(cell.path, fit.reason.removeprefix("fit_paint: ") + (INVERTED if falls else ""), key)
    return replace(fit, warnings=(*fit.warnings, *cell.remarks))


def calibrate_temperature_paint(
    cell: CellTable, *, t_ref_K: float, order: int | None = None, key: str | None = None
) -> TemperaturePaint:
    """The law of a paint that answers to temperature alone, see `paint.fit_temperature_paint` and `calibrate_paint`."""
    fit = fit_temperature_paint(
        cell.temperature, cell.ratio, t_ref=t_ref_K, ratio_sigma=cell.ratio_sigma,
        temperature_sigma=float(np.sqrt(np.mean(cell.temperature_sigma**2))), order=order,
    )  # fmt: skip
    if isinstance(fit, NotFitted):
        falls = "does not rise" in fit.reason
        words = fit.reason.removeprefix("fit_temperature_paint: ")
        raise io.FileError(cell.path, words + (INVERTED.replace("pressure", "temperature") if falls else ""), key)
    return fit
