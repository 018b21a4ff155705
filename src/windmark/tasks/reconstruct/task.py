"""What is to be reconstructed, checked before anything is computed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.geometry import PARAMETERS, Camera, Pose
from windmark.scene import Detections, MarkerCovariance, MarkerSet, View
from windmark.scene.repeated import repeated_views

Array = NDArray[np.float64]
Labels = Mapping[str, Mapping[int, str]]

FEWEST_SPOTS = 8
"""Spots that a picture needs to take part."""


class Refused(Exception):
    """The data say no: cause and reason of a `NotReconstructed`.

    ``alone`` are views that share too little; ``nearly`` are the primaries (a `Located`) that might be the right ones.
    """

    def __init__(self, cause: str, reason: str, alone: Sequence[int] = (), nearly: Any = None) -> None:
        super().__init__(reason)
        self.cause, self.reason, self.alone, self.nearly = cause, reason, tuple(alone), nearly


@dataclass(frozen=True)
class Task:
    """Spots, cameras and views; views are numbered as given.

    Parameters
    ----------
    detections : of each view, their covariances with what lens and light leave
    cameras : by name
    views : with their camera, and a pose in the primaries' frame where that is known
    primary : the known markers
    primary_cov : joint covariance of those of them whose errors are correlated, or None
    labels : for each view {spot: index of a primary}
    ties : for each view {name: spot} of all labels, also of markers that are no primaries
    free : interior parameters to be found
    seed : of every random search
    """

    detections: tuple[Detections, ...]
    cameras: Mapping[str, Camera]
    views: tuple[View, ...]
    primary: MarkerSet
    labels: tuple[dict[int, int], ...]
    ties: tuple[dict[str, int], ...]
    free: tuple[str, ...]
    seed: int
    primary_cov: MarkerCovariance | None = None

    @classmethod
    def checked(
        cls, detections: Sequence[Detections], cameras: Camera | Mapping[str, Camera], primary: MarkerSet | None,
        views: Sequence[View] | None, labels: Labels | None, free: Sequence[str], seed: int, model_px: float = 0.0,
        primary_cov: MarkerCovariance | None = None,
    ) -> Task:  # fmt: skip
        """A task from the arguments of `reconstruct`; ValueError where they do not fit."""
        free_frame, primary = primary is None, primary or MarkerSet.make([], np.zeros((0, 3)))
        if primary_cov is not None:
            primary = primary_cov.on(primary)
        if views is None:
            if not isinstance(cameras, Camera) and len(cameras) != 1:
                raise UsageError("reconstruct: with several cameras, views must say which picture has which")
            views = tuple(View(f"{v}") for v in range(len(detections)))
            cameras = {"camera": cameras if isinstance(cameras, Camera) else next(iter(cameras.values()))}
        elif isinstance(cameras, Camera):
            cameras = dict.fromkeys({v.camera for v in views}, cameras)
        if len(views) != len(detections):
            raise UsageError(f"reconstruct: expected one view per picture, got {len(views)} for {len(detections)}")
        names = [v.name for v in views]
        if len(set(names)) != len(names):
            twice = sorted({n for n in names if names.count(n) > 1})
            raise UsageError(f"reconstruct: names of views must be unique, more than once: {', '.join(twice[:5])}")
        unknown = sorted({v.camera for v in views} - set(cameras))
        if unknown:
            raise UsageError(f"reconstruct: views use unknown cameras {', '.join(unknown)}")
        wrong = [p for p in free if p not in PARAMETERS]
        if wrong:
            raise UsageError(f"reconstruct: free: {wrong[0]!r} is none of {', '.join(PARAMETERS)}")
        if not 0 <= model_px < np.inf:
            raise UsageError(f"reconstruct: model_px must be 0 or more, got {model_px}")
        named = _checked_labels(labels or {}, names, detections, primary, free_frame)
        index = {str(n): i for i, n in enumerate(primary.name)}
        return cls(
            tuple(replace(d, cov=d.cov + model_px**2 * np.eye(2)) for d in detections), dict(cameras), tuple(views),
            primary,
            tuple({s: index[n] for s, n in mine.items() if n in index} for mine in named),
            tuple({n: s for s, n in mine.items()} for mine in named), tuple(free), seed, primary_cov,
        )  # fmt: skip

    def camera(self, view: int) -> Camera:
        """Camera of a view."""
        return self.cameras[self.views[view].camera]

    def known_together(self, names: Sequence[str]) -> MarkerCovariance | None:
        """The joint covariance of some of the primaries."""
        if self.primary_cov is None:
            return None
        both = set(names) & set(self.primary_cov.name.tolist())
        return self.primary_cov.take([n for n in names if n in both])

    @property
    def usable(self) -> list[int]:
        """Views with spots enough, and no other view's once more."""
        return [v for v, d in enumerate(self.detections) if len(d) >= FEWEST_SPOTS and v not in self.repeated]

    @cached_property
    def repeated(self) -> dict[int, int]:
        """View -> an earlier one that it shows once more."""
        view = np.repeat(np.arange(len(self.detections)), [len(d) for d in self.detections])
        xy, cov = (np.concatenate([getattr(d, n) for d in self.detections]) for n in ("xy", "cov"))
        return repeated_views(view, None, xy, cov) if len(view) else {}

    @property
    def given(self) -> dict[int, Pose]:
        """Poses that the user knows."""
        return {v: view.cam_from_model for v, view in enumerate(self.views) if view.cam_from_model is not None}


def _checked_labels(
    labels: Labels, names: list[str], detections: Sequence[Detections], primary: MarkerSet, free_frame: bool
) -> list[dict[int, str]]:
    """For each view {spot: name}."""
    known = set(primary.name.tolist())
    times = Counter(n for mine in labels.values() for n in set(mine.values()))
    unknown = sorted(set(labels) - set(names))
    if unknown:
        raise UsageError(f"reconstruct: labels name unknown views {', '.join(unknown[:5])}")
    out: list[dict[int, str]] = []
    for name, spots in zip(names, detections, strict=True):
        mine = labels.get(name, {})
        wrong = [n for n in mine.values() if n not in known and times[n] < 2 and not free_frame]
        if wrong:
            raise UsageError(
                f"reconstruct: labels of view {name}: {wrong[0]!r} is no primary marker, and in no other view"
            )
        beyond = [s for s in mine if not 0 <= s < len(spots)]
        if beyond:
            raise UsageError(f"reconstruct: labels of view {name}: spot {beyond[0]} of {len(spots)}")
        if len(set(mine.values())) < len(mine):
            raise UsageError(f"reconstruct: labels of view {name} give one marker to two spots")
        out.append({int(s): n for s, n in mine.items()})
    return out
