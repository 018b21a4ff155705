"""The verb `associate`: which spot is which marker in every picture, the poses being roughly known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.epipolar.refine import refine_poses
from windmark.epipolar.search import Criteria, Found, find_points
from windmark.epipolar.views import ideal_spots, stations
from windmark.errors import DataError, UsageError
from windmark.geometry import Camera, Pose
from windmark.scene import Detections, Observations, Tracks

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

GATE = 3.7
"""Standard deviations; a right spot is farther away once in a thousand times."""
LEAD = float(np.log(1000.0))
"""A point must be so many times likelier than a rival for its spots."""
PASSES = 6
"""Times that poses and points are improved by each other, at most."""
LOST = 0.4
"""A view with so small a part of the others' share of linked spots has a wrong pose."""
STEADY = 2e-3
"""Share of the links that may still change when nothing more is expected to."""
WHY = {
    "": "belongs to a point",
    "lens": "beyond the lens model",
    "alone": "on no epipolar line of another free spot at a possible depth",
    "weak": "such spots are there, but too few views agree to exclude chance",
    "tied": "belongs to a point that is no better than a rival",
}
"""What can become of a spot."""


@dataclass(frozen=True)
class Association:
    """N points and which spots they are.

    Parameters
    ----------
    tracks, observations : the links; ``track`` and ``point`` are indices into ``xyz``. Same order, point after point
    xyz, cov : (N, 3), (N, 3, 3) coordinates and their covariance, in the frame of the poses, which count as independent
    log10_nfa : (N,) how many such points chance alone would give, at most
    residuals : (O, 2) projected - observed, pixels
    why : for each view (M,) the keys of `WHY`: "" for a spot that belongs to a point
    poses, pose_cov : (V,), (V, 6, 6) after the points have corrected them; as given where nothing was to correct
    scale : residuals in units of the covariances (1 where poses were not corrected)
    passes : times that spots were linked
    """

    tracks: Tracks
    observations: Observations
    xyz: Array
    cov: Array
    log10_nfa: Array
    residuals: Array
    why: tuple[NDArray[np.str_], ...]
    poses: Pose
    pose_cov: Array
    scale: float
    passes: int

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def views(self) -> Ints:
        """(N,) number of views of each point."""
        return np.bincount(self.tracks.track, minlength=len(self.xyz))


def associate(
    detections: Sequence[Detections],
    cameras: Camera | Sequence[Camera],
    poses: Pose | Sequence[Pose],
    *,
    pose_cov: ArrayLike | None = None,
    depth_range: tuple[float, float] | None = None,
    points_near: ArrayLike | None = None,
    model_px: float = 0.05,
    min_views: int = 3,
    max_nfa: float = 0.1,
) -> Association:
    """Link the spots of many pictures that are one point, and find the points (AIAA 2005-5007, section VI).

    Two spots near each other's epipolar line give a point hypothesis. It is grown through the other views, nearest
    first: a spot alone at the predicted place, within the uncertainty of spot, pose and point, is taken and narrows the
    next prediction. Hypotheses are ranked by their evidence against chance (see `epipolar.search`), a spot belongs to
    the best one only, and near ties are left open. With uncertain poses the clear points correct them by an
    adjustment, and the search is repeated with what the adjustment leaves of the uncertainty.

    Parameters
    ----------
    detections : spots of each of V views; positions and covariances are used
    cameras : one for all views, or one per view
    poses : cam_from_model of every view, a batch or a sequence
    pose_cov : (V, 6, 6) or (6, 6) covariances of ``exp(delta) @ cam_from_model``; None where the poses are exact, and
        then they stay as they are
    depth_range : nearest and farthest depth of points before every camera. None: from a fifth to five times that at
        which the lines of sight meet
    points_near : (N, 3) some known points: depths differ from theirs by no more than their own extent. Not together
        with ``depth_range``
    model_px : 1 sigma of what the detections' covariances do not hold: lens, eccentricity
    min_views : views that a point needs; with two nothing checks a link but the epipolar line, see `match_known_pair`
    max_nfa : largest expected number of false points

    Returns
    -------
    Association
        Without any point where the data hold none.

    Raises
    ------
    ValueError
        Numbers that do not fit together; fewer than three views; unusable options.
    """
    cams, pose, cov = _checked(detections, cameras, poses, pose_cov)
    _check_options(depth_range, points_near, min_views, max_nfa, model_px, len(cams))
    about = None if points_near is None else np.asarray(points_near, dtype=float).reshape(-1, 3)
    spots = _Spots.of(detections, cams, model_px)
    scale, links, passes = 1.0, -1, 0
    exact, moved = pose_cov is None, np.zeros(len(cams), dtype=np.bool_)
    given, given_cov = pose, cov
    while True:
        stand, depth = stations(cams, pose, cov, depth_range, about)
        rough = not exact and passes == 0
        criteria = Criteria(GATE, min_views, max_nfa, LEAD, rough)
        found = find_points(
            stand, spots.ideal, spots.noise * max(scale, 1.0) ** 2, spots.count, spots.usable, depth, criteria
        )
        passes += 1
        before, links = links, int((found.rows >= 0).sum())
        lost = _lost_views(found.rows, spots.count) & moved
        settled = not rough and abs(links - before) <= STEADY * links and not lost.any()
        if exact or settled or passes == PASSES:
            break
        refined = refine_poses(cams, pose, cov, found.xyz, spots.observations(found.rows))
        if refined is None and not rough:
            break
        if refined is None:
            exact = True  # Nothing to correct the poses by: what there is counts as it is.
            continue
        pose, cov, scale, moved = refined.poses, refined.pose_cov, refined.scale, refined.moved
        if not rough and lost.any():
            # A wrong correction: what was given is nearer to the truth.
            pose, moved = _put_back(pose, given, lost), moved & ~lost
            cov[lost] = given_cov[lost]
    return _result(spots, found, cams, pose, cov, scale, passes)


