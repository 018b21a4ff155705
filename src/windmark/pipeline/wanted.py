"""What a project may want beside values on nodes: pictures merged, values at points and along lines."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from windmark.errors import UsageError
from windmark.pipeline.project_entries import Direction, Positive, Role, Vector
from windmark.pipeline.settings import Strict


class MergeOptions(Strict):
    """Pictures of one time point merged on the surface, options of `windmark.merge_views`.

    ``images``: names of those that take part, all by default. Images with the same ``point`` are merged with each
    other; where no image has one, all are of one time point.
    ``gain``: "overlap" finds each picture's gain (and with ``offset`` its grey level without light) from what several
    see, the default of grey levels; "none" takes values as they are, the default of temperatures and radiances.
    ``black``: the grey level without light of all pictures. ``reference``: the image whose grey levels are kept.
    ``taper_deg``, ``taper_px``: how far before the obliquity's limit, and how
    near to borders and outlines, the weight of a picture falls to nothing.

    ``offset``: also find each picture's grey level without light.
    """

    images: tuple[str, ...] | None = None
    gain: Literal["overlap", "none"] | None = None
    offset: bool = False
    black: float = 0.0
    reference: str | None = None
    taper_deg: Positive = 15.0
    taper_px: Positive = 12.0

    @model_validator(mode="after")
    def _whole(self) -> MergeOptions:
        if self.offset and self.gain == "none":
            raise UsageError('merge: offset needs gain = "overlap"')
        return self


class PointsEntry(Strict):
    """Points at which values are wanted: pressure taps, any list.

    ``file``: CSV ``name,x,y,z[,nx,ny,nz][,volume][,role][,...]`` or ``.tgts``. ``roles``: which rows; by default the
    taps of a ``.tgts`` file, everything of a CSV table. ``max_distance``: points are moved onto the nearest surface
    within it; 0.002 of the grid's size (`Mesh.size`) by default.

    ``name``: of the results, by default the stem of the file.
    """

    file: Path
    name: str | None = None
    roles: Annotated[tuple[Role, ...], Field(min_length=1)] | None = None
    max_distance: Positive | None = None

    @property
    def label(self) -> str:
        """Name of the list in results."""
        return self.name or self.file.stem


class LineEntry(Strict):
    """Values along the surface from one point to another: ``n`` of them, or one every ``spacing`` length units.

    ``normal``: of the plane that cuts the surface along the line, such as [0, 1, 0] for a span station.
    ``max_distance``: how far the surface may be from start and end; 0.002 of the grid's size (`Mesh.size`) by default.

    ``name``: of its results. ``start``: first point. ``end``: last point. ``n``: number of values. ``spacing``: of the
    values, in place of their number.
    """

    name: str
    start: Vector
    end: Vector
    n: Annotated[int, Field(ge=2, le=1_000_000)] | None = None
    spacing: Positive | None = None
    normal: Direction | None = None
    max_distance: Positive | None = None

    @model_validator(mode="after")
    def _one_step(self) -> LineEntry:
        if self.n is not None and self.spacing is not None:
            raise UsageError(f"line {self.name}: give n or spacing, not both")
        if self.start == self.end:
            raise UsageError(f"line {self.name}: start and end must differ, both are {list(self.start)}")
        return self


def check_merge(merge: MergeOptions, images: Sequence[tuple[str, str | None, str]], grid: bool) -> None:
    """Refuse a [merge] table that does not fit the images: (name, point, camera) of each.

    Raises
    ------
    ValueError
        For unknown images, images without a point beside others that have one, two of one camera without points.
    """
    if not grid:
        raise UsageError("merging needs a grid: add [grid] file = ...")
    names = [name for name, _, _ in images]
    unknown = sorted({*(merge.images or ()), *([merge.reference] if merge.reference else [])} - set(names))
    if unknown:
        raise UsageError(f"merge: {unknown[0]!r} is not the name of an image; they are {', '.join(names)}")
    mine = [image for image in images if merge.images is None or image[0] in merge.images]
    if merge.reference is not None and merge.reference not in [name for name, _, _ in mine]:
        raise UsageError(f"merge: the reference {merge.reference!r} is not among the images that are merged")
    without = [name for name, point, _ in mine if point is None]
    if without and len(without) < len(mine):
        raise UsageError(f"merge: image {without[0]} has no point while others have one; give it one, or name the"
                         " images that are merged (merge.images)")  # fmt: skip
    if without:
        cameras = [camera for _, _, camera in mine]
        double = next((c for c in cameras if cameras.count(c) > 1), None)
        if double is not None:
            two = [name for name, _, camera in mine if camera == double]
            raise UsageError(f"merge: images {two[0]} and {two[1]} are both of camera {double}, so they are of"
                             ' different instants; give every image its point (point = "...")')  # fmt: skip


def groups(merge: MergeOptions, images: Sequence[tuple[str, str | None]]) -> dict[str | None, list[str]]:
    """Names of the images to be merged with each other, by their point."""
    out: dict[str | None, list[str]] = {}
    for name, point in images:
        if merge.images is None or name in merge.images:
            out.setdefault(point, []).append(name)
    return out
