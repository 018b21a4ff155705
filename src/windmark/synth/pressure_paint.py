"""Pressure-sensitive paint of the virtual tunnel: Stern-Volmer with temperature, bleached by the light that it had."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.synth.paint import Flow, Paint

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

Array = NDArray[np.float64]


class Air(Protocol):
    """What the paint feels."""

    def state(self, xyz: Array, normal: Array, volume: str) -> tuple[Array, Array]:
        """Pressure (Pa) and wall temperature (K) at rest points (N, 3) with normals (N, 3): (N,) each."""
        ...


@dataclass(frozen=True)
class StillAir:
    """Wind off: one pressure and one temperature everywhere."""

    p_Pa: float = 101_325.0
    T_K: float = 293.15

    def state(self, xyz: Array, normal: Array, volume: str) -> tuple[Array, Array]:
        """See `Air`."""
        return np.full(len(xyz), self.p_Pa), np.full(len(xyz), self.T_K)


@dataclass(frozen=True)
class SternVolmer:
    """The true calibration of a paint: I_ref / I = sum over k of A_k(T) (p / p_ref)^k.

    Source: Liu and Sullivan, *Pressure and Temperature Sensitive Paints*, chapter 3.

    Parameters
    ----------
    coefficients : (K, M) A_k(T) = sum over m of coefficients[k, m] (T - T_ref)^m; the first column sums to 1
    p_ref_Pa, T_ref_K : where I = I_ref
    """

    coefficients: Array
    p_ref_Pa: float = 100_000.0
    T_ref_K: float = 293.15

    def __post_init__(self) -> None:
        if np.ndim(self.coefficients) != 2 or abs(float(self.coefficients[:, 0].sum()) - 1) > 1e-9:
            raise ValueError("SternVolmer: coefficients must be (K, M) with a first column that sums to 1")

    def ratio(self, p_Pa: ArrayLike, T_K: ArrayLike) -> Array:
        """I_ref / I at pressures and temperatures of any common shape."""
        x, warmer = np.asarray(p_Pa, dtype=float) / self.p_ref_Pa, np.asarray(T_K, dtype=float) - self.T_ref_K
        by_power = [np.polynomial.polynomial.polyval(warmer, a) for a in self.coefficients]
        return np.asarray(sum(a * x**k for k, a in enumerate(by_power)))


TYPICAL = SternVolmer(np.array([[0.17, 0.0006, 0.0], [0.88, 0.0072, 3e-5], [-0.05, -0.0003, 0.0]]))
"""A porphyrin paint: 0.83 % per per cent of pressure, 0.75 % per kelvin, slightly curved."""


@dataclass(frozen=True, eq=False)
class Glow:
    """Light that the surface throws on itself, tabulated at N places of the model at rest.

    Parameters
    ----------
    xyz, normal : (N, 3)
    light : (N,) what is added to the surface's own, in the same unit
    """

    xyz: Array
    normal: Array
    light: Array

    SIDES = 30.0
    """Length by which opposite normals are apart: two sides of a thin wing are far from each other."""

    def at(self, xyz: Array, normal: Array) -> Array:
        """(N,) light at rest points with normals: the mean of the four nearest places, by their inverse distance."""
        distance, place = self._tree.query(np.column_stack([xyz, self.SIDES * normal]), k=4)
        weight = 1 / np.maximum(distance, 1e-6)
        return np.asarray((weight * self.light[place]).sum(axis=1) / weight.sum(axis=1))

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree

        return cKDTree(np.column_stack([self.xyz, self.SIDES * self.normal]))


@dataclass(frozen=True)
class SensitivePaint(Paint):
    """`Paint` that answers to pressure and temperature, and fades with the light that it had.

    The volumes of ``sensitive`` answer, the others shine as `Paint` has them.

    Parameters
    ----------
    law : its calibration
    air : what it feels; `Paint`'s own ``flow`` does nothing
    fading_per_s : part of its light that it loses per second of unit light
    lit_s : how long the lamps have been on
    lamp_factor : of all lamps at this instant: they flicker
    glow : what its sensitive volumes throw on each other; None: nothing
    """

    law: SternVolmer = field(default_factory=lambda: TYPICAL)
    air: Air = field(default_factory=StillAir)
    fading_per_s: float = 0.0
    lit_s: float = 0.0
    lamp_factor: float = 1.0
    glow: Glow | None = None

    @staticmethod
    def of(paint: Paint, law: SternVolmer = TYPICAL, *, fading_per_s: float = 0.0) -> SensitivePaint:
        """A coating with lamps as a sensitive one, in still air."""
        same = {f.name: getattr(paint, f.name) for f in fields(Paint)}
        return SensitivePaint(**same, law=law, fading_per_s=fading_per_s)

    def shine(self, p: Array, n: Array, p0: Array, n0: Array, volume: str, flow: Flow | None) -> Array:
        """See `Paint.shine`."""
        light = self.light(p, n)
        out = self.lamp_factor * light * self.coating(p0, volume)
        if volume in self.sensitive:
            out *= np.exp(-self.fading_per_s * self.lit_s * light) / self.law.ratio(*self.air.state(p0, n0, volume))
            if self.glow is not None:
                out += self.lamp_factor * self.glow.at(p0, n0)
        return np.asarray(out)
