"""Which nodes of the mesh a camera sees, where, how obliquely, and why not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.geometry.described import described
from windmark.resection.casting import cast, for_kernels, single_pose, to_camera_frame
from windmark.resection.reasons import BLANKED, FACING_AWAY, HIDDEN, OBLIQUE, REASONS, VISIBLE
from windmark.scene import Mesh
from windmark.scene.shown import check_kinds, pandas_table

Array = NDArray[np.float64]
Codes = NDArray[np.uint8]
Tolerance = float | Array | None

# Part of the size of what hides it (`Mesh.sizes`) by which a node may lie behind a triangle and still count as on it:
# above the rounding of single precision and of five-digit files, below any real thickness.
_TOLERANCE = 1e-5


@described(lambda v: {
    "nodes": len(v), "visible": int(v.visible.sum()),
    "picture": "not said" if v.size_px is None else f"{v.size_px[0]} x {v.size_px[1]} px",
})  # fmt: skip
@dataclass(frozen=True)
class NodeView:
    """Nodes (or other points of the surface) as one camera sees them.

    Parameters
    ----------
    xy : (V, 2) pixels, NaN behind the camera and beyond the lens model's range; given for hidden nodes too
    depth : (V,) z in the camera frame
    reason : (V,) uint8, `VISIBLE` = 0 or why not, see `REASONS`
    obliquity_deg : (V,) angle between the surface's normal and the line of sight: 0 seen squarely, 90
        edge-on, more: the normal points away. NaN where no normal is known
    size_px : (width, height) of the image that ``xy`` belongs to

    Examples
    --------
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> beside = wm.Pose.look_at([1.4, 0.0, 4.0], [1.4, 0.0, 0.0], [0.0, 1.0, 0.0])
    >>> view = wm.see_nodes(plate, wm.Camera((64, 48), 60.0), beside)
    >>> view.visible.tolist(), view.xy.round(1).tolist()
    ([False, True, True, False], [[-4.5, 38.5], [25.5, 38.5], [25.5, 8.5], [-4.5, 8.5]])
    >>> view.counts
    {'visible': 2, 'blanked': 0, 'lens': 0, 'outside': 2, 'facing_away': 0, 'oblique': 0, 'hidden': 0}
    """

    xy: Array
    depth: Array
    reason: Codes
    obliquity_deg: Array
    size_px: tuple[int, int]

    def __len__(self) -> int:
        return len(self.reason)

    @property
    def visible(self) -> NDArray[np.bool_]:
        """(V,): in the picture, turned to the camera and not hidden."""
        return self.reason == VISIBLE

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``: place, depth, obliquity of every node, and whether it is visible or why not."""
        return pandas_table({
            "x": self.xy[:, 0], "y": self.xy[:, 1], "depth": self.depth, "obliquity_deg": self.obliquity_deg,
            "reason": np.array(REASONS)[self.reason],
        })  # fmt: skip

    @property
    def counts(self) -> dict[str, int]:
        """How many nodes there are of each of `REASONS`."""
        return dict(zip(REASONS, np.bincount(self.reason, minlength=len(REASONS)).tolist(), strict=True))

    def follow(self, camera: Camera, cam_from_model: Pose, xyz: Array) -> NodeView:
        """The same nodes in a neighbouring frame of a sequence, without a new test of what hides what.

        Parameters
        ----------
        camera, cam_from_model : the new view
        xyz : (V, 3) the nodes, where they are now

        Returns
        -------
        NodeView with new ``xy`` and ``depth``. Nodes come and go at the image's border; "hidden",
        "facing_away" and "oblique", and the obliquities, are those of this view.
        """
        if np.shape(xyz) != (len(self), 3):
            raise ValueError(f"NodeView.follow: xyz must be ({len(self)}, 3), got {np.shape(xyz)}")
        _, xy, state, depth = look(camera, single_pose(cam_from_model, "NodeView.follow"), xyz)
        kept = np.isin(self.reason, (BLANKED, FACING_AWAY, OBLIQUE, HIDDEN))
        return replace(self, xy=xy, depth=depth, reason=np.where(kept, self.reason, state), size_px=camera.size_px)


