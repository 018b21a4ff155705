"""Light at the nodes of a grid that moved, with its noise and with what the pose and the deformation leave open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Deformation, vertex_volumes
from windmark.geometry import Camera, Pose
from windmark.paint.modes import principal_axes
from windmark.resection import NodeView, inside_px, interpolate_image, see_nodes
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
    """

    name: str
    camera: str
    light: Array
    variance: Array
    lens: Camera
    cam_from_tunnel: Pose
    mesh: Mesh
    moves: Array


@dataclass(frozen=True)
class Sampling:
    """How values are taken.

    Parameters
    ----------
    max_obliquity_deg : surface seen more obliquely gets no value
    edge_px : nor does what is nearer to an outline, where pixels mix
    """

    max_obliquity_deg: float = 70.0
    edge_px: float = 3.0


@dataclass(frozen=True, eq=False)
class Samples:
    """A picture at V nodes; NaN where it shows none.

    Parameters
    ----------
    value, variance : (V,) light and the variance of its noise
    columns : (V, F) change of the value for one sigma of each direction of ``moves``
    weight : (V,) 0 at the limit of what the picture shows, 1 well inside
    """

    value: Array
    variance: Array
    columns: Array
    weight: Array


def moved_grid(state: Deformation, mesh: Mesh) -> tuple[Mesh, Array]:
    """The grid in the tunnel, and (V, 3, F) see `ModelPicture`. Poses of cameras that were free are not in it."""
    place, by_free = state.linearised(mesh.vertices, vertex_volumes(mesh))
    return mesh.moved(place), np.asarray(by_free @ principal_axes(state.cov))


def sample_picture(picture: ModelPicture, how: Sampling) -> Samples:
    """Values at the nodes, bilinear between the four pixels round them.

    A node's value is that of the surface there, not the mean over the cells round it: where nodes are coarser than
    pixels the noise is that of about two pixels.
    """
    view = see_nodes(
        picture.mesh, picture.lens, picture.cam_from_tunnel, max_obliquity_deg=how.max_obliquity_deg
    )  # fmt: skip
    inside = inside_px(picture.mesh, picture.lens, picture.cam_from_tunnel)
    count = len(view)
    value, variance, weight = np.full(count, np.nan), np.full(count, np.nan), np.zeros(count)
    columns = np.zeros((count, picture.moves.shape[2]))
    seen = np.flatnonzero(view.visible)
    deep = _at_pixels(inside, view.xy[seen])
    seen, deep = seen[deep > how.edge_px], deep[deep > how.edge_px]
    light, noise = _bilinear(picture.light, picture.variance, view.xy[seen])
    good = np.isfinite(light)
    seen, deep = seen[good], deep[good]
    value[seen], variance[seen] = light[good], noise[good]
    columns[seen] = _along(picture, view, seen)
    weight[seen] = _inside(view.obliquity_deg[seen], deep, how)
    return Samples(value, variance, columns, weight)


def _at_pixels(image: Array, xy: Array) -> Array:
    height, width = image.shape
    column, row = np.rint(xy).astype(int).T
    return np.asarray(image[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)])


def _bilinear(light: Array, variance: Array, xy: Array) -> tuple[Array, Array]:
    """Values (N,) and their variance: pixels are independent, so it takes the squares of the weights."""
    height, width = light.shape
    corner = np.clip(np.floor(xy).astype(int), 0, [width - 2, height - 2])
    fx, fy = np.clip(xy - corner, 0.0, 1.0).T
    value, noise = np.zeros(len(xy)), np.zeros(len(xy))
    for dy, wy in ((0, 1 - fy), (1, fy)):
        for dx, wx in ((0, 1 - fx), (1, fx)):
            at = corner[:, 1] + dy, corner[:, 0] + dx
            value += np.where(wx * wy > 0, wx * wy * light[at], 0.0)
            noise += np.where(wx * wy > 0, (wx * wy) ** 2 * variance[at], 0.0)
    return value, noise


def _along(picture: ModelPicture, view: NodeView, seen: NDArray[np.int64]) -> Array:
    """(N, F) the picture's slope along the nodes' moves."""
    xy = view.xy[seen]
    slope = np.zeros((len(xy), 2))
    for axis in range(2):
        step = np.eye(2)[axis]
        ahead, behind = (
            interpolate_image(picture.light, xy + s * step, interpolation="linear").astype(float) for s in (1.0, -1.0)
        )
        slope[:, axis] = np.nan_to_num(0.5 * (ahead - behind))
    cam = picture.cam_from_tunnel.apply(picture.mesh.vertices[seen])
    by_place = np.einsum("nk,nkj->nj", slope, picture.lens.point_jacobian(cam)[2]) @ picture.cam_from_tunnel.rotation
    return np.asarray(np.einsum("nj,njf->nf", by_place, picture.moves[seen]))


def _inside(obliquity_deg: Array, deep: Array, how: Sampling) -> Array:
    angle = np.clip((how.max_obliquity_deg - obliquity_deg) / TAPER_DEG, 0.02, 1.0)
    return np.asarray(angle * np.clip((deep - how.edge_px) / TAPER_PX, 0.02, 1.0))
