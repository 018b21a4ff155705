"""Light at the nodes of a grid that moved, with its noise and with what the pose and the deformation leave open."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.deformation import Deformation, vertex_volumes
from windmark.geometry import Camera, Pose
from windmark.paint import disc_nodes, polygon_nodes
from windmark.paint.modes import principal_axes
from windmark.resection import (
    FootprintPlanes,
    PixelMap,
    footprint_values,
    footprints,
    interpolate_image,
    map_pixels,
    outline_distance,
    see_nodes,
)
from windmark.scene import Mesh

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TAPER_DEG, TAPER_PX = 15.0, 6.0
"""The weight of a camera falls to nothing over so many degrees before the largest obliquity, and so many pixels from
outlines: cameras are merged without steps."""


@dataclass(frozen=True, eq=False)
class ModelPicture:
    """One picture, reduced to light, with where everything was when it was taken.

    Parameters
    ----------
    name, camera : of the picture and of its camera
    light, variance : (H, W) in proportion to the light, NaN where a pixel cannot be used; and of its noise
    lens, cam_from_tunnel : the camera
    mesh : the grid in the tunnel
    moves : (V, 3, F) how the nodes move for one sigma of each direction of what motion and deformation leave open
    lasting : (H, W) part of the variance that is the same error in every picture of the camera (`Intensity`)
    """

    name: str
    camera: str
    light: Array
    variance: Array
    lens: Camera
    cam_from_tunnel: Pose
    mesh: Mesh
    moves: Array
    lasting: Array | float = 0.0


@dataclass(frozen=True, eq=False)
class Patches:
    """What is not the surface that is measured: markers, holes of taps, drawn polygons.

    Parameters
    ----------
    rest : the grid at rest
    centres, radii, normals : (D, 3), (D,), (D, 3) of discs there; normals NaN where not known
    polygons : corners (K, 3) of each, see `paint.polygon_nodes`
    """

    rest: Mesh
    centres: Array
    radii: Array
    normals: Array
    polygons: tuple[Array, ...] = ()

    def pixels(self, pixels: PixelMap) -> Mask:
        """(H, W) pixels that see one of the discs from the side that it is on, or a triangle that a polygon touches."""
        triangle = pixels.triangle.ravel()
        out = (self._drawn[triangle] & (triangle >= 0)).reshape(pixels.valid.shape)
        number = np.flatnonzero((triangle >= 0) & self._touched[triangle])
        if not len(number):
            return out
        corners = self.rest.vertices[self.rest.triangles[triangle[number]]]
        second, third = pixels.barycentric.reshape(-1, 2)[number].T[..., None]
        xyz = (1 - second - third) * corners[:, 0] + second * corners[:, 1] + third * corners[:, 2]
        facing = self._facing
        for k, near in enumerate(cKDTree(xyz).query_ball_point(self.centres, self.radii)):
            own = number[np.asarray(near, dtype=np.int64)]
            if np.isfinite(self.normals[k]).all():
                own = own[facing[triangle[own]] @ self.normals[k] > 0]
            out.ravel()[own] = True
        return out

    @cached_property
    def nodes(self) -> Mask:
        """(V,) nodes within one of them."""
        out = disc_nodes(self.rest, self.centres, self.radii, self.normals) >= 0
        for corners in self.polygons:
            out |= polygon_nodes(self.rest, corners)
        return np.asarray(out)

    @cached_property
    def _facing(self) -> Array:
        return self.rest.triangle_normals()

    @cached_property
    def _drawn(self) -> Mask:
        """(T,) triangles with a node inside of a polygon."""
        out = np.zeros(len(self.rest.triangles), bool)
        for corners in self.polygons:
            out |= polygon_nodes(self.rest, corners)[self.rest.triangles].any(axis=1)
        return out

    @cached_property
    def _touched(self) -> Mask:
        """(T,) triangles that may reach into a disc."""
        corners = self.rest.vertices[self.rest.triangles]
        middle = corners.mean(axis=1)
        size = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1, initial=0.0)
        out = np.zeros(len(middle), bool)
        if not len(middle):
            return out
        for k, near in enumerate(cKDTree(middle).query_ball_point(self.centres, self.radii + size.max())):
            own = np.asarray(near, dtype=np.int64)
            out[own[np.linalg.norm(middle[own] - self.centres[k], axis=1) <= self.radii[k] + size[own]]] = True
        return out


@dataclass(frozen=True)
class Sampling:
    """How values are taken.

    Parameters
    ----------
    max_obliquity_deg : surface seen more obliquely gets no value
    edge_px : nor does what is nearer to an outline, where pixels mix
    values : "footprint": a plane through all pixels that lie nearest to a node, interpolated linearly where that has
        less noise; or one of `resection.INTERPOLATIONS`
    patches : their pixels do not count for the nodes beside them
    """

    max_obliquity_deg: float = 70.0
    edge_px: float = 3.0
    values: str = "footprint"
    patches: Patches | None = None

    def patch_pixels(self, pixels: PixelMap) -> Mask:
        """(H, W) pixels that see a patch."""
        return np.zeros(pixels.valid.shape, bool) if self.patches is None else self.patches.pixels(pixels)


@dataclass(frozen=True, eq=False)
class Samples:
    """A picture at V nodes; NaN where it shows none.

    Parameters
    ----------
    value, variance : (V,) light and the variance of its noise
    columns : (V, F) change of the value for one sigma of each direction of ``moves``
    weight : (V,) 0 at the limit of what the picture shows and beyond, 1 well inside, whether there is a value or not
    bent : (V,) part of the value that was taken off because light is bent round the node (`FootprintValues`)
    obliquity_deg : (V,) angle between the surface's normal and the line of sight
    lasting : (V,) part of the variance that is the same error in every picture of the camera
    xy : (V, 2) the nodes in the picture
    planes : through the nodes' pixels, NaN where a value is not that of its plane; None where none were asked for
    """

    value: Array
    variance: Array
    columns: Array
    weight: Array
    bent: Array
    obliquity_deg: Array
    lasting: Array
    xy: Array
    planes: FootprintPlanes | None = None


def moved_grid(state: Deformation, mesh: Mesh) -> tuple[Mesh, Array]:
    """The grid in the tunnel, and (V, 3, F) see `ModelPicture`. Poses of cameras that were free are not in it."""
    place, by_free = state.linearised(mesh.vertices, vertex_volumes(mesh))
    return mesh.moved(place), np.asarray(by_free @ principal_axes(state.cov))


def sample_picture(picture: ModelPicture, how: Sampling, *, straight: bool = False) -> Samples:
    """Values at the nodes, from all pixels nearest to each node, or by interpolation where these are too few.

    ``straight``: the bend of light within a cell is left, see `footprint_values`: a ratio has its own.
    """
    view = see_nodes(
        picture.mesh, picture.lens, picture.cam_from_tunnel, max_obliquity_deg=how.max_obliquity_deg
    )  # fmt: skip
    pixels = map_pixels(picture.mesh, picture.lens, picture.cam_from_tunnel, cull_backfaces=True)
    inside = outline_distance(pixels)
    count = len(view)
    value, variance, weight, bent = np.full(count, np.nan), np.full(count, np.nan), np.zeros(count), np.zeros(count)
    columns = np.zeros((count, picture.moves.shape[2]))
    seen = np.flatnonzero(view.visible)
    deep = _at_pixels(inside, view.xy[seen])
    seen, deep = seen[deep > how.edge_px], deep[deep > how.edge_px]
    weight[seen] = _inside(view.obliquity_deg[seen], deep, how)
    kind, planes = "linear" if how.values == "footprint" else how.values, None
    light, noise = _interpolated(picture.light, picture.variance, view.xy[seen], kind)
    slope = _slope(picture.light, view.xy[seen])
    if how.values == "footprint":
        cells = footprints(pixels, view, (inside > how.edge_px) & ~how.patch_pixels(pixels))
        of = footprint_values(
            picture.light, picture.variance, cells, picture.mesh.triangles, view.xy, straight=straight
        )  # fmt: skip
        better = ~(of.variance[seen] > noise) & np.isfinite(of.value[seen])
        light, noise = np.where(better, of.value[seen], light), np.where(better, of.variance[seen], noise)
        slope = np.where(better[:, None], of.slope[seen], slope)
        bent[seen] = np.where(better, of.bent[seen], 0.0)
        if (planes := of.planes) is not None:
            planes.value[seen[~better]] = np.nan
    good = np.isfinite(light)
    seen = seen[good]
    value[seen], variance[seen] = light[good], noise[good]
    columns[seen] = _along(picture, slope[good], seen)
    lasting = np.full(count, np.nan)
    # About the same part of all pixels of a node, whatever their weights: light and its noise change little over them.
    with np.errstate(invalid="ignore", divide="ignore"):
        part = np.broadcast_to(picture.lasting / picture.variance, picture.light.shape)
    lasting[seen] = variance[seen] * np.clip(np.nan_to_num(_at_pixels(part, view.xy[seen])), 0.0, 1.0)
    return Samples(value, variance, columns, weight, bent, view.obliquity_deg, lasting, view.xy, planes)


def _at_pixels(image: Array, xy: Array) -> Array:
    height, width = image.shape
    column, row = np.rint(xy).astype(int).T
    return np.asarray(image[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)])


def _interpolated(light: Array, variance: Array, xy: Array, kind: str) -> tuple[Array, Array]:
    """Values (N,) and their variance: pixels are independent, so it takes the squares of the weights."""
    height, width = light.shape
    first, wx, wy = _weights(xy, kind)
    value, noise = np.zeros(len(xy)), np.zeros(len(xy))
    for j in range(wy.shape[1]):
        for i in range(wx.shape[1]):
            w = wx[:, i] * wy[:, j]
            at = np.clip(first[:, 1] + j, 0, height - 1), np.clip(first[:, 0] + i, 0, width - 1)
            value += np.where(w != 0, w * light[at], 0.0)
            noise += np.where(w != 0, w**2 * variance[at], 0.0)
    return value, noise


def _weights(xy: Array, kind: str) -> tuple[NDArray[np.int64], Array, Array]:
    """First pixel (N, 2) and weights (N, K) of each axis; cubic: Catmull-Rom (Keys, IEEE ASSP 29, 1981)."""
    if kind == "nearest":
        one = np.ones((len(xy), 1))
        return np.rint(xy).astype(np.int64), one, one
    corner = np.floor(xy).astype(np.int64)
    f = (xy - corner)[..., None]
    if kind == "linear":
        w = np.concatenate([1 - f, f], axis=2)
        return corner, w[:, 0], w[:, 1]
    w = 0.5 * np.concatenate(
        [-f + 2 * f**2 - f**3, 2 - 5 * f**2 + 3 * f**3, f + 4 * f**2 - 3 * f**3, f**3 - f**2], axis=2
    )  # fmt: skip
    return corner - 1, w[:, 0], w[:, 1]


def _slope(light: Array, xy: Array) -> Array:
    """(N, 2) per pixel, between the pixels on both sides; 0 where one of them is missing."""
    slope = np.zeros((len(xy), 2))
    for axis in range(2):
        step = np.eye(2)[axis]
        ahead, behind = (
            interpolate_image(light, xy + s * step, interpolation="linear").astype(float) for s in (1.0, -1.0)
        )
        slope[:, axis] = np.nan_to_num(0.5 * (ahead - behind))
    return slope


def _along(picture: ModelPicture, slope: Array, seen: NDArray[np.int64]) -> Array:
    """(N, F) change of the values along the nodes' moves."""
    cam = picture.cam_from_tunnel.apply(picture.mesh.vertices[seen])
    by_place = np.einsum("nk,nkj->nj", slope, picture.lens.point_jacobian(cam)[2]) @ picture.cam_from_tunnel.rotation
    return np.asarray(np.einsum("nj,njf->nf", by_place, picture.moves[seen]))


def _inside(obliquity_deg: Array, deep: Array, how: Sampling) -> Array:
    angle = np.clip((how.max_obliquity_deg - obliquity_deg) / TAPER_DEG, 0.02, 1.0)
    return np.asarray(angle * np.clip((deep - how.edge_px) / TAPER_PX, 0.02, 1.0))
