from __future__ import annotations

import numpy as np
import pytest

from windmark.synth.marks import Clutter, Marks, distance, draw, join, scatter


def test_distance_to_points_segments_and_rectangles():
    m = Marks.make(
        [[0, 0], [10, 0], [0, 10]], half=[[0, 0], [3, 0], [2, 1]], angle=[0, np.pi / 2, 0], outer=1, contrast=1
    )
    np.testing.assert_allclose(distance(m, np.array([3.0, 4.0]))[0], 5)
    np.testing.assert_allclose(distance(m, np.array([[10.0, 7.0], [12, 2]]))[:, 1], [4, 2], atol=1e-12)
    np.testing.assert_allclose(
        distance(m, np.array([[0.0, 10.0], [5, 14], [1.5, 10]]))[:, 2], [-1, np.hypot(3, 3), -0.5]
    )


@pytest.mark.parametrize(
    ("shape", "area"),
    [
        ({"outer": 3.3}, np.pi * 3.3**2),
        ({"outer": 0.2}, np.pi * 0.2**2),
        ({"outer": 4.0, "inner": 2.5}, np.pi * (16 - 6.25)),
        ({"outer": 0.15, "half": (9, 0), "angle": 0.7}, 18 * 0.3 + np.pi * 0.15**2),
        ({"outer": 0.1, "half": (6, 4), "angle": 0.3}, 12 * 8 + 40 * 0.1 + np.pi * 0.01),
    ],
)
def test_drawn_area_is_exact(shape, area):
    image = draw(np.ones((41, 41)), Marks.make([20.2, 19.7], contrast=0.6, **shape), subpixels=11)
    assert (1 - image).sum() / 0.6 == pytest.approx(area, rel=0.02, abs=0.003)
    assert image.min() > 0.4 - 1e-12


def test_marks_multiply_and_may_leave_the_image():
    m = Marks.make([[5, 5], [5, 5], [-50, 5], [0, 0]], outer=[3, 3, 2, 2], contrast=[0.5, 0.5, 0.9, 0.2])
    out = draw(np.full((11, 11), 2.0), m)
    assert out[5, 5] == pytest.approx(0.5)
    assert out[0, 0] == pytest.approx(1.6)
    with pytest.raises(ValueError, match="image"):
        draw(np.ones(5), m)


def test_turned_keeps_shapes():
    m = Marks.make([[3, 0], [0, 2]], half=(2, 0), outer=0.5, contrast=1)
    t = m.turned(np.pi / 2, [10, 20])
    np.testing.assert_allclose(t.center, [[10, 23], [8, 20]], atol=1e-12)
    point = np.array([10.4, 25.5])
    back = np.array([5.5, -0.4])
    np.testing.assert_allclose(distance(t, point), distance(m, back), atol=1e-12)


def test_scatter_leaves_out_what_finds_no_room():
    items = [Marks.make([0, 0], outer=1.0, contrast=0.5) for _ in range(5)]
    rng = np.random.default_rng(0)
    assert len(scatter(items, (20, 20), rng)) == 5
    assert len(scatter(items, (20, 20), rng, keep_clear=[[10, 10]], clearance_px=100)) == 0
    assert len(join([])) == 0


def test_items_have_the_counts_asked_for():
    assert len(Clutter(1, 2, 3, 4, 5, 6, 7).items(np.random.default_rng(0), 4.0)) == 28
