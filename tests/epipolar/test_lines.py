"""Matching along epipolar lines without camera parameters."""

import numpy as np
import pytest

from windmark.epipolar import match_along_lines


def views(seed=0, n=80):
    """Two nearly affine views of a curved sheet, spots shuffled."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 1000, (4 * n, 2))
    kept: list[int] = []
    for i, p in enumerate(xy):
        if len(kept) < n and (not kept or np.linalg.norm(xy[kept] - p, axis=1).min() > 45):
            kept.append(i)
    a = xy[kept]
    depth = 40 * np.sin(a[:, 0] / 300) + 0.05 * a[:, 1]
    b = a @ np.array([[0.97, 0.1], [-0.08, 1.02]]) + np.column_stack([depth, 0.2 * depth])
    order = rng.permutation(len(a))
    return a, b[order], np.argsort(order)


def test_it_grows_from_a_few_and_takes_no_wrong_one():
    a, b, partner = views()
    known = np.array([0, 9, 22, 41, 60, 71])
    off = b[None] - b[partner][:, None]
    allowed = np.abs(off @ np.array([-0.196, 0.981])) < 2.0  # the lines run along the parallax
    i, j = match_along_lines(a, b, known, partner[known], allowed)
    assert (partner[i] == j).all()
    assert len(i) > 0.7 * len(a)
    assert set(known) <= set(i.tolist())


def test_a_spot_that_is_missing_there_stays_open():
    a, b, partner = views()
    gone = partner[[30, 50]]
    keep = np.setdiff1d(np.arange(len(b)), gone)
    known = np.array([0, 9, 22, 41, 60, 71])
    number = np.full(len(b), -1)
    number[keep] = np.arange(len(keep))
    off = b[keep][None] - b[partner][:, None]
    allowed = np.abs(off @ np.array([-0.196, 0.981])) < 2.0
    i, j = match_along_lines(a, b[keep], known, number[partner[known]], allowed)
    assert not {30, 50} & set(i.tolist())
    assert (number[partner[i]] == j).all()


def test_three_known_ones_are_needed():
    a, b, _ = views()
    with pytest.raises(ValueError, match="at least three"):
        match_along_lines(a, b, np.array([0, 1]), np.array([0, 1]), np.ones((len(a), len(b)), bool))
