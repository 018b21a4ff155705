"""What a self-calibration gives back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import SolveReport
from windmark.calibration.hardly_checked import Hardly, HardlyBar, hardly_checked_words
from windmark.calibration.setup import changed
from windmark.errors import g2, g3
from windmark.geometry import Camera, Pose
from windmark.geometry.described import described
from windmark.scene import Doubt, MarkerSet, Observations, View
from windmark.scene.shown import pandas_table

Array = NDArray[np.float64]

CAUSES = {
    "too_few": "too few marks, pictures or markers",
    "degenerate": "the pictures do not determine what was asked for",
    "misfit": "the marks do not fit any solution that was found",
    "mirrored_marks": "the marks of pictures are mirrored, or their y is counted upward",
    "not_flat": "the dots of the board are not on one plane",
    "not_converged": "the adjustment did not reach a minimum",
    "control": "what is known of markers or distances contradicts itself",
    "units": "a known distance is in another unit than the markers' places",
    "discs": "the table's radii contradict the ellipses in the pictures",
}
"""Every cause of a `NotCalibrated`, in words."""


def _figures(c: Calibration) -> dict[str, object]:
    focal = ", ".join(f"{n} {k.focal_px:.2f} ± {g2(c.sigma(n, 'focal_px'))}" for n, k in c.cameras.items())
    sigma = float(np.sqrt((c.markers.sigma**2).mean()))
    return {
        "views": len(c.views), "markers": len(c.markers), "marks": f"{int(c.used.sum())} of {len(c.used)}",
        "sigma0": f"{g3(c.sigma0)}", "rms px": f"{g3(c.rms_px)}", "focal px": focal,
        "markers' sigma": f"{g2(sigma)} {c.markers.length_unit}".rstrip(),
        "warnings": "; ".join(c.warnings) or "none",
    }  # fmt: skip


@described(_figures)
@dataclass(frozen=True)
class Calibration:
    """Cameras, poses and marker coordinates from one adjustment, with their uncertainties.

    Parameters
    ----------
    cameras : by name, with ``cov`` over their free parameters
    views : the views that took part, with their poses
    markers : the markers that took part; ``sigma`` from this adjustment, times ``sigma0`` where that is above 1
    marker_cov : (N, 3, 3) their covariances in the datum, times ``max(1, sigma0)**2``
    pose_cov : (V, 6, 6) of ``exp(delta) @ cam_from_model``, times ``max(1, sigma0)**2``
    observations : the marks that took part: ``view`` and ``point`` are those of this result
    residuals : (O, 2) projected - observed in pixels
    test : (O,) squared residual in units of its own standard deviation: chi-square with two degrees of freedom for a
        right mark, beside the residuals of the others
    used : (O,) False for gross errors, which were left out of the adjustment
    sigma0 : standard deviation of unit weight: 1 where the residuals are as large as the covariances of the marks say
    redundancy : observations minus unknowns
    rms_px : root mean square length of the residuals of the used marks
    focal_change : (V,) relative change of the focal length of each view; zero where it is that of its camera
    principal_shift : (V, 2) shift of the principal point of each view (px), likewise
    cam_from_rig : of each camera of a rig, the first one's is the identity; empty without a rig
    rig_cov : (6, 6) of ``exp(delta) @ cam_from_rig`` of each, times ``max(1, sigma0)**2``
    dropped : why views or markers did not take part, by their name
    suspect : names of what contradicts the rest: control that was left out, markers and views that lost a quarter of
        their marks (a marker that moved, a picture out of focus)
    doubts : what was found to be wrong, or weaker than it looks; ``warnings`` are their sentences
    swapped : (first, second, view) names of markers whose marks were exchanged
    report : why the adjustment stopped
    options : everything it was made with, by name
    hardly_checked, hardly_checked_bars : known markers, and known distances, whose errors the others hardly show, the
        worst first; no sigma contains them

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> rng = np.random.default_rng(1)
    >>> markers = wm.MarkerSet.make([f"m{i}" for i in range(30)], rng.uniform(-1.0, 1.0, (30, 3)) * [2.0, 1.5, 0.5])
    >>> eyes, camera = [(-3, 0, 6), (3, 0, 6), (0, 3, 6), (0, -3, 6)], wm.Camera((640, 480), 800.0)
    >>> xy = [camera.project(wm.Pose.look_at(eye, [0, 0, 0], [1, 0, 0]).apply(markers.xyz))[0] for eye in eyes]
    >>> noisy = np.concatenate(xy) + rng.normal(0.0, 0.02, (120, 2))
    >>> seen = wm.Observations(*np.divmod(np.arange(120), 30), noisy, np.tile(0.0004 * np.eye(2), (120, 1, 1)))
    >>> views = [wm.View(f"view{i}") for i in range(4)]
    >>> found = wm.self_calibrate(seen, markers, {"camera": camera}, views, datum=wm.Free(), free=["focal_px"])
    >>> 0.8 < found.sigma0 < 1.2, found.warnings  # the residuals are as large as the spots' covariances say
    (True, ())
    >>> sorted(found.cameras), found.cameras["camera"].cov is not None, found.residuals.shape
    (['camera'], True, (120, 2))
    """

    cameras: Mapping[str, Camera]
    views: tuple[View, ...]
    markers: MarkerSet
    marker_cov: Array
    pose_cov: Array
    observations: Observations
    residuals: Array
    test: Array
    used: NDArray[np.bool_]
    sigma0: float
    redundancy: int
    rms_px: float
    focal_change: Array
    principal_shift: Array
    dropped: Mapping[str, str]
    suspect: tuple[str, ...]
    swapped: tuple[tuple[str, str, str], ...]
    report: SolveReport
    options: Mapping[str, Any] = field(default_factory=dict)
    cam_from_rig: Mapping[str, Pose] = field(default_factory=dict)
    rig_cov: Mapping[str, Array] = field(default_factory=dict)
    doubts: tuple[Doubt, ...] = ()
    hardly_checked: tuple[Hardly, ...] = ()
    hardly_checked_bars: tuple[HardlyBar, ...] = ()

    def __bool__(self) -> bool:
        return True

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``: view, marker, place, residual, test value of every mark, and whether it was used."""
        obs = self.observations
        return pandas_table({
            "view": np.array([v.name for v in self.views])[obs.view], "marker": self.markers.name[obs.point],
            "x": obs.xy[:, 0], "y": obs.xy[:, 1], "dx": self.residuals[:, 0], "dy": self.residuals[:, 1],
            "test": self.test, "used": self.used,
        })  # fmt: skip

    def plot(self, camera: str | None = None, ax: Any = None) -> Any:
        """Residuals of all marks of a camera as arrows where they lie in the picture, left out ones grey: what is left
        of the lens shows as a pattern. The axes of matplotlib; without a name the only or first camera.
        """
        from windmark.scene import plots

        camera = next(iter(self.cameras)) if camera is None else camera
        if camera not in self.cameras:
            raise ValueError(f"plot: no camera {camera!r}; there are {', '.join(self.cameras)}")
        obs = self.observations
        of = np.array([v.camera == camera for v in self.views])[obs.view]
        ax = plots.pixel_axes(ax, None, obs.xy[of])
        ax.plot(*obs.xy[of & ~self.used].T, "x", color="tab:gray")
        plots.arrows(ax, obs.xy[of & self.used], self.residuals[of & self.used])
        return ax

    @property
    def warnings(self) -> tuple[str, ...]:
        """The doubts as sentences."""
        return tuple(str(d) for d in self.doubts)

    @property
    def unchecked(self) -> str:
        """Of which known markers and distances an error would hardly show, and what it would do, in words; or ""."""
        return hardly_checked_words(self.hardly_checked, self.hardly_checked_bars, self.markers)

    def pose(self, view: str) -> Pose:
        """``cam_from_model`` of a view by name."""
        for v in self.views:
            if v.name == view and v.cam_from_model is not None:
                return v.cam_from_model
        raise ValueError(f"pose: no view {view!r}; there are {', '.join(v.name for v in self.views[:10])}")

    def camera(self, view: str) -> Camera:
        """The camera of a view by name, with the focal length and principal point that the view has."""
        names = [v.name for v in self.views]
        if view not in names:
            raise ValueError(f"camera: no view {view!r}; there are {', '.join(names[:10])}")
        n = names.index(view)
        return changed(self.cameras[self.views[n].camera], np.r_[self.focal_change[n], self.principal_shift[n]])

    def sigma(self, camera: str, parameter: str) -> float:
        """Standard deviation of an interior parameter by name; 0 if it was not free."""
        from windmark.geometry import PARAMETERS

        if camera not in self.cameras or parameter not in PARAMETERS:
            raise ValueError(f"sigma: unknown camera {camera!r} or parameter {parameter!r}")
        cov, k = self.cameras[camera].cov, PARAMETERS.index(parameter)
        return 0.0 if cov is None else float(np.sqrt(cov[k, k]))


