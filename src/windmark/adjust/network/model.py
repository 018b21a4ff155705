"""What a network consists of: which view has which camera and pose, what was observed, what is free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.loss import Loss
from windmark.geometry import PARAMETERS

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Bars:
    """Known distances between pairs of points.

    Parameters
    ----------
    first, second : (B,) indices of the points
    length, sigma : (B,) distance and its standard deviation in the length unit
    """

    first: Ints
    second: Ints
    length: Array
    sigma: Array

    def __post_init__(self) -> None:
        n = len(self.length)
        for name in ("first", "second", "length", "sigma"):
            if np.shape(getattr(self, name)) != (n,):
                raise ValueError(f"Bars: {name} must be ({n},), got {np.shape(getattr(self, name))}")
        if (self.first == self.second).any():
            raise ValueError("Bars: a distance needs two different points")
        if not ((self.length > 0) & (self.sigma > 0) & np.isfinite(self.length) & np.isfinite(self.sigma)).all():
            raise ValueError("Bars: length and sigma must be finite and > 0")


@dataclass(frozen=True)
class KnownTogether:
    """Points whose known coordinates have errors that are correlated.

    Parameters
    ----------
    point : (K,) ascending indices of the points
    value : (K, 3) their known coordinates
    whitener : (3K, 3K) ``W`` with ``W^T W`` the inverse of their covariance
    """

    point: Ints
    value: Array
    whitener: Array

    def __post_init__(self) -> None:
        k = len(self.point)
        for name, shape in (("value", (k, 3)), ("whitener", (3 * k, 3 * k))):
            if np.shape(getattr(self, name)) != shape:
                raise ValueError(f"KnownTogether: {name} must be {shape}, got {np.shape(getattr(self, name))}")
        if (np.diff(self.point) <= 0).any():
            raise ValueError("KnownTogether: point must be ascending")

    def residual(self, points: Array) -> Array:
        """(3K,) whitened, of the places (N, 3) of all points."""
        return np.asarray(self.whitener @ (points[self.point] - self.value).ravel())


NO_BARS = Bars(*(np.zeros(0, np.int64),) * 2, *(np.zeros(0),) * 2)


@dataclass(frozen=True)
class Network:
    """Observations of points in views, and what is free. The values travel beside it (`NetworkState`).

    Parameters
    ----------
    view, point : (O,) view and point of each observation
    xy, cov : (O, 2), (O, 2, 2) pixels and px^2
    view_camera, view_frame : (V,) camera and frame of each view
    view_offset : (V,) rig member of each view, -1 for none: ``cam_from_model = offset @ frame``
    free_camera : for each camera the names of its free parameters (`geometry.PARAMETERS`)
    free_frame, free_offset : (F,), (A,) which poses are free
    free_change : (V, 3) in what views may differ from their camera: focal length, principal point (2)
    held : (N, 3) coordinates of points that do not move
    point_value, point_sigma : (N, 3) known coordinates and their 1 sigma; sigma inf where nothing is known
    camera_value, camera_sigma : for each camera, known parameters by name and their 1 sigma
    change_sigma : (V, 3) 1 sigma of these changes round 0 (relative, px); inf where nothing is known
    bars : known distances
    together : points with a joint covariance; they are free, observed, and have no ``point_sigma``
    loss : on the length of each observation's whitened residual
    weight : (O,) factors on the observations' part of the cost, 0 for those that are left out; None is 1
    eliminate : "points" or "frames" leave the system of equations first; "auto" takes the larger group
    """

    view: Ints
    point: Ints
    xy: Array
    cov: Array
    view_camera: Ints
    view_frame: Ints
    view_offset: Ints
    free_camera: tuple[tuple[str, ...], ...]
    free_frame: Mask
    held: Mask
    free_offset: Mask = field(default_factory=lambda: np.zeros(0, bool))
    free_change: Mask | None = None
    point_value: Array | None = None
    point_sigma: Array | None = None
    camera_value: Sequence[Mapping[str, float]] = ()
    camera_sigma: Sequence[Mapping[str, float]] = ()
    change_sigma: Array | None = None
    bars: Bars = NO_BARS
    together: KnownTogether | None = None
    loss: Loss = field(default_factory=Loss)
    weight: Array | None = None
    eliminate: str = "auto"

    def __post_init__(self) -> None:
        o, v, n = len(self.xy), len(self.view_camera), len(self.held)
        shapes = {
            "view": (o,), "point": (o,), "xy": (o, 2), "cov": (o, 2, 2), "view_frame": (v,), "view_offset": (v,),
            "held": (n, 3), "free_change": (v, 3), "point_value": (n, 3), "point_sigma": (n, 3), "change_sigma": (v, 3),
            "weight": (o,),
        }  # fmt: skip
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value is not None and np.shape(value) != shape:
                raise ValueError(f"Network: {name} must be {shape}, got {np.shape(value)}")
        self._check_index("view", self.view, v)
        self._check_index("point", self.point, n)
        self._check_index("view_camera", self.view_camera, len(self.free_camera))
        self._check_index("view_frame", self.view_frame, len(self.free_frame))
        self._check_index("view_offset", self.view_offset, len(self.free_offset), low=-1)
        if self.eliminate not in ("auto", "points", "frames"):
            raise ValueError(f'Network: eliminate must be "auto", "points" or "frames", got {self.eliminate!r}')
        for names in self.free_camera:
            unknown = [name for name in names if name not in PARAMETERS]
            if unknown:
                raise ValueError(f"Network: free_camera: {unknown[0]!r} is none of {', '.join(PARAMETERS)}")

    @staticmethod
    def _check_index(name: str, index: Ints, size: int, low: int = 0) -> None:
        if len(index) and not (index.min() >= low and index.max() < size):
            raise ValueError(f"Network: {name} must be {low} ... {size - 1}, got {index.min()} ... {index.max()}")

    @cached_property
    def used_view(self) -> Mask:
        """(V,) views in which something was observed."""
        return _among(self.view, len(self.view_camera))

    @cached_property
    def used_point(self) -> Mask:
        """(N,) points that were observed or belong to a known distance."""
        bars = self.bars
        return _among(np.concatenate([self.point, bars.first, bars.second]), len(self.held))

    @property
    def tied(self) -> Mask:
        """(N,) points that known distances or joint covariances tie to others."""
        more = () if self.together is None else (self.together.point,)
        return _among(np.concatenate([self.bars.first, self.bars.second, *more]), len(self.held))

    @cached_property
    def used_frame(self) -> Mask:
        """(F,) frames of such views."""
        return _among(self.view_frame[self.used_view], len(self.free_frame))

    @cached_property
    def used_offset(self) -> Mask:
        """(A,) rig members of such views."""
        member = self.view_offset[self.used_view]
        return _among(member[member >= 0], len(self.free_offset))


def _among(index: Ints, size: int) -> Mask:
    out = np.zeros(size, bool)
    out[index] = True
    return out
