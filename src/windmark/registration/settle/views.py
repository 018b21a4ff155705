"""C cameras that see the same markers at once, as the settle kernels want them, and how their interiors may vary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.registration._kernels.near import nearest
from windmark.registration.cached import cached_property
from windmark.registration.search.layout import Layout
from windmark.registration.search.plane import Plane, density_of
from windmark.registration.settle._kernels.doubt import DOUBTS, doubted_kernel
from windmark.registration.settle._kernels.state import PLACE, ROWS, WIDE, Sights

Array = NDArray[np.float64]

PARAMETERS_PACKED = 11
"""Interior parameters at the head of a packed camera."""
SURE = 1e-9
"""Directions of a covariance with less than this part of its largest variance are no freedom."""
AT_HOME = Pose.identity()
HOME = AT_HOME.rotation[None], AT_HOME.translation[None]
"""Of a single camera in the rig that it is."""


@dataclass(frozen=True, eq=False)
class Views:
    """What C cameras saw.

    Parameters
    ----------
    planes : of each camera: task, layout and search plane
    cam_from_rig : of each camera; the identity for a single one
    loose : (C, 22, P) how the cameras may vary, see `Sights`
    modes : (K, N, 3) how the unit model may be deformed, by 1 sigma
    names : (C,) numbers of the cameras among all that were given, those without spots too
    """

    planes: tuple[Plane, ...]
    cam_from_rig: tuple[Pose, ...]
    loose: Array
    modes: Array
    names: tuple[int, ...]

    @classmethod
    def of(
        cls, planes: Sequence[Plane], cam_from_rig: Sequence[Pose] | None = None, names: Sequence[int] = (),
        rig_cov: Sequence[Array | None] = (),
    ) -> Views:  # fmt: skip
        """Rigid, with the cameras as open as their tasks and the covariances (6, 6) of their places say."""
        poses = tuple(cam_from_rig) if cam_from_rig is not None else (AT_HOME,) * len(planes)
        columns = [known_camera(p.task.camera, p.task.focal_sigma) for p in planes]
        places = [known_place(cov, planes[0].layout.frame.scale) for cov in rig_cov]
        none = np.zeros((0, len(planes[0].model.xyz), 3))
        views = cls(tuple(planes), poses, _stacked(columns), none, tuple(names) or tuple(range(len(planes))))
        return views.opened(places) if any(place.size for place in places) else views

    @property
    def layout(self) -> Layout:
        """Of the markers."""
        return self.planes[0].layout

    def bent(self, modes: Array) -> Views:
        """The same with a model that may be deformed."""
        return self._with(modes=modes)

    def doubted(self, *, columns: Sequence[int] = range(len(DOUBTS))) -> Views:
        """The same with cameras that may be wrong, in some columns of `doubted_camera` (of each)."""
        return self.opened([doubted_camera(p.task.camera)[:, list(columns)] for p in self.planes])

    def without(self, taken: Sequence[NDArray[np.bool_]]) -> Views:
        """The same, with some of the spots (of each camera (M,) bool) left to no marker."""
        sights = self.sights
        gone = np.concatenate(list(taken))
        order, x = sights.by_x.copy(), sights.x.copy()
        for first, last in zip(sights.first[:-1], sights.first[1:], strict=True):
            own = slice(first, last)
            out = gone[own][order[own]]
            # What is beyond the last is never met; see `settle._kernels.label`.
            x[own] = np.concatenate([x[own][~out], np.full(int(out.sum()), np.inf)])
            order[own] = np.concatenate([order[own][~out], order[own][out]])
        return self._with(sights=sights._replace(by_x=order, x=x))

    def mirrored(self, flip: Array) -> Views:
        """The same spots with the table mirrored by ``flip`` (3, 3); normals unknown."""
        sights, modes = self.sights, self.modes @ flip if len(self.modes) else self.modes
        normal = np.zeros_like(sights.normal)
        return self._with(sights=sights._replace(xyz=sights.xyz @ flip, normal=normal, modes=modes))

    @property
    def gone(self) -> NDArray[np.bool_]:
        """(S,) spots of all cameras, one after the other, that are left to no marker."""
        sights, out = self.sights, np.zeros(len(self.sights.xy), dtype=bool)
        out[sights.by_x + np.repeat(sights.first[:-1], np.diff(sights.first))] = np.isinf(sights.x)
        return out

    def opened(self, extra: Sequence[Array]) -> Views:
        """The same with cameras that may vary in more ways, (22, p) each."""
        return self._with(loose=np.concatenate([self.loose, _stacked(extra)], axis=2))

    def with_place(self, c: int, cam_from_rig: Pose) -> Views:
        """The same with camera c elsewhere."""
        poses = list(self.cam_from_rig)
        poses[c] = cam_from_rig
        return self._with(poses=tuple(poses))

    def _with(
        self, *, loose: Array | None = None, modes: Array | None = None, poses: tuple[Pose, ...] | None = None,
        sights: Sights | None = None,
    ) -> Views:  # fmt: skip
        sights = sights or self.sights
        if loose is not None:
            sights = sights._replace(loose=loose)
        if modes is not None:
            sights = sights._replace(modes=np.ascontiguousarray(modes))
        if poses is not None:
            rotation, translation = _places(poses, self.layout.frame.scale)
            sights = sights._replace(rotation=rotation, translation=translation)
        other = Views(self.planes, poses or self.cam_from_rig, sights.loose, sights.modes, self.names)
        other.__dict__.update(sights=sights, leads=self.leads, densities=self.densities)
        return other

    @cached_property
    def sights(self) -> Sights:
        """All of it for the kernels."""
        planes, layout = self.planes, self.layout
        xy = [np.ascontiguousarray(p.task.xy) for p in planes]
        order = [p[:, 0].argsort(kind="stable") for p in xy]
        cov = [p.task.cov.reshape(-1, 4)[:, [0, 1, 3]] for p in planes]
        leads, dense, shares = _by_lead(self)
        return Sights(
            layout.model.xyz, layout.model.normal, layout.model.near, layout.sigma_of(planes[0].task.markers),
            self.modes,
            *_places(self.cam_from_rig, layout.frame.scale),
            np.array([0, *accumulate(len(p) for p in xy)]), _joined(xy), _joined(cov),
            _joined([d[-1] for d in self.densities]), leads, dense, shares, np.array([p.fixed_count for p in planes]),
            _joined(order), _joined([p[o, 0] for p, o in zip(xy, order, strict=True)]),
            np.array([p.size for p in planes]), np.array([p.radius for p in planes]),
            np.array([p.task.tolerance_px for p in planes]), np.array([p.packed for p in planes]),
            self.loose,
        )  # fmt: skip

    @cached_property
    def leads(self) -> tuple[NDArray[np.int64], ...]:
        """Of each camera, the prefixes of its list of spots."""
        return tuple(np.array(plane.leads) for plane in self.planes)

    @cached_property
    def densities(self) -> tuple[Array, ...]:
        """Of each camera, (L, M) the spots per px^2 round each spot, among the spots of each prefix."""
        return tuple(_densities(plane) for plane in self.planes)

    def camera(self, c: int, packed: Array) -> Camera:
        """Camera c with the parameters (17,) of a state."""
        given = self.planes[c].task.camera
        if np.array_equal(packed, self.planes[c].packed):
            return given
        return given.with_parameters(
            np.concatenate([packed[:PARAMETERS_PACKED], packed[PARAMETERS_PACKED + 1 : -2], packed[-1:]]), cov=given.cov
        )


def known_camera(camera: Camera, focal_sigma: float) -> Array:
    """(22, P) how a camera may vary by what is known of it: `Camera.cov`, and a free focal length of so large a sigma.

    A free focal length comes first; row 0 is of its logarithm.
    """
    if camera.cov is None:
        return np.eye(ROWS, int(focal_sigma > 0)) * focal_sigma
    cov = np.array(camera.cov)
    if focal_sigma > 0:
        cov[0, :], cov[:, 0] = 0.0, 0.0
    unit = np.sqrt(np.diag(cov))
    safe = np.where(unit > 0, unit, 1.0)  # the parameters' units differ by orders
    value, vector = np.linalg.eigh(cov / np.outer(safe, safe))
    kept = value > SURE
    columns = np.zeros((ROWS, int(kept.sum())))
    change = unit[:, None] * vector[:, kept] * np.sqrt(value[kept])
    columns[:PARAMETERS_PACKED], columns[WIDE:] = change[:PARAMETERS_PACKED], change[PARAMETERS_PACKED:]
    columns[0] /= camera.focal_px
    if focal_sigma > 0:
        columns = np.concatenate([np.eye(ROWS, 1) * focal_sigma, columns], axis=1)
    return columns


def doubted_camera(camera: Camera) -> Array:
    """(22, 5) how a camera may be wrong: focal length, aspect, principal point in x and y, lens (see `DOUBTS`)."""
    return np.asarray(doubted_kernel(camera.packed(), np.array(camera.size_px, dtype=float)))


def known_place(cov: Array | None, scale: float) -> Array:
    """(22, P) how a camera's place in the rig may vary, by the covariance (6, 6) of ``exp(delta) @ cam_from_rig``."""
    if cov is None:
        return np.zeros((ROWS, 0))
    unit = np.repeat([1.0, 1 / scale], 3)
    value, vector = np.linalg.eigh(cov * np.outer(unit, unit))
    kept = value > SURE * value[-1]
    columns = np.zeros((ROWS, int(kept.sum())))
    columns[PLACE:WIDE] = vector[:, kept] * np.sqrt(value[kept])
    return columns


