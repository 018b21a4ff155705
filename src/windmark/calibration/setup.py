"""From marks, markers, cameras and views to a network; what cannot take part is left out and named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network import Bars, KnownTogether, Network, NetworkState
from windmark.calibration.datum import Datum, Distance, Fixed, Free, Weighted
from windmark.errors import UsageError
from windmark.geometry import PARAMETERS, Camera, DegenerateGeometry, Pose
from windmark.geometry.camera import LENS_PARAMETERS
from windmark.options.calibration import SOLVER
from windmark.scene import MarkerCovariance, MarkerSet, Observations, View

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

LEAST_MARKS, LEAST_VIEWS = 4, 2
"""Marks a view needs, and views a free marker needs."""
"""Levenberg-Marquardt, or the paper's growing and shrinking steps."""


FOCUS, PRINCIPAL = "focus", "principal"
"""In ``prior_sigma``: how far the focal lengths (relative) and principal points (px) of single views are from their
camera's."""


@dataclass(frozen=True)
class Job:
    """A calibration, checked, before anything is solved.

    Parameters
    ----------
    observations, markers, views : as given; marks carry the index of view and marker
    cameras : by name, in order of first use
    free : free interior parameters
    datum, distances : as given
    rig : views of one frame share a pose of the rig
    free_focal : names of views with a focal length of their own
    prior_sigma : 1 sigma of free parameters round the start values, by name; of `FOCUS` that of the relative changes
        of the focal length in the views of ``free_focal``, of `PRINCIPAL` that of the shifts in ``free_principal``
    solver : see `options.calibration`
    ellipses : (O, 3) half axes and direction of the marks' ellipses
    free_principal : names of views with a principal point of their own
    """

    observations: Observations
    markers: MarkerSet
    views: tuple[View, ...]
    cameras: Mapping[str, Camera]
    free: tuple[str, ...]
    datum: Datum
    distances: tuple[Distance, ...]
    rig: bool
    free_focal: tuple[str, ...]
    prior_sigma: Mapping[str, float]
    solver: str = SOLVER.default
    ellipses: Array | None = None
    free_principal: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        obs, markers, views = self.observations, self.markers, self.views
        for name, index, size in (("view", obs.view, len(views)), ("point", obs.point, len(markers))):
            if len(index) and not (index.min() >= 0 and index.max() < size):
                raise ValueError(
                    f"self_calibrate: observations.{name} must be 0 ... {size - 1}, got {index.min()} ... {index.max()}"
                )
        names = [v.name for v in views]
        if len(set(names)) != len(names):
            twice = sorted({n for n in names if names.count(n) > 1})
            raise UsageError(f"self_calibrate: names of views must be unique, more than once: {', '.join(twice[:5])}")
        unknown = sorted({v.camera for v in views} - set(self.cameras))
        if unknown:
            raise UsageError(f"self_calibrate: views use unknown cameras {', '.join(unknown)}")
        both = obs.view.astype(np.int64) * max(len(markers), 1) + obs.point
        _, first, count = np.unique(both, return_index=True, return_counts=True)
        if (count > 1).any():
            o = first[count > 1][0]
            raise UsageError(
                f"self_calibrate: marker {markers.name[obs.point[o]]} is observed more than once in view "
                f"{views[int(obs.view[o])].name}; {int((count > 1).sum())} such pairs"
            )
        of_views = (FOCUS, PRINCIPAL)
        wrong = [p for p in self.free if p not in PARAMETERS]
        wrong += [p for p in self.prior_sigma if p not in (*PARAMETERS, *of_views)]
        if wrong:
            raise UsageError(f"self_calibrate: free: {wrong[0]!r} is none of {', '.join(PARAMETERS)}")
        lenses = {c.lens for c in self.cameras.values()}
        lacking = [p for p in self.free if not any(p in LENS_PARAMETERS[lens] for lens in lenses)]
        if lacking:
            raise UsageError(
                f"self_calibrate: free: a {' or '.join(sorted(lenses))} lens has no {lacking[0]}; it has "
                f"{', '.join(LENS_PARAMETERS[min(lenses)])}"
            )
        for what in of_views:
            if what in self.prior_sigma and not self.prior_sigma[what] > 0:
                raise UsageError(f"self_calibrate: prior_sigma: {what} must be > 0, got {self.prior_sigma[what]}")
        for what, asked in (("free_focal", self.free_focal), ("free_principal", self.free_principal)):
            if missing := sorted(set(asked) - set(names)):
                raise UsageError(f"self_calibrate: {what} names unknown views {', '.join(missing[:5])}")
        if self.ellipses is not None and self.ellipses.shape != (len(obs), 3):
            raise ValueError(f"self_calibrate: ellipses must be ({len(obs)}, 3), got {self.ellipses.shape}")
        SOLVER.check(self.solver, "self_calibrate")
        if not isinstance(self.datum, Fixed | Weighted | Free):
            raise UsageError(
                "self_calibrate: datum must be calibration.Fixed, Weighted or Free: what fixes position, direction and "
                f"size is never guessed; got {type(self.datum).__name__}"
            )

    def marker(self, name: str, what: str) -> int:
        """Index of a marker by name."""
        found = np.flatnonzero(self.markers.name == name)
        if not len(found):
            raise UsageError(f"self_calibrate: {what} names the unknown marker {name!r}")
        return int(found[0])

    def chosen(self, names: Sequence[str] | None, what: str) -> Mask:
        """(N,) markers by name; None takes all."""
        out = np.zeros(len(self.markers), dtype=np.bool_)
        if names is None:
            return ~out
        out[[self.marker(name, what) for name in names]] = True
        return out

    @property
    def held(self) -> Mask:
        """(N,) markers that do not move."""
        if isinstance(self.datum, Fixed):
            return self.chosen(self.datum.markers, "datum")
        return np.zeros(len(self.markers), dtype=np.bool_)

    def known_sigma(self) -> Array:
        """(N, 3) 1 sigma of the coordinates that a `Weighted` datum knows, inf of all others."""
        datum = self.datum
        if not isinstance(datum, Weighted):
            return np.full((len(self.markers), 3), np.inf)
        given = self.markers.sigma if datum.sigma is None else np.full((len(self.markers), 3), datum.sigma)
        if datum.covariance is not None:
            given = given.copy()
            given[[self.marker(str(n), "datum's covariance") for n in datum.covariance.name]] = datum.covariance.sigma
        chosen = self.chosen(datum.markers, "datum")[:, None] & np.isfinite(given)
        if not (given[chosen] > 0).all():
            raise UsageError("self_calibrate: datum Weighted: sigma must be > 0; hold markers with Fixed")
        if chosen.any(axis=1).sum() < 3:
            raise UsageError("self_calibrate: datum Weighted needs at least three markers with a sigma")
        return np.where(chosen, given, np.inf)

    def known_together(self, among: Mask) -> tuple[Ints, MarkerCovariance] | None:
        """Which of some markers, (N,), a datum knows with a joint covariance, in order, and that; None for none."""
        datum = self.datum
        if not isinstance(datum, Weighted) or datum.covariance is None:
            return None
        chosen = among & self.chosen(datum.markers, "datum") & np.isin(self.markers.name, datum.covariance.name)
        index = np.flatnonzero(chosen)
        return (index, datum.covariance.take(self.markers.name[index].tolist())) if len(index) else None


