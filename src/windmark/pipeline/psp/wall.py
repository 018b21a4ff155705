"""The wall's temperature where something says it at the nodes: an infrared camera's maps, a temperature paint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from windmark import io
from windmark.errors import DataError, g2, g3
from windmark.paint import NodeField, given_temperature
from windmark.paint.stern_volmer import TEMPERATURE_OUTSIDE
from windmark.pipeline.psp.entries import POINT
from windmark.pipeline.psp.load import PspTest
from windmark.pipeline.psp.stream import FROZEN_K
from windmark.pipeline.psp.table import PointRow
from windmark.scene import Mesh
from windmark.scene.units import IN_MM
from windmark.tasks.psp import MergedRatio, as_one_cause, two_colours
from windmark.tasks.psp.channels import REFERENCE

MAP, PAINT, CHANNEL = "temperature map", "temperature paint", "temperature channel"
STEADY = "steady pressure"
NEAR = 0.1
"""Part of the grid's size within which a map's nodes lie where the grid has them: it may be that of the bent model."""
BENT, ROUNDING, FEW = 0.1, 1e-5, 0.01
"""Part of its length by which no bending changes a triangle's side; of the grid's size, what a file rounds; part of the
sides of which that is not asked."""


@dataclass(frozen=True, eq=False)
class Wall:
    """The wall's temperature at the nodes in kelvin, None where nothing says it there; and what is to be said of it."""

    temperature: NodeField | None = None
    remarks: tuple[str, ...] = ()


def wall_of(test: PspTest, row: PointRow, colours: Mapping[str, MergedRatio]) -> Wall:
    """The temperature of a point's wall by its map or its temperature paint.

    Parameters
    ----------
    colours : the ratios of other colours that the point has

    Raises
    ------
    DataError, FileError
        For a map that is not of this grid, or is in another unit; and where the point has neither map nor temperature
        paint, and nothing else says its temperature.
    """
    warm, words = test.project.temperature, []
    if "temperature" in colours:
        own = colours["temperature"]
        own = replace(own, ratio=as_one_cause(own.ratio, CHANNEL))
        # It moves in the same light as the other colours.
        return _by_paint(test, row, two_colours(own, colours["reference"]) if "reference" in colours else own)
    if warm.maps is not None:
        path = test.project.path.parent / warm.maps.replace(POINT, row.name)
        if path.is_file():
            return Wall(read_map(path, test, warm.maps_sigma_K))
        words.append(f"no file {warm.maps.replace(POINT, row.name)!r} beside the project")
    if warm.paint is not None:
        words.append("the table of points names no pictures of its temperature paint")
    if words and warm.recovery is None and warm.readings is None:
        raise DataError(f"the temperature is missing: {' and '.join(words)}")
    return Wall(None, tuple(f"the temperature is that of thermocouples or recovery: {why}" for why in words))


def steady_of(test: PspTest, row: PointRow) -> tuple[NodeField | None, tuple[str, ...]]:
    """The steady pressure about which a gain holds, None without one; and what is to be said of it."""
    how = test.project.paint
    if how.steady is None:
        return None, ()
    path = test.project.path.parent / how.steady.replace(POINT, row.name)
    if not path.is_file():
        raise DataError(f"the steady pressure is missing: no file {how.steady.replace(POINT, row.name)!r} beside the "
                        "project")  # fmt: skip
    found = read_map(path, test, how.steady_sigma_Pa, ("pressure", "Pa", STEADY))
    exact = found.known.any() and not found.sigma[found.known].any()
    return found, ("the steady pressure is taken as exact: neither its file nor paint.steady_sigma_Pa says a sigma",
                   ) if exact else ()  # fmt: skip