def _lost_views(rows: Ints, count: Ints) -> Mask:
    """(V,) views whose spots belong to points far more seldom than those of the others."""
    share = (rows >= 0).sum(axis=0) / np.maximum(count, 1)
    return np.asarray(share < LOST * np.median(share))


def _put_back(poses: Pose, given: Pose, where: Mask) -> Pose:
    return Pose(
        np.where(where[:, None, None], given.rotation, poses.rotation),
        np.where(where[:, None], given.translation, poses.translation),
    )


@dataclass(frozen=True)
class _Spots:
    """All spots, view after view, in pixels and in ideal coordinates."""

    count: Ints
    view: Ints
    xy: Array
    cov: Array
    ideal: Array
    noise: Array
    usable: Mask

    @staticmethod
    def of(detections: Sequence[Detections], cameras: Sequence[Camera], model_px: float) -> _Spots:
        wider = [Detections.make(d.xy, cov=d.cov + model_px**2 * np.eye(2)) for d in detections]
        ideal, noise = ideal_spots(wider, cameras)
        count = np.array([len(d) for d in detections])
        return _Spots(
            count, np.repeat(np.arange(len(count)), count), np.concatenate([d.xy for d in wider]),
            np.concatenate([d.cov for d in wider]), ideal, noise, np.asarray(np.isfinite(ideal).all(axis=1)),
        )  # fmt: skip

    def observations(self, rows: Ints) -> Observations:
        """The links of rows (T, V), point after point."""
        point, view = np.nonzero(rows >= 0)
        spot = rows[point, view]
        return Observations(view, point, self.xy[spot], self.cov[spot])


def _result(
    spots: _Spots, found: Found, cameras: tuple[Camera, ...], poses: Pose, pose_cov: Array, scale: float, passes: int
) -> Association:
    point, view = np.nonzero(found.rows >= 0)
    spot = found.rows[point, view]
    start = np.cumsum(spots.count) - spots.count
    observations = spots.observations(found.rows)
    residuals = np.full((len(point), 2), np.nan)
    for v, camera in enumerate(cameras):
        mine = view == v
        place = Pose(poses.rotation[v], poses.translation[v]).apply(found.xyz[point[mine]])
        residuals[mine] = camera.project(place)[0] - observations.xy[mine]
    why = np.where(found.tied, "tied", np.where(found.met, "weak", "alone"))
    why[~spots.usable] = "lens"
    why[spot] = ""
    return Association(
        Tracks(point, view, spot - start[view]), observations, found.xyz, found.cov, found.log_nfa / np.log(10.0),
        residuals, tuple(np.split(why, start[1:])), poses, pose_cov, scale, passes,
    )  # fmt: skip


def _checked(
    detections: Sequence[Detections], cameras: Camera | Sequence[Camera], poses: Pose | Sequence[Pose],
    pose_cov: ArrayLike | None,
) -> tuple[tuple[Camera, ...], Pose, Array]:  # fmt: skip
    """One camera, pose and covariance for each view."""
    views = len(detections)
    cams = (cameras,) * views if isinstance(cameras, Camera) else tuple(cameras)
    if len(cams) != views:
        raise ValueError(f"associate: expected one camera or {views}, one per view of detections, got {len(cams)}")
    if not isinstance(poses, Pose):
        poses = Pose(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))
    if poses.rotation.shape != (views, 3, 3):
        raise ValueError(f"associate: poses must be {views}, one per view, got {poses.rotation.shape[:-2]}")
    cov = np.zeros((6, 6)) if pose_cov is None else np.asarray(pose_cov, dtype=float)
    if cov.shape not in ((6, 6), (views, 6, 6)) or not np.isfinite(cov).all():
        raise ValueError(f"associate: pose_cov must be finite, (6, 6) or ({views}, 6, 6), got {cov.shape}")
    return cams, poses, np.array(np.broadcast_to(cov, (views, 6, 6)))


def _check_options(
    depth_range: tuple[float, float] | None, points_near: ArrayLike | None, min_views: int, max_nfa: float,
    model_px: float, views: int,
) -> None:  # fmt: skip
    if views < 3:
        raise DataError(f"associate: three views are needed, got {views}; for two there is match_known_pair")
    if depth_range is not None and points_near is not None:
        raise UsageError("associate: give depth_range or points_near, not both")
    if depth_range is not None and not 0 < depth_range[0] < depth_range[1]:
        raise UsageError(f"associate: depth_range must be 0 < nearest < farthest, got {depth_range}")
    if points_near is not None and np.shape(points_near)[-1:] != (3,):
        raise ValueError(f"associate: points_near must be (N, 3), got {np.shape(points_near)}")
    if min_views < 3 or min_views > views:
        raise UsageError(f"associate: min_views must be 3 ... {views}, got {min_views}")
    if not max_nfa > 0:
        raise UsageError(f"associate: max_nfa must be > 0, got {max_nfa}")
    if not model_px >= 0:
        raise UsageError(f"associate: model_px must be >= 0, got {model_px}")
