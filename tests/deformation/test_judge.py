"""Does a deformation say what contradicts it? All residuals, their pattern, markers and views that lost marks."""

import re
from dataclasses import replace

import numpy as np
import pytest
from swept_scenes import BEAM, CAMERAS, MARKERS, MOTION, NOISE, PARTS, VIEWS, VOLUMES, Q, draws, observed, seen, z_of

from windmark.deformation import Deformation, Stations, Volume, Volumes, identify, span_values
from windmark.deformation.equations import CHECKED, Equations
from windmark.deformation.laws import Hinge, Powers
from windmark.deformation.setup import prepare, start_values
from windmark.deformation.solve import solve
from windmark.geometry import Pose
from windmark.scene import Observations

SIMPLE = (Volume("wing", replace(BEAM, bend=Powers((2,))), parent="body"), Volume("body"))


def solved(spots, parts):
    task = prepare(spots, MARKERS, Volumes.of(parts), CAMERAS, VIEWS, True, None, False, None, False, None, None)
    values = start_values(task, None)
    return solve(task, values, task.eccentricity(values), False, near=False)


def test_what_is_right_is_not_doubted():
    found = draws(200, seen(), 31)
    assert [r.warnings for r in found if r.warnings] == []
    assert all(r.fits and r.misfit is None for r in found)


def test_what_an_unknown_would_explain_is_what_it_explains():
    """The test without solving again against solving again, with the same shape as a parameter of the law."""
    spots = observed(seen(), np.random.default_rng(32))
    few, many = solved(spots, SIMPLE), solved(spots, PARTS)
    equations = Equations(few)
    rich = Volumes.of(PARTS).bind(MARKERS.xyz, np.where(MARKERS.role == "wall", "", MARKERS.volume))
    b2, t1, t2 = few.values["law"]
    slope = rich.linearise(np.array([b2, 0.0, t1, t2]))[1][..., 1:2]
    added = equations.added(equations.by_place @ (few.values["motion"].rotation @ slope))
    test, rank, value, _ = added.fitted(np.array([0]))
    assert rank == 1
    share = added.power[0, 0] / added.size[0] ** 2
    faded = share / (share + CHECKED)
    assert test == pytest.approx(faded * (few.chi2 - many.chi2), rel=0.01)
    assert value[0] == pytest.approx(faded * many.values["law"][1], rel=0.01)
    assert few.redundancy == many.redundancy + 1


def test_groups_at_once_are_groups_one_by_one():
    equations = Equations(solved(observed(seen(), np.random.default_rng(33)), SIMPLE))
    rng = np.random.default_rng(34)
    added = equations.added(equations.by_place @ rng.standard_normal((len(MARKERS), 3, 7)))
    groups = np.array([[0, 1, 2], [3, 4, -1], [5, 6, 1]])
    tests, ranks = added.each(groups)
    for k, group in enumerate(groups):
        test, rank, _, _ = added.fitted(group[group >= 0])
        assert tests[k] == pytest.approx(test, rel=1e-9)
        assert ranks[k] == rank


def test_a_law_too_simple_is_named_by_what_is_left_and_its_sigmas_contain_it():
    """4 mm of the cubic are missing; the quadratic takes most of it, 0.1 to 0.6 mm stay."""
    outside, without, at = [], [], Stations.along((205, 80, 0), (430, 590, 0), 9, volume="wing", chord=(100, 0, 0))
    truth = Volumes.of(PARTS)
    ends = np.concatenate([at.fore, at.aft])
    place = truth.bind(ends, "wing").place(Q)
    bending = (place - ends)[:, 2].reshape(2, -1).mean(axis=0)
    for k in range(20):
        spots = observed(seen(), np.random.default_rng([35, k]))
        found = identify(spots, MARKERS, SIMPLE, CAMERAS, VIEWS)
        assert isinstance(found, Deformation)
        assert not found.fits
        assert found.suspect == ("wing",)
        assert "law of wing too simple: what is left looks like bending of" in found.warnings[0]
        amount = float(re.search(r"bending of ([0-9.]+) mm at m", found.warnings[0])[1])
        assert 0.1 < amount < 1.2, "what the quadratic takes of the cubic is not left"
        got, cov = found.place(MARKERS.xyz[:50], "wing")
        off = got - MOTION.apply(truth.bind(MARKERS.xyz[:50], "wing").place(Q))
        outside.append(np.abs(off) > 1.96 * np.sqrt(np.diagonal(cov, axis1=1, axis2=2)))
        span = span_values(found, at)
        assert (np.abs(span.bending - bending) < 4 * span.bending_sigma).all()
        stated = replace(found, misfit=None, cov=solved(spots, SIMPLE).cov).place(MARKERS.xyz[:50], "wing")[1]
        without.append(np.abs(off) > 1.96 * np.sqrt(np.diagonal(stated, axis1=1, axis2=2)))
    assert np.mean(outside) < 0.08
    assert np.mean(without) > 0.3


