"""Light: what the paint gives back at each surface point, as a plain function of the point.

The image intensity is luminescence times lamps. Luminescence is the coating's level (uneven, and
grained where asked) divided by the Stern-Volmer term where a flow gives a pressure. Everything is
smooth, so the truth at a node, a pixel or any surface point is `Paint.intensity`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.synth.wing import HalfModel

Array = NDArray[np.float64]


class Flow(Protocol):
    """A wind: gives the pressure on the surface."""

    def pressure_ratio(self, xyz: Array, normal: Array, volume: str) -> Array:
        """Pressure over its wind-off value at rest points (N, 3) with normals (N, 3): (N,)."""
        ...


@dataclass(frozen=True)
class Paint:
    """Coating and lamps.

    Parameters
    ----------
    levels : luminescence of each volume under unit light
    sensitive : volumes whose coating answers to pressure
    lamps : (L, 4) position and power; light = power cos(angle) / distance^2. No lamp: unit light
        everywhere, whatever the normal
    waves : (W, 5) unevenness of the coating: wave vector, phase, amplitude
    grain : (n, n, n) values of the paint's grain on a periodic lattice, or None
    grain_size, grain_amplitude : lattice step in length units, relative amplitude
    stern_volmer : share A of I_ref / I = A + (1 - A) p / p_ref
    """

    levels: Mapping[str, float] = field(default_factory=dict)
    sensitive: tuple[str, ...] = ("wing", "body")
    lamps: Array = field(default_factory=lambda: np.zeros((0, 4)))
    waves: Array = field(default_factory=lambda: np.zeros((0, 5)))
    grain: Array | None = None
    grain_size: float = 3.0
    grain_amplitude: float = 0.0
    stern_volmer: float = 0.2

    @staticmethod
    def random(
        rng: np.random.Generator,
        levels: Mapping[str, float],
        lamps: ArrayLike,
        *,
        unevenness: float = 0.03,
        grain: float = 0.01,
        wavelength: tuple[float, float] = (120.0, 400.0),
        grain_size: float = 3.0,
    ) -> Paint:
        """A coating sprayed by hand: four waves of the given total amplitude, and a grain."""
        count = 4
        k = rng.standard_normal((count, 3))
        k *= 2 * np.pi / (rng.uniform(*wavelength, count) * np.linalg.norm(k, axis=1))[:, None]
        phase = rng.uniform(0, 2 * np.pi, count)
        waves = np.concatenate([k, phase[:, None], np.full((count, 1), unevenness / np.sqrt(count))], axis=1)
        table = rng.standard_normal((32, 32, 32)) if grain > 0 else None
        return Paint(levels, lamps=np.array(lamps, dtype=float).reshape(-1, 4), waves=waves, grain=table,
                     grain_size=grain_size, grain_amplitude=grain)  # fmt: skip

    def intensity(
        self,
        xyz: ArrayLike,
        normal: ArrayLike,
        volume: str,
        *,
        rest_xyz: ArrayLike | None = None,
        rest_normal: ArrayLike | None = None,
        flow: Flow | None = None,
    ) -> Array:
        """Noise-free intensity of the surface without markers.

        Parameters
        ----------
        xyz, normal : (N, 3) points and unit outward normals where they are now (the lamps see these)
        volume : the volume they all belong to
        rest_xyz, rest_normal : the same before the model moved (the paint's pattern and the pressure
            are fixed to these); as xyz and normal when not given
        flow : the wind, None for wind off

        Returns
        -------
        (N,) relative intensity, 1 at unit level, light and pressure
        """
        p, n = np.asarray(xyz, dtype=float), np.asarray(normal, dtype=float)
        p0 = p if rest_xyz is None else np.asarray(rest_xyz, dtype=float)
        n0 = n if rest_normal is None else np.asarray(rest_normal, dtype=float)
        return self.shine(p, n, p0, n0, volume, flow)

    def shine(self, p: Array, n: Array, p0: Array, n0: Array, volume: str, flow: Flow | None) -> Array:
        """`intensity` of points ``p`` with the normals ``n``, which were ``p0`` and ``n0`` before the model moved."""
        out = self.light(p, n) * self.coating(p0, volume)
        if flow is not None and volume in self.sensitive:
            a = self.stern_volmer
            out /= a + (1 - a) * flow.pressure_ratio(p0, n0, volume)
        return out

    def light(self, xyz: Array, normal: Array) -> Array:
        """(N,) light that falls on the surface: lamps with inverse square and cosine, no shadows."""
        if not len(self.lamps):
            return np.ones(len(xyz))
        out = np.zeros(len(xyz))
        for *position, power in self.lamps:
            d = np.array(position) - xyz
            square = np.einsum("nk,nk->n", d, d)
            out += power * np.maximum(np.einsum("nk,nk->n", d, normal), 0) / (square * np.sqrt(square))
        return out

    def coating(self, rest_xyz: Array, volume: str) -> Array:
        """(N,) luminescence under unit light and reference pressure."""
        out = np.ones(len(rest_xyz))
        if len(self.waves):
            out += np.cos(rest_xyz @ self.waves[:, :3].T + self.waves[:, 3]) @ self.waves[:, 4]
        if self.grain is not None and self.grain_amplitude:
            from windmark.synth._kernels import lattice_noise

            out += self.grain_amplitude * lattice_noise(np.ascontiguousarray(rest_xyz), self.grain, 1 / self.grain_size)
        return out * self.levels.get(volume, 1.0)


@dataclass(frozen=True)
class TransonicFlow:
    """A pressure field that looks like a transonic wing: suction peak, plateau, shock, recovery.

    It is a drawing of a flow, not a solution of one; p / p_ref = 1 + gamma M^2 Cp / 2, p_ref being
    the wind-off pressure and taken equal to the static pressure of the stream.
    """

    shape: HalfModel = field(default_factory=HalfModel)
    mach: float = 0.8
    shock_width: float = 0.02

    def pressure_ratio(self, xyz: Array, normal: Array, volume: str) -> Array:
        """See `Flow`. Walls feel nothing."""
        if volume == "wing":
            cp = self.wing_cp(xyz, normal)
        elif volume == "body":
            cp = self.body_cp(xyz)
        else:
            return np.ones(len(xyz))
        return 1 + 0.7 * self.mach**2 * cp

    def wing_cp(self, xyz: Array, normal: Array) -> Array:
        """(N,) pressure coefficient; the two surfaces are blended round the leading edge."""
        xc, eta = self.shape.planform(xyz)
        stagnation = np.exp(-xc / 0.012)
        shock = 0.63 - 0.2 * eta
        plateau = -0.85 * (1 - 0.35 * eta**4) - 0.35 * np.exp(-((xc / 0.07) ** 2))
        recovery = -0.3 + 0.5 * (xc - shock) / (1 - shock)
        after = 0.5 * (1 + np.tanh((xc - shock) / self.shock_width))
        upper = 0.9 * stagnation + (1 - stagnation) * ((1 - after) * plateau + after * recovery)
        lower = 0.9 * stagnation + (1 - stagnation) * (0.2 * xc - 0.25 * np.sin(np.pi * xc))
        share = 0.5 * (1 + np.tanh(6 * normal[..., 2]))
        return share * upper + (1 - share) * lower

    def body_cp(self, xyz: Array) -> Array:
        """(N,) stagnation at the nose, suction on its shoulder and beside the wing."""
        s = self.shape
        nose = (xyz[..., 0] - s.body_nose) / s.ogive_nose
        middle = (xyz[..., 0] - 0.5 * s.root_chord) / s.root_chord
        return (
            0.6 * np.exp(-nose / 0.25)
            - 0.18 * np.exp(-(((nose - 0.9) / 0.35) ** 2))
            - 0.22 * np.exp(-(middle**2) / 0.2)
        )
