"""Views and observations: what the one adjustment sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.scene.shown import described


@dataclass(frozen=True)
class View:
    """One image: which camera took it, in which frame (instant), and from where if known."""

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

    def __len__(self) -> int:
        return len(self.xy)


@dataclass(frozen=True)
class Tracks:
    """Spots of many views that are one physical marker.

    Parameters
    ----------
    track : (K,) id of the track
    view : (K,) index of the view
    detection : (K,) index into that view's detections
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
