"""Perfect images: every pixel is the mean of the light that falls on its square.

Rays go through the exact lens to the nearest of the mesh's flat triangles. A pixel that an outline
(of the model, of a marker, of dirt) crosses is divided into sub-pixels; in all others the light is
smooth and its value at the centre is the mean up to the light's curvature over one pixel.
No noise, no blur, no rounding: `degrade` adds them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.synth.decals import Decals
from windmark.synth.screen import Rays, Screen, pixel_boxes, sample_offsets
from windmark.synth.truth import OWN_SURFACE, MarkerTruth, marker_truth
from windmark.synth.world import World

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Ints = NDArray[np.int32]

UNIT = np.array([False, True, False, True])
"""Of place and normal, now and at rest: which are to have length one."""
_CHUNK = 1 << 15  # samples shaded at a time: what fits in the processor's cache


@dataclass(frozen=True)
class Rendering:
    """A perfect image and what it shows.

    Parameters
    ----------
    image : (H, W) float64, relative intensity
    triangle : (H, W) int32, nearest triangle on the ray of the pixel's centre, -1 for none
    depth : (H, W) z of that hit in the camera's frame, inf for none
    camera, cam_from_tunnel : the view
    uv : (H, W, 2) rays of the pixels' centres
    tell : gives `markers`
    """

    image: Array
    triangle: Ints
    depth: Array
    camera: Camera
    cam_from_tunnel: Pose
    uv: Array
    tell: Callable[[], MarkerTruth]

    @cached_property
    def markers(self) -> MarkerTruth:
        """The truth of every marker, worked out when it is asked for: most pictures of a sequence are only seen."""
        return self.tell()

    @property
    def xyz(self) -> Array:
        """(H, W, 3) surface point of every pixel's centre in the tunnel's frame, NaN for none."""
        z = np.where(self.triangle >= 0, self.depth, np.nan)[..., None]
        return self.cam_from_tunnel.inverse().apply(np.concatenate([z * self.uv, z], axis=-1))


@dataclass(frozen=True)
class _Samples:
    """Rays cast on a set of pixels: slot (H, W) gives a pixel's row, n x n rays in each."""

    slot: Ints
    n: int
    hit: Ints
    depth: Array
    factor: Array
    partial: Mask


def render(
    world: World,
    camera: Camera,
    cam_from_tunnel: Pose,
    *,
    subpixels: int = 11,
    background: float = 0.0,
    rays: Rays | None = None,
) -> Rendering:
    """The perfect image of a world.

    Parameters
    ----------
    world : what stands in the tunnel
    camera, cam_from_tunnel : the view
    subpixels : rays along each side of a pixel that an outline crosses (the paper's 11)
    background : intensity where no surface is met
    rays : `Rays.of(camera)` where several images are made with one camera

    Notes
    -----
    The back of a triangle is black. An outline is every mesh edge between a front and a back face,
    every open edge and every change of volume. Marker and dirt edges are not stepped: a sub-pixel
    takes its share of the disc (see `_kernels.paint_decals`), so areas and centroids of discs of
    r = 3 px hold to about 1e-4 px.
    """
    if subpixels < 1:
        raise ValueError(f"render: subpixels must be at least 1, got {subpixels}")
    rays = Rays.of(camera) if rays is None else rays
    screen = Screen.of(world.mesh, camera, cam_from_tunnel, rays.bend)
    decals = Decals.join([world.dirt, Decals.of_markers(world.markers, world.marker_contrast)])
    painter = _Painter(screen, rays, decals, camera, cam_from_tunnel)

    height, width = rays.uv.shape[:2]
    whole = painter.sample(np.ones((height, width), dtype=bool), 1)
    depth = whole.depth.reshape(height, width)
    triangle = whole.hit.reshape(height, width)
    fine = whole.partial.reshape(height, width) | _outlines(screen, camera, triangle, depth)

    shade = _Shader(world, screen, rays, background)
    image = shade(whole, ~fine)
    fine |= _bent(image, fine)
    edge = painter.sample(fine, subpixels)
    image[fine] = shade(edge, fine)[fine]
    tell = partial(marker_truth, world.markers, camera, cam_from_tunnel, screen=screen)
    return Rendering(image, triangle, depth, camera, cam_from_tunnel, np.ascontiguousarray(rays.uv[..., :2]), tell)