def doubted_place(turn: float, shift: float) -> Array:
    """(22, 6) a camera's place that is known to ``turn`` (radians) and ``shift`` (sizes of the model), 1 sigma."""
    columns = np.zeros((ROWS, 6))
    columns[PLACE:WIDE] = np.diag(np.repeat([turn, shift], 3))
    return columns


def _places(poses: Sequence[Pose], scale: float) -> tuple[Array, Array]:
    """(C, 3, 3) and (C, 3) of poses, in sizes of the model."""
    if len(poses) == 1 and poses[0] is AT_HOME:
        return HOME
    return np.array([pose.rotation for pose in poses]), np.array([pose.translation for pose in poses]) / scale


def _densities(plane: Plane) -> Array:
    xy, size = plane.task.xy, plane.size
    if len(plane.leads) == 1:
        return density_of(plane.task.near_px, size)[None]
    out = np.full((len(plane.leads), len(xy)), np.nan)
    for row, lead in zip(out, plane.leads, strict=True):
        near = plane.task.near_px if lead == len(xy) else nearest(xy[:lead], min(4, lead - 1))[1]
        row[:lead] = density_of(near, size)
    return out


def _by_lead(views: Views) -> tuple[NDArray[np.int64], Array, Array]:
    """`Sights.leads`, `Sights.dense` and `Sights.log_share`."""
    if len(views.planes) == 1:
        plane = views.planes[0]
        return views.leads[0][None], views.densities[0], plane.log_shares(plane.leads)[None]
    most, count = max(len(leads) for leads in views.leads), len(views.planes)
    leads, shares, first = np.zeros((count, most), np.int64), np.zeros((count, most)), 0
    dense = np.full((most, sum(len(plane.task.xy) for plane in views.planes)), np.nan)
    for c, plane in enumerate(views.planes):
        own = len(plane.leads)
        leads[c, :own], shares[c, :own] = plane.leads, plane.log_shares(plane.leads)
        dense[:own, first : first + len(plane.task.xy)] = views.densities[c]
        first += len(plane.task.xy)
    return leads, dense, shares


def _stacked(columns: Sequence[Array]) -> Array:
    """(C, 22, P) of (22, p) each, filled up with columns that change nothing."""
    out = np.zeros((len(columns), ROWS, max(c.shape[1] for c in columns)))
    for own, c in zip(out, columns, strict=True):
        own[:, : c.shape[1]] = c
    return out


def _joined(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    return np.ascontiguousarray(parts[0] if len(parts) == 1 else np.concatenate(list(parts)))
