"""Shapes of bending and twist along a beam: functions of the station e = s / length, zero at the clamped root."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from windmark.errors import UsageError

Array = NDArray[np.float64]


class Basis(Protocol):
    """k functions of the station; each is worth 1 at e = 1 unless said otherwise."""

    @property
    def names(self) -> tuple[str, ...]:
        """What tells them apart, for the parameters' names."""

    def value(self, e: Array) -> Array:
        """(..., k) at stations e >= 0."""

    def slope(self, e: Array) -> Array:
        """(..., k) derivative by e."""


@dataclass(frozen=True)
class Powers:
    """e^n.

    Parameters
    ----------
    degrees : distinct whole numbers >= 1; bending of a clamped beam starts with 2, twist with 1
    """

    degrees: tuple[int, ...]

    def __post_init__(self) -> None:
        if any(n < 1 for n in self.degrees) or len(set(self.degrees)) != len(self.degrees):
            raise UsageError(f"degrees must be distinct and at least 1, got {self.degrees}")

    @property
    def names(self) -> tuple[str, ...]:
        """The degrees."""
        return tuple(str(n) for n in self.degrees)

    def value(self, e: Array) -> Array:
        """See `Basis`."""
        return np.stack([e**n for n in self.degrees], axis=-1) if self.degrees else np.zeros((*e.shape, 0))

    def slope(self, e: Array) -> Array:
        """See `Basis`."""
        return np.stack([n * e ** (n - 1) for n in self.degrees], axis=-1) if self.degrees else np.zeros((*e.shape, 0))


@dataclass(frozen=True)
class CantileverModes:
    """The first eigenmodes of a uniform clamped-free beam in bending (Blevins 1979, table 8-1).

    Parameters
    ----------
    count : how many
    """

    count: int

    @property
    def names(self) -> tuple[str, ...]:
        """1, 2, ..."""
        return tuple(str(n + 1) for n in range(self.count))

    def value(self, e: Array) -> Array:
        """See `Basis`."""
        return self._sum(e, 0)

    def slope(self, e: Array) -> Array:
        """See `Basis`."""
        return self._sum(e, 1)

    @cached_property
    def _constants(self) -> list[tuple[float, float, float]]:
        return [_cantilever(n) for n in range(self.count)]

    def _sum(self, e: Array, order: int) -> Array:
        out = np.zeros((*e.shape, self.count))
        for n, (root, rest, tip) in enumerate(self._constants):
            z = root * e
            # cosh z - cos z - (1 - rest) (sinh z - sin z), without the difference of large numbers
            if order:
                shape = root * (-np.exp(-z) + rest * np.cosh(z) + np.sin(z) + (1 - rest) * np.cos(z))
            else:
                shape = np.exp(-z) + rest * np.sinh(z) - np.cos(z) + (1 - rest) * np.sin(z)
            out[..., n] = shape / tip
        return out


def _cantilever(n: int) -> tuple[float, float, float]:
    """Root of cos(l) cosh(l) = -1, one less the shape's ratio of sines to cosines, and the shape's value at the tip."""
    middle = (n + 0.5) * np.pi  # the root lies within 0.31 of it
    root = float(brentq(lambda v: np.cos(v) + 1 / np.cosh(v), middle - 0.4, middle + 0.4, xtol=1e-15))
    rest = (np.exp(-root) + np.cos(root) + np.sin(root)) / (np.cosh(root) + np.cos(root))
    tip = np.exp(-root) + rest * np.sinh(root) - np.cos(root) + (1 - rest) * np.sin(root)
    return root, float(rest), float(tip)


@dataclass(frozen=True)
class TorsionModes:
    """The first eigenmodes of a uniform clamped-free shaft: sin((n - 1/2) pi e), signed to be 1 at the tip."""

    count: int

    @property
    def names(self) -> tuple[str, ...]:
        """1, 2, ..."""
        return tuple(str(n + 1) for n in range(self.count))

    def value(self, e: Array) -> Array:
        """See `Basis`."""
        k = (np.arange(self.count) + 0.5) * np.pi
        return np.asarray(np.sin(k * e[..., None]) * np.sin(k))

    def slope(self, e: Array) -> Array:
        """See `Basis`."""
        k = (np.arange(self.count) + 0.5) * np.pi
        return np.asarray(k * np.cos(k * e[..., None]) * np.sin(k))


@dataclass(frozen=True)
class Splines:
    """Cubic splines through values at given stations; the parameters are these values.

    Parameters
    ----------
    stations : increasing, in (0, 1]
    clamped : the slope at the root is zero, too (bending); else only the value (twist)
    """

    stations: tuple[float, ...]
    clamped: bool

    def __post_init__(self) -> None:
        steps = np.diff(np.concatenate([[0.0], self.stations]))
        if not (len(steps) and np.isfinite(steps).all() and (steps > 0).all()) or self.stations[-1] > 1 + 1e-12:
            raise UsageError(f"stations must increase strictly within (0, 1], got {self.stations}")

    @property
    def names(self) -> tuple[str, ...]:
        """The stations in percent."""
        return tuple(f"{100 * e:.4g}".replace(".", "_") for e in self.stations)

    def value(self, e: Array) -> Array:
        """See `Basis`."""
        return np.asarray(self._spline()(e))

    def slope(self, e: Array) -> Array:
        """See `Basis`."""
        return np.asarray(self._spline()(e, 1))

    def _spline(self) -> CubicSpline:
        knots = np.concatenate([[0.0], self.stations])
        values = np.vstack([np.zeros(len(self.stations)), np.eye(len(self.stations))])
        free = (2, np.zeros(len(self.stations)))  # no curvature at a free end
        first = (1, np.zeros(len(self.stations))) if self.clamped else free
        return CubicSpline(knots, values, bc_type=(first, free))


def cantilever(bend: int, twist: int) -> tuple[CantileverModes, TorsionModes]:
    """The first modes of bending and torsion."""
    if bend < 0 or twist < 0 or bend + twist == 0:
        raise UsageError(f"modes: expected counts >= 0, not both 0, got {bend} and {twist}")
    return CantileverModes(bend), TorsionModes(twist)


def powers(degrees: Sequence[int]) -> Powers:
    """See `Powers`."""
    return Powers(tuple(int(n) for n in degrees))
