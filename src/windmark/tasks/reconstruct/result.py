"""What `reconstruct` gives back: markers in the frame of the primaries, or why there are none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from windmark.calibration import Calibration
from windmark.errors import g3
from windmark.geometry import Camera
from windmark.geometry.described import described
from windmark.scene import Doubt, MarkerSet, Tracks, View, plots
from windmark.scene.shown import pandas_table

Array = NDArray[np.float64]

CAUSES = {
    "too_few": "too few pictures or spots",
    "no_pair": "no two pictures could be matched",
    "baseline": "the pictures were all taken from one place",
    "few_primaries": "fewer than three primary markers",
    "line": "the primary markers are on a line",
    "not_found": "the primary markers were not recognised among the reconstructed ones",
    "mirrored": "the mirror image of the table of primary markers fits the reconstructed ones, the table does not",
    "ambiguous": "the primary markers fit the reconstructed ones in several ways",
    "focal": "the pictures contradict the given focal length",
    "lens": "the pictures contradict the given camera: its lens, principal point or aspect ratio",
    "poses": "the pictures contradict the given poses",
    "unconnected": "the pictures with the primary markers are not connected",
    "adjustment": "the adjustment of all pictures together failed",
}
"""Every cause of a `NotReconstructed`, in words."""
Cause = Literal[
    "too_few", "no_pair", "baseline", "few_primaries", "line", "not_found", "mirrored", "ambiguous", "focal",
    "lens", "poses", "unconnected", "adjustment",
]  # fmt: skip


@described(lambda r: {
    "markers": len(r.markers), "views": f"{len(r.views) - len(r.dropped)} of {len(r.views)}",
    "rms px": f"{g3(r.rms_px)}", "sigma0": f"{g3(r.calibration.sigma0)}",
    "warnings": "; ".join(r.warnings) or "none",
})  # fmt: skip
@dataclass(frozen=True)
class Reconstruction:
    """Markers, views and cameras in the frame and the length unit of the primary markers.

    Parameters
    ----------
    markers : (N,) primaries by their names, the others as s001, s002, ...; ``sigma`` is that of the adjustment.
        Primaries that did not hold the frame, for others were labelled, have their names where a point is there
    marker_cov : (N, 3, 3) covariances in the frame of the primaries
    normal_sigma_deg : (N,) 1 sigma of the normals that the markers' ellipses gave, NaN where they gave none; their
        radii come with them
    count : (N,) number of views of each marker
    views : all views, ``cam_from_model`` None for those that could not be used
    cameras : by name, with ``cov`` over the parameters that were free
    tracks : which spot of which view is which marker: ``track`` indexes ``markers``, ``view`` the views. Spots that the
        adjustment left out as too far off are among them where geometry gives them to no other marker
    linked : (O,) marks of the calibration that are links; the others are gross errors
    calibration : the adjustment behind it, with residuals and tests, and which marks it used
    dropped : why views did not take part, by name
    found_by : how each view got its pose: "given", "labels", "pair", "register" or "neighbour"
    options : everything it was made with, by name
    frame : what frame and scale are, in words; "" where primaries hold them
    free_scale : lengths have no unit
    doubts : what the pictures and the table say against it, besides the calibration's
    unrecognised : why primaries have no marker, by name
    unchecked : how far a camera that is another one than given would carry markers without being noticed, in words;
        "" where that is little beside their sigmas
    open_spots : of two pictures: spots, by the picture, that have possible partners in the other one, none of which
        stands out; they are in no track

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> xyz = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3)) * [2.0, 1.5, 0.2]
    >>> camera, eyes = wm.Camera((640, 480), 800.0), [(-1, 0, 6), (1, 0, 6), (0, 1, 6)]
    >>> poses = [wm.Pose.look_at(eye, [0, 0, 0], [0, 1, 0]) for eye in eyes]
    >>> spots = [wm.Detections.make(camera.project(pose.apply(xyz))[0].round(2), sigma_px=0.01) for pose in poses]
    >>> known = wm.MarkerSet.make(["a", "b", "c", "d", "e", "f"], xyz[:6], role="primary")
    >>> views = [wm.View(f"view{i}", cam_from_model=pose) for i, pose in enumerate(poses)]
    >>> found = wm.reconstruct(spots, camera, known, views=views)
    >>> found.count.tolist() == [3] * 20, found.rms_px < 0.02  # each marker is in all three pictures
    (True, True)
    >>> first = found.tracks.view == 0  # the spots of the first picture and their markers
    >>> np.allclose(found.markers.xyz[found.tracks.track[first]], xyz[found.tracks.detection[first]], atol=1e-3)
    True
    """

    markers: MarkerSet
    marker_cov: Array
    normal_sigma_deg: Array
    count: NDArray[np.int64]
    views: tuple[View, ...]
    cameras: Mapping[str, Camera]
    tracks: Tracks
    linked: NDArray[np.bool_]
    calibration: Calibration
    dropped: Mapping[str, str]
    found_by: Mapping[str, str]
    options: Mapping[str, Any] = field(default_factory=dict)
    frame: str = ""
    free_scale: bool = False
    open_spots: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    doubts: tuple[Doubt, ...] = ()
    unrecognised: Mapping[str, str] = field(default_factory=dict)
    unchecked: str = ""

    def __bool__(self) -> bool:
        return True

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``: name, place, its sigmas and the number of views of every marker."""
        sigma = np.sqrt(np.diagonal(self.marker_cov, axis1=1, axis2=2))
        return pandas_table({
            "name": self.markers.name, **dict(zip("xyz", self.markers.xyz.T, strict=True)), "sigma_x": sigma[:, 0],
            "sigma_y": sigma[:, 1], "sigma_z": sigma[:, 2], "views": self.count,
        })  # fmt: skip

    def plot(self, ax: Any = None) -> Any:
        """Markers and stations of the pictures in space; the axes of matplotlib."""
        stations = np.array([v.cam_from_model.center for v in self.views if v.cam_from_model is not None])
        ax = plots.space_axes(ax, np.vstack([self.markers.xyz, stations.reshape(-1, 3)]))
        known = self.markers.role == "primary"
        for some, color, what in ((~known, "tab:blue", "markers"), (known, "tab:orange", "known markers")):
            ax.plot(*self.markers.xyz[some].T, ".", color=color, label=what)
        ax.plot(*stations.reshape(-1, 3).T, "^", color="tab:gray", label="stations")
        ax.legend()
        return ax

    @property
    def warnings(self) -> tuple[str, ...]:
        """Everything that was found to be wrong, or weaker than it looks, in sentences."""
        return (*self.calibration.warnings, *(str(d) for d in self.doubts))

    @property
    def suspect(self) -> tuple[str, ...]:
        """Names of markers, primaries and pictures that contradict the rest."""
        return tuple(dict.fromkeys((*self.calibration.suspect, *(n for d in self.doubts for n in d.names))))

    @property
    def rms_px(self) -> float:
        """Root mean square length of the residuals."""
        return self.calibration.rms_px


@dataclass(frozen=True)
class NotReconstructed:
    """Why there is no reconstruction; falsy.

    Parameters
    ----------
    reason : in words, with the numbers
    cause : one of `CAUSES`
    dropped : why views did not take part, by name
    options : everything it was made with, by name

    Examples
    --------
    >>> import windmark as wm
    >>> spots = wm.Detections.make([[100.0, 100.0], [200.0, 100.0], [150.0, 200.0]])
    >>> answer = wm.reconstruct([spots, spots], wm.Camera((640, 480), 800.0), None)
    >>> bool(answer), answer.cause
    (False, 'too_few')
    >>> answer.dropped["0"]
    '3 spots, at least 8 are needed'
    """

    reason: str
    cause: Cause
    dropped: Mapping[str, str] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return False
