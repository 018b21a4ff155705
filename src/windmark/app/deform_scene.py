"""A deforming model in 3D: the grid frame by frame, coloured by its displacement, with sigma."""

from __future__ import annotations

from collections.abc import Sequence as Several

import numpy as np
from numpy.typing import NDArray

from windmark.app.deform_film import since
from windmark.app.scene3d import STATION_COLOURS, Frames, Scene3D, Station
from windmark.app.standing_scene import own_markers, shown_markers, spread
from windmark.deformation import Deformation
from windmark.deformation.result import vertex_volumes
from windmark.pipeline.deform import FrameRecord, Loaded, Sequence
from windmark.tasks.deform.zero import Zero, displaced_since

Array = NDArray[np.float64]

CHUNK = 20_000
"""Nodes whose covariances are worked out at a time."""


def deform_scene(loaded: Loaded, sequence: Sequence, magnify: float) -> Scene3D | None:
    """The frames that the film keeps, or some of them; None without a grid or a frame."""
    mesh = loaded.mesh
    if mesh is None or not sequence.film:
        return None
    kept = _some(sequence.film, len(mesh.vertices))
    moved, sigma = zip(*(_moved(mesh.vertices, mesh.used, vertex_volumes(mesh), state, sequence.zero)
                         for _, state in kept), strict=True)  # fmt: skip
    unit = loaded.project.length_unit
    markers = loaded.test.markers
    shown = shown_markers(markers, markers.xyz, unit)
    markers = markers.take(own_markers(markers))
    every = np.arange(len(markers))
    carried = [_moved(markers.xyz, every, markers.volume, state, sequence.zero)[0] for _, state in kept]
    frames = Frames(tuple(_label(row) for row, _ in kept), np.stack(moved), np.stack(sigma), magnify,
                    f"displacement by the laws {since(sequence)}, {unit}", np.stack(carried))  # fmt: skip
    first = kept[0][1]
    stations = [
        Station(s.name, s.camera, s.cam_from_tunnel @ first.tunnel_from_model,
                STATION_COLOURS[k % len(STATION_COLOURS)]) for k, s in enumerate(loaded.test.stations)
    ]  # fmt: skip
    poses = [s.cam_from_model for s in stations]
    up = -poses[0].rotation[1]
    ahead = np.mean([p.rotation[2] for p in poses], axis=0)
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-12) + 0.9 * up
    focus = mesh.vertices[mesh.used]
    return Scene3D(unit, ahead, up, mesh, (), stations, shown, frames=frames, focus=focus)


def _some(film: Several[tuple[FrameRecord, Deformation]], nodes: int) -> list[tuple[FrameRecord, Deformation]]:
    return [film[k] for k in spread(len(film), nodes, len(film))]


def _label(row: FrameRecord) -> str:
    time = f", {row.time_s:.4g} s" if np.isfinite(row.time_s) else ""
    return f"frame {row.key}{time}"


def _moved(
    vertices: Array, used: NDArray[np.intp], volume: NDArray[np.str_], state: Deformation, zero: Zero | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(V, 3) displacement of the nodes by the laws since the zero, and (V,) the sigma of its length."""
    moved = np.zeros((len(vertices), 3), dtype=np.float32)
    sigma = np.full(len(vertices), np.nan, dtype=np.float32)
    for start in range(0, len(used), CHUNK):
        at = used[start : start + CHUNK]
        change, cov = displaced_since(zero, state, state.volumes.bind(vertices[at], volume[at]), frame="model")
        size = np.linalg.norm(change, axis=1, keepdims=True)
        along = np.divide(change, size, out=np.zeros_like(change), where=size > 0)
        variance = np.einsum("ni,nij,nj->n", along, cov, along)
        # Without a displacement there is no direction: the mean of all.
        variance = np.where(size[:, 0] > 0, variance, np.trace(cov, axis1=1, axis2=2) / 3)
        moved[at], sigma[at] = change, np.sqrt(np.maximum(variance, 0.0))
    return moved, sigma
