"""Wings: a beam that bends and twists along its elastic axis.

Sections stay flat and keep their shape. The axis does not stretch: it comes back by the integral of 1 - cos(slope) as
it bends, and the sections lean with it. For a tip that rises by 2 % of the span these are 0.02 % of the span and 3 % of
the thickness, both more than a good stereo system's uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.law import BoundLaw
from windmark.deformation.laws.bases import Basis, Powers
from windmark.deformation.laws.directions import Vector, unit, vector
from windmark.deformation.parameter import Parameter

Array = NDArray[np.float64]

DEGREE = np.pi / 180.0
NODES, WEIGHTS = (0.5 * (v + k) for v, k in zip(np.polynomial.legendre.leggauss(12), (1.0, 0.0), strict=True))
"""Gauss-Legendre on [0, 1], for the shortening."""
STEP = 1e-6
"""Of the numerical derivatives, in lengths of the beam and in turns of one radian."""


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
            raise ValueError("section: the sections' normal must not be at right angles to the axis")
        return axis, float(np.linalg.norm(along)), normal, np.cross(axis, normal), section * np.sign(section @ axis)

    def bind(self, xyz: Array) -> BoundLaw:
        """See `Law`."""
        return _BoundBeam(self, xyz)


class _BoundBeam:
    """Shapes at the points' stations, worked out once."""

    def __init__(self, beam: Beam, xyz: Array) -> None:
        self._axis, length, self._up, self._side, self._section = beam.frame()
        from_root = xyz - vector(beam.root, "root")
        e = np.maximum(from_root @ self._section / (self._axis @ self._section) / length, 0.0)
        self._foot = vector(beam.root, "root") + (length * e)[:, None] * self._axis
        self._arm = xyz - self._foot
        between = e[:, None] * NODES
        self._share = length * e[:, None] * WEIGHTS  # of the integral from the root to the station
        self._values = [b.value(e) for b in (beam.bend, beam.twist, beam.sway)]
        self._slopes = [b.slope(e) / length for b in (beam.bend, beam.sway)]
        self._between = [b.slope(between) / length for b in (beam.bend, beam.sway)]
        counts = [v.shape[-1] for v in self._values]
        self._parts = [slice(int(a), int(b)) for a, b in pairwise(np.cumsum([0, *counts]))]
        self._steps = np.repeat([STEP * length, STEP / DEGREE, STEP * length], counts)

    def place(self, q: Array) -> Array:
        """See `BoundLaw`."""
        return self._many(q[None])[0]

    def linearise(self, q: Array) -> tuple[Array, Array]:
        """See `BoundLaw`; central differences, all parameters at once."""
        steps = np.diag(self._steps)
        out = self._many(np.concatenate([q[None], q + steps, q - steps]))
        k = len(q)
        return out[0], np.moveaxis((out[1 : k + 1] - out[k + 1 :]) / (2 * self._steps[:, None, None]), 0, -1)

    def _many(self, q: Array) -> Array:
        """Displaced points (B, N, 3) for many sets of parameters (B, k)."""
        bend, twist, sway = self._parts
        w, v = (q[:, part] @ values.T for part, values in ((bend, self._values[0]), (sway, self._values[2])))
        dw, dv = (q[:, part] @ slopes.T for part, slopes in zip((bend, sway), self._slopes, strict=True))
        angle = DEGREE * (q[:, twist] @ self._values[1].T)
        inner = sum(
            np.einsum("bk,nmk->bnm", q[:, part], slopes) ** 2
            for part, slopes in zip((bend, sway), self._between, strict=True)
        )
        shorter = ((1 - np.sqrt(np.maximum(1 - inner, 0.0))) * self._share).sum(axis=-1)
        axis = self._foot - shorter[..., None] * self._axis + w[..., None] * self._up + v[..., None] * self._side
        return np.asarray(axis + self._lean(dw, dv, self._twisted(angle)))

    def _twisted(self, angle: Array) -> Array:
        """The sections' points turned about the sections' normal (Rodrigues' formula)."""
        m, arm = self._section, self._arm
        along = (arm @ m)[:, None] * m
        cos, sin = np.cos(angle)[..., None], np.sin(angle)[..., None]
        return np.asarray(along + cos * (arm - along) + sin * np.cross(m, arm))

    def _lean(self, dw: Array, dv: Array, arm: Array) -> Array:
        """Sections that lean with the axis: the least rotation from the axis to its new direction t.

        With u = a x t it is x + u x x + u x (u x x) / (1 + a t).
        """
        cos = np.sqrt(np.maximum(1 - dw**2 - dv**2, 0.0))
        # a x up = side, a x side = -up.
        turn = dw[..., None] * self._side - dv[..., None] * self._up
        across = np.cross(turn, arm)
        return np.asarray(arm + across + np.cross(turn, across) / (1 + cos)[..., None])
