"""What no stream and no taps can say: units that are mixed, gauge pressures, pictures that were exchanged; and what a
calibration does not say: pressures and temperatures beyond it; and what a level hangs on that no tap checks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2, g3
from windmark.paint import (
    InSitu,
    NodeField,
    PressureMap,
    SternVolmer,
    TunnelConditions,
    TunnelGain,
    recovery_temperature,
)
from windmark.paint.cp import AIR
from windmark.paint.stern_volmer import PRESSURE_OUTSIDE, TEMPERATURE_OUTSIDE

Array = NDArray[np.float64]

SURE = 5.0
"""Sigmas by which a node must be beyond what can be."""
PART = 0.1
"""Part of the surface that is: fewer nodes are flaws of a picture."""
ABOVE = 1.0
"""In Cp, beyond the stream's total pressure: a calibration that is somewhat off is no mixed unit."""
LOWEST = -10.0
"""Cp that suction peaks of slats alone come to, on a small part of a surface."""
LEVEL, SLOPE = 2.0, 4.0
"""Factors by which readings of taps may differ from the paint's a-priori pressure, and change with it. The nearest
units that are mixed up (psi and kPa) differ by 6.9."""
BEYOND = 0.1
"""Part of a calibrated range by which a law may be used beyond its ends."""
EXTRAPOLATED = "the paint's calibration is extrapolated: "
"""Begins what is said where that is done on more than `PART` of the surface."""

LITTLE = 0.01
"""Part of the nodes that cameras show which may have no pressure before that is said."""
LACKING = "no pressure where cameras show the surface: "
"""Begins what is said where more than `PART` of the nodes has none."""
UNCHECKED = "nothing checks the level of the pressure: "
"""Begins what is said of a point without taps that count."""

BESIDE_RECOVERY = "thermocouples and recovery contradict each other: "
"""Begins what is said where the wall's temperature is not what the stream leaves on it."""

UNFIT = f"{UNCHECKED}it is that of the taps, "
"""Begins what is said where the paint's own pressure cannot contradict a fit to taps."""


def mach_of(stream: TunnelConditions) -> float:
    """The stream's Mach number, or what q and p say of it where none is given."""
    by_q = np.sqrt(stream.q_inf / (0.5 * AIR * stream.p_inf))
    return float(stream.mach if np.isfinite(stream.mach) else by_q)


def total_pressure(stream: TunnelConditions) -> float:
    """Of the stream, in the unit of its static pressure."""
    return float(stream.p_inf * (1 + 0.5 * (AIR - 1) * mach_of(stream) ** 2) ** (AIR / (AIR - 1)))


def beyond_stream(cp: NodeField, stream: TunnelConditions) -> str:
    """Why no stream of these conditions leaves such pressures on a model, "" where it may."""
    on = cp.known
    if not on.any() or not (stream.q_inf > 0 and stream.p_inf > 0):
        return ""
    most = (total_pressure(stream) - stream.p_inf) / stream.q_inf
    least = max(-stream.p_inf / stream.q_inf, LOWEST)
    value, sigma = cp.value[on], cp.sigma[on]
    over, under = np.mean(value > most + ABOVE + SURE * sigma), np.mean(value < least - SURE * sigma)
    causes = "units of p_inf, q_inf or p_off are mixed, or pictures with wind and without were exchanged"
    if over > PART:
        return (f"on {100 * over:.0f} % of the surface Cp is above {g3(most + ABOVE)} (median {g3(np.median(value))}), "
                f"the stream's total pressure gives {g3(most)}: {causes}")  # fmt: skip
    if under > PART:
        words = "which no surface has" if least == LOWEST else "that of no pressure at all"
        return (f"on {100 * under:.0f} % of the surface Cp is below {g3(least)}, {words} (median "
                f"{g3(np.median(value))}): {causes}")  # fmt: skip
    return ""


def beside_recovery(wall: NodeField, stream: TunnelConditions, recovery: float | None, spread: float) -> list[str]:
    """What is said where thermocouples give a ``wall`` that is not of this stream, by what is said of both.

    ``recovery`` : factor; ``spread``: by how much the wall may differ from recovery (K, 1 sigma). Nothing without Mach
    number or total temperature.
    """
    there = wall.value[wall.known]
    if recovery is None or not len(there) or not (np.isfinite(stream.mach) and np.isfinite(stream.t_0)):
        return []
    by_stream = recovery_temperature(stream, 1, recovery=recovery, t_0_sigma=spread)
    warm, even, sigma = float(np.median(there)), float(by_stream.value[0]), float(by_stream.sigma[0])
    if abs(warm - even) <= SURE * sigma:
        return []
    hotter = f", and hotter than the stream's T0 of {stream.t_0:.4g} K" if warm > stream.t_0 + spread else ""
    return [f"{BESIDE_RECOVERY}the wall is at {warm:.4g} K by readings (median), at {even:.4g} K by recovery, "
            f"{g2(abs(warm - even) / sigma)} of its sigmas apart{hotter}"]  # fmt: skip


