"""2D alignment of a model with a part that moves by itself: said, and in the sigma of the places on it."""

import numpy as np
import pytest

import windmark as wm
from windmark.scene import Detections
from windmark.tasks.align2d.apart import moved_together, of_parts, parts_apart

SIZE = (600, 800)
PICTURE = np.zeros(SIZE, np.uint8)
SIGMA = 0.02
NONE = np.empty((0, 2))


def markers(seed, count=60):
    rng = np.random.default_rng(seed)
    return rng, rng.uniform([20, 20], [780, 580], (count, 2))


def aligned(rng, x, y, **options):
    """Alignment of two empty pictures by marks with noise."""
    spots = [Detections.make(at + rng.normal(0, SIGMA, at.shape), sigma_px=SIGMA) for at in (x, y)]
    found = wm.align_images(PICTURE, PICTURE, reference_detections=spots[0], detections=spots[1], **options)
    assert found
    return found


def off_by_sigma(found, x, y):
    """Distance of places from where they are, in the picture of sigmas."""
    column, row = x.astype(int).T
    return np.hypot(*(found.transform.apply(x) - y).T) / found.sigma_map()[row, column]


@pytest.mark.parametrize("by", [(3.0, 0.0), (0.0, 6.0), (-4.0, 12.0), (20.0, -25.0), (5.0, 60.0)])
def test_a_part_that_moves_by_itself_is_found_at_any_distance(by):
    for seed in (1, 3):
        rng, x = markers(seed)
        part = x[:, 0] > 690
        y = x + np.array([4.0, 2.0]) + np.outer(part, by)
        found = aligned(rng, x, y)
        said = np.concatenate([found.rejected[rows, 0] for rows in found.apart])
        assert set(said) <= set(np.flatnonzero(part))
        assert len(said) >= part.sum() - 1  # one may leave the picture, or lie where another one is expected
        assert off_by_sigma(found, x[part], y[part]).max() < 5
        alone = off_by_sigma(found, x[~part], y[~part])
        assert (np.median(alone) < 2, np.hypot(*found.residual.T).max() < 0.2) == (True, True)


def test_wrong_pairs_bending_and_walls_are_no_parts():
    for seed in range(2):
        rng, x = markers([7, seed])
        bent = x + np.array([5.0, 3.0]) + np.column_stack([np.zeros(len(x)), 4e-5 * (x[:, 0] - 300) ** 2])
        assert aligned(rng, x, bent).apart == []
        wrong = x + np.array([5.0, 3.0])
        wrong[::15] += rng.uniform(-8, 8, (4, 2))
        found = aligned(rng, x, wrong)
        assert (len(found.rejected) >= 3, found.apart) == (True, [])
        far = np.array([31.0, 17.0])
        wall = rng.uniform([0, 0], [800, 600], (12, 2))
        beside = aligned(rng, np.vstack([x, wall]), np.vstack([x + far, wall]))
        assert (beside.apart, len(beside.still) >= 10) == ([], True)
        # Where they are said to be on the model, they are what moved against the others.
        told = aligned(rng, np.vstack([x, wall]), np.vstack([x + far, wall]), keep_still=True)
        assert (len(told.still), sum(len(p) for p in told.apart) >= 10) == (0, True)


def test_neighbours_that_are_off_alike_are_a_part():
    x = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0], [500.0, 500.0], [10.0, 10.0]])
    off = np.array([[4.0, 0.0], [4.5, 0.2], [3.8, -0.3], [4.0, 0.0], [-4.0, 0.0]])
    others = np.array([[250.0, 0.0], [0.0, 250.0], [510.0, 500.0], [500.0, 510.0], [490.0, 500.0], [500.0, 490.0]])
    sigma = np.full(5, 0.01)
    assert [set(p) for p in parts_apart(x, off, sigma, others)] == [{0, 1, 2, 3}]
    # Two are a part only where they agree better: chance makes two more often than three.
    assert parts_apart(x[:2], off[:2], sigma[:2], others) == []
    assert [len(p) for p in parts_apart(x[:2], off[[0, 0]], sigma[:2], others)] == [2]
    assert [len(p) for p in parts_apart(x[:2], off[:2], np.full(2, 0.2), others)] == [2]
    assert parts_apart(x[:1], off[:1], sigma[:1], others) == []


