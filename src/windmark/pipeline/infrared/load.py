"""From a project file to an infrared run: everything but the frames' pictures is read and checked first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark import io
from windmark.deformation import vertex_volumes
from windmark.errors import WindmarkError
from windmark.io.errors import noted
from windmark.paint import EmissivityTable, Wall, curvature_sum, dielectric_emissivity
from windmark.pipeline.deform.entries import CameraEntry as DeformCamera
from windmark.pipeline.deform.frames import FrameTable, instants_of, read_frame_table
from windmark.pipeline.deform.load import Loaded, load
from windmark.pipeline.deform.project import DeformProject
from windmark.pipeline.deform.timeline import Timeline
from windmark.pipeline.infrared.project import InfraredProject
from windmark.pipeline.infrared.sensors import ThermalSensor, read_sensor
from windmark.pipeline.infrared.times import frame_times
from windmark.pipeline.points import PointSet, lists_on_grid
from windmark.scene import Mesh
from windmark.scene.units import IN_MM
from windmark.tasks.infrared import SurfaceLight
from windmark.tasks.psp import Patches

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class InfraredRun:
    """An infrared run with everything that does not change from frame to frame.

    Parameters
    ----------
    project : the settings
    deforming : cameras, markers, laws and the grid, as `windmark deform` has them
    mesh : the grid at rest
    timeline : the frames with their pictures
    times : (F,) seconds of the frames; NaN where nothing says them
    table : what is known of the frames besides
    sensors : camera -> from numbers to signals
    surface : emissivity and what it reflects
    patches : markers, which are of another material
    walls, wall_of : the walls, and (V,) the number of each node's, -1 for none
    curvature : (V,) sum of the surface's curvatures, 1 / m; NaN where unknown
    points : wanted points on the grid
    remarks : what is odd but no error
    read : the files that all this was read from
    """

    project: InfraredProject
    deforming: Loaded
    mesh: Mesh
    timeline: Timeline
    times: Array
    table: FrameTable
    sensors: Mapping[str, ThermalSensor]
    surface: SurfaceLight
    patches: Patches
    walls: tuple[Wall, ...]
    wall_of: NDArray[np.int64]
    curvature: Array
    points: tuple[PointSet, ...]
    remarks: tuple[str, ...]
    read: tuple[Path, ...] = ()

    @property
    def metres(self) -> float:
        """Of a length unit."""
        return 1e-3 * IN_MM[self.project.length_unit]


def load_infrared(project: InfraredProject) -> InfraredRun:
    """Read what a project names.

    Raises
    ------
    FileError
        Naming the project's key, or the file, that is wrong.
    """
    with noted() as read:
        out = _load(project)
    return replace(out, read=tuple(sorted(map(Path, read))))


def _load(project: InfraredProject) -> InfraredRun:
    wanted = as_deform(project)
    deforming = load(wanted)
    mesh = deforming.mesh
    assert mesh is not None
    table = read_frame_table(wanted)
    timeline = instants_of(wanted)
    times, said = frame_times(project, timeline, table)
    stations = [deforming.test.station(c.name) for c in project.camera]
    sensors = {c.name: read_sensor(project, k, stations[k]) for k, c in enumerate(project.camera)}
    walls, wall_of = _walls(project, mesh)
    curvature = np.zeros(len(mesh.vertices))
    if project.heat is not None and project.heat.curvature:
        curvature = curvature_sum(mesh) / (1e-3 * IN_MM[project.length_unit])
    lengths = project.lengths
    points = lists_on_grid(project.points, lengths, mesh)
    remarks = [*deforming.remarks, *timeline.remarks, *said]
    remarks += [f"camera {c.name}: no even pictures are given: unequal pixels are not corrected, nor in any sigma"
                for c in project.camera if not c.even]  # fmt: skip
    return InfraredRun(
        project, deforming, mesh, timeline, times, table, sensors, _surface(project),
        _patches(project, deforming, mesh), walls, wall_of, curvature, points, tuple(remarks),
    )  # fmt: skip


def as_deform(project: InfraredProject) -> DeformProject:
    """The part of the project that `windmark deform` knows."""
    known = DeformCamera.model_fields
    cameras = tuple(DeformCamera(**{k: getattr(c, k) for k in known}) for c in project.camera)
    return DeformProject(
        path=project.path, title=project.title, length_unit=project.length_unit, camera=cameras,
        markers=project.markers, volume=project.volume, motion=project.motion, look=project.look, grid=project.grid,
        sequence=project.sequence,
    )  # fmt: skip


def _surface(project: InfraredProject) -> SurfaceLight:
    s = project.surface
    if s.table is not None:
        table = io.read_table(s.table, required=("angle_deg", "emissivity"), known=None)
        try:
            emissivity = EmissivityTable(table.numbers("angle_deg"), table.numbers("emissivity")).at
        except WindmarkError as error:
            raise io.FileError(s.table, str(error)) from None
    elif s.angle == "none":
        normal = float(s.emissivity or 0.0)

        def emissivity(angle_deg: ArrayLike) -> Array:
            return np.full(np.shape(angle_deg), normal)
    else:
        emissivity = partial(dielectric_emissivity, normal=float(s.emissivity or 0.0), index=s.index)
    return SurfaceLight(
        emissivity, s.emissivity_sigma, s.surroundings_K, s.surroundings_sigma_K, s.transmission,
        s.transmission_sigma, s.window_K,
    )  # fmt: skip


def _walls(project: InfraredProject, mesh: Mesh) -> tuple[tuple[Wall, ...], NDArray[np.int64]]:
    """The walls, and each node's."""
    volume = vertex_volumes(mesh)
    wall_of = np.full(len(mesh.vertices), -1, np.int64)
    known = sorted(set(volume.tolist()) - {""})
    out = []
    for k, entry in enumerate(project.wall):
        strange = [v for v in entry.volumes if v not in known]
        if strange:
            raise io.FileError(project.path, f"no part of the grid is called {strange[0]!r}; it has {', '.join(known)}",
                               f"wall[{k}].volumes")  # fmt: skip
        wall_of[np.isin(volume, entry.volumes) if entry.volumes else volume != ""] = k
        try:
            out.append(entry.wall)
        except WindmarkError as error:
            raise io.FileError(project.path, str(error), f"wall[{k}]") from None
    return tuple(out), wall_of


def _patches(project: InfraredProject, deforming: Loaded, mesh: Mesh) -> Patches:
    """The markers, which are of another material, and what a lens blurs round them."""
    markers, how = deforming.test.markers, project.sampling
    own = np.flatnonzero((markers.role != "wall") & (markers.radius > 0)) if how.clear else np.zeros(0, np.int64)
    nodes = mesh.vertices[mesh.used]
    pixel = max(float(np.median(s.cam_from_tunnel.apply(nodes)[:, 2])) / s.camera.focal_px
                for s in deforming.test.stations)  # fmt: skip
    reach = how.clear * markers.radius[own] + how.marker_edge_px * pixel
    return Patches(mesh, markers.xyz[own], reach, np.full((len(own), 3), np.nan))
