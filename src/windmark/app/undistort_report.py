"""The page of `windmark undistort`: pictures before and after, what the lens did, the camera that fits them now."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import windmark
from windmark import io
from windmark.app.lens_report import put_correction, put_distortion, put_parameters
from windmark.app.photo import FURTHER
from windmark.app.provenance import Provenance
from windmark.app.report import Report
from windmark.app.verdict_words import put_verdict
from windmark.calibration import redraw
from windmark.errors import g2
from windmark.geometry import Camera
from windmark.pipeline.verdict import Verdict
from windmark.pipeline.verdict.undistorted import drawn, lens_displacement

DRAWN = 12
"""Pictures that are shown before and after; the others are files beside the page."""
LEAST_PX = 1e-6
"""A displacement below this is what numbers are rounded by."""


@dataclass(frozen=True)
class Undone:
    """What was done.

    Parameters
    ----------
    camera, target : whose lens was undone, and the one that fits the corrected pictures
    written : file -> names of what was written for it
    left_out : file -> why it was not read
    filled : part of the corrected picture that has a value
    notes : what is to be said of the camera's file
    """

    camera: Camera
    target: Camera
    written: Mapping[str, Sequence[str]]
    left_out: Mapping[str, str]
    filled: float
    notes: Sequence[str] = ()

    @property
    def moved_px(self) -> NDArray[np.float64]:
        """How far the lens moves places all over the picture, where it has an inverse and they are drawn."""
        moved = lens_displacement(self.camera)
        return moved[np.isfinite(moved) & drawn(self.camera, self.target)]

    @property
    def bends(self) -> bool:
        """Whether there is a distortion to be seen."""
        return bool((self.moved_px > LEAST_PX).any())


def undistort_page(
    done: Undone, paths: Sequence[Path], read: Callable[[Path], NDArray[np.generic]], verdict: Verdict,
    out: io.ResultFolder,
) -> Report:  # fmt: skip
    """The whole page, what could not be drawn in its ``failed``; ``read`` gives the first picture of a file."""
    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    page = Report("Pictures without distortion", f"windmark {windmark.__version__}, {when}", folder=out.target)
    put_verdict(page, verdict)
    _figures(page, done)
    for note in done.notes:
        page.text(note)
    page.heading("Before and after")
    for number, path in enumerate(paths[:DRAWN]):
        with page.part(f"{path.name}: before and after"):
            _before_and_after(page, done, path, read(path), number)
    if len(paths) > DRAWN:
        page.text(f"{len(paths) - DRAWN} further pictures are not drawn here.", "soft")
    page.heading("The lens")
    if done.bends:
        put_distortion(page, done.camera, "picture of the distortion")
    page.heading("Its camera, as given", 3)
    put_parameters(page, done.camera, "no sigma")
    page.heading("The camera of the corrected pictures", 3)
    put_parameters(page, done.target, zeros=False)
    page.heading("Files beside this report")
    page.table(["picture", "written"], [(name, ", ".join(files)) for name, files in done.written.items()],
               scroll=len(done.written) > 15)  # fmt: skip
    page.table(["file", "content"], [
        ("camera.json", "the camera that fits the corrected pictures: it has no distortion"),
        ("valid.png", "which pixels have a value (white)"),
    ])  # fmt: skip
    page.provenance(Provenance.of_verb(out))
    return page


def _figures(page: Report, done: Undone) -> None:
    known = done.moved_px if done.bends else np.zeros(1)
    width, height = done.target.size_px
    rows: list[tuple[str, object]] = [("pictures corrected", len(done.written)), ("left out", len(done.left_out))]
    rows += [("the lens moves a place by at most, px", g2(known.max())),
             ("by root mean square over what is drawn, px", g2(np.sqrt(np.mean(known**2))))]  # fmt: skip
    rows += [("size of the corrected pictures, px", f"{width} x {height}"),
             ("of them filled, %", f"{100 * done.filled:.1f}")]  # fmt: skip
    page.table(["", "value"], rows)
    for name, why in done.left_out.items():
        page.text(f"Left out: {name}: {why}", "bad")


def _before_and_after(page: Report, done: Undone, path: Path, image: NDArray[np.generic], number: int) -> None:
    """The first picture at once and with its distortion magnified; the others open when they are looked at."""
    corrected = redraw(image, done.camera, done.target)
    if number == 0:
        put_correction(page, path.name, image, done.camera, corrected, magnified=done.bends)
        return
    with page.folded(f"picture-{number}", escape(path.name), packed=True, closed=True):
        put_correction(page, path.name, image, done.camera, corrected, room=FURTHER.photo, magnified=False)