@dataclass(frozen=True)
class NotCalibrated:
    """The data says no. Falsy.

    Parameters
    ----------
    reason : why, in words for the user
    cause : key of `CAUSES`
    weak : names of what is not determined
    dropped : why views or markers could not take part, by name
    sigma0 : of the best solution met, NaN without one
    options : everything the attempt was made with

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> markers = wm.MarkerSet.make(["a", "b", "c"], [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> xy, cov = np.array([[320.0, 240.0], [400.0, 240.0], [320.0, 300.0]]), np.tile(np.eye(2), (3, 1, 1))
    >>> seen = wm.Observations(np.zeros(3, dtype=int), np.arange(3), xy, cov)
    >>> cameras, views = {"camera": wm.Camera((640, 480), 800.0)}, [wm.View("only")]
    >>> answer = wm.self_calibrate(seen, markers, cameras, views, datum=wm.Fixed())
    >>> bool(answer), answer.cause
    (False, 'too_few')
    >>> dict(answer.dropped)
    {'only': 'view with 3 marks; 4 are needed'}
    """

    reason: str
    cause: str
    weak: tuple[str, ...] = ()
    dropped: Mapping[str, str] = field(default_factory=dict)
    sigma0: float = float("nan")
    options: Mapping[str, Any] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return False
