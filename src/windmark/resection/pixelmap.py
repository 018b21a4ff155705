"""The pixel map: which point of the model's surface each pixel sees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry import Camera, Pose
from windmark.geometry.described import described
from windmark.geometry.rays import kept_rays
from windmark.resection.casting import RAYS_AT_ONCE, Hits, cast, for_kernels, single_pose, to_camera_frame
from windmark.scene import Mesh
from windmark.scene.shown import check_kinds, xarray_dataset

Array = NDArray[np.float64]


@described(lambda m: {
    "pixels": f"{m.triangle.shape[1]} x {m.triangle.shape[0]}", "on the surface": int(m.valid.sum()),
})  # fmt: skip
@dataclass(frozen=True)
class PixelMap:
    """The surface point behind every pixel of one view.

    Parameters
    ----------
    triangle : (H, W) int32, the triangle that the pixel's centre sees, -1 for none
    barycentric : (H, W, 2) weights of that triangle's second and third vertex (the first has the
        rest), NaN for none. They are weights in space, so perspective is accounted for:
        ``xyz = a + w0 (b - a) + w1 (c - a)``
    mesh, camera, cam_from_model : what the map was made of

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> above = wm.Pose.look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    >>> pixels = wm.map_pixels(plate, wm.Camera((64, 48), 60.0), above)
    >>> bool(pixels.valid[24, 32]), bool(pixels.valid[0, 0])
    (True, False)
    >>> x = pixels.interpolate(plate.vertices[:, 0])  # of a quantity on the nodes, what each pixel sees
    >>> np.allclose(x, pixels.xyz()[..., 0], equal_nan=True)
    True
    """

    triangle: NDArray[np.int32]
    barycentric: Array
    mesh: Mesh
    camera: Camera
    cam_from_model: Pose

    def __post_init__(self) -> None:
        shape = self.camera.size_px[::-1]
        if np.shape(self.triangle) != shape or np.shape(self.barycentric) != (*shape, 2):
            raise ValueError(
                f"PixelMap: triangle and barycentric must be {shape} and {(*shape, 2)} as the camera's image,"
                f" got {np.shape(self.triangle)} and {np.shape(self.barycentric)}"
            )

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(H, W): the pixel's centre sees the mesh."""
        return self.triangle >= 0

    def interpolate(self, node_values: ArrayLike) -> Array:
        """Values given at the nodes, on the pixels.

        Parameters
        ----------
        node_values : (V,) or (V, K)

        Returns
        -------
        (H, W) or (H, W, K), NaN where not valid or where a node of the triangle has NaN
        """
        values = np.asarray(node_values, dtype=float)
        if values.ndim not in (1, 2) or len(values) != len(self.mesh.vertices):
            raise ValueError(
                f"PixelMap.interpolate: node_values must be ({len(self.mesh.vertices)},) or"
                f" ({len(self.mesh.vertices)}, K) for this mesh, got {values.shape}"
            )
        flat = interpolate_at(self.mesh.triangles, values, self.triangle.ravel(), self.barycentric.reshape(-1, 2))
        return flat.reshape(*self.triangle.shape, *values.shape[1:])

    def to_xarray(self) -> Any:
        """An ``xarray.Dataset`` by row and column: surface point x, y, z, its triangle and volume."""
        at, unit = ("row", "column"), self.mesh.length_unit
        places = {name: (at, v, unit) for name, v in zip("xyz", np.moveaxis(self.xyz(), 2, 0), strict=True)}
        volume = self.triangle_values(np.asarray(self.mesh.volume)).astype(object)
        return xarray_dataset({**places, "triangle": (at, self.triangle, ""), "volume": (at, volume, "")})

    def triangle_values(self, values: ArrayLike) -> NDArray[np.generic]:
        """Values given per triangle (T, ...), on the pixels (H, W, ...): NaN, 0, False or '' where not valid."""
        v = np.asarray(values)
        if v.ndim == 0 or len(v) != len(self.mesh.triangles):
            raise ValueError(
                f"PixelMap.triangle_values: values must be ({len(self.mesh.triangles)}, ...), got {v.shape}"
            )
        nothing = np.nan if v.dtype.kind in "fc" else np.zeros((), v.dtype)
        out = np.full((*self.triangle.shape, *v.shape[1:]), nothing, dtype=v.dtype)
        out[self.valid] = v[self.triangle[self.valid]]
        return out

    def xyz(self, mesh: Mesh | None = None) -> Array:
        """Surface points in model coordinates, (H, W, 3), NaN where not valid.

        ``mesh`` may be the same grid in another shape (deformed under load): the points move with it.
        """
        vertices = self.same_grid(mesh).vertices
        flat = interpolate_at(self.mesh.triangles, vertices, self.triangle.ravel(), self.barycentric.reshape(-1, 2))
        return flat.reshape(*self.triangle.shape, 3)

    def depth(self) -> Array:
        """Z coordinate of the surface points in the camera frame, (H, W), NaN where not valid."""
        return self.interpolate(self.cam_from_model.apply(self.mesh.vertices)[:, 2])

    def obliquity_deg(self) -> Array:
        """Angle between the surface's normal and the line of sight of each pixel, (H, W), NaN where not valid.

        0 to 90 degrees: it is the side that is seen that counts.
        """
        found = self.valid
        vertices_cam = to_camera_frame(self.cam_from_model, self.mesh.vertices)
        triangle, weights = self.triangle[found], self.barycentric[found]
        points = interpolate_at(self.mesh.triangles, vertices_cam, triangle, weights)
        cosine = sight_cosines(vertices_cam, self.mesh.triangles, points, triangle)
        return np.asarray(self.to_image(np.degrees(np.arccos(np.clip(np.abs(cosine), 0, 1)))))

    def to_image(self, values: ArrayLike) -> NDArray[np.floating]:
        """Values of the valid pixels in row-major order (as ``x[pixel_map.valid]`` has them), as an image.

        (N, ...) -> (H, W, ...), NaN where not valid; floating types stay as they are, others become float64.
        """
        v = np.asarray(values)
        found = self.valid
        count = np.count_nonzero(found)
        if v.ndim == 0 or len(v) != count:
            raise ValueError(f"PixelMap.to_image: values must be ({count}, ...), one per valid pixel, got {v.shape}")
        out = np.full((*found.shape, *v.shape[1:]), np.nan, v.dtype if v.dtype.kind == "f" else np.float64)
        out[found] = v
        return out

    def same_grid(self, mesh: Mesh | None) -> Mesh:
        """``mesh`` if it is this map's grid in another shape (None: the map's own mesh)."""
        if mesh is None:
            return self.mesh
        same = mesh.vertices.shape == self.mesh.vertices.shape and (
            mesh.triangles is self.mesh.triangles or np.array_equal(mesh.triangles, self.mesh.triangles)
        )
        if not same:
            raise ValueError(
                "PixelMap: mesh must have the nodes and triangles of the mesh that was mapped"
                f" ({len(self.mesh.vertices)} and {len(self.mesh.triangles)}), in any shape;"
                f" got {len(mesh.vertices)} and {len(mesh.triangles)}"
            )
        return mesh


