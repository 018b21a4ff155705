"""Stern-Volmer with temperature: I_ref / I = sum over k of A_k(T) (p / p_ref)^k, and its inverse.

Source: T. Liu and J. P. Sullivan, Pressure and Temperature Sensitive Paints (2005), eqs. 3.9 and 5.4. A_k(T) is a
polynomial in T - T_ref. In the tunnel the ratio is not that of the cell: the wind-off picture was taken at p_off and
T_off, so I_off / I_on = f(p_on, T_on) / f(p_off, T_off), in which a common factor of the calibration drops out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.geometry.described import described

Array = NDArray[np.float64]
Flags = NDArray[np.uint8]

PRESSURE_OUTSIDE, TEMPERATURE_OUTSIDE, NO_RATIO, NO_TEMPERATURE, NO_REFERENCE = 1, 2, 4, 8, 16
FLAGS = {
    PRESSURE_OUTSIDE: "the pressure lies outside the calibrated range",
    TEMPERATURE_OUTSIDE: "the temperature lies outside the calibrated range",
    NO_RATIO: "there is no ratio, or none above zero",
    NO_TEMPERATURE: "there is no temperature",
    NO_REFERENCE: "there is no wind-off pressure or temperature",
}
"""Bits of a node's flag in `Inversion` and `PressureMap`, in words."""
STEPS = 65
"""Places along pressure and temperature at which the slope is looked at."""
_ITERATIONS = 60


