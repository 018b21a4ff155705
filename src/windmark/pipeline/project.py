"""The project file: one TOML that names cameras, images, markers, grid and what is wanted.

Every key is checked before any work starts; an error names the file, the key and what was expected.
Paths are relative to the project file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from glob import has_magic
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from windmark.errors import UsageError
from windmark.io import FileError, frame_address, picture_name
from windmark.io.recordings.folder import picture_files
from windmark.options.detection import (
    BAYER,
    CHANNEL,
    MERIT_MAX,
    PHOTOMETRY,
    POLARITY_OR_AUTO,
    RADIUS_PX,
    REFINE,
    Bayer,
    Channel,
    Photometry,
    PolarityOrAuto,
    Refine,
)
from windmark.options.registration import (
    BINDING,
    FREE_FOCAL,
    LABEL_DISTANCE_PX,
    MAX_DEFORMATION,
    MAX_TABLE_ERROR,
    MAX_TIME_S,
    METHOD,
    OCCLUSION,
    PRIOR_MAX_ANGLE_DEG,
    PRIOR_MAX_SCALE,
    SEED,
    TOLERANCE_PX,
    Method,
)
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.quantity import Quantity
from windmark.pipeline.rig_settings import RigOptions, check_rig, instants, rig_cameras
from windmark.pipeline.settings import Strict, existing, existing_picture, explained, ranged, read_toml, unusable_name
from windmark.pipeline.wanted import LineEntry, MergeOptions, PointsEntry, check_merge

Finite = Annotated[float, Field(allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]
Place = tuple[float, float]
Unit = Literal["in", "ft", "mm", "cm", "m"]
NodeFormat = Literal["vtk", "tecplot", "plot3d", "csv", "netcdf"]
Role = Literal["model", "wall", "primary", "secondary", "tap", "virtual", "fiducial"]
Positive = Annotated[float, Field(gt=0)]


class CameraEntry(Strict):
    """One camera: its interior parameters.

    ``pose = "find"``: a pose in the file is only compared with, never used as a start.
    ``pose = "known"``: the pose in the file is taken as it is and nothing is matched.
    """

    name: str = "camera"
    file: Path
    pose: Literal["find", "known"] = "find"


class ImageEntry(Strict):
    """One image, or a frame of a recording: ``file = "run.cine[120]"``, or ``page`` of a multipage TIFF. A pattern,
    ``file = "img*.tif"``, stands for every picture that it matches.

    ``channel``: of a colour picture; grey is a weighted sum. ``bayer``: the file is a colour sensor's raw mosaic.
    ``quantity``, ``unit``: what the values are, such as "temperature" in "K"; None: what the file says, else grey.
    ``scale``, ``offset``: value = offset + scale * grey level, before anything is sampled.
    ``labels``: marker name -> (x, y) of its spot, which the registration must keep; ``exclude``: (x, y) of spots that
    take no part. The spot nearest to such a place is meant, at most ``register.label_distance_px`` away.
    ``point``: of the test (a time, a step of a polar): images of the same point are merged; with a ``[rig]`` they
    are of one instant.
    """

    file: Path
    name: str | None = None
    camera: str | None = None
    page: Annotated[int, Field(ge=0)] | None = None
    channel: Channel = CHANNEL.default
    bayer: Bayer | None = BAYER.default
    quantity: Literal["grey", "radiance", "temperature"] | None = None
    unit: str | None = None
    scale: Annotated[float, Field(allow_inf_nan=False)] = 1.0
    offset: Annotated[float, Field(allow_inf_nan=False)] = 0.0
    labels: dict[str, Place] = Field(default_factory=dict)
    exclude: tuple[Place, ...] = ()
    point: str | None = None

    @model_validator(mode="after")
    def _quantity(self) -> ImageEntry:
        if self.quantity is None and self.unit is not None:
            raise UsageError(f'unit {self.unit!r} without quantity; expected "temperature" or "radiance" there')
        Quantity(self.quantity or "grey", self.unit or "", self.scale, self.offset)
        return self

    @property
    def label(self) -> str:
        """Name of the image in results and of its folder."""
        return self.name or picture_name(self.file)


class MarkersEntry(Strict):
    """The markers' table; only the given roles are matched. Where the model moved, leave the walls out."""

    file: Path
    roles: Annotated[tuple[Role, ...], Field(min_length=1)] = ("model", "wall", "primary", "secondary")


