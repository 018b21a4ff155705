"""Columns of a table whose names say their units: ``pressure_kPa``, ``temperature_degC``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.io.csvtable import Table
from windmark.pipeline.psp.stream import TEMPERATURE

Array = NDArray[np.float64]


def in_unit(table: Table, quantity: str, units: Mapping[str, float], *, optional: bool = False) -> Array:
    """A column ``quantity_UNIT`` in the units' base; NaN where a cell, or with ``optional`` the column, is missing.

    Raises
    ------
    FileError
        Without such a column, with several, or with one in a unit that is not known.
    """
    column = _column(table, quantity, units, optional)
    if column is None:
        return np.full(len(table), np.nan)
    return table.numbers(column, optional=True) * units[_unit_of(column, quantity, units)]


def temperatures(table: Table, quantity: str, *, optional: bool = False) -> Array:
    """A column ``quantity_UNIT`` in kelvin; see `in_unit`."""
    column = _column(table, quantity, TEMPERATURE, optional)
    if column is None:
        return np.full(len(table), np.nan)
    factor, offset = TEMPERATURE[_unit_of(column, quantity, TEMPERATURE)]
    return table.numbers(column, optional=True) * factor + offset


def _column(table: Table, quantity: str, units: Mapping[str, object], optional: bool) -> str | None:
    found = [c for c in table.columns if c.startswith(f"{quantity.lower()}_")]
    if not found and optional:
        return None
    expected = f"expected {quantity}_UNIT with one of the units {', '.join(units)}"
    if len(found) != 1:
        raise io.FileError(Path(table.path), f"has {' and '.join(found) or f'no column {quantity}_...'}; {expected}")
    if not _unit_of(found[0], quantity, units):
        raise io.FileError(Path(table.path), f"its unit is not known; {expected}", found[0])
    return found[0]


def _unit_of(column: str, quantity: str, units: Mapping[str, object]) -> str:
    """The unit in a column's name, whatever its letters' case; "" for one that is not known."""
    said = column[len(quantity) + 1 :].lower()
    return next((unit for unit in units if unit.lower() == said), "")


def check_units(table: Table, quantities: Mapping[str, str]) -> None:
    """Refuse a quantity without a unit, or in one that is not known, in a table that may have columns of its own: its
    cells would not count, and nothing would say so.

    Parameters
    ----------
    quantities : each -> the column that it is expected as; one that is there, any others beside it are the user's own

    Raises
    ------
    FileError
        Naming the column.
    """
    for quantity, expected in quantities.items():
        word = quantity.lower()
        own = [c for c in table.columns if c == word or c.startswith(f"{word}_")]
        right = [c for c in own if c == expected or (expected.endswith("_UNIT") and c != word)]
        if own and not right:
            words = f"unknown column {own[0]!r}; expected {expected}, or another name for a column of your own"
            raise io.FileError(Path(table.path), words, "header")


def check_columns(table: Table, plain: Sequence[str], quantities: Sequence[str]) -> None:
    """Refuse a column that is none of the ``plain`` ones, nor one of the ``quantities`` with a unit: what it says would
    not count, as a sigma that is not called as expected.

    Raises
    ------
    FileError
        Naming the column.
    """
    listed = [*plain, *(f"{q}_UNIT" for q in quantities)]
    for column in table.columns:
        if column not in plain and not any(column.startswith(f"{q}_") for q in quantities):
            words = f"unknown column {column!r}; the columns are {','.join(listed)}"
            raise io.FileError(Path(table.path), words, "header")
