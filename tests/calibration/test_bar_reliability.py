"""What known distances do not tell of each other's errors, and that it is said of a good network."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.calibration import Calibration, Distance, Fixed, Free, self_calibrate
from windmark.pipeline.verdict.network import _unchecked

SIGMA = 0.02


@pytest.fixture(scope="module")
def case():
    return networks.make(3, points=60, views=8)


def ends(case, length, taken=()):
    """Two markers that are about so far apart."""
    xyz = case.truth.points
    far = np.linalg.norm(xyz[:, None] - xyz, axis=2)
    far[list(taken)] = far[:, list(taken)] = np.inf
    return divmod(int(np.abs(far - length).argmin()), len(xyz))


def run(case, pairs, off=(0.0, 0.0, 0.0), datum=None):
    """With distances that are known exactly but for ``off``."""
    observations, markers, cameras, views, _ = networks.nouns(case, camera=networks.CAMERA)
    xyz = case.truth.points
    bars = [
        Distance(str(markers.name[a]), str(markers.name[b]), float(np.linalg.norm(xyz[a] - xyz[b])) + o, SIGMA)
        for (a, b), o in zip(pairs, off, strict=False)
    ]
    return self_calibrate(
        observations, replace(markers, length_unit="mm"), cameras, views, datum=Free() if datum is None else datum,
        free=(), distances=bars,
    )  # fmt: skip


def size(result):
    return float(np.linalg.norm(result.markers.xyz - result.markers.xyz.mean(axis=0)))


def test_an_error_of_a_long_one_beside_a_short_one_is_one_of_all_lengths_and_said(case):
    short = ends(case, 30)
    pairs = [short, ends(case, 500, short)]
    right = run(case, pairs)
    assert right.doubts == ()
    (worst,) = right.hardly_checked_bars
    assert (worst.first, worst.second) == tuple(str(right.markers.name[k]) for k in pairs[1])
    assert worst.share < 0.01
    assert f"the known distance {worst.first} to {worst.second}: an error of up to" in right.unchecked
    words, advice = _unchecked(right)
    assert words == f"; {right.unchecked}"
    assert "a further known distance" in advice
    wrong = run(case, pairs, (0.0, 0.5 * worst.error))
    assert isinstance(wrong, Calibration)
    assert wrong.doubts == ()  # nothing shows
    assert size(wrong) / size(right) - 1 == pytest.approx(0.5 * worst.scale, rel=0.1)
    noticed = run(case, pairs, (0.0, 1.6 * worst.error))
    assert not noticed or noticed.doubts


def test_distances_that_check_each_other_are_not_named(case):
    first = ends(case, 400)
    second = ends(case, 410, first)
    assert run(case, [first, second]).hardly_checked_bars == ()
    assert run(case, [first, second, ends(case, 390, (*first, *second))]).unchecked == ""


def test_what_holds_the_scale_by_itself_is_not_named(case):
    """The only distance of a free network, in proportion to which all is; and markers that are held."""
    pair = ends(case, 400)
    assert run(case, [pair]).hardly_checked_bars == ()
    assert run(case, [pair], datum=Fixed()).unchecked == ""