class GridEntry(Strict):
    """The surface grid.

    ``volumes``: the model's parts, each with the zones (blocks, or volumes of the file) it is made of; zones
    that are not named do not belong to the job (walls do not move with the model). All zones by default.
    ``walls``: "leave_out" leaves out those that bear markers of role wall and none of the model; "keep" all. Alignment
    leaves them out in any case.
    ``orientation``: "auto" turns the triangles to the air: the side that the cameras see, the outside of a body and
    the inside of walls (see `windmark.orient_outward`); "file" takes them as they are. ``volume_face``: of a file with
    volume blocks, the face that is the surface.
    """

    file: Path
    volumes: dict[str, tuple[str, ...]] | None = None
    orientation: Literal["auto", "file"] = "auto"
    volume_face: Literal["imin", "imax", "jmin", "jmax", "kmin", "kmax"] | None = None
    walls: Literal["keep", "leave_out"] = "keep"

    @model_validator(mode="after")
    def _each_zone_once(self) -> GridEntry:
        zones = [zone for zones in (self.volumes or {}).values() for zone in zones]
        double = sorted({z for z in zones if zones.count(z) > 1})
        if double:
            raise UsageError(f"volumes: a zone belongs to one volume, given more than once: {', '.join(double)}")
        empty = [name for name, zones in (self.volumes or {}).items() if not zones]
        if empty or self.volumes == {}:
            raise UsageError(f"volumes: {', '.join(empty) or 'none given'}; expected at least one zone in each")
        return self


class DetectOptions(Strict):
    """Options of `windmark.detect`.

    ``radius_px``: without it each image's own estimate is taken, and said. ``mask``: a picture of the images' size, of
    which only pixels that are not 0 are used, or a table of polygons (see `io.read_mask`).
    """

    radius_px: Positive | Annotated[tuple[Positive, ...], Field(min_length=1)] | None = RADIUS_PX.default
    polarity: PolarityOrAuto = POLARITY_OR_AUTO.default
    merit_max: Annotated[float, ranged(MERIT_MAX)] = MERIT_MAX.default
    refine: Refine = REFINE.default
    photometry: Photometry | None = PHOTOMETRY.default
    mask: Path | None = None


class RegisterOptions(Strict):
    """Options of `windmark.register`. ``prior``: a camera file whose pose the solution must be near to.

    ``method``: "hash" looks up how neighbouring markers can look, "ransac" is the paper's search (section III.C).
    ``occlusion``: markers that the grid hides are neither expected nor matched.
    ``max_table_error``: as part of the distance between markers; larger for a rough table. ``max_deformation``: as part
    of the model's size. ``binding``: the images' labels are facts, which no other solution is compared with.
    """

    method: Method = METHOD.default
    prior: Path | None = None
    prior_max_angle_deg: Annotated[float, ranged(PRIOR_MAX_ANGLE_DEG)] = PRIOR_MAX_ANGLE_DEG.default
    prior_max_scale: Annotated[float, ranged(PRIOR_MAX_SCALE)] = PRIOR_MAX_SCALE.default
    tolerance_px: Annotated[float, ranged(TOLERANCE_PX)] | None = TOLERANCE_PX.default
    free_focal: bool = FREE_FOCAL.default
    seed: int = SEED.default
    max_time_s: Annotated[float, ranged(MAX_TIME_S)] | None = MAX_TIME_S.default
    max_table_error: Annotated[float, ranged(MAX_TABLE_ERROR)] = MAX_TABLE_ERROR.default
    max_deformation: Annotated[float, ranged(MAX_DEFORMATION)] = MAX_DEFORMATION.default
    label_distance_px: Annotated[float, ranged(LABEL_DISTANCE_PX)] = LABEL_DISTANCE_PX.default
    binding: bool = BINDING.default
    occlusion: bool = OCCLUSION.default


