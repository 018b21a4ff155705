"""Marker tables: CSV, and NASA's ``.tgts`` through `windmark.io.tgts`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.io.csvtable import Table, read_table, write_table
from windmark.io.errors import FileError
from windmark.io.text import Pathlike, read_text
from windmark.io.tgts import read_tgts
from windmark.scene import ROLES, MarkerSet
from windmark.scene.shown import PATH, check_kinds
from windmark.scene.units import IN_WORDS

Array = NDArray[np.float64]

XYZ = ("x", "y", "z")
NORMAL = ("nx", "ny", "nz")
SIGMA = ("sigma_x", "sigma_y", "sigma_z")
COLUMNS = ("name", *XYZ, *NORMAL, "radius", "volume", "role", *SIGMA)
"""Columns of a marker table; only name, x, y and z are needed."""

TARGET_ROLES = ("model", "wall", "primary", "secondary")
"""Roles of painted markers that a detector may find. Taps and the like are not among them."""


_UNIT = re.compile(r"^[ \t]*#[ \t]*length[ _]unit:[ \t]*([^\s;]+)(?:;.*|[ \t]*)\r?$", re.MULTILINE | re.IGNORECASE)


def read_markers(path: Pathlike, *, roles: Sequence[str] | None = TARGET_ROLES) -> MarkerSet:
    """Read a marker table.

    CSV: a header ``name,x,y,z[,nx,ny,nz][,radius][,volume][,role][,sigma_x,sigma_y,sigma_z]`` in any order and case,
    separated by comma, semicolon or tab; lengths may have their unit behind them (``x [mm]``); ``#`` starts a comment
    line; an empty cell is an unknown value (volume and role: "model"). ``.tgts``: see `windmark.io.tgts`.

    Parameters
    ----------
    path : the file; the extension ``.tgts`` (any case) tells the format, everything else is CSV
    roles : the roles wanted; by default only painted markers, so that nothing is matched to a
        pressure tap by accident. None for all.

    Returns
    -------
    MarkerSet in the file's order, lengths in the file's own unit; ``length_unit`` is what a comment or the header says
    (see `read_marker_unit`), "" where it says none

    Raises
    ------
    FileError
        Names the line: missing or unknown column, no number, NaN or infinity, empty or double
        name, unknown role; or no marker left.

    Examples
    --------
    >>> import tempfile
    >>> import windmark as wm
    >>> table = wm.MarkerSet.make(["m1", "t1"], [[1, 2, 3], [4, 5, 6]], role=["model", "tap"], length_unit="mm")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     wm.write_markers(f"{folder}/markers.csv", table)
    ...     painted = wm.read_markers(f"{folder}/markers.csv")  # without the pressure tap
    ...     everything = wm.read_markers(f"{folder}/markers.csv", roles=None)
    >>> painted.name.tolist(), everything.name.tolist(), painted.length_unit
    (['m1'], ['m1', 't1'], 'mm')
    """
    if roles is not None:
        unknown = sorted(set(roles) - set(ROLES))
        if unknown:
            raise UsageError(f"read_markers: roles must be among {', '.join(ROLES)}, got {', '.join(unknown)}")
    markers = read_tgts(path) if Path(path).suffix.lower() == ".tgts" else _read_csv(path)
    chosen = markers if roles is None else markers.with_role(*roles)
    if not len(chosen):
        found = sorted(set(markers.role.tolist()))
        has = f"its {len(markers)} entries are {', '.join(found)}" if found else "the table has no rows"
        wanted = "" if roles is None else f" of role {', '.join(roles)}"
        raise FileError(path, f"no markers{wanted}; {has}")
    return replace(chosen, length_unit=read_marker_unit(path, markers.length_unit))


def read_marker_unit(path: Pathlike, header: str = "") -> str:
    """The length unit that a table of places says (``# length unit: mm``, or in its ``header``), "" where none does.

    "free" is that of a reconstruction without scale.

    Raises
    ------
    FileError
        When the file is no text, or says it twice and differently.
    """
    found = sorted({IN_WORDS.get(unit, unit) for unit in [*_UNIT.findall(read_text(path)), *filter(None, [header])]})
    if len(found) > 1:
        raise FileError(path, f"says the length unit more than once: {', '.join(found)}; expected one")
    return found[0] if found else ""


def write_markers(path: Pathlike, markers: MarkerSet, *, length_unit: str = "") -> None:
    """Write a marker table as CSV, whole or not at all; columns in which nothing is known are left out.

    `read_markers` with ``roles=None`` gives back every bit.

    Parameters
    ----------
    path : the file
    markers : the markers
    length_unit : unit of the coordinates, written as a comment, which `read_marker_unit` finds; that of the markers
        themselves where none is given

    Raises
    ------
    ValueError
        For the extension ``.tgts``, which holds less (no sigma, no volume), and for names that are
        empty or begin or end with a space.
    FileError
        When the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import windmark as wm
    >>> markers = wm.MarkerSet.make(["a", "b"], [[0.1, 0.0, 0.0], [1.0, 0.2, 0.0]], radius=2.5, length_unit="mm")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     wm.write_markers(f"{folder}/markers.csv", markers)
    ...     again = wm.read_markers(f"{folder}/markers.csv", roles=None)
    >>> again.xyz.tolist(), again.radius.tolist(), again.length_unit
    ([[0.1, 0.0, 0.0], [1.0, 0.2, 0.0]], [2.5, 2.5], 'mm')
    """
    check_kinds("write_markers", path=(path, PATH), markers=(markers, MarkerSet))
    length_unit = length_unit or markers.length_unit
    if Path(path).suffix.lower() == ".tgts":
        raise UsageError(f"write_markers: path must name a CSV file, got {path}")
    for field in ("name", "volume"):
        for text in getattr(markers, field).tolist():
            if not text or text != text.strip():
                raise UsageError(f"write_markers: {field} must not be empty or begin or end with a space: {text!r}")
    columns = {"name": markers.name, **_columns(XYZ, markers.xyz)}
    if np.isfinite(markers.normal).any():
        columns |= _columns(NORMAL, markers.normal)
    if np.isfinite(markers.radius).any():
        columns["radius"] = markers.radius
    columns |= {"volume": markers.volume, "role": markers.role}
    if np.isfinite(markers.sigma).any():
        columns |= _columns(SIGMA, markers.sigma)
    write_table(path, columns, comment=f"length unit: {length_unit}" if length_unit else "")


def _columns(names: tuple[str, ...], values: Array) -> dict[str, NDArray]:
    return {name: values[:, k] for k, name in enumerate(names)}


def _read_csv(path: Pathlike) -> MarkerSet:
    return marker_set_of(read_table(
        path, required=("name", *XYZ), known=COLUMNS, lengths=(*XYZ, "radius", *SIGMA), plain=NORMAL,
        otherwise=" (windmark convert --columns makes such a table of others)",
    ))  # fmt: skip


def marker_set_of(table: Table) -> MarkerSet:
    """The markers of a table with columns among `COLUMNS`, all roles; `FileError` names the line of a bad cell."""
    names = table.names()
    xyz = np.stack([table.numbers(column) for column in XYZ], axis=1)
    normal = table.together(*NORMAL)
    if normal is not None:
        nothing = np.isnan(normal)
        table.check(nothing.all(axis=1) | ~nothing.any(axis=1), "expected all of nx, ny, nz or none")
        table.check((normal != 0).any(axis=1), "nx, ny, nz is 0, 0, 0; expected a direction")
    radius = table.numbers("radius", optional=True) if "radius" in table else None
    if radius is not None:
        table.check(~(radius <= 0), "radius must be > 0, or empty where unknown")
    sigma = table.together(*SIGMA)
    if sigma is not None:
        table.check(~(sigma < 0).any(axis=1), "sigma_x, sigma_y, sigma_z must be >= 0, or empty where unknown")
    markers = MarkerSet.make(
        names, xyz, sigma=sigma, radius=radius, normal=normal, volume=_words(table, "volume"), role=_roles(table),
        length_unit=table.length_unit,
    )  # fmt: skip
    return _with_own_unit_normals(markers, normal)


def _words(table: Table, column: str) -> list[str]:
    return [cell or "model" for cell in table.text(column)] if column in table else ["model"] * len(table)


def _roles(table: Table) -> list[str]:
    roles = [cell.lower() for cell in _words(table, "role")]
    for row, role in enumerate(roles):
        if role not in ROLES:
            table.fail(row, f"role is {role!r}; expected one of {', '.join(ROLES)}")
    return roles


def _with_own_unit_normals(markers: MarkerSet, normal: Array | None) -> MarkerSet:
    """Keep normals that are unit vectors to rounding as they stand, so that a table survives a round trip."""
    if normal is None:
        return markers
    unit = np.abs(np.linalg.norm(normal, axis=1) - 1) < 1e-14
    return replace(markers, normal=np.where(unit[:, None], normal, markers.normal))