def see_nodes(
    mesh: Mesh,
    camera: Camera,
    cam_from_model: Pose,
    *,
    max_obliquity_deg: float | None = None,
    two_sided: bool = False,
    tolerance: Tolerance = None,
) -> NodeView:
    """Where the nodes of the mesh are in the image, and which of them the camera sees.

    A node is visible when it is in the picture and within the lens model's range, when one of its
    triangles faces the camera, and when the line of sight meets nothing before it. The last is tested
    on the exact ray of each node, not on a depth image, so nodes on silhouettes and seams do not
    flicker and the resolution of the image does not matter.

    Parameters
    ----------
    mesh, camera, cam_from_model : the scene
    max_obliquity_deg : nodes seen more obliquely are not used (reason "oblique"); None for no limit
    two_sided : do not trust the orientation of the triangles: nothing "faces away", and what is on the
        back of a body is found to be hidden by its front. Right for a closed body whatever its blocks'
        orientations; an open surface is then seen from both sides. The obliquity is folded into 0-90
    tolerance : length by which a node may lie behind a triangle and still count as lying on it, one or of each triangle
        (T,); 1e-5 of `Mesh.sizes` by default. Overset blocks that do not match need more: the gap between them

    Returns
    -------
    NodeView

    Raises
    ------
    ValueError
        If ``cam_from_model`` is a batch, or a tolerance or angle is out of range.

    Notes
    -----
    By default the orientation is trusted as `Mesh` promises it (counter-clockwise from outside). A node
    faces the camera if any of its triangles does, so a node on an edge is not lost to its mean normal;
    the obliquity is that of the mean normal (of its own block, where blocks meet).

    Examples
    --------
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> camera = wm.Camera((64, 48), 60.0)
    >>> above, below = (wm.Pose.look_at([0.0, 0.0, z], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]) for z in (4.0, -4.0))
    >>> wm.see_nodes(plate, camera, above).visible.tolist()
    [True, True, True, True]
    >>> wm.see_nodes(plate, camera, below).visible.tolist()  # the surface faces away
    [False, False, False, False]
    >>> wm.see_nodes(plate, camera, below, two_sided=True).visible.tolist()
    [True, True, True, True]
    """
    check_kinds("see_nodes", mesh=(mesh, Mesh), camera=(camera, Camera), cam_from_model=(cam_from_model, Pose))
    pose = single_pose(cam_from_model, "see_nodes")
    least = hiding_tolerance(tolerance, mesh, "see_nodes")
    checked_angle(max_obliquity_deg, "see_nodes")
    cam, xy, reason, depth = look(camera, pose, mesh.vertices)
    normals, faces = _node_normals(cam, mesh.triangles)
    obliquity = _obliquity_deg(normals, cam, two_sided)
    if not two_sided:
        reason[(reason == VISIBLE) & (faces == 1)] = FACING_AWAY
    if max_obliquity_deg is not None:
        reason[(reason == VISIBLE) & (obliquity > max_obliquity_deg)] = OBLIQUE
    unused = faces == 0
    if mesh.blanked is not None:
        unused |= mesh.blanked
    reason[unused] = BLANKED
    asked = np.flatnonzero(reason == VISIBLE)
    reason[asked[is_hidden(cam, mesh.triangles, cam[asked], least)]] = HIDDEN
    return NodeView(xy, depth, reason, obliquity, camera.size_px)


def see_points(
    xyz: ArrayLike, camera: Camera, cam_from_model: Pose, *, mesh: Mesh | None = None, tolerance: Tolerance = None
) -> NodeView:
    """Where points (N, 3) are in the image and, with a mesh, whether it hides them.

    Points need not be nodes: pressure taps, markers, points of a `section`. They have no normal, so none
    faces away: on the back of a closed body they are hidden. NaN points are "outside".

    Parameters and errors as in `see_nodes`.
    """
    pose = single_pose(cam_from_model, "see_points")
    points = np.asarray(xyz, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"see_points: xyz must be (N, 3), got {points.shape}")
    cam, xy, reason, depth = look(camera, pose, points)
    if mesh is not None:
        least = hiding_tolerance(tolerance, mesh, "see_points")
        asked = np.flatnonzero(reason == VISIBLE)
        vertices_cam = to_camera_frame(pose, mesh.vertices)
        reason[asked[is_hidden(vertices_cam, mesh.triangles, cam[asked], least)]] = HIDDEN
    return NodeView(xy, depth, reason, np.full(len(points), np.nan), camera.size_px)


