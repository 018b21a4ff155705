"""What `pipeline.resume` keeps of a deformation test: its frames, what it is made with, what its frames share."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from windmark import io
from windmark.deformation import Deformation
from windmark.io.errors import reading
from windmark.pipeline import same_run
from windmark.pipeline.deform.project import RECORDING, DeformProject
from windmark.pipeline.deform.record import FrameRecord
from windmark.tasks.deform.task import DeformationTest, DeformedFrame, FrameImages


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
    pictures : camera -> its pictures' name, size and checksum
    sizes : table -> its length in bytes
    """

    row: FrameRecord
    state: Deformation | None
    compared: tuple[DeformedFrame, FrameImages | None] | None
    pictured: tuple[DeformedFrame, FrameImages | None] | None
    pictures: Mapping[str, str]
    sizes: Mapping[str, int]

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


def made_with(project: DeformProject) -> dict[str, Any]:
    """See `same_run.made_with`; where the results go is left out."""
    options = json.loads(project.model_dump_json(exclude={"path": True, "output": {"folder"}, "watch": True}))
    return same_run.made_with("deform", {f"[{k}] of the project": v for k, v in options.items()}, inputs(project))


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


def files_told(folder: Path, sizes: Mapping[str, int]) -> dict[tuple[str, str], str]:
    """Camera and name of the files that the table of arrivals has -> what became of them."""
    name = "arrivals.csv"
    if name not in sizes:
        return {}
    with reading(folder / name):
        text = (folder / name).read_bytes()[: sizes[name]].decode()
    return {(row["camera"], row["file"]): row["fate"] for row in csv.DictReader(text.splitlines())}
