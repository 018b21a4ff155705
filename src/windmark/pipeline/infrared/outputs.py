"""Results of an infrared run as files: fields of the frames on the moving grid, tables, histories at points."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.paint import NodeField, interpolated
from windmark.pipeline.infrared.flux import FrameFields
from windmark.pipeline.infrared.load import InfraredRun
from windmark.pipeline.infrared.record import REDUCED, FrameRecord
from windmark.pipeline.points import PointSet, without_value
from windmark.scene import Mesh
from windmark.tasks.infrared import FLAGS, flag_words

Array = NDArray[np.float64]

FRAMES = "frames"
"""Folder of the fields."""


def node_fields(fields: FrameFields) -> tuple[dict[str, NDArray], dict[str, str]]:
    """Name -> (V,) values and units: everything with its sigma; single precision, far below any sigma."""
    out: dict[str, NDArray] = {}
    units: dict[str, str] = {}
    for name, field, unit in (("temperature", fields.temperature, "K"), ("heat_flux", fields.flux, "W/m2")):
        if field is not None:
            out[name] = np.where(field.known, field.value, np.nan).astype(np.float32)
            out[f"sigma_{name}"] = np.where(field.known, field.sigma, np.nan).astype(np.float32)
            units |= {name: unit, f"sigma_{name}": unit}
    out["flags"], out["camera"] = fields.flags.astype(np.int32), fields.source.astype(np.int32)
    return out, units


def write_frame(folder: Path, run: InfraredRun, record: FrameRecord, mesh: Mesh, fields: FrameFields) -> None:
    """Write the fields of a frame; ``mesh`` where the model was, in the tunnel's axes."""
    place, wanted = folder / FRAMES, run.project.output.grid
    place.mkdir(exist_ok=True)
    values, units = node_fields(fields)
    units["length"] = run.project.length_unit
    history = {
        "frame": record.key, "time_s": _number(record.time_s), "flags": {str(b): w for b, w in FLAGS.items()},
        "causes": {k: [list(c) for c in v] for k, v in record.causes.items()},
    }  # fmt: skip
    io.write_nodes_netcdf(place / f"{record.key}.nc", mesh, values, units=units, history=history)
    if "vtk" in wanted:
        io.write_nodes_vtk(place / f"{record.key}.vtp", mesh, values, units=units)
    if "tecplot" in wanted:
        io.write_tecplot(place / f"{record.key}.dat", mesh, values, units=units)
    if "csv" in wanted:
        io.write_nodes_csv(place / f"{record.key}.csv", mesh, values, units=units)
    if "plot3d" in wanted and mesh.blocks:
        io.write_plot3d_function(place / f"{record.key}.f", mesh, values, units=units)


def write_tables(folder: Path, run: InfraredRun, records: Sequence[FrameRecord]) -> None:
    """``frames.csv`` over all frames, and the collection that shows their fields in ParaView at their times."""
    io.write_table(folder / "frames.csv", {
        "frame": np.array([r.key for r in records], dtype=np.str_),
        "time_s": np.array([r.time_s for r in records]),
        "status": np.array([r.status for r in records], dtype=np.str_),
        "rms_px": np.array([r.rms_px for r in records]),
        "seen": np.array([r.seen for r in records]),
        "cameras": np.array([" ".join(r.cameras) for r in records], dtype=np.str_),
        "median_temperature_K": np.array([r.median_T for r in records]),
        "median_sigma_temperature_K": np.array([r.median_sigma_T for r in records]),
        "median_heat_flux_W_m2": np.array([r.median_q for r in records]),
        "median_sigma_heat_flux_W_m2": np.array([r.median_sigma_q for r in records]),
        "flagged": np.array([r.flagged for r in records]),
        "reason": np.array(["; ".join(filter(None, (r.reason, *r.remarks))) for r in records], dtype=np.str_),
    })  # fmt: skip
    if "vtk" not in run.project.output.grid:
        return
    files = {f"{FRAMES}/{r.key}.vtp": r.time_s for r in records}
    io.write_collection(folder / "run.pvd", [(time, file) for file, time in files.items() if (folder / file).exists()])


class PointHistories:
    """Temperature and heat flux at the wanted points, frame by frame."""

    COLUMNS = ("temperature_K", "sigma_temperature_K", "heat_flux_W_m2", "sigma_heat_flux_W_m2")

    def __init__(self, run: InfraredRun) -> None:
        self._run = run
        self._at = {s.name: _nodes(s, run.mesh) for s in run.points}
        self.rows: dict[str, list[tuple[str, float, Array, list[str]]]] = {s.name: [] for s in run.points}

    def add(self, record: FrameRecord, fields: FrameFields) -> None:
        """One frame."""
        for of in self._run.points:
            nodes, weights = self._at[of.name]
            count = weights.shape[0]
            columns = [np.full(count, np.nan)] * 4
            columns[:2] = _at_points(fields.temperature, nodes, weights)
            if fields.flux is not None:
                columns[2:] = _at_points(fields.flux, nodes, weights)
            near = np.where(weights > 0, fields.flags[nodes], 0)
            words = [flag_words(int(f)) for f in np.bitwise_or.reduce(near, axis=1)]
            off = np.all(weights <= 0, axis=1).tolist()
            words = ["outside the grid" if o else w for o, w in zip(off, words, strict=True)]
            self.rows[of.name].append((record.key, record.time_s, np.stack(columns, axis=1), words))

    def valueless(self) -> list[str]:
        """What is to be said of lists that have no temperature in any frame; of those off the grid that is known."""
        every = [(of, [values[:, 0] for _, _, values, _ in self.rows[of.name]]) for of in self._run.points]
        return [without_value(of, "no frame has a temperature there") for of, seen in every
                if seen and not of.far.all() and not np.isfinite(seen).any()]  # fmt: skip

    def write(self, folder: Path) -> None:
        """``points-NAME.csv``: a row per frame and point."""
        for of in self._run.points:
            rows, names = self.rows[of.name], of.names.tolist()
            values = np.concatenate([r[2] for r in rows]) if rows else np.zeros((0, 4))
            io.write_table(folder / f"points-{of.name}.csv", {
                "frame": np.repeat(np.array([r[0] for r in rows], dtype=np.str_), len(names)),
                "time_s": np.repeat(np.array([r[1] for r in rows], dtype=float), len(names)),
                "point": np.tile(np.array(names, dtype=np.str_), len(rows)),
                **{c: values[:, k] for k, c in enumerate(self.COLUMNS)},
                "flags": np.array([w for r in rows for w in r[3]], dtype=np.str_),
            })  # fmt: skip


def _nodes(of: PointSet, mesh: Mesh) -> tuple[NDArray[np.int64], Array]:
    """Nodes (N, 3) and weights of the points; weights of 0 off the grid."""
    nodes, weights = of.surface.corners(mesh)
    return nodes.astype(np.int64), np.maximum(weights, 0.0)


def _at_points(field: NodeField, nodes: NDArray[np.int64], weights: Array) -> list[Array]:
    there = interpolated(field, nodes, weights)
    off = ~(weights > 0).any(axis=1) | ~np.isfinite(there.value)
    return [np.where(off, np.nan, there.value), np.where(off, np.nan, there.sigma)]


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def reduced(records: Sequence[FrameRecord]) -> list[FrameRecord]:
    """The frames that came to a result."""
    return [r for r in records if r.status == REDUCED]
