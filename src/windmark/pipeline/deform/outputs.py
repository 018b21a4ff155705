"""Results of a sequence as files, written frame by frame so that memory does not grow with their number."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

import windmark
from windmark import io
from windmark.deformation import Deformation
from windmark.pipeline.deform.frames import FrameTable
from windmark.pipeline.deform.load import Loaded
from windmark.pipeline.deform.points import COLUMNS, FramePoints
from windmark.pipeline.deform.project import OutputEntry
from windmark.pipeline.deform.record import MOTION, FrameRecord
from windmark.pipeline.deform.task import DeformedFrame
from windmark.pipeline.deform.values import units
from windmark.pipeline.deform.why import words_of

Array = NDArray[np.float64]

CHUNK = 64
"""Frames that are written to the NetCDF file at once."""
STATUS = ("cold", "tracked", "lost")


def gridded(wanted: OutputEntry, frame: DeformedFrame) -> bool:
    """Whether the grid of a frame is written."""
    return bool(wanted.grid) and frame.index % wanted.every == 0


class Writer:
    """Open files of a running sequence; a context manager.

    ``deformation.csv`` has one row per frame, ``cameras.csv`` one per frame and camera, ``span.csv`` one per frame and
    station, ``markers.csv`` one per frame and marker seen, ``deformation.nc`` all of it as arrays over frames;
    ``points-NAME.csv`` has one per frame, camera and point.
    """

    def __init__(self, folder: Path, loaded: Loaded, table: FrameTable) -> None:
        self._folder, self._loaded, self._table = folder, loaded, table
        self._names = loaded.test.volumes.names
        self._rows: list[FrameRecord] = []
        self._written = 0
        self._streams: dict[str, IO[str]] = {}
        self._netcdf: Any = None

    def __enter__(self) -> Writer:
        of_laws = [p.unit for p in self._loaded.test.volumes.parameters]
        unit = self._loaded.project.length_unit
        head = ["frame", "time_s", *self._table.columns, "status", "spots", "outliers", "doubtful", "rms_px",
                "sigma0"]  # fmt: skip
        for name in (*self._names, *MOTION):
            head += [name, f"sigma_{name}"]
        self._open("deformation.csv", [*head, "few", "seconds", "reason"])
        self._open("cameras.csv", ["frame", "time_s", "camera", "lag_s", "expected", "spots", "reason"])
        if self._loaded.stations is not None:
            self._open("span.csv", [
                "frame", "eta", "bending", "sigma_bending", "twist_deg", "sigma_twist_deg", "twist_with_motion_deg",
                "sigma_twist_with_motion_deg",
            ])  # fmt: skip
        self._open("markers.csv", [
            "frame", "marker", "x", "y", "z", "dx", "dy", "dz", "sigma_dx", "sigma_dy", "sigma_dz", "outlier",
        ])  # fmt: skip
        for entry in self._loaded.project.points:
            about = f"# length unit: {unit}\n# value, sigma: grey level\n"
            self._open(f"points-{entry.label}.csv", COLUMNS, about)
        (self._folder / "units.json").write_text(
            json.dumps({"length": unit, "parameters": dict(zip(self._names, of_laws, strict=True))}, indent=2) + "\n",
            encoding="utf-8",
        )
        self._open_netcdf(of_laws, unit)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._flush()
        for stream in self._streams.values():
            stream.close()
        self._netcdf.close()

    def add(
        self, frame: DeformedFrame, row: FrameRecord, mapped: Mapping[str, Array], points: Sequence[FramePoints] = ()
    ) -> None:
        """Write one frame; ``mapped`` are values at the grid's nodes, see `Mapper.frame`; ``points`` at points."""
        at = self._table.row(row.key)
        more = [_cell(v[at]) if at is not None else "" for v in self._table.columns.values()]
        cells = [row.key, _cell(row.time_s), *more, row.status, row.spots, row.outliers, len(row.doubtful),
                 *map(_cell, (row.rms_px, row.sigma0))]  # fmt: skip
        for values, sigma in ((row.q, row.q_sigma), (row.motion, row.motion_sigma)):
            for value, size in zip(values, sigma, strict=True):
                cells += [_cell(value), _cell(size)]
        self._line("deformation.csv", [*cells, _quoted(words_of(row.cameras)), _cell(row.seconds), _quoted(row.reason)])
        for name, sight in row.cameras.items():
            self._line("cameras.csv", [
                row.key, _cell(row.time_s), _quoted(name), _cell(sight.lag_s), sight.expected, sight.found,
                _quoted(sight.reason),
            ])  # fmt: skip
        if self._loaded.stations is not None and frame.state is not None:
            columns = (row.bending, row.bending_sigma, row.twist, row.twist_sigma, row.pitch, row.pitch_sigma)
            for s, eta in enumerate(self._loaded.stations.eta):
                self._line("span.csv", [row.key, _cell(eta), *(_cell(c[s]) for c in columns)])
        if frame.state is not None:
            self._markers(frame, frame.state)
            self._grid(frame, frame.state, mapped)
        for found in points:
            self._points(frame, found)
        self._rows.append(row)
        if len(self._rows) == CHUNK:
            self._flush()

    def live(self) -> None:
        """Let other programs see what was written so far."""
        for stream in self._streams.values():
            stream.flush()

    # --- parts -----------------------------------------------------------------------------
    def _open(self, name: str, head: Sequence[str], about: str = "") -> None:
        self._streams[name] = open(self._folder / name, "w", encoding="utf-8", newline="")  # noqa: SIM115 (closed on exit)
        self._streams[name].write(about)
        self._line(name, [_quoted(h) for h in head])

    def _line(self, name: str, cells: Sequence[Any]) -> None:
        self._streams[name].write(",".join(map(str, cells)) + "\n")

    def _markers(self, frame: DeformedFrame, state: Deformation) -> None:
        """Displacement of every marker that was seen, in the tunnel, with that of its law."""
        markers, seen = self._loaded.test.markers, frame.observations
        assert seen is not None
        point = np.unique(seen.point[markers.role[seen.point] != "wall"])
        moved, cov = (column[point] for column in state.markers_displaced())
        place = markers.xyz[point] + moved
        sigma = max(1.0, np.nan_to_num(state.sigma0)) * np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
        bad = np.unique(seen.point[~state.used])
        for k, p in enumerate(point):
            numbers = (*place[k], *moved[k], *sigma[k])
            name = _quoted(str(markers.name[p]))
            self._line("markers.csv", [frame.key, name, *map(_cell, numbers), int(p in bad)])

    def _points(self, frame: DeformedFrame, found: FramePoints) -> None:
        """A camera's values at one list of points."""
        v, words = found.values, found.values.words
        for k, name in enumerate(found.of.names.tolist()):
            numbers = (*v.xyz[k], v.value[k], v.sigma[k], found.ratio[k], found.sigma_ratio[k])
            self._line(f"points-{found.of.name}.csv",
                       [frame.key, found.camera, _quoted(name), *map(_cell, numbers), words[k]])  # fmt: skip

    def _grid(self, frame: DeformedFrame, state: Deformation, mapped: Mapping[str, Array]) -> None:
        wanted = self._loaded.project.output
        if not gridded(wanted, frame):
            return
        from windmark.deformation import vertex_volumes

        mesh = self._loaded.mesh
        assert mesh is not None
        (self._folder / "grid").mkdir(exist_ok=True)
        moved = state.mesh(mesh)
        unit = self._loaded.project.length_unit
        if "plot3d" in wanted.grid:
            io.write_mesh(self._folder / "grid" / f"{frame.key}.xyz", moved, length_unit=unit)
        if "vtk" in wanted.grid:
            shift = moved.vertices - mesh.vertices
            place, cov = state.displacement(mesh.vertices, vertex_volumes(mesh), frame="model")
            fields = {
                "displacement_x": shift[:, 0], "displacement_y": shift[:, 1], "displacement_z": shift[:, 2],
                "deformation": np.linalg.norm(place, axis=1),
                "sigma_deformation": np.sqrt(np.trace(cov, axis1=1, axis2=2)),
            }  # fmt: skip
            io.write_nodes_vtk(self._folder / "grid" / f"{frame.key}.vtp", moved, {**fields, **mapped},
                               units={**dict.fromkeys(fields, unit), **units(mapped)})  # fmt: skip

    def _open_netcdf(self, of_laws: Sequence[str], unit: str) -> None:
        import h5netcdf

        project, stations = self._loaded.project, self._loaded.stations
        span = 0 if stations is None else len(stations)
        file = self._netcdf = h5netcdf.File(self._folder / "deformation.nc", "w")
        file.attrs["title"] = project.title
        file.attrs["source"] = f"windmark {windmark.__version__}"
        file.attrs["length_unit"] = unit
        file.attrs["history"] = json.dumps(project.model_dump(mode="json"))
        file.dimensions = {"frame": None, "parameter": max(len(self._names), 1), "motion_axis": 6, "text": 64,
                           "station": max(span, 1)}  # fmt: skip

        def variable(name: str, dims: tuple[str, ...], about: Mapping[str, str], kind: str = "f8") -> None:
            made = file.create_variable(name, dims, kind, fillvalue=np.nan if kind == "f8" else None)
            for key, text in about.items():
                made.attrs[key] = text

        variable("time", ("frame",), {"units": "s", "long_name": "time; the frame number where no rate is given"})
        variable("frame_number", ("frame",), {"long_name": "number of the frame; -1 where its name is none"}, "i4")
        variable("status", ("frame",), {"flag_meanings": " ".join(STATUS), "flag_values": "0 1 2"}, "i1")
        for name in self._table.columns:
            variable(name, ("frame",), {})
        for name in ("rms_px", "sigma0", "spots", "outliers", "doubtful", "seconds"):
            variable(name, ("frame",), {})
        cameras = [s.name for s in self._loaded.test.stations]
        file.dimensions["camera"] = len(cameras)
        labels = {"names": " ".join(cameras)}
        variable("camera_lag", ("frame", "camera"), {
            **labels, "units": "s", "long_name": "nearest picture later than the instant by; NaN without one",
        })  # fmt: skip
        variable("camera_expected", ("frame", "camera"), {**labels, "long_name": "markers that should be seen"})
        variable("camera_spots", ("frame", "camera"), {**labels, "long_name": "markers that were seen"})
        if self._names:
            labels = {"names": " ".join(self._names), "units": " ".join(u or "1" for u in of_laws)}
            variable("parameters", ("frame", "parameter"), {**labels, "long_name": "law parameters less the zero"})
            variable("parameters_sigma", ("frame", "parameter"), labels)
        labels = {"names": " ".join(MOTION), "units": f"{unit} {unit} {unit} deg deg deg"}
        variable("motion", ("frame", "motion_axis"), {**labels, "long_name": "rigid motion of the model less the zero"})
        variable("motion_sigma", ("frame", "motion_axis"), labels)
        if stations is not None:
            variable("eta", ("station",), {"long_name": "station"})
            file["eta"][...] = stations.eta
            for name, of in (("bending", unit), ("twist", "deg"), ("twist_with_motion", "deg")):
                variable(name, ("frame", "station"), {"units": of})
                variable(f"{name}_sigma", ("frame", "station"), {"units": of})

    def _flush(self) -> None:
        """Append the waiting rows to the NetCDF file."""
        rows, file, first = self._rows, self._netcdf, self._written
        if not rows:
            return
        end = first + len(rows)
        file.resize_dimension("frame", end)
        number = [int(r.key) if r.key.isdigit() else -1 for r in rows]
        file["time"][first:end] = [r.time_s if np.isfinite(r.time_s) else r.instant for r in rows]
        file["frame_number"][first:end] = np.array(number, np.int32)
        file["status"][first:end] = np.array([STATUS.index(r.status) for r in rows], np.int8)
        for name, values in self._table.columns.items():
            at = [self._table.row(r.key) for r in rows]
            file[name][first:end] = [np.nan if k is None else values[k] for k in at]
        for name in ("rms_px", "sigma0", "spots", "outliers", "seconds"):
            file[name][first:end] = [float(getattr(r, name)) for r in rows]
        names = [s.name for s in self._loaded.test.stations]
        for name, value in (("lag", "lag_s"), ("expected", "expected"), ("spots", "found")):
            file[f"camera_{name}"][first:end] = np.array(
                [[float(getattr(r.cameras[n], value)) if n in r.cameras else np.nan for n in names] for r in rows]
            )
        file["doubtful"][first:end] = [float(len(r.doubtful)) for r in rows]
        pairs = [("motion", "motion", "motion_sigma")]
        if self._names:
            pairs.append(("parameters", "q", "q_sigma"))
        if self._loaded.stations is not None:
            pairs += [("bending", "bending", "bending_sigma"), ("twist", "twist", "twist_sigma"),
                      ("twist_with_motion", "pitch", "pitch_sigma")]  # fmt: skip
        for name, value, sigma in pairs:
            file[name][first:end] = np.array([getattr(r, value) for r in rows])
            file[f"{name}_sigma"][first:end] = np.array([getattr(r, sigma) for r in rows])
        file.flush()
        self._written, self._rows = end, []


def _cell(value: float) -> str:
    return "" if value != value else f"{float(value):.9g}"


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\n') else text
