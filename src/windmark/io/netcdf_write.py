"""Arrays with their dimensions and attributes as a NetCDF-4 file, written whole."""

from __future__ import annotations

import os
from collections.abc import Mapping
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.io.atomic import atomic_path

Variable = tuple[tuple[str, ...], NDArray[Any], Mapping[str, str]]
"""Names of the dimensions, values (numbers, or text as objects), attributes."""


def write_variables(
    path: str | os.PathLike[str], variables: Mapping[str, Variable], attributes: Mapping[str, str]
) -> None:
    """Write them compressed; the file opens with ``xarray.open_dataset``.

    Through h5netcdf alone: xarray would do the same, and takes half a second of CPU to be loaded.

    Raises
    ------
    FileError
        Where the file cannot be written; then nothing is.
    """
    import h5netcdf

    content = BytesIO()  # what the disk has against it is told by Python, not by HDF5
    with h5netcdf.File(content, "w") as file:
        file.attrs.update(attributes)
        for name, (dimensions, values, said) in variables.items():
            for dimension, size in zip(dimensions, values.shape, strict=True):
                if dimension not in file.dimensions:
                    file.dimensions[dimension] = size
            _put(file, name, dimensions, values).attrs.update(said)
    with atomic_path(path) as temporary, open(temporary, "wb") as stream:
        stream.write(content.getbuffer())


def _put(file: Any, name: str, dimensions: tuple[str, ...], values: NDArray[Any]) -> Any:
    if values.dtype.kind == "b":  # NetCDF has no truth values
        values = values.astype(np.int8)
    if values.dtype.kind not in "iuf":
        import h5py

        return file.create_variable(name, dimensions, dtype=h5py.string_dtype(), data=values)
    missing = np.array(np.nan, values.dtype) if values.dtype.kind == "f" else None
    packed: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if values.size else {}
    return file.create_variable(name, dimensions, dtype=values.dtype, data=values, fillvalue=missing, **packed)
