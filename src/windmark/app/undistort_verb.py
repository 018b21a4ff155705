"""The verb `windmark undistort`: corrected images, the camera that fits them, the lens' effect magnified."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.app import console
from windmark.app.alone import Unreadable, not_drawn, write_png
from windmark.app.progress import progress
from windmark.app.undistort_report import Undone, undistort_page
from windmark.app.verdict_words import judged
from windmark.calibration import KEEP, corrected_camera, magnified_camera, magnify_distortion, redraw
from windmark.calibration import undistort as correct
from windmark.errors import UsageError, WindmarkError
from windmark.geometry import Camera
from windmark.pipeline.clock import counting
from windmark.pipeline.verdict.undistorted import undistort_verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = 3.0  # the paper's factor
_AS_PNG = (".png", ".jpg", ".jpeg", ".bmp")
Image = NDArray[np.generic]


@dataclass(frozen=True)
class Wishes:
    """What is wanted of `windmark undistort`; see its options."""

    keep: str = "size"
    magnify: float | None = None
    field: bool = False
    picture: bool = False
    output: Path = Path("undistorted")


def undistort(images: list[Path], camera_file: Path, wishes: Wishes, as_json: bool) -> None:
    """Correct each image, write all into one folder, say it."""
    if wishes.keep not in KEEP:
        raise UsageError(f"--keep must be one of {', '.join(KEEP)}, got {wishes.keep!r}")
    images = [file for path in images for file in _files(path)]
    names = [io.picture_name(path) for path in images]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UsageError(f"images: {twice[0]} is there twice; the results are named after the images")
    content = io.read_camera_file(camera_file)
    camera = content.camera
    target = corrected_camera(camera, keep=wishes.keep)
    magnified = None if wishes.magnify is None else magnified_camera(camera, wishes.magnify)
    written: dict[str, list[str]] = {}
    lost = Unreadable()
    failed: list[str] = []
    with progress() as show, console.result_folder(wishes.output) as out:
        place = out.place
        ended = counting(show, "undistort", len(images))
        for path in images:
            with lost.unless_readable(path.name, place):
                written[path.name] = _one(path, place, camera, target, magnified, wishes)
            ended(path.name)
        lost.refuse_unless(written)
        # An image of ones shows which pixels have a value; files have no word for "none" but 0.
        valid = redraw(np.ones(camera.size_px[::-1], np.uint8), camera, target).valid
        io.write_image(place / "valid.png", valid)
        pose = content.cam_from_model if content.length_unit else None
        pose_cov = None if pose is None else content.pose_cov
        io.write_camera(place / "camera.json", target, pose, unit=content.length_unit, pose_cov=pose_cov)
        shown = [path for path in images if path.name in written]
        _draw(shown, camera, camera_file.name, place, wishes, failed)
        verdict = undistort_verdict(camera, target, len(written), lost.why)
        show("draw the report")
        said = _said(content, camera_file.name)
        done = Undone(camera, target, written, lost.why, float(valid.mean()), said)
        page = undistort_page(done, shown, lambda path: next(_grey_of_mosaics(path)), verdict, out)
        (place / "report.html").write_text(page.html(), encoding="utf-8")
        failed += page.failed
    filled = 100 * float(valid.mean())
    width, height = target.size_px
    record = {
        "folder": wishes.output, "images": written, "camera": "camera.json", "size_px": target.size_px,
        "filled_percent": filled, "note": content.note,
        "left_out": lost.why, "not_drawn": failed,
    }  # fmt: skip
    lines = [f"{name}: {', '.join(str(wishes.output / f) for f in files)}" for name, files in written.items()]
    lines += lost.lines() + not_drawn(failed)
    lines.append(f"{width} x {height} px, {filled:.1f} % of them filled (valid.png)")
    lines += said
    lines.append(f"{wishes.output / 'camera.json'} fits the corrected images: it has no distortion")
    lines += [*judged(record, verdict), f"report: {wishes.output / 'report.html'}"]
    console.answer(record, as_json, lines)


def _said(content: io.CameraFile, name: str) -> list[str]:
    """What had to be done to the camera's file, and what of it could not be used."""
    said = [content.note] if content.note else []
    if content.cam_from_model is not None and content.length_unit is None:
        said.append(f"{name} does not say the length unit of its pose: the pose is left out")
    return said


def _files(path: Path) -> list[Path]:
    """The file; the pictures of a folder or pattern."""
    items = io.pictures([path]) if path.is_dir() or not path.exists() else [path]
    return [item for item in items if isinstance(item, Path)] or [path]


def _one(path: Path, place: Path, camera: Camera, target: Camera, magnified: Camera | None, wishes: Wishes
         ) -> list[str]:  # fmt: skip
    """Correct one file, a stack page by page; the names written."""
    stem, suffix = io.picture_name(path), _suffix(path)
    names = [_write(path, place / f"{stem}{suffix}", lambda page: redraw(page, camera, target).image)]
    if magnified is not None:
        name = f"{stem}-x{wishes.magnify:g}{suffix}"
        names.append(_write(path, place / name, lambda page: redraw(page, camera, magnified).image))
    return names


def _suffix(path: Path) -> str:
    """PNG where it holds what comes out, else TIFF."""
    suffix = path.suffix.lower()
    if suffix not in _AS_PNG:
        return ".tiff" if suffix == ".tiff" else ".tif"
    with io.frames(path) as picture:
        return ".tif" if picture.dtype != np.uint8 and len(picture.shape) == 3 else ".png"


def _write(source: Path, target: Path, change: Callable[[Image], Image]) -> str:
    def pages() -> Iterator[Image]:
        for page in _grey_of_mosaics(source):
            try:
                yield change(page)
            except WindmarkError as error:
                raise io.FileError(source, str(error)) from error

    if io.page_count(source) > 1:
        io.write_images(target, pages())
    else:
        io.write_image(target, next(pages()))
    return target.name


def _grey_of_mosaics(source: Path) -> Iterator[Image]:
    """All pictures of a file; neighbours of a raw mosaic have other colours and must not be mixed by a redrawing."""
    mosaic = None
    if source.suffix.lower() == ".cine" or "[" in source.name:
        with io.frames(source) as recording:
            mosaic = recording.bayer
    pages = io.read_images(source)
    return pages if mosaic is None else (io.from_mosaic(page, mosaic) for page in pages)


def _draw(images: list[Path], camera: Camera, name: str, place: Path, wishes: Wishes, failed: list[str]) -> None:
    """The pictures that are wanted."""
    if not (wishes.field or wishes.picture):
        return
    from windmark.app.lens_pictures import correction_picture, distortion_picture

    if wishes.field:
        write_png(place / "distortion.png", lambda: distortion_picture(camera, name), failed)
    if wishes.picture:
        factor = _SHOWN if wishes.magnify is None else wishes.magnify

        def draw(path: Path) -> Figure:
            image = next(_grey_of_mosaics(path))
            if camera.lens != "brown":  # nothing to magnify in proportion
                return correction_picture(image, camera, correct(image, camera))
            shown = correct(image, camera), magnify_distortion(image, camera, factor)
            return correction_picture(image, camera, *shown, factor)

        for path in images:
            write_png(place / f"{io.picture_name(path)}-picture.png", partial(draw, path), failed)
