"""Values of a picture at pressure taps or any list of points, each with its sigma or the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry import Camera, Pose
from windmark.geometry.described import described
from windmark.resection.nearest import SurfacePoints, nearest_on_surface
from windmark.resection.noise import NoiseLaw
from windmark.resection.reasons import REASONS, VISIBLE
from windmark.resection.sampling import node_values
from windmark.resection.sources import Picture, Prepared, prepare, value_variance
from windmark.resection.surface_view import see_surface
from windmark.resection.visibility import NodeView
from windmark.scene import Mesh
from windmark.scene.shown import ARRAY, check_kinds, pandas_table

Array = NDArray[np.float64]

POINT_REASONS = (*REASONS, "far", "either_side", "no_pixel", "no_place")
"""What a `PointValues.reason` code means: those of a node, then why a point has no place on the surface.

far: farther from the surface than allowed; either_side: as near to both sides of a thin part, and no normal tells which
is meant; no_pixel: the picture has no value there (NaN); no_place: the coordinates are no numbers.
"""
FAR, EITHER_SIDE, NO_PIXEL, NO_PLACE = range(len(REASONS), len(POINT_REASONS))


@described(lambda p: {"points": len(p), "with value": int((p.reason == 0).sum())})  # fmt: skip
@dataclass(frozen=True)
class PointValues:
    """Values at N points.

    Parameters
    ----------
    value : (N,) NaN where there is none
    sigma : (N,) of the picture's noise and the pose, and of what a pixel next to an outline shows of another surface
    reason : (N,) uint8, 0 or why there is no value, see `POINT_REASONS`
    xy : (N, 2) pixels, NaN where the point has no place in the picture
    xyz : (N, 3) the point of the surface that was looked at
    moved : (N,) how far the point asked for was moved onto the surface

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> above = wm.Pose.look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    >>> image, camera = np.full((48, 64), 7.0), wm.Camera((64, 48), 60.0)
    >>> tap = wm.sample_points(image, camera, above, plate, [[0.3, 0.2, 0.01]], max_distance=0.05, noise=1.0)
    >>> tap.xyz.round(3).tolist(), tap.moved.round(3).tolist()  # brought onto the surface
    ([[0.3, 0.2, 0.0]], [0.01])
    >>> tap.value.round(3).tolist(), bool(tap.sigma[0] < 1.1)
    ([7.0], True)
    """

    value: Array
    sigma: Array
    reason: NDArray[np.uint8]
    xy: Array
    xyz: Array
    moved: Array

    def __len__(self) -> int:
        return len(self.reason)

    @property
    def words(self) -> NDArray[np.str_]:
        """(N,) the reasons as words, empty where there is a value."""
        return reason_words(self.reason)

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``: value, sigma, why there is none, place in the picture and on the surface."""
        return pandas_table({
            "value": self.value, "sigma": self.sigma, "reason": self.words.tolist(), "x_px": self.xy[:, 0],
            "y_px": self.xy[:, 1], **dict(zip("xyz", self.xyz.T, strict=True)), "moved": self.moved,
        })  # fmt: skip


def reason_words(reason: NDArray[np.uint8]) -> NDArray[np.str_]:
    """The words of codes; empty where all is well."""
    return np.array(["", *POINT_REASONS[1:]], dtype=np.str_)[reason]


def sample_points(
    image: ArrayLike,
    camera: Camera,
    cam_from_model: Pose,
    mesh: Mesh,
    xyz: ArrayLike,
    *,
    normal: ArrayLike | None = None,
    max_distance: float | None = None,
    max_obliquity_deg: float | None = 80.0,
    noise: float | ArrayLike | NoiseLaw | None = None,
    pose_cov: Array | None = None,
    interpolation: str = "cubic",
    tolerance: float | None = None,
) -> PointValues:
    """Values of a picture at points on the surface or near it: pressure taps, any list.

    Parameters
    ----------
    image, camera, cam_from_model, interpolation : as in `sample`
    mesh : the surface; points are moved onto it, and it hides
    xyz, normal, max_distance : as in `nearest_on_surface`
    max_obliquity_deg, tolerance : as in `see_nodes`
    noise, pose_cov : as in `Picture`

    Returns
    -------
    PointValues

    Raises
    ------
    ValueError
        For wrong shapes or options.

    Notes
    -----
    Source: AIAA 2005-5007, section III.D ("if the results are required on a given point set or on a line").

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> above = wm.Pose.look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    >>> image = np.tile(np.arange(64.0), (48, 1))  # its grey level is its column
    >>> places = [[0.3, 0.2, 0.01], [9.0, 0.0, 0.0]]
    >>> taps = wm.sample_points(image, wm.Camera((64, 48), 60.0), above, plate, places, max_distance=0.05, noise=1.0)
    >>> taps.value.round(1).tolist(), taps.words.tolist()
    ([36.0, nan], ['', 'far'])
    """
    check_kinds(
        "sample_points", image=(image, ARRAY), camera=(camera, Camera), cam_from_model=(cam_from_model, Pose),
        mesh=(mesh, Mesh), xyz=(xyz, ARRAY),
    )  # fmt: skip
    points = nearest_on_surface(mesh, xyz, normal=normal, max_distance=max_distance)
    picture = Picture("image", np.asarray(image), camera, cam_from_model, noise, pose_cov)
    source = prepare(picture, mesh, interpolation, "sample_points")
    return point_values(source, mesh, np.asarray(xyz, dtype=float), points, max_obliquity_deg=max_obliquity_deg,
                        tolerance=tolerance)  # fmt: skip


def point_values(
    source: Prepared,
    mesh: Mesh,
    asked: Array,
    points: SurfacePoints,
    *,
    max_obliquity_deg: float | None = 80.0,
    tolerance: float | None = None,
    place_cov: Array | None = None,
) -> PointValues:
    """`sample_points` for points (N, 3) whose places on the surface are known already, in a picture of `prepare`.

    ``mesh`` may be the grid on which they were found in another shape; ``moved`` stays as it was there. ``place_cov``
    (N, 3, 3): covariance of the places on that grid.
    """
    camera, pose = source.picture.camera, source.picture.cam_from_model
    view = see_surface(mesh, points, camera, pose, max_obliquity_deg=max_obliquity_deg, tolerance=tolerance)
    reason = point_reasons(asked, points, view)
    value = node_values(source.pixels, view, interpolation=source.interpolation).astype(float)
    value[reason != VISIBLE] = np.nan
    place = points.on(mesh)
    sigma = np.sqrt(value_variance(source, view, place, value, place_cov))
    reason[(reason == VISIBLE) & ~np.isfinite(value)] = NO_PIXEL
    return PointValues(value, sigma, reason, view.xy, place, points.distance)


def point_reasons(asked: Array, points: SurfacePoints, view: NodeView) -> NDArray[np.uint8]:
    """(N,) codes of `POINT_REASONS`: no place on the surface first, then why it is not seen."""
    reason = view.reason.copy()
    reason[points.either_side] = EITHER_SIDE
    reason[points.triangle < 0] = FAR
    reason[~np.isfinite(asked).all(axis=1)] = NO_PLACE
    return reason
