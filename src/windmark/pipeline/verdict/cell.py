"""The verdict on a paint's calibration: residuals beyond their sigmas, few measurements, a reference outside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from windmark.errors import g2, g3
from windmark.paint import PaintFit, TemperaturePaint
from windmark.paint.own_reference import OWN_REFERENCE
from windmark.pipeline.psp.cell import CellTable
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding, Verdict


@dataclass(frozen=True)
class _Fit:
    """What both kinds of paint have: rows, unknowns, RMS with and without the row, residuals over their sigmas."""

    rows: int
    unknowns: int
    rms: float
    cv_rms: float
    sigma0: float


def pressure_verdict(fit: PaintFit, cell: CellTable) -> Verdict:
    """Judge the calibration of a paint that answers to pressure."""
    law = fit.law
    unknowns = (fit.order[0] + 1) * (fit.order[1] + 1)
    found = _common(_Fit(len(fit.residuals), unknowns, fit.rms, fit.cv_rms, fit.sigma0))
    if not np.ptp(cell.temperature) > 0:
        said = f"the cell had {law.t_range[0]:g} K alone: what temperature does to the paint is not known"
        found.append(Finding(DOUBTFUL, "weak", said, "measure at the tunnel's temperatures, wind off and on"))
    found += calibration_findings(fit.warnings)
    found += _outside(law.p_ref, law.p_range, "Pa", "--p-ref") + _outside(law.t_ref, law.t_range, "K", "--t-ref")
    return Verdict.of(found, 1, f"{len(fit.residuals)} measurements are followed to {g3(fit.rms)} of I_ref / I (RMS)",
                      "name the file in the project of the paint test")  # fmt: skip


def calibration_findings(warnings: Sequence[str]) -> list[Finding]:
    """Of what is said of a paint's calibration: a table that says nothing of the temperature."""
    step = "divide all rows by one light, that of the reference pressure and temperature, and calibrate again"
    return [Finding(DOUBTFUL, "weak", said, step) for said in warnings if said.startswith(OWN_REFERENCE)]


def temperature_verdict(law: TemperaturePaint, cell: CellTable) -> Verdict:
    """Judge the calibration of a paint that answers to temperature."""
    rows, unknowns = len(cell.ratio), len(law.coefficients)
    sigma0 = float("nan")
    if cell.ratio_sigma is not None:
        left = (np.log(cell.ratio) - law.log_ratio(cell.temperature)) / (cell.ratio_sigma / cell.ratio)
        sigma0 = float(np.sqrt((left**2).sum() / (rows - unknowns)))
    found = _common(_Fit(rows, unknowns, law.rms, law.cv_rms, sigma0))
    found += _outside(law.t_ref, law.t_range, "K", "--t-ref")
    return Verdict.of(found, 1, f"{rows} measurements are followed to {g3(law.rms)} of ln(I_ref / I) (RMS)",
                      "name the file in the project of the run")  # fmt: skip


def _common(fit: _Fit) -> list[Finding]:
    found = []
    if fit.sigma0 > rules.SIGMA0:
        said = f"residuals are {g2(fit.sigma0)} times their stated sigmas"
        step = "look for rows far from the law in the picture; state the cell's true sigmas, or take a higher --order"
        found.append(Finding(DOUBTFUL, "noise", said, step))
    if fit.cv_rms > rules.LEFT_OUT_TIMES * fit.rms:
        said = f"{fit.rows} measurements for {fit.unknowns} unknowns: rows left out of the fit are off by "
        said += f"{g3(fit.cv_rms)} (RMS), those in it by {g3(fit.rms)}"
        found.append(Finding(DOUBTFUL, "few", said, "measure more pressures and temperatures, or take a lower --order"))
    return found


def _outside(value: float, span: tuple[float, float], unit: str, option: str) -> list[Finding]:
    """A reference state at which nothing was measured; a span of nothing has been said already."""
    room = span[1] - span[0]
    if not room > 0 or span[0] - rules.BEYOND * room <= value <= span[1] + rules.BEYOND * room:
        return []
    said = f"the reference {value:g} {unit} is outside of the calibrated {span[0]:g} to {span[1]:g} {unit}"
    step = f"give {option} as the pictures without wind have it, and measure in the cell as far as there"
    return [Finding(DOUBTFUL, "weak", said, step)]
