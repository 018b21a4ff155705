"""What stands in the tunnel at one instant: surface, markers, paint, dirt; and how it moves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.geometry.discs import tangent
from windmark.scene import MarkerSet, Mesh
from windmark.synth.decals import Decals
from windmark.synth.motion import gradient
from windmark.synth.paint import Flow, Paint

Array = NDArray[np.float64]

MODEL_VOLUMES = ("wing", "body")


@dataclass(frozen=True)
class World:
    """Everything a camera can see, in the tunnel's frame.

    Parameters
    ----------
    mesh : surface where it is now; its flat triangles are the truth
    markers : markers where they are now
    paint : luminescence and lamps (the lamps stand still)
    flow : the wind, or None for wind off
    dirt : decals beside the markers
    marker_contrast : the light falls to 1 - contrast on a marker
    rest : (V, 3) vertices before any motion: what the paint's pattern is fixed to
    tunnel_from_model : the rigid motion of the model done so far
    """

    mesh: Mesh
    markers: MarkerSet
    paint: Paint
    flow: Flow | None = None
    dirt: Decals = field(default_factory=lambda: Decals.join([]))
    marker_contrast: float = 0.85
    rest: Array | None = None
    tunnel_from_model: Pose = field(default_factory=Pose.identity)

    @property
    def rest_vertices(self) -> Array:
        """(V, 3) vertices before any motion."""
        return self.mesh.vertices if self.rest is None else self.rest

    def node_intensity(self) -> Array:
        """(V,) the noise-free, markerless intensity at the mesh's nodes: what mapped values are compared with."""
        out = np.full(len(self.mesh.vertices), np.nan)
        resting = replace(self.mesh, vertices=self.rest_vertices)
        normal, rest_normal = self.mesh.vertex_normals(), resting.vertex_normals()
        names, code = np.unique(self.mesh.volume, return_inverse=True)
        for k, name in enumerate(names):
            v = np.unique(self.mesh.triangles[code == k])
            out[v] = self.paint.intensity(
                self.mesh.vertices[v], normal[v], str(name), rest_xyz=self.rest_vertices[v], rest_normal=rest_normal[v],
                flow=self.flow,
            )  # fmt: skip
        return out

    def moved(self, tunnel_from_model: Pose, volumes: Sequence[str] = MODEL_VOLUMES) -> World:
        """The world after a further rigid motion of some volumes; the rest stands still.

        Only a motion of the whole model (all of `MODEL_VOLUMES` that the mesh has) counts in
        `tunnel_from_model`; a wall or a flap can be moved alone.
        """
        model = set(MODEL_VOLUMES) & set(np.unique(self.mesh.volume).tolist())
        whole = bool(model) and model <= set(volumes)
        return self._changed(
            volumes,
            tunnel_from_model.apply,
            lambda _, vectors: tunnel_from_model.rotate(vectors),
            lambda _, vectors: tunnel_from_model.rotate(vectors),
            tunnel_from_model @ self.tunnel_from_model if whole else self.tunnel_from_model,
        )

    def deformed(self, law: Callable[[Array], Array], volumes: Sequence[str] = ("wing",)) -> World:
        """The world after a deformation of some volumes.

        Parameters
        ----------
        law : (N, 3) -> (N, 3), given and giving points in the model's frame (rigid motion taken off)
        volumes : the volumes that deform

        Markers move with the law; a marker's centre then leaves the flat triangle it was seated on
        by no more than the law's bend over one cell. Normals follow the law's inverse transposed
        gradient, found by central differences.
        """
        pose = self.tunnel_from_model
        back = pose.inverse()

        def move(xyz: Array) -> Array:
            return pose.apply(law(back.apply(xyz)))

        def turn(xyz: Array, vectors: Array) -> Array:
            cotangent = np.linalg.solve(np.swapaxes(gradient(move, xyz), -1, -2), vectors[..., None])[..., 0]
            return cotangent / np.linalg.norm(cotangent, axis=-1, keepdims=True)

        def stretch(xyz: Array, vectors: Array) -> Array:
            along = (gradient(move, xyz) @ vectors[..., None])[..., 0]
            return along / np.linalg.norm(along, axis=-1, keepdims=True)

        return self._changed(volumes, move, turn, stretch, pose)

    def _changed(
        self,
        volumes: Sequence[str],
        move: Callable[[Array], Array],
        turn_normals: Callable[[Array, Array], Array],
        turn_tangents: Callable[[Array, Array], Array],
        pose: Pose,
    ) -> World:
        known = set(np.unique(self.mesh.volume).tolist())
        if not set(volumes) <= known:
            raise ValueError(f"World: volumes must be among {', '.join(sorted(known))}, got {', '.join(volumes)}")
        nodes = np.unique(self.mesh.triangles[np.isin(self.mesh.volume, volumes)])
        vertices = self.mesh.vertices.copy()
        vertices[nodes] = move(vertices[nodes])
        m, d = np.isin(self.markers.volume, volumes), np.isin(self.dirt.volume, volumes)
        markers, dirt = self.markers, self.dirt
        return replace(
            self,
            mesh=replace(self.mesh, vertices=vertices),
            markers=replace(
                markers,
                xyz=_put(markers.xyz, m, move(markers.xyz[m])),
                normal=_put(markers.normal, m, turn_normals(markers.xyz[m], markers.normal[m])),
                curvature=_put(markers.curvature, m, _turned(markers.take(m), turn_normals, turn_tangents)),
            ),
            dirt=replace(
                dirt,
                center=_put(dirt.center, d, move(dirt.center[d])),
                normal=_put(dirt.normal, d, turn_normals(dirt.center[d], dirt.normal[d])),
                direction=_put(dirt.direction, d, turn_tangents(dirt.center[d], dirt.direction[d])),
            ),
            rest=self.rest_vertices,
            tunnel_from_model=pose,
        )


def _turned(
    markers: MarkerSet, turn_normals: Callable[[Array, Array], Array], turn_tangents: Callable[[Array, Array], Array]
) -> Array:
    """(N, 3, 3) the markers' curvature, turned with their normals and tangents; what a law adds to it is left out."""
    first, up = tangent(markers.normal), turn_normals(markers.xyz, markers.normal)
    along = turn_tangents(markers.xyz, first)
    along -= (along * up).sum(axis=1, keepdims=True) * up
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    before = np.stack([first, np.cross(markers.normal, first), markers.normal], axis=-1)
    turn = np.stack([along, np.cross(up, along), up], axis=-1) @ np.swapaxes(before, -1, -2)
    return np.asarray(turn @ markers.curvature @ np.swapaxes(turn, -1, -2))


def _put(values: Array, where: NDArray[np.bool_], new: Array) -> Array:
    out = values.copy()
    out[where] = new
    return out
