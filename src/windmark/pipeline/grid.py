"""The grid as a job uses it: the wanted volumes, turned outward."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark import io, resection
from windmark.geometry import Camera, Pose
from windmark.pipeline.project import GridEntry
from windmark.scene import MarkerSet, Mesh

UNDER_GRID = 2e-3
"""A marker's table place may lie so far under the grid's flat triangles (of its diagonal); that does not hide it."""
HIDDEN = resection.REASONS.index("hidden")
_CLOSED = 1e-6
"""Sum of the normals over the area below which a surface counts as closed."""


def read_grid(entry: GridEntry) -> Mesh:
    """Read a grid, keep the wanted volumes and orient it.

    Nodes stay as they are in the file, so results can be written in its order; those of other volumes
    are in no triangle any more.

    Raises
    ------
    FileError
        When the file cannot be read or has no such zone.
    """
    volume_of = {zone: name for name, zones in (entry.volumes or {}).items() for zone in zones}
    try:
        mesh = io.read_mesh(entry.file, volumes=volume_of or None, volume_face=entry.volume_face)
    except io.FileError:
        raise
    except ValueError as error:  # a zone that the file has not, a face of a grid that has no volume blocks
        raise io.FileError(entry.file, str(error)) from error
    if volume_of:
        keep = np.isin(mesh.volume, list(volume_of.values()))
        mesh = replace(mesh, triangles=mesh.triangles[keep], volume=mesh.volume[keep])
    if entry.orientation == "auto" and not is_outward(mesh):
        mesh = resection.orient_outward(mesh)
    return mesh


def is_outward(mesh: Mesh) -> bool:
    """Whether the triangles form a closed surface around a positive volume.

    The normals of a closed, consistently turned surface add up to nothing (divergence theorem), which
    costs far less to see than to follow every edge.
    """
    normals = mesh.triangle_normals()
    area = np.linalg.norm(normals, axis=1).sum()
    if not area > 0 or np.linalg.norm(normals.sum(axis=0)) > _CLOSED * area:
        return False
    # Six times the enclosed volume, from the middle of the box so that nothing large cancels.
    low, high = mesh.box
    middle = 0.5 * (low + high)
    return bool(np.sum((mesh.vertices[mesh.triangles[:, 0]] - middle) * normals) > 0)


def sight(markers: MarkerSet, mesh: Mesh) -> Callable[[Pose, Camera], NDArray[np.bool_]]:
    """What registration asks: which markers the grid does not hide."""

    def visible(cam_from_model: Pose, camera: Camera) -> NDArray[np.bool_]:
        seen = resection.see_points(
            markers.xyz, camera, cam_from_model, mesh=mesh, tolerance=UNDER_GRID * mesh.diagonal
        )
        return np.asarray(seen.reason != HIDDEN)

    return visible
