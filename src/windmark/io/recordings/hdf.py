"""HDF5 and NetCDF stacks: which of a file's arrays are pictures, and which is their time."""

from __future__ import annotations

import math
import re
import threading
from typing import Any

import numpy as np

from windmark.io.apart import Content, read_apart
from windmark.io.bounded import BoundedFile, check_unpacked
from windmark.io.errors import FileError, decoding
from windmark.io.recordings.base import Image, Recording, check_compressed, check_size
from windmark.io.text import Pathlike

_TIME_NAMES = ("time_s", "time", "times", "timestamp", "timestamps", "t", "frame_time", "frame_times")
_UNITS = {
    "s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "millisecond": 1e-3, "milliseconds": 1e-3,
    "us": 1e-6, "µs": 1e-6, "microsecond": 1e-6, "microseconds": 1e-6, "ns": 1e-9, "nanosecond": 1e-9,
    "nanoseconds": 1e-9, "min": 60.0, "minutes": 60.0, "h": 3600.0, "hours": 3600.0, "days": 86400.0,
}  # fmt: skip
_MOST_OBJECTS = 20_000


def check_stored(path: Pathlike, found: Any, name: str) -> None:
    """What was never written would come back as zeros; what its bytes cannot be would fill the memory."""
    stored, needed = found.id.get_storage_size(), found.dtype.itemsize * math.prod(found.shape)
    if stored == 0 and needed and not found.external and not found.is_virtual:
        raise FileError(path, "was never written: it has no bytes in the file", name)
    if found.chunks is None:
        if not found.external and not found.is_virtual and stored < needed:
            raise FileError(path, f"damaged or cut off: {stored} of {needed} bytes are there", name)
        return
    check_unpacked(path, found.dtype.itemsize * math.prod(found.chunks), stored, name)
    check_compressed(path, needed, stored)


class _Stack(Recording):
    """An array (N, H, W) or (N, H, W, C), or one picture (H, W), that can be read by parts."""

    def _take(self, array: Any, place: str) -> None:
        """Set what is known of the frames from their array."""
        shape = tuple(int(n) for n in array.shape or ())
        self._single = len(shape) == 2
        if self._single:
            shape = (1, *shape)
        if len(shape) not in (3, 4) or (len(shape) == 4 and not 1 <= shape[3] <= 4):
            raise FileError(self.path, f"is {shape}; expected (N, H, W), (N, H, W, up to 4 colours) or (H, W)", place)
        kind = np.dtype(array.dtype)
        if kind.kind not in "uif" or kind.itemsize > 8:
            raise FileError(self.path, f"holds {kind}; expected integers or floats", place)
        check_size(self.path, shape[2], shape[1], shape[0])
        self.count, self.shape, self.dtype = shape[0], shape[1:], kind.newbyteorder("=")
        self.bits = 8 * kind.itemsize
        self._array = array
        self._guard = threading.Lock()

    def read(self, number: int) -> Image:
        """One frame."""
        with self._guard:
            values = self._array[()] if self._single else self._array[number]
        return np.asarray(values).astype(self.dtype, copy=False).reshape(self.shape)

    def _clock(self, found: list[tuple[str, Any, str]]) -> None:
        """Time from the first candidate (name, array, units) that says its unit."""
        for name, array, units in found:
            values = np.asarray(array[()], dtype=np.float64)
            factor, start = time_unit(units, name)
            if factor is None or not np.isfinite(values).all():
                self.noted(f"{name} has no unit of time: frames have no time stamps")
                continue
            self.time_s, self.start = values * factor, start
            return


class HdfRecording(_Stack):
    """A dataset of an HDF5 (or NetCDF 4) file: the one that is named, or the only one that can be pictures."""

    kind = "HDF5 stack"

    def __init__(self, path: Pathlike, place: str | None, *, tried: bool = False) -> None:
        import h5py

        super().__init__(path)
        if not tried:
            read_apart("windmark.io.recordings.hdf:hdf_trial", path, place=place)
        self._file = h5py.File(path, "r")
        try:
            name = place if place is not None else _only(path, _datasets(self._file, path))
            found = self._file.get(name)
            if not isinstance(found, h5py.Dataset):
                names = [n for n, _ in _datasets(self._file, path)]
                raise FileError(path, f"there is no {name} in it; expected one of {_some(names)}")
            self._take(found, name)
            check_stored(path, found, name)
            check_unpacked(path, self.dtype.itemsize * math.prod(self.shape), found.id.get_storage_size(), name)
            self._clock(self._times(found))
        except BaseException:
            self._file.close()
            raise

    def _times(self, pictures: Any) -> list[tuple[str, Any, str]]:
        """1-D datasets of the stack's length with a name of time: its own scale, then beside it, then at the top."""
        import h5py

        places = []
        if pictures.dims and len(pictures.dims[0]):
            places.append(pictures.dims[0][0])
        for group in dict.fromkeys((pictures.parent, self._file)):
            places += [group.get(n) for n in _TIME_NAMES if isinstance(group.get(n), h5py.Dataset)]
        return [
            (str(p.name), p, _text(p.attrs.get("units", "")))
            for p in places
            if p.shape == (self.count,) and p.dtype.kind in "uif" and p.dtype.itemsize <= 8
            and (p.chunks is not None or p.id.get_storage_size() >= p.dtype.itemsize * self.count)
        ]  # fmt: skip

    def walk(self) -> None:
        """Follow the whole index of the stored parts, and decode the first frame and the last."""
        if self._array.chunks is not None:
            self._array.id.get_num_chunks()
        for number in {0, self.count - 1}:
            self.read(number)

    def close(self) -> None:
        """Give the file back."""
        self._file.close()


