"""A model that heats up: a known heat flux into a known wall, its temperatures by fine finite differences.

Nothing here knows how heat flux is found from temperatures: heat is followed layer by layer, in cells that shrink
towards the surface and lose area with depth where the surface is convex, by the Crank-Nicolson scheme. The flux is a
sum of products of place and time, so one dimension of depth is enough: every surface point's temperature is that sum.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.synth.wing import HalfModel

Array = NDArray[np.float64]

CELLS, STEPS = 160, 1500
"""Of depth and of time."""
TABLE = (401, 101)
"""Places along a surface's two parameters for which its curvature is worked out."""


@dataclass(frozen=True)
class SolidWall:
    """Layers from the surface inwards: thickness m, conductivity W/mK, capacity J/m3K. No heat leaves its back."""

    layers: tuple[tuple[float, float, float], ...]

    def rise(self, flux: Callable[[Array], Array], times: ArrayLike, *, curvature: float = 0.0) -> Array:
        """(N,) rise of the surface temperature at times (N,) for a flux (W/m2) that begins at 0.

        ``curvature``: sum of the surface's two, 1 / m, positive where it is convex to the air.
        """
        from scipy.linalg.lapack import dgtsv

        at = np.asarray(times, dtype=float)
        end = float(at.max(initial=0.0))
        if end <= 0:
            return np.zeros(at.shape)
        faces, k, c = self._cells()
        middle, size = 0.5 * (faces[1:] + faces[:-1]), np.diff(faces)
        capacity = c * size * np.maximum(1 - curvature * middle, 0.02)
        resistance = 0.5 * size / (k * np.maximum(1 - curvature * middle, 0.02))
        g = 1 / (resistance[1:] + resistance[:-1])
        # The first steps are short: the surface warms with the root of time.
        t = end * np.linspace(0, 1, STEPS + 1) ** 2
        q = flux(t)
        temperature, surface = np.zeros(len(c)), np.zeros(STEPS + 1)
        total = np.zeros(len(c))
        total[:-1] += g
        total[1:] += g
        beside = -0.5 * g
        for n in range(STEPS):
            step = t[n + 1] - t[n]
            flow = g * np.diff(temperature)
            right = capacity * temperature / step
            right[:-1] += 0.5 * flow
            right[1:] -= 0.5 * flow
            right[0] += 0.5 * (q[n] + q[n + 1])
            # Of three diagonals, straight from LAPACK: what scipy's `solve_banded` adds takes five times as long.
            *_, temperature, info = dgtsv(beside, capacity / step + 0.5 * total, beside, right)
            if info:
                raise np.linalg.LinAlgError(f"SolidWall: step {n}: its equations are singular (dgtsv: {info})")
            surface[n + 1] = temperature[0] + q[n + 1] * resistance[0]
        return np.interp(at, t, surface, left=0.0)

    def _cells(self) -> tuple[Array, Array, Array]:
        """Faces (N + 1,), conductivity and capacity (N,) of the cells, finest at the surface and at each joint."""
        faces, k, c, depth = [np.zeros(1)], [], [], 0.0
        for thickness, conductivity, capacity in self.layers:
            x = np.linspace(0, 1, CELLS + 1)
            fine = 0.03 * x + 0.97 * (x**2 * (3 - 2 * x) if len(self.layers) > 1 else x**3)
            faces.append(depth + thickness * fine[1:])
            depth += thickness
            k += [conductivity] * CELLS
            c += [capacity] * CELLS
        return np.concatenate(faces), np.array(k), np.array(c)


RESIN = SolidWall(((0.012, 0.25, 1.7e6),))
COATED_STEEL = SolidWall(((4e-4, 0.22, 1.6e6), (3e-3, 15.0, 3.7e6)))
"""Of the virtual test: the wing, and the body."""
CURVES = (-80.0, -20.0, 0.0, 20.0, 60.0, 140.0, 260.0, 420.0)
"""Sums of curvatures, 1 / m, for which temperatures are worked out; linear between."""


