"""Which law? The right one wins, by what it predicts and by the information criteria."""

import numpy as np
import pytest

from windmark.deformation import Volume, Volumes, compare_laws
from windmark.deformation.laws import Beam, Powers
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet, Observations, View

NOISE = 0.05
CAMERA = Camera((1280, 1024), 2090.0)
MIDDLE = np.array([60.0, 250.0, 0.0])
ENDS = {"root": (60, 0, 0), "tip": (60, 500, 0)}


def wing(**shapes):
    return [Volume("wing", Beam(**ENDS, **shapes))]


CANDIDATES = {
    "rigid": [Volume("wing")],
    "bending only": wing(twist=Powers(())),
    "bending and twist": wing(),
    "too rich": wing(bend=Powers((2, 3, 4, 5)), twist=Powers((1, 2, 3, 4)), sway=Powers((2, 3))),
}
MOTION = Pose.from_rotvec(np.radians([0.3, 1.0, -0.2]), [2.0, 1.0, 8.0])


def markers():
    xyz = np.random.default_rng(2).uniform([0, 10, -8], [120, 490, 8], (40, 3))
    return MarkerSet.make([f"m{k}" for k in range(40)], xyz, volume="wing")


MARKERS = markers()


def compared(q, cameras=2, seed=0, candidates=CANDIDATES, stated=NOISE):
    """Observations of a wing that bends and twists by ``q``, from cameras 60 degrees apart; one spot is wrong."""
    rng = np.random.default_rng(seed)
    place = Volumes.of(wing()).bind(MARKERS.xyz, MARKERS.volume).place(np.array(q, dtype=float))
    views, view, xy = [], [], []
    for k, degrees in enumerate((-30, 30)[:cameras]):
        a = np.radians(degrees)
        pose = Pose.look_at(MIDDLE + 1045 * np.array([np.sin(a), 0, np.cos(a)]), MIDDLE, [1, 0, 0])
        views.append(View(f"v{k}", "c", "", pose))
        seen = CAMERA.project(pose.apply(MOTION.apply(place)))[0]
        view += [k] * len(seen)
        xy.append(seen + NOISE * rng.standard_normal(seen.shape))
    xy[0][3] += [6.0, -4.0]
    point = np.tile(np.arange(len(MARKERS)), cameras)
    cov = np.tile(stated**2 * np.eye(2), (len(view), 1, 1))
    seen = Observations(np.array(view), point, np.concatenate(xy), cov)
    return compare_laws(candidates, seen, MARKERS, CAMERA, views)


@pytest.mark.parametrize("cameras", [1, 2])
def test_the_law_that_made_the_pictures_wins(cameras):
    """A wrong law predicts markers it has not seen badly, a rich one worse than the right one."""
    order = compared([12.0, -4.0, 0.5, 0.7], cameras)
    best, by_name = order[0], {c.name: c for c in order}
    assert best.name == "bending and twist"
    assert min(order, key=lambda c: c.bic).name == best.name
    assert best.cross_chi2 == pytest.approx(1.0, abs=0.35)
    assert by_name["rigid"].cross_px > 5 * best.cross_px
    assert by_name["bending only"].cross_px > 2 * best.cross_px
    assert by_name["too rich"].chi2 < best.chi2  # it explains more, and predicts less
    assert by_name["too rich"].cross_chi2 > best.cross_chi2


@pytest.mark.parametrize("stated", [NOISE, NOISE / 3])
def test_a_wing_that_does_not_twist_needs_no_twist(stated):
    """Of six wings, where cross-validation is right in about three of four; also where spots are worse than stated."""
    for seed in range(6):
        assert compared([12.0, -4.0, 0.0, 0.0], seed=seed, stated=stated)[0].name == "bending only"


def test_evidence_orders_and_what_cannot_be_identified_is_last():
    order = compared([12.0, -4.0, 0.5, 0.7], candidates={**CANDIDATES, "none": wing(bend=Powers(tuple(range(2, 90))))})
    assert [c.bic for c in order[:-1]] == sorted(c.bic for c in order[:-1])
    assert order[-1].name == "none"
    assert order[-1].reason
    right = order[0]
    assert right.bic - right.aic == pytest.approx(right.parameters * (np.log(2 * len(right.state.used)) - 2))


def test_all_candidates_are_judged_on_the_same_observations():
    """The spot that is no marker's is left out for all of them."""
    order = compared([12.0, -4.0, 0.5, 0.7])
    counts = {len(c.state.used) for c in order}
    assert counts == {2 * len(MARKERS) - 1}


def test_folds():
    with pytest.raises(ValueError, match="folds must be at least 2, got 1"):
        compare_laws(CANDIDATES, Observations(*(np.zeros(s) for s in ((0,), (0,), (0, 2), (0, 2, 2)))), MARKERS,
                     CAMERA, [View("v0", "c", "", Pose.identity())], folds=1)  # fmt: skip
