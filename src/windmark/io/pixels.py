"""What each pixel of a picture shows, as NetCDF-4: its place on the model and its value."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.io.fields import written_by
from windmark.io.netcdf_write import Variable, write_variables
from windmark.io.text import to_json

_CONVENTIONS = (
    "row and column from 0, (0, 0) the centre of the top-left pixel; x, y, z of the surface point behind the pixel's "
    "centre in the model's frame, in length_unit; volume indexes volume_names; NaN and -1 where the pixel shows none"
)


def write_pixels(
    path: str | os.PathLike[str],
    value: ArrayLike,
    xyz: ArrayLike,
    volume: ArrayLike,
    fields: Mapping[str, ArrayLike] | None = None,
    *,
    length_unit: str,
    name: str = "value",
    units: Mapping[str, str] | None = None,
    history: Mapping[str, Any] | None = None,
) -> None:
    """Write a picture with the surface point behind every pixel (opens with ``xarray.open_dataset``).

    Parameters
    ----------
    path : the file, usually ``.nc``
    value : (H, W) the picture; variable ``name``
    xyz : (H, W, 3) surface points, NaN where the pixel shows none; variables ``x``, ``y``, ``z``
    volume : (H, W) str, the volume that each pixel shows, "" for none; variable ``volume``
    fields : further (H, W) values by name
    length_unit : of xyz
    name : of the picture's variable, such as ``temperature_K``
    units : name -> unit of the picture's variable and of the fields
    history : how it was made (options, inputs); written as JSON

    Raises
    ------
    ValueError
        For arrays that are not of one picture.
    FileError
        Where the file cannot be written; then nothing is.
    """
    picture, places, parts = np.asarray(value), np.asarray(xyz, dtype=float), np.asarray(volume)
    if picture.ndim != 2 or places.shape != (*picture.shape, 3) or parts.shape != picture.shape:
        raise ValueError(
            f"write_pixels: value, xyz and volume must be (H, W), (H, W, 3) and (H, W), got {picture.shape}, "
            f"{places.shape} and {parts.shape}"
        )
    arrays: dict[str, NDArray[Any]] = {name: picture, **dict(zip("xyz", np.moveaxis(places, 2, 0), strict=True))}
    for key, more in (fields or {}).items():
        if np.shape(more) != picture.shape:
            raise ValueError(f"write_pixels: field {key} must be {picture.shape}, got {np.shape(more)}")
        arrays[key] = np.asarray(more)
    unit = {**dict.fromkeys("xyz", length_unit), **(units or {})}
    names = sorted(set(parts[parts != ""].tolist()))
    number = np.full(picture.shape, -1, np.int16)
    for k, part in enumerate(names):
        number[parts == part] = k
    variables: dict[str, Variable] = {n: (("row", "column"), v, {"units": unit.get(n, "")}) for n, v in arrays.items()}
    variables["volume"] = (("row", "column"), number, {})
    variables["volume_names"] = (("volume_name",), np.array(names, dtype=object), {})
    attributes = {
        "title": "surface point and value of every pixel", "source": written_by(), "conventions": _CONVENTIONS,
        "length_unit": length_unit, "history": to_json(history or {}),
    }  # fmt: skip
    write_variables(path, variables, attributes)