class ResectOptions(Strict):
    """How values are taken from the image."""

    max_obliquity_deg: Annotated[float, Field(gt=0, le=90)] = 80.0
    interpolation: Literal["linear", "cubic"] = "cubic"


class PovEntry(Strict):
    """The paper's point of view (see docs/conventions.md): angles in degrees, distances in the length unit."""

    rx_deg: Finite
    ry_deg: Finite
    rz_deg: Finite
    dx: Finite
    dy: Finite
    dz: Finite


class ViewEntry(Strict):
    """A virtual image, the same for all images and cameras of the job. Its point of view is given in one of three ways.

    - ``direction`` (model frame) and ``up`` (which points to the top): framed on all nodes of the grid that take part,
      or on those of ``volumes``, whatever the images show of them.
    - ``pov``: the paper's numbers, with ``fov_deg``.
    - ``camera``: a camera file with a pose; its lens and size, unless ``size_px`` or ``fov_deg`` are given: then a
      perfect camera of this size and field of view (its own by default) in the same place.
    """

    name: str
    direction: Vector | None = None
    up: Vector | None = None
    volumes: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    pov: PovEntry | None = None
    camera: Path | None = None
    size_px: tuple[Annotated[int, Field(gt=0, le=20000)], Annotated[int, Field(gt=0, le=20000)]] | None = None
    fov_deg: Annotated[float, Field(gt=0, lt=170)] | None = None

    @model_validator(mode="after")
    def _one_way(self) -> ViewEntry:
        by = [k for k in ("direction", "pov", "camera") if getattr(self, k) is not None]
        if len(by) != 1:
            raise UsageError(
                f"view {self.name}: expected one of direction (with up), pov, camera; got {', '.join(by) or 'none'}"
            )
        if (self.up is None) == (by == ["direction"]):
            raise UsageError(f"view {self.name}: direction and up belong together")
        if self.direction is not None and self.up is not None and _parallel(self.direction, self.up):
            raise UsageError(f"view {self.name}: up is parallel to direction, or one of them is zero")
        if self.volumes is not None and self.direction is None:
            raise UsageError(f"view {self.name}: volumes say what a view by direction is framed on")
        if self.pov is not None and self.fov_deg is None:
            raise UsageError(f"view {self.name}: fov_deg is missing; a point of view needs a field of view")
        return self


