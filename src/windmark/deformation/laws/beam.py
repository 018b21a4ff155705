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
from windmark.geometry.rotations import hat

Array = NDArray[np.float64]

DEGREE = np.pi / 180.0
NODES, WEIGHTS = (0.5 * (v + k) for v, k in zip(np.polynomial.legendre.leggauss(12), (1.0, 0.0), strict=True))
"""Gauss-Legendre on [0, 1], for the shortening."""
STEEP = 1e-6
"""Least squared cosine of a slope: a search may try bendings that no beam can take."""


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
        self._axis, length, up, side, self._section = beam.frame()
        self._up, self._side = up, side
        from_root = xyz - vector(beam.root, "root")
        e = np.maximum(from_root @ self._section / (self._axis @ self._section) / length, 0.0)
        self._foot = vector(beam.root, "root") + (length * e)[:, None] * self._axis
        arm = xyz - self._foot
        self._along = (arm @ self._section)[:, None] * self._section
        self._across, self._normal = arm - self._along, np.cross(self._section, arm)
        between = e[:, None] * NODES
        self._share = length * e[:, None] * WEIGHTS  # of the integral from the root to the station
        self._values = [b.value(e) for b in (beam.bend, beam.twist, beam.sway)]
        self._slopes = [b.slope(e) / length for b in (beam.bend, beam.sway)]
        self._between = [b.slope(between) / length for b in (beam.bend, beam.sway)]
        counts = [v.shape[-1] for v in self._values]
        self._parts = [slice(int(a), int(b)) for a, b in pairwise(np.cumsum([0, *counts]))]
        # Sections lean by u = axis x direction = w' (axis x up) + v' (axis x side); axis x side is -up.
        by_w, by_v = hat(side), hat(-up)
        self._turns = np.stack([by_w, by_v, by_w @ by_w, by_w @ by_v + by_v @ by_w, by_v @ by_v]).reshape(5, 9)

    def place(self, q: Array) -> Array:
        """See `BoundLaw`."""
        bend, twist, sway = self._parts
        w, v = self._values[0] @ q[bend], self._values[2] @ q[sway]
        dw, dv = self._slopes[0] @ q[bend], self._slopes[1] @ q[sway]
        shorter, _, _ = self._shortening(q)
        lean = np.eye(3) + self._leans(dw, dv)[0]
        return self._axis_place(w, v, shorter) + _turned(lean, self._twisted(self._values[1] @ q[twist])[0])

    def linearise(self, q: Array) -> tuple[Array, Array]:
        """See `BoundLaw`."""
        bend, twist, sway = self._parts
        w, v = self._values[0] @ q[bend], self._values[2] @ q[sway]
        dw, dv = self._slopes[0] @ q[bend], self._slopes[1] @ q[sway]
        shorter, by_bend, by_sway = self._shortening(q)
        leans = self._leans(dw, dv)
        leans[0] += np.eye(3)
        arm, by_angle = self._twisted(self._values[1] @ q[twist])
        turned, by_dw, by_dv = _turned(leans, arm)
        out = np.empty((len(w), 3, len(q)))
        for part, direction, values, slopes, back, by_slope in (
            (bend, self._up, self._values[0], self._slopes[0], by_bend, by_dw),
            (sway, self._side, self._values[2], self._slopes[1], by_sway, by_dv),
        ):
            out[..., part] = direction[:, None] * values[:, None] - self._axis[:, None] * back[:, None]
            out[..., part] += by_slope[..., None] * slopes[:, None]
        out[..., twist] = _turned(leans[0], by_angle)[..., None] * (DEGREE * self._values[1])[:, None]
        return self._axis_place(w, v, shorter) + turned, out

    def _axis_place(self, w: Array, v: Array, shorter: Array) -> Array:
        """Where the axis is at the points' stations."""
        moves = np.stack([-shorter, w, v], axis=1) @ np.stack([self._axis, self._up, self._side])
        return np.asarray(self._foot + moves)

    def _shortening(self, q: Array) -> tuple[Array, Array, Array]:
        """How far the axis comes back at the stations (N,), and its derivatives (N, k) by bending and sway."""
        bend, _, sway = self._parts
        w, v = self._between[0] @ q[bend], self._between[1] @ q[sway]
        left = np.sqrt(np.maximum(1 - w * w - v * v, STEEP))
        shorter = ((1 - left) * self._share).sum(axis=1)
        share = (self._share / left)[:, None]
        return shorter, *((share * x[:, None] @ f)[:, 0] for x, f in zip((w, v), self._between, strict=True))

    def _twisted(self, degrees: Array) -> tuple[Array, Array]:
        """The sections' points turned about the sections' normal (Rodrigues' formula), and the derivative by radian."""
        cos, sin = np.cos(DEGREE * degrees)[:, None], np.sin(DEGREE * degrees)[:, None]
        return self._along + cos * self._across + sin * self._normal, cos * self._normal - sin * self._across

    def _leans(self, dw: Array, dv: Array) -> Array:
        """Sections that lean with the axis: least rotation (N, 3, 3) to its new direction, less 1; derivatives.

        It is hat(u) + hat(u)^2 / (1 + c) with c the cosine between the axis and its direction; the second and third
        are its derivatives by the slopes.
        """
        c = np.sqrt(np.maximum(1 - dw * dw - dv * dv, STEEP))
        part = 1 / (1 + c)
        rise = part * part / c  # of ``part`` with half the squared slope
        zero, one = np.zeros_like(c), np.ones_like(c)
        ww, wv, vv = dw * dw, dw * dv, dv * dv
        rows = np.array([
            [dw, dv, ww * part, wv * part, vv * part],
            [one, zero, (2 * part + ww * rise) * dw, (part + ww * rise) * dv, vv * rise * dw],
            [zero, one, ww * rise * dv, (part + vv * rise) * dw, (2 * part + vv * rise) * dv],
        ])  # fmt: skip
        return (np.moveaxis(rows, 1, -1) @ self._turns).reshape(3, len(c), 3, 3)


def _turned(rotation: Array, vectors: Array) -> Array:
    return np.asarray((rotation @ vectors[..., None])[..., 0])
