"""Labelled spots of one camera: near where the state so far says that markers are, or from nothing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark import detection
from windmark.detection import Guided
from windmark.detection.pairs import nearest
from windmark.detection.template.result import BORDER, CONTAMINATED, ILL
from windmark.geometry import Camera, Pose
from windmark.geometry.order import median
from windmark.scene import Detections, MarkerSet
from windmark.scene.levels import saturation_level
from windmark.tasks.deform.task import DeformationTest, Image, Station
from windmark.tasks.predictions import Known, Predictions, from_camera, look_again

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAST_PX, MOST_PX = 1.0, 12.0
"""Markers are looked for at least and at most so far from where they are expected."""
OWN_PX = 1.0
"""A spot of the whole image so near to one with a marker is the same; so near to a marker's place it was looked at."""
APART = 0.45
"""... and never farther than this part of the distance to the nearest other marker in the image."""
CLEARLY = 0.5
"""The nearest spot is a marker's if it is nearer by this factor than any other."""
SIGMAS = 4.0
"""Of the root mean square prediction error of the frames before."""


@dataclass(frozen=True)
class Labelled:
    """Spots of one image with their markers.

    Parameters
    ----------
    marker : (n,) index of the marker
    xy, cov : (n, 2), (n, 2, 2)
    axes_px, angle : (n, 2), (n,) ellipses as they were fitted
    by_table : (n, 3) half axes and direction as marker table and pose have them; NaN where unknown
    expected : how many markers could be seen
    known : what is known of the image, for the next one; None for nothing
    radius_px : median radius of the spots
    reason : why there are none
    pose : where the search put the camera (cold only)
    eccentricity_px : (n, 2) as the state that they were expected from has it (`Predictions`); None if unknown
    off_px : how far the spots were from where they were expected, root mean square per coordinate; inf if unknown
    between_cov : (n, 2, 2) what interpolating between pictures adds to ``cov``; None for spots of one picture
    not_found : what was at the other expected places -> how many
    saturation : grey level from which on the image says nothing; None where that was not asked
    """

    marker: Ints
    xy: Array
    cov: Array
    axes_px: Array
    angle: Array
    by_table: Array
    expected: int = 0
    known: Known | None = None
    radius_px: float = np.nan
    reason: str = ""
    pose: Pose | None = None
    off_px: float = np.inf
    eccentricity_px: Array | None = None
    between_cov: Array | None = None
    not_found: Mapping[str, int] = field(default_factory=dict)
    saturation: float | None = None

    @staticmethod
    def none(reason: str) -> Labelled:
        """No spot, and why."""
        empty = np.zeros((0, 2))
        return Labelled(
            np.zeros(0, np.int64), empty, np.zeros((0, 2, 2)), empty, np.zeros(0), np.zeros((0, 3)), reason=reason
        )

    def without(self, markers: Ints) -> Labelled:
        """Only the spots of other markers."""
        keep, every = ~np.isin(self.marker, markers), ("marker", "xy", "cov", "axes_px", "angle", "by_table")
        own = {n: getattr(self, n) for n in (*every, "eccentricity_px", "between_cov")}
        fewer: dict[str, Any] = {n: None if v is None else v[keep] for n, v in own.items()}
        return replace(self, **fewer)

    def measured_as(self, other: Labelled) -> Labelled:
        """The same labels with what others of the same image measured of the spots that both have, by their places."""
        if not (len(self.marker) and len(other.marker)) or (self.between_cov is None) != (other.between_cov is None):
            return self
        away, where = cKDTree(other.xy).query(self.xy)
        own = (away < OWN_PX) & (np.bincount(where, minlength=len(other.marker))[where] == 1)

        def taken(name: str) -> Any:
            mine = getattr(self, name)
            return None if mine is None else np.where(own.reshape(-1, *[1] * (mine.ndim - 1)),
                                                      getattr(other, name)[where], mine)  # fmt: skip

        names = ("xy", "cov", "axes_px", "angle", "between_cov")
        return replace(self, known=other.known, **{name: taken(name) for name in names})


