"""Values at the nodes of VTK data sets, and what of their arrays is none."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.io.fields import label, split_label

_OURS = ("iblank", "volume", "vtkGhostType", "windmark_point", "windmark_cell")
"""Arrays that `vtk_read` takes for what they are."""


def point_values(leaves: list[Any]) -> tuple[dict[str, NDArray[np.floating]], tuple[str, ...]]:
    """Real numbers at the nodes of all data sets, one after the other.

    Returns
    -------
    columns : the array's name -> values; a vector of three is ``name_x``, ``name_y``, ``name_z``
    left_out : the arrays that are not among them, in words
    """
    found = [_arrays(leaf) for leaf in leaves]
    first = found[0] if found else {}
    names = [n for n, a in first.items() if all(n in one and one[n].ndim == a.ndim for one in found)]
    columns: dict[str, NDArray[np.floating]] = {}
    for name in names:
        values = np.concatenate([one[name] for one in found])
        columns |= {name: values} if values.ndim == 1 else _components(name, values)
    at_points = sorted({array for leaf in leaves for array in _names(leaf.GetPointData())})
    kept = set(names)
    at_cells = sorted({array for leaf in leaves for array in _names(leaf.GetCellData())})
    left = [f"the array {name!r}, not a number or vector at every node" for name in at_points if name not in kept]
    return columns, (*left, *(f"the array {name!r}, values at cells" for name in at_cells))


def _names(attributes: Any) -> list[str]:
    arrays = [attributes.GetAbstractArray(k) for k in range(attributes.GetNumberOfArrays())]
    return [a.GetName() for a in arrays if a.GetName() and a.GetName() not in _OURS]


def _arrays(leaf: Any) -> dict[str, NDArray[np.floating]]:
    """Numbers (V,) and vectors (V, 3) at the nodes of one data set."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    out: dict[str, NDArray[np.floating]] = {}
    for name in _names(leaf.GetPointData()):
        array = leaf.GetPointData().GetArray(name)  # None for text
        if array is not None and array.GetNumberOfComponents() in (1, 3):
            values = vtk_to_numpy(array)
            out[name] = values if values.dtype.kind == "f" else values.astype(np.float64)
    return out


def _components(name: str, values: NDArray[np.floating]) -> dict[str, NDArray[np.floating]]:
    """A vector as three columns; the unit stays behind the name."""
    short, unit = split_label(name)
    names = [f"{short}_{axis}" for axis in "xyz"]
    return {label(n, {n: unit}): np.ascontiguousarray(values[:, k]) for k, n in enumerate(names)}
