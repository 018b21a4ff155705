"""The corrected image (lens undone) and the correction magnified: AIAA 2005-5007, section IV.B, Fig. 9."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.calibration.corrected_cov import corrected_cov
from windmark.errors import DataError, UsageError
from windmark.geometry import Camera
from windmark.geometry.rays import pixel_rays
from windmark.scene.shown import ARRAY, check_kinds

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

KEEP = ("size", "all", "filled")
"""Which part of the corrected image is kept; see `corrected_camera`."""

MOST = 100
"""Times as many pixels as the original's that a corrected image may have: its border is ten times as long."""

_ROWS = 128  # rows of rays held at a time, so that memory stays that of the images


@dataclass(frozen=True)
class CorrectedImage:
    """An image redrawn for another camera.

    Parameters
    ----------
    image : (H, W) or (H, W, C), in the type of the original; 0, or NaN in floating point, where not valid
    camera : the camera that it fits; with what is left of the original's covariance, see `corrected_cov`
    valid : (H, W) bool, where the original image has a value
    """

    image: NDArray[np.generic]
    camera: Camera
    valid: Mask


def undistort(image: ArrayLike, camera: Camera, *, keep: str = "size") -> CorrectedImage:
    """The image as a perfect camera would have taken it: straight edges are straight.

    Distortion, shear and sensor tilts are undone; focal length and aspect stay, so a pixel keeps its scale near
    the principal point. The values come from a cubic B-spline through all pixels.

    Parameters
    ----------
    image : (H, W) or (H, W, C) of the camera's size; bool, whole numbers or floating point. NaN pixels and those
        around them become not valid
    camera : with its lens
    keep : see `corrected_camera`

    Returns
    -------
    CorrectedImage, with the perfect camera

    Raises
    ------
    ValueError
        For an image that is not of the camera's size, an unknown ``keep``, or a lens without an inverse
        on the image's border where ``keep`` needs it.

    Notes
    -----
    Computed in float32. 8- and 16-bit values are rounded to whole numbers again, and cut off at the type's limits.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> camera = wm.Camera((60, 40), 50.0, k1=-0.2)
    >>> corrected = wm.undistort(np.full((40, 60), 100, dtype=np.uint8), camera)
    >>> corrected.camera.k1, corrected.camera.focal_px
    (0.0, 50.0)
    >>> corrected.image.shape, corrected.image.dtype.name, int(corrected.image[corrected.valid].min())
    ((40, 60), 'uint8', 100)
    """
    check_kinds("undistort", image=(image, ARRAY), camera=(camera, Camera))
    return redraw(image, camera, corrected_camera(camera, keep=keep))


def magnify_distortion(image: ArrayLike, camera: Camera, factor: float) -> CorrectedImage:
    """The image with ``factor`` times its distortion: 1 is the image itself, 0 the corrected one.

    What the correction does becomes visible (the paper's Fig. 9 has factor 3). Each ray is drawn at its perfect
    place plus ``factor`` times the displacement that the lens gives it. Parameters, errors and result as
    `undistort`; where the magnified distortion is not one to one, nothing is valid.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> image = np.tile(np.arange(60.0), (40, 1))  # its grey level is its column
    >>> camera = wm.Camera((60, 40), 50.0, k1=-0.2)
    >>> drawn = [wm.magnify_distortion(image, camera, factor).image[5, 10] for factor in (0.0, 1.0, 3.0)]
    >>> [round(float(column), 1) for column in drawn]
    [10.9, 10.0, 5.5]
    """
    check_kinds("magnify_distortion", image=(image, ARRAY), camera=(camera, Camera))
    return redraw(image, camera, magnified_camera(camera, factor))


def corrected_camera(camera: Camera, *, keep: str = "size") -> Camera:
    """The perfect camera (no distortion, shear, tilt) with the same focal length, aspect and direction.

    Where the original has a covariance, it has one, too (`corrected_cov`): errors of the lens are still in the picture.

    Parameters
    ----------
    camera : with its lens
    keep : "size": the same size and principal point; some of the picture may fall outside, some of it may be
        empty. "all": as large as it takes to hold every pixel of the original. "filled": the part without
        empty pixels

    Raises
    ------
    ValueError
        For an unknown ``keep``, a lens without an inverse on the image's border, or if nothing is filled.
    """
    if keep not in KEEP:
        raise UsageError(f"corrected_camera: keep must be one of {', '.join(KEEP)}, got {keep!r}")
    plain = Camera(camera.size_px, camera.focal_px, camera.aspect, camera.cx, camera.cy)
    if keep == "size":
        return replace(plain, cov=corrected_cov(camera, plain))
    left, top, right, bottom = (plain.project(camera.unproject(side))[0] for side in _border(camera.size_px))
    if not all(np.isfinite(side).all() for side in (left, top, right, bottom)):
        wide = "; directions at 90 degrees and more from its axis have no place in a flat picture"
        why = wide if camera.lens == "fisheye" else ""
        raise DataError(f"corrected_camera: the lens has no inverse on the image's border{why}; expected keep='size'")
    if keep == "all":
        everything = np.concatenate([left, top, right, bottom])
        first, last = np.floor(everything.min(axis=0) + 0.5), np.ceil(everything.max(axis=0) - 0.5)
    else:
        first = np.ceil([left[:, 0].max() + 0.5, top[:, 1].max() + 0.5])
        last = np.floor([right[:, 0].min() - 0.5, bottom[:, 1].min() - 0.5])
    size = last - first + 1
    if (size < 1).any():
        raise DataError("corrected_camera: no part of the corrected image is filled; expected keep='size' or 'all'")
    if size.prod() > MOST * np.prod(camera.size_px):
        raise DataError(
            f"corrected_camera: the corrected image would have {size[0]:.0f} x {size[1]:.0f} px, more than {MOST} "
            "times the original's: it goes on to nearly 90 degrees from the axis; expected keep='size'"
        )
    cut = replace(plain, size_px=(int(size[0]), int(size[1])), cx=camera.cx - first[0], cy=camera.cy - first[1])
    return replace(cut, cov=corrected_cov(camera, cut))


