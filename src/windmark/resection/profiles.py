"""Values of an image along a line on the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import DataError, UsageError
from windmark.geometry import Camera, Pose
from windmark.resection.sampling import Image, checked_image, checked_interpolation, node_values
from windmark.resection.sections import Section, arc_lengths, at_arc, section, three_numbers
from windmark.resection.visibility import NodeView, see_points
from windmark.scene import Mesh
from windmark.scene.shown import ARRAY, check_kinds

Array = NDArray[np.float64]


MOST_POINTS = 1_000_000
"""Of a line: more is a spacing in the wrong unit."""


@dataclass(frozen=True)
class LineProfile:
    """Values of an image along a line on the surface.

    Parameters
    ----------
    xyz : (n, 3) points on the surface, equally spaced along it
    arc : (n,) length along the surface from the first point
    values : (n,) or (n, C) float32, NaN where the camera does not see the point
    view : where the points are in the image, and why some are not seen
    gaps : how far the line's ends are from the start and the end that were asked for
    """

    xyz: Array
    arc: Array
    values: Image
    view: NodeView
    gaps: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class SurfaceLine:
    """A line along the surface: points (n, 3), arc length (n,), and how far its ends are from those asked for."""

    xyz: Array
    arc: Array
    gaps: tuple[float, float]


def sample_line(
    image: ArrayLike,
    camera: Camera,
    cam_from_model: Pose,
    mesh: Mesh,
    start: ArrayLike,
    end: ArrayLike,
    *,
    n: int = 200,
    normal: ArrayLike | None = None,
    interpolation: str = "cubic",
) -> LineProfile:
    """Values along the surface from one point to another, as along a chord at a span station.

    The line is where the surface is cut by the plane through both points that stands upright on the
    surface. It is followed from the point of the cut nearest to ``start`` to that nearest to ``end``;
    round a closed section the shorter way is taken.

    Parameters
    ----------
    image, camera, cam_from_model, interpolation : as in `sample`
    mesh : the surface; also hides
    start, end : (3,) model coordinates, on the surface or near it
    n : number of points, ends included
    normal : (3,) of the cutting plane, such as (0, 1, 0) for a span station; its part along start-end
        is ignored. None: found from the surface's normals at start and end

    Returns
    -------
    LineProfile

    Raises
    ------
    ValueError
        If start and end coincide, n < 2, the plane cannot be found (surface normals along the line, or
        opposite at its ends) or misses the mesh.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> above = wm.Pose.look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    >>> image = np.tile(np.arange(64.0), (48, 1))  # its grey level is its column
    >>> line = wm.sample_line(image, wm.Camera((64, 48), 60.0), above, plate, [-0.9, 0, 0], [0.9, 0, 0], n=4)
    >>> line.arc.round(2).tolist(), line.values.round(1).tolist()
    ([0.0, 0.6, 1.2, 1.8], [18.0, 27.0, 36.0, 45.0])
    """
    check_kinds(
        "sample_line", image=(image, ARRAY), camera=(camera, Camera), cam_from_model=(cam_from_model, Pose),
        mesh=(mesh, Mesh),
    )  # fmt: skip
    pixels = checked_image(image, camera.size_px, "sample_line")
    checked_interpolation(interpolation, "sample_line")
    line = surface_line(mesh, start, end, n=n, normal=normal)
    view = see_points(line.xyz, camera, cam_from_model, mesh=mesh)
    return LineProfile(line.xyz, line.arc, node_values(pixels, view, interpolation=interpolation), view, line.gaps)


def surface_line(
    mesh: Mesh,
    start: ArrayLike,
    end: ArrayLike,
    *,
    n: int | None = None,
    spacing: float | None = None,
    normal: ArrayLike | None = None,
) -> SurfaceLine:
    """The line of `sample_line` without a picture.

    Parameters
    ----------
    mesh, start, end, normal : as in `sample_line`
    n : number of points, ends included; 200 by default
    spacing : instead of n: the distance between points, adjusted to divide the line in whole steps

    Returns
    -------
    SurfaceLine. Where the surface has a gap between start and end the line ends at its border: ``gaps`` says so.

    Raises
    ------
    ValueError
        As `sample_line`; for both n and spacing, or a spacing that is not positive.
    """
    a, b = three_numbers(start, "sample_line: start"), three_numbers(end, "sample_line: end")
    if n is not None and spacing is not None:
        raise UsageError("sample_line: give n or spacing, not both")
    if n is not None and n < 2:
        raise UsageError(f"sample_line: n must be at least 2, got {n}")
    if spacing is not None and not 0 < spacing < np.inf:
        raise UsageError(f"sample_line: spacing must be a length > 0, got {spacing}")
    plane = _upright_plane(mesh, a, b, None if normal is None else three_numbers(normal, "sample_line: normal"))
    cut = section(mesh, a, plane)
    if not len(cut):
        raise DataError("sample_line: the plane through start and end does not meet the mesh")
    path = _path_between(cut, a, b)
    along = arc_lengths(path)
    count = (200 if n is None else n) if spacing is None else int(max(1, round(min(along[-1] / spacing, 1e9)))) + 1
    if count > MOST_POINTS:
        raise UsageError(f"sample_line: at most {MOST_POINTS} points, got {count} (of a line {along[-1]:.6g} long)")
    arc = np.linspace(0.0, along[-1], count)
    xyz = at_arc(path, along, arc)
    return SurfaceLine(xyz, arc, (float(np.linalg.norm(xyz[0] - a)), float(np.linalg.norm(xyz[-1] - b))))


def _upright_plane(mesh: Mesh, a: Array, b: Array, normal: Array | None) -> Array:
    """Normal of the plane through a and b that holds the mean surface normal at the two."""
    along = b - a
    length = np.linalg.norm(along)
    if not length > 0:
        raise UsageError(f"sample_line: start and end must differ, both are {a.tolist()}")
    along = along / length
    if normal is None:
        plane = np.cross(along, _normal_near(mesh, a) + _normal_near(mesh, b))
    else:
        plane = normal - (normal @ along) * along
    if not np.linalg.norm(plane) > 1e-6:
        raise DataError(
            "sample_line: start, end and the surface's normals do not define a plane; give the plane's normal"
        )
    return plane


def _normal_near(mesh: Mesh, point: Array) -> Array:
    """Unit mean normal of the triangles round the node nearest to a point; zero if it has no direction."""
    used = mesh.used
    if not len(used):
        raise DataError("sample_line: the mesh has no triangles")
    node = used[np.nanargmin(np.linalg.norm(mesh.vertices[used] - point, axis=1))]
    round_it = mesh.triangles[(mesh.triangles == node).any(axis=1)]
    a, b, c = (mesh.vertices[round_it[:, k]] for k in range(3))
    total = np.cross(b - a, c - a).sum(axis=0)
    length = np.linalg.norm(total)
    return total / length if length > 0 else total


def _path_between(cut: Section, a: Array, b: Array) -> Array:
    """The points of the cut from the place nearest to a to the place nearest to b, on the line nearest to both."""
    candidates = []
    for part, closed in zip(cut.lines(), cut.closed, strict=True):
        points, arc = cut.xyz[part], cut.arc[part]
        (da, sa), (db, sb) = _nearest(points, arc, a), _nearest(points, arc, b)
        candidates.append((da + db, sa, sb, points, arc, bool(closed)))
    _, sa, sb, points, arc, closed = min(candidates, key=lambda item: item[0])
    if closed and abs(sb - sa) > 0.5 * arc[-1]:
        # The shorter way leads through the seam: unroll the line twice.
        points, arc = np.concatenate([points, points[1:]]), np.concatenate([arc, arc[1:] + arc[-1]])
        total = arc[-1] / 2
        sa, sb = (sa, sb + total) if sb < sa else (sa + total, sb)
    low, high = min(sa, sb), max(sa, sb)
    stations = np.concatenate([[low], arc[(arc > low) & (arc < high)], [high]])
    path = at_arc(points, arc, stations)
    return path if sa <= sb else path[::-1]


def _nearest(points: Array, arc: Array, target: Array) -> tuple[float, float]:
    """Distance of a point to a polyline, and the arc length of the nearest place."""
    step = np.diff(points, axis=0)
    square = np.einsum("nk,nk->n", step, step)
    t = np.clip(np.einsum("nk,nk->n", target - points[:-1], step) / np.where(square > 0, square, 1.0), 0.0, 1.0)
    distance = np.linalg.norm(points[:-1] + t[:, None] * step - target, axis=1)
    k = int(np.argmin(distance))
    return float(distance[k]), float(arc[k] + t[k] * np.sqrt(square[k]))
