"""Temperature-sensitive paint: ln(I_ref / I) as a polynomial of the temperature, calibrated and inverted.

Source: T. Liu and J. P. Sullivan, Pressure and Temperature Sensitive Paints (2005), eq. 2.28 (Arrhenius) and its
polynomial form. As with pressure, ratios of the tunnel are against a wind-off picture at t_off, and a common factor
drops out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.paint.modes import NodeField, combined
from windmark.paint.refusal import NotFitted
from windmark.paint.stern_volmer import NO_RATIO, NO_REFERENCE, TEMPERATURE_OUTSIDE

Array = NDArray[np.float64]
Flags = NDArray[np.uint8]

MOST_ORDER = 4
POINTS = 257


@dataclass(frozen=True, eq=False)
class TemperaturePaint:
    """ln(I_ref / I) = sum over k of c_k (T - t_ref)^k.

    Parameters
    ----------
    coefficients : (K + 1,)
    t_ref : reference temperature
    t_range : calibrated range, over which the law rises
    cov : (K + 1, K + 1); None: exact
    rms, cv_rms : of the calibration's residuals, and of each row against the others; NaN where not calibrated here
    temperature_unit : of all of them
    """

    coefficients: Array
    t_ref: float
    t_range: tuple[float, float]
    cov: Array | None = None
    rms: float = float("nan")
    cv_rms: float = float("nan")
    temperature_unit: str = "K"

    def __post_init__(self) -> None:
        if np.ndim(self.coefficients) != 1 or len(self.coefficients) < 2 or not self.t_range[0] < self.t_range[1]:
            raise UsageError("TemperaturePaint: coefficients must be (K + 1,) with K at least 1, t_range must rise")
        if not (self._slope(np.linspace(*self.t_range, POINTS)) > 0).all():
            raise UsageError("TemperaturePaint: I_ref/I does not rise with temperature all over the calibrated range")

    def log_ratio(self, temperature: ArrayLike) -> Array:
        """ln(I_ref / I) at temperatures."""
        off = np.asarray(temperature, dtype=float) - self.t_ref
        return np.asarray(np.polynomial.polynomial.polyval(off, self.coefficients))

    def _slope(self, t: Array) -> Array:
        return np.asarray(np.polynomial.polynomial.polyval(
            t - self.t_ref, self.coefficients[1:] * np.arange(1, len(self.coefficients))))  # fmt: skip

    def temperature_map(
        self, ratio: NodeField, *, t_off: float, t_off_sigma: float = 0.0, cause: str = "temperature paint"
    ) -> tuple[NodeField, Flags]:
        """Temperature of nodes from I_off / I, and their flags (`stern_volmer.FLAGS`).

        Beyond the calibrated range the law goes on straight, flagged. The calibration's errors are the modes
        ``cause:k``, that of t_off is the mode ``wind-off temperature``.
        """
        flags = np.zeros(len(ratio), np.uint8)
        good = ratio.value > 0
        flags[~good] |= NO_RATIO
        if not np.isfinite(t_off):
            flags |= np.uint8(NO_REFERENCE)
        if not self.t_range[0] <= t_off <= self.t_range[1]:
            flags[good] |= TEMPERATURE_OUTSIDE
        log = np.log(np.where(good, ratio.value, np.nan)) + self.log_ratio(t_off)
        t = self._inverse(log)
        flags[good & ((t < self.t_range[0]) | (t > self.t_range[1]))] |= TEMPERATURE_OUTSIDE
        end = np.clip(t, *self.t_range)
        slope = self._slope(end)
        out = combined(t, [(ratio, np.where(good, 1 / np.where(good, ratio.value, 1.0) / slope, 0.0))],
                       unit=self.temperature_unit)  # fmt: skip
        if t_off_sigma:
            by_off = float(self._slope(np.array([t_off]))[0]) * t_off_sigma / slope
            out = out.with_mode("wind-off temperature", np.where(np.isfinite(t), by_off, 0.0))
        if self.cov is not None:
            k = np.arange(len(self.coefficients))
            powers = (end - self.t_ref)[:, None] ** k
            bent = k * (end - self.t_ref)[:, None] ** np.maximum(k - 1, 0)
            by = ((t_off - self.t_ref) ** k - powers - bent * (t - end)[:, None]) / slope[:, None]
            out = out.with_modes(cause, np.where(np.isfinite(by), by, 0.0), self.cov)
        return out, flags

    def _inverse(self, log: Array) -> Array:
        """Temperatures at which the law gives ``log``: Newton from a table, straight beyond the range."""
        grid = np.linspace(*self.t_range, POINTS)
        at = self.log_ratio(grid)
        t = np.interp(log, at, grid)
        for _ in range(4):
            t = np.clip(t - (self.log_ratio(t) - log) / self._slope(t), *self.t_range)
        beyond = np.where(log < at[0], log - at[0], np.where(log > at[-1], log - at[-1], 0.0))
        return np.asarray(t + beyond / self._slope(t))


def fit_temperature_paint(
    temperature: ArrayLike,
    ratio: ArrayLike,
    *,
    t_ref: float,
    ratio_sigma: ArrayLike | None = None,
    temperature_sigma: float = 0.0,
    order: int | None = None,
    temperature_unit: str = "K",
) -> TemperaturePaint | NotFitted:
    """Calibrate a temperature paint from M cell measurements, see `fit_paint`.

    Parameters
    ----------
    temperature, ratio : (M,) I_ref / I there
    ratio_sigma : (M,) or one number; None: from the residuals
    order : 1 to 4; None: the lowest within one standard error of the best in cross-validation

    Returns
    -------
    TemperaturePaint; or NotFitted with too few temperatures, or where no order rises all over the range.
    """
    t, r = np.asarray(temperature, dtype=float), np.asarray(ratio, dtype=float)
    if t.ndim != 1 or t.shape != r.shape:
        raise ValueError(f"fit_temperature_paint: temperature and ratio must be (M,), got {t.shape} and {r.shape}")
    if not (np.isfinite(t).all() and (r > 0).all() and np.isfinite(r).all() and np.isfinite(t_ref)):
        raise UsageError("fit_temperature_paint: temperatures must be finite, ratios above zero")
    if order is not None and order not in range(1, MOST_ORDER + 1):
        raise UsageError(f"fit_temperature_paint: order must be 1 to {MOST_ORDER}, got {order}")
    span = float(np.ptp(t)) if len(t) else 0.0
    levels = 1 + int((np.diff(np.sort(t)) > 0.01 * span).sum()) if span > 0 else 1
    found: dict[int, tuple[TemperaturePaint, Array]] = {}
    why = ""
    for k in [order] if order is not None else range(1, MOST_ORDER + 1):
        if levels < k + 1 or len(t) < k + 2:
            why = why or (f"order {k} needs {k + 1} different temperatures and {k + 2} rows, there are {levels} and "
                          f"{len(t)}")  # fmt: skip
            continue
        made = _fitted(t, np.log(r), r, t_ref, ratio_sigma, temperature_sigma, k, temperature_unit)
        if isinstance(made, str):
            why = why or made
        else:
            found[k] = made
    if not found:
        return NotFitted(f"fit_temperature_paint: {why}")
    best = min(found, key=lambda k: float(np.mean(found[k][1] ** 2)))
    square = found[best][1] ** 2
    limit = float(square.mean() + square.std() / np.sqrt(len(square)))
    return found[min(k for k in found if float(np.mean(found[k][1] ** 2)) <= limit)][0]


def _fitted(t: Array, y: Array, r: Array, t_ref: float, sigma: ArrayLike | None, t_sigma: float, order: int, unit: str
            ) -> tuple[TemperaturePaint, Array] | str:  # fmt: skip
    """The law of one order and its residuals against the fit without each row, or why there is none."""
    half = 0.5 * float(np.ptp(t))
    k = np.arange(order + 1)
    design = ((t - t_ref) / half)[:, None] ** k
    weight = np.ones(len(t))
    for _ in range(4):
        left, values, right = np.linalg.svd(design * weight[:, None], full_matrices=False)
        inverse = right.T / values
        c = inverse @ (left.T @ (weight * y))
        slope = (design[:, :-1] * k[1:]) @ c[1:] / half
        known = 0.0 if sigma is None else np.asarray(sigma, dtype=float) / r
        variance = np.broadcast_to(known**2 + (slope * t_sigma) ** 2, t.shape)
        weight = 1 / np.sqrt(variance) if (variance > 0).all() else np.ones(len(t))
    residual = y - design @ c
    squares, dof = float(((weight * residual) ** 2).sum()), len(t) - order - 1
    factor = max(squares / dof, 1.0) if sigma is not None else squares / dof
    scale = half ** -k.astype(float)
    press = residual / np.maximum(1 - np.einsum("nk,nk->n", left, left), 1e-12)
    try:
        spread = inverse @ inverse.T * np.outer(scale, scale) * factor
        rms = [float(np.sqrt(np.mean(a**2))) for a in (residual, press)]
        law = TemperaturePaint(c * scale, t_ref, (float(t.min()), float(t.max())), spread, rms[0], rms[1], unit)
    except UsageError as error:
        return str(error).removeprefix("TemperaturePaint: ")
    return law, press
