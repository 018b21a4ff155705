"""The wind of a virtual polar: a transonic Cp field with shock and tip vortex that go with incidence, and wall heat."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from windmark.synth.paint import TransonicFlow
from windmark.synth.wing import HalfModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PolarFlow:
    """A drawing of the flow round the half model at one incidence, not a solution of one.

    Parameters
    ----------
    shape : the model
    alpha_deg : incidence
    mach : of the stream
    p0_Pa, T0_K : stagnation pressure and temperature
    recovery : factor r of the wall temperature T_inf + r (T0 - T_inf)
    uneven : (W, 5) waves by which the wall is warmer than that: wave vector, phase, amplitude in kelvin
    shock_width : of the chord
    """

    shape: HalfModel = field(default_factory=HalfModel)
    alpha_deg: float = 2.0
    mach: float = 0.8
    p0_Pa: float = 100_000.0
    T0_K: float = 303.15
    recovery: float = 0.896
    uneven: Array = field(default_factory=lambda: np.zeros((0, 5)))
    shock_width: float = 0.02

    @property
    def p_inf_Pa(self) -> float:
        """Static pressure of the stream (gamma = 1.4)."""
        return float(self.p0_Pa * (1 + 0.2 * self.mach**2) ** -3.5)

    @property
    def q_inf_Pa(self) -> float:
        """Dynamic pressure of the stream."""
        return 0.7 * self.mach**2 * self.p_inf_Pa

    @property
    def wall_T_K(self) -> float:
        """The recovery temperature."""
        cold = self.T0_K / (1 + 0.2 * self.mach**2)
        return cold + self.recovery * (self.T0_K - cold)

    def state(self, xyz: Array, normal: Array, volume: str) -> tuple[Array, Array]:
        """See `pressure_paint.Air`."""
        p = self.p_inf_Pa + self.q_inf_Pa * self.cp(xyz, normal, volume)
        warmer = np.cos(xyz @ self.uneven[:, :3].T + self.uneven[:, 3]) @ self.uneven[:, 4]
        return p, self.wall_T_K + warmer

    def cp(self, xyz: Array, normal: Array, volume: str) -> Array:
        """(N,) pressure coefficient at rest points (N, 3) with normals (N, 3); 0 on walls."""
        if volume == "wing":
            return self._wing(xyz, normal)
        if volume == "body":
            still = TransonicFlow(self.shape, self.mach).body_cp(xyz)
            return np.asarray(still - 0.02 * self.alpha_deg * normal[..., 2])
        return np.zeros(len(xyz))

    def _wing(self, xyz: Array, normal: Array) -> Array:
        """Suction peak, plateau, shock, recovery and vortex above; the two surfaces are blended round the nose."""
        xc, eta = self.shape.planform(xyz)
        a = self.alpha_deg
        stagnation = np.exp(-xc / 0.012)
        shock = 0.56 - 0.18 * eta + 0.012 * a
        peak = (0.12 + 0.1 * a) * np.exp(-((xc / 0.07) ** 2))
        plateau = -(0.5 + 0.12 * a) * (1 - 0.35 * eta**4) - peak
        recovery = -0.25 - 0.02 * a + (0.45 + 0.02 * a) * (xc - shock) / (1 - shock)
        after = 0.5 * (1 + np.tanh((xc - shock) / self.shock_width))
        upper = 0.9 * stagnation + (1 - stagnation) * ((1 - after) * plateau + after * recovery)
        upper = upper - (0.05 + 0.1 * a) * np.exp(-(((eta - 0.97 + 0.05 * xc) / 0.025) ** 2)) * 0.5 * (
            1 + np.tanh((xc - 0.25) / 0.1)
        )
        lower = 0.9 * stagnation + (1 - stagnation) * (0.2 * xc - (0.28 - 0.06 * a) * np.sin(np.pi * xc))
        share = 0.5 * (1 + np.tanh(6 * normal[..., 2]))
        return np.asarray(share * upper + (1 - share) * lower)
