"""Wings: a beam that bends and twists along its elastic axis.

Sections stay flat and keep their shape. The axis does not stretch: it comes back by the integral of 1 - cos(slope) as
it bends, and the sections lean with it. For a tip that rises by 2 % of the span these are 0.02 % of the span and 3 % of
the thickness, both more than a good stereo system's uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.law import BoundLaw
from windmark.deformation.laws.bases import Basis, Powers
from windmark.deformation.laws.directions import Vector, unit, vector
from windmark.deformation.parameter import Parameter
from windmark.errors import UsageError

Array = NDArray[np.float64]

DEGREE = np.pi / 180.0
NODES, WEIGHTS = (0.5 * (v + k) for v, k in zip(np.polynomial.legendre.leggauss(12), (1.0, 0.0), strict=True))
"""Gauss-Legendre on [0, 1], for the shortening."""


@dataclass(frozen=True)
class Beam:
    """Bending and twist of a volume along an axis.

    Parameters
    ----------
    root, tip : (3,) the elastic axis, from the clamped section to the tip
    up : (3,) direction of positive bending, made normal to the axis
    bend, twist, sway : shapes along the axis: of bending (length unit), of twist (degrees, positive by the right-hand
        rule about the sections' normal) and of bending in the plane (length unit, along axis x up)
    section : (3,) normal of the sections; by default the axis, for streamwise sections of a swept wing (0, 1, 0)
    unit : length unit, for the parameters' names only

    Raises
    ------
    ValueError
        For points that coincide, ``up`` along the axis, sections that contain the axis.
    """

    root: Vector
    tip: Vector
    up: Vector = (0.0, 0.0, 1.0)
    bend: Basis = field(default_factory=lambda: Powers((2, 3)))
    twist: Basis = field(default_factory=lambda: Powers((1, 2)))
    sway: Basis = field(default_factory=lambda: Powers(()))
    section: Vector | None = None
    unit: str = ""

    def __post_init__(self) -> None:
        self.frame()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """bend_*, twist_*, sway_*."""
        return (
            *(Parameter(f"bend_{n}", self.unit) for n in self.bend.names),
            *(Parameter(f"twist_{n}", "deg") for n in self.twist.names),
            *(Parameter(f"sway_{n}", self.unit) for n in self.sway.names),
        )

    def frame(self) -> tuple[Array, float, Array, Array, Array]:
        """Axis (3,), its length, up (3,) and axis x up (3,) normal to it, and the sections' normal (3,)."""
        along = vector(self.tip, "tip") - vector(self.root, "root")
        axis = unit(along, "tip - root")
        up = vector(self.up, "up")
        normal = unit(up - (up @ axis) * axis, "up, which must not lie along the axis,")
        section = axis if self.section is None else unit(vector(self.section, "section"), "section")
        if abs(float(section @ axis)) < 0.1:
            raise UsageError("section: the sections' normal must not be at right angles to the axis")
        return axis, float(np.linalg.norm(along)), normal, np.cross(axis, normal), section * np.sign(section @ axis)

    def bind(self, xyz: Array) -> BoundLaw:
        """See `Law`."""
        return _BoundBeam(self, xyz)


class _BoundBeam:
    """Shapes at the points' stations, worked out once."""

    def __init__(self, beam: Beam, xyz: Array) -> None:
        axis, length, up, side, section = beam.frame()
        from_root = xyz - vector(beam.root, "root")
        e = np.maximum(from_root @ section / (axis @ section) / length, 0.0)
        self._foot = vector(beam.root, "root") + (length * e)[:, None] * axis
        arm = xyz - self._foot
        along = (arm @ section)[:, None] * section
        self._arms = np.stack([along, arm - along, np.cross(section, arm)], axis=1)
        self._frame = np.stack([axis, up, side])
        self._share = length * e[:, None] * WEIGHTS  # of the integral from the root to the station
        # Degrees come out of the twist's shapes: the law's own unit is the radian.
        shapes = ((beam.bend, 1.0), (beam.twist, DEGREE), (beam.sway, 1.0))
        self._many_bend, self._many_twist, _ = (len(b.names) for b, _ in shapes)
        self._values = np.concatenate([unit * b.value(e) for b, unit in shapes], axis=-1)
        self._slopes = np.concatenate([unit * b.slope(e) for b, unit in shapes], axis=-1) / length
        between = e[:, None] * NODES
        self._between = np.concatenate([unit * b.slope(between) for b, unit in shapes], axis=-1) / length

    def place(self, q: Array) -> Array:
        """See `BoundLaw`."""
        return self._bent(q, 0)[0]

    def linearise(self, q: Array) -> tuple[Array, Array]:
        """See `BoundLaw`."""
        return self._bent(q, len(self._foot))

    def _bent(self, q: Array, derivatives: int) -> tuple[Array, Array]:
        """Places (N, 3) and the derivatives (N, 3, K) of so many points, all or none."""
        from windmark.deformation.laws._beam_kernels import bend

        place, by_q = np.empty_like(self._foot), np.empty((derivatives, 3, len(q)))
        bend(
            np.ascontiguousarray(q, dtype=float), self._many_bend, self._many_twist, self._frame, self._foot,
            self._arms, self._values, self._slopes, self._between, self._share, place, by_q,
        )  # fmt: skip
        return place, by_q
