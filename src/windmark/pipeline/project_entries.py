"""The tables of a project file: cameras, pictures, markers, grid, what is wanted, and the options of each step."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from windmark.errors import UsageError
from windmark.io import picture_name
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
from windmark.pipeline.quantity import Quantity
from windmark.pipeline.settings import Strict, ranged

Finite = Annotated[float, Field(allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]


def _pointing(vector: Vector) -> Vector:
    if not any(vector):
        raise UsageError("is zero; expected a direction")
    return vector


Direction = Annotated[Vector, AfterValidator(_pointing)]
Place = tuple[float, float]
Unit = Literal["in", "ft", "mm", "cm", "m"]
NodeFormat = Literal["vtk", "tecplot", "plot3d", "csv", "netcdf"]
Role = Literal["model", "wall", "primary", "secondary", "tap", "virtual", "fiducial"]
Positive = Annotated[float, Field(gt=0)]
Radius = Annotated[float, ranged(RADIUS_PX)]


class CameraEntry(Strict):
    """One camera: its interior parameters.

    ``pose = "find"``: a pose in the file is only compared with, never used as a start.
    ``pose = "known"``: the pose in the file is taken as it is and nothing is matched.

    ``name``: by which images and results call it. ``file``: its lens, of any format that `windmark convert` reads, and
    its pose where one is known. ``pose``: "find" it in each image, or "known": that of the file.
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

    ``file``: picture, frame or pattern. ``name``: of its results, by default the stem of the file. ``camera``: that
    took it, where there are several. ``page``: of a multipage TIFF, from 0.
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
    """The markers' table; only the given roles are matched. Where the model moved, leave the walls out.

    ``file``: CSV or ``.tgts``. ``roles``: which markers take part. ``surface``: without [grid], a grid that they lie
    on: on curved parts a disc's image is not centred on the disc.
    """

    file: Path
    surface: Path | None = None
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

    ``file``: PLOT3D, STL, OBJ, PLY, VTK, Tecplot, Cart3D.
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

    radius_px: Radius | Annotated[tuple[Radius, ...], Field(min_length=1)] | None = RADIUS_PX.default
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
    seed: Annotated[int, ranged(SEED)] = SEED.default
    max_time_s: Annotated[float, ranged(MAX_TIME_S)] | None = MAX_TIME_S.default
    max_table_error: Annotated[float, ranged(MAX_TABLE_ERROR)] = MAX_TABLE_ERROR.default
    max_deformation: Annotated[float, ranged(MAX_DEFORMATION)] = MAX_DEFORMATION.default
    label_distance_px: Annotated[float, ranged(LABEL_DISTANCE_PX)] = LABEL_DISTANCE_PX.default
    binding: bool = BINDING.default
    occlusion: bool = OCCLUSION.default


class ResectOptions(Strict):
    """How values are taken from the image.

    ``max_obliquity_deg``: surface seen more obliquely gets no value. ``interpolation``: between pixels: "cubic" spline
    or "linear".
    """

    max_obliquity_deg: Annotated[float, Field(gt=0, le=90)] = 80.0
    interpolation: Literal["linear", "cubic"] = "cubic"


class PovEntry(Strict):
    """The paper's point of view (see docs/conventions.md): angles in degrees, distances in the length unit.

    ``rx_deg``: turn of the model about the camera's x axis (to the right). ``ry_deg``: about its y axis (down).
    ``rz_deg``: about its z axis (ahead). ``dx``: place of the model's origin to the right of the camera. ``dy``: below
    it. ``dz``: ahead of it.
    """

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

    ``name``: of its pictures. ``direction``: that it looks along, in the frame of the model. ``up``: points to the top
    of the picture. ``volumes``: on which it is framed, by default all that take part. ``size_px``: width and height of
    the picture. ``fov_deg``: full horizontal field of view.
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
    """A cut of the surface by a plane: values along the line, every `spacing` length units or at each grid line.

    ``name``: of its results. ``point``: of the plane. ``normal``: of the plane. ``spacing``: of the values along the
    line, by default one at each grid line.
    """

    name: str
    point: Vector
    normal: Direction
    spacing: Positive | None = None


class AlignOptions(Strict):
    """3D alignment: every image is recomputed as if taken from the reference image's pose.

    What the grid's volumes say moves; all else stays. ``background``: pixels that show none of it in the reference
    image are "blank" (NaN), or, for images of one camera that stands still, "keep" the image's own grey level, but
    for those that the model hides in that image (NaN).

    ``reference``: name of the image whose pose all others get.
    """

    reference: str
    background: Literal["blank", "keep"] = "blank"


class OutputOptions(Strict):
    """What is written, and where. ``nodes``: formats of the node values, by default all that the grid allows.

    ``pixels``: also the surface point behind every pixel of each image (NetCDF).

    ``folder``: of the results.
    """

    folder: Path = Path("results")
    nodes: tuple[NodeFormat, ...] | None = None
    pixels: bool = False
