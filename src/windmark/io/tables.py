"""Tables of what was seen: detections of one or many images, and matches of spots with markers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.io.csvtable import Table, read_table, write_table
from windmark.io.text import Pathlike
from windmark.scene import Detections, MarkerSet, Matching

Array = NDArray[np.float64]
Text = NDArray[np.str_]

DETECTION_COLUMNS = (
    "image", "x", "y", "sigma_x", "sigma_y", "rho", "radius", "merit",
    "axis_major", "axis_minor", "angle_deg", "depth", "flags",
)  # fmt: skip
"""Pixels, but for rho (correlation of x and y), merit, angle_deg, depth (grey levels), flags (`scene.FLAGS`)."""

NAMES = "name"
"""Last column of a table of detections that were told who they are; every other program may leave it out."""

MATCH_COLUMNS = ("image", "name", "x", "y", "dx", "dy", "distance_px")
"""x, y: detected; dx, dy: projected - detected; all in pixels."""

MATCH_EXTRAS = ("sigma_x", "sigma_y", "rho", "camera", "frame")
"""What a table of matches may also have: covariance of the mark, which camera took the image, and at which instant."""


def write_detections(
    path: Pathlike,
    detections: Detections | Mapping[str, Detections],
    *,
    image: str = "",
    names: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Write the spots of one image, or of many in one table, as CSV, whole or not at all.

    ``image,x,y,sigma_x,sigma_y,rho,radius,merit,axis_major,axis_minor,angle_deg,depth,flags``; empty
    where unknown (or infinite). Floats keep every digit; the covariance (through sigma and rho) and the angle
    (through degrees) come back to rounding, everything else exactly.

    Parameters
    ----------
    path : the file
    detections : of one image, or a mapping of image names to detections
    image : the image's name, for detections of one image
    names : image name to the marker's name of each spot: a last column ``name``

    Raises
    ------
    FileError
        When the file cannot be written.
    """
    sets = {image: detections} if isinstance(detections, Detections) else detections
    parts = [_detection_columns(name, spots) for name, spots in sets.items()]
    empty = _detection_columns("", Detections.make(np.zeros((0, 2))))
    columns = {column: np.concatenate([part[column] for part in [empty, *parts]]) for column in empty}
    if names is not None:
        columns[NAMES] = np.array([name for key in sets for name in names[key]], dtype=np.str_)
    write_table(path, columns)


def _detection_columns(image: str, spots: Detections) -> dict[str, NDArray]:
    known = np.isfinite(spots.cov).all(axis=(1, 2), keepdims=True)
    cov = np.where(known, spots.cov, np.nan)
    sigma = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    rho = cov[:, 0, 1] / (sigma[:, 0] * sigma[:, 1])
    columns = (
        np.array([image] * len(spots), dtype=np.str_), *spots.xy.T, *sigma.T, rho, spots.radius_px, spots.merit,
        *spots.axes_px.T, np.degrees(spots.angle), spots.depth, spots.flags,
    )  # fmt: skip
    return dict(zip(DETECTION_COLUMNS, columns, strict=True))


def read_detections(path: Pathlike, *, sigma_px: float = 0.1) -> dict[str, Detections]:
    """Read a table of detections.

    Only the columns x and y are needed, so tables of other programs can be used once their header
    is right ((0, 0) is the centre of the top-left pixel).

    Parameters
    ----------
    path : the file
    sigma_px : standard deviation per coordinate for a table without the columns sigma_x and sigma_y;
        an empty cell in these columns stays unknown (NaN)

    Returns
    -------
    Image name to `Detections`, in the order of first appearance; the name is "" where the table has
    no image column. An image without a spot leaves no row, so it is not there.

    Raises
    ------
    FileError
        Names the line: unknown column, no number, sigma not > 0, rho outside -1 to 1.
    """
    table = read_table(path, required=("x", "y"), known=(*DETECTION_COLUMNS, NAMES))
    spots = Detections.make(
        np.stack([table.numbers("x"), table.numbers("y")], axis=1),
        cov=_covariance(table, sigma_px),
        merit=_optional(table, "merit"),
        radius_px=_optional(table, "radius"),
        axes_px=table.together("axis_major", "axis_minor"),
        angle=np.radians(_optional(table, "angle_deg")),
        depth=_optional(table, "depth"),
        flags=_flags(table),
    )
    rows: dict[str, list[int]] = {}
    for row, image in enumerate(table.text("image") if "image" in table else [""] * len(table)):
        rows.setdefault(image, []).append(row)
    return {image: spots.take(np.array(own)) for image, own in rows.items()}


def read_detection_names(path: Pathlike) -> dict[str, list[str]]:
    """The markers' names of `read_detections`: image name to one name per spot, "" where it has none."""
    table = read_table(path, required=("x", "y"), known=(*DETECTION_COLUMNS, NAMES))
    images = table.text("image") if "image" in table else [""] * len(table)
    names = table.text(NAMES) if NAMES in table else [""] * len(table)
    out: dict[str, list[str]] = {image: [] for image in images}
    for image, name in zip(images, names, strict=True):
        out[image].append(name)
    return out