@dataclass(frozen=True)
class Heating:
    """The heat flux of the virtual test, and the temperatures that it makes.

    Parameters
    ----------
    shape : the half model, in mm
    walls : volume -> what it is made of; other volumes stay cold
    start_s, times : when the wind comes on; the instants (F,) at which temperatures are known
    level : factor on the flux
    phase : where the transition front has its tongues
    initial_K, cold_K : of the model before the wind, on average; of everything else
    """

    shape: HalfModel
    walls: Mapping[str, SolidWall]
    start_s: float
    times: tuple[float, ...]
    level: float = 1.0
    phase: float = 0.0
    initial_K: float = 303.0
    cold_K: float = 288.0

    def laws(self, time: Array) -> Array:
        """(2, N) the two parts of the flux over the time since the start."""
        t = np.asarray(time, dtype=float)

        def rising(after: float, over: float) -> Array:
            x = np.clip((t - after) / over, 0.0, 1.0)
            return np.asarray(x * x * (3 - 2 * x))

        return np.stack([rising(0.0, 0.15) * np.exp(-0.12 * t), rising(0.4, 0.6)])

    def parts(self, xyz: Array, normal: Array, volume: str) -> Array:
        """(2, N) W/m2 at rest points (N, 3): laminar with a stagnation line, and what turbulence adds."""
        if volume == "wing":
            xc, eta = self.shape.planform(xyz)
            front = 0.62 - 0.22 * eta + 0.07 * np.cos(7 * np.pi * eta + self.phase)
            laminar = 700.0 * (xc + 0.04) ** -0.5
            turbulent = 1300.0 * 0.5 * (1 + np.tanh((xc - front) / 0.05))
        elif volume == "body":
            along = (xyz[..., 0] - self.shape.body_nose) / self.shape.ogive_nose
            laminar = 900.0 + 2500.0 * np.exp(-along / 0.3)
            turbulent = 500.0 * 0.5 * (1 + np.tanh((along - 1.5) / 0.2))
        else:
            laminar = turbulent = np.zeros(len(xyz))
        return self.level * np.stack([laminar, turbulent])

    def flux(self, frame: int, xyz: Array, normal: Array, volume: str) -> Array:
        """(N,) W/m2 in one of the instants; 0 before the start."""
        since = self.times[frame] - self.start_s
        return self.laws(np.array([since]))[:, 0] @ self.parts(xyz, normal, volume) * (since > 0)

    def temperature(self, frame: int, xyz: Array, normal: Array, volume: str) -> Array:
        """(N,) kelvin in one of the instants."""
        if volume not in self.walls:
            return np.full(len(xyz), self.cold_K)
        start = self.initial_K + 0.6 * np.cos(0.011 * xyz[..., 0] - 0.008 * xyz[..., 1] + self.phase)
        bend = 1e3 * surface_curvature(self.shape, xyz, normal, volume)
        table = self._rises[volume][:, :, frame]
        rise = [np.interp(bend, CURVES, table[:, k]) for k in range(2)]
        return np.asarray(start + (np.stack(rise) * self.parts(xyz, normal, volume)).sum(axis=0))

    @cached_property
    def _rises(self) -> dict[str, Array]:
        """Volume -> (curves, 2, F) rise for 1 W/m2 of each part."""
        since = np.maximum(np.asarray(self.times) - self.start_s, 0.0)
        parts = [partial(self._law, k) for k in range(2)]
        return {
            name: np.array([[wall.rise(part, since, curvature=bend) for part in parts] for bend in CURVES])
            for name, wall in self.walls.items()
        }

    def _law(self, part: int, time: Array) -> Array:
        return np.asarray(self.laws(time)[part])


def surface_curvature(shape: HalfModel, xyz: Array, normal: Array, volume: str) -> Array:
    """(N,) sum of the surface's curvatures at rest points, 1 / length unit, positive where it is convex.

    From the shape's own surfaces, tabulated: the trace of the second fundamental form over the first one, by central
    differences. The wing's tip counts as its upper and lower surface.
    """
    if volume == "body":
        s = (xyz[..., 0] - shape.body_nose) / (shape.body_tail - shape.body_nose)
        return _looked_up(shape, "body", s, np.arctan2(xyz[..., 1], xyz[..., 2]) / np.pi)
    xc, eta = shape.planform(xyz)
    s, t = np.arccos(1 - 2 * xc) / np.pi, (eta * shape.span - shape.wing_root) / (shape.span - shape.wing_root)
    above = normal[..., 2] >= 0
    out = np.empty(len(xc))
    for name, on in (("wing_upper", above), ("wing_lower", ~above)):
        out[on] = _looked_up(shape, name, s[on], t[on])
    return out


def _looked_up(shape: HalfModel, name: str, s: Array, t: Array) -> Array:
    from scipy.ndimage import map_coordinates

    table = _table(shape, name)
    at = np.stack([s, t]) * (np.array(table.shape)[:, None] - 1)
    return np.asarray(map_coordinates(table, at, order=1, mode="nearest"))


@lru_cache(maxsize=16)
def _table(shape: HalfModel, name: str) -> Array:
    """(S, T) curvatures of a patch over its parameters, kept off its ends."""
    patch = shape.patches()[name]
    h = 2e-3
    s, t = (a.ravel() for a in np.meshgrid(*(np.clip(np.linspace(0, 1, n), 2 * h, 1 - 2 * h) for n in TABLE),
                                           indexing="ij"))  # fmt: skip
    ds, dt = ((patch.point(s + a, t + b) - patch.point(s - a, t - b)) / (2 * h) for a, b in ((h, 0.0), (0.0, h)))
    ns, nt = ((patch.normal(s + a, t + b) - patch.normal(s - a, t - b)) / (2 * h) for a, b in ((h, 0.0), (0.0, h)))

    def dot(a: Array, b: Array) -> Array:
        return np.asarray(np.einsum("nk,nk->n", a, b))

    e, f, g = dot(ds, ds), dot(ds, dt), dot(dt, dt)
    mean = (g * dot(ds, ns) - f * (dot(ds, nt) + dot(dt, ns)) + e * dot(dt, nt)) / (e * g - f * f)
    return mean.reshape(TABLE)
