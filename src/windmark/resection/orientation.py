"""Turn the triangles of a mesh to the air, sheet by sheet, whatever the file's habits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.geometry.rays import pixel_rays
from windmark.resection.casting import cast, single_pose, to_camera_frame
from windmark.resection.chains import weld
from windmark.resection.two_sided import Edges, Twins, agreed, neighbours, twins, unknown_sides
from windmark.resection.visibility import checked_tolerance
from windmark.scene import Mesh

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

# A sheet whose normals cancel to less than this part of its size has no inside of its own.
_FLAT = 1e-6


# Rays of one camera that ask which side of a sheet it sees: a sheet of some pixels is met by one.
_RAYS = 1 << 17
# Part of what a sheet turns to a camera that must be seen of it, rather than be hidden by others: past the edge of a
# thin part its open other side looks out.
_SLIVER = 0.05
# Points of the other sheets at which it is asked whether a sheet surrounds them, and how deep inside it they must be,
# as part of the mesh's size: a patch that is laid over a body may lie a little under its flat triangles.
_SAMPLES, _DEPTH = 16, 2e-3
# Part of all directions that it covers, seen from nearly all of them: less is hardly beside it.
_BESIDE, _NEARLY_ALL = 0.1, 0.9


def orient_outward(
    mesh: Mesh,
    *,
    outside: ArrayLike | None = None,
    cameras: Sequence[tuple[Camera, Pose]] = (),
    tolerance: float | None = None,
) -> Mesh:
    """A mesh whose triangles are counter-clockwise seen from the air, as `Mesh` promises.

    Structured files give each block an orientation of its own. Triangles that meet at an edge are
    turned alike (across blocks too, where they meet within ``tolerance``), so each connected sheet has
    one orientation left to choose:

    1. A camera stands in the air: the side of a sheet that cameras see is its air side (of the larger
       part of what they see, where they see both). A sliver tells nothing: less than 5 % of what the side turns to
       them.
    2. What no camera sees, or without any: of a sheet within whose box all others are its air is where they are, as
       inside a test section, closed or not. They are on the side from which it covers a tenth and more of all
       directions, seen from a little (0.2 % of the mesh's size) beside them, too: a patch laid over a body is on
       neither side of it.
    3. Any other sheet is turned so that it encloses positive volume, an open one (a half model) as seen
       from its own centroid.

    Parameters
    ----------
    mesh : any orientation
    outside : (3,) a point in the air. It decides for sheets that enclose nothing (a flat plate) and that no
        camera sees; without it they keep the orientation that most of their area has
    cameras : cameras with their poses (cam_from_model), as they took images of this surface
    tolerance : distance at which nodes of different blocks are the same; 1e-5 of the least of `Mesh.sizes`

    Returns
    -------
    Mesh with the same nodes, blocks and order of triangles; some triangles have their second and third
    node exchanged. Sheets with only one side (a Moebius strip) are left as they are. At edges in which more than two
    triangles meet those connect that alone have its nodes in the file, or are alone of one zone. Two sheets that lie on
    each other, the sides of a part without thickness, are turned away from each other; which of them is which side is
    what the file's windings say where these oppose each other (see `sides_in_doubt`). Of a body with one closed shell
    inside it the outer one is taken for a wall unless a camera sees it from outside; a shell that is not the outermost
    is turned outward by itself.

    Notes
    -----
    The part of all directions that a sheet covers is its winding number: A. Jacobson, L. Kavan,
    O. Sorkine-Hornung, "Robust inside-outside segmentation using generalized winding numbers", ACM
    Transactions on Graphics 32 (2013); solid angle of a triangle: A. van Oosterom, J. Strackee, IEEE
    Transactions on Biomedical Engineering 30 (1983).

    Examples
    --------
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 3, 2]])
    >>> plate.triangle_normals()[:, 2].tolist()  # one triangle is turned over
    [2.0, -2.0]
    >>> wm.orient_outward(plate, outside=[0.0, 0.0, 5.0]).triangle_normals()[:, 2].tolist()
    [2.0, 2.0]
    """
    if not len(mesh.triangles):
        return mesh
    toward = None if outside is None else np.asarray(outside, dtype=float)
    if toward is not None and (toward.shape != (3,) or not np.isfinite(toward).all()):
        raise UsageError(f"orient_outward: outside must be three finite numbers, got {outside!r}")
    number = _welded(mesh, checked_tolerance(tolerance, mesh, "orient_outward"))
    edges = Edges.of(number, mesh.triangles)
    pairs = twins(mesh, number, edges)
    thin = pairs.mask(len(number))
    sheet, turned = _consistent(edges, mesh.parts, pairs, len(number))
    inward, flat = _inward(mesh, sheet, turned, toward, thin)
    wall = _surrounding(mesh, number, sheet, turned)
    if wall is not None:
        inward[wall[0]] = wall[1]
    seen = _seen_side(mesh, sheet, turned, cameras, thin)
    inward = np.where(seen != 0, seen < 0, inward)
    flip = turned ^ inward[sheet]
    if thin.any():
        flip ^= _as_file(mesh, sheet, thin, flip, (seen != 0) | ~flat)
    triangles = mesh.triangles.copy()
    triangles[flip, 1], triangles[flip, 2] = mesh.triangles[flip, 2], mesh.triangles[flip, 1]
    return replace(mesh, triangles=triangles)


def wound_both_ways(mesh: Mesh) -> bool:
    """Whether some triangles run through their common edge in one direction: one of them is the other way round."""
    tail, head = mesh.triangles.ravel().astype(np.int64), np.roll(mesh.triangles, -1, axis=1).ravel()
    way = (tail * len(mesh.vertices) + head)[tail != head]
    way.sort()
    return bool((np.diff(way) == 0).any())


def sides_in_doubt(mesh: Mesh, turned: Mesh) -> tuple[tuple[str, str], ...]:
    """Pairs of volumes that are the two sides of a part without thickness, where nothing tells which is which side.

    ``mesh`` is as the file has it, ``turned`` what `orient_outward` made of it. The file tells it where it winds both
    sides against each other and all other parts to the air, or none.
    """
    if not len(mesh.triangles):
        return ()
    return unknown_sides(mesh, turned, _welded(mesh, checked_tolerance(None, mesh, "sides_in_doubt")))


def _welded(mesh: Mesh, tolerance: float) -> Ints:
    """(T, 3) corners of the triangles, numbered alike where they coincide; nodes in no triangle connect nothing."""
    used = mesh.used
    place = np.empty(len(mesh.vertices), np.int64)
    place[used] = weld(np.nan_to_num(mesh.vertices[used]), tolerance)[0]
    return np.asarray(place[mesh.triangles])


def _seen_side(mesh: Mesh, sheet: Ints, turned: NDArray[np.bool_], cameras: Sequence[tuple[Camera, Pose]],
               thin: NDArray[np.bool_]) -> Array:  # fmt: skip
    """Per sheet: rays of all cameras that meet its front (once its triangles agree) minus those that meet its back; 0
    where they are a sliver of what they would meet if nothing hid it. Of the two sides of a ``thin`` part (T,) a ray
    meets either, and tells nothing.
    """
    votes, total = np.zeros(int(sheet.max()) + 1), 0
    views = [(single_pose(pose, "orient_outward"), _sample_rays(camera)) for camera, pose in cameras]
    for pose, rays in views:
        corners = to_camera_frame(pose, mesh.vertices)
        hit = cast(corners, mesh.triangles, rays).triangle
        tells = (hit >= 0) & ~thin[hit]
        met, (u, v) = hit[tells], rays[tells].T
        a, b, c = (corners[mesh.triangles[met, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        front = -np.sign(normal[:, 0] * u + normal[:, 1] * v + normal[:, 2])
        votes += np.bincount(sheet[met], weights=np.where(turned[met], -front, front), minlength=len(votes))
        total += len(rays)
    few = (votes != 0) & (np.abs(votes) < _SLIVER * total)
    some = np.flatnonzero(few[sheet] & ~thin)  # no sheet would be met by more rays than there are
    would = np.zeros(len(votes))
    for pose, rays in views if len(some) else ():
        facing, alone = _unhidden(to_camera_frame(pose, mesh.vertices[mesh.triangles[some]].reshape(-1, 3)), rays)
        same = (facing ^ turned[some]) == (votes[sheet[some]] > 0)
        would += np.bincount(sheet[some], weights=np.where(same, alone, 0.0), minlength=len(votes))
    return np.where(np.abs(votes) < _SLIVER * would, 0.0, votes)


def _unhidden(corners: Array, rays: Array) -> tuple[NDArray[np.bool_], Array]:
    """Whether triangles, corners (3 T, 3) in the camera's frame, face it, and how many of its rays (N, 2) each would
    meet alone, about; none of those that reach behind it or lie beside its view.
    """
    corners = corners.reshape(-1, 3, 3)
    ahead = np.asarray((corners[:, :, 2] > 0).all(axis=1))
    at = corners[:, :, :2] / np.where(ahead[:, None, None], corners[:, :, 2:], 1.0)
    (a, b), (low, high) = (at[:, k] - at[:, 0] for k in (1, 2)), (np.nanmin(rays, axis=0), np.nanmax(rays, axis=0))
    area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    middle = at.mean(axis=1)
    inside = ahead & ((middle > low) & (middle < high)).all(axis=1)
    # y points down: what is counter-clockwise seen from the camera has a negative area here.
    return area < 0, np.where(inside, np.abs(area) * (len(rays) / max(float(np.prod(high - low)), 1e-300)), 0.0)


def _sample_rays(camera: Camera) -> Array:
    """(N, 2) rays of evenly spread pixels, at most about `_RAYS`: those of a camera with so many fewer pixels."""
    width, height = camera.size_px
    step = max(1, int(np.ceil(np.sqrt(width * height / _RAYS))))
    first = step // 2
    size = (max(1, -(-(width - first) // step)), max(1, -(-(height - first) // step)))
    thin = replace(camera, size_px=size, focal_px=camera.focal_px / step, cx=(camera.cx - first) / step,
                   cy=(camera.cy - first) / step)  # fmt: skip
    return pixel_rays(thin, 0, size[1]).reshape(-1, 2)


def _surrounding(mesh: Mesh, number: Ints, sheet: Ints, turned: NDArray[np.bool_]) -> tuple[int, bool] | None:
    """The sheet that has all others on one side, and whether it must be turned for its air to be there; None where
    there is none. Only the sheet whose box holds all the others is asked.
    """
    corners = mesh.vertices[mesh.triangles]
    real = (number != np.roll(number, 1, axis=1)).all(axis=1)  # a collapsed cell at a pole is no sheet
    count = int(sheet.max()) + 1
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, sheet[real], corners[real].min(axis=1))
    np.maximum.at(high, sheet[real], corners[real].max(axis=1))
    there = np.isfinite(low).all(axis=1)
    if there.sum() < 2:
        return None
    outer = int(np.argmax(np.where(there, np.linalg.norm(np.where(there[:, None], high - low, 0.0), axis=1), -1.0)))
    if (low[there] < low[outer]).any() or (high[there] > high[outer]).any():
        return None
    mine, others = (sheet == outer) & real, np.flatnonzero((sheet != outer) & real)
    wall, sign = corners[mine], np.where(turned[mine], -1.0, 1.0)
    some = others[np.linspace(0, len(others) - 1, min(_SAMPLES, len(others))).astype(int)]
    around = _DEPTH * mesh.size * np.concatenate([np.eye(3), -np.eye(3)])
    points = (corners[some].mean(axis=1)[:, None] + around).reshape(-1, 3)
    covered = np.array([float(sign @ solid_angles(wall - point)) / (4 * np.pi) for point in points])
    # Not all of them: a half model stands on its wall, and a little beside its root is the wall's other side.
    for inside_out in (True, False):
        if ((covered if inside_out else -covered) > _BESIDE).mean() > _NEARLY_ALL:
            return outer, inside_out
    return None


def solid_angles(corners: Array) -> Array:
    """(T,) signed solid angles of triangles (T, 3, 3) seen from the origin: positive when seen from behind."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    la, lb, lc = (np.sqrt(np.einsum("tk,tk->t", v, v)) for v in (a, b, c))
    volume = np.einsum("tk,tk->t", a, np.cross(b, c))
    dots = la * lb * lc + sum(
        np.einsum("tk,tk->t", u, v) * length for u, v, length in ((a, b, lc), (b, c, la), (c, a, lb))
    )
    return np.asarray(2 * np.arctan2(volume, dots))