class _Painter:
    """Casts rays and lays the decals on what they hit."""

    def __init__(self, screen: Screen, rays: Rays, decals: Decals, camera: Camera, pose: Pose) -> None:
        self.screen, self.rays = screen, rays
        center, normal, first = pose.apply(decals.center), pose.rotate(decals.normal), pose.rotate(decals.direction)
        # Seen from behind there is nothing: those decals are dropped.
        facing = (center * normal).sum(axis=1) < 0
        center, normal, first, reach = center[facing], normal[facing], first[facing], decals.reach[facing]
        self.frame = np.ascontiguousarray(np.stack([center, first, np.cross(normal, first)], axis=1))
        shape = [decals.half[:, 0], decals.half[:, 1], decals.outer, decals.inner, decals.contrast]
        # A pixel whose centre misses a speck may still hold it: the gate is wider by three pixels' footprint.
        gate = OWN_SURFACE * reach + 3 * center[:, 2] / camera.focal_px
        form = pose.rotate_form(decals.curvature[facing])
        e, f = self.frame[:, 1], self.frame[:, 2]
        bent = [np.einsum("ki,kij,kj->k", a, form, b) for a, b in ((e, e), (e, f), (f, f))]
        self.shape = np.ascontiguousarray(np.column_stack([*(v[facing] for v in shape), gate, *bent]))
        self.volume = screen.volume_code(decals.volume[facing])
        self.boxes = _decal_boxes(camera, self.frame, reach)

    def sample(self, where: Mask, n: int) -> _Samples:
        """Cast n x n rays in the pixels ``where``."""
        from windmark.synth._kernels import cast, paint_decals

        slot = np.full(where.shape, -1, np.int32)
        count = int(where.sum())
        slot[where] = np.arange(count, dtype=np.int32)
        hit, depth = np.full((count, n * n), -1, np.int32), np.full((count, n * n), np.inf)
        s, uv = self.screen, self.rays.uv
        cast(s.vertices, s.triangles, s.boxes, slot, uv, *sample_offsets(n), hit, depth)
        factor, partial = np.ones((count, n * n)), np.zeros(count, dtype=bool)
        paint_decals(
            self.frame, self.shape, self.volume, self.boxes, slot, uv, n, hit, depth, s.code, factor, partial
        )  # fmt: skip
        return _Samples(slot, n, hit, depth, factor, partial)