def taking_part(job: Job, used: Mask) -> tuple[Mask, dict[str, str]]:
    """Marks that can take part, (O,), and why views and markers cannot, by name.

    A view needs four marks, a free marker two views; leaving one out may leave others with too few.
    """
    obs, held = job.observations, job.held
    known = held.copy()
    if isinstance(job.datum, Weighted):
        known |= job.chosen(job.datum.markers, "datum")
    alive, dropped = used.copy(), {}
    while True:
        per_view = np.bincount(obs.view[alive], minlength=len(job.views))
        per_point = np.bincount(obs.point[alive], minlength=len(job.markers))
        poor_view = (per_view > 0) & (per_view < LEAST_MARKS)
        poor_point = (per_point > 0) & (per_point < LEAST_VIEWS) & ~known
        if not (poor_view.any() or poor_point.any()):
            break
        for v in np.flatnonzero(poor_view):
            dropped[job.views[v].name] = f"view with {per_view[v]} marks; {LEAST_MARKS} are needed"
        for p in np.flatnonzero(poor_point):
            dropped[str(job.markers.name[p])] = "marker seen in one view only"
        alive &= ~poor_view[obs.view] & ~poor_point[obs.point]
    for v in np.flatnonzero((per_view == 0) & ~np.isin([w.name for w in job.views], list(dropped))):
        dropped[job.views[v].name] = "view without marks"
    return alive, dropped


