"""What a picture's candidates say of each other: discs among other things, families, and other things alone."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import windmark as wm
from windmark.detection.company import RIVAL_NATS, are_others, odds_of_discs

RNG = np.random.default_rng(11)


def things(count, nats, size=(1.0, 3.0), contrast=(0.3, 1.0)):
    """Nats about a mean, sizes and contrasts of a range."""
    return (RNG.normal(nats, 0.5, count), np.exp(RNG.uniform(*np.log(size), count)),
            np.exp(RNG.uniform(*np.log(contrast), count)))  # fmt: skip


def judged(*groups, asked=True):
    """Share of each group that is another thing."""
    nats, size, contrast = (np.concatenate(part) for part in zip(*groups, strict=True))
    other = are_others(nats, size, contrast, np.full(len(nats), asked))
    return [float(part.mean()) for part in np.split(other, np.cumsum([len(g[0]) for g in groups])[:-1])]


def test_discs_alone_are_judged_as_ever():
    """Also where there are few, and worn ones; what says nothing is left alone."""
    nats = np.array([-2.0, -2.0, -2.0, 2.0, RIVAL_NATS + 0.1, np.nan])
    assert are_others(nats, np.ones(6), np.ones(6), np.ones(6, dtype=bool)).tolist() == [False] * 4 + [True, False]
    assert odds_of_discs(np.full(500, -2.0)) == pytest.approx(RIVAL_NATS)
    assert odds_of_discs(np.empty(0)) == pytest.approx(RIVAL_NATS)
    assert are_others(np.array([2.0]), np.ones(1), np.ones(1), np.ones(1, dtype=bool)).tolist() == [False]


def test_those_that_look_least_like_the_other_things_are_of_them():
    """Of 400 letters 40 are hardly told from discs: each alone would be one."""
    clear, tail = things(360, 12.0), things(40, 1.0)
    assert judged(tail)[0] < 0.2
    sure, unsure = judged(clear, tail)
    assert sure == 1.0
    assert unsure > 0.9
    assert odds_of_discs(np.concatenate([clear[0], tail[0]])) < -2.0


def test_discs_that_show_their_shape_are_discs_in_any_company():
    others, discs = things(400, 12.0), things(15, -6.0)
    assert judged(others, discs) == [1.0, 0.0]


@pytest.mark.parametrize("sizes", [(2.0,), (1.5, 2.4)])
def test_small_discs_are_known_by_their_family(sizes):
    """Pixels say next to nothing; letters of the same range of sizes and contrasts say as little."""
    others, tail = things(250, 12.0), things(60, -0.3)
    families = [things(20, -1.0, (0.97 * s, 1.03 * s), (0.68, 0.72)) for s in sizes]
    clear, small, *discs = judged(others, tail, *families)
    assert clear == 1.0
    assert small > 0.6
    assert max(discs) <= 0.05


def test_those_that_are_not_asked_speak_for_themselves():
    assert judged(things(360, 12.0), things(40, 1.0), asked=False)[1] == 0.0


def squares(size=(400, 500), half=(1.9, 3.4), seed=3):
    """Squares of any angle, 7 x 7 sub-pixels, blurred a little."""
    rng, sub = np.random.default_rng(seed), (np.arange(7) - 3) / 7.0
    share = np.ones(size)
    for y in range(16, size[0] - 15, 22):
        for x in range(16, size[1] - 15, 22):
            v, u = (rng.uniform(-0.5, 0.5) + np.arange(-8, 9)[:, None] + sub for _ in range(2))
            turn, side = rng.uniform(0, np.pi), rng.uniform(*half)
            a = u.ravel() * np.cos(turn) + v.ravel()[:, None] * np.sin(turn)
            b = v.ravel()[:, None] * np.cos(turn) - u.ravel() * np.sin(turn)
            inside = (abs(a) <= side) & (abs(b) <= side)
            share[y - 8 : y + 9, x - 8 : x + 9] *= 1.0 - 0.7 * inside.reshape(17, 7, 17, 7).mean(axis=(1, 3))
    return np.round(150.0 * gaussian_filter(share, 0.6) + rng.normal(0, 2.0, size)).astype(np.uint8)


def test_a_picture_of_small_squares_has_no_markers():
    """The smallest of them were taken: their corners are hardly seen."""
    assert len(wm.detect(squares(), radius_px=3.0)) == 0
