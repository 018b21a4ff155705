"""What `register` gives back: a registration of one camera or of a rig, or why there is none."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.adjust import SolveReport
from windmark.errors import g2, g3
from windmark.geometry import Camera, Pose
from windmark.geometry.described import described
from windmark.registration.cached import cached_property
from windmark.registration.directions import WeakDirection, weak_directions
from windmark.scene import Detections, MarkerSet, Matching
from windmark.scene.shown import pandas_table

Array = NDArray[np.float64]

CAUSES = {
    "too_few": "too few spots or markers to fix a pose and check it",
    "degenerate": "the spots or the markers lie on one line",
    "nothing": "no pose explains the spots",
    "weak": "the best solution could be chance",
    "misfit": "the best solution does not fit within the tolerance",
    "ambiguous": "two different solutions explain the spots about equally well",
    "focal": "the focal length is not determined by this view",
    "wrong_focal": "the given focal length does not fit",
    "wrong_camera": "the given camera does not fit: its principal point, aspect, lens, or place in the rig",
    "exchanged": "two cameras of the rig are in each other's place",
    "mirrored": "the mirror image of the table fits the picture, the table does not",
    "one_pair": "a single pair holds the pose",
    "discs": "the table's radii or normals contradict the picture",
    "labels": "a fixed label contradicts what the spots show",
    "time": "the time limit came first",
}
"""Every cause of a `NotRegistered`, in words."""
CONTRADICTED = ("wrong_focal", "wrong_camera", "mirrored", "misfit")
"""Causes that speak of a picture as a whole: it contradicts the camera or the markers."""
Cause = Literal[
    "too_few", "degenerate", "nothing", "weak", "misfit", "ambiguous", "focal", "wrong_focal", "wrong_camera",
    "exchanged", "mirrored", "one_pair", "discs", "labels", "time",
]  # fmt: skip


@dataclass(frozen=True)
class RunnerUp:
    """The best solution that is *distinct* from the one reported.

    Parameters
    ----------
    score : its log-likelihood ratio in nats, to compare with that of the best
    cam_from_model : its pose
    count : its matched markers
    same_labels : it is another pose of mostly the same pairs (mirrored in a plane), not another labelling
    """

    score: float
    cam_from_model: Pose
    count: int
    same_labels: bool


@dataclass(frozen=True)
class Unchecked:
    """Something that the picture cannot tell: an error of it would go unnoticed and move the pose.

    Parameters
    ----------
    what : "focal length", "principal point", "aspect", "lens", "place in the rig", "scale", "mirror", "shift",
        "copy", "pair", "bending", "radii", "twice", or "camera", one that is taken as exact
    words : why, and how large an error this picture would show
    camera : number of the camera, of a rig
    """

    what: str
    words: str
    camera: int = 0


@dataclass(frozen=True)
class Deformation:
    """How a model differs from its table: a smooth displacement of all markers, found together with the pose.

    A rigid motion is no deformation, and which part of the model stands still the picture does not tell, unless there
    are walls: the pose is the mean of those by which one or another part would, and its covariance has how far these
    are apart. A displacement along the line of sight can hardly be seen by one camera: there the sigma is that of what
    was expected.

    Parameters
    ----------
    displacement : (N, 3) of every marker from its place in the table, in the model's frame and unit; of markers that
        were not seen it is a prediction
    sigma : (N, 3) 1 sigma of it
    shift_px : (N, 2) what it does in the image
    largest : largest displacement of a matched marker beyond a rigid motion of all of them, as part of the model's
        largest extent
    parameters : how many parameters of it this view determines
    """

    displacement: Array
    sigma: Array
    shift_px: Array
    largest: float
    parameters: float

    @property
    def largest_px(self) -> float:
        """Largest shift of a marker in the image."""
        return float(np.linalg.norm(self.shift_px, axis=1).max())


@dataclass(frozen=True, kw_only=True)
class _Found:
    """What the registrations of one camera and of a rig have in common; see there."""

    rms_px: float
    cov: Array
    score: float
    log10_nfa: float
    runner_up: RunnerUp | None
    n_hypotheses: int
    report: SolveReport
    xyz: Array
    deformation: Deformation | None = None
    unchecked: tuple[Unchecked, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return True


def _figures(r: Registration) -> dict[str, object]:
    pov = r.cam_from_model.to_pov()
    return {
        "markers": f"{len(r.matching)} of {r.n_expected}", "rms px": f"{g3(r.rms_px)}",
        "excess px": f"{g2(r.excess_px)}", "log10_nfa": f"{r.log10_nfa:.0f}",
        "rx, ry, rz deg": f"{pov.rx_deg:.3f}, {pov.ry_deg:.3f}, {pov.rz_deg:.3f}",
        "dx, dy, dz": f"{pov.dx:.5g}, {pov.dy:.5g}, {pov.dz:.5g}", "focal px": f"{r.camera.focal_px:.2f}",
        "weak": "; ".join(w.words() for w in r.weak) or "nothing",
    }  # fmt: skip


@described(_figures)
@dataclass(frozen=True, kw_only=True)
class Registration(_Found):
    """Which spot is which marker, and where the camera was.

    Parameters
    ----------
    cam_from_model : the pose
    camera : the camera; with ``free_focal`` the focal length found, the other parameters as given (moved within
        ``camera.cov`` if that was given), and their covariance
    matching : the pairs, in order of markers
    rms_px : root mean square length of the residuals
    residuals : (K, 2) projected - detected, pixels, in the order of the matching. Projected is the centre of the imaged
        disc where a marker's normal and radius are known, else the image of its centre
    cov : (6, 6) covariance of [rotation, translation] for ``exp(delta) @ cam_from_model``; with ``free_focal``
        (7, 7), the focal length last. It includes the excess; where this looks like that of a
        bent model, what such a one would change; and of a bent model that its root, whose pose it is, is not known.
        Distance and focal length grow together: where they are
        known to some percent only, their errors are normal as logarithms
    excess_px : 1 sigma per coordinate of the misfit beyond the covariances of detections and markers:
        table errors, lens, and what is left of a deformation
    score : log-likelihood ratio in nats against "the spots are where they are by chance"
    log10_nfa : decimal logarithm of the false-alarm number: how many labellings this good chance would give
    runner_up : the best distinct other solution, None if the search met none
    n_expected : markers that should be seen from there (in the image, facing the camera), matched ones included
    n_hypotheses : links of three markers to three spots that were tried
    report : why the last adjustment stopped
    xyz : (N, 3) the markers of the table
    deformation : None if the rigid model explains the spots. Otherwise the residuals are those of the deformed one
    unchecked : what this picture cannot tell, though the pose rests on it
    options : everything the registration was made with, by name

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> rng = np.random.default_rng(1)
    >>> markers = wm.MarkerSet.make([f"m{i}" for i in range(20)], rng.uniform(-1.0, 1.0, (20, 3)) * [2.0, 1.0, 0.2])
    >>> camera, pose = wm.Camera((640, 480), 800.0), wm.Pose.look_at([0.5, 0.3, 6.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    >>> spots = wm.Detections.make(camera.project(pose.apply(markers.xyz))[0].round(1)[::-1])  # in any order
    >>> answer = wm.register(spots, markers, camera)
    >>> bool(answer), len(answer.matching), answer.rms_px < 0.1
    (True, 20, True)
    >>> answer.matching.detection[:3].tolist()  # the spots of the first three markers
    [19, 18, 17]
    >>> answer.weak  # no direction in which the pose is not well known
    ()
    """

    cam_from_model: Pose
    camera: Camera
    matching: Matching
    residuals: Array
    excess_px: float
    n_expected: int

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``: marker, spot and residual (projected - detected, pixels) of every pair."""
        residual = self.residuals
        return pandas_table({
            "marker": self.matching.marker, "detection": self.matching.detection, "dx": residual[:, 0],
            "dy": residual[:, 1], "distance_px": np.hypot(residual[:, 0], residual[:, 1]),
        })  # fmt: skip

    def plot(
        self, detections: Detections, markers: MarkerSet | None = None, image: ArrayLike | None = None, ax: Any = None
    ) -> Any:
        """Matched spots with residuals as arrows, other spots grey, names where the table is given; matplotlib's axes.

        Parameters
        ----------
        detections, markers : those of the registration
        image : (H, W) to draw over
        """
        from windmark.scene import plots

        ax = plots.pixel_axes(ax, image, detections.xy)
        matched = detections.xy[self.matching.detection]
        ax.plot(*np.delete(detections.xy, self.matching.detection, axis=0).T, ".", color="tab:gray")
        ax.plot(*matched.T, ".", color="tab:blue")
        plots.arrows(ax, matched, self.residuals)
        if markers is not None:
            for name, xy in zip(markers.name[self.matching.marker], matched, strict=True):
                ax.annotate(str(name), xy, (3, 3), textcoords="offset points", fontsize="x-small")
        return ax

    @cached_property
    def weak(self) -> tuple[WeakDirection, ...]:
        """Directions that the spots hardly determine, weakest first; of a camera without a marker of its own none."""
        if not len(self.matching):
            return ()
        return weak_directions(self.cam_from_model, self.camera.focal_px, self.cov, self.matched_xyz)

    @cached_property
    def off_table(self) -> float:
        """How far the matched markers are off their table (1 sigma per coordinate, in its length unit), if all of the
        excess is theirs; NaN without a marker.
        """  # fmt: skip
        if not len(self.matching):
            return math.nan
        depth = float(np.median(self.cam_from_model.apply(self.matched_xyz)[:, 2]))
        return self.excess_px * depth / self.camera.focal_px

    @property
    def matched_xyz(self) -> Array:
        """(K, 3) the matched markers, with the deformation."""
        xyz = self.xyz if self.deformation is None else self.xyz + self.deformation.displacement
        return xyz[self.matching.marker]


@described(lambda r: {
    "markers": ", ".join(f"{n} of {m}" for n, m in zip(r.counts, r.n_expected, strict=True)),
    "rms px": f"{g3(r.rms_px)}", "log10_nfa": f"{r.log10_nfa:.0f}",
})  # fmt: skip
@dataclass(frozen=True, kw_only=True)
class RigRegistration(_Found):
    """Which spot is which marker in each of C cameras, and where the model was.

    Parameters
    ----------
    rig_from_model : the pose
    cameras : with a free focal length as found, and moved within ``Camera.cov`` where that was given; else as given
    cam_from_rig : as given, moved within ``rig_cov`` where that was
    matchings : of each camera, the pairs in order of markers; empty where a camera had no spots
    rms_px : root mean square length of all residuals
    residuals : of each camera, (K, 2) projected - detected, pixels, in the order of its matching. Projected is the
        centre of the imaged disc where a marker's normal and radius are known, else the image of its centre
    cov : (6, 6) covariance of [rotation, translation] for ``exp(delta) @ rig_from_model``. It includes the excess, and
        what places of cameras that are slightly off would change
    excess_px : (C,) 1 sigma per coordinate of the misfit beyond the covariances of detections and markers: table
        errors, lens, bending, errors of ``cam_from_rig``; NaN where no marker was matched
    score : log-likelihood ratio in nats against "the spots are where they are by chance", all cameras together
    log10_nfa : decimal logarithm of the false-alarm number: how many labellings this good chance would give
    runner_up : the best distinct other solution, as the first camera would see it; None if the search met none
    n_expected : of each camera, markers that should be seen, matched ones included; 0 where it had no spots
    n_hypotheses : links of three markers to three spots that were tried, in all cameras
    report : why the last adjustment stopped
    xyz : (N, 3) the markers of the table
    deformation : None if the rigid model explains the spots; its ``shift_px`` is that in the first camera
    unchecked : what these pictures cannot tell, though the pose rests on it
    options : everything the registration was made with, by name

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> rng = np.random.default_rng(1)
    >>> markers = wm.MarkerSet.make([f"m{i}" for i in range(20)], rng.uniform(-1.0, 1.0, (20, 3)) * [2.0, 1.0, 0.2])
    >>> camera = wm.Camera((640, 480), 800.0)
    >>> poses = [wm.Pose.look_at([x, 0.3, 6.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]) for x in (-1.0, 1.0)]
    >>> spots = [wm.Detections.make(camera.project(pose.apply(markers.xyz))[0].round(1)) for pose in poses]
    >>> answer = wm.register_rig(spots, markers, [camera, camera], [pose @ poses[0].inverse() for pose in poses])
    >>> answer.counts
    (20, 20)
    >>> bool(answer.cam_from_model(1).angle_to(poses[1]) < 1e-3)
    True
    """

    rig_from_model: Pose
    cameras: tuple[Camera, ...]
    cam_from_rig: tuple[Pose, ...]
    matchings: tuple[Matching, ...]
    residuals: tuple[Array, ...]
    excess_px: Array
    n_expected: tuple[int, ...]

    @property
    def counts(self) -> tuple[int, ...]:
        """Matched markers of each camera."""
        return tuple(len(m.marker) for m in self.matchings)

    def cam_from_model(self, i: int) -> Pose:
        """The pose as camera i sees it."""
        return self.cam_from_rig[i] @ self.rig_from_model


@dataclass(frozen=True)
class NotRegistered:
    """The data says no. Falsy.

    Parameters
    ----------
    reason : why, in words for the user
    cause : key of `CAUSES`
    best_count : matched markers of the best solution met, 0 without one
    best_candidate : its pose, not to be trusted; None without one
    runner_up : the solution it could not be told from, if any
    n_hypotheses : links of three markers to three spots that were tried
    weak : with the cause "focal", the directions that the spots hardly determine, weakest first
    options : everything the attempt was made with, by name

    Examples
    --------
    >>> import windmark as wm
    >>> markers = wm.MarkerSet.make(["a", "b"], [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    >>> answer = wm.register(wm.Detections.make([[100, 100], [200, 100]]), markers, wm.Camera((640, 480), 800.0))
    >>> bool(answer), answer.cause
    (False, 'too_few')
    >>> answer.reason
    '2 spots: three pairs fix a pose and a fourth is needed to check it'
    """

    reason: str
    cause: Cause
    best_count: int = 0
    best_candidate: Pose | None = None
    runner_up: RunnerUp | None = None
    n_hypotheses: int = 0
    weak: tuple[WeakDirection, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return False
