"""Points at which values are wanted (taps, any list), and the values there as CSV, Tecplot and NetCDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.io.atomic import atomic_path
from windmark.io.csvtable import read_table, write_table
from windmark.io.errors import FileError
from windmark.io.fields import LENGTH, label, written_by
from windmark.io.markers import COLUMNS, NORMAL, SIGMA, XYZ, read_marker_unit, read_markers
from windmark.io.netcdf_write import Variable, write_variables
from windmark.io.numbers_text import format_rows
from windmark.io.text import Pathlike
from windmark.scene import ROLES

Array = NDArray[np.float64]
Text = NDArray[np.str_]

LABELS = ("run", "time", "note")
"""Columns of a table that say for whom or when a row is; nothing is made of them."""
FILL = -9999.0
"""What Tecplot's text has for NaN."""


@dataclass(frozen=True)
class PointList:
    """N points by name: place (N, 3), outward normal (N, 3) or NaN, volume (N,) or "", role (N,) or "".

    ``length_unit`` is what the file says, "" where it does not.
    """

    name: Text
    xyz: Array
    normal: Array
    volume: Text
    role: Text
    length_unit: str = ""

    def __len__(self) -> int:
        return len(self.name)


def read_points(path: Pathlike, *, roles: Sequence[str] | None = None, strict: bool = False) -> PointList:
    """Read a list of points.

    Parameters
    ----------
    path : ``.tgts``, or CSV with the columns ``name,x,y,z[,nx,ny,nz][,volume][,role]`` and any others, which are left
        out. Coordinates may be empty (NaN): such a point has no place
    roles : rows of these roles. None: the taps of a ``.tgts`` file (all its entries where it has none), every row of a
        CSV table
    strict : refuse a column that is none of a marker table's (`markers.COLUMNS`) nor `LABELS`: a normal that is called
        otherwise than expected would not count

    Raises
    ------
    FileError
        Names the line: an empty or double name, a cell that is no number, an unknown role, with ``strict`` an unknown
        column; or no point at all.
    """
    points = _of_tgts(path, roles) if Path(path).suffix.lower() == ".tgts" else _of_csv(path, strict)
    if roles is not None:
        keep = np.isin(points.role, list(roles))
        points = replace(points, **{f: getattr(points, f)[keep] for f in ("name", "xyz", "normal", "volume", "role")})
    if not len(points):
        raise FileError(path, "no points" + ("" if roles is None else f" of role {', '.join(roles)}"))
    return replace(points, length_unit=read_marker_unit(path, points.length_unit))


def _of_tgts(path: Pathlike, roles: Sequence[str] | None) -> PointList:
    markers = read_markers(path, roles=None)
    taps = markers.with_role("tap")
    if roles is None and len(taps):
        markers = taps
    return PointList(markers.name, markers.xyz, markers.normal, np.full(len(markers), ""), markers.role)


def _of_csv(path: Pathlike, strict: bool) -> PointList:
    columns = (*COLUMNS, *LABELS) if strict else None
    lengths = (*XYZ, "radius", *SIGMA) if strict else XYZ
    table = read_table(path, required=("name", *XYZ), known=columns, lengths=lengths, plain=NORMAL)
    names = table.names()
    normal = table.together(*NORMAL)
    if normal is None:
        normal = np.full((len(table), 3), np.nan)
    known = np.isfinite(normal)
    table.check(known.all(axis=1) | ~known.any(axis=1), "expected all of nx, ny, nz or none")
    table.check((normal != 0).any(axis=1), "nx, ny, nz is 0, 0, 0; expected a direction")
    roles = [cell.lower() for cell in table.text("role")] if "role" in table else [""] * len(table)
    for row, role in enumerate(roles):
        if role and role not in ROLES:
            table.fail(row, f"role is {role!r}; expected one of {', '.join(ROLES)}")
    return PointList(
        np.array(names, dtype=np.str_),
        np.stack([table.numbers(c, optional=True) for c in "xyz"], axis=1),
        normal,
        np.array(table.text("volume") if "volume" in table else [""] * len(table), dtype=np.str_),
        np.array(roles, dtype=np.str_),
        table.length_unit,
    )