def _parallel(a: Vector, b: Vector) -> bool:
    """As `Pose.look_at` has it."""
    across = math.hypot(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    return across <= 1e-12 * math.hypot(*a) * math.hypot(*b)


class SectionEntry(Strict):
    """A cut of the surface by a plane: values along the line, every `spacing` length units or at each grid line."""

    name: str
    point: Vector
    normal: Vector
    spacing: Positive | None = None


class AlignOptions(Strict):
    """3D alignment: every image is recomputed as if taken from the reference image's pose.

    What the grid's volumes say moves; all else stays. ``background``: pixels that show none of it in the reference
    image are "blank" (NaN), or, for images of one camera that stands still, "keep" the image's own grey level, but
    for those that the model hides in that image (NaN).
    """

    reference: str
    background: Literal["blank", "keep"] = "blank"


class OutputOptions(Strict):
    """What is written, and where. ``nodes``: formats of the node values, by default all that the grid allows.

    ``pixels``: also the surface point behind every pixel of each image (NetCDF).
    """

    folder: Path = Path("results")
    nodes: tuple[NodeFormat, ...] | None = None
    pixels: bool = False


class Project(Strict):
    """A whole job. `path` is the project file; other paths are already absolute."""

    path: Path
    title: str
    length_unit: Unit
    camera: Annotated[tuple[CameraEntry, ...], Field(min_length=1)]
    rig: RigOptions | None = None
    image: Annotated[tuple[ImageEntry, ...], Field(min_length=1)]
    markers: MarkersEntry | None = None
    grid: GridEntry | None = None
    detect: DetectOptions | None = None
    register_: RegisterOptions = Field(default_factory=RegisterOptions, alias="register")
    resect: ResectOptions = Field(default_factory=ResectOptions)
    view: tuple[ViewEntry, ...] = ()
    section: tuple[SectionEntry, ...] = ()
    points: tuple[PointsEntry, ...] = ()
    line: tuple[LineEntry, ...] = ()
    merge: MergeOptions | None = None
    align: AlignOptions | None = None
    output: OutputOptions = Field(default_factory=OutputOptions)

    @model_validator(mode="after")
    def _consistent(self) -> Project:
        for kind, names in (
            ("camera", [c.name for c in self.camera]),
            ("image", [i.label for i in self.image]),
            ("view", [v.name for v in self.view]),
            ("section", [s.name for s in self.section]),
            ("points", [p.label for p in self.points]),
            ("line", [n.name for n in self.line]),
            ("point", list(dict.fromkeys(i.point for i in self.image if i.point is not None))),
        ):
            double = sorted({n for n in names if names.count(n) > 1})
            if double:
                raise UsageError(f"{kind} names must be unique, more than once: {', '.join(double)}")
            if (why := unusable_name(names)) is not None:
                raise UsageError(f"{kind} names become file names, and {why}")
        cameras = [c.name for c in self.camera]
        for image in self.image:
            if image.camera is None and len(cameras) > 1:
                raise UsageError(f"image {image.label}: say which camera took it, one of {', '.join(cameras)}")
            if image.camera is not None and image.camera not in cameras:
                raise UsageError(f"image {image.label}: camera {image.camera!r} is not one of {', '.join(cameras)}")
        if any(c.pose == "find" for c in self.camera):
            missing = [name for name in ("markers", "detect") if getattr(self, name) is None]
            if missing:
                raise UsageError(f"[{missing[0]}] is missing: the cameras' poses are found from markers in the images")
        if self.rig is not None:
            found = [c.name for c in self.camera if c.pose == "find"]
            known = [c.name for c in self.camera if c.pose == "known"]
            check_rig(self.rig, found, known, self._taken())
        if self.register_.binding and not any(i.labels for i in self.image):
            raise UsageError("register: binding says that labels are facts, but no image has labels")
        if self.align and self.align.reference not in [i.label for i in self.image]:
            raise UsageError(f"align: reference {self.align.reference!r} is not the name of an image")
        if self.align and self.align.background == "keep" and len({self.camera_of(i).name for i in self.image}) > 1:
            raise UsageError('align: background = "keep" needs images of one camera; these are of several')
        if self.align and len({(i.quantity, i.unit) for i in self.image}) > 1:
            raise UsageError("align: all images must have the same quantity and unit, for they are subtracted")
        if self.grid is None and (self.view or self.section or self.align or self.points or self.line):
            raise UsageError("views, sections, points, lines and alignment need a grid: add [grid] file = ...")
        if self.merge is not None:
            check_merge(self.merge, self._taken(), bool(self.grid))
            taken = sorted({"merged", *(f"merged-{i.point}" for i in self.image)} & {i.label for i in self.image})
            if taken:
                raise UsageError(f"merge: its folder {taken[0]} has the name of an image; name the image otherwise")
        return self

    @property
    def lengths(self) -> Lengths:
        """What reads its files: their lengths are in its unit."""
        return Lengths.of_project(self.path, self.length_unit)

    def camera_of(self, image: ImageEntry) -> CameraEntry:
        """The camera that took an image."""
        return next(c for c in self.camera if image.camera in (None, c.name))

    def _taken(self) -> list[tuple[str, str | None, str]]:
        """Name, point and camera of every image."""
        return [(i.label, i.point, self.camera_of(i).name) for i in self.image]

    @property
    def rig_cameras(self) -> tuple[str, ...]:
        """The cameras of the rig; none without one."""
        return rig_cameras(self.rig, [c.name for c in self.camera if c.pose == "find"])

    @property
    def instants(self) -> tuple[tuple[ImageEntry, ...], ...]:
        """Images that cameras of the rig took at the same instant, two and more of each."""
        of_label = {i.label: i for i in self.image}
        groups = instants(self.rig, [c.name for c in self.camera if c.pose == "find"], self._taken()).values()
        return tuple(tuple(of_label[name] for name, _ in group) for group in groups if len(group) > 1)


def read_project(path: str | Path, given: Mapping[str, Mapping[str, Any]] | None = None) -> Project:
    """Read and check a project file.

    Parameters
    ----------
    path : the TOML file
    given : tables whose keys replace those of the file

    Raises
    ------
    FileError
        When the file is missing, no TOML, has an unknown or wrong key, or names a file that is absent.
    """
    path = Path(path)
    data = with_pictures(path, read_toml(path, Project))
    for table, keys in (given or {}).items():
        if isinstance(data.setdefault(table, {}), dict):
            data[table] |= keys
    return make_project(path, data)


def with_pictures(path: Path, data: dict[str, Any]) -> dict[str, Any]:
    """Settings with a table for each picture of ``[[image]] file = "img*.tif"``, in natural order.

    Raises
    ------
    FileError
        For a pattern that no picture matches, and for a name or labels beside one that several match.
    """
    images = data.get("image")
    if not isinstance(images, list):
        return data
    return {**data, "image": [one for n, entry in enumerate(images) for one in pictures_of(path, n, entry)]}


def pictures_of(path: Path, number: int, entry: Any) -> list[Any]:
    """The tables of one ``[[image]]``, several where its file is a pattern; see `with_pictures`."""
    file = entry.get("file") if isinstance(entry, dict) else None
    if not isinstance(file, str) or not has_magic(file):
        return [entry]
    full = path.parent / file
    if frame_address(full).number is not None or full.exists():
        return [entry]
    found = picture_files(full)
    alone = [key for key in ("name", "labels", "exclude", "page") if key in entry]
    if len(found) > 1 and alone:
        raise FileError(path, f"is of one picture, the pattern is of {len(found)}", f"image[{number}].{alone[0]}")
    stems = [p.stem for p in found]
    double = {stem for stem in stems if stems.count(stem) > 1}
    names = [{"name": f"{p.parent.name}-{p.stem}"} if p.stem in double else {} for p in found]
    return [{**entry, "file": str(p), **name} for p, name in zip(found, names, strict=True)]


def make_project(path: Path, settings: Mapping[str, Any]) -> Project:
    """A checked project from the settings that a project file would hold; ``path`` gives the base of its paths."""
    try:
        project = Project(path=path.resolve(), **settings)
    except ValidationError as error:
        raise explained(path, error, Project) from None
    return _with_absolute_paths(project)


def _with_absolute_paths(project: Project) -> Project:
    base = project.path.parent
    register = project.register_
    if register.prior is not None:
        register = register.model_copy(update={"prior": existing(project.path, "register.prior", register.prior)})

    rig = project.rig
    if rig is not None and rig.file is not None:
        rig = rig.model_copy(update={"file": existing(project.path, "rig.file", rig.file)})

    detect = project.detect
    if detect is not None and detect.mask is not None:
        detect = detect.model_copy(update={"mask": existing_picture(project.path, "detect.mask", detect.mask)})

    def moved(key: str, entry: Strict) -> Strict:
        return entry.model_copy(update={"file": existing(project.path, f"{key}.file", entry.file)})  # type: ignore[attr-defined]

    def found(i: int, entry: ImageEntry) -> ImageEntry:
        return entry.model_copy(update={"file": existing_picture(project.path, f"image[{i}].file", entry.file)})

    def located(key: str, view: ViewEntry) -> ViewEntry:
        if view.camera is None:
            return view
        return view.model_copy(update={"camera": existing(project.path, f"{key}.camera", view.camera)})

    return project.model_copy(
        update={
            "view": tuple(located(f"view[{i}]", v) for i, v in enumerate(project.view)),
            "camera": tuple(moved(f"camera[{i}]", c) for i, c in enumerate(project.camera)),
            "image": tuple(found(i, c) for i, c in enumerate(project.image)),
            "markers": moved("markers", project.markers) if project.markers else None,
            "points": tuple(moved(f"points[{i}]", p) for i, p in enumerate(project.points)),
            "grid": moved("grid", project.grid) if project.grid else None,
            "register_": register,
            "rig": rig,
            "detect": detect,
            "output": project.output.model_copy(update={"folder": (base / project.output.folder).resolve()}),
        }
    )
