"""A model followed through images, in a folder that keeps every image's row: what is stopped can go on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.geometry import Camera, Pose
from windmark.pipeline.resume import (
    CHUNK,
    SeriesJournal,
    check_state,
    read_stopped,
)
from windmark.pipeline.same_run import check_begun, check_pictures, picture_print
from windmark.pipeline.track_files import FollowOptions, follow
from windmark.pipeline.track_results import PoseRow
from windmark.scene import MarkerSet
from windmark.tasks.follow import FollowedFrame

Array = NDArray[np.float64]


@dataclass(frozen=True)
class KeptRow:
    """What the journal has of one image.

    Parameters
    ----------
    row : its row
    cov : (6, 6) of its pose, see `Registration.cov`; None without one
    polarity : that of its spots
    pictures : see `resume.KeptFrame`
    """

    row: PoseRow
    cov: Array | None
    polarity: str
    pictures: Mapping[str, str]

    @property
    def key(self) -> str:
        """The image's name."""
        return self.row.name

    @staticmethod
    def of(frame: FollowedFrame, item: io.PictureFile) -> KeptRow:
        """What is kept of an image that was followed."""
        answer = frame.registered
        cov = None if answer is None else answer.cov[:6, :6]
        return KeptRow(PoseRow.of(frame), cov, frame.polarity, prints_of(item))


@dataclass
class Series:
    """What is known of a series.

    Parameters
    ----------
    rows : of the images, in order
    last : the last pose and its (6, 6) covariance; None where no image gave one
    polarity : that of the markers, "" where not decided
    """

    rows: list[PoseRow] = field(default_factory=list)
    last: tuple[Pose, Array] | None = None
    polarity: str = ""

    def add(self, kept: KeptRow) -> None:
        """Add an image."""
        self.rows.append(kept.row)
        if kept.row.cam_from_model is not None and kept.cov is not None:
            self.last = kept.row.cam_from_model, kept.cov
        self.polarity = kept.polarity or self.polarity


def prints_of(item: io.PictureFile) -> dict[str, str]:
    """See `resume.KeptFrame`: there is one camera."""
    return {"": picture_print(item)}


def follow_series(
    folder: Path,
    images: Sequence[io.PictureFile],
    markers: MarkerSet,
    camera: Camera,
    *,
    options: FollowOptions,
    instants: Sequence[float] | None,
    made: Mapping[str, Any],
    go_on: str = "",
    say: Callable[[PoseRow], None] = lambda _: None,
) -> Series:
    """`follow` with a journal in ``folder``, which `resume.clear` takes away.

    Parameters
    ----------
    folder : an existing folder
    images, markers, camera, options, instants : see `follow`
    made : what the series is made with, see `same_run.made_with`
    go_on : "resume" goes on with the series that was stopped in ``folder``, "finish" takes what that has measured, ""
        begins
    say : called with the row of every image

    Raises
    ------
    FileError
        Where there is no series to go on with, what it was made with or its pictures have changed, or the journal
        cannot be written.
    """
    out, handed_on, stopped = Series(), {}, None
    if go_on:
        check_begun(folder, made)
        stopped = read_stopped(folder, {}, to_go_on=go_on == "resume")
    if stopped is not None:
        for kept in stopped.frames:
            out.add(kept)
        if go_on == "finish":
            return out
        check_state(folder, stopped)
        check_pictures(folder, stopped.frames, [(i.name, prints_of(i)) for i in images[: len(out.rows)]])
        handed_on = stopped.handed_on({})
    left = images[len(out.rows) :]
    following = follow(
        left, markers, camera, options=options, instants=None if instants is None else instants[len(out.rows) :],
        handed_on=handed_on,
    )  # fmt: skip
    journal = SeriesJournal(folder, {}, stopped)
    try:
        if stopped is None:
            journal.begin(made, {})
        for frame, item in zip(following, left, strict=True):
            kept = KeptRow.of(frame, item)
            journal.add(kept, handed_on)
            out.add(kept)
            if len(out.rows) % CHUNK == 0:
                journal.sync()
            say(kept.row)
    finally:
        journal.close()
    return out
