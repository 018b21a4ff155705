"""What is known of a point's stream, and who says it: its own cells, its ``.wtd`` file, the project for all points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from windmark.errors import UsageError, g2

PRESSURE = {"Pa": 1.0, "hPa": 100.0, "mbar": 100.0, "kPa": 1e3, "bar": 1e5, "psf": 47.880259, "psi": 6894.757293}
"""Pascals of the units that columns of pressures may be in."""
TEMPERATURE = {"K": (1.0, 0.0), "degC": (1.0, 273.15), "degF": (5 / 9, 255.3722222222222)}
"""Factor and offset to kelvin."""

_PLAIN = {"alpha_deg": "alpha_deg", "beta_deg": "beta_deg", "mach": "mach"}
_PRESSURES = {"p_inf": "p_inf", "q_inf": "q_inf", "p_off": "p_off", "sigma_p_inf": "sigma_p", "sigma_q_inf": "sigma_q"}
_TEMPERATURES = {"T0": "t_0", "T_off": "t_off"}
"""Names of quantities, to which a unit is added -> of the row of a point (`table.PointRow`)."""
_WORDS = {
    "alpha_deg": ("alpha", "degrees"), "beta_deg": ("beta", "degrees"), "mach": ("Mach", ""), "p_inf": ("p_inf", "Pa"),
    "q_inf": ("q_inf", "Pa"), "t_0": ("T0", "K"), "p_off": ("p_off", "Pa"), "t_off": ("T_off", "K"),
    "sigma_p": ("sigma_p_inf", "Pa"), "sigma_q": ("sigma_q_inf", "Pa"),
}  # fmt: skip
KEYS = tuple(_WORDS)
"""Of a row, all that may be said of the stream."""
DIFFERS, DIFFERS_DEG = 1e-3, 0.01
"""Two that say a quantity differ beyond rounding: by this part of it, or so many degrees."""
ROUNDED = 1e-4
"""Part by which q_inf and 0.7 M^2 p_inf may differ because the table's numbers are rounded."""
FROZEN_K = 50.0
"""Air is solid below: a temperature that says so has another unit."""


def constants_of(said: Mapping[str, float]) -> dict[str, float]:
    """``[conditions]`` of a project, keys as the columns of the table of points -> `KEYS`, in pascals and kelvin.

    Raises
    ------
    UsageError
        For a key or unit that is not known, a quantity that is there twice, and what no stream has.
    """
    out: dict[str, float] = {}
    for key, value in said.items():
        name, number = _in_base(key, value)
        if name in out:
            raise UsageError(f"{key}: {_WORDS[name][0]} is there more than once")
        if name in ("mach", "p_inf", "q_inf", "p_off") and not number > 0:
            raise UsageError(f"{key}: expected a number above 0, got {value:g}")
        if name in ("t_0", "t_off") and not number > FROZEN_K:
            raise UsageError(f"{key}: expected above {FROZEN_K:g} K, got {number:g} K: is it in the unit of its name?")
        if name in ("sigma_p", "sigma_q") and number < 0:
            raise UsageError(f"{key}: expected at least 0, got {value:g}")
        out[name] = number
    return out


def _in_base(key: str, value: float) -> tuple[str, float]:
    if key in _PLAIN:
        return _PLAIN[key], float(value)
    quantity, _, unit = key.rpartition("_")
    if quantity in _PRESSURES and unit in PRESSURE:
        return _PRESSURES[quantity], value * PRESSURE[unit]
    if quantity in _TEMPERATURES and unit in TEMPERATURE:
        factor, offset = TEMPERATURE[unit]
        return _TEMPERATURES[quantity], value * factor + offset
    known = [*_PLAIN, *(f"{q}_UNIT" for q in (*_PRESSURES, *_TEMPERATURES))]
    raise UsageError(f"{key} is not known; expected {', '.join(known)}, with units of pressure {', '.join(PRESSURE)}, "
                     f"of temperature {', '.join(TEMPERATURE)}")  # fmt: skip


def differs(key: str, counts: float, other: float, part: float = DIFFERS) -> bool:
    """Whether two that say a quantity of `KEYS` differ, by ``part`` of it or by an angle; not where one is missing."""
    return abs(other - counts) > (DIFFERS_DEG if key.endswith("_deg") else part * abs(counts))


def in_words(key: str, value: float | None = None) -> str:
    """A quantity of `KEYS` as tables call it; with a value its number and unit alone."""
    name, unit = _WORDS[key]
    return name if value is None else f"{value:g} {unit}".rstrip()


def joined(said: Sequence[tuple[str, Mapping[str, float]]]) -> tuple[dict[str, float], tuple[str, ...]]:
    """What is known of the stream by who says it, the first one that does counts; and where another contradicts it.

    Parameters
    ----------
    said : who, in words, and `KEYS` -> value, NaN where it does not say one
    """
    out = dict.fromkeys(KEYS, float("nan"))
    words = []
    for key in KEYS:
        by = [(who, of[key]) for who, of in said if np.isfinite(of.get(key, np.nan))]
        if not by:
            continue
        (first, counts), *others = by
        out[key] = counts
        words += [f"{in_words(key)} is {in_words(key, counts)} by {first}, which counts, and {in_words(key, value)} "
                  f"by {who}" for who, value in others if differs(key, counts, value)]  # fmt: skip
    return out, tuple(words)


def dynamic_pressure(mach: float, p_inf: float) -> float:
    """Of air at a Mach number and static pressure, in the unit of that."""
    return 0.7 * mach**2 * p_inf


def contradiction(mach: float, p_inf: float, q_inf: float, sigma_p: float, sigma_q: float) -> float:
    """Part by which 0.7 M^2 p_inf differs from q_inf: 0 without a Mach number, within rounding and within sigmas.

    A Mach number is as exact as its last digit, or the second one behind the point (0.2 is taken as 0.20): at low speed
    that is much of q_inf, and says nothing of a pressure.
    """
    if not np.isfinite(mach):
        return 0.0
    part = dynamic_pressure(mach, p_inf) / q_inf - 1
    sigma = float(np.hypot(np.nan_to_num(sigma_p) / p_inf, np.nan_to_num(sigma_q) / q_inf))
    digits = max(len(np.format_float_positional(mach, trim="-").partition(".")[2]), 2)
    rounded = 1.05 * 10.0**-digits / mach if mach > 0 else 0.0  # twice half a unit of that digit, and a little
    return 0.0 if abs(part) <= max(ROUNDED, rounded, 2 * sigma) else part


def contradiction_words(part: float, p_inf: float, q_inf: float) -> list[str]:
    """What is said of a `contradiction` beyond `DIFFERS`; less is in the sigma alone."""
    if not abs(part) > DIFFERS:
        return []
    return [f"Mach, p_inf and q_inf contradict each other by {g2(100 * abs(part))} %, and the sigma of all nodes has "
            f"it: a p_inf that is so wrong makes {g2(abs(part) * p_inf / q_inf)} in Cp; correct the one that is wrong, "
            "give Mach with all its digits, or leave it out where it is nominal"]  # fmt: skip
