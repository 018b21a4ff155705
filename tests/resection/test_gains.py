"""How far nodes are believed where several pictures are brought to one scale."""

import numpy as np
import pytest

from windmark.resection.gains import CUT, _trust


@pytest.mark.parametrize(("noise", "usual"), [(1.0, 1.0), (5.0, 5.0), (0.1, 1.0)])
def test_a_node_whose_misfit_is_cut_times_the_usual_one_counts_half(noise, usual):
    """The usual misfit is what nodes show, such as five times what is stated; but no less than that."""
    rng = np.random.default_rng(8)
    value = rng.uniform(50, 100, 4000) + noise * rng.normal(size=(2, 4000))
    value[:, 0] = 75.0 + np.array([0.5, -0.5]) * CUT * usual * np.sqrt(2)  # of a difference of two
    trust = _trust(value, np.ones((2, 4000)), np.ones(2), np.zeros(2), np.ones((2, 4000), bool))
    assert trust[0] == pytest.approx(0.5, abs=0.02)
    assert np.median(trust) > 0.9
