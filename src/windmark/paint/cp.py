"""Pressure coefficient from the tunnel's conditions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.paint.modes import NodeField, combined
from windmark.scene.shown import check_kinds

Array = NDArray[np.float64]

AIR = 1.4
"""Ratio of specific heats of air."""


@dataclass(frozen=True, eq=False)
class TunnelConditions:
    """The free stream of one point.

    Parameters
    ----------
    p_inf, q_inf : static and dynamic pressure; > 0
    cov : (2, 2) of the two; None: exact
    mach, t_0 : Mach number and total temperature, NaN where not known (recovery temperature needs them)
    pressure_unit, temperature_unit : of the above

    Examples
    --------
    >>> import windmark as wm
    >>> conditions = wm.TunnelConditions.from_mach(1e5, 0.8, 300.0, p_0_sigma=50.0, mach_sigma=0.001)
    >>> round(conditions.p_inf), round(conditions.q_inf)
    (65602, 29390)
    >>> bool(conditions.cov[0, 1] != 0)  # both come from the same two readings
    True
    """

    p_inf: float
    q_inf: float
    cov: Array | None = None
    mach: float = float("nan")
    t_0: float = float("nan")
    pressure_unit: str = "Pa"
    temperature_unit: str = "K"

    def __post_init__(self) -> None:
        if not (0 < self.p_inf < np.inf and 0 < self.q_inf < np.inf):
            raise UsageError(f"TunnelConditions: p_inf and q_inf must be > 0, got {self.p_inf} and {self.q_inf}")
        if self.cov is not None and np.shape(self.cov) != (2, 2):
            raise ValueError(f"TunnelConditions: cov must be (2, 2), got {np.shape(self.cov)}")

    @staticmethod
    def of(p_inf: float, q_inf: float, p_sigma: float = 0.0, q_sigma: float = 0.0, *, pressure_unit: str = "Pa"
           ) -> TunnelConditions:  # fmt: skip
        """Static and dynamic pressure that were measured independently, with their standard deviations."""
        return TunnelConditions(p_inf, q_inf, np.diag([p_sigma**2, q_sigma**2]).astype(float),
                                pressure_unit=pressure_unit)  # fmt: skip

    @staticmethod
    def from_mach(
        p_0: float, mach: float, t_0: float = float("nan"), *, p_0_sigma: float = 0.0, mach_sigma: float = 0.0,
        gamma: float = AIR, pressure_unit: str = "Pa", temperature_unit: str = "K",
    ) -> TunnelConditions:  # fmt: skip
        """From total pressure and Mach number: isentropic flow of a perfect gas (NACA Report 1135, eqs. 44, 47).

        The errors of p_inf and q_inf are correlated, for both come from the same two readings.
        """
        if not (p_0 > 0 and mach > 0 and gamma > 1):
            raise UsageError(f"TunnelConditions: p_0, mach > 0 and gamma > 1 are needed, got {p_0}, {mach}, {gamma}")
        ratio = 1 + 0.5 * (gamma - 1) * mach**2
        p = p_0 * ratio ** (-gamma / (gamma - 1))
        q = 0.5 * gamma * mach**2 * p
        by_mach = -gamma * mach / ratio * p
        slopes = np.array([[p / p_0, by_mach], [q / p_0, q * (2 / mach + by_mach / p)]])
        return TunnelConditions(p, q, slopes @ np.diag([p_0_sigma**2, mach_sigma**2]) @ slopes.T, mach, t_0,
                                pressure_unit, temperature_unit)  # fmt: skip


def pressure_coefficient(pressure: NodeField, conditions: TunnelConditions) -> NodeField:
    """Cp = (p - p_inf) / q_inf of every node; the conditions' errors are the modes ``conditions:k``.

    Raises
    ------
    ValueError
        For pressures in another unit than the conditions.

    Examples
    --------
    >>> import windmark as wm
    >>> conditions = wm.TunnelConditions.of(50000.0, 20000.0, q_sigma=100.0)
    >>> cp = wm.pressure_coefficient(wm.NodeField.make([50000.0, 70000.0], 200.0, unit="Pa"), conditions)
    >>> cp.value.tolist(), cp.sigma.round(4).tolist()
    ([0.0, 1.0], [0.01, 0.0112])
    """
    check_kinds("pressure_coefficient", pressure=(pressure, NodeField), conditions=(conditions, TunnelConditions))
    if pressure.unit and pressure.unit != conditions.pressure_unit:
        raise UsageError(
            f"pressure_coefficient: the pressure is in {pressure.unit}, the conditions in {conditions.pressure_unit}"
        )
    q = conditions.q_inf
    cp = (pressure.value - conditions.p_inf) / q
    out = combined(cp, [(pressure, 1 / q)])
    if conditions.cov is None or not np.any(conditions.cov):
        return out
    slopes = np.stack([np.full(len(cp), -1 / q), -cp / q], axis=1)
    return out.with_modes("conditions", np.where(np.isfinite(cp)[:, None], slopes, 0.0), conditions.cov)
