"""Views and observations: what the one adjustment sees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.geometry.described import described
from windmark.scene.shown import pandas_table


@dataclass(frozen=True)
class View:
    """One image: which camera took it, in which frame (instant), and from where if known.

    Examples
    --------
    >>> import windmark as wm
    >>> left = wm.View("run7_left", camera="left", frame="7")
    >>> right = wm.View("run7_right", camera="right", frame="7")
    >>> left.frame == right.frame  # taken at the same instant
    True
    >>> left.cam_from_model is None  # from where is not known yet
    True
    """

    name: str
    camera: str = "camera"
    frame: str = "0"
    cam_from_model: Pose | None = None


@described(lambda o: {
    "marks": len(o.xy), "views": len(np.unique(o.view)), "points": len(np.unique(o.point)),
})  # fmt: skip
@dataclass(frozen=True)
class Observations:
    """O observed image points as columns.

    Parameters
    ----------
    view : (O,) index of the view
    point : (O,) index of the point (marker)
    xy : (O, 2) pixels
    cov : (O, 2, 2) px^2

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> view, point = np.array([0, 0, 1]), np.array([5, 7, 5])
    >>> xy = np.array([[100.0, 80.0], [120.5, 83.0], [98.2, 79.0]])
    >>> seen = wm.Observations(view, point, xy, np.tile(0.01 * np.eye(2), (3, 1, 1)))
    >>> seen.xy[seen.point == 5].tolist()  # marker 5 in the two views that show it
    [[100.0, 80.0], [98.2, 79.0]]
    """

    view: NDArray[np.int64]
    point: NDArray[np.int64]
    xy: NDArray[np.float64]
    cov: NDArray[np.float64]

    def __post_init__(self) -> None:
        o = len(self.xy)
        shapes = {"view": (o,), "point": (o,), "xy": (o, 2), "cov": (o, 2, 2)}
        for name, shape in shapes.items():
            got = np.shape(getattr(self, name))
            if got != shape:
                raise ValueError(f"Observations: {name} must be {shape}, got {got}")
        if not (np.isfinite(self.xy).all() and np.isfinite(self.cov).all()):
            raise ValueError("Observations: xy and cov must be finite")

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``: view, point, place and its sigmas of every mark."""
        sigma = np.sqrt(np.diagonal(self.cov, axis1=1, axis2=2))
        return pandas_table({
            "view": self.view, "point": self.point, "x": self.xy[:, 0], "y": self.xy[:, 1], "sigma_x": sigma[:, 0],
            "sigma_y": sigma[:, 1],
        })  # fmt: skip

    def __len__(self) -> int:
        return len(self.xy)


@described(lambda t: {
    "marks": len(t.track), "tracks": len(np.unique(t.track)), "views": len(np.unique(t.view)),
})  # fmt: skip
@dataclass(frozen=True)
class Tracks:
    """Spots of many views that are one physical marker.

    Parameters
    ----------
    track : (K,) id of the track
    view : (K,) index of the view
    detection : (K,) index into that view's detections

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> tracks = wm.Tracks(track=np.array([0, 0, 1]), view=np.array([0, 1, 1]), detection=np.array([3, 0, 2]))
    >>> first = tracks.track == 0
    >>> list(zip(tracks.view[first].tolist(), tracks.detection[first].tolist(), strict=True))
    [(0, 3), (1, 0)]
    """

    track: NDArray[np.int64]
    view: NDArray[np.int64]
    detection: NDArray[np.int64]

    def __post_init__(self) -> None:
        if not (np.shape(self.track) == np.shape(self.view) == np.shape(self.detection)):
            raise ValueError("Tracks: track, view and detection must have the same length")
        pairs = np.stack([self.view, self.detection], axis=1)
        if len(np.unique(pairs, axis=0)) != len(pairs):
            raise ValueError("Tracks: a spot may belong to one track only")
