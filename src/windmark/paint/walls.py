"""Walls: the heat flux into them that makes the surface's temperature rise, as a response in time.

For a temperature that is straight between samples the flux is exact: it is a sum of the wall's response to a ramp of
the surface temperature. Of a semi-infinite wall that is 2 e sqrt(t / pi), which gives the formula of Cook and Felderman
(AIAA J. 4, 1966); of layers it is found from their admittance in the Laplace domain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError

Array = NDArray[np.float64]

BACKS = ("semi-infinite", "adiabatic", "isothermal")
TERMS = 20
"""Terms of Talbot's contour (Abate and Valko, Int. J. Numer. Methods Eng. 60, 2004): twelve digits are wanted, and more
terms lose them to rounding."""


@dataclass(frozen=True)
class Layer:
    """One layer: thickness (m), conductivity (W / m K) and heat capacity per volume, density times c (J / m^3 K)."""

    thickness: float
    conductivity: float
    capacity: float

    def __post_init__(self) -> None:
        if not (self.thickness > 0 and self.conductivity > 0 and self.capacity > 0):
            raise UsageError(f"Layer: thickness, conductivity and capacity must be above zero, got {self}")

    @property
    def effusivity(self) -> float:
        """Root of conductivity times capacity."""
        return float(np.sqrt(self.conductivity * self.capacity))

    @property
    def diffusivity(self) -> float:
        """Conductivity over capacity, m^2 / s."""
        return self.conductivity / self.capacity


@dataclass(frozen=True)
class Wall:
    """Layers from the surface inwards.

    Parameters
    ----------
    layers : of which the last ends at ``back``
    back : "semi-infinite": the last layer goes on (its thickness then only says how long that may be thought);
        "adiabatic": no heat leaves at its back; "isothermal": its back keeps the initial temperature
    relative_sigma : of the effusivities, in common to all nodes: it goes straight into the flux
    """

    layers: tuple[Layer, ...]
    back: str = "semi-infinite"
    relative_sigma: float = 0.0

    def __post_init__(self) -> None:
        if not self.layers or self.back not in BACKS or not self.relative_sigma >= 0:
            raise UsageError(f"Wall: at least one layer, and back one of {', '.join(BACKS)}, got {self.back!r}")
        finite = self.layers[:-1] if self.back == "semi-infinite" else self.layers
        if any(not np.isfinite(layer.thickness) for layer in finite):
            raise UsageError("Wall: layers must have a finite thickness, but for the last one of a semi-infinite wall")

    @staticmethod
    def semi_infinite(conductivity: float, capacity: float, *, thickness: float = np.inf, relative_sigma: float = 0.0
                      ) -> Wall:  # fmt: skip
        """One material that is thick enough; its real ``thickness`` says until when."""
        return Wall((Layer(thickness, conductivity, capacity),), "semi-infinite", relative_sigma)

    @staticmethod
    def of(layers: Sequence[Layer], back: str = "adiabatic", *, relative_sigma: float = 0.0) -> Wall:
        """A wall of layers of finite thickness."""
        return Wall(tuple(layers), back, relative_sigma)

    def admittance(self, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Flux over surface temperature in the Laplace domain (Carslaw and Jaeger, section 3.7, by layers)."""
        last = self.layers[-1]
        root = np.sqrt(s)
        y = last.effusivity * root
        if self.back != "semi-infinite":
            t = np.tanh(last.thickness * root / np.sqrt(last.diffusivity))
            y = y * t if self.back == "adiabatic" else y / t
        for layer in self.layers[-2::-1]:
            own, t = layer.effusivity * root, np.tanh(layer.thickness * root / np.sqrt(layer.diffusivity))
            y = own * (y + own * t) / (own + y * t)
        return np.asarray(y)

    def ramp_response(self, time: ArrayLike) -> Array:
        """Flux (N,) at times (N,) > 0 after the surface began to warm by 1 K per second, W / m^2."""
        t = np.asarray(time, dtype=float)
        if len(self.layers) == 1 and self.back == "semi-infinite":
            return np.asarray(2 * self.layers[0].effusivity * np.sqrt(t / np.pi))
        theta = np.arange(1, TERMS) * np.pi / TERMS
        cot = 1 / np.tan(theta)
        delta = np.concatenate([[0.4 * TERMS], 0.4 * np.arange(1, TERMS) * np.pi * (cot + 1j)])
        gamma = np.concatenate([
            [0.5 * np.exp(delta[0])],
            (1 + 1j * theta * (1 + cot**2) - 1j * cot) * np.exp(delta[1:]),
        ])  # fmt: skip
        s = delta / t[:, None]
        return np.asarray(0.4 / t * (gamma * self.admittance(s) / s**2).real.sum(axis=1))

    def step_weights(self, dt: float, count: int) -> Array:
        """(count,) flux after 0, 1, ... samples for a rise of 1 K within one sample."""
        r = np.concatenate([[0.0], self.ramp_response(dt * np.arange(1, count + 1))])
        return np.diff(r) / dt

    def fourier_number(self, time: ArrayLike) -> Array:
        """How far heat has gone through a wall thought semi-infinite: diffusivity t / thickness^2, its layers added up
        by the time that they take; 0 for other walls.
        """
        t = np.asarray(time, dtype=float)
        through = sum(layer.thickness / np.sqrt(layer.diffusivity) for layer in self.layers)
        return np.zeros(t.shape) if self.back != "semi-infinite" else np.asarray(t / through**2)
