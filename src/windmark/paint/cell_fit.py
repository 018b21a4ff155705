"""A-priori calibration: Stern-Volmer fitted to a table of cell measurements, its order by cross-validation.

Where the order is not given, the law is the mean of all orders that the table leaves possible, by Akaike's weights, and
its covariance holds what they differ by (Buckland, Burnham and Augustin, Biometrics 53, 1997): the covariance of one
order that was chosen by the same table is too small (90 % of its 95 % intervals held).

Least squares in scaled powers (p / p_ref, and T between -1 and 1), each row weighted by the variance that its ratio has
by its own sigma and by those of pressure and temperature through the slopes of the law (York, Can. J. Phys. 44, 1966).
What the law cannot follow beyond the stated sigmas, or all of it where none is stated, scales the covariance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError, g3
from windmark.geometry.described import described
from windmark.paint.own_reference import own_reference
from windmark.paint.refusal import NotFitted
from windmark.paint.stern_volmer import SternVolmer, law_slopes

Array = NDArray[np.float64]
Order = tuple[int, int]

MOST_P, MOST_T = 4, 3
"""Highest powers of pressure and temperature that are tried."""
LITTLE = 0.01
"""Orders of less than this part of the likeliest one's weight do not count."""
RANK = 1e-10
"""Smallest singular value of the scaled equations, relative to the largest, that is more than rounding."""
_ROUNDS = 6