def _consistent(edges: Edges, part: Ints, thin: Twins, count: int) -> tuple[Ints, NDArray[np.bool_]]:
    """Sheet number (T,) of each of ``count`` triangles, and whether it must be turned to agree with its sheet.

    Each triangle is two nodes of a graph, as it is and turned; neighbours connect the copies that
    agree, and the two sides of a thin part those that are turned away from each other. A sheet then shows up as two
    mirrored components; a one-sided sheet as a single one.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    a, b = neighbours(edges, part, thin.overlap)
    first, second = np.append(edges.owner[a], thin.first), np.append(edges.owner[b], thin.second)
    # Triangles that run through their common edge in opposite directions agree as they are; so do the sides of a part.
    opposed = np.append(edges.forward[a] != edges.forward[b], ~thin.alike)
    other = np.where(opposed, second, second + count)
    mirror = np.where(opposed, second + count, second)
    rows, columns = np.concatenate([first, first + count]), np.concatenate([other, mirror])
    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(2 * count, 2 * count))
    _, label = connected_components(graph, directed=False)
    as_is, flipped = label[:count], label[count:]
    _, sheet = np.unique(np.minimum(as_is, flipped), return_inverse=True)
    return sheet, as_is > flipped


def _as_file(mesh: Mesh, sheet: Ints, thin: NDArray[np.bool_], flip: NDArray[np.bool_], known: NDArray[np.bool_]
             ) -> NDArray[np.bool_]:  # fmt: skip
    """Triangles (T,) of thin sheets of which only the file's windings say which side they are: to be turned over where
    it winds all others inward. ``flip``: what is turned so far; ``known``: (S,) sheets that something else decided.
    """
    area = np.linalg.norm(mesh.triangle_normals(), axis=1)
    most = np.bincount(sheet, weights=np.where(thin, area, 0.0)) > 0.5 * np.bincount(sheet, weights=area)
    return (most & ~known)[sheet] if agreed(mesh, most[sheet], flip) else np.zeros(len(sheet), bool)


def _inward(mesh: Mesh, sheet: Ints, turned: NDArray[np.bool_], outside: Array | None, thin: NDArray[np.bool_]
            ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:  # fmt: skip
    """Per sheet: whether it is inside out once its triangles agree, and whether it encloses nothing.

    Between the two sides of a ``thin`` part (T,) there is nothing, whatever their cells' diagonals.
    """
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    sign = np.where(turned, -1.0, 1.0)
    normal = 0.5 * np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    middle = (a + b + c) / 3

    def total(values: Array) -> Array:
        return np.bincount(sheet, weights=values).astype(float)

    size = total(np.where(thin, 0.0, area))
    safe = np.where(size > 0, size, 1.0)
    solid = np.where(thin, 0.0, area)
    center = np.stack([total(solid * middle[:, k]) for k in range(3)], axis=1) / safe[:, None]
    lever = np.einsum("tk,tk->t", normal, middle - center[sheet])
    volume = total(np.where(thin, 0.0, sign * lever)) / 3
    flat = np.abs(volume) <= _FLAT * size**1.5
    # What encloses nothing follows the point in the air, or else the majority of its own area.
    plain = total(sign * area)
    if outside is not None:
        facing = total(np.where(thin, 0.0, sign * np.einsum("tk,tk->t", normal, outside - middle)))
        plain = np.where(facing != 0, facing, plain)
    return np.where(flat, plain < 0, volume < 0), flat
