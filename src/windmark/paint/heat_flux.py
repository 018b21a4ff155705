"""Heat flux of many histories of the surface temperature, with its exact sigma and where it does not hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.paint.walls import Wall

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BLOCK = 1024
"""Histories worked on at a time."""
LATE = 0.2
"""Fourier number from which a wall is no longer semi-infinite: its back changes the flux by 2 exp(-1 / Fo), 1.3 %."""


@dataclass(frozen=True, eq=False)
class HeatFlux:
    """Heat flux into the wall.

    Parameters
    ----------
    flux : (H, F) W / m^2, positive into the wall; NaN from a history's first missing sample on
    noise_gain : (F,) sigma of the flux for a noise of 1 K of each sample
    noise_sigma : (H, F) or (1, F) standard deviation by the noise of the temperatures
    relative_sigma : of the wall, common to all
    fourier : (F,) Fourier number of the wall; 0 where it is not thought semi-infinite
    late : (F,) bool, samples at which the wall's back is felt
    """

    flux: Array
    noise_gain: Array
    noise_sigma: Array
    relative_sigma: float
    fourier: Array
    late: Mask

    @property
    def sigma(self) -> Array:
        """(H, F) standard deviation, the wall's included."""
        return np.hypot(self.noise_sigma, self.relative_sigma * np.abs(np.nan_to_num(self.flux)))


def heat_flux(
    temperature: ArrayLike,
    dt: float,
    wall: Wall,
    *,
    sigma: ArrayLike = 0.0,
    correlation: ArrayLike = (1.0,),
    initial: ArrayLike | None = None,
    initial_sigma: float = 0.0,
    curvature: ArrayLike | None = None,
) -> HeatFlux:
    """Heat flux from histories of the surface temperature.

    Parameters
    ----------
    temperature : (H, F) histories, evenly spaced by ``dt`` seconds, from before the heating on
    wall : what is below the surface
    sigma : (H,) or one number, noise of one sample
    correlation : (L,) of the noise between samples 0, 1, ... L - 1 apart, from 1; nothing further apart
    initial, initial_sigma : (H,) or one number, temperature of the whole wall before the first sample and its error;
        None: the first sample, with its noise
    curvature : (H,) or one number, sum of the surface's two curvatures (1 / m, positive where it is convex to the
        air): heat spreads over less area with depth. Of the first order, see `Wall.curved_admittance`; of a
        semi-infinite wall it takes conductivity * curvature / 2 * (T - T_initial) off the flux

    Returns
    -------
    HeatFlux

    Raises
    ------
    ValueError
        For a shape that is not (H, F), fewer than two samples, or a correlation that is none.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> wall = wm.Wall.semi_infinite(0.2, 1.6e6)  # a plastic
    >>> time = np.arange(50) * 0.1
    >>> rise = 2.0 * 1000.0 * np.sqrt(time / np.pi) / wall.layers[0].effusivity  # by 1 kW / m^2 from the start on
    >>> history = 300.0 + rise[None, :]
    >>> wm.heat_flux(history, 0.1, wall).flux[0, [10, 49]].round(-1).tolist()
    [1000.0, 1000.0]
    """
    t = np.asarray(temperature, dtype=float)
    if t.ndim != 2 or t.shape[1] < 2:
        raise ValueError(f"heat_flux: temperature must be (H, F) with F at least 2, got {t.shape}")
    noise, c = np.asarray(sigma, dtype=float), np.asarray(correlation, dtype=float)
    if not (0 < dt < np.inf and (noise >= 0).all() and initial_sigma >= 0):
        raise UsageError(f"heat_flux: dt must be above zero, sigmas at least 0, got {dt}")
    if c.ndim != 1 or c[:1].tolist() != [1.0] or (np.abs(c) > 1).any():
        raise UsageError("heat_flux: correlation must begin with 1 and stay between -1 and 1")
    count = t.shape[1]
    g = wall.step_weights(dt, count)
    curve = np.zeros(len(t)) if curvature is None else np.broadcast_to(np.asarray(curvature, float), (len(t),))
    lost = wall.step_weights(dt, count, curved=True) if curve.any() else g
    base = None if initial is None else np.broadcast_to(np.asarray(initial, dtype=float), (len(t),))
    flux = np.empty(t.shape)
    for k in range(0, len(t), BLOCK):
        part = slice(k, k + BLOCK)
        start = t[part, 0] if base is None else base[part]
        flux[part] = _convolved(t[part], start, g)
        if curve[part].any():
            flux[part] -= curve[part, None] * _convolved(t[part], start, lost)
    gain = _noise_gain(g, c, base is None)
    own = noise.reshape(-1, 1) * gain
    if base is not None and initial_sigma:
        # An initial temperature that is wrong by 1 K is a step of 1 K at the first sample.
        own = np.hypot(own, initial_sigma * np.abs(g))
    fourier = wall.fourier_number(dt * np.arange(count))
    return HeatFlux(flux, gain, own, wall.relative_sigma, fourier, fourier > LATE)


def _convolved(t: Array, start: Array, g: Array) -> Array:
    """(H, F) sum of the weights times the rises of temperature."""
    from scipy.fft import irfft, next_fast_len, rfft

    count = t.shape[1]
    rise = np.empty(t.shape)
    rise[:, 0] = t[:, 0] - start
    np.subtract(t[:, 1:], t[:, :-1], out=rise[:, 1:])
    bad = ~np.isfinite(rise)
    any_bad = bool(bad.any())
    if any_bad:
        rise[bad] = 0.0
    n = next_fast_len(2 * count - 1, real=True)
    out = irfft(rfft(rise, n, axis=1, overwrite_x=True) * rfft(g, n), n, axis=1, overwrite_x=True)[:, :count]
    if any_bad:
        out[np.maximum.accumulate(bad, axis=1)] = np.nan
    return np.asarray(out)


def _noise_gain(g: Array, correlation: Array, from_first: bool) -> Array:
    """(F,) sigma of the flux at each sample for a noise of 1 K, of the given correlation.

    The flux at sample n is the sum of w_nk T_k with w_nk = g_(n-k) - g_(n-k-1), so its variance is w C w^T exactly.
    Where the first sample is the initial temperature its own rise is none.
    """
    w = np.concatenate([g[:1], np.diff(g)])  # weights of T_n, T_(n-1), ...
    count = len(g)
    total = np.zeros(count)
    for lag, rho in enumerate(correlation[:count]):
        both = w[: count - lag] * w[lag:]
        total[lag:] += rho * (1 if lag == 0 else 2) * np.cumsum(both)
    if from_first:
        # The first sample's weight is then -g_(n-1) in the place of w_n = g_n - g_(n-1): less by g_n.
        total += g**2
        for lag, rho in enumerate(correlation[:count]):
            # Product of the change with every weight that is so far from the first sample: w_(n - lag).
            shifted = np.zeros(count)
            shifted[lag:] = w[: count - lag]
            own = w if lag == 0 else shifted
            total -= 2 * rho * g * own
    return np.sqrt(np.maximum(total, 0.0))