def test_a_part_that_bends_and_has_no_law_is_named_as_that_with_the_unit_that_was_given():
    rigid = Volumes.of((Volume("wing"),), "in")
    found = identify(observed(seen(), np.random.default_rng(41)), MARKERS, rigid, CAMERAS, VIEWS)
    assert isinstance(found, Deformation)
    words = next(str(d) for d in found.doubts if d.cause == "bent")
    # Everything that a bent wing lacks: two kinds are named, the others are counted.
    looks = "wing deforms and has no law: what is left looks like "
    assert re.fullmatch(looks + r"bending of \S+ in at m\d+ and twist of \S+ deg at m\d+ \(and \d more\)", words)


def test_spots_less_certain_than_stated_scale_the_covariance_and_never_shrink_it():
    spots = observed(seen(), np.random.default_rng(36))
    right = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS)
    worse = identify(replace(spots, cov=spots.cov / 9), MARKERS, PARTS, CAMERAS, VIEWS)
    better = identify(replace(spots, cov=spots.cov * 9), MARKERS, PARTS, CAMERAS, VIEWS)
    assert f"residuals are {worse.sigma0:.2g} times as large as stated (sigma0)" in worse.warnings[0]
    assert worse.sigma0 == pytest.approx(3 * right.sigma0, rel=1e-2)
    assert not worse.fits
    np.testing.assert_allclose(worse.cov, right.cov * right.sigma0**2, rtol=2e-2)
    assert better.sigma0 < 0.4
    assert better.warnings == ()
    np.testing.assert_allclose(better.cov, right.cov * 9, rtol=1e-2)


def test_a_marker_that_stands_elsewhere_is_named_with_its_distance():
    xyz = MARKERS.xyz.copy()
    xyz[7] += [2.0, 0.0, 1.0]
    found = identify(observed(seen(xyz=xyz), np.random.default_rng(37)), MARKERS, PARTS, CAMERAS, VIEWS)
    assert found.suspect == ("m7",)
    (words,) = found.warnings
    assert words.startswith("m7 is ")
    assert words.endswith(" mm from where its table has it")
    assert float(words.split()[2]) == pytest.approx(5**0.5, abs=0.1)  # three sigma in depth
    assert found.fits


def test_markers_of_one_volume_that_stand_elsewhere_are_named_in_one_sentence():
    """Every one of them had a sentence, and what stood behind them was not read."""
    xyz = MARKERS.xyz.copy()
    for k, n in enumerate((3, 11, 19, 27, 35)):
        xyz[n] += (2.0 + k) * np.array([1.0, 0.0, 0.0])
    found = identify(observed(seen(xyz=xyz), np.random.default_rng(39)), MARKERS, PARTS, CAMERAS, VIEWS)
    assert found.suspect == ("m35", "m27", "m19", "m11", "m3")
    (words,) = found.warnings
    said = re.fullmatch(
        r"m35, m27, m19 and 2 more markers of wing are (\S+) to (\S+) mm from where their table has them", words
    )
    assert [float(n) for n in said.groups()] == pytest.approx([2.0, 6.0], abs=0.1)
    assert found.fits


def test_gross_errors_that_have_nothing_in_common_are_no_marker_and_no_camera():
    rng = np.random.default_rng(38)
    named = 0
    for _ in range(20):
        spots = observed(seen(), rng)
        bad = rng.random(len(spots)) < 0.2
        spots.xy[bad] += rng.uniform(-40, 40, (int(bad.sum()), 2))
        found = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS)
        named += bool(found.suspect)
    assert named <= 2


def test_a_view_that_loses_far_more_than_the_others_is_named():
    rng = np.random.default_rng(39)
    spots = observed(seen(), rng)
    bad = (spots.view == 1) & (rng.random(len(spots)) < 0.5)
    spots.xy[bad] += 400 * NOISE * rng.standard_normal((int(bad.sum()), 2))
    found = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS)
    assert found.suspect == ("v1",)
    assert "v1 lost" in found.warnings[0]