def read_map(
    path: Path, test: PspTest, common_sigma: float, of: tuple[str, str, str] = ("temperature", "K", MAP)
) -> NodeField:
    """What a NetCDF file says at the grid's nodes, and its ``sigma_NAME`` where given.

    Parameters
    ----------
    common_sigma : that all nodes share
    of : name of the field, its unit, and the cause of that error
    """
    name, unit, cause = of
    mesh, fields, units, _ = io.read_nodes_netcdf(path)
    if name not in fields:
        raise io.FileError(path, f"has {', '.join(fields) or 'no field'}; expected one at the nodes", name)
    if (why := _other_nodes(mesh, test.mesh)):
        raise io.FileError(path, f"{why}; expected the nodes of the project's grid in the same order", name)
    if units.get(name) != unit:
        raise io.FileError(path, f"is in {units.get(name) or 'no unit'}; expected {unit}", name)
    value = np.asarray(fields[name], dtype=float)
    sigma = np.asarray(fields.get(f"sigma_{name}", np.zeros(len(value))), dtype=float)
    on = np.isfinite(value)
    least = FROZEN_K if unit == "K" else 0.0
    low, lost = int((value[on] <= least).sum()), int((~(sigma[on] >= 0)).sum())
    if low:
        words = f"{low} of its {len(value)} nodes are not above {least:g} {unit}; expected NaN where it is not known"
        raise io.FileError(path, words, name)
    if lost:
        words = f"{lost} nodes with a {name} have no sigma; expected one for each, or no field sigma_{name} at all"
        raise io.FileError(path, words, f"sigma_{name}")
    sigma = np.where(on, sigma, 0.0)
    return given_temperature(value, sigma, common_sigma=common_sigma, unit=unit, cause=cause)


def _other_nodes(a: Mesh, b: Mesh) -> str:
    """Why a grid has not the nodes of the project's (b) in the same order, in words, or "". It may be moved and bent:
    its nodes lie near, and the triangles' sides are as long.
    """
    if len(a.vertices) != len(b.vertices):
        return f"it has {len(a.vertices)} nodes, the project's grid {len(b.vertices)}"
    factor = IN_MM[a.length_unit] / IN_MM[b.length_unit] if a.length_unit and b.length_unit else 1.0
    xyz = factor * a.vertices
    far = np.linalg.norm(xyz - b.vertices, axis=1)
    if not (far < NEAR * b.diagonal).all():
        unit = f" {b.length_unit}".rstrip()
        return f"its nodes lie up to {g3(float(far.max()))}{unit} from those of the project's grid"
    t, following = b.triangles, np.roll(b.triangles, -1, axis=1)
    own, theirs = (np.linalg.norm(v[t] - v[following], axis=2) for v in (b.vertices, xyz))
    other = np.abs(theirs - own) > BENT * own + ROUNDING * b.diagonal
    if not other.mean() > FEW:
        return ""
    part = g2(100 * float(other.mean()))
    return f"{part} % of the sides of the grid's triangles are of another length between its nodes"


def _by_paint(test: PspTest, row: PointRow, by_paint: MergedRatio) -> Wall:
    law = test.temperature_paint
    if law is None:
        raise DataError("the table of points names pictures of a temperature paint; temperature.paint of the project, "
                        "its calibration, is missing")  # fmt: skip
    if not law.t_range[0] <= row.t_off <= law.t_range[1]:
        raise DataError(f"T_off is {row.t_off:g} K, outside the temperature paint's calibration ({law.t_range[0]:g} to "
                        f"{law.t_range[1]:g} K): its unit is another one, or the cell is wrong (line {row.line} of the "
                        "table of points)")  # fmt: skip
    found, flags = law.temperature_map(by_paint.ratio, t_off=row.t_off, cause=PAINT)
    beyond = float(np.mean((flags[found.known] & TEMPERATURE_OUTSIDE) > 0)) if found.known.any() else 0.0
    words = [f"{g2(100 * beyond)} % of the nodes lie outside the temperature paint's calibration"] if beyond > 0 else []
    words += [f"{name} does not count: {why}" for name, why in by_paint.left_out.items()]
    return Wall(as_one_cause(found, PAINT, 4, keep=REFERENCE), tuple(words))
