"""Laws that are linear in their parameters: modes from a structural calculation, and smooth free displacement."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.linalg import eigh

from windmark.deformation.law import BoundLaw, Linear
from windmark.deformation.laws.directions import Vector, vector
from windmark.deformation.parameter import Parameter
from windmark.errors import UsageError

Array = NDArray[np.float64]

NEIGHBOURS = 32
"""Nodes that take part in the interpolation at a point."""
FAINT = 1e-6
"""Variance of a shape, as part of the strongest one's, below which it is left out."""


@dataclass(frozen=True, eq=False)
class TabulatedModes:
    """Mode shapes known at nodes: finite elements, or measured ones.

    Parameters
    ----------
    nodes : (M, 3) places in the model's frame
    shapes : (M, 3, k) displacement by one unit of each mode
    unit : of the amplitudes; shapes in length units per this unit

    Between nodes a thin-plate spline through the nearest ones is taken; beyond them it extrapolates.

    Raises
    ------
    ValueError
        For shapes that do not fit, fewer than four nodes, or two at one place.
    """

    nodes: Array
    shapes: Array
    unit: str = ""

    def __post_init__(self) -> None:
        if self.nodes.ndim != 2 or self.nodes.shape[1] != 3 or len(self.nodes) < 4:
            raise UsageError(f"modes: nodes must be (M >= 4, 3), got {self.nodes.shape}")
        if self.shapes.shape[:2] != self.nodes.shape or self.shapes.ndim != 3 or not self.shapes.shape[2]:
            raise UsageError(f"modes: shapes must be ({len(self.nodes)}, 3, k), got {self.shapes.shape}")
        if not (np.isfinite(self.nodes).all() and np.isfinite(self.shapes).all()):
            raise UsageError("modes: nodes and shapes must be finite")
        if len(np.unique(self.nodes, axis=0)) < len(self.nodes):
            raise UsageError("modes: nodes must be at distinct places")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """mode_1, mode_2, ..."""
        return tuple(Parameter(f"mode_{n + 1}", self.unit) for n in range(self.shapes.shape[2]))

    def bind(self, xyz: Array) -> BoundLaw:
        """See `Law`."""
        values = self.shapes.reshape(len(self.nodes), -1)
        # Nodes in a plane: the trend across it is not known and must not be asked for.
        centre = self.nodes.mean(axis=0)
        _, size, axes = np.linalg.svd(self.nodes - centre, full_matrices=False)
        used = axes[size > 1e-6 * size[0]]
        smooth = RBFInterpolator(
            (self.nodes - centre) @ used.T, values, neighbors=min(NEIGHBOURS, len(self.nodes)),
            kernel="thin_plate_spline",
        )  # fmt: skip
        return Linear(xyz, np.asarray(smooth((xyz - centre) @ used.T)).reshape(len(xyz), 3, -1))


@dataclass(frozen=True, eq=False)
class Smooth:
    """Any displacement that is smooth: a Gaussian process (Rasmussen and Williams 2006, chapter 2).

    Parameters
    ----------
    points : (M, 3) places that carry it, usually the volume's markers
    amplitude : expected size of the displacement, one number or (3,) along x, y, z; 0: none along that axis
    reach : distance over which neighbours move alike (correlation length)
    unit : length unit, for the parameters' names only

    The parameters are the strongest eigenmodes at the points, held by the prior: where no marker sees the volume the
    displacement returns to zero and its sigma to the amplitude.
    """

    points: Array
    amplitude: float | Vector
    reach: float
    unit: str = ""

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 3 or not len(self.points):
            raise UsageError(f"smooth: points must be (M, 3) with M > 0, got {self.points.shape}")
        if not (np.isfinite(self.reach) and self.reach > 0):
            raise UsageError(f"smooth: reach must be > 0, got {self.reach}")
        if not (self._amplitudes() >= 0).all() or not self._amplitudes().any():
            raise UsageError(f"smooth: amplitude must be >= 0 and not 0 along every axis, got {self.amplitude}")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """x_1, x_2, ..., y_1, ..., z_1, ...: amplitudes of the modes."""
        count = len(self._modes[0])
        return tuple(
            Parameter(f"{axis}_{n + 1}", self.unit, sigma=float(size))
            for axis, size in zip("xyz", self._amplitudes(), strict=True)
            if size > 0
            for n in range(count)
        )

    def bind(self, xyz: Array) -> BoundLaw:
        """See `Law`."""
        value, mode = self._modes
        shape = self._correlation(xyz, self.points) @ mode / np.sqrt(value)
        axes = [axis for axis, size in zip(np.eye(3), self._amplitudes(), strict=True) if size > 0]
        return Linear(xyz, np.concatenate([shape[:, None, :] * axis[:, None] for axis in axes], axis=2))

    def _amplitudes(self) -> Array:
        return vector(np.broadcast_to(np.asarray(self.amplitude, dtype=float), 3).tolist(), "smooth: amplitude")

    @cached_property
    def _modes(self) -> tuple[Array, Array]:
        """Variances and eigenmodes (M, k) of the correlation at the points, strongest first."""
        value, mode = eigh(self._correlation(self.points, self.points))
        kept = value > FAINT * value[-1]
        # A mode and its negative are as good; every machine shall give the same.
        largest = mode[np.abs(mode).argmax(axis=0), np.arange(len(value))]
        return value[kept][::-1], (mode * np.sign(largest))[:, kept][:, ::-1]

    def _correlation(self, a: Array, b: Array) -> Array:
        apart = ((a[:, None] - b[None]) ** 2).sum(axis=-1)
        return np.asarray(np.exp(-0.5 * apart / self.reach**2))