def test_a_camera_that_moved_is_named_with_how_far_and_the_rest_is_as_if_it_had_been_free():
    for k, walls in enumerate((True, True, False)):
        delta = np.concatenate([np.radians([0.0, 0.2, 0.0]), [1.0, 0.0, 0.0]])
        poses = [VIEWS[0].cam_from_model, Pose.exp(delta) @ VIEWS[1].cam_from_model]
        spots = observed(seen(poses=poses, wall=walls), np.random.default_rng([40, k]))
        found = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS)
        if not walls:  # the model with one camera moved as well as the other one did
            assert not found
            assert found.cause == "moved"
            assert set(found.weak) == {"v0", "v1"}
            assert "do not tell which" in found.reason
            continue
        assert found.suspect == ("v1",)
        assert "v1 is taken as fixed and is not where it should be: it turned by 0.2 ± " in found.warnings[0]
        free = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS, free_poses=["v1"])
        np.testing.assert_allclose(found.q, free.q, rtol=1e-3)
        np.testing.assert_allclose(found.cov, free.cov, rtol=1e-2, atol=1e-12)
        assert (np.abs(z_of(found, Q)) < 4).all()


def test_one_camera_whose_walls_all_contradict_it_is_not_where_it_is_said_to_be():
    """The model's motion takes up what it is off, and its walls are gross errors then: all was well without them."""
    walls = np.flatnonzero(MARKERS.role == "wall")[:4]

    def one(truth):
        return (truth.view == 0) & (np.isin(truth.point, walls) | (MARKERS.role[truth.point] != "wall"))

    still = 0
    for k, degrees in enumerate((0.0, 0.0, 0.0, 0.0, 0.03, 0.05, 0.1)):
        turn = Pose.exp(np.concatenate([np.radians([0.0, degrees, 0.0]), np.zeros(3)]))
        poses = [turn @ VIEWS[0].cam_from_model, VIEWS[1].cam_from_model]
        spots = observed(seen(poses=poses, wall=True), np.random.default_rng([43, k]), only=one)
        found = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS[:1])
        assert isinstance(found, Deformation)
        if not degrees:
            still += "v0" not in found.suspect
            continue
        (doubt,) = (d for d in found.doubts if d.cause == "moved")
        assert "v0 is taken as fixed and is not where it should be: it turned by" in str(doubt)
        off = found.place(MARKERS.xyz[:50], "wing")[0] - MOTION.apply(VOLUMES.bind(MARKERS.xyz[:50], "wing").place(Q))
        assert np.sqrt((off**2).sum(axis=1).mean()) < 0.6  # mm; the turn alone is up to 1.8
    assert still == 4


def test_cameras_that_stand_still_are_not_said_to_have_moved():
    """Nor where a law is too simple, or spots are worse than stated."""
    for k in range(10):
        spots = observed(seen(wall=True), np.random.default_rng([41, k]))
        for cov, parts in ((spots.cov, PARTS), (spots.cov, SIMPLE), (spots.cov / 9, PARTS)):
            found = identify(replace(spots, cov=cov), MARKERS, parts, CAMERAS, VIEWS)
            assert isinstance(found, Deformation)
            assert not {"v0", "v1"} & set(found.suspect)


def flapped(attached, bends=1.0, views=VIEWS):
    """What comes of a flap that is fixed to the wing, or to the body, where the laws have it on the body."""
    rng = np.random.default_rng(42)
    hinge = Hinge((330.0, 350.0, 0.0), (420.0, 560.0, 0.0))
    xyz = MARKERS.xyz.copy()
    along = rng.uniform(0, 1, 10)[:, None]
    xyz[50:60] = [330.0, 350.0, 0.0] + along * [90.0, 210.0, 0.0] + rng.uniform([8, 0, 0], [50, 0, 0], (10, 3))
    volume = np.where(np.arange(72) < 50, "wing", np.where(np.arange(72) < 60, "flap", "wall"))
    set_of = replace(MARKERS, xyz=xyz, volume=volume)
    body, wing = Volume("body"), PARTS[0]
    on = {n: Volumes.of((body, wing, Volume("flap", hinge, parent=n))) for n in ("wing", "body")}
    q = np.append(bends * Q, 6.0)
    truth = seen(q, xyz=xyz, volumes=on["wing" if attached else "body"], set_of=set_of, wall=True)
    spots = observed(truth, rng, only=lambda t: t.view < len(views))
    return identify(spots, set_of, on["body"], CAMERAS, views)


def test_a_flap_that_moves_with_the_wing_is_asked_for_its_parent():
    fixed = flapped(True)
    words = "" if fixed else fixed.reason
    if fixed:
        words = " ".join(fixed.warnings)
        assert {"flap", "wing"} <= set(fixed.suspect)
    assert "flap moves with wing" in words
    assert "give it that parent" in words
    assert not fixed or "attached" in {d.cause for d in fixed.doubts}


@pytest.mark.parametrize("bends", [1.0, 0.0])
def test_a_flap_that_stands_on_the_body_is_left_alone(bends):
    assert flapped(False, bends).warnings == ()