@described(lambda p: {
    "order": p.order, "pressure": f"{p.p_range[0]:g} to {p.p_range[1]:g} {p.pressure_unit}",
    "temperature": f"{p.t_range[0]:g} to {p.t_range[1]:g} {p.temperature_unit}",
    "covariance": "no" if p.cov is None else "yes",
})  # fmt: skip
@dataclass(frozen=True, eq=False)
class SternVolmer:
    """A calibrated paint.

    Parameters
    ----------
    coefficients : (K + 1, J + 1) a_kj of A_k(T) = sum over j of a_kj (T - T_ref)^j
    p_ref, t_ref : reference pressure and temperature; p_ref > 0
    p_range, t_range : lowest and highest calibrated pressure and temperature
    cov : ((K + 1)(J + 1),) squared, of the coefficients row by row (k slow, j fast); None: taken as exact
    pressure_unit, temperature_unit : of the above and of everything that goes in and comes out

    Raises
    ------
    ValueError
        For ranges or shapes that are none, or where I_ref / I is not positive and rising with pressure everywhere in
        the calibrated range: such a law has no inverse.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> paint = wm.SternVolmer(np.array([[0.2, 0.0], [0.8, 0.005]]), 1e5, 300.0, (2e4, 1.2e5), (290.0, 320.0))
    >>> paint.ratio([1e5, 5e4], 300.0).round(6).tolist()  # I_ref / I
    [1.0, 0.6]
    >>> by_pressure, by_temperature, _ = paint.slopes(1e5, 300.0)
    >>> round(float(by_temperature / by_pressure), 3)  # pascals that one kelvin is mistaken for
    625.0
    """

    coefficients: Array
    p_ref: float
    t_ref: float
    p_range: tuple[float, float]
    t_range: tuple[float, float]
    cov: Array | None = None
    pressure_unit: str = "Pa"
    temperature_unit: str = "K"

    def __post_init__(self) -> None:
        a = np.asarray(self.coefficients, dtype=float)
        if a.ndim != 2 or a.shape[0] < 2 or not np.isfinite(a).all():
            raise ValueError(f"SternVolmer: coefficients must be finite (K + 1, J + 1) with K >= 1, got {a.shape}")
        object.__setattr__(self, "coefficients", a)
        if self.cov is not None and np.shape(self.cov) != (a.size, a.size):
            raise ValueError(f"SternVolmer: cov must be ({a.size}, {a.size}), got {np.shape(self.cov)}")
        if not (self.p_ref > 0 and np.isfinite(self.t_ref)):
            raise UsageError(f"SternVolmer: p_ref must be > 0 and t_ref finite, got {self.p_ref} and {self.t_ref}")
        (p0, p1), (t0, t1) = self.p_range, self.t_range
        if not (0 <= p0 < p1 < np.inf and -np.inf < t0 <= t1 < np.inf):
            raise UsageError(f"SternVolmer: p_range and t_range must rise, p >= 0, got {self.p_range}, {self.t_range}")
        trouble = self.not_invertible()
        if trouble:
            raise UsageError(f"SternVolmer: {trouble}")

    @property
    def order(self) -> tuple[int, int]:
        """Highest powers of pressure and of temperature."""
        return self.coefficients.shape[0] - 1, self.coefficients.shape[1] - 1

    def not_invertible(self) -> str:
        """Why the law has no inverse in its range, "" where it has one."""
        p, t = (g.ravel() for g in np.meshgrid(np.linspace(*self.p_range, STEPS), np.linspace(*self.t_range, STEPS)))
        ratio, slope = self.ratio(p, t), self.slopes(p, t)[0]
        for what, bad in (("is not above zero", ~(ratio > 0)), ("does not rise with pressure", ~(slope > 0))):
            if bad.any():
                k = int(np.flatnonzero(bad)[0])
                return (f"I_ref/I {what} at p = {p[k]:.6g} {self.pressure_unit}, T = {t[k]:.6g} "
                        f"{self.temperature_unit}, inside the calibrated range")  # fmt: skip
        return ""

    def ratio(self, pressure: ArrayLike, temperature: ArrayLike) -> Array:
        """I_ref / I at pressures and temperatures (N,)."""
        level = self._levels(temperature)
        x = np.asarray(pressure, dtype=float) / self.p_ref
        out = level[-1]
        for a in level[-2::-1]:
            out = out * x + a
        return np.asarray(out)

    def slopes(self, pressure: ArrayLike, temperature: ArrayLike) -> tuple[Array, Array, Array]:
        """Derivatives of `ratio` by pressure (N,), temperature (N,) and coefficients (N, (K + 1)(J + 1))."""
        return law_slopes(self.coefficients, self.p_ref, self.t_ref, pressure, temperature)

    def invert(
        self, ratio: ArrayLike, temperature: ArrayLike, *, p_off: ArrayLike | None = None,
        t_off: ArrayLike | None = None,
    ) -> Inversion:  # fmt: skip
        """Pressure of nodes.

        Parameters
        ----------
        ratio : (N,) I_off / I_on
        temperature : (N,) or one number, wind on
        p_off, t_off : (N,) or one number, of the wind-off picture; None: p_ref and t_ref

        Returns
        -------
        Inversion. Beyond the calibrated pressures the law goes on straight, with its slope at the end of the range,
        and the node is flagged; a temperature outside is flagged, too. What is missing gives NaN.
        """
        r, t, p0, t0 = (
            np.asarray(a, dtype=float)
            for a in np.broadcast_arrays(np.atleast_1d(np.asarray(ratio, dtype=float)), temperature,
                                         self.p_ref if p_off is None else p_off, self.t_ref if t_off is None else t_off)
        )  # fmt: skip
        flags = np.zeros(r.shape, np.uint8)
        flags[~(np.isfinite(r) & (r > 0))] |= NO_RATIO
        flags[~np.isfinite(t)] |= NO_TEMPERATURE
        off = self.ratio(p0, t0)
        flags[~(np.isfinite(off) & (off > 0) & (p0 > 0))] |= NO_REFERENCE
        good = flags == 0
        flags[good & ((t < self.t_range[0]) | (t > self.t_range[1]))] |= TEMPERATURE_OUTSIDE
        flags[good & ((t0 < self.t_range[0]) | (t0 > self.t_range[1]))] |= TEMPERATURE_OUTSIDE
        flags[good & ((p0 < self.p_range[0]) | (p0 > self.p_range[1]))] |= PRESSURE_OUTSIDE
        p, end, outside = self._solve(np.where(good, r * off, np.nan), np.where(good, t, np.nan))
        flags[outside & good] |= PRESSURE_OUTSIDE
        flags[good & ~np.isfinite(p)] |= TEMPERATURE_OUTSIDE
        return self._answer(p, end, r, t, p0, t0, off, flags)

    def _levels(self, temperature: ArrayLike) -> list[Array]:
        """A_0(T) to A_K(T)."""
        d = np.asarray(temperature, dtype=float) - self.t_ref
        return [np.asarray(np.polynomial.polynomial.polyval(d, row)) for row in self.coefficients]

    def _solve(self, cell: Array, t: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Pressures (N,) at which the law gives the ratio ``cell``; the place in the range whose slope holds there."""
        low, high = (np.full(cell.shape, p) for p in self.p_range)
        at_low, at_high = self.ratio(low, t), self.ratio(high, t)
        below, above = cell < at_low, cell > at_high
        p = low + (high - low) * np.clip((cell - at_low) / (at_high - at_low), 0.0, 1.0)
        for _ in range(_ITERATIONS):
            off = self.ratio(p, t) - cell
            low, high = np.where(off <= 0, p, low), np.where(off >= 0, p, high)
            with np.errstate(divide="ignore", invalid="ignore"):
                new = p - off / self._rise(p, t)
            new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
            done = not (np.abs(new - p) > 1e-13 * self.p_range[1]).any()
            p = new
            if done:
                break
        outside = below | above
        end = np.where(below, self.p_range[0], np.where(above, self.p_range[1], p))
        slope = self._rise(end, t)
        with np.errstate(divide="ignore", invalid="ignore"):
            straight = np.where(slope > 0, end + (cell - self.ratio(end, t)) / slope, np.nan)
        return np.where(np.isnan(cell + t), np.nan, np.where(outside, straight, p)), end, outside

    def _rise(self, p: Array, t: Array) -> Array:
        """Slope of the law by pressure."""
        level = self._levels(t)
        x = p / self.p_ref
        out = np.zeros(np.shape(x))
        for k in range(len(level) - 1, 0, -1):
            out = out * x + k * level[k]
        return np.asarray(out / self.p_ref)

    def _answer(self, p: Array, end: Array, r: Array, t: Array, p0: Array, t0: Array, off: Array, flags: Flags
                ) -> Inversion:  # fmt: skip
        """With the derivatives of p by everything: of the law's equation f(p, T; a) = r f(p_off, T_off; a).

        Beyond the range the law is f(end) + f'(end) (p - end), and it is this that is differentiated.
        """
        by_p, by_t, by_a = self.slopes(end, t)
        beyond = np.where(np.isfinite(p), p - end, 0.0)
        if beyond.any():
            step = 1e-4 * (self.p_range[1] - self.p_range[0])
            inside = np.where(beyond > 0, end - step, end)
            _, t_low, a_low = self.slopes(inside, t)
            _, t_high, a_high = self.slopes(inside + step, t)
            by_t = by_t + (t_high - t_low) / step * beyond
            by_a = by_a + (a_high - a_low) / step * beyond[:, None]
        off_p, off_t, off_a = self.slopes(p0, t0)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = np.where(np.isfinite(p), 1 / by_p, np.nan)
            return Inversion(
                p, off * inverse, -by_t * inverse, (r[:, None] * off_a - by_a) * inverse[:, None], r * off_p * inverse,
                r * off_t * inverse, flags,
            )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Inversion:
    """Pressures of N nodes and what they depend on.

    Parameters
    ----------
    pressure : (N,) NaN where it cannot be told
    by_ratio, by_temperature : (N,) derivatives by the ratio and by the temperature, wind on
    by_coefficients : (N, (K + 1)(J + 1))
    by_p_off, by_t_off : (N,) by pressure and temperature of the wind-off picture
    flags : (N,) uint8, sums of `FLAGS`
    """

    pressure: Array
    by_ratio: Array
    by_temperature: Array
    by_coefficients: Array
    by_p_off: Array
    by_t_off: Array
    flags: Flags


def law_slopes(a: Array, p_ref: float, t_ref: float, pressure: ArrayLike, temperature: ArrayLike
               ) -> tuple[Array, Array, Array]:  # fmt: skip
    """`SternVolmer.slopes` of coefficients (K + 1, J + 1) that need not have an inverse."""
    p, t = np.broadcast_arrays(np.asarray(pressure, dtype=float), np.asarray(temperature, dtype=float))
    x, d = p / p_ref, t - t_ref
    px, td = x[..., None] ** np.arange(a.shape[0]), d[..., None] ** np.arange(a.shape[1])
    dpx = np.concatenate([np.zeros((*x.shape, 1)), px[..., :-1] * np.arange(1, a.shape[0])], axis=-1) / p_ref
    dtd = np.concatenate([np.zeros((*x.shape, 1)), td[..., :-1] * np.arange(1, a.shape[1])], axis=-1)
    by_p = np.asarray(((dpx @ a) * td).sum(axis=-1))
    by_t = np.asarray(((px @ a) * dtd).sum(axis=-1))
    return by_p, by_t, (px[..., :, None] * td[..., None, :]).reshape(*x.shape, a.size)
