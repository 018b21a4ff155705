"""Random numbers for the tests of resection: the same each time."""

from __future__ import annotations

import numpy as np
import pytest


@pytest.fixture
def rng():
    return np.random.default_rng(20050607)