def make_network(job: Job, taken: Mask, weight: Array | None = None) -> Network:
    """The network of the marks that take part."""
    obs, markers, views = job.observations, job.markers, job.views
    names = list(job.cameras)
    camera = np.array([names.index(v.camera) for v in views], dtype=np.int64)
    frames, frame = frames_of(job)
    held = np.repeat(job.held[:, None], 3, axis=1)
    value = sigma = None
    if isinstance(job.datum, Weighted):
        value, sigma = markers.xyz, job.known_sigma()
    seen = np.zeros(len(markers), dtype=np.bool_)
    seen[obs.point[taken]] = True
    together = job.known_together(seen)
    tied = None
    if together is not None and sigma is not None:
        index, known = together
        sigma[index], tied = np.inf, KnownTogether(index, markers.xyz[index], known.whitener())
    free_offset = np.arange(len(names)) > 0 if job.rig else np.zeros(0, dtype=np.bool_)
    priors = {k: v for k, v in job.prior_sigma.items() if k in job.free}
    own = (
        [{k: v for k, v in priors.items() if k in LENS_PARAMETERS[c.lens]} for c in job.cameras.values()]
        if priors
        else []
    )
    return Network(
        view=obs.view[taken], point=obs.point[taken], xy=obs.xy[taken], cov=obs.cov[taken],
        view_camera=camera, view_frame=frame, view_offset=camera if job.rig else np.full(len(views), -1),
        free_camera=tuple(
            tuple(p for p in job.free if p in LENS_PARAMETERS[c.lens]) for c in job.cameras.values()
        ), free_frame=np.ones(len(frames), dtype=np.bool_), held=held,
        free_offset=free_offset, free_change=free_change(job), change_sigma=_change_sigma(job),
        point_value=value, point_sigma=sigma, bars=bars_of(job), together=tied,
        weight=None if weight is None else weight[taken],
        camera_sigma=own,
        camera_value=[{k: float(getattr(c, k)) for k in p} for c, p in zip(job.cameras.values(), own, strict=False)],
    )  # fmt: skip


def free_change(job: Job) -> Mask | None:
    """(V, 3) what each view may differ by from its camera, as `adjust.network.Network` has it; None for nothing."""
    if not (job.free_focal or job.free_principal):
        return None
    focal, principal = set(job.free_focal), set(job.free_principal)
    return np.array([[v.name in focal, v.name in principal, v.name in principal] for v in job.views], dtype=np.bool_)


def _change_sigma(job: Job) -> Array | None:
    """(V, 3) how much that is, beforehand."""
    focus, principal = (job.prior_sigma.get(what, np.inf) for what in (FOCUS, PRINCIPAL))
    return None if np.isinf([focus, principal]).all() else np.tile([focus, principal, principal], (len(job.views), 1))


