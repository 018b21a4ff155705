"""From a project file to a test: cameras, markers and laws are read and checked before any image is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.deformation import Law, LawError, Stations, Volume, Volumes, check_law, laws_of_source, with_parameters
from windmark.deformation.laws.catalog import CATALOG, make_law
from windmark.errors import WindmarkError, g3
from windmark.geometry import Camera, Pose
from windmark.io.errors import note_read, noted, reading
from windmark.pipeline.deform.entries import CameraEntry, VolumeEntry, no_law
from windmark.pipeline.deform.imported import imported_files
from windmark.pipeline.deform.project import DeformProject
from windmark.pipeline.grid import oriented, read_surface, sides_words, with_curvature
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.points import PointSet, lists_on_grid
from windmark.pipeline.walls import wall_volumes, walls_note, without
from windmark.scene import MarkerSet, Mesh
from windmark.scene.units import spelt
from windmark.tasks.deform.task import DeformationTest, LookOptions, Station
from windmark.tasks.likely_unit import likely_unit
from windmark.tasks.sight import sight

Array = NDArray[np.float64]


WHERE_IT_STANDS = "where the camera stands (cam_from_tunnel), such as windmark register or calibrate write it"
"""What a camera's file must say whose pose is not found anew in every picture."""

FARTHEST = 3.0
"""A station that is so many times the extent of its part's markers beyond them is a mistake in its coordinates."""


@dataclass(frozen=True)
class Loaded:
    """A project with everything it names.

    Parameters
    ----------
    project : the settings
    test : what `follow_deformation` wants
    mesh : the grid; None without one
    stations : where twist and bending are reported; None without
    remarks : what is odd but no error
    read : the files that all this was read from
    places : lists of points on the grid at which values are wanted
    """

    project: DeformProject
    test: DeformationTest
    mesh: Mesh | None
    stations: Stations | None
    remarks: tuple[str, ...]
    read: tuple[Path, ...] = ()
    places: tuple[PointSet, ...] = ()


def load(project: DeformProject) -> Loaded:
    """Read everything that a project names.

    Raises
    ------
    FileError
        Naming the project's key, or the file, that is wrong.
    """
    with noted() as read:
        out = _load(project)
    return replace(out, read=tuple(sorted(map(Path, read))))


def _load(project: DeformProject) -> Loaded:
    lengths = project.lengths
    markers = lengths.markers(project.markers.file, project.markers.roles)
    rig = tuple(_station(project, i, c, lengths) for i, c in enumerate(project.camera))
    # The grid is that of the model where it stands without load: near enough to know which side the cameras see.
    posed = [(s.camera, s.cam_from_tunnel) for s in rig]
    mesh, walls = _grid(project, posed, lengths)
    markers = with_curvature(markers, mesh)
    volumes, remarks = volumes_of(project, markers)
    remarks += walls
    remarks += [f"{c.file}: {note}" for c in project.camera if (note := lengths.camera(c.file).note)]
    remarks += [f"{path}: {text}" for path, text in lengths.notes()]
    stations = None
    if project.stations is not None:
        given = project.stations
        try:
            stations = Stations.along(
                given.start, given.end, given.count, volume=given.volume, chord=given.chord, up=given.up
            )
        except WindmarkError as error:
            raise io.FileError(project.path, str(error).removeprefix("stations: "), "stations") from None
        own = markers.xyz[(markers.volume == stations.volume) & (markers.role != "wall")]
        if len(own):
            _check_place(project, own, stations)
            _check_moves(project, own, volumes, stations)
        _check_tip(project, volumes, stations)
    look = project.look
    radius = (look.radius_px,) if isinstance(look.radius_px, float) else look.radius_px
    options = LookOptions(
        radius, look.polarity, look.merit_max, look.photometry, look.max_time_s, look.max_table_error,
        look.max_deformation, look.seed,
    )  # fmt: skip
    test = DeformationTest(
        rig, markers, volumes, project.motion.free,
        sight(markers, mesh) if mesh is not None and look.occlusion else None, None, options,
    )  # fmt: skip
    places = () if mesh is None else lists_on_grid(project.points, lengths, mesh)
    return Loaded(project, test, mesh, stations, tuple(remarks), places=places)


def _check_place(project: DeformProject, own: Array, stations: Stations) -> None:
    """Stations that lie where the part's markers are only in another unit, or nowhere near them."""
    places, unit = stations.middle, project.length_unit
    units, _ = likely_unit(places, (own.min(axis=0), own.max(axis=0)), unit)
    if units:
        far = [f"{g3(np.linalg.norm(np.ptp(p, axis=0)))} {unit}" for p in (places, own)]
        words = f"the stations span {far[0]}, the markers of {stations.volume} {far[1]}: they are rather in "
        raise io.FileError(project.path, words + spelt(units[0]), "stations.start")
    beyond = np.linalg.norm(np.maximum(np.maximum(own.min(axis=0) - places, places - own.max(axis=0)), 0.0), axis=1)
    extent = float(np.linalg.norm(np.ptp(own, axis=0)))
    if beyond.max() > FARTHEST * extent:
        words = (f"a station lies {g3(beyond.max())} {unit} beyond the markers of {stations.volume}, which span "
                 f"{g3(extent)} {unit}: no law is measured there; expected start and end on the part")  # fmt: skip
        raise io.FileError(project.path, words, "stations.end" if beyond[-1] == beyond.max() else "stations.start")


def _reach(volumes: Volumes, xyz: Array, volume: str) -> Array:
    """(N,) how far one unit of some parameter moves points of a volume, near the start."""
    by_q = volumes.bind(xyz, volume).linearise(volumes.start)[1]
    return np.asarray(np.linalg.norm(by_q, axis=1).max(axis=1, initial=0.0))


