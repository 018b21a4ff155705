"""Walls: the heat flux into them that makes the surface's temperature rise, as a response in time.

For a temperature that is straight between samples the flux is exact: it is a sum of the wall's response to a ramp of
the surface temperature. Of a semi-infinite wall that is 2 e sqrt(t / pi), which gives the formula of Cook and Felderman
(AIAA J. 4, 1966); of layers it is found from their admittance in the Laplace domain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError

Array = NDArray[np.float64]

BACKS = ("semi-infinite", "adiabatic", "isothermal")
TERMS = 20
"""Terms of Talbot's contour (Abate and Valko, Int. J. Numer. Methods Eng. 60, 2004): twelve digits are wanted, and more
terms lose them to rounding."""
CHUNK = 4096
"""Times that are worked on at once."""


@dataclass(frozen=True)
class Layer:
    """One layer: thickness (m), conductivity (W / m K) and heat capacity per volume, density times c (J / m^3 K).

    Examples
    --------
    >>> import windmark as wm
    >>> steel = wm.Layer(thickness=0.01, conductivity=16.0, capacity=4.0e6)
    >>> steel.effusivity, steel.diffusivity
    (8000.0, 4e-06)
    """

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

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> steel = wm.Wall.semi_infinite(16.0, 4.0e6)
    >>> painted = wm.Wall.of([wm.Layer(2e-4, 0.2, 1.6e6), wm.Layer(0.02, 16.0, 4.0e6)], back="adiabatic")
    >>> painted.back, [layer.thickness for layer in painted.layers]
    ('adiabatic', [0.0002, 0.02])
    >>> early, late = steel.heated_depth([1.0, 4.0])
    >>> round(float(late / early), 3)  # heat goes on with the square root of time
    2.0
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

    def curved_admittance(self, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """What the admittance loses for each 1 / m of the sum of the surface's curvatures (convex to the air).

        At the depth z heat has 1 - curvature z of the surface's area. The admittance is the integral of area (k T'^2 +
        s c T^2) over the depth for a surface temperature of 1, and stationary by T: its change of the first order is
        that of the area alone, with T of the flat wall. Of a semi-infinite wall: conductivity / 2.
        """
        root = np.sqrt(s)
        below = np.zeros(np.shape(s), complex)
        inner: list[NDArray[np.complex128]] = []  # admittance below each layer, from the last one up
        for k, layer in enumerate(self.layers[::-1]):
            inner.append(below)
            own = layer.effusivity * root
            if k == 0 and self.back == "semi-infinite":
                below = own
                continue
            t = np.tanh(layer.thickness * root / np.sqrt(layer.diffusivity))
            below = own / t if k == 0 and self.back == "isothermal" else own * (below + own * t) / (own + below * t)
        out, top, depth = np.zeros(np.shape(s), complex), np.ones(np.shape(s), complex), 0.0
        for k, (layer, under) in enumerate(zip(self.layers, inner[::-1], strict=True)):
            own, p = layer.effusivity * root, root / np.sqrt(layer.diffusivity)
            last = k == len(self.layers) - 1
            if last and self.back == "semi-infinite":
                return np.asarray(out + layer.conductivity * p**2 * top**2 * (depth / p + 0.5 / p**2))
            length = layer.thickness
            back = np.exp(-2 * p * length)  # T = a (exp(-p z) + r exp(p (z - 2 length)))
            r = -np.ones_like(own) if last and self.back == "isothermal" else (own - under) / (own + under)
            a2 = (top / (1 + r * back)) ** 2
            down = (1 - back) / (2 * p)
            deep = down * (depth + 1 / (2 * p)) - length * back / (2 * p)
            up = down * (depth - 1 / (2 * p)) + length / (2 * p)
            out = out + 2 * layer.conductivity * p**2 * a2 * (deep + r**2 * back * up)
            top = top * np.exp(-p * length) * (1 + r) / (1 + r * back)
            depth += length
        return np.asarray(out)

    def conductance_along(self, time: ArrayLike) -> Array:
        """Conductance along the surface (N,), W / K, at times (N,) after the surface was warmed by 1 K and kept so.

        The integral of conductivity times temperature over the depth: of a semi-infinite wall conductivity times
        2 sqrt(diffusivity t / pi); in the end each layer's conductivity times thickness for an adiabatic back. Metal
        under an insulator has its part as it gets warm, which is long after heat has gone through the insulator.
        """
        t = np.asarray(time, dtype=float)
        out = np.zeros(t.shape)
        out[t > 0] = _in_time(lambda s: self._along(s) / s, t[t > 0])
        return out

    def _along(self, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """The integral of `conductance_along` in the Laplace domain, for a surface temperature of 1.

        As k T'' = s c T it is, of a layer, its diffusivity / s times the flux into it less that out of it.
        """
        root = np.sqrt(s)
        out, top = np.zeros(np.shape(s), complex), np.ones(np.shape(s), complex)
        for k, layer in enumerate(self.layers):
            entering = top * Wall(self.layers[k:], self.back).admittance(s)
            leaving = np.zeros_like(top)
            if k < len(self.layers) - 1 or self.back == "isothermal":
                own, e = layer.effusivity * root, np.exp(-layer.thickness * root / np.sqrt(layer.diffusivity))
                if k == len(self.layers) - 1:
                    leaving = top * own * 2 * e / (1 - e**2)
                else:
                    below = Wall(self.layers[k + 1 :], self.back).admittance(s)
                    top = top * 2 * e * own / (own * (1 + e**2) + below * (1 - e**2))
                    leaving = top * below
            out = out + layer.diffusivity / s * (entering - leaving)
        return np.asarray(out)

    def ramp_response(self, time: ArrayLike) -> Array:
        """Flux (N,) at times (N,) > 0 after the surface began to warm by 1 K per second, W / m^2."""
        t = np.asarray(time, dtype=float)
        if len(self.layers) == 1 and self.back == "semi-infinite":
            return np.asarray(2 * self.layers[0].effusivity * np.sqrt(t / np.pi))
        return _in_time(lambda s: self.admittance(s) / s**2, t)

    def curved_ramp_response(self, time: ArrayLike) -> Array:
        """What `ramp_response` loses for each 1 / m of curvature, see `curved_admittance`; W / m."""
        t = np.asarray(time, dtype=float)
        if len(self.layers) == 1 and self.back == "semi-infinite":
            return np.asarray(0.5 * self.layers[0].conductivity * t)
        return _in_time(lambda s: self.curved_admittance(s) / s**2, t)

    def step_weights(self, dt: float, count: int, *, curved: bool = False) -> Array:
        """(count,) flux after 0, 1, ... samples for a rise of 1 K within one; ``curved``: its loss by curvature."""
        response = self.curved_ramp_response if curved else self.ramp_response
        return np.diff(np.concatenate([[0.0], response(dt * np.arange(1, count + 1))])) / dt

    def heated_depth(self, time: ArrayLike) -> Array:
        """How deep (m) heat has gone at times (N,): 2 sqrt(diffusivity t / pi) through one layer after the other."""
        left = 2 * np.sqrt(np.maximum(np.asarray(time, dtype=float), 0.0) / np.pi)
        out = np.zeros(left.shape)
        for k, layer in enumerate(self.layers):
            root = np.sqrt(layer.diffusivity)
            goes_on = k == len(self.layers) - 1 and self.back == "semi-infinite"
            part = left * root if goes_on else np.minimum(left * root, layer.thickness)
            out += part
            left = left - part / root
        return out

    def fourier_number(self, time: ArrayLike) -> Array:
        """How far heat has gone through a wall thought semi-infinite: diffusivity t / thickness^2, its layers added up
        by the time that they take; 0 for other walls.
        """
        t = np.asarray(time, dtype=float)
        through = sum(layer.thickness / np.sqrt(layer.diffusivity) for layer in self.layers)
        return np.zeros(t.shape) if self.back != "semi-infinite" else np.asarray(t / through**2)


def _in_time(transform: Callable[[Any], Any], time: Array) -> Array:
    """(N,) the function of time (N,) > 0 that has a Laplace transform, by Talbot's contour."""
    theta = np.arange(1, TERMS) * np.pi / TERMS
    cot = 1 / np.tan(theta)
    delta = np.concatenate([[0.4 * TERMS], 0.4 * np.arange(1, TERMS) * np.pi * (cot + 1j)])
    gamma = np.concatenate([
        [0.5 * np.exp(delta[0])],
        (1 + 1j * theta * (1 + cot**2) - 1j * cot) * np.exp(delta[1:]),
    ])  # fmt: skip
    out = np.empty(len(time))
    for k in range(0, len(time), CHUNK):
        t = time[k : k + CHUNK]
        s = delta / t[:, None]
        out[k : k + CHUNK] = 0.4 / t * (gamma * transform(s)).real.sum(axis=1)
    return out