class _Shader:
    """Turns hits into light."""

    def __init__(self, world: World, screen: Screen, rays: Rays, background: float) -> None:
        self.world, self.screen, self.rays, self.background = world, screen, rays, background
        resting = replace(world.mesh, vertices=world.rest_vertices)
        # Per vertex: place and normal now, place and normal at rest.
        self.fields = np.ascontiguousarray(np.nan_to_num(np.hstack([
            world.mesh.vertices, world.mesh.vertex_normals(), world.rest_vertices, resting.vertex_normals(),
        ])))  # fmt: skip
        corner = [screen.vertices[screen.triangles[:, k]] for k in range(3)]
        self.front = np.einsum("tk,tk->t", np.cross(corner[1] - corner[0], corner[2] - corner[0]), corner[0]) < 0

    def __call__(self, samples: _Samples, where: Mask) -> Array:
        """(H, W) mean light of the sampled pixels ``where``, 0 elsewhere."""
        n = samples.n
        dx, dy = sample_offsets(n)
        ys, xs = np.nonzero(where)
        out = np.zeros(where.shape)
        step = max(1, _CHUNK // (n * n))
        for first in range(0, len(ys), step):
            y, x = ys[first : first + step], xs[first : first + step]
            row, ray = samples.slot[y, x], self.rays.uv[y, x]
            u = ray[:, :1] + ray[:, 2:3] * dx + ray[:, 3:4] * dy
            v = ray[:, 1:2] + ray[:, 4:5] * dx + ray[:, 5:6] * dy
            light = self._light(samples.hit[row].ravel(), np.stack([u.ravel(), v.ravel()], axis=1))
            out[y, x] = (light.reshape(-1, n * n) * samples.factor[row]).mean(axis=1)
        return out

    def _light(self, hit: Ints, uv: Array) -> Array:
        from windmark.synth._kernels import interpolate

        light = np.full(len(hit), self.background)
        light[hit >= 0] = 0.0
        lit = np.flatnonzero(self.front[hit] & (hit >= 0))
        if not len(lit):
            return light
        code = self.screen.code[hit[lit]]
        for k in np.flatnonzero(np.bincount(code)):
            part = lit[code == k]
            values = np.empty((4, len(part), 3))
            interpolate(self.screen.vertices, self.screen.triangles, hit[part], uv[part], self.fields, UNIT, values)
            xyz, normal, rest_xyz, rest_normal = values
            light[part] = self.world.paint.intensity(
                xyz, normal, self.screen.names[k], rest_xyz=rest_xyz, rest_normal=rest_normal, flow=self.world.flow
            )
        return light


def _outlines(screen: Screen, camera: Camera, triangle: Ints, depth: Array) -> Mask:
    """(H, W) pixels that the outline of a surface, or a line where two volumes meet, may cross."""
    from windmark.synth._kernels import flag_edges

    flag = np.zeros(depth.shape, dtype=bool)
    flag_edges(camera.packed(), screen.vertices, screen.xy, _silhouette(screen), depth, flag)
    code = np.where(triangle >= 0, screen.code[triangle], -1)
    for axis in (0, 1):
        a, b = (code[1:], code[:-1]) if axis == 0 else (code[:, 1:], code[:, :-1])
        low, high = (flag[1:], flag[:-1]) if axis == 0 else (flag[:, 1:], flag[:, :-1])
        low |= a != b
        high |= a != b
    return flag


def _bent(image: Array, known: Mask) -> Mask:
    """(H, W) pixels where the light bends so much that its mean over the pixel may differ by 0.3 % from its centre.

    The mean exceeds the centre's value by the second differences / 24. Pixels ``known`` to need care
    hold no light yet: differences across them are not used.
    """
    excess = np.zeros(image.shape)
    for axis in (0, 1):
        a, k = np.moveaxis(image, axis, 0), np.moveaxis(known, axis, 0)
        second = np.abs(a[2:] - 2 * a[1:-1] + a[:-2]) * ~(k[2:] | k[1:-1] | k[:-2])
        near = np.zeros_like(a)
        near[1:-1] = second
        # The light bends most at an outline: a pixel beside one takes its neighbour's bend if that is larger.
        near[2:-1] = np.maximum(near[2:-1], second[:-1])
        near[1:-2] = np.maximum(near[1:-2], second[1:])
        excess += np.moveaxis(near, 0, axis) / 24
    return (excess > 0.003 * image) & ~known


def _silhouette(screen: Screen) -> Ints:
    """(E, 2) edges with one face to the camera and the other away, or with one face only (towards the camera)."""
    t = screen.triangles.astype(np.int64)
    corner = [screen.vertices[t[:, k]] for k in range(3)]
    front = np.einsum("tk,tk->t", np.cross(corner[1] - corner[0], corner[2] - corner[0]), corner[0]) < 0
    pairs = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    key = pairs.min(axis=1) * len(screen.vertices) + pairs.max(axis=1)
    # An inner edge between two front faces is counted twice; only edges counted once are outlines.
    unique, count = np.unique(key[np.tile(front, 3)], return_counts=True)
    once = unique[count == 1]
    return np.stack([once // len(screen.vertices), once % len(screen.vertices)], axis=1).astype(np.int32)


def _decal_boxes(camera: Camera, frame: Array, reach: Array) -> Ints:
    """Pixel ranges that hold the decals: the image of a circle a little wider than each, and a pixel more."""
    theta = 2 * np.pi * np.arange(16) / 16
    circle = np.cos(theta)[:, None] * frame[:, None, 1] + np.sin(theta)[:, None] * frame[:, None, 2]
    xy, _ = camera.project(frame[:, None, 0] + 1.1 * reach[:, None, None] * circle)
    unknown = ~np.isfinite(xy).all(axis=(1, 2))
    xy[unknown] = np.inf  # empty box: a decal that leaves the lens is not drawn
    low, high = xy.min(axis=1) - 1, xy.max(axis=1) + 1
    high[unknown] = -np.inf
    return pixel_boxes(low, high, camera.size_px)