def write_point_values(
    path: Pathlike,
    columns: Mapping[str, ArrayLike],
    *,
    units: Mapping[str, str],
    title: str = "windmark",
    about: Mapping[str, str] | None = None,
) -> None:
    """Write columns (N,) of values at points; the extension says how: ``.csv``, ``.dat`` (Tecplot) or ``.nc`` (NetCDF).

    Parameters
    ----------
    path : the file
    columns : name -> (N,); texts (names, reasons) are columns of CSV and NetCDF; in Tecplot, which has numbers only,
        they are auxiliary data of the zone, ``name_1``, ``name_2``, ...
    units : name -> unit of the columns, and "length" -> that of all coordinates, which every format's head names
    title : of the table
    about : what else holds for the table

    Raises
    ------
    ValueError
        For another extension.
    FileError
        When the file cannot be written.
    """
    arrays = {name: np.asarray(values) for name, values in columns.items()}
    head = {"length unit": units.get(LENGTH, ""), **(about or {})}
    kind = Path(path).suffix.lower()
    if kind == ".csv":
        length = units.get(LENGTH, "")
        more = {n: unit for n, unit in units.items() if n != LENGTH and n in arrays and unit != length}
        write_table(path, arrays, comment="\n".join(f"{key}: {text}" for key, text in {**head, **more}.items()))
    elif kind == ".dat":
        _write_tecplot(path, arrays, units, title, head)
    elif kind == ".nc":
        _write_netcdf(path, arrays, units, title, head)
    else:
        raise UsageError(f"write_point_values: path must end in .csv, .dat or .nc, got {path}")


def _write_tecplot(path: Pathlike, arrays: Mapping[str, NDArray[Any]], units: Mapping[str, str], title: str,
                   head: Mapping[str, str]) -> None:  # fmt: skip
    """An ordered zone, one point after the other."""
    numbers = {name: a for name, a in arrays.items() if a.dtype.kind in "biuf"}
    texts = {name: a for name, a in arrays.items() if name not in numbers}
    count = len(next(iter(arrays.values())))
    lines = [
        f"TITLE = {_quoted(title)}",
        f"VARIABLES = {' '.join(_quoted(label(n, units)) for n in numbers)}",
        f'DATASETAUXDATA NanValue = "{FILL:.9g}"',
        f"DATASETAUXDATA Program = {_quoted(written_by())}",
        *(f"DATASETAUXDATA {_key(k)} = {_quoted(v)}" for k, v in head.items() if v),
        f"ZONE T = {_quoted(title)}, I = {count}, J = 1, K = 1, ZONETYPE = ORDERED, DATAPACKING = POINT",
        *(f"AUXDATA {name}_{k} = {_quoted(str(v))}" for name, a in texts.items()
          for k, v in enumerate(a.tolist(), start=1) if v),
    ]  # fmt: skip
    columns = [np.where(np.isfinite(a), a, FILL) if a.dtype.kind == "f" else a.astype(np.int64)
               for a in numbers.values()]  # fmt: skip
    formats = ["%.9g" if a.dtype.kind == "f" else "%d" for a in columns]
    with atomic_path(path) as temporary, open(temporary, "wb") as stream:
        stream.write(("\n".join(lines) + "\n").encode())
        stream.write(format_rows(columns, formats))


def _key(text: str) -> str:
    return "".join(part.capitalize() for part in "".join(c if c.isalnum() else " " for c in text).split())


def _quoted(text: str) -> str:
    return '"' + " ".join(text.replace('"', "'").split()) + '"'


def _write_netcdf(path: Pathlike, arrays: Mapping[str, NDArray[Any]], units: Mapping[str, str], title: str,
                  head: Mapping[str, str]) -> None:  # fmt: skip
    variables: dict[str, Variable] = {
        name: (("point",), a if a.dtype.kind in "biuf" else a.astype(object), {"units": units.get(name, "")})
        for name, a in arrays.items()
    }
    attributes = {"title": title, "source": written_by(), **{k.replace(" ", "_"): v for k, v in head.items()}}
    write_variables(path, variables, attributes)
