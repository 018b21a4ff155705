"""Which images belong to one instant, from files on a disk."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from glob import glob
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.pipeline.deform.entries import RECORDING, CameraEntry
from windmark.pipeline.deform.names import instant_of, is_number, key_of, key_of_file, kind_of, order, said_of, stamp_ns
from windmark.pipeline.deform.project import DeformProject
from windmark.pipeline.deform.timeline import Timeline, timeline
from windmark.tasks.deform.task import FrameImages

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FrameTable:
    """What is known of the frames besides their images.

    Parameters
    ----------
    key : F keys; empty without a table
    time_s : (F,) NaN where unknown
    columns : name -> (F,) further quantities, such as the angle of attack
    """

    key: tuple[str, ...] = ()
    time_s: Array = field(default_factory=lambda: np.zeros(0))
    columns: Mapping[str, Array] = field(default_factory=dict)

    def row(self, key: str) -> int | None:
        """Where a frame stands; None if it is not there."""
        return self._rows.get(key)

    @cached_property
    def _rows(self) -> dict[str, int]:
        return {key: k for k, key in enumerate(self.key)}


def read_frame_table(project: DeformProject) -> FrameTable:
    """The table of frames that a project names; an empty one without.

    Raises
    ------
    FileError
        For a table without the column ``frame``, with a frame twice, or cells that are no numbers.
    """
    path = project.sequence.frames
    if path is None:
        return FrameTable()
    table = io.read_table(path, required=("frame",), known=None)
    keys = tuple(key_of(str(v)) for v in table.text("frame"))
    if twice := sorted((k for k, count in Counter(keys).items() if count > 1), key=order):
        raise io.FileError(path, f"frame {twice[0]} is there more than once", "frame")
    columns = {n: table.numbers(n) for n in table.columns if n != "frame"}
    return FrameTable(keys, columns.pop("time_s", np.full(len(keys), np.nan)), columns)


def frames_on_disk(project: DeformProject, recorded: Mapping[str, Array] | None = None) -> list[FrameImages]:
    """The images of every instant, in order.

    Parameters
    ----------
    project : names the cameras, their images and clocks
    recorded : camera -> times in seconds that its recording holds, picture by picture

    Raises
    ------
    FileError
        When a pattern matches no file, two images of a camera are the same frame, or the cameras' clocks do not fit.
    """
    return instants_of(project, recorded).frames


def instants_of(project: DeformProject, recorded: Mapping[str, Array] | None = None) -> Timeline:
    """`frames_on_disk` with the camera that gives the instants and with what is odd about the clocks."""
    found = {c.name: _images(project, i, c) for i, c in enumerate(project.camera)}
    files = [file for images in found.values() for file in images.values()]
    notes = (*(f"{address}: {text}" for address, text in io.notes_of(files)), *_counted(found))
    if recorded or any(c.has_clock for c in project.camera):
        out = timeline(project, found, {**_stamps(project, found), **(recorded or {})})
        return replace(out, remarks=(*out.remarks, *notes))
    keys = sorted({k for images in found.values() for k in images}, key=order)
    kind = kind_of(keys)
    frames = []
    for n, key in enumerate(keys):
        instant = instant_of(key, kind, keys[0], n)
        images = {name: own[key] for name, own in found.items() if key in own}
        frames.append(FrameImages(key, instant, images, time_s=instant if kind == "stamp" else float("nan")))
    return Timeline(frames, "", (*said_of(keys, project.sequence.rate_hz), *notes))


def _counted(found: Mapping[str, Mapping[str, io.PictureFile]]) -> list[str]:
    """Cameras in whose films pictures are missing that are counted."""
    return [
        f"{name}: frames are counted with those that its film lacks: its frame {file.number} is frame {key}"
        for name, own in found.items()
        for key, file in [max(own.items(), key=lambda item: order(item[0]))]
        if isinstance(file, io.Frame) and is_number(key) and int(key) != file.frames.number(file.number)
    ]


def _stamps(project: DeformProject, found: Mapping[str, Mapping[str, io.PictureFile]]) -> dict[str, Array]:
    """Camera -> the times that its recording or its pictures' names hold, where nothing else says when these were."""
    out = {}
    for i, camera in enumerate(project.camera):
        if camera.rate_hz is not None or camera.times not in (None, RECORDING):
            continue
        keys = sorted(found[camera.name], key=order)
        files = [found[camera.name][key] for key in keys]
        named = [stamp_ns(key) for key in keys]
        stamps = np.array([
            f.time_s if isinstance(f, io.Frame) else np.nan if ns is None else ns / 1e9
            for f, ns in zip(files, named, strict=True)
        ])  # fmt: skip
        if np.isfinite(stamps).any():
            out[camera.name] = stamps
        elif camera.times == RECORDING:
            raise io.FileError(
                project.path, f"{files[0].name} and the other pictures of camera {camera.name} hold no time stamps; "
                "expected a recording or names that do, a table, or rate_hz", f"camera[{i}].times",
            )  # fmt: skip
    return out


def _images(project: DeformProject, i: int, camera: CameraEntry) -> dict[str, io.PictureFile]:
    base = project.path.parent
    out: dict[str, io.PictureFile] = {}
    for pattern in camera.patterns:
        files = files_of(base / pattern)
        if not files:
            raise io.FileError(project.path, f"no file matches {pattern!r} beside the project", f"camera[{i}].images")
        for file in files:
            key = key_of_file(file, counted=camera.times is None)  # tables count the frames that are there
            if key in out:
                raise io.FileError(
                    project.path, f"{out[key].name} and {file.name} are both frame {key} of camera {camera.name}",
                    f"camera[{i}].images",
                )  # fmt: skip
            out[key] = file
    return out


def files_of(pattern: Path) -> list[io.PictureFile]:
    """The pictures that a pattern names, in order, recordings and folders frame by frame; none where no file fits."""
    address = io.frame_address(pattern)
    if address.dataset is not None or address.number is not None or address.file.exists():
        return io.pictures([pattern]) if address.file.exists() else []
    return io.pictures(sorted(Path(p) for p in glob(str(pattern), recursive=True) if Path(p).is_file()))
