"""Volumes that move but keep their shape: free rigid bodies, hinged flaps, models on a bending sting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.law import BoundLaw, Numeric
from windmark.deformation.laws.directions import Vector, unit, vector
from windmark.deformation.parameter import Parameter
from windmark.errors import UsageError
from windmark.geometry.rotations import exp_so3, hat, left_jacobian

Array = NDArray[np.float64]

DEGREE = np.pi / 180.0
SLOPE = {"force": 1.5, "moment": 2.0}
"""Slope at the end of a cantilever over deflection / length, for a force or a moment there (Euler-Bernoulli)."""
SHORTENING = {"force": 0.6, "moment": 2.0 / 3.0}
"""How much the end comes back over deflection^2 / length: half the integral of the squared slope."""


@dataclass(frozen=True)
class Rigid:
    """A rigid motion of a volume relative to its parent: a shift and a rotation vector about a pivot.

    Parameters
    ----------
    pivot : (3,) point that the rotation leaves where it is
    unit : length unit, for the parameters' names only
    """

    pivot: Vector = (0.0, 0.0, 0.0)
    unit: str = ""

    def __post_init__(self) -> None:
        vector(self.pivot, "pivot")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """shift_x, shift_y, shift_z, turn_x, turn_y, turn_z (degrees)."""
        shifts = tuple(Parameter(f"shift_{a}", self.unit) for a in "xyz")
        return shifts + tuple(Parameter(f"turn_{a}", "deg") for a in "xyz")

    def bind(self, xyz: Array) -> BoundLaw:
        """See `Law`."""
        return _BoundRigid(xyz - vector(self.pivot, "pivot"), vector(self.pivot, "pivot"))


@dataclass(frozen=True)
class _BoundRigid:
    arm: Array
    pivot: Array

    def place(self, q: Array) -> Array:
        return np.asarray(self.arm @ exp_so3(DEGREE * q[3:]).T + self.pivot + q[:3])

    def linearise(self, q: Array) -> tuple[Array, Array]:
        turned = self.arm @ exp_so3(DEGREE * q[3:]).T
        by_q = np.empty((*self.arm.shape, 6))
        by_q[..., :3] = np.eye(3)
        by_q[..., 3:] = -DEGREE * (hat(turned) @ left_jacobian(DEGREE * q[3:]))
        return turned + self.pivot + q[:3], by_q


@dataclass(frozen=True)
class Hinge:
    """A flap, rudder or aileron that turns about its hinge line.

    Parameters
    ----------
    start, end : (3,) two points of the hinge line; the angle is positive by the right-hand rule from start to end

    Raises
    ------
    ValueError
        For points that coincide.
    """

    start: Vector
    end: Vector

    def __post_init__(self) -> None:
        self.line()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The angle in degrees."""
        return (Parameter("angle", "deg"),)

    def line(self) -> tuple[Array, Array]:
        """A point (3,) of the hinge line and its direction (3,)."""
        origin = vector(self.start, "start")
        return origin, unit(vector(self.end, "end") - origin, "end - start")

    def bind(self, xyz: Array) -> BoundLaw:
        """See `Law`."""
        origin, axis = self.line()
        return _BoundHinge(xyz - origin, origin, axis)


@dataclass(frozen=True)
class _BoundHinge:
    arm: Array
    origin: Array
    axis: Array

    def place(self, q: Array) -> Array:
        return np.asarray(self.arm @ exp_so3(DEGREE * q[0] * self.axis).T + self.origin)

    def linearise(self, q: Array) -> tuple[Array, Array]:
        out = self.place(q)
        return out, DEGREE * np.cross(self.axis, out - self.origin)[..., None]


@dataclass(frozen=True)
class Sting:
    """A rigid model on a sting that bends like a cantilever and twists.

    Parameters
    ----------
    root : (3,) where the sting is clamped
    end : (3,) where it enters the model
    up : (3,) direction of the first deflection, made normal to the sting
    load : "force" or "moment" at the end: which slope belongs to a deflection
    unit : length unit, for the parameters' names only

    Notes
    -----
    A model whose rigid motion is free needs no sting; with a known sting two deflections and a roll replace six
    parameters. The end comes back by 0.6 (force) or 2/3 (moment) of deflection^2 / length.
    """

    root: Vector
    end: Vector
    up: Vector = (0.0, 0.0, 1.0)
    load: str = "force"
    unit: str = ""

    def __post_init__(self) -> None:
        if self.load not in SLOPE:
            raise UsageError(f"sting: load must be one of {', '.join(SLOPE)}, got {self.load!r}")
        self.frame()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Names: deflection (along up), side (along sting x up) and roll (degrees, about the sting)."""
        return Parameter("deflection", self.unit), Parameter("side", self.unit), Parameter("roll", "deg")

    def frame(self) -> tuple[Array, float, Array, Array]:
        """Axis (3,), its length, up (3,) and axis x up (3,) normal to it."""
        along = vector(self.end, "end") - vector(self.root, "root")
        axis = unit(along, "end - root")
        up = vector(self.up, "up")
        normal = unit(up - (up @ axis) * axis, "up, which must not lie along the sting,")
        return axis, float(np.linalg.norm(along)), normal, np.cross(axis, normal)

    def bind(self, xyz: Array) -> BoundLaw:
        """See `Law`."""
        end = vector(self.end, "end")
        a, length, n, c = self.frame()
        slope, shortening = SLOPE[self.load] / length, SHORTENING[self.load] / length
        arm = xyz - end

        def place(q: Array) -> Array:
            w, v, roll = q
            # The end's tangent leans by w towards n (a turn about a x n = c) and by v towards c (about -n).
            lean = np.arctan(slope * np.hypot(w, v))
            axis = np.zeros(3) if w == v == 0 else (w * c - v * n) / np.hypot(w, v)
            rotation = exp_so3(lean * axis) @ exp_so3(DEGREE * roll * a)
            shift = w * n + v * c - shortening * (w * w + v * v) * a
            return np.asarray(arm @ rotation.T + end + shift)

        return Numeric(place, np.array([1e-5 * length, 1e-5 * length, 1e-3]))