def is_hidden(vertices_cam: Array, triangles: NDArray[np.int32], points_cam: Array, tolerance: float | Array
              ) -> NDArray[np.bool_]:  # fmt: skip
    """Whether something lies before the points (N, 3), all in the camera frame and in front of it.

    ``tolerance`` is one length, or that of each triangle (T,) where it is the one that hides.
    The distance is taken across the hiding triangle, not along the ray: a bias in depth scaled with the
    slope, without a parameter for it.
    """
    from windmark.resection import _points

    if not len(points_cam):
        return np.zeros(0, bool)
    triangles = for_kernels(triangles)
    hits = cast(vertices_cam, triangles, points_cam[:, :2] / points_cam[:, 2:])
    behind = np.empty(len(points_cam))
    _points.distance_behind(vertices_cam, triangles, points_cam, hits.triangle, behind)
    return behind > (tolerance if isinstance(tolerance, float) else np.asarray(tolerance)[hits.triangle])


def hiding_tolerance(tolerance: Tolerance, mesh: Mesh, verb: str) -> float | Array:
    """What `is_hidden` wants: one length, or one for each triangle; by default a part of `Mesh.sizes`."""
    if tolerance is None:
        return _TOLERANCE * mesh.sizes if len(mesh.triangles) else 0.0
    if np.ndim(tolerance) == 0:
        return checked_tolerance(float(tolerance), mesh, verb)
    each = np.asarray(tolerance, dtype=float)
    if each.shape != (len(mesh.triangles),) or not ((each >= 0) & (each < np.inf)).all():
        raise ValueError(f"{verb}: tolerance must be a length >= 0, or one of each triangle, got {each.shape}")
    return each if len(each) else 0.0


def checked_tolerance(tolerance: float | None, mesh: Mesh, verb: str) -> float:
    """The tolerance in length units; by default that of the smallest of `Mesh.sizes`: at a far field's scale the two
    sides of a thin trailing edge would be one.
    """
    if tolerance is None:
        return _TOLERANCE * float(mesh.sizes.min()) if len(mesh.triangles) else 0.0
    if not 0 <= tolerance < np.inf:
        raise UsageError(f"{verb}: tolerance must be a length >= 0, got {tolerance}")
    return float(tolerance)


def checked_angle(max_obliquity_deg: float | None, verb: str) -> None:
    """Refuse an impossible limit."""
    if max_obliquity_deg is not None and not 0 < max_obliquity_deg <= 180:
        raise UsageError(f"{verb}: max_obliquity_deg must be in (0, 180], got {max_obliquity_deg}")


def look(camera: Camera, pose: Pose, points: Array) -> tuple[Array, Array, Codes, Array]:
    """Camera coordinates, pixels, state (VISIBLE, LENS or OUTSIDE) and depth of points (N, 3)."""
    from windmark.resection import _points

    n = len(points)
    cam, xy, state = np.empty((n, 3)), np.empty((n, 2)), np.empty(n, np.uint8)
    size = np.array(camera.size_px, dtype=float)
    points = np.ascontiguousarray(points, dtype=float)
    _points.look(pose.rotation, pose.translation, camera.packed(), size, points, cam, xy, state)
    return cam, xy, state, cam[:, 2]


def _node_normals(cam: Array, triangles: NDArray[np.int32]) -> tuple[Array, Codes]:
    from windmark.resection import _points

    normals, faces = np.zeros((len(cam), 3)), np.zeros(len(cam), np.uint8)
    _points.node_normals(cam, for_kernels(triangles), normals, faces)
    return normals, faces


def _obliquity_deg(normals: Array, cam: Array, two_sided: bool) -> Array:
    """Angle of normals (V, 3) to the line from the points to the camera; NaN without a normal."""
    along = -np.einsum("vk,vk->v", normals, cam)
    across = np.linalg.norm(np.cross(normals, cam), axis=1)
    angle = np.degrees(np.arctan2(across, np.abs(along) if two_sided else along))
    return np.where((along != 0) | (across != 0), angle, np.nan)
