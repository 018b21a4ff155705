"""Many images aligned to one reference: its markers are found once, images run in threads, none stops the others."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from windmark import detection, io
from windmark.compiling import working_time
from windmark.errors import WindmarkError
from windmark.options.detection import CHANNEL, MERIT_MAX, POLARITY_OR_AUTO
from windmark.pipeline.align2d.named import NamedSpots, of_image
from windmark.pipeline.clock import Progress, counting, silent
from windmark.scene import Detections
from windmark.tasks.align2d import ImageAlignment, NotAligned, align_images

Image = NDArray[Any]


@dataclass(frozen=True)
class AlignSettings:
    """How to align; every option as in `align_images`, channel and bayer as in `io.read_grey`.

    Parameters
    ----------
    mask, image_mask : files of pixels where the markers of the reference, and of the images, may be
    named : named spots of the pictures in place of detection and matching
    """

    kind: str = "auto"
    max_shift_px: float | None = None
    radius_px: tuple[float, ...] | None = None
    polarity: str = POLARITY_OR_AUTO.default
    merit_max: float = MERIT_MAX.default
    keep_still: bool = False
    channel: str = CHANNEL.default
    bayer: str | None = None
    mask: Path | None = None
    image_mask: Path | None = None
    named: Mapping[str, NamedSpots] | None = None


@dataclass(frozen=True)
class Reference:
    """The reference picture and its markers, the ``polarity`` that the images are searched with, too.

    ``radius_note`` says how radius and polarity were found, "" where they were given.
    """

    path: io.PictureFile
    image: Image
    spots: Detections
    radii_px: tuple[float, ...]
    radius_note: str
    named: NamedSpots | None
    polarity: str


@dataclass(frozen=True)
class AlignedFile:
    """What became of one image: ``problem`` says why there is no alignment ("" where there is one)."""

    path: io.PictureFile
    image: Image | None
    answer: ImageAlignment | NotAligned | None
    problem: str
    seconds: float

    @property
    def name(self) -> str:
        """The file's stem."""
        return self.path.stem

    @property
    def alignment(self) -> ImageAlignment | None:
        """The alignment, if there is one."""
        return self.answer if isinstance(self.answer, ImageAlignment) else None


def read_reference(path: io.PictureFile, settings: AlignSettings) -> Reference:
    """Read the reference and find its markers.

    Raises
    ------
    FileError
        Where it cannot be read, shows no marker, or is not in the table of named spots.
    """
    image = io.read_grey(path, channel=settings.channel, bayer=settings.bayer)
    if settings.named is not None:
        named = of_image(settings.named, path)
        if named is None:
            raise io.FileError(path, "is not in the column image of the table of matches; expected the reference there")
        return Reference(path, image, named.spots, settings.radius_px or (), "", named, settings.polarity)
    mask = None if settings.mask is None else io.read_mask(settings.mask, image.shape[:2])
    look = detection.find_markers(
        image, polarity=settings.polarity, radius_px=settings.radius_px, merit_max=settings.merit_max, mask=mask
    )
    said = [look.radius.reason] if look.radius is not None else []
    note = "; ".join([*said, *([look.words] if look.words else [])])
    return Reference(path, image, look.detections, look.radii_px, note, None, look.polarity)


def align_files(
    paths: Sequence[io.PictureFile], reference: Reference, settings: AlignSettings, *, progress: Progress = silent,
    workers: int | None = None,
) -> Iterator[AlignedFile]:  # fmt: skip
    """Align images in their order; only some more than there are threads are in memory at a time.

    An image that cannot be read or aligned comes with its ``problem``.
    """
    threads = max(1, min(len(paths), workers or os.cpu_count() or 1))
    ended = counting(progress, "align", len(paths))
    waiting: deque[Future[AlignedFile]] = deque()
    with ThreadPoolExecutor(max_workers=threads) as pool:
        try:
            for path in paths:
                if len(waiting) > threads:
                    yield waiting.popleft().result()
                waiting.append(pool.submit(_align_one, path, reference, settings, ended))
            while waiting:
                yield waiting.popleft().result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _align_one(path: io.PictureFile, reference: Reference, settings: AlignSettings, ended: Progress) -> AlignedFile:
    start = working_time()
    image: Image | None = None
    answer: ImageAlignment | NotAligned | None = None
    try:
        image = io.read_grey(path, channel=settings.channel, bayer=settings.bayer)
        answer = _answer(path, image, reference, settings)
        problem = "" if isinstance(answer, ImageAlignment) else f"not aligned: {answer.reason}"
    except WindmarkError as error:  # FileError among them
        problem = str(error)
    ended(path.name)
    return AlignedFile(path, image, answer, problem, working_time() - start)


def _answer(
    path: io.PictureFile, image: Image, reference: Reference, settings: AlignSettings
) -> ImageAlignment | NotAligned:  # fmt: skip
    """One image; where the radius is not given the reference's is tried first, then the image's own."""
    common: dict[str, Any] = {"kind": settings.kind, "polarity": reference.polarity, "merit_max": settings.merit_max,
                              "keep_still": settings.keep_still, "reference_detections": reference.spots}  # fmt: skip
    if reference.named is not None and settings.named is not None:
        named = of_image(settings.named, path)
        if named is None:
            raise io.FileError(path, "is not in the column image of the table of matches; expected its markers there")
        pairs = reference.named.pairs_with(named)
        return align_images(image, reference.image, detections=named.spots, pairs=pairs, **common)
    if not len(reference.spots):
        why = reference.radius_note if not reference.radii_px else f"none of radius {reference.radii_px} px"
        return NotAligned(f"no marker in the reference {reference.path.name}: {why}", "no_spots")
    mask = None if settings.image_mask is None else io.read_mask(settings.image_mask, image.shape[:2])
    common |= {"max_shift_px": settings.max_shift_px, "mask": mask}
    answer = align_images(image, reference.image, radius_px=reference.radii_px, **common)
    if isinstance(answer, NotAligned) and settings.radius_px is None:
        own = tuple(detection.estimate_radius(image, reference.polarity, mask=mask).radii_px)
        if own and own != reference.radii_px:
            again = align_images(image, reference.image, radius_px=own, **common)
            answer = again if isinstance(again, ImageAlignment) or again.count > answer.count else answer
    return answer