def frames_of(job: Job) -> tuple[list[str], Ints]:
    """Names of the frames, and (V,) the frame of each view: the rig's instants, or every view by itself."""
    keys = [v.frame if job.rig else v.name for v in job.views]
    place = {key: n for n, key in enumerate(dict.fromkeys(keys))}
    return list(place), np.array([place[k] for k in keys], dtype=np.int64)


def bars_of(job: Job) -> Bars:
    """The known distances by the markers' indices."""
    ends = [(job.marker(d.first, "distances"), job.marker(d.second, "distances")) for d in job.distances]
    first, second = (np.array([e[n] for e in ends], dtype=np.int64) for n in (0, 1))
    return Bars(first, second, np.array([d.length for d in job.distances], dtype=float),
                np.array([d.sigma for d in job.distances], dtype=float))  # fmt: skip


def first_state(job: Job, cameras: Mapping[str, Camera], poses: Sequence[Pose | None]) -> NetworkState:
    """Values from cameras and the poses of views; those without take one of the others, they have no marks.

    Raises
    ------
    DegenerateGeometry
        When a camera of a rig shares no frame with the first.
    """
    names = list(job.cameras)
    keys, frame = frames_of(job)
    change = None if free_change(job) is None else np.zeros((len(job.views), 3))
    values = tuple(replace(cameras[n], cov=None) for n in names)
    usable = next(p for p in poses if p is not None)
    if not job.rig:
        return NetworkState(values, _stack([p or usable for p in poses]), job.markers.xyz.copy(), None, change)
    camera = np.array([names.index(v.camera) for v in job.views])
    offsets = [Pose.identity()]
    for c in range(1, len(names)):
        pairs = [
            there @ here.inverse()
            for a, here in enumerate(poses)
            for b, there in enumerate(poses)
            if here and there and camera[a] == 0 and camera[b] == c and frame[a] == frame[b]
        ]
        if not pairs:
            raise DegenerateGeometry(f"rig: camera {names[c]} has no frame in common with {names[0]}", (names[c],))
        offsets.append(_middle(pairs))
    frames = []
    for f in range(len(keys)):
        known = [(offsets[camera[v]], poses[v]) for v in np.flatnonzero(frame == f).tolist()]
        frames.append(next((offset.inverse() @ p for offset, p in known if p is not None), usable))
    return NetworkState(values, _stack(frames), job.markers.xyz.copy(), _stack(offsets), change)


def _stack(poses: list[Pose]) -> Pose:
    return Pose(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))


def _middle(poses: list[Pose]) -> Pose:
    """The pose with the smallest sum of distances to all others: wrong ones do no harm."""
    logs = np.array([[(a @ b.inverse()).log() for b in poses] for a in poses])
    scale = np.array([1.0, 1.0, 1.0, *(np.full(3, 1 / max(float(np.linalg.norm(poses[0].translation)), 1e-9)))])
    return poses[int(np.linalg.norm(logs * scale, axis=2).sum(axis=1).argmin())]


def changed(camera: Camera, change: Array) -> Camera:
    """The camera of one view, which differs by ``change`` (3,): relative focal length, principal point (px)."""
    if not change.any():
        return camera
    focal, x, y = (float(value) for value in change)
    return replace(camera, focal_px=camera.focal_px * (1 + focal), cx=camera.cx + x, cy=camera.cy + y)


def views_of(job: Job, state: NetworkState) -> list[tuple[Camera, Pose]]:
    """Camera (with the view's own focal length and principal point) and ``cam_from_model`` of every view."""
    names, (_, frame) = list(job.cameras), frames_of(job)
    out = []
    for v, view in enumerate(job.views):
        c = names.index(view.camera)
        camera = state.cameras[c] if state.change is None else changed(state.cameras[c], state.change[v])
        pose = Pose.trusted(state.frames.rotation[frame[v]], state.frames.translation[frame[v]])
        if state.offsets is not None:
            pose = Pose(state.offsets.rotation[c], state.offsets.translation[c]) @ pose
        out.append((camera, pose))
    return out
