"""Pictures mapped onto the deformed grid: grey levels at its nodes, and their ratio to the wind-off ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.deformation import Deformation, bound_vertices, identify
from windmark.geometry import Camera, Pose
from windmark.pipeline.deform.entries import ValuesEntry
from windmark.pipeline.deform.pictures import read_light
from windmark.resection import inside_px, node_values, see_nodes
from windmark.scene import MarkerSet, Mesh, View
from windmark.tasks.deform.task import DeformationTest, DeformedFrame, FrameImages, Image

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

@dataclass(frozen=True)
class Compared:
    """One frame by one camera, mapped in two ways (AIAA 2005-5007, Fig. 10).

    Parameters
    ----------
    key, camera : which
    rigid, deformed : (V,) ratio wind-off / frame with the grid moved as a whole to where it fits all markers of this
        camera best, and with the grid deformed; NaN where not seen
    off_px : (V,) how far apart both put a node in the image
    """

    key: str
    camera: str
    rigid: Array
    deformed: Array
    off_px: Array


def surface_values(light: Image, mesh: Mesh, camera: Camera, cam_from_mesh: Pose, how: ValuesEntry) -> Array:
    """Grey levels at the nodes of a grid.

    Parameters
    ----------
    light : (H, W), of the camera's size, see `light_of`
    mesh : where it is when the image is taken
    how : ``black`` is taken off; ``max_obliquity_deg``, ``edge_px`` and ``interpolation`` as the project file has them

    Returns
    -------
    (V,) NaN where the camera does not see a node, where its pixels say nothing, or less than ``edge_px`` inside the
    outline of its surface
    """
    view = see_nodes(mesh, camera, cam_from_mesh, max_obliquity_deg=how.max_obliquity_deg)
    values = np.asarray(node_values(light, view, interpolation=how.interpolation), dtype=float) - how.black
    if how.edge_px > 0:
        inside = inside_px(mesh, camera, cam_from_mesh)
        seen = np.flatnonzero(view.visible)
        column, row = np.rint(view.xy[seen]).astype(int).T
        height, width = inside.shape
        near = inside[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)] <= how.edge_px
        values[seen[near]] = np.nan
    return values


class Mapper:
    """Maps the wanted cameras' pictures of every frame, and their ratio to the wind-off pictures.

    Parameters
    ----------
    test : cameras and markers
    mesh : at rest
    how : what is wanted
    """

    def __init__(self, test: DeformationTest, mesh: Mesh, how: ValuesEntry) -> None:
        self._test, self._mesh, self._how = test, mesh, how
        self._placed = bound_vertices(test.volumes, mesh)
        self._bare = away_from(test.markers, mesh, how.clear)
        self._off: dict[str, Array] = {}
        self.compared: Compared | None = None
        """The frame with the largest deformation so far; None without wind-off pictures."""
        self._most = 0.0

    def reference(self, frames: list[tuple[DeformedFrame, FrameImages]]) -> None:
        """Take the mean of wind-off frames as what later ones are compared with."""
        for name in self._how.cameras:
            seen = [self._mapped(frame, images, name) for frame, images in frames]
            known = [v for v in seen if v is not None]
            if known:
                self._off[name] = np.mean(known, axis=0)

    def frame(self, frame: DeformedFrame, images: FrameImages) -> dict[str, Array]:
        """Name -> (V,): grey level per camera and, with wind-off pictures, the ratio wind-off / frame."""
        out: dict[str, Array] = {}
        for name in self._how.cameras:
            values = self._mapped(frame, images, name)
            if values is None:
                continue
            out[f"grey_{name}"] = values
            if name in self._off:
                out[f"ratio_{name}"] = ratio = _divided(self._off[name], values)
                self._compare(frame, images, name, ratio)
        return out

    def _mapped(self, frame: DeformedFrame, images: FrameImages, name: str) -> Array | None:
        if frame.state is None or name not in frame.views or name in images.shots:
            return None  # a picture of another instant shows the model where it is not
        moved = frame.state.mesh(self._mesh, placed=self._placed)
        return self._values(images, name, moved, *self._seen_by(frame.state, name))

    def _seen_by(self, state: Deformation, name: str) -> tuple[Camera, Pose]:
        station = self._test.station(name)
        return state.cameras.get(name, station.camera), state.cam_from_tunnel.get(name, station.cam_from_tunnel)

    def _values(self, images: FrameImages, name: str, mesh: Mesh, camera: Camera, pose: Pose) -> Array:
        light = read_light(images.images[name], self._test.station(name))[1]
        return np.where(self._bare, surface_values(light, mesh, camera, pose, self._how), np.nan)

    def _compare(self, frame: DeformedFrame, images: FrameImages, name: str, ratio: Array) -> None:
        """Keep this frame if it is the most deformed so far."""
        state = frame.state
        assert state is not None
        moved = state.mesh(self._mesh, placed=self._placed).vertices
        rest = state.tunnel_from_model.apply(self._mesh.vertices)
        size = float(np.linalg.norm((moved - rest)[self._mesh.used], axis=1).max())
        whole = as_a_whole(frame, self._test, name) if size > self._most else None
        if whole is None:
            return
        self._most = size
        camera, pose = self._seen_by(state, name)
        rigid = _divided(self._off[name], self._values(images, name, self._mesh, camera, pose @ whole))
        off = camera.project((pose @ whole).apply(self._mesh.vertices))[0] - camera.project(pose.apply(moved))[0]
        self.compared = Compared(frame.key, name, rigid, ratio, np.linalg.norm(off, axis=1))


def as_a_whole(frame: DeformedFrame, test: DeformationTest, name: str) -> Pose | None:
    """tunnel_from_model that fits the model's markers best in one camera, with no law; None where that fails."""
    seen, state = frame.observations, frame.state
    assert seen is not None
    assert state is not None
    own = (seen.view == frame.views.index(name)) & (test.markers.role[seen.point] != "wall") & state.used
    station = test.station(name)
    pose = state.cam_from_tunnel.get(name, station.cam_from_tunnel)
    part = replace(seen, view=np.zeros(int(own.sum()), np.int64), point=seen.point[own], xy=seen.xy[own],
                   cov=seen.cov[own])  # fmt: skip
    camera = state.cameras.get(name, station.camera)
    answer = identify(part, test.markers, [], {name: camera}, [View(name, name, "", pose)], reject=False)
    return answer.tunnel_from_model if isinstance(answer, Deformation) else None


def away_from(markers: MarkerSet, mesh: Mesh, radii: float) -> Mask:
    """(V,) nodes that are not within so many radii of a marker's centre; markers of unknown radius hide nothing."""
    out = np.ones(len(mesh.vertices), bool)
    own = np.flatnonzero((markers.role != "wall") & (markers.radius > 0))
    if radii > 0 and len(own):
        near = cKDTree(mesh.vertices).query_ball_point(markers.xyz[own], radii * markers.radius[own])
        out[np.concatenate([np.asarray(n, np.int64) for n in near])] = False
    return out


def _divided(off: Array, on: Array) -> Array:
    return np.divide(off, on, out=np.full(len(on), np.nan), where=on > 0)


def units(fields: Mapping[str, Array]) -> dict[str, str]:
    """Units of what `Mapper.frame` gives."""
    return {name: "grey level" if name.startswith("grey_") else "1" for name in fields}
