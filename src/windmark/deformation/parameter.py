"""Parameters of deformation laws: what an engineer calls them, in which unit, and what is known before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from windmark.errors import UsageError

ANGLE_UNITS = ("deg", "rad")


@dataclass(frozen=True)
class Parameter:
    """One parameter of a law, in the unit that the law itself works with.

    Parameters
    ----------
    name : an identifier, unique within the law
    unit : "deg", "mm", "1/m", ...; "" for a pure number. Only a label: nothing is converted
    start : value of the undeformed model, and where a search without better knowledge starts
    sigma : what is known before: standard deviation about the start; inf for nothing
    lower, upper : bounds

    Raises
    ------
    ValueError
        For a name that is no identifier, or numbers that contradict each other.
    """

    name: str
    unit: str = ""
    start: float = 0.0
    sigma: float = float("inf")
    lower: float = float("-inf")
    upper: float = float("inf")

    def __post_init__(self) -> None:
        if not self.name.isidentifier():
            raise UsageError(f"Parameter: name must be an identifier, got {self.name!r}")
        if not np.isfinite(self.start):
            raise UsageError(f"Parameter {self.name}: start must be finite, got {self.start}")
        if not self.sigma > 0:
            raise UsageError(f"Parameter {self.name}: sigma must be > 0, got {self.sigma}")
        if not self.lower <= self.start <= self.upper or self.lower == self.upper:
            raise UsageError(
                f"Parameter {self.name}: expected lower <= start <= upper, got {self.lower}, {self.start}, {self.upper}"
            )

    @property
    def step(self) -> float:
        """A small change for numerical derivatives where nothing else says what is small."""
        known = self.sigma if np.isfinite(self.sigma) else max(abs(self.start), 1.0)
        return 1e-4 * known
