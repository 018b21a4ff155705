"""What one picture says at points of the surface: value, its variance, and how much it should count."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry import Camera, Pose
from windmark.geometry.described import described
from windmark.geometry.rotations import hat
from windmark.resection.noise import NoiseLaw, noise_law
from windmark.resection.pixelmap import PixelMap, map_pixels
from windmark.resection.sampling import Image, checked_image, checked_interpolation, interpolate_image, node_values
from windmark.resection.silhouettes import silhouette
from windmark.resection.visibility import NodeView
from windmark.scene import Mesh

Array = NDArray[np.float64]

EDGE_PX = 1.5
"""Nearer than this to an outline a pixel mixes two surfaces."""
LEAST_SHARE = 1e-4
"""What is left of a weight at the border: where no other picture sees the point the value stays, else it yields."""


@described(lambda p: {
    "name": p.name, "size": " x ".join(str(n) for n in np.shape(p.image)[1::-1]), "camera": p.camera,
})  # fmt: skip
@dataclass(frozen=True, eq=False)
class Picture:
    """One picture of the model with its camera, as merging and sampling take it.

    Parameters
    ----------
    name : of the picture
    image : (H, W), any real type; NaN pixels have no value
    camera, cam_from_model : where it was taken from
    noise : standard deviation of a pixel: one number, (H, W), or a `NoiseLaw`; None estimates the law from the picture
    pose_cov : (6, 6) covariance of the pose, ``exp(delta) @ cam_from_model``, as a `Registration` has it; None: exact

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> above = wm.Pose.look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    >>> camera = wm.Camera((64, 48), 60.0)
    >>> picture = wm.Picture("left", np.full((48, 64), 5.0), camera, above, noise=0.5)
    >>> picture.name, picture.image.shape == camera.size_px[::-1]
    ('left', True)
    """

    name: str
    image: NDArray[np.generic]
    camera: Camera
    cam_from_model: Pose
    noise: float | ArrayLike | NoiseLaw | None = None
    pose_cov: Array | None = None


@dataclass(frozen=True, eq=False)
class Prepared:
    """A `Picture`, checked, with what is made once for all its points.

    ``inside_px``: (H, W) distance of every pixel to the next outline of the model or pixel without a value.
    """

    picture: Picture
    pixels: Image
    noise: NoiseLaw | Array
    interpolation: str
    inside_px: Array = field(repr=False)


@dataclass(frozen=True)
class Taken:
    """What one picture says at N points.

    Parameters
    ----------
    value : (N,) float64, NaN where the picture has none
    variance : (N,) of noise and pose together
    weight : (N,) information per area of the surface: pixels per area over the noise's variance, tapered
    taper : (N,) 0 at the borders of validity to 1
    """

    value: Array
    variance: Array
    weight: Array
    taper: Array


def prepare(
    picture: Picture, mesh: Mesh, interpolation: str, verb: str, seen: PixelMap | None = None
) -> Prepared:
    """Check a picture, and find the outlines beside which it mixes two surfaces; ``seen``: it is mapped already."""
    pixels = checked_image(picture.image, picture.camera.size_px, verb)
    if pixels.ndim != 2:
        raise ValueError(f"{verb}: image must be (H, W), got {pixels.shape}")
    checked_interpolation(interpolation, verb)
    cov = picture.pose_cov
    if cov is not None and (np.ndim(cov) != 2 or np.shape(cov)[0] < 6 or np.shape(cov)[0] != np.shape(cov)[1]):
        raise ValueError(f"{verb}: pose_cov must be (6, 6), got {np.shape(cov)}")
    seen = map_pixels(mesh, picture.camera, picture.cam_from_model) if seen is None else seen
    return Prepared(picture, pixels, _noise(picture, verb), interpolation, _inside_px(pixels, seen))


def _noise(picture: Picture, verb: str) -> NoiseLaw | Array:
    if picture.noise is None:
        return noise_law(picture.image)
    if isinstance(picture.noise, NoiseLaw):
        return picture.noise
    sigma = np.asarray(picture.noise, dtype=float)
    if sigma.ndim not in (0, 2) or (sigma.ndim and sigma.shape != np.shape(picture.image)) or (sigma < 0).any():
        raise ValueError(f"{verb}: noise must be a sigma >= 0, or one for each pixel as the image, got {sigma.shape}")
    return sigma**2 if sigma.ndim else NoiseLaw(float(sigma) ** 2, 0.0, 0.0)


def _inside_px(pixels: Image, seen: PixelMap) -> Array:
    from scipy.ndimage import distance_transform_edt

    bad = silhouette(seen) | ~np.isfinite(pixels)
    return np.asarray(distance_transform_edt(~bad)) if bad.any() else np.full(pixels.shape, np.inf)


def take(
    source: Prepared, view: NodeView, xyz: Array, normal: Array, *, max_obliquity_deg: float, taper_deg: float,
    taper_px: float,
) -> Taken:  # fmt: skip
    """Value, variance and weight of one picture at points (N, 3) with unit normals (N, 3).

    The weight is the information about a small patch of the surface: the number of pixels on it (the determinant of the
    projection's derivative along the surface, in which distance and obliquity are), over the variance of one.
    """
    value = node_values(source.pixels, view, interpolation=source.interpolation).astype(float)
    good = np.flatnonzero(np.isfinite(value))
    n = len(value)
    variance, weight, taper = np.full(n, np.nan), np.zeros(n), np.zeros(n)
    xy = view.xy[good]
    noise = pixel_variance(source, value[good], xy)
    cam, jacobian = _projected(source.picture, xyz[good])
    variance[good] = noise * _noise_share(source, xy) + _of_place(source, cam, jacobian, xy) + _of_mixing(source, xy)
    turned = source.picture.cam_from_model.rotate(np.nan_to_num(normal[good]))
    density = np.abs(np.einsum("nk,nk->n", turned, np.cross(jacobian[:, 0], jacobian[:, 1])))
    # A node whose normals cancel out (a fold) still has its value.
    density = np.maximum(density, 1e-6 * density.max(initial=0.0))
    taper[good] = _taper(source, view, good, max_obliquity_deg, taper_deg, taper_px)
    with np.errstate(divide="ignore", invalid="ignore"):
        weight[good] = np.maximum(taper[good], LEAST_SHARE) * density / noise
    # Without noise (a perfect picture of a test) pixels alone count.
    exact = good[noise <= 0]
    weight[exact] = np.maximum(taper[exact], LEAST_SHARE) * density[noise <= 0]
    return Taken(value, variance, weight, taper)


def value_variance(source: Prepared, view: NodeView, xyz: Array, value: Array, place_cov: Array | None = None
                   ) -> Array:  # fmt: skip
    """(N,) variance of values that `node_values` took at points (N, 3): of the picture's noise, of the pose, of what
    lies beyond an outline that is near; and that of the points' own places, of covariance (N, 3, 3).
    """
    good = np.flatnonzero(np.isfinite(value))
    out = np.full(len(value), np.nan)
    xy = view.xy[good]
    cam, jacobian = _projected(source.picture, xyz[good])
    noise = pixel_variance(source, value[good], xy) * _noise_share(source, xy)
    out[good] = noise + _of_place(source, cam, jacobian, xy) + _of_mixing(source, xy)
    if place_cov is not None:
        along = np.einsum("nk,nkj->nj", _gradient(source, xy), jacobian) @ source.picture.cam_from_model.rotation
        out[good] += np.einsum("nj,njk,nk->n", along, place_cov[good], along)
    return out


def _projected(picture: Picture, xyz: Array) -> tuple[Array, Array]:
    cam = picture.cam_from_model.apply(xyz)
    return cam, picture.camera.point_jacobian(cam)[2]


def pixel_variance(source: Prepared, value: Array, xy: Array) -> Array:
    """Variance of one pixel at points."""
    if isinstance(source.noise, NoiseLaw):
        return source.noise.variance(value)
    height, width = source.noise.shape
    column, row = np.rint(xy).astype(int).T
    return np.asarray(source.noise[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)])


def _gradient(source: Prepared, xy: Array) -> Array:
    """(N, 2) grey levels per pixel, over two pixels; over less next to the border and to what is missing."""
    out = np.zeros((len(xy), 2))
    last = np.array(source.pixels.shape[::-1]) - 1.0
    place = np.clip(xy, 0.0, last)
    here = interpolate_image(source.pixels, place, interpolation="linear").astype(float)
    for axis in range(2):
        change, span = np.zeros(len(xy)), np.zeros(len(xy))
        for sign in (1.0, -1.0):
            beside = np.clip(place + sign * np.eye(2)[axis], 0.0, last)
            there = interpolate_image(source.pixels, beside, interpolation="linear").astype(float)
            known = np.isfinite(there)
            change[known] += sign * (there - here)[known]
            span[known] += np.abs(beside - place)[known, axis]
        out[:, axis] = np.nan_to_num(change / np.maximum(span, 0.5))
    return out


def _of_place(source: Prepared, cam: Array, jacobian: Array, xy: Array) -> Array:
    """Variance of the values by that of their place in the picture: of the pose, and of the pixel's centre for
    "nearest".
    """
    picture, gradient = source.picture, _gradient(source, xy)
    rounding = np.einsum("nk,nk->n", gradient, gradient) / 12 if source.interpolation == "nearest" else 0.0
    if picture.pose_cov is None:
        return np.zeros(len(cam)) + rounding
    cov = np.asarray(picture.pose_cov, dtype=float)
    by_focal = np.zeros((len(cam), 0))
    along = np.einsum("nk,nkj->nj", gradient, jacobian)
    by_pose = np.concatenate([-np.einsum("nj,njk->nk", along, hat(cam)), along], axis=1)
    if len(cov) > 6:  # a free focal length moves every point along its ray from the principal point
        camera = picture.camera
        by_camera = camera.project_jacobian(cam)[3][..., 0]
        by_focal = np.einsum("nk,nk->n", gradient, by_camera)[:, None]
        cov = cov[:7, :7]
    by = np.concatenate([by_pose, by_focal], axis=1)
    return np.asarray(np.einsum("nj,jk,nk->n", by, cov, by) + rounding)


def _of_mixing(source: Prepared, xy: Array) -> Array:
    """Variance of the values next to an outline, whose pixels may show the other surface: anywhere within `EDGE_PX`.

    A cubic surface reaches one pixel farther than that, and what it takes from there is its difference to a linear one.
    """
    if not np.isfinite(source.inside_px).any():
        return np.zeros(len(xy))
    away = interpolate_image(source.inside_px, xy, interpolation="linear")
    out, near = np.zeros(len(xy)), away < EDGE_PX
    gradient = _gradient(source, xy[near])
    out[near] = np.einsum("nk,nk->n", gradient, gradient) * EDGE_PX**2 / 3
    if source.interpolation == "cubic":
        near = away < EDGE_PX + 1.0
        cubic, linear = (interpolate_image(source.pixels, xy[near], interpolation=k) for k in ("cubic", "linear"))
        out[near] += np.square(cubic.astype(float) - linear.astype(float))
    return out


def _noise_share(source: Prepared, xy: Array) -> Array:
    """Which part of a pixel's variance a value has: the sum of the squared interpolation weights, and of their
    products where the noise of neighbours is alike (the sum of the weights is 1).
    """
    alike = source.noise.alike if isinstance(source.noise, NoiseLaw) else 0.0
    own = _own_share(source, xy)
    return own if alike == 0.0 else own + alike * (1 - own)


def _own_share(source: Prepared, xy: Array) -> Array:
    """Sum of the squared interpolation weights.

    As `sample_cubic` does: sixteen pixels, or four where one of the sixteen is missing.
    """
    height, width = source.pixels.shape
    place = np.clip(xy, 0, np.array([width, height]) - 1.0)
    corner = np.floor(place + 1e-6)
    f = np.maximum(place - corner, 0.0)
    if source.interpolation == "nearest":
        return np.ones(len(xy))
    linear = np.prod(f**2 + (1 - f) ** 2, axis=1)
    if source.interpolation == "linear":
        return np.asarray(linear)
    g = 1 - f
    w = np.stack([-0.5 * f * g * g, 1 + f * f * (1.5 * f - 2.5), 1 + g * g * (1.5 * g - 2.5), -0.5 * g * f * f])
    i, j = corner.astype(int).T
    wide = (i >= 1) & (j >= 1) & (i + 2 < width) & (j + 2 < height)
    missing = ~np.isfinite(source.pixels)
    if missing.any():
        from scipy.ndimage import maximum_filter

        # The sixteen pixels from (i-1, j-1): a 4 x 4 box whose middle is shifted by half.
        near = maximum_filter(missing, size=4, origin=-1, mode="nearest")
        wide &= ~near[j, i]
    return np.where(wide, np.prod((w**2).sum(axis=0), axis=1), linear)


def _taper(source: Prepared, view: NodeView, good: NDArray[np.int64], max_obliquity_deg: float, taper_deg: float,
           taper_px: float) -> Array:  # fmt: skip
    """Smooth fall to 0 at the obliquity's limit, at the border of the picture and at outlines."""
    width, height = view.size_px
    xy = view.xy[good]
    border = np.minimum(xy + 0.5, np.array([width, height]) - 0.5 - xy).min(axis=1)
    angle = np.nan_to_num(view.obliquity_deg[good], nan=0.0)
    out = _smooth((max_obliquity_deg - angle) / taper_deg) * _smooth(border / taper_px)
    if np.isfinite(source.inside_px).any():
        inside = interpolate_image(source.inside_px, xy, interpolation="linear").astype(float)
        out *= _smooth((inside - EDGE_PX) / taper_px)
    return np.asarray(out)


def _smooth(t: Array) -> Array:
    """0 below 0, 1 above 1, with no corner between."""
    s = np.clip(t, 0.0, 1.0)
    return s * s * (3 - 2 * s)
