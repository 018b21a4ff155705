"""Values of images at points: on pixels, on points of the model, on nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.resection.visibility import NodeView, see_points
from windmark.scene import Mesh
from windmark.scene.shown import ARRAY, check_kinds

Array = NDArray[np.float64]
Image = NDArray[np.float32]

INTERPOLATIONS = ("nearest", "linear", "cubic")


def interpolate_image(image: ArrayLike, xy: ArrayLike, *, interpolation: str = "cubic") -> Image:
    """Values of an image at any positions.

    Parameters
    ----------
    image : (H, W) or (H, W, C), any real type; computed in float32 (exact for 8- and 16-bit images)
    xy : (..., 2) pixels, (0, 0) the centre of the top-left one
    interpolation : "nearest", "linear" or "cubic" (Catmull-Rom). Each is exact at pixel centres

    Returns
    -------
    (...) or (..., C) float32. NaN outside the image (its area goes to half a pixel beyond the outer
    centres), for NaN positions, and where a pixel that carries weight is NaN. Cubic becomes linear
    next to the border and next to NaN pixels, where some of its sixteen pixels are missing.

    Raises
    ------
    ValueError
        For a wrong shape or an unknown interpolation.
    """
    pixels = checked_image(image, None, "interpolate_image")
    checked_interpolation(interpolation, "interpolate_image")
    points = np.asarray(xy, dtype=float)
    if points.shape[-1:] != (2,):
        raise ValueError(f"interpolate_image: xy must be (..., 2), got {points.shape}")
    flat = np.ascontiguousarray(points.reshape(-1, 2))
    out = _values(pixels, flat, np.zeros(len(flat), np.uint8), interpolation)
    return out.reshape(*points.shape[:-1], *pixels.shape[2:])


def sample(
    image: ArrayLike,
    camera: Camera,
    cam_from_model: Pose,
    xyz: ArrayLike,
    *,
    mesh: Mesh | None = None,
    interpolation: str = "cubic",
    tolerance: float | None = None,
) -> Image:
    """Values of the image at points of the model: pressure taps, a rake, a line, any set.

    Parameters
    ----------
    image : (H, W) or (H, W, C), of the camera's size
    camera, cam_from_model : the view
    xyz : (N, 3) in model coordinates
    mesh : if given, points that it hides from the camera get NaN; without it the points are taken as seen
    interpolation : see `interpolate_image`
    tolerance : see `see_nodes`; for points that are not exactly on the mesh

    Returns
    -------
    (N,) or (N, C) float32, NaN outside the image, behind the camera, where hidden, and on NaN pixels

    Raises
    ------
    ValueError
        For a wrong shape, an image that is not the camera's size, an unknown interpolation.

    Notes
    -----
    Source: AIAA 2005-5007, section III.D ("if the results are required on a given point set or on a line").

    Examples
    --------
    >>> import windmark as wm
    >>> test = wm.synth.wind_tunnel(1, size_px=(640, 512), nodes=2000, clutter=None)
    >>> shot = test.shot("wind-off")
    >>> camera, pose = test.cameras["cam1"], shot.view.cam_from_model
    >>> values = wm.sample(shot.image, camera, pose, test.markers.xyz)
    >>> len(values) == len(test.markers)
    True
    """
    check_kinds(
        "sample", image=(image, ARRAY), camera=(camera, Camera), cam_from_model=(cam_from_model, Pose),
        xyz=(xyz, ARRAY),
    )  # fmt: skip
    pixels = checked_image(image, camera.size_px, "sample")
    view = see_points(xyz, camera, cam_from_model, mesh=mesh, tolerance=tolerance)
    return node_values(pixels, view, interpolation=interpolation)


def node_values(image: ArrayLike, view: NodeView, *, interpolation: str = "cubic") -> Image:
    """Values of the image on the nodes of a `NodeView`: (V,) or (V, C) float32, NaN where not visible.

    The view may serve many images: only this has to be done again for each frame.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> above = wm.Pose.look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    >>> view = wm.see_nodes(plate, wm.Camera((64, 48), 60.0), above)
    >>> frames = [np.full((48, 64), level) for level in (10.0, 20.0)]
    >>> [wm.node_values(frame, view).tolist() for frame in frames]  # one view serves them all
    [[10.0, 10.0, 10.0, 10.0], [20.0, 20.0, 20.0, 20.0]]
    """
    check_kinds("node_values", image=(image, ARRAY), view=(view, NodeView))
    pixels = checked_image(image, view.size_px, "node_values")
    return _values(pixels, view.xy, view.reason, checked_interpolation(interpolation, "node_values"))


def _values(pixels: Image, xy: Array, skip: NDArray[np.uint8], interpolation: str) -> Image:
    """The kernel on (H, W) or (H, W, C): (N,) or (N, C)."""
    from windmark.resection import _sampling

    channels = pixels[..., None] if pixels.ndim == 2 else pixels
    out = np.empty((len(xy), channels.shape[2]), np.float32)
    xy, skip = np.ascontiguousarray(xy), np.ascontiguousarray(skip)
    if interpolation == "cubic":
        _sampling.sample_cubic(channels, xy, skip, out)
    else:
        _sampling.sample_linear(channels, xy, skip, interpolation == "nearest", out)
    return out[:, 0] if pixels.ndim == 2 else out


def checked_image(image: ArrayLike, size_px: tuple[int, int] | None, verb: str) -> Image:
    """The image as contiguous float32 (H, W[, C]), of the given size."""
    pixels = np.asarray(image)
    if pixels.ndim not in (2, 3) or pixels.dtype.kind not in "buif":
        raise UsageError(
            f"{verb}: image must be (H, W) or (H, W, C) of real numbers, got {pixels.shape} {pixels.dtype}"
        )
    if size_px is not None and pixels.shape[1::-1] != tuple(size_px):
        raise UsageError(
            f"{verb}: image must be {size_px[0]} x {size_px[1]} as its camera says (width x height),"
            f" got {pixels.shape[1]} x {pixels.shape[0]}"
        )
    return np.ascontiguousarray(pixels, dtype=np.float32)


def checked_interpolation(interpolation: str, verb: str) -> str:
    """The name, if it is one of `INTERPOLATIONS`."""
    if interpolation not in INTERPOLATIONS:
        raise UsageError(f"{verb}: interpolation must be one of {', '.join(INTERPOLATIONS)}, got {interpolation!r}")
    return interpolation