def test_places_nearer_to_the_part_than_to_the_others_are_in_doubt():
    x, others = np.array([[100.0, 0.0], [100.0, 50.0]]), np.array([[0.0, 0.0], [0.0, 50.0]])
    off = np.array([[6.0, 0.0], [0.0, 8.0]])
    at = np.array([[90.0, 0.0], [90.0, 50.0], [10.0, 0.0], [45.0, 0.0], [30.0, 0.0]])
    np.testing.assert_allclose(of_parts(at, x, off, [np.array([0, 1])], others), [18.0, 32.0, 0.0, 18.0, 0.0])
    np.testing.assert_array_equal(of_parts(at, x, off, [], others), np.zeros(5))


def test_spots_without_a_partner_move_together_or_by_chance():
    rng = np.random.default_rng(5)
    area = float(SIZE[0] * SIZE[1])
    expected = rng.uniform([600, 100], [700, 400], (6, 2))
    seen = np.vstack([rng.uniform([0, 0], [800, 600], (8, 2)), expected[::-1] + np.array([31.0, -17.0])])
    np.testing.assert_array_equal(np.sort(moved_together(expected, seen, area, NONE), axis=0)[:, 0], np.arange(6))
    pairs = moved_together(expected, seen, area, NONE)
    np.testing.assert_allclose(seen[pairs[:, 1]] - expected[pairs[:, 0]], np.tile([31.0, -17.0], (6, 1)))
    # What is where it is expected has not moved by itself, and what is anywhere is chance.
    assert len(moved_together(expected, expected + rng.normal(0, 0.3, (6, 2)), area, NONE)) == 0
    assert len(moved_together(expected[:2], seen, area, NONE)) == 0
    for _ in range(50):
        some, other = (rng.uniform([0, 0], [800, 600], (30, 2)) for _ in range(2))
        assert len(moved_together(some, other, area, NONE)) == 0


def test_gaps_of_a_regular_layout_have_not_moved_by_its_pitch():
    """A strut hides one column of markers wind-off, and the one beside it wind-on."""
    rng = np.random.default_rng(8)
    x = np.stack(np.meshgrid(60 + 60.0 * np.arange(11), 60 + 60.0 * np.arange(9)), axis=-1).reshape(-1, 2)
    first, second = (np.abs(x[:, 0] - column) > 1 for column in (300, 360))
    y = x + np.array([3.0, 2.0])
    spots = [Detections.make(at + rng.normal(0, SIGMA, at.shape), sigma_px=SIGMA) for at in (x[first], y[second])]
    found = wm.align_images(PICTURE, PICTURE, reference_detections=spots[0], detections=spots[1], max_shift_px=20)
    assert found
    assert (found.apart, len(found.rejected)) == ([], 0)


def test_a_part_that_turns_by_itself_is_named():
    """No two of its markers moved alike."""
    for seed in range(2):
        rng, x = markers([9, seed])
        part = x[:, 0] > 650
        middle = x[part].mean(axis=0)
        y = x + np.array([4.0, 2.0])
        y[part] += (x[part] - middle) @ np.array([[0.0, 0.06], [-0.06, 0.0]])
        found = aligned(rng, x, y)
        said = np.concatenate([found.rejected[rows, 0] for rows in found.apart])
        assert set(said) <= set(np.flatnonzero(part))
        assert len(said) >= 0.7 * part.sum()  # those beside its middle have hardly moved


def test_a_wing_that_bends_beside_a_rigid_body_is_no_part():
    """Markers in rows: with nothing between stations, two motions predict each other's markers as well."""
    x = np.stack(np.meshgrid(np.linspace(30, 770, 7), np.linspace(30, 570, 7)), axis=-1).reshape(-1, 2)
    bent = np.clip((x[:, 0] - 480) / 320, 0, None)
    y = x + np.array([3.0, -4.0]) + np.column_stack([np.zeros(len(x)), 3.5 * bent**2])
    found = aligned(np.random.default_rng(0), x, y, max_shift_px=40)
    assert (found.kind, len(found.rejected), found.apart) == ("spline", 0, [])
    assert np.hypot(*(found.transform.apply(x) - y).T).max() < 0.15
