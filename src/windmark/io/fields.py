"""Node values on their way into a result file: checked, named with their units, never silently changed."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.scene import Mesh

LENGTH = "length"
"""The key of the coordinates' unit among the units."""

_LABEL = re.compile(r"^(?P<name>.*?)(?: \[(?P<unit>[^\[\]]*)\])?$", re.DOTALL)
_FORBIDDEN = re.compile(r'[\x00-\x1f"\[\]]')


def checked_fields(
    mesh: Mesh,
    fields: Mapping[str, ArrayLike],
    units: Mapping[str, str] | None = None,
    reserved: Collection[str] = (),
) -> dict[str, NDArray[Any]]:
    """Fields as one float32 or float64 array of V values each; NaN means that the node has no value.

    float32 stays float32; booleans and integers become float32 where that is exact, else float64.

    Parameters
    ----------
    mesh : the mesh whose V nodes the values belong to
    fields : name -> (V,) values
    units : name -> unit, for any of the fields, and "length" for the coordinates
    reserved : names the file format uses itself

    Raises
    ------
    ValueError
        For a wrong shape or type, a name that cannot be written, or a unit of no field.
    """
    for name, unit in (units or {}).items():
        if name not in fields and name != LENGTH:
            raise ValueError(f"units: {name!r} is no field; fields are {list(fields)}")
        if _FORBIDDEN.search(unit):
            raise UsageError(f"units: {unit!r} of {name!r} may not hold quotes, brackets or control characters")
    return {name: _checked(mesh, name, values, reserved) for name, values in fields.items()}


def _checked(mesh: Mesh, name: str, values: ArrayLike, reserved: Collection[str]) -> NDArray[Any]:
    if not name or name != name.strip() or _FORBIDDEN.search(name):
        raise UsageError(f"fields: the name {name!r} is empty, padded, or holds quotes, brackets or control characters")
    if name.lower() in reserved or name.lower() == LENGTH:
        raise UsageError(f"fields: the name {name!r} is used by the file format itself; choose another")
    array = np.asarray(values)
    if array.shape != (len(mesh.vertices),):
        raise ValueError(f"fields: {name!r} must have shape ({len(mesh.vertices)},), one per node, got {array.shape}")
    if array.dtype.kind in "bui":
        small = array.astype(np.float32)
        return small if np.array_equal(small.astype(float), array.astype(float)) else array.astype(np.float64)
    if array.dtype.kind != "f":
        raise ValueError(f"fields: {name!r} must be real numbers, got {array.dtype}")
    return array.astype(np.float32 if array.dtype.itemsize <= 4 else np.float64, copy=False)


def label(name: str, units: Mapping[str, str] | None) -> str:
    """``name [unit]``, or the name alone where no unit is given."""
    unit = (units or {}).get(name, "")
    return f"{name} [{unit}]" if unit else name


def axis_labels(units: Mapping[str, str] | None) -> list[str]:
    """The coordinates' names, with the unit of length if it is given."""
    unit = (units or {}).get(LENGTH, "")
    return [label(axis, {axis: unit}) for axis in "xyz"]


def written_by() -> str:
    """The program and its version, for every file."""
    return f"windmark {version('windmark')}"


def split_label(text: str) -> tuple[str, str]:
    """``name [unit]`` -> (name, unit); the unit is empty where there is none."""
    match = _LABEL.match(text.strip())
    assert match is not None  # the pattern matches any text
    return match["name"], match["unit"] or ""


def single_is_exact(values: NDArray[Any]) -> bool:
    """Whether float32 holds these values without loss, as it does for grids read from single precision."""
    with np.errstate(over="ignore"):
        return np.array_equal(values.astype(np.float32).astype(values.dtype), values, equal_nan=True)
