"""Whether thermocouples agree: each reading against what the others say there, under the covariance of the wall.

With the kriging matrix K of M readings and an unknown mean, P = K^-1 - K^-1 1 1' K^-1 / (1' K^-1 1) gives all of it:
the reading k less what the others predict is (P t)_k / P_kk with the variance 1 / P_kk, the weighted sum of squares is
t' P t, and without k it is less by (P t)_k^2 / P_kk (Dubrule, Mathematical Geology 15, 1983).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.chance import chance
from windmark.errors import g2, g3

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FALSE = 0.01
"""Probability that any reading at all is left out, or sigmas become larger, where none is wrong."""
CONTRADICT = 0.001
"""That of readings so far from each other, from which it is doubted that they are of this wall."""
DOUBTED = "thermocouples contradict each other"
"""Begins what is said of such."""


@dataclass(frozen=True, eq=False)
class TestedWells:
    """What the test of M readings comes to.

    Parameters
    ----------
    used : (M,) that count
    variance : (M,) of their own errors; more than stated where one of several is wrong and none tells which
    power : variance of the wall's temperature about its mean
    words : what is to be said of it
    """

    __test__ = False

    used: Mask
    variance: Array
    power: float
    words: tuple[str, ...] = ()


def alike(a: Array, b: Array, length: float) -> Array:
    """(A, B) correlation of the wall's temperature at places (A, 3) and (B, 3)."""
    square = ((a[:, None] - b[None]) ** 2).sum(axis=2)
    return np.asarray(np.exp(-0.5 * square / length**2))


def power_of(t: Array, variance: Array, spread: float | None) -> float:
    """Variance of the wall's temperature about its mean: as stated, or as readings show it."""
    if spread is not None:
        return float(spread**2)
    return float(max(np.var(t, ddof=1) - variance.mean(), variance.mean()))


def tested_wells(at: Array, t: Array, variance: Array, length: float, spread: float | None, names: list[str],
                 unit: str) -> TestedWells:  # fmt: skip
    """Test readings (M,) of thermocouples with names (M,) at places (M, 3).

    A reading that contradicts all others is left out, where these agree without it: fewer than half of all. Where
    nothing tells which is wrong, each that is off by more than chance counts with what it is off as its sigma, and all
    sigmas, those of the wall between them, too, become larger by as much as readings differ: either one of them is
    wrong or the wall varies by more than was said.
    """
    used, words = np.ones(len(t), bool), []
    left_out: dict[str, str] = {}
    while used.sum() > 2 and 2 * (len(left_out) + 1) < len(t):
        of = np.flatnonzero(used)
        off, sigma, odd = _odd(at[of], t[of], variance[of], length, spread)
        if odd.sum() != 1:  # several: of two at one place the others may agree with either
            break
        k = int(np.argmax(odd))
        more = "more" if off[k] > 0 else "less"
        left_out[names[of[k]]] = (f"it reads {g3(abs(off[k]))} {unit} {more} than the others say there, by "
                                  f"{g2(abs(off[k]) / sigma[k])} sigma")  # fmt: skip
        used[of[k]] = False
    if left_out:
        words.append("thermocouples that do not count: " + "; ".join(f"{k} ({v})" for k, v in left_out.items()))
    of = np.flatnonzero(used)
    if len(of) == 1:
        words.append(f"{names[of[0]]} alone says the wall's temperature: nothing tests its reading")
    power = power_of(t[used], variance[used], spread)
    larger, own, said = _larger(at[of], t[of], variance[of], length, power, [names[k] for k in of], unit)
    variance = variance * larger**2
    variance[of] += own
    return TestedWells(used, variance, power * larger**2, (*words, *said))


def _projector(at: Array, variance: Array, length: float, power: float) -> Array:
    inverse = np.linalg.inv(power * alike(at, at, length) + np.diag(variance))
    own = inverse.sum(axis=1)
    return np.asarray(inverse - np.outer(own, own) / own.sum())


def _odd(at: Array, t: Array, variance: Array, length: float, spread: float | None) -> tuple[Array, Array, Mask]:
    """What each reading is off, its sigma, and whether it contradicts all others, which agree without it."""
    from scipy.special import chdtrc

    count = len(t)
    off, sigma, odd = np.empty(count), np.empty(count), np.zeros(count, bool)
    for k in range(count):
        others = np.arange(count) != k
        # A spread that is not stated is that of the others: a wrong reading would make it what it needs.
        p = _projector(at, variance, length, power_of(t[others], variance[others], spread))
        e = p @ (t - t[k])
        off[k], sigma[k] = e[k] / p[k, k], 1 / np.sqrt(p[k, k])
        own = float(e[k] ** 2 / p[k, k])
        rest, dof = max(float((t - t[k]) @ e) - own, 0.0), count - 2
        # Others that differ by more than their sigmas say make nothing likelier than they are themselves.
        unlikely = count * chance(own, 1, own + max(rest, dof), count - 1) < FALSE
        odd[k] = unlikely and chdtrc(dof, rest) > FALSE
    return off, sigma, odd


def _larger(at: Array, t: Array, variance: Array, length: float, power: float, names: list[str], unit: str
            ) -> tuple[float, Array, list[str]]:  # fmt: skip
    """By which factor all sigmas must be larger for readings to be within them (1 where they are), by what (M,) the
    variances of those that are off, and what is said of it.
    """
    from scipy.special import chdtrc

    dof, own = len(t) - 1, np.zeros(len(t))
    if dof < 1:
        return 1.0, own, []
    p = _projector(at, variance, length, power)
    e = p @ (t - t.mean())
    squares, off = float((t - t.mean()) @ e), e / np.diagonal(p)
    probability = float(chdtrc(dof, squares))
    if not probability < FALSE:
        return 1.0, own, []
    wrong = chdtrc(1, off * e) < FALSE
    own[wrong] = off[wrong] ** 2
    times = float(np.sqrt(squares / dof))
    some = ", ".join(n for n, w in zip(names, wrong, strict=True) if w) or "they"
    begins = DOUBTED if probability < CONTRADICT else "thermocouples differ"
    return times, own, [f"{begins}: {g2(times)} times as much as their sigmas and the wall's spread of "
                        f"{g2(np.sqrt(power))} {unit} say; {some} may be wrong (by up to {g3(np.abs(off).max())} "
                        f"{unit}), nothing tells which; the sigmas of the wall's temperature contain it"]  # fmt: skip