def _check_moves(project: DeformProject, own: Array, volumes: Volumes, stations: Stations) -> None:
    """A law that moves the part's markers ``own`` moves stations, too."""
    of_markers = _reach(volumes, own, stations.volume).max()
    if of_markers > 0 and not _reach(volumes, stations.middle, stations.volume).max() > 1e-9 * of_markers:
        words = (f"the law of {stations.volume} moves its markers but none of the stations: start and end are in "
                 "another unit, or lie beside the part")  # fmt: skip
        raise io.FileError(project.path, words, "stations.start")


def _check_tip(project: DeformProject, volumes: Volumes, stations: Stations) -> None:
    """The last station is reported as the tip: no law that moves the others may leave it where it is."""
    reach = _reach(volumes, stations.middle, stations.volume)
    if reach.max() > 0 and not reach[-1] > 1e-9 * reach.max():
        words = (f"the law of {stations.volume} moves other stations but not the last one, which is reported as the "
                 "tip: start and end are exchanged, or end lies beside the part")  # fmt: skip
        raise io.FileError(project.path, words, "stations.end")


def _grid(
    project: DeformProject, posed: Sequence[tuple[Camera, Pose]], lengths: Lengths
) -> tuple[Mesh | None, list[str]]:
    """The grid, and what is said of it."""
    if project.grid is None:
        return None, []
    file = read_surface(project.grid, lengths)
    mesh = oriented(file, project.grid, posed)
    said = [f"{project.grid.file}: {words}" for words in sides_words(file, mesh, project.grid)]
    if project.grid.walls == "keep":
        return mesh, said
    walls = wall_volumes(project.markers.file, project.grid, mesh, lengths)
    return without(mesh, walls), said + ([f"{project.grid.file}: {walls_note(walls, 'the grid')}"] if walls else [])


def _station(project: DeformProject, i: int, entry: CameraEntry, lengths: Lengths) -> Station:
    content = lengths.camera(entry.file)
    camera, pose = content.camera, content.cam_from_model
    if pose is None:
        raise io.FileError(
            entry.file, f"has no pose; expected {WHERE_IT_STANDS}", f"camera[{i}].file",
        )  # fmt: skip
    cov = None
    if entry.pose_sigma is not None and entry.pose_sigma_deg is not None:
        cov = _pose_cov(pose, np.radians(entry.pose_sigma_deg), entry.pose_sigma)
    mask = None if entry.mask is None else io.read_mask(entry.mask, camera.size_px[::-1])
    return Station(entry.name, camera, pose, entry.moves, cov, entry.free_focal, mask)


def _pose_cov(pose: Pose, turn: float, shift: float) -> Array:
    """(6, 6) for ``exp(delta) @ pose``, the camera turning about its own centre, so that its shift is independent."""
    return np.diag([turn**2] * 3 + [shift**2] * 3)


def volumes_of(project: DeformProject, markers: MarkerSet) -> tuple[Volumes, list[str]]:
    """The volumes of a project with their laws, and what is odd about these; FileError where one cannot be made."""
    parts: list[Volume] = []
    remarks: list[str] = []
    for i, entry in enumerate(project.volume):
        key = f"volume[{i}]"
        points = markers.xyz[(markers.volume == entry.name) & (markers.role != "wall")]
        try:
            law = None if entry.law is None else _law(project, entry, points)
            if law is not None and entry.parameters:
                law = with_parameters(law, entry.parameters)
            if law is not None and len(points):
                remarks += check_law(law, points, name=entry.law or "")
        except LawError as error:
            raise io.FileError(project.path, str(error), f"{key}.law") from None
        if law is not None and not len(points):
            known = ", ".join(sorted(set(markers.volume[markers.role != "wall"].tolist())))
            raise io.FileError(
                project.path, f"no marker belongs to volume {entry.name!r}; the table has {known}", f"{key}.name"
            )
        try:
            parts.append(Volume(entry.name, law, entry.parent, entry.attach))
        except WindmarkError as error:
            raise io.FileError(project.path, str(error), key) from None
    try:
        return Volumes.of(parts, project.length_unit), remarks
    except WindmarkError as error:
        raise io.FileError(project.path, str(error), "volume") from None


def _law(project: DeformProject, entry: VolumeEntry, points: Array) -> Law:
    """A built-in law, or one of a user's file."""
    assert entry.law is not None
    if entry.law in CATALOG:
        table = None
        if "table" in entry.options:
            file = _beside(project, Path(str(entry.options["table"])))
            table = io.read_modes(file)
            project.lengths.agree(file, io.read_marker_unit(file))
        return make_law(entry.law, entry.options, unit=project.length_unit, points=points, table=table)
    if why := no_law(entry.law):  # of another law, which the project does not name
        raise LawError(why)
    name, _, which = entry.law.partition(".py")
    file = _beside(project, Path(f"{name}.py"))
    with reading(file):
        text = file.read_text(encoding="utf-8")
    laws = laws_of_source(text, str(file))
    for other in imported_files(text):
        note_read(other)
    which = which.removeprefix(":")
    if not which and len(laws) > 1:
        raise LawError(f"{file}: holds {', '.join(laws)}; say which, {name}.py:NAME")
    if which and which not in laws:
        raise LawError(f"{file}: holds no law {which}; it has {', '.join(laws)}")
    return laws[which or next(iter(laws))].with_options(entry.options)


def _beside(project: DeformProject, path: Path) -> Path:
    return (project.path.parent / path).resolve()
