"""Labels by place, false spots, changed tables, lines within pictures, lamps: small parts of the tasks."""

import numpy as np
import pytest
from scipy import stats

import windmark as wm
from windmark.errors import DataError, UsageError
from windmark.tasks.clicked_pair.lines import _segment
from windmark.tasks.deform.between import lagrange
from windmark.tasks.labels import excluded_spots, fixed_spots
from windmark.tasks.odd import nearest_spots, together
from windmark.tasks.psp.lamps import LEAST, Lamp, lit
from windmark.tasks.unexplained import LARGE, _others

SPOTS = wm.Detections.make([[10.0, 10.0], [30.0, 10.0], [30.0, 40.0]])


def test_a_label_means_the_nearest_spot_within_reach():
    assert fixed_spots(SPOTS, {"a": (12.0, 11.0), "b": (30.0, 37.0)}, 3.0) == {0: "a", 2: "b"}
    assert fixed_spots(SPOTS, {"b": (30.0, 37.01)}, 3.0) == {2: "b"}
    with pytest.raises(
        DataError, match=r"label b: no spot within 3 px of \(30, 36.9\); the nearest is 3.1 px away, at \(30.0, 40.0\)"
    ):
        fixed_spots(SPOTS, {"b": (30.0, 36.9)}, 3.0)
    with pytest.raises(UsageError, match=r"label c: the spot at \(10.0, 10.0\) is a already"):
        fixed_spots(SPOTS, {"a": (10.0, 10.0), "c": (11.0, 10.0)}, 3.0)
    with pytest.raises(DataError, match=r"exclude: no spot at \(1, 2\); none was detected"):
        excluded_spots(SPOTS.take([]), [(1.0, 2.0)], 3.0)
    assert excluded_spots(SPOTS, [(30.0, 41.0), (10.0, 9.0), (30.0, 39.0)], 3.0).tolist() == [0, 2]
    assert excluded_spots(SPOTS, [], 3.0).dtype == np.int64
    with pytest.raises(UsageError, match=r"exclude: the spot at \(10.0, 10.0\) has the label a; take the label or"):
        excluded_spots(SPOTS, [(10.0, 9.0)], 3.0, {0: "a"})
    assert excluded_spots(SPOTS, [(10.0, 9.0)], 3.0, {1: "a"}).tolist() == [0]


def test_chances_of_false_spots_are_uniform_where_nothing_belongs_together():
    """Places and spots at random. 400 pictures; the tenth that should be below 0.1 is known to 0.015."""
    rng = np.random.default_rng(1)
    size, chances = (600, 400), []
    for _ in range(400):
        spots = rng.uniform([0, 0], size, (12, 2))
        place = rng.uniform([150, 100], [450, 300], (1, 2))
        distance, chance = nearest_spots(place, spots, size)
        assert distance[0] == pytest.approx(np.hypot(*(spots - place).T).min())
        chances.append(chance[0])
    for level in (0.05, 0.1):
        # The circle is a union bound: what is drawn is no more, and little less.
        assert 0.6 * level < np.mean(np.array(chances) < level) < 1.4 * level
    assert max(chances) <= 1.0
    for none in (nearest_spots(np.ones((2, 2)), np.zeros((0, 2)), size), nearest_spots(np.zeros((0, 2)), spots, size)):
        assert np.isinf(none[0]).all()
        assert (none[1] == 1.0).all()


@pytest.mark.parametrize("count", [1, 3, 8])
def test_together_pictures_are_as_likely_as_fisher_says(count):
    chances = np.random.default_rng(count).random((3000, count))
    found = np.array([together(c) for c in chances])
    assert stats.kstest(found, "uniform").statistic < 0.025  # 3000 draws, one in twenty
    assert together([0.0]) < 1e-200
    assert together([0.3]) == pytest.approx(0.3)