def near(
    image: Image, test: DeformationTest, station: Station, camera: Camera, pose: Pose, placed: MarkerSet,
    error_px: float, before: Labelled | None, hidden: NDArray[np.bool_] | None, like: Ints | None = None,
    saturation: float | None = None,
) -> Labelled:  # fmt: skip
    """Markers near where they are expected.

    Parameters
    ----------
    image : of the station
    camera, pose : as expected, cam_from_tunnel
    placed : all markers where they are expected, in the tunnel
    error_px : root mean square error of such expectations lately
    before : the frame before
    hidden : (N,) markers that something hides from this camera; None if unknown
    like : (N,) to which of the markers of the frame before each looks alike; None where they are these
    saturation : of the image, where it was looked at before
    """
    radius = None if before is None or not np.isfinite(before.radius_px) else before.radius_px
    known = np.arange(len(placed)) if hidden is None else np.flatnonzero(~hidden)
    seen = placed if hidden is None else placed.take(known)
    expected = from_camera(camera, pose, seen, radius)
    if not len(expected):
        return Labelled.none("no marker faces the camera")
    expected = expected.take(np.argsort(expected.axes_px[:, 0], kind="stable"))  # windows of one size in a row
    which = known[expected.row]
    by_table = np.column_stack([expected.axes_px, expected.angle])
    looks = which if like is None else like[which]
    expected = _as_seen(expected, looks, before)
    apart = nearest(expected.xy)
    reach = max(LEAST_PX, min(SIGMAS * error_px, MOST_PX, max(APART * apart, LEAST_PX)))
    told = None if before is None else before.known
    saturation = saturation_level(image) if saturation is None else saturation
    count = len(placed) if like is None else int(like.max()) + 1 if told is None else len(told.colour)
    found, told = look_again(
        image, expected, looks, count, told, search_px=reach, polarity=test.look.polarity,
        photometry=test.look.photometry, mask=station.mask, reshape=told is None, saturation=saturation,
    )  # fmt: skip
    # The centre of a disc that the border cuts hangs on what is assumed beyond it, that of an ill-conditioned fit on
    # nothing: neither takes part, and a cut one was not to be expected (as in `register`).
    cut = found.found & ((found.flags & BORDER) > 0)
    good = np.flatnonzero(found.found & ((found.flags & (BORDER | ILL)) == 0))
    size = median(np.sqrt(found.axes_px[good].prod(axis=1))) if len(good) else np.nan
    off = float(np.sqrt(((found.xy[good] - expected.xy[good]) ** 2).mean())) if len(good) else np.inf
    why = "" if len(good) else "no marker near its expected place"
    # What is flagged as contaminated keeps its place with as much doubt as its residuals say.
    doubt = np.where((found.flags[good] & CONTAMINATED) > 0, np.fmax(found.chi2[good], 1.0), 1.0)
    return Labelled(
        which[good], found.xy[good], found.cov[good] * doubt[:, None, None], found.axes_px[good], found.angle[good],
        by_table[good], len(expected) - int(cut.sum()), told, size, why, off_px=off,
        eccentricity_px=None if expected.eccentricity_px is None else expected.eccentricity_px[good],
        not_found=_not_found(found, cut), saturation=saturation,
    )  # fmt: skip


def _not_found(found: Guided, cut: NDArray[np.bool_]) -> dict[str, int]:
    """What was seen where markers were expected and none was taken."""
    words = Counter(w for w, there in zip(found.words, found.found, strict=True) if not there)
    ill = found.found & ~cut & ((found.flags & ILL) > 0)
    words.update({"its place cannot be determined": int(ill.sum())} if ill.any() else {})
    return dict(words.most_common())


def _as_seen(expected: Predictions, which: Ints, before: Labelled | None) -> Predictions:
    """Expected markers with the ellipses that they had in the frame before, changed as the pose changes them.

    Discs are never quite what a table says. With the right shape six unknowns are enough (`detect_at`), which is faster
    and surer than ten.
    """
    if before is None or not len(before.marker):
        return expected
    place = np.full(int(max(which.max(), before.marker.max())) + 1, -1)
    place[before.marker] = np.arange(len(before.marker))
    old = place[which]
    known = (old >= 0) & np.isfinite(before.axes_px[old]).all(axis=1) & np.isfinite(before.angle[old])
    axes, angle = expected.axes_px.copy(), expected.angle.copy()
    table = before.by_table[old[known]]
    change = np.column_stack([axes[known] / table[:, :2], angle[known] - table[:, 2]])
    change = np.where(np.isfinite(change).all(axis=1, keepdims=True), change, [1.0, 1.0, 0.0])
    axes[known] = before.axes_px[old[known]] * change[:, :2]
    angle[known] = before.angle[old[known]] + change[:, 2]
    return replace(expected, axes_px=axes, angle=angle)


def everything(image: Image, test: DeformationTest, station: Station) -> Detections | str:
    """All spots of an image; or why there are none."""
    look_for = test.look
    radius: Any = look_for.radius_px
    if radius is None:
        estimate = detection.estimate_radius(image, look_for.polarity, mask=station.mask)
        if not estimate:
            return "no radius prevails among the spots"
        radius = tuple(estimate.radii_px)
    return detection.detect(
        image, radius_px=radius, polarity=look_for.polarity, merit_max=look_for.merit_max,
        photometry=look_for.photometry, mask=station.mask,
    )  # fmt: skip


def around(spots: Detections | str, camera: Camera, pose: Pose, placed: MarkerSet) -> Labelled:
    """Spots that are clearly nearer to a marker's expected place than any other spot, and to no other marker's.

    Right as long as markers move by less than a third of their distance to each other.

    Parameters
    ----------
    spots : of the whole image, or why there are none
    camera, pose : as expected, cam_from_tunnel
    placed : markers where they are expected, in the tunnel
    """
    if isinstance(spots, str):
        return Labelled.none(spots)
    xy, valid = camera.project(pose.apply(placed.xyz))
    seen = np.flatnonzero(valid & camera.in_image(xy))
    if not len(seen) or len(spots) < 2:
        return Labelled.none("too few spots or markers in the image")
    away, spot = cKDTree(spots.xy).query(xy[seen], k=2)
    back = cKDTree(xy[seen]).query(spots.xy)[1]
    good = (back[spot[:, 0]] == np.arange(len(seen))) & (away[:, 0] <= CLEARLY * away[:, 1])
    return labelled_spots(spots, spot[good, 0], seen[good], len(seen), pose)


def labelled_spots(spots: Detections, spot: Ints, marker: Ints, expected: int, pose: Pose) -> Labelled:
    """Spots of the whole image with their markers; ``pose`` of the camera, cam_from_tunnel."""
    if not len(spot):
        return replace(Labelled.none("no spot is clearly nearest to a marker"), pose=pose)
    return Labelled(
        marker, spots.xy[spot], spots.cov[spot], spots.axes_px[spot], spots.angle[spot],
        np.full((len(spot), 3), np.nan), expected, None, float(np.median(spots.radius_px[spot])), "", pose,
    )  # fmt: skip
