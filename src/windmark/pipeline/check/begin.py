"""A project begun as its verb begins it: everything is read and put together, no picture is looked at.

What the verb would refuse at once is so refused by `windmark check`, whatever it is; the settings alone do not show
that a volume has no marker, a law no such option, or a section misses the grid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Protocol

from windmark import resection
from windmark.io.errors import FileError
from windmark.pipeline.deform.frames import instants_of, read_frame_table
from windmark.pipeline.deform.load import load
from windmark.pipeline.deform.project import read_deform_project
from windmark.pipeline.deform.wind_off import wind_off_frames
from windmark.pipeline.infrared import load_infrared, read_infrared_project
from windmark.pipeline.job import begin
from windmark.pipeline.project import read_project
from windmark.pipeline.psp import load_psp, read_psp_project
from windmark.pipeline.verdict.table import hinge_words
from windmark.scene import Mesh
from windmark.tasks.deform.hinges import exchanged_hinges
from windmark.tasks.psp.cuts import surface_of

Vector = tuple[float, float, float]


class Cut(Protocol):
    """A wanted section."""

    name: str
    point: Vector
    normal: Vector


def begun(kind: str, path: Path) -> Iterator[FileError]:
    """What the verb ``kind`` has against the project at ``path`` before it looks at a picture.

    Raises
    ------
    FileError
        The first thing that it refuses.
    """
    yield from _BEGIN[kind](path)


def _run(path: Path) -> Iterator[FileError]:
    project = read_project(path)
    mesh = begin(project).inputs.mesh
    if mesh is not None:
        yield from _missed(path, project.section, lambda _: mesh)


def _deform(path: Path) -> Iterator[FileError]:
    project = read_deform_project(path)
    try:
        test = load(project).test
    except FileError as error:
        yield error
    else:
        names = [entry.name for entry in project.volume]
        for volume, other in exchanged_hinges(test.markers, test.volumes).items():
            yield FileError(path, hinge_words(volume, other), f"volume[{names.index(volume)}].options")
    try:  # either says nothing of the other
        read_frame_table(project)
        wind_off_frames(project, instants_of(project))
    except FileError as error:
        yield error


def _psp(path: Path) -> Iterator[FileError]:
    test = load_psp(read_psp_project(path))
    volumes = {s.name: s.volume for s in test.project.section}
    yield from _missed(path, test.project.section, lambda name: surface_of(test.mesh, volumes[name]))


def _infrared(path: Path) -> Iterator[FileError]:
    run = load_infrared(read_infrared_project(path))
    wind_off_frames(run.deforming.project, run.timeline)
    yield from ()


def _missed(path: Path, cuts: Sequence[Cut], surface: Callable[[str], Mesh]) -> Iterator[FileError]:
    """Sections whose plane does not meet the surface."""
    for k, cut in enumerate(cuts):
        if not len(resection.section(surface(cut.name), cut.point, cut.normal)):
            yield FileError(path, f"section {cut.name}: the plane does not meet the grid; check its point and normal",
                            f"section[{k}]")  # fmt: skip


_BEGIN: dict[str, Callable[[Path], Iterator[FileError]]] = {
    "run": _run, "deform": _deform, "psp": _psp, "infrared": _infrared,
}  # fmt: skip
