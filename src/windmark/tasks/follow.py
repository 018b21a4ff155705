"""A model followed through a sequence of images: predict, look where the markers must be, label, and start again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark import detection
from windmark.compiling import working_time
from windmark.detection.fields import field_shift
from windmark.errors import DataError, UsageError, WindmarkError
from windmark.geometry import Camera, Pose
from windmark.options.detection import MERIT_MAX, POLARITY
from windmark.options.registration import MAX_TABLE_ERROR
from windmark.registration import Motion, NotRegistered, Registration, TrackState, predict, track
from windmark.registration.track import taken_up
from windmark.scene import Detections, MarkerSet
from windmark.scene.repeated import print_of
from windmark.tasks.expected import imaged_size, of_size, prediction_sigma_px
from windmark.tasks.predictions import Known, from_camera, look_again
from windmark.tasks.unexplained import unexplained

Array = NDArray[np.float64]
Image = NDArray[np.generic]

Reader = Callable[[Any], Image]

SIGMAS, LEAST_PX, MOST_PX = 3.5, 1.5, 10.0
"""Markers are looked for within so many sigma of the prediction, at least and at most so far; beyond that anywhere."""
FEWER = 0.6
"""A guided frame with less than this part of the markers of the frame before is looked at again as a whole."""


@dataclass(frozen=True)
class FollowOptions:
    """How to follow; every option has its meaning from the verb that it goes to.

    Parameters
    ----------
    radius_px : of `detect`; None finds it in the first image that shows one
    polarity, merit_max, photometry : of `detect`; "auto" takes what gives the first pose, dark markers first
    mask : (H, W) pixels that are used; None for all
    motion, prior : of `registration.track.track`
    tolerance_px, max_time_s, max_table_error, seed : of `register`
    """

    radius_px: tuple[float, ...] | None = None
    polarity: str = POLARITY.default
    merit_max: float = MERIT_MAX.default
    photometry: str | None = None
    mask: NDArray[np.bool_] | None = None
    motion: Motion = field(default_factory=Motion)
    prior: Pose | None = None
    tolerance_px: float | None = None
    max_time_s: float | None = None
    max_table_error: float = MAX_TABLE_ERROR.default
    seed: int = 0


@dataclass(frozen=True)
class FollowedFrame:
    """What became of one image.

    Parameters
    ----------
    index, name : its place in the sequence, from 0, and its name
    instant : when it was taken, in frames
    status : "cold", "tracked", "reacquired" or "lost", see `TrackState`
    reason : why it is lost, or had to be searched for
    guided : its spots were looked for near the prediction only
    polarity : that of its spots, "dark" or "bright"
    detections, registration : the spots, and what they gave; None for an image that cannot be read
    seconds : wall time, reading included
    blur_px : how blurred its spots are, 1 sigma of a Gaussian; NaN where they were not looked for near a prediction
    fields_px : how far its rows of odd number are from those of even number, see `FieldShift.sure_px`
    time_s : when it was taken by its recording's clock, NaN where unknown
    picture : tells whether another picture is the same bit by bit (`print_of`); 0 for one that cannot be read
    """

    index: int
    name: str
    instant: float
    status: str
    reason: str
    guided: bool = False
    polarity: str = ""
    detections: Detections | None = None
    registration: Registration | NotRegistered | None = None
    seconds: float = 0.0
    time_s: float = np.nan
    blur_px: float = np.nan
    fields_px: float = 0.0
    picture: int = 0

    @property
    def registered(self) -> Registration | None:
        """The registration if there is one."""
        return self.registration if isinstance(self.registration, Registration) else None


def follow(
    images: Iterable[Any],
    markers: MarkerSet,
    camera: Camera,
    *,
    options: FollowOptions | None = None,
    read: Reader | None = None,
    instants: Sequence[float] | None = None,
    handed_on: dict[str, Any] | None = None,
) -> Iterator[FollowedFrame]:
    """Pose and labels in every image of a sequence, one after the other; memory does not grow with its length.

    The first image is registered without help. From then on the pose is predicted; where the prediction is sharp
    enough the markers are looked for near their predicted ellipses (`detect_at`), else in the whole image. A frame
    that cannot be followed that way is detected as a whole and registered. An image that cannot be read, that has
    another size, or that gives no pose is flagged and changes nothing for the others.

    Parameters
    ----------
    images : names with grey images, or what ``read`` makes one of and has a ``name``, and perhaps ``time_s``
    markers : those that move with the model (or those that stand still): one rigid body
    camera : interior parameters
    options : see `FollowOptions`
    read : makes the grey image of such a thing; a `WindmarkError` says why there is none
    instants : when each image was taken, in frames, strictly increasing; None means one frame apart
    handed_on : takes what every image hands on to the next, before it is yielded; where it holds what an earlier
        sequence of the same markers, camera and options left in it, the images go on with that, and with the instants
        behind its own

    Raises
    ------
    ValueError
        For options out of range, no ``read`` for what is no image, instants that do not increase or do not fit the
        images.
    """
    follower = _Follower(markers, camera, options or FollowOptions(), read)
    kept = {} if handed_on is None else handed_on
    follower.take_up(kept.get("follower", {}))
    first, last = kept.get("index", 0), kept.get("instant", -np.inf)
    for k, item in enumerate(images):
        index = first + k
        if instants is not None and k >= len(instants):
            raise UsageError(f"follow: instants must be given for every image, got {len(instants)} for more images")
        instant = float(index) if instants is None else float(instants[k])
        if not (np.isfinite(instant) and instant > last):
            raise UsageError(f"follow: instants must increase strictly, number {index} is {instant:g} after {last:g}")
        frame = follower.frame(index, item, instant, 1.0 if index == 0 else instant - last)
        last = instant
        kept.update(follower=follower.handed_on(), index=index + 1, instant=last)
        yield replace(frame, time_s=getattr(item, "time_s", np.nan))


_HANDED_ON = ("_known", "_radius", "_polarity", "_last", "_size")


class _Follower:
    """What goes from image to image."""

    def __init__(self, markers: MarkerSet, camera: Camera, options: FollowOptions, read: Reader | None) -> None:
        self._markers, self._camera, self._options, self._reader = markers, camera, options, read
        self._state: TrackState | None = None
        self._known: Known | None = None  # blur and noise of the last image
        self._radius: tuple[float, ...] | None = options.radius_px
        self._polarity = "" if options.polarity == detection.AUTO else options.polarity  # "": not decided yet
        self._last: tuple[int, float] = (0, np.nan)  # markers and their radius in the last good image
        self._size = 1.0  # of discs beside the table's, by the last image that was looked at as a whole

    def handed_on(self) -> dict[str, Any]:
        """What the next image goes on with; what markers and camera alone make is left out."""
        state = None if self._state is None else self._state.told()
        return {"state": state, **{name: getattr(self, name) for name in _HANDED_ON}}

    def take_up(self, handed_on: Mapping[str, Any]) -> None:
        """Go on with what `handed_on` gave."""
        for name in _HANDED_ON if handed_on else ():
            setattr(self, name, handed_on[name])
        if (state := handed_on.get("state")) is not None:
            self._state = taken_up(state, self._markers, self._camera)

    def frame(self, index: int, item: Any, instant: float, dt: float) -> FollowedFrame:
        """Follow one image."""
        start = working_time()
        if self._reader is None and not isinstance(item, tuple):
            raise UsageError(f"follow: expected names with grey images, or `read` for {type(item).__name__}")
        name = item[0] if isinstance(item, tuple) else item.name
        try:
            image = self._read(item)
        except WindmarkError as error:
            return self._lost(index, name, instant, dt, str(error), start)
        if (guided := self._guided(image, dt)) is not None and guided[0]:
            spots, (answer, self._state), near = guided[0], guided[1], True
        else:
            near = False
            tried = self._polarities(image, dt)
            if not tried:
                return self._lost(index, name, instant, dt, "no radius prevails among the spots", start)
            spots, (answer, self._state) = tried
        fields = 0.0
        if isinstance(answer, Registration):
            mine = answer.matching.detection
            self._last = len(mine), float(np.median(spots.radius_px[mine]))
            if not near:
                self._size = imaged_size(spots, answer, self._markers, self._last[1])
            fields = field_shift(image, spots.xy[mine], self._last[1]).sure_px
        state, reason = self._state, self._state.reason
        if index == 0 and isinstance(answer, NotRegistered):
            told = self._unexplained(spots, answer)
            answer, reason = told, reason if told is answer else told.reason
        return FollowedFrame(
            index, name, instant, state.status, reason, near, self._polarity, spots, answer,
            working_time() - start, blur_px=self._known.frame.blur_px if near and self._known else np.nan,
            fields_px=fields, picture=print_of(image),
        )  # fmt: skip

    def _read(self, item: Any) -> Image:
        if isinstance(item, tuple):
            image = np.asarray(item[1])
        else:
            assert self._reader is not None  # `frame` has asked
            image = self._reader(item)
        height, width = image.shape[:2]
        if (width, height) != self._camera.size_px:
            expected = "{} x {}".format(*self._camera.size_px)
            name = item[0] if isinstance(item, tuple) else str(item)
            raise DataError(f"{name}: is {width} x {height} pixels but the camera is {expected}")
        return image

    def _lost(self, index: int, name: str, instant: float, dt: float, reason: str, start: float) -> FollowedFrame:
        if self._state is not None:
            self._state = self._state.without(reason, dt)
        return FollowedFrame(index, name, instant, "lost", reason, seconds=working_time() - start)

    def _guided(
        self, image: Image, dt: float
    ) -> tuple[Detections, tuple[Registration | NotRegistered, TrackState]] | None:
        """Spots near the prediction, and what they give; None where that is of no use or does not hold."""
        state = self._state
        if state is None or state.estimate is None:
            return None
        pose, cov = predict(state, dt)
        reach = SIGMAS * prediction_sigma_px(self._camera, pose, cov, self._markers)
        if not reach < MOST_PX:
            return None
        expected = of_size(from_camera(self._camera, pose, self._markers, self._last[1]), self._markers, self._size)
        if not len(expected):
            return None
        reach, options = max(reach, LEAST_PX), self._options
        found, known = look_again(
            image, expected, expected.row, len(self._markers), self._known, search_px=reach,
            polarity=self._polarity, photometry=options.photometry, mask=options.mask,
        )  # fmt: skip
        spots = found.detections
        if len(spots) < FEWER * self._last[0]:
            return None
        answer = self._track(state, spots, dt, area=(2 * reach + 1) ** 2)
        if not isinstance(answer[0], Registration) or len(answer[0].matching) < FEWER * self._last[0]:
            return None
        gone = np.setdiff1d(np.intersect1d(state.marker, expected.row), answer[1].marker)
        if _may_have_slipped(state.prepared.layout.symmetries[0], gone, answer[1].marker):
            return None
        self._known = known
        return spots, answer

    def _polarities(
        self, image: Image, dt: float
    ) -> tuple[Detections, tuple[Registration | NotRegistered, TrackState]] | None:
        """All spots of an image and what they give; None where their size is not known and cannot be found.

        Where the polarity is open, bright spots are tried where dark ones give no pose; the first pose decides it.
        """
        first = None
        for polarity in (self._polarity,) if self._polarity else ("dark", "bright"):
            look = self._everything(image, polarity)
            if look.radius is not None and not look.radius:
                continue
            result = look.detections, self._track(self._state, look.detections, dt)
            if isinstance(result[1][0], Registration):
                self._polarity = polarity
            if self._polarity:
                self._radius = look.radii_px
                return result
            first = first or result
        return first

    def _unexplained(self, spots: Detections, no: NotRegistered) -> NotRegistered:
        """As `unexplained`, of the first image: those behind it are as they are."""
        names = ("tolerance_px", "max_time_s", "max_table_error", "seed")
        options = {name: getattr(self._options, name) for name in names}
        return unexplained(spots, self._markers, self._camera, no, options)

    def _everything(self, image: Image, polarity: str) -> detection.Look:
        """All spots of one polarity."""
        options = self._options
        return detection.find_markers(
            image, radius_px=self._radius, polarity=polarity, merit_max=options.merit_max,
            photometry=options.photometry, mask=options.mask,
        )  # fmt: skip

    def _track(
        self, state: TrackState | None, spots: Detections, dt: float, area: float | None = None
    ) -> tuple[Registration | NotRegistered, TrackState]:
        """`track`; with ``area`` (px^2 looked through for each marker) from guided spots, without a search."""
        options = self._options
        return track(
            state, spots, self._markers, self._camera, dt=dt, motion=options.motion, prior=options.prior,
            tolerance_px=options.tolerance_px, least_density=0.0 if area is None else 1 / area, search=area is None,
            max_time_s=options.max_time_s, max_table_error=options.max_table_error, seed=options.seed,
        )  # fmt: skip


def _may_have_slipped(onto: NDArray[np.int32], gone: NDArray[np.int64], seen: NDArray[np.int64]) -> bool:
    """Whether a near-symmetry of the markers explains why some of them are gone: they are not there, others are.

    Spots that only it explains lie where nobody looked. The whole image tells: `registration.track` weighs both then.

    Parameters
    ----------
    onto : (S, N) which marker each near-symmetry takes a marker for, -1 for none; see `Layout.symmetries`
    gone, seen : markers that were there before and are not, and those that seem to be there
    """
    if not len(gone) or not len(onto):
        return False
    empty = (onto[:, gone] < 0).mean(axis=1) > 0.5
    as_many = (onto[:, seen] >= 0).sum(axis=1) >= FEWER * len(seen)
    return bool((empty & as_many).any())
