"""What counts as determined: both sides of a natural unit and of rounding, and who is named."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.adjust import covariance, weak_parameters
from windmark.geometry import DegenerateGeometry

NAMES = ("a", "b", "c")


def system(information, natural=None):
    return SimpleNamespace(information=np.array(information, float), natural=np.eye(3) if natural is None else natural)


def of_sigmas(*sigma):
    return system(np.diag(1 / np.array(sigma) ** 2))


@pytest.mark.parametrize("small", [1e-6, 1e-2])
def test_a_parameter_is_weak_where_two_sigma_are_more_than_a_natural_unit(small):
    assert weak_parameters(of_sigmas(small, 0.49, small), NAMES) == ()
    assert weak_parameters(of_sigmas(small, 0.51, small), NAMES) == ("b",)
    # Three that are each determined are so together, whatever their variances add up to.
    assert weak_parameters(of_sigmas(0.45, 0.45, 0.45), NAMES) == ()


def test_a_direction_names_all_that_it_is_made_of():
    """Sum known, difference not: two parameters are named, the third is not."""
    both, apart = np.array([1.0, 1, 0]) / np.sqrt(2), np.array([1.0, -1, 0]) / np.sqrt(2)
    h = 1e4 * np.outer(both, both) + 1e4 * np.diag([0.0, 0, 1])
    for known in (0.0, 1 / 0.6**2):
        assert weak_parameters(system(h + known * np.outer(apart, apart)), NAMES) == ("a", "b")
    assert weak_parameters(system(h + np.outer(apart, apart) / 0.4**2), NAMES) == ()
    # A little of a third one in it is not named.
    tilted = np.array([1.0, -1.0, 0.1]) / np.sqrt(2.01)
    rest = np.eye(3) - np.outer(tilted, tilted)
    assert weak_parameters(system(1e4 * rest), NAMES) == ("a", "b")
    assert weak_parameters(system(np.zeros((3, 3))), NAMES) == NAMES


def test_a_tight_prior_makes_nothing_else_look_weak():
    assert weak_parameters(of_sigmas(1e-9, 0.1, 0.1), NAMES) == ()


def test_covariance_is_the_inverse_in_the_users_units():
    rng = np.random.default_rng(2)
    root, natural = rng.normal(size=(3, 5)) * 10, np.diag([2.0, 30.0, 0.1])
    h = root @ root.T
    got = covariance(system(h, natural), NAMES)
    np.testing.assert_allclose(got, natural @ np.linalg.inv(h) @ natural.T, rtol=1e-6)
    other = rng.normal(size=(3, 3))
    noise = other @ other.T
    sandwich = natural @ np.linalg.inv(h) @ noise @ np.linalg.inv(h) @ natural.T
    np.testing.assert_allclose(covariance(system(h, natural), NAMES, noise), sandwich, rtol=1e-5)
    with pytest.raises(DegenerateGeometry) as error:
        covariance(of_sigmas(0.1, 0.1, 0.7), NAMES)
    assert error.value.weak == ("c",)
