"""Pictures of a point: read, corrected, the model found in each; a bad one is left out beside good ones, and said."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.deformation import Deformation
from windmark.errors import DataError, WindmarkError
from windmark.paint import correct_picture, enough
from windmark.pipeline.deform.followed import Followed
from windmark.pipeline.deform.names import key_of_file
from windmark.pipeline.deform.pictures import follow_deformation, read_levels
from windmark.pipeline.light import without_dead
from windmark.pipeline.psp.instants import alone_words, by_instant, in_order
from windmark.pipeline.psp.load import PspTest
from windmark.pipeline.psp.once import Once
from windmark.pipeline.psp.response import soft_words
from windmark.pipeline.psp.sensors import pictures_named
from windmark.pipeline.psp.table import WIND_OFF
from windmark.pipeline.psp.taken import Taken, said
from windmark.pipeline.same_picture import content_of
from windmark.scene.levels import missing_at
from windmark.tasks.deform.task import FrameImages
from windmark.tasks.psp import BadPicture, ModelPicture, moved_grid

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Found:
    """The pictures of a kind in which the model was found.

    Parameters
    ----------
    pictures : with pose and deformation
    states : of the instants, in order
    rms_px : residuals of each instant
    troubles : picture or instant -> what was wrong
    bad : pictures that cannot be used
    names : of the pictures, also where they themselves are no longer kept
    followed : what was said of the instants that have a state
    instants : of each picture, the number of its state
    several : what tells that they are of several states, in words
    """

    pictures: tuple[ModelPicture, ...]
    states: tuple[Deformation, ...]
    rms_px: tuple[float, ...]
    troubles: Mapping[str, str] = field(default_factory=dict)
    bad: tuple[BadPicture, ...] = ()
    names: tuple[str, ...] = ()
    followed: tuple[Followed, ...] = ()
    instants: tuple[int, ...] = ()
    several: tuple[str, ...] = ()


def read_pictures(test: PspTest, kind: str, pattern: str, once: Once) -> dict[str, list[Taken]]:
    """Camera -> its pictures in order, with their light. Pictures of one number, of all cameras, are of one instant.

    Parameters
    ----------
    once : the point's pictures so far

    Raises
    ------
    DataError
        Where there are none, too few of a camera can be used (`paint.enough`), or one is of another kind, too.
    """
    if not pattern:
        missing = ": the reference is missing" if kind.startswith(WIND_OFF) else ""
        raise DataError(f"the table of points names no {kind} pictures{missing}")
    out = {}
    for station in test.deforming.test.stations:
        files = pictures_named(test.project, pattern, station.name)
        named = zip(_names(files), files, strict=True)
        out[station.name] = in_order([_taken(test, station.name, name, file) for name, file in named])
    if not any(out.values()):
        missing = "the reference is missing: " if kind.startswith(WIND_OFF) else ""
        raise DataError(f"{missing}no {kind} picture matches {pattern!r} beside the project")
    out = once.of(kind, out)
    for camera, pictures in out.items():
        once.remarks += [w for w in [soft_words(kind, camera, pictures, test.sensors[camera].model)] if w]
        count = sum(not p.copy for p in pictures)
        good = sum(p.image is not None for p in pictures)
        if pictures and not enough(good, count):
            first = next(p for p in pictures if p.why)
            raise DataError(f"only {good} of {count} {kind} pictures of {camera} can be used; the first that "
                            f"cannot is {first.name}: {first.why}")  # fmt: skip
    return {name: pictures for name, pictures in out.items() if pictures}


def _names(files: Sequence[io.PictureFile]) -> list[str]:
    """What pictures are called in messages: with their folder where two of them have one name."""
    often = Counter(file.name for file in files)
    places = [(file if isinstance(file, Path) else file.path).parent.name for file in files]
    return [f"{place}/{f.name}" if often[f.name] > 1 else f.name for place, f in zip(places, files, strict=True)]


def _taken(test: PspTest, camera: str, name: str, file: io.PictureFile) -> Taken:
    """A picture with light and variance, NaN where a pixel cannot be used."""
    most = test.project.radiometry.max_saturated
    try:
        image, mixed, _ = read_levels(file, test.deforming.test.station(camera))
        if (dark := test.sensors[camera].dark) is not None:
            dark.check(np.asarray(image), "this picture")
        done = correct_picture(missing_at(image, mixed), test.sensors[camera].model, most_saturated=most)
    except WindmarkError as error:
        return Taken(name, None, why=str(error), key=key_of_file(file))
    value = without_dead(np.where(done.usable, done.value, np.nan))
    variance = np.where(np.isnan(value), np.nan, done.variance)
    return Taken(name, image, value, variance, done.lasting, content=content_of(image), key=key_of_file(file))


def the_model_in(test: PspTest, kind: str, raw: Mapping[str, list[Taken]]) -> Found:
    """The model in the pictures of a kind that can be used.

    Raises
    ------
    DataError
        Where it is found in none.
    """
    bad = tuple(BadPicture(said(kind, n, p), n, p.why) for n, own in raw.items() for p in own if p.why)
    frames, paired = [], by_instant(raw)
    for k, of in enumerate(paired):
        images = {n: picture.image for n, picture in of.items() if picture.image is not None}
        if images:
            frames.append(FrameImages(f"{k}", float(k), images))
    seen: list[ModelPicture] = []
    states, rms, followed, instants = [], [], [], []
    troubles = alone_words(kind, paired, list(raw))
    for frame in follow_deformation(frames, test.deforming.test):
        state, k = frame.state, int(frame.key)
        if state is None:
            troubles[f"{kind} picture {k + 1}"] = f"the model was not found: {frame.reason}"
            continue
        if not state.fits:
            troubles[f"{kind} picture {k + 1}"] = "; ".join(state.warnings[:2])
        states.append(state)
        rms.append(state.rms_px)
        followed.append(Followed.of(frame, f"{kind} picture {k + 1}", test.deforming.test))
        mesh, moves = moved_grid(state, test.mesh)
        instants += [len(states) - 1] * len(frame.views)
        for name in frame.views:
            own, station = paired[k][name], test.deforming.test.station(name)
            lens = state.cameras.get(name, station.camera)
            pose = state.cam_from_tunnel.get(name, station.cam_from_tunnel)
            seen.append(ModelPicture(
                said(kind, name, own), name, own.light, own.variance, lens, pose, mesh, moves, own.lasting
            ))  # fmt: skip
    if not states:
        raise DataError(f"no {kind} picture can be used; {next(iter(troubles.values()))}")
    return Found(tuple(seen), tuple(states), tuple(rms), troubles, bad, tuple(p.name for p in seen), tuple(followed),
                 tuple(instants))  # fmt: skip
