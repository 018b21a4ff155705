"""What `pipeline.resume` keeps of a deformation test: its frames, what it is made with, what its frames share."""

from __future__ import annotations

import csv
import json
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from windmark import io
from windmark.deformation import Deformation
from windmark.io.errors import reading
from windmark.pipeline import same_run
from windmark.pipeline.deform.entries import RECORDING
from windmark.pipeline.deform.project import DeformProject
from windmark.pipeline.deform.record import FrameRecord
from windmark.tasks.deform.task import DeformationTest, DeformedFrame, FrameImages

READ_BYTES = 1 << 20
"""Of a table at once."""


@dataclass(frozen=True)
class Kept:
    """What the journal has of one frame.

    Parameters
    ----------
    row : its numbers
    state : its deformation where the film keeps it
    compared : the frame itself and its pictures where it is the most deformed one so far that was mapped; the pictures
        None where they are frames of a recording
    pictured : the same where the report shows its pictures, or did until then: see `Gallery`
    pictures : camera -> its pictures' name, size and checksum; live, name, size and date
    sizes : table -> its length in bytes
    crcs : table -> checksum of what it has
    """

    row: FrameRecord
    state: Deformation | None
    compared: tuple[DeformedFrame, FrameImages | None] | None
    pictured: tuple[DeformedFrame, FrameImages | None] | None
    pictures: Mapping[str, str]
    sizes: Mapping[str, int]
    crcs: Mapping[str, int]

    @property
    def key(self) -> str:
        """The frame's name."""
        return self.row.key


def named(test: DeformationTest) -> dict[str, Any]:
    """What is the same object in all frames, by name: poses of cameras that stand still are told by that."""
    out: dict[str, Any] = {"markers": test.markers, "volumes": test.volumes, "marker_cov": test.marker_cov}
    out |= {f"volume {part.name}": part for part in test.volumes.parts}
    out |= {f"law {part.name}": part.law for part in test.volumes.parts}
    for s in test.stations:
        out |= {f"camera {s.name}": s.camera, f"pose {s.name}": s.cam_from_tunnel, f"cov {s.name}": s.pose_cov}
    return {name: value for name, value in out.items() if value is not None}


def made_with(
    project: DeformProject, wind_off: Mapping[str, FrameImages], read: Iterable[Path] = ()
) -> dict[str, Any]:
    """See `same_run.made_with`; where the results go is left out.

    Every frame is relative to the wind-off ones: their pictures count wherever they are in the sequence. ``read``: all
    files that the project was loaded from, see `Loaded`.
    """
    options = json.loads(project.model_dump_json(exclude={"path": True, "output": {"folder"}, "watch": True}))
    said = {f"[{k}] of the project": v for k, v in options.items()}
    files = same_run.with_all(inputs(project), read, project.path)
    return same_run.made_with("deform", said | prints_of(wind_off), files)


def prints_of(wind_off: Mapping[str, FrameImages]) -> dict[str, Any]:
    """What the pictures of the wind-off frames are called in messages -> `pictures_of` them."""
    return {f"a picture of the wind-off frame {key}": pictures_of(frame) for key, frame in wind_off.items()}


def inputs(project: DeformProject) -> list[tuple[str, Path]]:
    """The files besides pictures that a project names, each with its key."""
    out: list[tuple[str, Path | None]] = [
        ("markers.file", project.markers.file),
        ("sequence.frames", project.sequence.frames),
    ]
    out.append(("grid.file", None if project.grid is None else project.grid.file))
    for camera in project.camera:
        times = None if camera.times == RECORDING else camera.times
        out += [
            (f"camera {camera.name}: {k}", p)
            for k, p in (("file", camera.file), ("mask", camera.mask), ("times", times))
        ]
    for volume in project.volume:
        tables = [str(volume.options["table"])] if "table" in volume.options else []
        tables += [f"{volume.law.partition('.py')[0]}.py"] if volume.law is not None and ".py" in volume.law else []
        out += [(f"volume {volume.name}: {name}", (project.path.parent / name).resolve()) for name in tables]
    out += [(f"points {p.label}: file", p.file) for p in project.points]
    return [(key, path) for key, path in out if path is not None]


def pictures_of(frame: FrameImages) -> dict[str, str]:
    """Camera -> `same_run.picture_print` of its pictures of an instant."""
    out = {}
    for name, image in frame.images.items():
        shots = [shot.image for shot in frame.shots.get(name, ())]
        out[name] = " ".join(same_run.picture_print(i) for i in (image, *shots) if isinstance(i, io.PictureFile))
    return out


def check_tables(folder: Path, kept: Kept) -> None:
    """See that the tables are as they were behind a frame: a spreadsheet saves them with other signs and line ends.

    Raises
    ------
    FileError
        For the first one that is not.
    """
    for name, size in kept.sizes.items():
        crc, left = 0, size
        with reading(folder / name), open(folder / name, "rb") as stream:
            while left and (content := stream.read(min(left, READ_BYTES))):
                crc, left = zlib.crc32(content, crc), left - len(content)
        if left or crc != kept.crcs[name]:
            raise io.FileError(folder / name, "was changed since the run was stopped; expected it as it was left")


def states_of(frames: Iterable[Kept]) -> dict[tuple[str, str], tuple[int, int]]:
    """Camera and name of the pictures of a live run -> size and date, see `Watch.prints`."""
    out = {}
    for kept in frames:
        for camera, text in kept.pictures.items():
            name, size, date = text.rsplit(":", 2)
            out[camera, name] = int(size), int(date)
    return out


ARRIVALS = "arrivals.csv"


def files_told(folder: Path, size: int | None = None) -> list[tuple[tuple[str, str], str]]:
    """Camera and name of the files in the table of arrivals, in its first bytes or all, and what became of each."""
    with reading(folder / ARRIVALS):
        text = (folder / ARRIVALS).read_bytes()[:size].decode()
    return [((row["camera"], row["file"]), row["fate"]) for row in csv.DictReader(text.splitlines())]