def map_pixels(mesh: Mesh, camera: Camera, cam_from_model: Pose, *, cull_backfaces: bool = False) -> PixelMap:
    """Relate each pixel to the point of the model's surface that its centre sees.

    The ray of each pixel centre (the lens distortion really inverted) is met with the triangles, so
    the barycentric weights are exact for the true lens and perspective; the paper's bilinear
    interpolation on the projected triangle is their limit for small triangles. Hidden surfaces are
    removed by depth alone, so the orientation of the triangles does not matter.

    Parameters
    ----------
    mesh : in model coordinates; may be open, badly oriented, or empty (then no pixel is valid)
    camera, cam_from_model : the view
    cull_backfaces : look through triangles whose normal points away from the camera (the near wall of
        a wind tunnel seen from outside)

    Returns
    -------
    PixelMap

    Raises
    ------
    ValueError
        If ``cam_from_model`` is a batch of poses.

    Examples
    --------
    >>> import windmark as wm
    >>> test = wm.synth.wind_tunnel(1, size_px=(640, 512), nodes=2000, clutter=None)
    >>> shot = test.shot("wind-off")
    >>> seen = wm.map_pixels(test.mesh, test.cameras["cam1"], shot.view.cam_from_model)
    >>> seen.xyz().shape
    (512, 640, 3)

    Notes
    -----
    Source: AIAA 2005-5007, section III.D. Pixels beyond the radius where the lens model is one to one
    are not valid.
    """
    check_kinds("map_pixels", mesh=(mesh, Mesh), camera=(camera, Camera), cam_from_model=(cam_from_model, Pose))
    pose = single_pose(cam_from_model, "map_pixels")
    width, height = camera.size_px
    vertices_cam = to_camera_frame(pose, mesh.vertices)
    hits = Hits.none(width * height)
    rows = max(1, RAYS_AT_ONCE // width)
    for first in range(0, height, rows):
        rays = kept_rays(camera, first, min(rows, height - first)).reshape(-1, 2)
        into = hits.part(slice(first * width, first * width + len(rays)))
        cast(vertices_cam, mesh.triangles, rays, cull_backfaces=cull_backfaces, into=into)
    shape = (height, width)
    return PixelMap(hits.triangle.reshape(shape), hits.weights.reshape(*shape, 2), mesh, camera, pose)


def sight_cosines(vertices_cam: Array, triangles: NDArray[np.int32], points_cam: Array, triangle: NDArray[np.int32]
                  ) -> Array:  # fmt: skip
    """Cosine of the angle at which the triangles (N,) of points (N, 3) are seen: < 0 from behind; camera frame."""
    from windmark.resection import _points

    out = np.empty(len(points_cam))
    _points.sight_cosines(vertices_cam, for_kernels(triangles), points_cam, triangle, out)
    return out


def interpolate_at(triangles: NDArray[np.int32], values: Array, triangle: NDArray[np.int32], weights: Array) -> Array:
    """Node values (V,) or (V, K) at points (N,) given by triangle and weights: (N,) or (N, K)."""
    from windmark.resection import _points

    columns = np.ascontiguousarray(values[:, None] if values.ndim == 1 else values, float)
    out = np.empty((len(triangle), columns.shape[1]))
    _points.interpolate(for_kernels(triangles), columns, triangle, weights, out)
    return out.reshape(len(triangle), *values.shape[1:])
