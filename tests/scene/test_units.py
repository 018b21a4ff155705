"""Which units numbers are in that do not fit each other, and by what nearly all of some ratios are off."""

import numpy as np
import pytest

from windmark.scene.units import (
    ALIKE,
    IN_MM,
    IN_WORDS,
    LENGTH_UNITS,
    RIM_PX,
    common_ratio,
    mixed_units,
    off_by,
    radii_words,
)


def test_units_are_those_of_the_international_agreement():
    assert IN_MM["mm"] == 1.0
    assert IN_MM["in"] == 25.4  # by definition, since 1959
    assert IN_MM["ft"] == pytest.approx(12 * IN_MM["in"])
    assert (IN_MM["cm"], IN_MM["m"]) == (10.0, 1000.0)
    assert set(IN_WORDS.values()) == set(LENGTH_UNITS)


@pytest.mark.parametrize("place", LENGTH_UNITS)
@pytest.mark.parametrize("radius", LENGTH_UNITS)
def test_every_pair_of_units_is_told_where_one_is_known(place, radius):
    factor = IN_MM[radius] / IN_MM[place]
    if place == radius:
        assert mixed_units(1.0, place) is None
        return
    for off in (1.0, 1.1, 1 / 1.1):
        assert mixed_units(factor * off, place) == (place, radius)


def test_factors_between_the_pairs_are_none():
    """12 (ft and in) and 10 (cm and mm) are near; 12 * 1.29 is still the former, beyond ALIKE it is nobody's."""
    assert mixed_units(12 * 0.99 * ALIKE, "in") == ("in", "ft")
    assert mixed_units(12 * 1.01 * ALIKE, "in") is None
    assert mixed_units(2.0, "mm") is None
    assert mixed_units(25.4 * 1.25, "mm") == ("mm", "in")
    assert mixed_units(25.4 * 1.4, "mm") is None
    assert mixed_units(25.4 / 1.25, "mm") == ("mm", "in")


def test_ratios_on_one_side_are_off_by_the_quartile_that_is_nearer_to_one():
    large = np.array([2.0, 2.1, 2.2, 2.3, 2.4])
    assert off_by(large, 3) == pytest.approx(np.percentile(large, 25))
    assert off_by(1 / large, 3) == pytest.approx(np.percentile(1 / large, 75))
    assert off_by(np.array([0.5, 0.6, 0.9, 1.8, 2.0]), 3) == 1.0
    assert off_by(np.array([0.5, 0.5, 0.5, 3.0, 0.5]), 3) == 0.5  # one that is another thing does not count


def test_what_is_unknown_does_not_count_and_few_say_nothing():
    ratios = np.array([3.0, 3.0, np.nan, np.inf, -1.0, 0.0])
    assert off_by(ratios, 2) == 3.0
    assert off_by(ratios, 3) == 1.0
    assert off_by(np.zeros(0), 1) == 1.0


@pytest.mark.parametrize(
    ("ratio", "place", "words"),
    [
        (25.4, "mm", "25.4 times too small for the imaged markers: radii in inch beside places in mm?"),
        (1 / 25.4, "in", "25.4 times too large for the imaged markers: radii in mm beside places in inch?"),
        (0.5, "mm", "2 times too large for the imaged markers; diameters in their place?"),
        (2.0, "mm", "2 times too small for the imaged markers; another unit, or something else than radii?"),
        (1 / 1.85, "mm", "1.85 times too large for the imaged markers; diameters in their place?"),
        (1 / 2.15, "mm", "2.15 times too large for the imaged markers; diameters in their place?"),
        (1 / 1.75, "mm", "1.75 times too large for the imaged markers; another unit, or something else than radii?"),
        (1 / 2.05, "in", "2.05 times too large for the imaged markers; diameters in their place?"),
        (2.1, "cm", "2.1 times too small for the imaged markers; another unit, or something else than radii?"),
        (1 / 2.25, "in", "2.25 times too large for the imaged markers: radii in cm beside places in inch?"),
        (1 / 2.25, "ft", "2.25 times too large for the imaged markers; another unit, or something else than radii?"),
        (2.3, "in", "2.3 times too small for the imaged markers; another unit, or something else than radii?"),
        (1.7, "mm", "1.7 times too small for the imaged markers; another unit, or something else than radii?"),
    ],
)
def test_radii_that_do_not_fit_are_explained(ratio, place, words):
    assert radii_words(ratio, place) == f"the table's radii are {words}"


def test_the_common_ratio_is_as_uncertain_as_scatter_and_rims_are():
    rng = np.random.default_rng(3)
    ratios = 1.2 * np.exp(rng.normal(0, 0.05, 400))
    found = common_ratio(np.append(ratios, [np.nan, 9.0]), np.full(402, 5.0), 4)
    assert found.ratio == pytest.approx(1.2, abs=0.02)
    assert found.sigma == pytest.approx(np.hypot(RIM_PX / 5, 0.05 * np.sqrt(np.pi / 800)), rel=0.05)
    assert found.is_off
    assert not common_ratio(ratios, np.full(400, 2.0), 4).is_off  # small spots: the rim
    assert not common_ratio(ratios[:3], np.full(3, 5.0), 4).is_off