def magnified_camera(camera: Camera, factor: float) -> Camera:
    """The camera with ``factor`` times the distortion.

    The displacement is linear in k1, k2, k3, p1 and p2, so they are multiplied; so are the tilts, whose
    displacement is linear to first order. `DataError` for a rational or fisheye lens, whose is not.
    """
    if camera.lens != "brown":
        raise DataError(f"magnified_camera: the distortion of a {camera.lens} lens is not in proportion to its numbers")
    if not np.isfinite(factor):
        raise UsageError(f"magnified_camera: factor must be a finite number, got {factor}")
    names = ("k1", "k2", "k3", "p1", "p2", "tilt_x", "tilt_y", "shear")
    return replace(camera, **{name: float(factor) * getattr(camera, name) for name in names}, cov=None)


def redraw(image: ArrayLike, camera: Camera, target: Camera) -> CorrectedImage:
    """What ``target`` would have seen in the place and direction of ``camera``, which took the image.

    Parameters, errors and result as `undistort`; nothing is averaged, so a much coarser target aliases.
    """
    pixels = _checked(image, camera.size_px)
    channels = pixels[..., None] if pixels.ndim == 2 else pixels
    spline, unknown = _spline(channels)
    width, height = target.size_px
    out = np.empty((height, width, channels.shape[2]), np.float32)
    packed = camera.packed()
    from windmark.calibration import _kernels

    for first in range(0, height, _ROWS):
        part = out[first : first + _ROWS]
        _kernels.redraw_rows(spline, unknown, packed, pixel_rays(target, first, len(part)), part)
    valid = np.isfinite(out[..., 0])
    picture = _as_type(out, valid, pixels.dtype)
    cov = target.cov if target.cov is not None else corrected_cov(camera, target)
    return CorrectedImage(picture[..., 0] if pixels.ndim == 2 else picture, replace(target, cov=cov), valid)


def _spline(channels: NDArray[np.generic]) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Coefficients of the cubic B-spline, and which pixels are not known (empty if all are).

    Source: Unser, Aldroubi and Eden, "B-spline signal processing", IEEE TSP 41 (1993).
    """
    from scipy import ndimage

    values = np.array(channels, dtype=np.float32, order="C")
    unknown = np.asarray(~np.isfinite(values).all(axis=-1))
    if unknown.any():
        # The spline's memory of a pixel fades within a few pixels; the nearest known one is a harmless stand-in.
        if unknown.all():
            return np.zeros_like(values), unknown.astype(np.uint8)
        nearest = ndimage.distance_transform_edt(unknown, return_distances=False, return_indices=True)
        values = np.ascontiguousarray(values[tuple(nearest)])
    for c in range(values.shape[2]):
        values[..., c] = ndimage.spline_filter(values[..., c], order=3, output=np.float32, mode="mirror")
    return values, np.asarray(unknown if unknown.any() else unknown[:0], dtype=np.uint8)


def _as_type(values: NDArray[np.float32], valid: Mask, kind: np.dtype[np.generic]) -> NDArray[np.generic]:
    if kind.kind == "f":
        return values.astype(kind, copy=False)
    known = np.where(valid[..., None], values, 0)
    if kind.kind == "b":
        return known >= 0.5
    limits = np.iinfo(kind)  # type: ignore[type-var]
    return np.clip(np.rint(known), limits.min, limits.max).astype(kind)


def _border(size_px: tuple[int, int]) -> tuple[Array, Array, Array, Array]:
    """Points along the left, top, right and bottom border of the image's area, a pixel apart."""
    x, y = (np.arange(side + 1) - 0.5 for side in size_px)

    def side(xs: ArrayLike, ys: ArrayLike) -> Array:
        return np.stack(np.broadcast_arrays(xs, ys), axis=-1)

    return side(x[0], y), side(x, y[0]), side(x[-1], y), side(x, y[-1])


def _checked(image: ArrayLike, size_px: tuple[int, int]) -> NDArray[np.generic]:
    pixels = np.asarray(image)
    if pixels.ndim not in (2, 3) or pixels.dtype.kind not in "buif":
        what = f"got {pixels.shape} {pixels.dtype}"
        raise UsageError(f"undistort: image must be (H, W) or (H, W, C) of real numbers, {what}")
    if pixels.dtype.kind in "ui" and pixels.dtype.itemsize > 2:
        raise UsageError(f"undistort: image must have 8 or 16 bits or floating point, got {pixels.dtype}")
    if pixels.shape[1::-1] != tuple(size_px):
        raise UsageError(
            f"undistort: image must be {size_px[0]} x {size_px[1]} as its camera says (width x height),"
            f" got {pixels.shape[1]} x {pixels.shape[0]}"
        )
    return pixels
