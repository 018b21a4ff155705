"""What a tracked labelling must pass by itself: evidence, misfit, errors of the table."""

from __future__ import annotations

import math

import numpy as np

from windmark.registration.task import Limits

MISFIT = 4.0
"""The residuals' sigma times this must fit into the neighbourhood of the search."""
TWICE = 3.0**0.5
"""An excess of so many sigma doubles the sigma of the spots."""
SUSPICIOUS = 1.8
"""A misfit of so many sigma of the spots is loose."""
MISSED = float(np.log(5.0))
"""More evidence (nats) that such a misfit needs for each missing marker, as if four of five were seen: a labelling that
is right in parts only, or by chance, explains them so, and a part of a large model has much evidence ..."""
LOOSE_AND_SPARSE = 40.0
"""... and so much on top where half of the markers are missing."""


def too_large(misfit_px: float, excess_px: float, sigma_px: float) -> bool:
    """Whether residuals are larger than the spots' covariances say, and the markers' do not explain it."""
    return misfit_px > SUSPICIOUS * sigma_px and excess_px > sigma_px


def least_evidence(limits: Limits, share: float, count: int, expected: int, loose: bool) -> float:
    """Evidence (nats) that a solution needs; ``share`` is what a prior leaves of all poses."""
    least = limits.score + float(np.log(share))
    if loose:
        least += (LOOSE_AND_SPARSE if 2 * count <= expected else 0.0) + MISSED * (expected - count)
    return least


def table_excess(
    limits: Limits, excess_px: float, redundancy: float, spacing_px: float, sigma_px: float
) -> tuple[float, float]:
    """By how much the markers are off their table (1 sigma, with its own uncertainty on top), and the limit."""
    allowed = math.hypot(limits.table_error * spacing_px, TWICE * sigma_px)
    return excess_px * (1 + 1 / math.sqrt(2 * max(redundancy, 1.0))), allowed
