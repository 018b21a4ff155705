"""Emissivity by the viewing angle, against Snell's and Fresnel's laws, and tables that are none."""

import numpy as np
import pytest

from windmark.errors import UsageError
from windmark.paint import EmissivityTable, dielectric_emissivity


@pytest.mark.parametrize("index", [1.3, 1.5, 2.4])
def test_emissivity_is_what_passes_the_surface(index):
    angle = np.radians(np.linspace(0.0, 89.0, 30))
    inside = np.arcsin(np.sin(angle) / index)
    across = ((np.cos(angle) - index * np.cos(inside)) / (np.cos(angle) + index * np.cos(inside))) ** 2
    along = ((np.cos(inside) - index * np.cos(angle)) / (np.cos(inside) + index * np.cos(angle))) ** 2
    passed = 1 - (across + along) / 2
    got = dielectric_emissivity(np.degrees(angle), 0.9, index)
    np.testing.assert_allclose(got, 0.9 * passed / passed[0], rtol=1e-12)
    # What is polarised along the plane of incidence passes whole at Brewster's angle.
    brewster = np.arctan(index)
    only = 1 - (np.cos(2 * brewster) ** 2) / 2
    assert dielectric_emissivity(np.degrees(brewster), passed[0], index) == pytest.approx(only)


def test_angles_beyond_the_horizon_are_at_it_and_paint_is_like_glass():
    np.testing.assert_allclose(dielectric_emissivity([90.0, 120.0], 0.9), 0.0, atol=1e-12)
    assert dielectric_emissivity(-5.0, 0.9) == 0.9
    # Glass reflects 8.9 % at 60 degrees, and 4 % straight on.
    assert dielectric_emissivity(60.0, 0.96) == pytest.approx(0.911, abs=0.001)


@pytest.mark.parametrize(("normal", "index"), [(0.0, 1.5), (1.01, 1.5), (np.nan, 1.5), (0.9, 1.0), (0.9, np.nan)])
def test_what_no_paint_has(normal, index):
    with pytest.raises(UsageError, match=r"normal must be in \(0, 1\], index above 1"):
        dielectric_emissivity(10.0, normal, index)
    assert dielectric_emissivity(0.0, 1.0) == 1.0


def test_a_table_is_straight_between_and_ends_where_it_ends():
    table = EmissivityTable([10.0, 40.0, 90.0], [1.0, 0.8, 0.1])
    np.testing.assert_allclose(table.at([10.0, 25.0, 65.0, 90.0]), [1.0, 0.9, 0.45, 0.1])
    assert np.isnan(table.at([9.99, 90.01])).all()
    assert EmissivityTable([0.0, 90.0], [0.9, 0.1]).at(0.0) == 0.9


@pytest.mark.parametrize(
    ("angle", "emissivity", "words"),
    [
        ([0.0, 10.0], [0.9], r"must be \(N,\), got \(2,\), \(1,\)"), ([[0.0, 1.0]], [[0.9, 0.8]], r"must be \(N,\)"),
        ([5.0], [0.9], "at least two angles, got 1"), ([0.0, 0.0], [0.9, 0.9], "must rise"),
        ([-1.0, 10.0], [0.9, 0.9], "must rise"), ([0.0, 90.5], [0.9, 0.9], "must rise"),
        ([0.0, 10.0], [0.0, 0.9], "above 0 and at most 1"), ([0.0, 10.0], [0.9, 1.1], "above 0 and at most 1"),
    ],
)  # fmt: skip
def test_tables_that_are_none(angle, emissivity, words):
    with pytest.raises(ValueError, match=words):
        EmissivityTable(angle, emissivity)
