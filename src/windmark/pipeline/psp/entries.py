"""The tables of a paint test's project file: what each key means, and what it may be."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from windmark.errors import UsageError
from windmark.paint.cell_fit import MOST_P, MOST_T
from windmark.paint.form_factors import FACETS
from windmark.pipeline.project_entries import Direction, Finite, NodeFormat, Positive, Role, Vector
from windmark.pipeline.settings import Strict

Pattern = Annotated[str, Field(min_length=1)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]

CAMERA, POINT = "{camera}", "{point}"
"""Stand for a camera's and a point's name in patterns of files."""


class CameraEntry(Strict):
    """One camera: a file with its lens and its pose (cam_from_tunnel). ``mask``: pixels that are used.

    ``name``: by which pictures and results call it. ``file``: its lens and its pose, of any format that `windmark
    convert` reads.
    """

    name: str
    file: Path
    mask: Path | None = None


class TableEntry(Strict):
    """The run/point table, CSV: a row per point, see `points.read_points_table`.

    ``alpha_at_rest_deg``: the incidence of the model as markers and grid have it, in the frame of the cameras' poses.
    ``beta_at_rest_deg``: its sideslip there, positive with wind from starboard: that of the cameras' frame, where its x
    is not along the wind.
    ``max_alpha_error_deg``: how far incidence and sideslip that the pictures show may be from the table's; it tells
    rows that were exchanged.

    ``table``: the file.
    """

    table: Path
    alpha_at_rest_deg: Finite = 0.0
    beta_at_rest_deg: Finite = 0.0
    max_alpha_error_deg: Positive = 0.5


class ReferenceEntry(Strict):
    """Of points that name no wind-off pictures of their own.

    ``table``: CSV ``alpha_deg,p_off_UNIT,T_off_UNIT,off``, wind-off pictures at several incidences, between which light
    is straight. ``mean_of_run``: the mean of all points of the same ``run`` (a column of the table of points; without
    it all points are one run), for a calibration of the tunnel's gain form.
    """

    table: Path | None = None
    mean_of_run: bool = False

    @model_validator(mode="after")
    def _one(self) -> ReferenceEntry:
        if (self.table is None) == (not self.mean_of_run):
            raise UsageError("expected either table, wind-off pictures by incidence, or mean_of_run = true")
        return self


class RadiometryEntry(Strict):
    """From grey levels to light. ``dark``, ``flat``: patterns of pictures; ``{camera}`` stands for the camera.

    ``linearity``: CSV ``level,light``, both rising: what levels less dark stand for, where that is not in proportion.

    ``black``: the grey level without light, where there are no dark pictures. ``saturation``: levels from which on a
    pixel is not used, nor is it where a picture's levels pile up below that; ``max_saturated``: part of the model's
    pixels that may be so, before the picture is refused.
    ``gain``: photo-electrons per grey level, and ``read_noise``: of reading a pixel, in grey levels (1 sigma); without
    them the pictures themselves say both. ``lamp_flicker``: relative standard deviation of the lamps from picture to
    picture; without it pictures of the same state say it, where there are several.
    """

    dark: Pattern | None = None
    flat: Pattern | None = None
    linearity: Pattern | None = None
    black: Finite | None = None
    saturation: Positive | None = None
    max_saturated: Annotated[float, Field(ge=0, le=1)] = 0.02
    gain: Positive | None = None
    read_noise: NotNegative = 1.0
    lamp_flicker: Annotated[float, Field(ge=0, le=0.1)] | None = None

    @property
    def gain_levels(self) -> float | None:
        """Grey levels per photo-electron."""
        return None if self.gain is None else 1 / self.gain

    @property
    def read_variance(self) -> float:
        """Of reading a pixel, in grey levels squared, rounding included."""
        return self.read_noise**2 + 1 / 12

    @model_validator(mode="after")
    def _one_black(self) -> RadiometryEntry:
        if self.dark is not None and self.black is not None:
            raise UsageError("dark and black both say the level without light; give one of them")
        return self


class PaintEntry(Strict):
    """``cell``: measurements in a calibration cell, see `cell.read_cell`; or ``calibration``: what
    `windmark paint-calibrate` made of them.

    ``p_ref_Pa``, ``t_ref_K``: at which the cell's ratio is 1. ``orders``: highest powers of pressure and temperature;
    without them cross-validation chooses.

    ``steady``: of a calibration of the tunnel's gain form, NetCDF files with the steady ``pressure`` (and
    ``sigma_pressure``) at the grid's nodes, about which the gain holds (``{point}`` stands for the point), all wrong by
    the same ``steady_sigma_Pa`` (1 sigma).

    ``steady_sigma_Pa``: 1 sigma of ``steady``, the same everywhere.
    """

    cell: Path | None = None
    calibration: Path | None = None
    p_ref_Pa: Positive = 1e5
    t_ref_K: Positive = 293.15
    orders: tuple[Annotated[int, Field(ge=1, le=MOST_P)], Annotated[int, Field(ge=0, le=MOST_T)]] | None = None
    steady: Pattern | None = None
    steady_sigma_Pa: NotNegative = 0.0

    @model_validator(mode="after")
    def _one(self) -> PaintEntry:
        if (self.cell is None) == (self.calibration is None):
            raise UsageError("expected either cell, a table of measurements, or calibration, what was made of it")
        own = sorted(self.model_fields_set & {"p_ref_Pa", "t_ref_K", "orders"})
        if self.calibration is not None and own:
            raise UsageError(f"only cell goes with {' and '.join(own)}: the file of calibration has its own")
        if self.steady is None and "steady_sigma_Pa" in self.model_fields_set:
            raise UsageError("steady_sigma_Pa is of the steady pressure; steady is missing")
        return self


class LampEntry(Strict):
    """A lamp, taken as a point that shines on all sides; the light of several is added in proportion to ``power``.

    ``position``: in the frame of the tunnel. ``power``: beside that of the other lamps.
    """

    position: Vector
    power: Positive = 1.0


class TapsEntry(Strict):
    """Pressure taps. ``pressures``: CSV ``point,name,pressure_UNIT[,sigma_UNIT]``. ``radius``: of the holes.

    ``in_situ``: the paint's pressure is fitted to the taps; "compare" only compares them.

    ``file``: their places: CSV or ``.tgts``. ``roles``: which rows of it, by default the taps. ``sigma``: of a reading,
    where the table says none, in its unit.
    """

    file: Path
    pressures: Path
    roles: tuple[Role, ...] | None = None
    radius: Positive | None = None
    in_situ: Literal["offset-slope", "offset", "compare"] = "offset-slope"
    sigma: Positive | None = None


class TemperatureEntry(Strict):
    """Of the wall. ``recovery``: factor r of T = T_inf + r (T0 - T_inf).

    ``thermocouples`` (a table of places) and ``readings`` (CSV ``point,name,temperature_K[,sigma_K]``) say it better;
    better still ``maps``, NetCDF files of an infrared camera's ``temperature`` at the grid's nodes (``{point}`` stands
    for the point), all wrong by the same ``maps_sigma_K`` (1 sigma); and ``paint``, the calibration of a temperature
    paint whose pictures the table of points names. Of these the last one that a point has counts. ``sigma_K``: by how
    much it varies over the wall, or differs from recovery (1 sigma); ``length``: over what distance it keeps about its
    value, a tenth of the grid's size by default.

    ``thermocouples``: table of their places. ``readings``: CSV ``point,name,temperature_K[,sigma_K]``. ``maps``: NetCDF
    files of temperatures at the nodes. ``maps_sigma_K``: 1 sigma of ``maps``, the same everywhere. ``paint``:
    calibration of a temperature paint.
    """

    recovery: Annotated[float, Field(gt=0, le=1.2)] | None = None
    sigma_K: Positive = 1.0
    length: Positive | None = None
    thermocouples: Path | None = None
    readings: Path | None = None
    maps: Pattern | None = None
    maps_sigma_K: NotNegative = 0.5
    paint: Path | None = None

    @model_validator(mode="after")
    def _something(self) -> TemperatureEntry:
        if (self.thermocouples is None) != (self.readings is None):
            raise UsageError("thermocouples and readings belong together")
        if all(way is None for way in (self.recovery, self.readings, self.maps, self.paint)):
            raise UsageError("nothing says the temperature; give recovery, thermocouples with readings, maps, or paint")
        return self


class PatchesEntry(Strict):
    """Nodes near a marker or a tap, and in a drawn polygon, get the value of their surroundings.

    ``polygons``: CSV ``name,x,y,z``, the corners of each in order: screws, filler, damage, what is no paint.

    ``clear``: within so many radii of its centre, 0: none; and ``edge_px`` pixels farther: lenses blur its rim.

    ``edge_px``: pixels beyond a patch that count to it.
    """

    polygons: Path | None = None
    clear: Annotated[float, Field(ge=0, le=10)] = 1.2
    edge_px: Annotated[float, Field(ge=0, le=20)] = 2.5


class SelfIlluminationEntry(Strict):
    """The model lights itself. ``reflectivity``: of the paint for its own light, with its error ``sigma``.

    ``facets``: how many groups of triangles throw light; more are finer where surfaces meet.

    ``sigma``: 1 sigma of ``reflectivity``.
    """

    reflectivity: Annotated[float, Field(gt=0, lt=1)]
    sigma: NotNegative = 0.1
    facets: Annotated[int, Field(ge=10, le=100_000)] = FACETS


class SamplingEntry(Strict):
    """``max_obliquity_deg``, ``edge_px``: surface seen more obliquely, or nearer to an outline, gets no value.

    ``values``: from all pixels nearest to a node, or interpolated at it.
    """

    max_obliquity_deg: Annotated[float, Field(gt=0, le=90)] = 70.0
    edge_px: Annotated[float, Field(ge=0, le=100)] = 3.0
    values: Literal["footprint", "nearest", "linear", "cubic"] = "footprint"


class LoadsEntry(Strict):
    """Reference area, chord, span and moment point of the loads, in the project's length unit.

    ``least_seen``: part of a volume's seen side that must have values.

    ``area``: reference area. ``chord``: reference chord. ``span``: reference span, by which Cl and Cn are; without it
    they are by the chord, as Cm is. ``moment_point``: about which moments are.
    """

    area: Positive
    chord: Positive
    span: Positive | None = None
    moment_point: Vector = (0.0, 0.0, 0.0)
    least_seen: Annotated[float, Field(ge=0, le=1)] = 0.5

    @property
    def span_used(self) -> float:
        """The length that Cl and Cn are by."""
        return self.span or self.chord

    def record(self) -> dict[str, object]:
        """What the coefficients are by, in words for who reads them later."""
        return {
            "area": self.area, "chord": self.chord, "span": self.span_used, "moment_point": list(self.moment_point),
            "Cl_and_Cn_by": "span" if self.span else "chord",
        }  # fmt: skip


class SectionEntry(Strict):
    """A cut of the surface by a plane: Cp over x / c there. ``chord``: the direction that x / c runs along.

    ``name``: of its results. ``point``: of the plane. ``normal``: of the plane. ``volume``: that is cut, by default
    all.
    """

    name: str
    point: Vector
    normal: Direction
    volume: str | None = None


class OutputEntry(Strict):
    """What is written, and where.

    ``folder``: of the results. ``grid``: formats of the fields on the grid.
    """

    folder: Path = Path("psp")
    grid: tuple[NodeFormat, ...] = ("vtk",)