def hdf_trial(path: str, place: str | None) -> Content:
    """Open an HDF5 file as `HdfRecording` does, for `read_apart`: what loops or crashes does it there."""
    with decoding(path):
        recording = HdfRecording(path, place, tried=True)
        recording.walk()
        recording.close()
    return {}


def hdf_names(path: str) -> Content:
    """Names at the top of an HDF5 file, for `read_apart`."""
    import h5py

    with decoding(path), h5py.File(path, "r") as file:
        return {"names": list(file)}


class Netcdf3Recording(_Stack):
    """A variable of a classic NetCDF file (version 3)."""

    kind = "NetCDF 3 stack"

    def __init__(self, path: Pathlike, place: str | None) -> None:
        from scipy.io import netcdf_file

        super().__init__(path)
        with BoundedFile(path) as stream:  # closed, the arrays keep the map of the file as long as they live
            self._file = netcdf_file(stream, "r", mmap=True)
        variables = {f"/{n}": v for n, v in self._file.variables.items()}
        name = place if place is not None else _only(path, [(n, v) for n, v in variables.items() if _may_be(v)])
        name = f"/{name.strip('/')}"
        if name not in variables:
            raise FileError(path, f"there is no {name} in it; expected one of {_some(list(variables))}")
        pictures = variables[name]
        self._take(_Plain(pictures), name)
        first = pictures.dimensions[0] if pictures.dimensions else ""
        names = dict.fromkeys([first, *_TIME_NAMES])
        self._clock([
            (n, _Plain(variables[f"/{n}"]), _text(getattr(variables[f"/{n}"], "units", "")))
            for n in names if f"/{n}" in variables and tuple(variables[f"/{n}"].shape) == (self.count,)
        ])  # fmt: skip

    def close(self) -> None:
        """Give the file back."""
        self._file.close()


class _Plain:
    """A NetCDF 3 variable with the type that its numbers have."""

    def __init__(self, variable: Any) -> None:
        self.shape, self.dtype, self._data = variable.shape, variable.data.dtype, variable.data

    def __getitem__(self, key: Any) -> Any:
        return np.array(self._data[key])


def time_unit(units: str, name: str = "") -> tuple[float | None, str | None]:
    """Seconds of a unit of time, and the absolute zero that it names: "ms since 2026-02-01T12:00" -> 0.001, "2026-...".

    Without a unit only a name that says it (``time_s``) helps; None where nothing does.
    """
    unit, _, since = re.sub(r"\s+", " ", units.strip()).partition(" since ")
    factor = _UNITS.get(unit) or _UNITS.get(unit.lower())
    if not unit and name.rpartition("/")[2] == "time_s":
        factor = 1.0
    return factor, since.strip().replace(" ", "T", 1) or None


def _datasets(file: Any, path: Pathlike) -> list[tuple[str, Any]]:
    """Numeric datasets that may be pictures."""
    import h5py

    found: list[tuple[str, Any]] = []
    seen = 0

    def visit(name: str, thing: Any) -> None:
        nonlocal seen
        seen += 1
        if seen > _MOST_OBJECTS:
            raise FileError(path, f"holds over {_MOST_OBJECTS} objects: say which, as in {path}:/cam1/images")
        if isinstance(thing, h5py.Dataset) and _may_be(thing):
            found.append((f"/{name}", thing))

    file.visititems(visit)
    return found


def _may_be(array: Any) -> bool:
    if array.shape is None or not all(array.shape):  # HDF5 knows arrays without any extent
        return False
    shape, kind = tuple(array.shape), np.dtype(getattr(array, "dtype", None) or array.data.dtype)
    size = shape[1:3] if len(shape) in (3, 4) else shape if len(shape) == 2 else (0, 0)
    return kind.kind in "uif" and min(size) >= 2 and (len(shape) != 4 or shape[3] <= 4)


def _only(path: Pathlike, found: list[tuple[str, Any]]) -> str:
    """The one stack; with no stack, the one picture."""
    stacks = [name for name, array in found if len(array.shape) > 2] or [name for name, _ in found]
    if not stacks:
        raise FileError(path, "holds no pictures; expected an array (N, H, W) or (N, H, W, colours)")
    if len(stacks) > 1:
        raise FileError(path, f"holds {len(stacks)} arrays that may be pictures, {_some(stacks)}: say which, as in "
                              f"{path}:{stacks[0]}")  # fmt: skip
    return stacks[0]


def _some(names: list[str]) -> str:
    return ", ".join(names[:5]) + (" ..." if len(names) > 5 else "") if names else "none"


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value if isinstance(value, str) else ""
