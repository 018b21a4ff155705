"""Body and wind axes: turns that are known, and references that are none."""

import numpy as np
import pytest

from windmark.errors import UsageError
from windmark.paint import LoadReference
from windmark.paint.axes import COEFFICIENTS

GOOD = {"area": 2.0, "chord": 0.5, "span": 4.0}


@pytest.mark.parametrize(("alpha", "beta"), [(0.0, 0.0), (12.0, 0.0), (0.0, 7.0), (-20.0, 30.0)])
def test_wind_axes_are_a_turn_with_drag_along_the_wind(alpha, beta):
    axes = LoadReference(**GOOD, alpha_deg=alpha, beta_deg=beta).wind_axes()
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    a, b = np.radians([alpha, beta])
    # The air comes from ahead, from below by alpha, from starboard by beta: it goes aft, up and to port.
    np.testing.assert_allclose(axes[0], [np.cos(a) * np.cos(b), -np.sin(b), np.sin(a) * np.cos(b)], atol=1e-12)
    assert axes[2] @ [0, 1, 0] == 0.0  # lift is in the plane of symmetry
    assert axes[2] @ [0, 0, 1] > 0
    assert axes[1] @ [0, 1, 0] > 0  # to starboard


def test_coefficients_of_unit_forces_and_moments():
    body = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])  # aft is y, starboard z, up x
    reference = LoadReference(**GOOD, body_axes=body)
    for k, axis in enumerate(body):
        got = dict(zip(COEFFICIENTS, reference.coefficients(np.r_[axis, 0, 0, 0]), strict=True))
        assert [got[n] for n in ("CA", "CY", "CN")] == [0.5 * (k == n) for n in range(3)]
        assert [got[n] for n in ("CD", "CC", "CL")] == [0.5 * (k == n) for n in range(3)]
        turn = dict(zip(COEFFICIENTS, reference.coefficients(np.r_[0, 0, 0, axis]), strict=True))
        by = {"Cl": -1 / (2 * 4), "Cm": 1 / (2 * 0.5), "Cn": -1 / (2 * 4)}
        assert [turn[n] for n in by] == [by[n] * (k == m) for m, n in enumerate(by)]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"area": 0.0}, "area must be > 0, got 0.0"), ({"chord": np.inf}, "chord"), ({"span": np.nan}, "span"),
        ({"alpha_deg": np.nan}, "angles must be finite"), ({"beta_deg": np.inf}, "angles must be finite"),
        ({"moment_point": [0.0, 1.0]}, "three finite numbers"), ({"moment_point": [0, 0, np.nan]}, "three finite"),
        ({"body_axes": np.diag([1.0, 1, -1])}, "right-handed"), ({"body_axes": 2 * np.eye(3)}, "length 1"),
        ({"body_axes": np.eye(2)}, "three rows"), ({"body_axes": [[1, 0, 0], [0.01, 1, 0], [0, 0, 1]]}, "right angles"),
    ],
)  # fmt: skip
def test_references_that_are_none(change, words):
    with pytest.raises((UsageError, ValueError), match=words):
        LoadReference(**(GOOD | change))
