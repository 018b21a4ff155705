"""In-situ calibration: what taps say of the paint, by an a-priori shape with free offset and slope, or a polynomial.

The taps' pressures are p = f(x; theta) with x the a-priori pressure (or the ratio) that the paint shows at the taps and
f a polynomial, offset and slope by default. Errors that all taps share with the nodes (temperature, calibration, wind
off) are modes of x: the fit takes up what of them looks like offset and slope, and `InSitu.applied` takes that part out
of the nodes' modes. Source: T. Liu and J. P. Sullivan, Pressure and Temperature Sensitive Paints (2005), ch. 4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError, g3
from windmark.paint.modes import NodeField
from windmark.paint.refusal import NotFitted
from windmark.paint.tap_fit import TapFit, fit_taps, leave_one_out

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FREE = ("both", "offset")
MOST_ORDER = 3
UNSURE = 0.5
"""A slope whose sigma is a larger part of it than this is not determined (its uncertainty, 2 sigma, is the slope)."""


@dataclass(frozen=True, eq=False)
class InSitu:
    """Pressure = sum over k of coefficients_k u^k, with u = (x - center) / scale of the M taps.

    Parameters
    ----------
    coefficients : (P,) of powers of u
    cov : (P, P) by what the taps themselves bring: their sigma, the noise of x, the scatter
    center, scale : of x, so that u is about -1 to 1 over the taps
    order, free : as asked for
    used : (M,) taps that count
    residuals : (M,) tap minus fit, also of taps that do not count; NaN for taps without reading
    blocked : taps that do not count, with the reason
    rms, loo_rms : of the residuals of the taps that count, and of each against the fit of the others
    scatter : standard deviation by which taps and paint differ beyond what their sigmas explain, larger by Student's
        factor where it comes from few taps; in ``cov``, and in every node's independent noise
    noise : root mean square of what the sigmas of taps and paint explain of their differences
    warnings : what is to be said of it, in words

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> taps = np.array([4e4, 5e4, 6e4, 7e4, 8e4, 9e4, 1e5])
    >>> paint = 0.95 * taps + 1500.0
    >>> paint[3] += 9000.0  # a blocked tap
    >>> fit = wm.in_situ(list("abcdefg"), taps, wm.NodeField.make(paint, 50.0, unit="Pa"), pressure_sigma=20.0)
    >>> fit.used.tolist(), dict(fit.blocked)
    ([True, True, True, False, True, True, True], {'d': '-9474 off, by 154 sigma'})
    """

    coefficients: Array
    cov: Array
    center: float
    scale: float
    order: int
    free: str
    used: Mask
    residuals: Array
    blocked: Mapping[str, str]
    rms: float
    loo_rms: float
    scatter: float
    x_range: tuple[float, float]
    unit: str = ""
    noise: float = np.nan
    warnings: tuple[str, ...] = ()
    _response: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    _tap_modes: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    _tap_names: tuple[str, ...] = field(default=(), repr=False)

    def __bool__(self) -> bool:
        return True

    def applied(self, x: NodeField) -> NodeField:
        """Calibrated pressure of nodes from their a-priori pressure (or ratio), with all modes.

        A mode of x moves a node by its own part, and by what it did to the fit at the taps. The fit's own errors are
        the modes ``in-situ:k``.
        """
        u = (x.value - self.center) / self.scale
        powers = u[:, None] ** np.arange(len(self.coefficients))
        slope = powers[:, :-1] @ (self.coefficients[1:] * np.arange(1, len(self.coefficients))) / self.scale
        value = powers @ self.coefficients
        names = tuple(dict.fromkeys((*x.names, *self._tap_names)))
        modes = np.zeros((len(x), len(names)))
        on = np.isfinite(value)
        by_taps = self._response @ self._tap_modes  # change of the coefficients for one sigma of each cause
        for k, name in enumerate(names):
            if name in x.names:
                modes[on, k] += (slope * x.modes[:, x.names.index(name)])[on]
            if name in self._tap_names:
                modes[on, k] += powers[on] @ by_taps[:, self._tap_names.index(name)]
        white = np.where(on, slope**2 * x.white + self.scatter**2, 0.0)
        out = NodeField(value, white, modes, names, self.unit)
        return out.with_modes("in-situ", np.where(on[:, None], powers, 0.0), self.cov)

    @property
    def moved(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """What the fit adds to an a-priori pressure, and its sigma: at ``center``, and to its slope (order 1).

        The sigma is of all that may part the two where taps and a-priori law are both right: the taps' own errors and
        every error of x, so that a fit which moves it by many of these contradicts one of them. NaN where the fit
        is no straight line, and for a slope that is kept; without meaning where x is a ratio.
        """
        if self.order != 1:
            return (np.nan, np.nan), (np.nan, np.nan)
        by_taps = self._response @ self._tap_modes
        sigma = np.sqrt(np.diagonal(self.cov + by_taps @ by_taps.T))
        slope = float(self.coefficients[1] / self.scale) - 1.0, float(sigma[1] / self.scale)
        return (float(self.coefficients[0] - self.center), float(sigma[0])), (
            slope if self.free == "both" else (np.nan, np.nan)
        )

    def outside(self, x: NodeField) -> Mask:
        """(N,) nodes beyond what the taps span by more than a tenth of it: the fit is extrapolated there."""
        low, high = self.x_range
        reach = 0.1 * (high - low)
        return np.asarray((x.value < low - reach) | (x.value > high + reach))


def in_situ(
    names: Sequence[str],
    pressure: ArrayLike,
    x: NodeField,
    *,
    pressure_sigma: ArrayLike,
    common_sigma: float = 0.0,
    order: int = 1,
    free: str = "both",
    unit: str = "Pa",
) -> InSitu | NotFitted:
    """Fit the paint to the taps.

    Parameters
    ----------
    names : (M,) of the taps
    pressure : (M,) readings, NaN where a tap gave none
    x : (M) a-priori pressure of the paint at the taps (or its ratio), with its noise and modes
    pressure_sigma : (M,) or one number, independent errors of the readings
    common_sigma : error that all readings share (reference side of the transducers): mode ``taps``
    order : 1: offset and slope; 2, 3: polynomial
    free : "both"; "offset" keeps the a-priori slope (order 1, x in the taps' unit)
    unit : of the pressures

    Returns
    -------
    InSitu; or NotFitted with too few taps (one more than unknowns, or two to test any), no spread of x, or a slope
    that is not above zero. Taps that disagree with all others (5 % chance that any good one does) are left out and
    named.

    Raises
    ------
    ValueError
        For arrays of different lengths, a sigma that is not above zero or not finite, or unknown options.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> taps = np.array([4e4, 5e4, 6e4, 7e4, 8e4])
    >>> paint = wm.NodeField.make(0.95 * taps + 1500.0, 50.0, unit="Pa")
    >>> fit = wm.in_situ([f"t{k}" for k in range(5)], taps, paint, pressure_sigma=20.0)
    >>> bool(fit), fit.used.tolist(), bool(abs(fit.residuals).max() < 1.0)
    (True, [True, True, True, True, True], True)
    >>> fit.applied(paint).value.round(0).tolist()
    [40000.0, 50000.0, 60000.0, 70000.0, 80000.0]
    """
    p, sigma = np.asarray(pressure, dtype=float), np.asarray(pressure_sigma, dtype=float)
    _check(names, p, x, sigma, common_sigma, order, free)
    sigma = np.broadcast_to(sigma, p.shape)
    unknowns = order + 1 if free == "both" else 1
    have = np.isfinite(p) & x.known & np.isfinite(x.variance)
    if have.sum() < unknowns + 1:
        return NotFitted(
            f"in-situ: {int(have.sum())} taps have a reading and a paint value; {unknowns} unknowns need at least "
            f"{unknowns + 1}",
            {"taps": int(have.sum())},
        )
    centre, scale = _span(x.value[have])
    if not scale > 0:
        return NotFitted("in-situ: the paint shows the same at all taps: nothing tells the slope")
    fit = fit_taps(p, sigma, x, have, centre, scale, order, free)
    trouble = _trouble(fit, x, centre, scale, free)
    if trouble:
        return NotFitted(f"in-situ: {trouble}", {"used": int(fit.used.sum())})
    return _result(names, fit, x, have, centre, scale, order, free, common_sigma, unit)


def _check(names: Sequence[str], p: Array, x: NodeField, sigma: Array, common: float, order: int, free: str) -> None:
    if p.ndim != 1 or len(names) != len(p) or len(x) != len(p) or sigma.shape not in ((), p.shape):
        raise ValueError(f"in_situ: names, pressure, x and sigma must be of one length, got {len(names)}, {p.shape}, "
                         f"{len(x)}, {sigma.shape}")  # fmt: skip
    if len(set(names)) < len(names):
        raise UsageError("in_situ: the names of the taps must differ")
    if not ((sigma > 0) & np.isfinite(sigma)).all() or not 0 <= common < np.inf:
        raise UsageError("in_situ: pressure_sigma must be finite and > 0, common_sigma finite and at least 0; leave a "
                         "tap out that says nothing, or make its reading NaN")  # fmt: skip
    if order not in range(1, MOST_ORDER + 1) or free not in FREE or (free == "offset" and order > 1):
        raise UsageError(f"in_situ: order must be 1 to {MOST_ORDER}, free one of {', '.join(FREE)} (offset: order 1), "
                         f"got {order} and {free!r}")  # fmt: skip


def _span(x: Array) -> tuple[float, float]:
    low, high = float(x.min()), float(x.max())
    tiny = 1e-9 * max(abs(low), abs(high))
    return 0.5 * (low + high), 0.5 * (high - low) if high - low > tiny else 0.0


def _trouble(fit: TapFit, x: NodeField, centre: float, scale: float, free: str) -> str:
    """Why the fit cannot be used, "" if it can."""
    if not np.isfinite(fit.cov).all():
        return "the taps that agree do not determine it: too few places along the pressure"
    if free == "offset":
        return ""
    u = np.linspace(*((x.value[fit.used].min() - centre) / scale, (x.value[fit.used].max() - centre) / scale), 33)
    k = np.arange(1, len(fit.coefficients))
    rows = np.concatenate([np.zeros((len(u), 1)), u[:, None] ** (k - 1) * k], axis=1)
    slope, sigma = rows @ fit.coefficients, np.sqrt(np.einsum("nk,kl,nl->n", rows, fit.cov, rows))
    mean, mean_sigma = float(slope.mean()), float(np.sqrt(rows.mean(axis=0) @ fit.cov @ rows.mean(axis=0)))
    if not mean > 0:
        return "the taps' pressures do not rise with what the paint shows: wrong taps, or their order exchanged"
    if mean_sigma > UNSURE * mean:
        return ("the taps' pressures do not spread enough for a slope (its sigma is "
                f"{g3(100 * mean_sigma / mean)} % of it); free = \"offset\" keeps the a-priori one")  # fmt: skip
    if not (slope > 0).all():
        return "the polynomial does not rise all the way between the taps: a lower order"
    if (sigma > UNSURE * mean).any() and len(fit.coefficients) > 2:
        return "the taps do not determine a polynomial of this order: a lower order"
    return ""


def _result(names: Sequence[str], fit: TapFit, x: NodeField, have: Mask, centre: float, scale: float, order: int,
            free: str, common: float, unit: str) -> InSitu:  # fmt: skip
    blocked = {names[k]: fit.reasons[k] for k in sorted(fit.reasons)}
    blocked |= {names[k]: "no reading, or no paint value there" for k in np.flatnonzero(~have).tolist()}
    loo = leave_one_out(fit)
    words = []
    if fit.scatter > 0:
        words.append(f"taps and paint differ by {g3(fit.scatter)} {unit} beyond their sigmas; all sigmas contain it")
    if blocked:
        words.append("taps that do not count: " + "; ".join(f"{k} ({v})" for k, v in blocked.items()))
    seen = x.value[fit.used]
    names_, modes = x.names, x.modes[fit.used] * -fit.slope[:, None]
    if common > 0:
        # All readings higher by one sigma: an error of its own, which the nodes get through the fit.
        names_, modes = (*names_, "taps"), np.column_stack([modes, np.full(len(seen), common)])
    return InSitu(
        fit.coefficients, fit.cov, centre, scale, order, free, fit.used, fit.residuals, blocked,
        float(np.sqrt(np.mean(fit.residuals[fit.used] ** 2))), float(np.sqrt(np.mean(loo**2))), fit.scatter,
        (float(seen.min()), float(seen.max())), unit, fit.noise, tuple(words), fit.response, modes, names_,
    )  # fmt: skip