def test_tables_that_are_tried_where_no_pose_explains_the_spots():
    xyz = np.array([[0.0, 0, 0], [100, 0, 0], [0, 0, 0], [0, 0, 5.0]])
    bare = wm.MarkerSet.make(list("abcd"), xyz)
    assert [cause for cause, _, _ in _others(bare)] == ["mirrored"]
    full = wm.MarkerSet.make(list("abcd"), xyz, normal=np.tile([0.6, 0, 0.8], (4, 1)))
    mirrored, discs = (other for _, other, _ in _others(full))
    np.testing.assert_array_equal(mirrored.xyz, xyz * [-1, 1, 1])
    np.testing.assert_allclose(mirrored.normal, full.normal * [-1, 1, 1])
    np.testing.assert_allclose(discs.normal, -full.normal)
    np.testing.assert_array_equal(discs.xyz, xyz)
    extent = np.linalg.norm([100.0, 0, 5])
    for part, tried in ((0.98, False), (1.02, True)):
        unsure = wm.MarkerSet.make(list("abcd"), xyz, sigma=part * LARGE * extent)
        causes = [cause for cause, _, _ in _others(unsure)]
        assert causes == (["mirrored", "misfit"] if tried else ["mirrored"])
    other, words = _others(unsure)[1][1:]
    assert np.isnan(other.sigma).all()
    assert "typically 0.3 % of their extent" in words


@pytest.mark.parametrize("seed", range(3))
def test_lines_are_cut_at_the_borders_of_the_picture(seed):
    rng = np.random.default_rng(seed)
    size, low, high = (60, 40), np.array([-0.5, -0.5]), np.array([59.5, 39.5])
    through = 0
    for _ in range(60):
        line = np.array([*rng.normal(size=2), rng.uniform(-40, 40)])
        part = _segment(line, size)
        x = np.linspace(-300, 400, 20001)
        points = np.stack([x, -(line[0] * x + line[2]) / line[1]], axis=1)
        inside = ((points >= low) & (points <= high)).all(axis=1)
        assert (len(part) == 2) >= bool(inside.any())
        if len(part):
            through += 1
            np.testing.assert_allclose(part @ line[:2] + line[2], 0.0, atol=1e-9)
            assert (np.abs(part - low).min(axis=1) < 1e-9).sum() + (np.abs(part - high).min(axis=1) < 1e-9).sum() >= 2
            assert ((part >= low - 1e-9) & (part <= high + 1e-9)).all()
    assert through > 10
    np.testing.assert_allclose(np.sort(_segment(np.array([1.0, 0.0, -7.0]), size), axis=0), [[7, -0.5], [7, 39.5]])
    np.testing.assert_allclose(np.sort(_segment(np.array([0.0, 2.0, -8.0]), size), axis=0), [[-0.5, 4], [59.5, 4]])
    assert _segment(np.array([1.0, 0.0, 7.0]), size).shape == (0, 2)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_weights_of_pictures_round_an_instant_are_exact_for_polynomials(count):
    rng = np.random.default_rng(count)
    times, instant = np.sort(rng.uniform(0, 1, count)).tolist(), 0.37
    weight = lagrange(times, instant)
    for power in range(count):
        assert weight @ np.power(times, power) == pytest.approx(instant**power)


def test_light_of_lamps_falls_with_the_square_of_the_distance_and_the_angle():
    x, y = np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 5))
    k = np.arange(25).reshape(5, 5)
    a, b, c, d = k[:-1, :-1].ravel(), k[:-1, 1:].ravel(), k[1:, 1:].ravel(), k[1:, :-1].ravel()
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    mesh = wm.Mesh.make(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), triangles)
    lamps = [Lamp((0.5, 0.2, 2.0), 3.0), Lamp((-1.0, 0.0, 1.0)), Lamp((0.0, 0.0, -1.0), 100.0)]  # the last one below
    expected = 0.0
    for lamp in lamps[:2]:
        away = np.array(lamp.position) - mesh.vertices
        distance = np.linalg.norm(away, axis=1)
        expected = expected + lamp.power * (away[:, 2] / distance) / distance**2
    np.testing.assert_allclose(lit(mesh, lamps), expected)
    assert np.isnan(lit(mesh, lamps[2:])).all()
    np.testing.assert_array_equal(lit(mesh, []), np.ones(25))
    far = lit(mesh, [Lamp((-1.0, -1.0, 0.05))])
    light = 0.05 / np.linalg.norm(mesh.vertices - [-1.0, -1.0, 0.05], axis=1) ** 3
    np.testing.assert_array_equal(np.isfinite(far), light > LEAST * light.max())