@pytest.mark.parametrize("bends", [0.0, 0.003, 0.01, 0.03])
def test_a_flap_of_which_one_picture_cannot_tell_whether_it_moves_with_the_wing_is_named(bends):
    """Where that cannot be told, no sigma of the flap's own law says how far off it may be."""
    found = flapped(True, bends, VIEWS[:1])
    assert "flap" in " ".join((*found.warnings, *map(str, found.unchecked)))


def test_where_the_pictures_tell_that_a_flap_stands_by_itself_nothing_is_left_unchecked():
    assert flapped(False).unchecked == ()


@pytest.mark.parametrize("both", [True, False])
def test_exchanged_labels_are_named_with_their_view(both):
    spots = observed(seen(), np.random.default_rng(43))
    for v in (0, 1) if both else (1,):
        a, b = (int(np.flatnonzero((spots.view == v) & (spots.point == n))[0]) for n in (4, 31))
        spots.xy[[a, b]] = spots.xy[[b, a]]
    found = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS)
    where = "v0, v1" if both else "v1"
    assert found.warnings == (f"labels of m4 and m31 are exchanged in {where}",)
    assert found.suspect == ("m4", "m31")
    assert (np.abs(z_of(found, Q)) < 4).all()


@pytest.mark.parametrize("wall", [False, True])
def test_a_picture_of_another_moment_is_named_as_that_and_no_law_and_no_camera(wall):
    """The wing was said to stretch and to sway: each camera fits the laws alone, in states of its own."""
    for k, part in enumerate((0.0, 0.5, 0.8)):
        now, then = seen(wall=wall), seen(q=part * Q, wall=wall)
        late = replace(now, xy=np.where((now.view == k % 2)[:, None], then.xy, now.xy))
        found = identify(observed(late, np.random.default_rng([77, k])), MARKERS, PARTS, CAMERAS, VIEWS)
        said = " ".join(found.warnings)
        assert "wing.bend_2 is " in said
        assert " by it alone and " in said
        assert said.count("pictures of different moments") == 1
        assert "too simple:" not in said
        assert "not where it should be" not in said
        assert {d.cause for d in found.doubts} <= {"picture", "noise"}


def test_a_picture_of_nearly_the_same_moment_is_named_by_the_marker_that_tells_it():
    """Residuals are as large as stated, or not much larger: the state was 4 sigma off and nothing was said."""
    shown = []
    for k in range(6):
        now, then = seen(), seen(q=0.98 * Q)
        late = replace(now, xy=np.where((now.view == k % 2)[:, None], then.xy, now.xy))
        found = identify(observed(late, np.random.default_rng([79, k])), MARKERS, PARTS, CAMERAS, VIEWS)
        assert 0.9 < found.sigma0 < 1.2
        (said,) = found.warnings
        shown.append(re.fullmatch(r"v0 shows another state: m\d+ is ([\d.]+) ± ([\d.]+) mm from where the other "
                                  "shows it: pictures of different moments", said))  # fmt: skip
    assert all(shown)
    assert min(float(s[1]) / float(s[2]) for s in shown) > 3


def test_a_law_that_lacks_something_is_no_picture_of_another_moment():
    for k in range(4):
        found = identify(observed(seen(wall=k > 1), np.random.default_rng([35, k])), MARKERS, SIMPLE, CAMERAS, VIEWS)
        assert "different moments" not in " ".join(found.warnings)


@pytest.mark.parametrize("marks", [0, 1, 4])
def test_a_view_with_few_marks_or_none_is_no_state_of_its_own(marks):
    truth = seen(wall=True)
    few = np.flatnonzero(truth.view == 1)[marks:]
    spots = observed(truth, np.random.default_rng(78), only=lambda t: ~np.isin(np.arange(len(t.view)), few))
    found = identify(spots, MARKERS, SIMPLE, CAMERAS, VIEWS)
    assert isinstance(found, Deformation)
    assert "too simple" in " ".join(found.warnings)
    assert "different moments" not in " ".join(found.warnings)


def test_markers_of_another_part_that_one_camera_sees_are_named():
    """Each has one mark, which says nothing of another place; they were left out of every frame without a word."""
    xyz, body = MARKERS.xyz.copy(), np.flatnonzero(MARKERS.volume == "body")
    wrong = body[:: max(len(body) // 5, 1)][:5]
    xyz[wrong] += [3.0, 1.0, 0.0]
    spots = observed(seen(xyz=xyz), np.random.default_rng(42))
    keep = ~np.isin(spots.point, wrong) | (spots.view == 0)
    one = Observations(*(getattr(spots, key)[keep] for key in ("view", "point", "xy", "cov")))
    found = identify(one, MARKERS, PARTS, CAMERAS, VIEWS)
    (words,) = found.warnings
    assert "more markers of body are not where the rest of it says" in words
    assert set(found.suspect) == set(MARKERS.name[wrong])