def _optional(table: Table, column: str) -> Array:
    return table.numbers(column, optional=True) if column in table else np.full(len(table), np.nan)


def _covariance(table: Table, sigma_px: float) -> Array:
    sigma = table.together("sigma_x", "sigma_y")
    if sigma is None:
        sigma = np.full((len(table), 2), float(sigma_px))
    table.check(~(sigma <= 0).any(axis=1), "sigma_x and sigma_y must be > 0, or empty where unknown")
    rho = np.nan_to_num(_optional(table, "rho"), nan=0.0)
    table.check(np.abs(rho) <= 1, "rho must be between -1 and 1")
    across = rho * sigma[:, 0] * sigma[:, 1]
    return np.stack([sigma[:, 0] ** 2, across, across, sigma[:, 1] ** 2], axis=1).reshape(-1, 2, 2)


def _flags(table: Table) -> NDArray[np.int64]:
    flags = np.nan_to_num(_optional(table, "flags"), nan=0.0)
    table.check((flags >= 0) & (flags == np.floor(flags)) & (flags < 2**31), "flags must be a whole number >= 0")
    return flags.astype(np.int64)


@dataclass(frozen=True)
class MatchTable:
    """K matches of spots with markers, of one or many images, as columns.

    Parameters
    ----------
    image : (K,) str
    name : (K,) str, the marker
    xy : (K, 2) detected position, pixels
    residual : (K, 2) projected - detected, pixels
    cov : (K, 2, 2) px^2, NaN where the table has no sigma
    camera, frame : (K,) str, "" where the table does not say
    """

    image: Text
    name: Text
    xy: Array
    residual: Array
    cov: Array
    camera: Text
    frame: Text

    def __len__(self) -> int:
        return len(self.name)


def write_matches(
    path: Pathlike,
    detections: Detections,
    markers: MarkerSet,
    matching: Matching,
    projected_xy: ArrayLike,
    *,
    image: str = "",
) -> None:
    """Write matches as CSV ``image,name,x,y,dx,dy,distance_px``, whole or not at all.

    Parameters
    ----------
    path : the file
    detections, markers, matching : what was seen, what is known, and who is who
    projected_xy : (K, 2) projected positions of the matched markers, in the matching's order
    image : the image's name

    Raises
    ------
    ValueError
        When projected_xy does not fit the matching.
    FileError
        When the file cannot be written.
    """
    projected = np.asarray(projected_xy, dtype=float)
    if projected.shape != (len(matching), 2):
        raise ValueError(f"write_matches: projected_xy must be ({len(matching)}, 2), got {projected.shape}")
    xy = detections.xy[matching.detection]
    residual = projected - xy
    columns = (
        np.array([image] * len(matching), dtype=np.str_), markers.name[matching.marker],
        *xy.T, *residual.T, np.hypot(*residual.T),
    )  # fmt: skip
    write_table(path, dict(zip(MATCH_COLUMNS, columns, strict=True)))


def read_matches(path: Pathlike) -> MatchTable:
    """Read a table of matches; dx, dy may be missing or empty (NaN): matches given by hand have none.

    Columns ``image,name,x,y[,dx,dy][,distance_px][,sigma_x,sigma_y][,rho][,camera][,frame]`` in any order.

    Raises
    ------
    FileError
        Names the line: no number, sigma not > 0, empty name, a name twice in one image, an image of two cameras or
        instants.
    """
    table = read_table(path, required=("name", "x", "y"), known=(*MATCH_COLUMNS, *MATCH_EXTRAS))
    images = table.text("image") if "image" in table else [""] * len(table)
    names = table.text("name")
    seen: dict[tuple[str, str], int] = {}
    for row, key in enumerate(zip(images, names, strict=True)):
        if not names[row]:
            table.fail(row, "name is empty; expected a marker's name")
        if key in seen:
            table.fail(row, f"the marker {names[row]!r} is already on line {table.lines[seen[key]]} for this image")
        seen[key] = row
    residual = table.together("dx", "dy")
    camera, frame = (table.text(column) if column in table else [""] * len(table) for column in ("camera", "frame"))
    of_image: dict[str, tuple[str, str]] = {}
    for row, (image, *who) in enumerate(zip(images, camera, frame, strict=True)):
        if of_image.setdefault(image, (who[0], who[1])) != tuple(who):
            table.fail(row, f"image {image!r} has another camera or frame than in the lines above; expected the same")
    return MatchTable(
        np.array(images, dtype=np.str_),
        np.array(names, dtype=np.str_),
        np.stack([table.numbers("x"), table.numbers("y")], axis=1),
        np.full((len(table), 2), np.nan) if residual is None else residual,
        _covariance(table, np.nan),
        np.array(camera, dtype=np.str_),
        np.array(frame, dtype=np.str_),
    )
