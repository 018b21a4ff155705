"""A sequence as arrays over frames: NetCDF-4, made in memory from the frames' numbers, so that no disk can break it."""

from __future__ import annotations

import io as streams
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import windmark
from windmark.pipeline.deform.frames import FrameTable
from windmark.pipeline.deform.load import Loaded
from windmark.pipeline.deform.names import number_of, stamp_ns
from windmark.pipeline.deform.record import MISFIT, FrameRecord
from windmark.pipeline.private_paths import without_folders
from windmark.tasks.deform.zero import MOTION

Array = NDArray[np.float64]

NOT_TRIED = ("late", "left")
"""Frames that were seen and not looked at: they came after a later one was measured, or the run ended first."""
STATUS = ("cold", "tracked", "lost", *NOT_TRIED, MISFIT)
NO_STAMP = -(2**63)


def series_content(loaded: Loaded, table: FrameTable, rows: Sequence[FrameRecord]) -> bytes:
    """The NetCDF-4 file of a sequence; the same rows give the same bytes."""
    import h5netcdf

    stream = streams.BytesIO()
    with h5netcdf.File(stream, "w") as file:
        _attributes(file, loaded, len(rows))
        for name, dims, values, about in _variables(loaded, table, rows):
            values = np.asarray(values)
            fill = NO_STAMP if name == "time_stamp" else np.nan if values.dtype.kind == "f" else None
            made = file.create_variable(name, dims, values.dtype, fillvalue=fill)
            made[...] = values
            for key, text in about.items():
                made.attrs[key] = text
    return stream.getvalue()


def _attributes(file: Any, loaded: Loaded, frames: int) -> None:
    project, stations, names = loaded.project, loaded.stations, loaded.test.volumes.names
    file.attrs["title"] = project.title
    file.attrs["source"] = f"windmark {windmark.__version__}"
    file.attrs["length_unit"] = project.length_unit
    options = without_folders(project.model_dump(exclude={"path"}), project.path.resolve().parent)
    file.attrs["history"] = json.dumps(options, default=str)
    # Without a limit only where there is no frame: the size of such a dimension is asked of every variable each
    # time that one is added, which took a tenth of a short run.
    file.dimensions = {
        "frame": frames or None, "parameter": max(len(names), 1), "motion_axis": 6, "text": 64,
        "station": max(0 if stations is None else len(stations), 1), "camera": len(loaded.test.stations),
    }  # fmt: skip


Variable = tuple[str, tuple[str, ...], Any, Mapping[str, str]]


def _variables(loaded: Loaded, table: FrameTable, rows: Sequence[FrameRecord]) -> list[Variable]:
    """Name, dimensions, values and attributes of everything."""
    number = np.array([number_of(r.key, r.index) for r in rows], np.int64)
    stamps = [stamp_ns(r.key) for r in rows]
    out: list[Variable] = [
        ("time", ("frame",), _floats([r.time_s if np.isfinite(r.time_s) else r.instant for r in rows]),
         {"units": "s", "long_name": "time; the frame number where no rate is given"}),
        ("frame_number", ("frame",), number, {"long_name": "number of the frame; -1 where its name is none"}),
        ("status", ("frame",), np.array([STATUS.index(r.status) for r in rows], np.int8),
         {"flag_meanings": " ".join(STATUS), "flag_values": " ".join(map(str, range(len(STATUS))))}),
    ]  # fmt: skip
    if any(ns is not None for ns in stamps):
        out.append(("time_stamp", ("frame",), np.array([NO_STAMP if ns is None else ns for ns in stamps], np.int64), {
            "units": "nanoseconds since 1970-01-01", "calendar": "proleptic_gregorian",
            "long_name": "time stamp in the pictures' names, as it stands there",
        }))  # fmt: skip
    for name, column in table.columns.items():
        at = [table.row(r.key) for r in rows]
        out.append((name, ("frame",), _floats([np.nan if k is None else column[k] for k in at]), {}))
    for name in ("rms_px", "sigma0", "spots", "outliers", "seconds"):
        out.append((name, ("frame",), _floats([getattr(r, name) for r in rows]), {}))
    out.append(("doubtful", ("frame",), _floats([len(r.doubtful) for r in rows]), {}))
    return [*out, *_of_cameras(loaded, rows), *_of_the_model(loaded, rows)]


def _of_cameras(loaded: Loaded, rows: Sequence[FrameRecord]) -> list[Variable]:
    names = [s.name for s in loaded.test.stations]
    about: dict[str, dict[str, str]] = {
        "lag_s": {"units": "s", "long_name": "nearest picture later than the instant by; NaN without one"},
        "expected": {"long_name": "markers that should be seen"},
        "found": {"long_name": "markers that were seen"},
        "blur_px": {"units": "px", "long_name": "blur of the markers' rims, 1 sigma; NaN where none was seen"},
    }
    return [
        (f"camera_{name}", ("frame", "camera"),
         _floats([[getattr(r.cameras[n], of) if n in r.cameras else np.nan for n in names] for r in rows], len(names)),
         {"names": " ".join(names), **about[of]})
        for name, of in (("lag", "lag_s"), ("expected", "expected"), ("spots", "found"), ("blur", "blur_px"))
    ]  # fmt: skip


def _of_the_model(loaded: Loaded, rows: Sequence[FrameRecord]) -> list[Variable]:
    unit, volumes, stations = loaded.project.length_unit, loaded.test.volumes, loaded.stations
    out: list[Variable] = []

    def pair(name: str, axis: str, of: str, size: int, about: Mapping[str, str], words: str = "") -> None:
        value, sigma, said = of, f"{of}_sigma", {"long_name": words} if words else {}
        out.append((name, ("frame", axis), _floats([getattr(r, value) for r in rows], size), {**about, **said}))
        out.append((f"{name}_sigma", ("frame", axis), _floats([getattr(r, sigma) for r in rows], size), about))

    if volumes.names:
        labels = {"names": " ".join(volumes.names), "units": " ".join(p.unit or "1" for p in volumes.parameters)}
        pair("parameters", "parameter", "q", len(volumes.names), labels, "law parameters less the zero")
    labels = {"names": " ".join(MOTION), "units": f"{unit} {unit} {unit} deg deg deg"}
    pair("motion", "motion_axis", "motion", 6, labels, "rigid motion of the model less the zero")
    if stations is not None:
        out.append(("eta", ("station",), np.asarray(stations.eta, dtype=float), {"long_name": "station"}))
        for name, of, words in (("bending", "bending", unit), ("twist", "twist", "deg"),
                                ("twist_with_motion", "pitch", "deg")):  # fmt: skip
            pair(name, "station", of, len(stations), {"units": words})
    return out


def _floats(values: Any, columns: int | None = None) -> Array:
    """(F,) or (F, columns), also of no frame."""
    return np.asarray(values, dtype=float).reshape((-1,) if columns is None else (-1, columns))
