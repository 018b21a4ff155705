"""The pictures of a calibration: their spots, their cameras and instants."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from windmark import detection, io
from windmark.errors import UsageError
from windmark.geometry import Camera
from windmark.options.calibration import MATCH_TIME_S
from windmark.options.detection import CHANNEL, MERIT_MAX, POLARITY
from windmark.options.registration import SEED
from windmark.pipeline.clock import Progress, counting, silent
from windmark.scene import Detections
from windmark.tasks.calibrate.marks import Taken, start_camera, taken_by
from windmark.tasks.calibrate.picture import Picture

Image = NDArray[np.generic]


@dataclass(frozen=True)
class MatchOptions:
    """How pictures are read, and their markers found and matched.

    Parameters
    ----------
    radius_px : of the markers; empty takes what each picture itself says
    polarity, merit_max : see `windmark.detect`
    channel, bayer : of colour pictures
    mask : picture of the pixels that are used
    labels : image name -> marker's name -> its place in the picture, where the labelling would be ambiguous
    tolerance_px : neighbourhood of the first round; None takes 0.3 of the spots' spacing
    max_time_s : CPU time per picture and round
    seed : of the matching
    """

    radius_px: tuple[float, ...] = ()
    polarity: str = POLARITY.default
    merit_max: float = MERIT_MAX.default
    channel: str = CHANNEL.default
    bayer: str | None = None
    mask: Path | None = None
    labels: Mapping[str, Mapping[str, tuple[float, float]]] = field(default_factory=dict)
    tolerance_px: float | None = None
    max_time_s: float = MATCH_TIME_S.default
    seed: int = SEED.default

    def __post_init__(self) -> None:
        if self.polarity not in ("dark", "bright"):  # one for all pictures of a calibration
            raise UsageError(f"polarity must be one of dark, bright, got {self.polarity!r}")


P = TypeVar("P", bound=Picture)
LEAST_READ = 2
"""Pictures that must be readable: with one alone nothing can be calibrated or reconstructed."""


def read_pictures(
    paths: Sequence[io.PictureFile],
    cameras: Mapping[str, Camera | None],
    patterns: Mapping[str, str],
    focal_px: float | None,
    make: Callable[[io.PictureFile, str, Taken], P],
    progress: Progress = silent,
) -> tuple[list[P], dict[str, Camera]]:
    """All pictures, read and searched side by side, and the cameras with their sizes.

    Parameters
    ----------
    paths : the pictures
    cameras : by name; None for a camera of which nothing is known
    patterns : camera -> pattern of its pictures' names, see `taken_by`
    focal_px : rough focal length of unknown cameras
    make : what is done with each, from its path, its name, and who took it
    progress : told of each that has ended

    Returns
    -------
    The pictures, those that cannot be read without a spot and with the reason (``unread``), and the cameras

    Raises
    ------
    ValueError
        For sizes that differ, names that say no camera.
    FileError
        For a picture that cannot be read, where fewer than two can, or none of its camera.
    """
    names = picture_names(paths)
    jobs = list(zip(paths, names, taken_by(names, list(cameras), patterns), strict=True))
    ended = counting(progress, "detect", len(jobs))

    def one(job: tuple[io.PictureFile, str, Taken]) -> P | io.FileError:
        made = _made(make, *job)
        ended(job[1])
        return made

    with ThreadPoolExecutor(max_workers=min(len(paths), os.cpu_count() or 1)) as pool:
        found = list(pool.map(one, jobs))
    read = [p for p in found if not isinstance(p, io.FileError)]
    seeing = {p.camera for p in read}
    for p, (_, _, taken) in zip(found, jobs, strict=True):
        if isinstance(p, io.FileError) and (len(read) < LEAST_READ or taken.camera not in seeing):
            raise p
    sized: dict[str, Camera] = {}
    for p in read:
        camera = sized.setdefault(p.camera, cameras[p.camera] or start_camera(p.size_px, focal_px))
        if camera.size_px != p.size_px:
            raise UsageError(f"picture {p.name} has {p.size_px} px; expected {camera.size_px}, as its camera")
    pictures = [_unread(type(read[0]), path, name, taken, sized[taken.camera], p) if isinstance(p, io.FileError) else p
                for p, (path, name, taken) in zip(found, jobs, strict=True)]  # fmt: skip
    return pictures, {name: sized[name] for name in cameras if name in sized}


def _made(
    make: Callable[[io.PictureFile, str, Taken], P], path: io.PictureFile, name: str, taken: Taken
) -> P | io.FileError:
    try:
        return make(path, name, taken)
    except io.FileError as error:
        return error


def _unread(
    kind: type[P], path: io.PictureFile, name: str, taken: Taken, camera: Camera, error: io.FileError
) -> P:
    """A picture that cannot be read, or whose mask cannot."""
    none, why = Detections.make(np.zeros((0, 2))), error.what if str(error.path) == str(path) else str(error)
    said = f"cannot be read: {why}"
    return kind(name, taken.camera, camera.size_px, none, taken.frame, problem=said, unread=said)


def picture_names(paths: Sequence[io.PictureFile]) -> list[str]:
    """Stems of the files; with the folder's name where stems come twice."""
    names = [p.stem for p in paths]
    if len(set(names)) < len(names):
        names = [f"{p.parent.name}/{p.stem}" for p in paths]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise UsageError(f"two pictures have the name {twice[0]}; names must differ")
    return names


def read_image(path: io.PictureFile, options: MatchOptions) -> tuple[Image, NDArray[np.bool_] | None]:
    """Grey levels of a picture, and which pixels are used (None: all)."""
    image = io.read_grey(path, channel=options.channel, bayer=options.bayer)
    return image, None if options.mask is None else io.read_mask(options.mask, image.shape)


def find_spots(image: Image, mask: NDArray[np.bool_] | None, options: MatchOptions) -> Detections:
    """Spots of a picture."""
    return detection.detect(
        image, radius_px=options.radius_px or None, polarity=options.polarity, merit_max=options.merit_max, mask=mask
    )
