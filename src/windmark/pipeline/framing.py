"""The virtual cameras of a job: one point of view for all its images and cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.geometry import Camera, Pose, PoV
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.project_entries import ViewEntry
from windmark.pipeline.results import FramedView
from windmark.pipeline.views import frame_view, perfect_camera, units_per_px
from windmark.scene import Mesh

Array = NDArray[np.float64]

SIZE_PX, FOV_DEG = (1200, 800), 2.0
"""Of a view by direction that says nothing else; two degrees are nearly a parallel projection."""


class HasViews(Protocol):
    """A project with points of view."""

    @property
    def path(self) -> Path:
        """The project file."""
        ...

    @property
    def view(self) -> tuple[ViewEntry, ...]:
        """What is wanted."""
        ...

    @property
    def lengths(self) -> Lengths:
        """What reads its files."""
        ...


def frame_views(project: HasViews, mesh: Mesh) -> tuple[FramedView, ...]:
    """The virtual cameras of a job: one per ``[[view]]``, the same for all its images and cameras.

    A view by direction is framed on the nodes of the grid that take part, whatever the images show of them, so
    that a picture of one job can be laid over that of another with the same grid, and no failed image moves the
    others.

    Raises
    ------
    FileError
        For a camera file that cannot be read, has no pose or another length unit; for a view before whose camera
        there is no surface, a volume that the grid has not. Names the view.
    """
    return tuple(_framed(project, k, entry, mesh) for k, entry in enumerate(project.view))


def _framed(project: HasViews, k: int, entry: ViewEntry, mesh: Mesh) -> FramedView:
    surface, what = _surface(project, k, entry, mesh)
    if entry.camera is not None:
        camera, pose, how = _from_file(project, k, entry)
    elif entry.pov is not None and entry.fov_deg is not None:
        camera = perfect_camera(entry.size_px or SIZE_PX, entry.fov_deg)
        pose, how = Pose.from_pov(PoV(**entry.pov.model_dump())), "from the point of view given in the project"
    else:
        assert entry.direction is not None
        assert entry.up is not None
        camera, pose = frame_view(
            surface, direction=entry.direction, up=entry.up, size_px=entry.size_px or SIZE_PX,
            fov_deg=entry.fov_deg or FOV_DEG,
        )  # fmt: skip
        along, up = ("({})".format(", ".join(f"{v:g}" for v in vector)) for vector in (entry.direction, entry.up))
        how = f"along {along}, {up} to the top, framed on {what} ({len(surface)} nodes), seen or not"
    if not (pose.apply(surface)[:, 2] > 0).any():
        raise io.FileError(project.path, "the whole surface is behind this point of view", f"view[{k}] ({entry.name})")
    return FramedView(entry.name, camera, pose, units_per_px(camera, pose, surface), how)


def _surface(project: HasViews, k: int, entry: ViewEntry, mesh: Mesh) -> tuple[Array, str]:
    """Nodes that the view is framed on, and their name in words."""
    if entry.volumes is None:
        nodes, what = mesh.used, "the grid"
    else:
        known = set(mesh.volume.tolist())
        if missing := [v for v in entry.volumes if v not in known]:
            words = f"the grid has no volume {missing[0]!r}; expected some of {', '.join(sorted(known))}"
            raise io.FileError(project.path, words, f"view[{k}].volumes")
        nodes = np.unique(mesh.triangles[np.isin(mesh.volume, entry.volumes)])
        what = f"volume {', '.join(entry.volumes)}"
    if not len(nodes):
        raise io.FileError(project.path, "the grid has no surface to be framed on", f"view[{k}] ({entry.name})")
    return mesh.vertices[nodes], what


def _from_file(project: HasViews, k: int, entry: ViewEntry) -> tuple[Camera, Pose, str]:
    """Camera and pose of a file: with its lens and size, or a perfect camera of the size and field of view given."""
    assert entry.camera is not None
    content = project.lengths.camera(entry.camera)
    if content.cam_from_model is None:
        raise io.FileError(entry.camera, f"has no pose; expected one, as the point of view of view {entry.name}")
    camera, how = content.camera, f"from {entry.camera.name}, with its lens"
    if entry.size_px is not None or entry.fov_deg is not None:
        camera = perfect_camera(entry.size_px or camera.size_px, entry.fov_deg or camera.fov_deg)
        how = f"from {entry.camera.name}, with a perfect lens"
    if content.note:
        how = f"{how} ({content.note})"
    return camera, content.cam_from_model, how
