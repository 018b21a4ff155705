"""How a solve ended: the record that every adjusted result carries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

REASONS = {
    "converged_gradient": "at the minimum, to a small part of the sigmas",
    "converged_step": "at the minimum: the next step changes nothing beyond rounding",
    "converged_cost": "at the minimum: the next step lowers nothing by a noticeable part",
    "max_iterations": "the allowed iterations were used up before the minimum was reached",
    "stalled": "no step lowers the cost, though the gradient says that one should",
}
"""Every reason for which an engine stops, in words."""


@dataclass(frozen=True)
class SolveReport:
    """Why and where an engine stopped.

    Parameters
    ----------
    reason : key of `REASONS`
    converged : the reason is a minimum, not an exhausted or stalled search
    iterations : steps tried (Levenberg-Marquardt) or passes over all parameters (paper's engine)
    evaluations : evaluations of the residuals, the one at the start included
    initial_cost, final_cost : half the sum of the squared whitened residuals, after the robust loss
    options : everything the solve was made with, by name
    """

    reason: str
    converged: bool
    iterations: int
    evaluations: int
    initial_cost: float
    final_cost: float
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """How many steps, and why no more."""
        return f"{self.iterations} iterations; {REASONS.get(self.reason, self.reason)}"

    def __post_init__(self) -> None:
        if self.reason not in REASONS:
            raise ValueError(f"SolveReport: reason must be among {', '.join(REASONS)}, got {self.reason!r}")
