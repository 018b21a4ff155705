"""Other colours of a paint: errors kept whole in few columns, light that both colours share cancelled."""

import numpy as np

from windmark.paint import NodeField
from windmark.tasks.psp import MergedRatio, as_one_cause, two_colours

RNG = np.random.default_rng(5)
N = 400


def field(value, names, size=0.01):
    modes = size * RNG.standard_normal((N, len(names)))
    return NodeField(np.broadcast_to(value, N).astype(float), np.full(N, 1e-6), modes, tuple(names))


def merged(ratio):
    return MergedRatio(ratio, {}, np.zeros(N, np.int8), 0.0, 0.0)


def test_one_cause_keeps_every_nodes_variance_and_what_is_to_stay():
    before = field(1.2, [*(f"a:{k}" for k in range(5)), "b", "stays:1", "stays:2"])
    after = as_one_cause(before, "new", 3, keep="stays")
    assert after.names == ("stays:1", "stays:2", "new:1", "new:2", "new:3")
    np.testing.assert_allclose(after.variance, before.variance)
    np.testing.assert_array_equal(after.modes[:, :2], before.modes[:, 6:])
    # The columns that are kept are those of most weight: of all sums' variances they hold the most.
    assert (after.modes[:, 2:] ** 2).sum() >= 0.5 * (before.modes[:, :6] ** 2).sum()


def test_what_both_colours_show_cancels_and_the_references_errors_are_one_cause():
    light = RNG.uniform(0.8, 1.2, N)
    paint, reference = field(1.5 * light, ["registration wind-on:1", "lamps"]), field(light, ["registration wind-on:1"])
    got = two_colours(merged(paint), merged(reference)).ratio
    np.testing.assert_allclose(got.value, 1.5)
    assert set(got.names) == {"registration wind-on:1", "lamps", "reference channel:1"}
    np.testing.assert_allclose(got.modes[:, got.names.index("reference channel:1")] ** 2,
                               (1.5 / light * reference.modes[:, 0]) ** 2)  # fmt: skip
    other = two_colours(merged(field(2.0 * light, ["x"])), merged(reference)).ratio
    shared = [f.modes[:, f.names.index("reference channel:1")] / f.value for f in (got, other)]
    np.testing.assert_allclose(shared[0], shared[1])


def test_no_light_in_one_colour_is_no_ratio():
    gone = np.r_[np.nan, 0.0, np.ones(N - 2)]
    got = two_colours(merged(field(1.0, ["a"])), merged(field(gone, ["a"]))).ratio
    assert np.isnan(got.value[:2]).all()
    assert np.isfinite(got.value[2:]).all()