def beyond_calibration(prior: PressureMap, temperature: NodeField, law: SternVolmer | TunnelGain) -> list[str]:
    """How much of the surface lies outside the paint's calibration, in pressure and in temperature; nothing of none.

    A gain is of a steady pressure, in units of its own: how far it is used beyond its ends is not looked at.
    """
    on, out = prior.field.known, []
    for what, bit, value, span, unit in (
        ("pressure", PRESSURE_OUTSIDE, prior.field.value, law.p_range, law.pressure_unit),
        ("temperature", TEMPERATURE_OUTSIDE, temperature.value, law.t_range, law.temperature_unit),
    ):
        share = float(np.mean((prior.flags[on] & bit) > 0)) if on.any() else 0.0
        if not share > 0:
            continue
        within = f"in {what} ({span[0]:g} to {span[1]:g} {unit})"
        room = BEYOND * (span[1] - span[0])
        far = (value[on] < span[0] - room) | (value[on] > span[1] + room)
        if isinstance(law, SternVolmer) and far.mean() > PART:
            out.append(f"{EXTRAPOLATED}{g2(100 * share)} % of the nodes lie outside it {within}, "
                       f"{g2(100 * far.mean())} % by more than a tenth of its range")  # fmt: skip
        else:
            out.append(f"{g2(100 * share)} % of the nodes lie outside the paint's calibration {within}")
    return out


def unchecked_level(
    law: SternVolmer | TunnelGain, ratio: NodeField, temperature: NodeField, p_off: float, t_off: float,
    stream: TunnelConditions,
) -> str:  # fmt: skip
    """What is in the pressure of a point unseen where no tap is compared with it, and how much that makes in Cp.

    The pressure and temperature of the wind-off pictures (``p_off``, ``t_off``) are as good as the table of points has
    them: they have no sigma there, so what an error of them makes is said.
    """
    words = (f"{UNCHECKED}no tap is compared with it, and lamps, exposure or dark level that changed between wind-off "
             "and wind-on are in it unseen, as are errors of p_off and T_off")  # fmt: skip
    on = ratio.known & temperature.known
    if not isinstance(law, SternVolmer) or not on.any():
        return words
    by = law.invert(ratio.value[on], temperature.value[on], p_off=p_off, t_off=t_off)
    light, off, cold = (
        g2(float(np.nanmedian(np.abs(slope))) / stream.q_inf)
        for slope in (0.01 * by.by_ratio * ratio.value[on], 0.01 * p_off * by.by_p_off, by.by_t_off)
    )
    return f"{words}: 1 % of the light is {light} in Cp, 1 % of p_off {off}, 1 K of T_off {cold}"


def fitted_level(law: SternVolmer | TunnelGain, flicker: float) -> list[str]:
    """Why a fit to taps is not compared with the paint's own pressure: a sigma of that lacks something; else nothing.

    ``flicker`` of the lamps, NaN where nothing says it.
    """
    lacks = [words for words, missing in (("its calibration is taken as exact", law.cov is None),
                                          ("no sigma has the lamps' flicker", bool(np.isnan(flicker)))) if missing]
    return [f"{UNFIT}and the paint by itself cannot contradict what all of them share (reference pressure, span): "
            f"{' and '.join(lacks)}"] if lacks else []  # fmt: skip


def lacking(ratio: NodeField, prior: PressureMap, temperature: NodeField) -> list[str]:
    """How much of what cameras show comes to no pressure, and whether it is the temperature that is missing."""
    lost = ratio.known & ~prior.field.known
    share = float(lost.sum()) / max(int(ratio.known.sum()), 1)
    if share <= LITTLE:
        return []
    cold = float(np.mean(~temperature.known[lost]))
    why = "nothing says the wall's temperature there" if cold > 0.5 else "the law has none for their ratio"
    return [f"{LACKING if share > PART else ''}{g2(100 * share)} % of the nodes with a ratio have no pressure: {why}; "
            "their loads are filled in from around"]  # fmt: skip


def other_unit(readings: Array, prior: Array, fit: InSitu | None = None) -> str:
    """Why readings of taps (N,) are not the absolute pressures that the paint shows there (N,), "" where they may be.

    ``fit``: of the taps, whose slope is looked at, too.
    """
    good = np.isfinite(readings) & np.isfinite(prior) & (prior > 0)
    if not good.any():
        return ""
    below = int((readings[good] <= 0).sum())
    if 2 * below > good.sum():
        return (f"{below} of {good.sum()} readings are not above 0: they are no absolute pressures, but differences "
                "from another one (gauge pressures)")  # fmt: skip
    level = float(np.median(readings[good]) / np.median(prior[good]))
    if not 1 / LEVEL < level < LEVEL:
        return (f"the taps' readings are {g3(level)} times the pressure that the paint shows there (medians "
                f"{np.median(readings[good]):.4g} and {np.median(prior[good]):.4g} Pa): another unit, or no absolute "
                "pressures")  # fmt: skip
    slope = 1.0 if fit is None else float(fit.coefficients[1] / fit.scale)
    if not 1 / SLOPE < slope < SLOPE:
        return (f"the taps' readings change by {g3(slope)} times what the paint shows there: another unit, or the "
                "readings of another point")  # fmt: skip
    return ""