@described(lambda f: {
    "order": f"{f.order[0]} in pressure and {f.order[1]} in temperature", "measurements": len(f.residuals),
    "rms": g3(f.rms), "cross-validated": g3(f.cv_rms), "warnings": "; ".join(f.warnings) or "none",
})  # fmt: skip
@dataclass(frozen=True, eq=False)
class PaintFit:
    """A calibration of a paint and how good it is.

    Parameters
    ----------
    law : the paint, with covariance
    order : highest powers of pressure and temperature that cross-validation chooses; the law has more of them where
        higher orders are possible, too
    residuals : (M,) measured less fitted I_ref / I
    rms, cv_rms : of the residuals, and of each row against the fit of all others
    sigma0 : residuals in units of their stated sigmas (root mean square, less what the fit takes up); NaN where no
        sigma was stated
    orders : cross-validated RMS of every order that was tried, or why it cannot be had
    warnings : what is to be said of it, in words

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> p, t = (v.ravel() for v in np.meshgrid(np.linspace(2e4, 1.2e5, 6), [290.0, 300.0, 310.0]))
    >>> ratio = 0.2 + 0.8 * p / 1e5 + 0.005 * (t - 300.0)
    >>> fit = wm.fit_paint(p, t, ratio, p_ref=1e5, t_ref=300.0, ratio_sigma=0.001, order=(1, 1))
    >>> (fit.law.coefficients.round(6) + 0.0).tolist()
    [[0.2, 0.005], [0.8, 0.0]]
    >>> bool(fit), fit.rms < 1e-9
    (True, True)
    """

    law: SternVolmer
    order: Order
    residuals: Array
    rms: float
    cv_rms: float
    sigma0: float
    orders: Mapping[Order, float | str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return True


@dataclass(frozen=True, eq=False)
class _Table:
    p: Array
    t: Array
    ratio: Array
    variance: Array
    p_var: Array
    t_var: Array
    p_ref: float
    t_ref: float
    stated: bool
    units: tuple[str, str]


@dataclass(frozen=True, eq=False)
class _Candidate:
    coefficients: Array
    cov: Array
    residuals: Array
    press: Array
    squares: float
    dof: int


def fit_paint(
    pressure: ArrayLike,
    temperature: ArrayLike,
    ratio: ArrayLike,
    *,
    p_ref: float,
    t_ref: float,
    ratio_sigma: ArrayLike | None = None,
    pressure_sigma: ArrayLike = 0.0,
    temperature_sigma: ArrayLike = 0.0,
    order: Order | None = None,
    pressure_unit: str = "Pa",
    temperature_unit: str = "K",
) -> PaintFit | NotFitted:
    """Calibrate a paint from measurements in a cell.

    Parameters
    ----------
    pressure, temperature, ratio : (M,) of the cell, and I_ref / I there. A factor common to all ratios does no harm
    p_ref, t_ref : at which I_ref was taken; the law's powers are of p / p_ref and T - t_ref
    ratio_sigma : (M,) or one number; None: not known, and taken from the residuals
    pressure_sigma, temperature_sigma : (M,) or one number
    order : highest powers of pressure (1 to 4) and temperature (0 to 3), of the whole law. None: the mean of what is
        possible; `PaintFit.order` is the lowest one whose cross-validated RMS is within one standard error of the best
        (Breiman et al., 1984, section 3.4.3)

    Returns
    -------
    PaintFit; or NotFitted where the table does not determine the law (pressures or temperatures that are too few or
    all the same, no row more than unknowns), or where no order rises with pressure all over the calibrated range.

    Raises
    ------
    ValueError
        For arrays of different lengths, numbers that are not finite, pressures or ratios not above zero, orders.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> p, t = (v.ravel() for v in np.meshgrid(np.linspace(2e4, 1.2e5, 6), [290.0, 300.0, 310.0]))
    >>> noise = np.random.default_rng(0).normal(0.0, 0.001, p.size)
    >>> fit = wm.fit_paint(p, t, 0.2 + 0.8 * p / 1e5 + 0.005 * (t - 300.0) + noise, p_ref=1e5, t_ref=300.0)
    >>> fit.order, fit.rms < 0.002
    ((1, 1), True)
    """
    table = _table(pressure, temperature, ratio, p_ref, t_ref, ratio_sigma, pressure_sigma, temperature_sigma,
                   (pressure_unit, temperature_unit))  # fmt: skip
    if order is not None and not (1 <= order[0] <= MOST_P and 0 <= order[1] <= MOST_T):
        raise UsageError(f"fit_paint: order must be 1 to {MOST_P} and 0 to {MOST_T}, got {order}")
    tried: dict[Order, _Candidate | str] = {}
    for k, j in [order] if order is not None else [(a, b) for a in range(1, MOST_P + 1) for b in range(MOST_T + 1)]:
        tried[k, j] = _candidate(table, k, j)
    found = {o: c for o, c in tried.items() if isinstance(c, _Candidate)}
    words = {o: c if isinstance(c, str) else _rms(c.press) for o, c in tried.items()}
    if not found:
        why = next(iter(tried.values()))
        return NotFitted(f"fit_paint: {why}", {"orders": words})
    chosen = _chosen(found)
    return _result(table, found, words, chosen)


def _table(pressure: ArrayLike, temperature: ArrayLike, ratio: ArrayLike, p_ref: float, t_ref: float,
           ratio_sigma: ArrayLike | None, p_sigma: ArrayLike, t_sigma: ArrayLike, units: tuple[str, str]
           ) -> _Table:  # fmt: skip
    p, t, r = (np.asarray(a, dtype=float) for a in (pressure, temperature, ratio))
    if p.ndim != 1 or p.shape != t.shape or p.shape != r.shape:
        raise ValueError(f"fit_paint: pressure, temperature, ratio must be (M,), got {p.shape}, {t.shape}, {r.shape}")
    if not len(p):
        raise UsageError("fit_paint: the table has no rows")
    for name, a, least in (("pressure", p, 0.0), ("temperature", t, -np.inf), ("ratio", r, 0.0)):
        bad = np.flatnonzero(~(np.isfinite(a) & (a > least)))
        if len(bad):
            what = "finite" if least < 0 else "above zero"
            raise UsageError(f"fit_paint: row {bad[0] + 1}: {name} is {a[bad[0]]:g}; expected a number {what}")
    if not (0 < p_ref < np.inf and np.isfinite(t_ref)):
        raise UsageError(f"fit_paint: p_ref must be > 0 and t_ref finite, got {p_ref} and {t_ref}")
    sigma = np.zeros(len(p)) if ratio_sigma is None else np.asarray(ratio_sigma, dtype=float)
    spread = [np.broadcast_to(np.asarray(s, dtype=float) ** 2, p.shape) for s in (sigma, p_sigma, t_sigma)]
    if ratio_sigma is not None and not (sigma > 0).all():
        raise UsageError("fit_paint: ratio_sigma must be above zero; leave it out where it is not known")
    if not all(np.isfinite(s).all() for s in spread):
        raise UsageError("fit_paint: sigmas must be finite")
    return _Table(p, t, r, spread[0], spread[1], spread[2], p_ref, t_ref, ratio_sigma is not None, units)


def _candidate(table: _Table, k: int, j: int) -> _Candidate | str:
    """The fit of one order, or why it cannot be had."""
    unknowns = (k + 1) * (j + 1)
    for name, values, need in (("pressures", table.p, k + 1), ("temperatures", table.t, j + 1)):
        levels = _levels(values)
        if levels < need:
            return f"order {k} in pressure, {j} in temperature needs {need} different {name}, the table has {levels}"
    if len(table.p) < unknowns + 1:
        return f"order ({k}, {j}) has {unknowns} unknowns, the table {len(table.p)} rows; expected at least one more"
    half = 0.5 * float(np.ptp(table.t)) or 1.0
    x, d = table.p / table.p_ref, (table.t - table.t_ref) / half
    terms = [(a, b) for a in range(k + 1) for b in range(j + 1)]
    design = np.stack([x**a * d**b for a, b in terms], axis=1)
    scale = np.array([half**-b for _, b in terms])
    weight = np.ones(len(x))
    for _ in range(_ROUNDS):
        left, values, right = np.linalg.svd(design * weight[:, None] / np.linalg.norm(design, axis=0),
                                            full_matrices=False)  # fmt: skip
        if values[-1] < RANK * values[0]:
            return f"order ({k}, {j}) is not determined: the rows lie so that its terms cannot be told apart"
        inverse = (right.T / values) / np.linalg.norm(design, axis=0)[:, None]
        c = inverse @ (left.T @ (weight * table.ratio))
        variance = _variance(table, (c * scale).reshape(k + 1, j + 1))
        new = 1 / np.sqrt(variance) if (variance > 0).all() else np.ones(len(x))
        if np.allclose(new, weight, rtol=1e-10):
            break
        weight = new
    residual = table.ratio - design @ c
    lever = np.einsum("nk,nk->n", left, left)
    squares, dof = float(((weight * residual) ** 2).sum()), len(x) - unknowns
    # Without a stated sigma the residuals are the only measure; with one they count where they are larger.
    factor = squares / dof if not table.stated else max(squares / dof, 1.0)
    coefficients = (c * scale).reshape(k + 1, j + 1)
    cov = inverse @ inverse.T * np.outer(scale, scale) * factor
    trouble = _not_invertible(table, coefficients)
    if trouble:
        return f"order ({k}, {j}): {trouble}"
    with np.errstate(divide="ignore"):
        press = np.where(lever < 1 - 1e-9, residual / np.maximum(1 - lever, 1e-12), np.inf)
    return _Candidate(coefficients, cov, residual, press, squares, dof)


def _variance(table: _Table, coefficients: Array) -> Array:
    """(M,) of measured less fitted, with the errors of pressure and temperature through the law's slopes."""
    by_p, by_t, _ = law_slopes(coefficients, table.p_ref, table.t_ref, table.p, table.t)
    return np.asarray(table.variance + by_p**2 * table.p_var + by_t**2 * table.t_var)


def _not_invertible(table: _Table, coefficients: Array) -> str:
    try:
        _law(table, coefficients, None)
    except UsageError as error:
        return str(error).removeprefix("SternVolmer: ")
    return ""


def _law(table: _Table, coefficients: Array, cov: Array | None) -> SternVolmer:
    t = (float(table.t.min()), float(table.t.max()))
    return SternVolmer(coefficients, table.p_ref, table.t_ref, (float(table.p.min()), float(table.p.max())), t, cov,
                       *table.units)  # fmt: skip


def _levels(values: Array) -> int:
    """How many different values there are, those within a hundredth of the whole span being one."""
    span = float(np.ptp(values))
    return 1 if not span > 0 else 1 + int((np.diff(np.sort(values)) > 0.01 * span).sum())


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _chosen(found: Mapping[Order, _Candidate]) -> Order:
    """The order of fewest unknowns whose cross-validation is within one standard error of the best."""
    best = min(found, key=lambda o: _rms(found[o].press))
    square = found[best].press ** 2
    # A row that alone decides a term is predicted by no other: then the fewest unknowns are all that can be asked for.
    limit = float(square.mean() + square.std() / np.sqrt(len(square))) if np.isfinite(square).all() else np.inf
    good = [o for o in found if float((found[o].press ** 2).mean()) <= limit]
    return min(good, key=lambda o: ((o[0] + 1) * (o[1] + 1), _rms(found[o].press)))


def _averaged(table: _Table, found: Mapping[Order, _Candidate]) -> tuple[Array, Array]:
    """Coefficients (K + 1, J + 1) and covariance of the mean of the orders, by their weights.

    A mean of laws that rise is one that rises.
    """
    n = len(table.p)
    score = {}
    for o, c in found.items():
        k = n - c.dof + 1  # and the scatter
        small = 2 * k * (k + 1) / (n - k - 1) if n - k - 1 > 0 else np.inf
        score[o] = n * np.log(max(c.squares, 1e-300) / n) + 2 * k + small
    best = min(score.values())
    if not np.isfinite(best):  # too few rows to compare orders at all: the one of most freedom that there is
        score = {o: float(n - found[o].dof) * -1.0 for o in found}
        best = min(score.values())
    weight = {o: float(np.exp(-0.5 * (s - best))) for o, s in score.items()}
    kept = {o: w for o, w in weight.items() if w > LITTLE * max(weight.values())}
    shape = max(o[0] for o in kept) + 1, max(o[1] for o in kept) + 1
    places = {o: (np.arange(o[0] + 1)[:, None] * shape[1] + np.arange(o[1] + 1)).ravel() for o in kept}
    total, size = sum(kept.values()), shape[0] * shape[1]
    each = {o: np.zeros(size) for o in kept}
    for o, at in places.items():
        each[o][at] = found[o].coefficients.ravel()
    mean = sum((w / total * each[o] for o, w in kept.items()), np.zeros(size))
    cov = np.zeros((size, size))
    for o, w in kept.items():
        cov += w / total * np.outer(each[o] - mean, each[o] - mean)
        cov[np.ix_(places[o], places[o])] += w / total * found[o].cov
    return mean.reshape(shape), cov


def _result(table: _Table, found: Mapping[Order, _Candidate], words: Mapping[Order, Any], order: Order) -> PaintFit:
    fit = found[order]
    law = _law(table, *_averaged(table, found))
    sigma0 = float(np.sqrt(fit.squares / fit.dof)) if table.stated else float("nan")
    said = []
    if table.stated and sigma0 > 1:
        from scipy.special import chdtrc

        if float(chdtrc(fit.dof, fit.squares)) < 0.001:
            said.append(f"the residuals are {g3(sigma0)} times their stated sigmas; the covariance is larger by that")
    if order[1] == 0 and _levels(table.t) == 1:
        said.append("one temperature alone: the paint's temperature coefficient is not known")
    if own := own_reference(table.p, table.t, table.ratio, table.units[0]):
        said.append(own)
    residuals = table.ratio - law.ratio(table.p, table.t)
    return PaintFit(law, order, residuals, _rms(residuals), _rms(fit.press), sigma0, dict(words), tuple(said))
