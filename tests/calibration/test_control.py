"""What is known beforehand is tested like a mark: control points, held markers, distances, priors, one focal length."""

import sys
from dataclasses import replace

import networks
import numpy as np
import pytest
from scipy.stats import beta, chi2, f

from windmark.calibration import Calibration, Distance, Fixed, Free, NotCalibrated, Weighted, self_calibrate
from windmark.calibration.setup import Job, first_state
from windmark.calibration.snooping import critical, externally
from windmark.calibration.solve import solve
from windmark.geometry import Pose
from windmark.geometry.similarity import align
from windmark.scene import Doubt

SIGMA = 0.05
CONTROL = [0, 1, 2, 3, 4, 5]


def names(index):
    return [f"m{i:02d}" for i in index]


def known(case, off=None, seed=0, index=CONTROL):
    """Rough markers, but control within its sigma; ``off`` moves one of it by so many millimetres."""
    start = case.start.points.copy()
    start[index] = case.truth.points[index] + np.random.default_rng(seed).normal(0, SIGMA, (len(index), 3))
    if off is not None:
        start[index[0]] += np.array([0.6, 0.0, 0.8]) * off
    return start


def run(case, start=None, **options):
    observations, markers, cameras, views, _ = networks.nouns(case, start=start)
    markers = replace(markers, length_unit="mm")
    cameras = options.pop("cameras", cameras)
    return self_calibrate(observations, markers, cameras, views, **options)


@pytest.fixture(scope="module")
def case():
    return networks.make(71, points=30, views=10)


def test_right_control_raises_no_doubt(case):
    for seed in range(5):
        result = run(case, known(case, seed=seed), datum=Weighted(names(CONTROL), SIGMA))
        assert isinstance(result, Calibration)
        assert result.doubts == result.suspect == result.warnings == ()


@pytest.mark.parametrize("off", [1.5, 5.0, 50.0, 150.0])
def test_a_control_point_elsewhere_is_left_out_and_named(case, off):
    result = run(case, known(case, off), datum=Weighted(names(CONTROL), SIGMA))
    assert isinstance(result, Calibration)
    assert result.suspect == ("m00",)
    said = result.warnings[0].removeprefix("control point m00 was left out: ")
    assert float(said.split()[0]) == pytest.approx(off, abs=0.3)
    assert "mm from where the pictures and the other control put it" in result.warnings[0]
    assert result.used.all()  # none of its marks is to blame
    place = result.markers.name.tolist().index("m00")
    assert np.abs(result.markers.xyz[place] - case.truth.points[0]).max() < 5 * result.markers.sigma[place].max()
    # What was left out has no part in what comes after: halves, other datums.
    assert "m00" not in result.options["datum"].markers


def test_a_held_marker_elsewhere_is_left_out_and_named(case):
    result = run(case, known(case, 2.0), datum=Fixed(names(CONTROL)))
    assert result.suspect[0] == "m00"
    assert result.warnings[0].startswith("held marker m00 was left out")


def test_what_cannot_be_told_apart_is_refused_with_all_of_it(case):
    """Of two distances that contradict each other one is wrong; of three control points, any one."""
    xyz = case.truth.points
    pairs = [(6, 7), (8, 9)]
    lengths = [float(np.linalg.norm(xyz[a] - xyz[b])) for a, b in pairs]
    bars = [Distance(*names(p), d + e, SIGMA) for p, d, e in zip(pairs, lengths, (0.0, 30 * SIGMA), strict=True)]
    result = run(case, datum=Free(), distances=bars)
    assert isinstance(result, NotCalibrated)
    assert result.cause == "control"
    assert result.weak == ("m06", "m07", "m08", "m09")
    assert "contradicts itself" in result.reason
    assert "distance m06 to m07" in result.reason
    three = run(case, known(case, 3.0, index=[10, 20, 29]), datum=Weighted(names([10, 20, 29]), SIGMA))
    assert (three.cause, three.weak) == ("control", ("m10", "m20", "m29"))


def test_one_of_three_distances_is_told(case):
    xyz = case.truth.points
    pairs = [(6, 7), (8, 9), (10, 11)]
    wrong = [Distance(*names((a, b)), float(np.linalg.norm(xyz[a] - xyz[b])) + 2.0 * (a == 8), SIGMA) for a, b in pairs]
    result = run(case, datum=Free(), distances=wrong)
    assert result.warnings[0].startswith("distance m08 to m09 was left out: ")
    assert len(result.options["distances"]) == 2
    away = float(np.linalg.norm(np.subtract(*result.markers.xyz[[6, 7]])))
    assert away == pytest.approx(wrong[0].length, abs=5 * SIGMA)


def test_of_two_distances_between_the_same_markers_only_the_wrong_one_goes(case):
    xyz = case.truth.points
    pairs, off = [(6, 7), (6, 7), (8, 9)], (0.0, 2.0, 0.0)
    lengths = [float(np.linalg.norm(xyz[a] - xyz[b])) + e for (a, b), e in zip(pairs, off, strict=True)]
    bars = [Distance(*names(p), d, SIGMA) for p, d in zip(pairs, lengths, strict=True)]
    result = run(case, datum=Free(), distances=bars)
    assert [d.length for d in result.options["distances"]] == [lengths[0], lengths[2]]


def test_control_that_is_worse_than_its_sigmas_everywhere_gets_larger_ones(case):
    start = known(case)
    start[CONTROL] += np.random.default_rng(1).normal(0, 10 * SIGMA, (len(CONTROL), 3))
    result = run(case, start, datum=Weighted(names(CONTROL), SIGMA))
    (sentence,) = result.warnings
    assert "times worse than its sigmas say" in sentence
    assert result.options["datum"].sigma > 3 * SIGMA
    off = np.abs(result.markers.xyz - case.truth.points[: len(result.markers)]) / result.markers.sigma
    assert off.max() < 5


def test_distances_that_agree_against_places_that_agree_are_named_with_their_ratio(case):
    """No single one of them heals it: it was said that none is at fault."""
    xyz, pairs = case.truth.points, [(6, 7), (8, 9)]
    bars = [Distance(*names(p), 1.05 * float(np.linalg.norm(xyz[p[0]] - xyz[p[1]])), SIGMA) for p in pairs]
    result = run(case, known(case), datum=Weighted(names(CONTROL), SIGMA), distances=bars)
    (doubt,) = result.doubts
    assert (doubt.cause, doubt.names) == ("control", ("m06", "m07", "m08", "m09"))
    said = str(doubt)
    assert float(said.split("distances are ")[1].split(" ")[0]) == pytest.approx(1.05, abs=2e-3)


def test_without_rejection_wrong_control_stays_but_is_named(case):
    result = run(case, known(case, 1.5), datum=Weighted(names(CONTROL), SIGMA), reject=False)
    assert "m00" in result.suspect
    assert "m00" in result.options["datum"].markers


def test_a_prior_that_the_pictures_contradict_is_left_out(case):
    believed = {"cam0": replace(networks.ROUGH, cx=networks.CAMERA.cx + 60.0)}
    result = run(case, datum=Free(), cameras=believed, prior_sigma={"cx": 2.0, "cy": 20.0})
    assert result.suspect == ("cx",)
    assert result.options["prior_sigma"] == {"cy": 20.0}
    assert abs(result.cameras["cam0"].cx - networks.CAMERA.cx) < 4 * result.sigma("cam0", "cx")
    right = {"cam0": replace(networks.ROUGH, cx=networks.CAMERA.cx + 3.0)}
    assert run(case, datum=Free(), cameras=right, prior_sigma={"cx": 2.0}).doubts == ()


def seen_otherwise(case, view, change=0.0, shift=0.0):
    """The case with one picture of another focal length, or shifted on the sensor (cropped) by so many pixels."""
    by_view = np.where(np.arange(10) == view, change, 0.0)
    truth, net = replace(case.truth, change=np.outer(by_view, [1.0, 0.0, 0.0])), case.network
    xy, inside = networks.project(truth, net.view_frame, net.view_offset, net.view_camera, net.view, net.point)
    xy = xy + np.where(net.view == view, shift, 0.0)[:, None] * [1.0, 0.3]
    xy = (xy + np.random.default_rng(0).normal(0, 0.1, xy.shape))[inside]
    network = replace(net, view=net.view[inside], point=net.point[inside], xy=xy, cov=net.cov[inside])
    return networks.Case(network, truth, case.start)


def test_a_picture_with_another_focal_length_is_named(case):
    other = seen_otherwise(case, 4, change=0.02)
    result = run(other, datum=Free())
    (doubt,) = result.doubts
    assert doubt.names[0] == "v04"
    assert str(doubt).startswith("focal length not that of the other pictures (free_focal): v04 (+2")
    assert run(other, datum=Free(), free_focal=["v04"]).doubts == ()


def seen_shifted(case, shift):
    """The case with principal points that are (V, 2) off in its pictures."""
    truth, net = replace(case.truth, change=np.column_stack([np.zeros(len(shift)), shift])), case.network
    xy, inside = networks.project(truth, net.view_frame, net.view_offset, net.view_camera, net.view, net.point)
    xy = (xy + np.random.default_rng(0).normal(0, 0.1, xy.shape))[inside]
    network = replace(net, view=net.view[inside], point=net.point[inside], xy=xy, cov=net.cov[inside])
    return networks.Case(network, truth, case.start)


def test_a_picture_with_another_principal_point_is_named_and_may_have_it(case):
    off = np.outer(np.arange(10) == 6, [9.0, -5.0])
    result = run(seen_shifted(case, off), datum=Free())
    (doubt,) = result.doubts
    assert (doubt.names[0], doubt.cause) == ("v06", "principal")
    assert str(doubt).startswith("principal point not that of the other pictures (free_principal): v06 (+")
    own = run(seen_shifted(case, off), datum=Free(), free_principal=["v06"])
    assert own.doubts == ()
    np.testing.assert_allclose(own.principal_shift[6], [9.0, -5.0], atol=5.0)  # 1 sigma is 1.7
    assert (np.delete(own.principal_shift, 6, axis=0) == 0).all()
    assert own.camera("v06").cx == own.cameras["cam0"].cx + own.principal_shift[6, 0]
    assert own.camera("v05") == own.cameras["cam0"]
    with pytest.raises(ValueError, match="no view 'v99'"):
        own.camera("v99")


def test_principal_points_that_all_differ_are_said_and_cost_no_accuracy_when_free(case):
    """A lens that is loose, or stabilised; z of the markers over all coordinates, after the best similarity."""
    off = np.random.default_rng(4).normal(0, 8.0, (10, 2))
    moved = seen_shifted(case, off)
    result = run(moved, datum=Free())
    assert any(d.cause == "principal" for d in result.doubts)
    every = [f"v{v:02d}" for v in range(10)]
    own = run(moved, datum=Free(), free_principal=every, prior_sigma={"principal": 8.0})
    assert own.doubts == ()
    z, wrong = (against_truth(case, r) for r in (own, result))
    assert 0.7 < z < 1.3
    assert wrong > 1.2 * z


def against_truth(case, result):
    """RMS of the markers' errors by their sigmas."""
    true = case.truth.points[[int(n[1:]) for n in result.markers.name]]
    off = align(result.markers.xyz, true, scale=True).apply(result.markers.xyz) - true
    return float(np.sqrt((off**2 / result.markers.sigma**2).mean()))


@pytest.mark.parametrize("seed", [1, 3, 6])
def test_a_change_of_focus_is_not_called_one_of_the_principal_point(case, seed):
    change = np.random.default_rng(seed).normal(0, 0.004, 10)
    truth, net = replace(case.truth, change=np.outer(change, [1.0, 0.0, 0.0])), case.network
    xy, inside = networks.project(truth, net.view_frame, net.view_offset, net.view_camera, net.view, net.point)
    xy = (xy + np.random.default_rng(0).normal(0, 0.1, xy.shape))[inside]
    network = replace(net, view=net.view[inside], point=net.point[inside], xy=xy, cov=net.cov[inside])
    result = run(networks.Case(network, truth, case.start), datum=Free())
    assert [d.cause for d in result.doubts if d.cause in ("focal", "principal")] == ["focal"]


@pytest.mark.parametrize("shift", [40.0, 70.0])
def test_a_cropped_picture_is_the_one_that_is_named_and_not_those_that_it_bends(case, shift):
    """It moved principal point and focal length by 10 to 50 sigma, and five right pictures were named for it."""
    result = run(seen_otherwise(case, 6, shift=shift), datum=Free())
    (doubt,) = result.doubts
    assert (doubt.names, doubt.cause) == (("v06",), "picture")
    assert list(result.dropped) == ["v06"]
    for parameter in ("focal_px", "cx", "cy"):
        off = getattr(result.cameras["cam0"], parameter) - getattr(networks.CAMERA, parameter)
        assert abs(off) < 4 * result.sigma("cam0", parameter)


def test_a_picture_of_a_far_other_focus_is_left_out_with_what_its_marks_say_of_it(case):
    result = run(seen_otherwise(case, 6, change=0.05), datum=Free())
    (doubt,) = result.doubts
    assert (doubt.names, doubt.cause) == (("v06",), "picture")
    assert "another focus took it (by its focal length +3" in str(doubt)


def test_a_marker_that_vanishes_with_its_wrong_marks_is_named(case):
    """It is left in one view only, and was not in the result without a word of why."""
    net = case.network
    mine = np.flatnonzero(net.point == 7)[:2]
    kept = (net.point != 7) | np.isin(np.arange(len(net.xy)), mine)
    xy = net.xy.copy()
    xy[mine[0]] += [25.0, -18.0]
    network = replace(net, view=net.view[kept], point=net.point[kept], xy=xy[kept], cov=net.cov[kept])
    result = run(networks.Case(network, case.truth, case.start), datum=Free())
    assert "m07" not in result.markers.name
    assert result.dropped == {"m07": "its marks contradict the others"}
    assert result.suspect == ("m07",)
    (doubt,) = result.doubts
    assert str(doubt).startswith("m07 lost 2 of its 2 marks: ")


def test_a_marker_of_which_one_mark_was_taken_for_wrong_comes_back(case):
    """What takes no part is not tested: the search that leaves gross errors out begins with one mark of it."""
    net = case.network
    kept = (net.point != 7) | np.isin(np.arange(len(net.xy)), np.flatnonzero(net.point == 7)[:2])
    xy = (net.xy + np.random.default_rng(0).normal(0, 0.1, net.xy.shape))[kept]
    network = replace(net, view=net.view[kept], point=net.point[kept], xy=xy, cov=net.cov[kept])
    observations, markers, cameras, views, _ = networks.nouns(networks.Case(network, case.truth, case.start))
    job = Job(observations, markers, tuple(views), cameras, networks.NAMES, Free(), (), False, (), {})
    every, shift = np.ones(len(xy), bool), np.zeros_like(xy)
    state = first_state(job, {"cam0": networks.CAMERA}, [Pose(r, t) for r, t in zip(
        case.truth.frames.rotation, case.truth.frames.translation, strict=True
    )])  # fmt: skip
    fits = every.copy()
    fits[np.flatnonzero(network.point == 7)[0]] = False
    solved = solve(job, state, every, shift, True, fits)
    assert solved.taken.all()
    assert solved.used.all()


def test_of_solutions_that_leave_markers_alone_the_one_that_explains_most_is_taken(case, monkeypatch):
    """Three pictures, a focal length 10 % off: nine markers of 39 vanished in a minimum that was none, 19 sigma off."""
    right, found = run(case, datum=Free()), []
    gone = Doubt(("m07",), "{} lost 3 of its 3 marks", "marker")

    def attempt(job, cameras, options, seed):
        part = right.used & (np.arange(len(right.used)) % (2 + len(found)) > 0)
        found.append(replace(right, used=part, doubts=(gone,), dropped={"m07": "its marks contradict the others"}))
        return found[-1]

    monkeypatch.setattr(sys.modules["windmark.calibration.self_calibrate"], "_attempt", attempt)
    result = run(case, datum=Free())
    assert len(found) > 2
    assert result is found[-1]


def test_half_of_the_pictures_are_not_left_out(case):
    """Which half is the wrong one nobody can tell, but which pictures are of one half."""
    net = case.network
    change = np.where(np.arange(10) < 5, 0.01, 0.0)
    truth = replace(case.truth, change=np.outer(change, [1.0, 0.0, 0.0]))
    xy, inside = networks.project(truth, net.view_frame, net.view_offset, net.view_camera, net.view, net.point)
    xy = (xy + np.random.default_rng(0).normal(0, 0.1, xy.shape))[inside]
    network = replace(net, view=net.view[inside], point=net.point[inside], xy=xy, cov=net.cov[inside])
    result = run(networks.Case(network, truth, case.start), datum=Free())
    assert result.dropped == {}
    assert [d.cause for d in result.doubts] == ["mixed"]
    names_of = [f"v{v:02d}" for v in range(10)]
    assert list(result.doubts[0].names) in (names_of[:5], names_of[5:])
    assert "at another zoom or focus" in str(result.doubts[0])


def test_names_with_braces_are_names(case):
    result = run(case, known(case, 1.5), datum=Weighted(names(CONTROL), SIGMA))
    (doubt,) = result.doubts
    assert "{x}" in str(doubt.renamed({"m00": "{x}"}))


CHANCES = np.array([0.5, 0.01, 0.001])


@pytest.mark.parametrize("redundancy", [3, 8, 400])
def test_the_test_beside_the_other_residuals_is_chi_square_for_any_redundancy(redundancy):
    """Two of r squares of one sigma, which is estimated from their sum: their share of it is a beta variable, and what
    is exceeded by chance stays so.
    """
    squares = 9.0 * redundancy
    share = beta.isf(CHANCES, 1, (redundancy - 2) / 2)
    values = externally(share * squares, np.full(3, True), squares, redundancy)
    np.testing.assert_allclose(values, chi2.isf(CHANCES, 2), rtol=1e-6)


def test_a_left_out_mark_is_tested_against_its_prediction():
    """Two squares beside six others of the same sigma: an F variable."""
    squares = 4.0 * 6
    values = externally(f.isf(CHANCES, 2, 6) * 2 * squares / 6, np.full(3, False), squares, 6)
    np.testing.assert_allclose(values, chi2.isf(CHANCES, 2), rtol=1e-6)
    assert critical(1000) == pytest.approx(chi2.isf(0.05 / 1000, 2))


def test_a_small_sigma0_makes_nothing_surer(case):
    """Residuals smaller than the marks' covariances say are no reason for smaller ones."""
    observations, markers, cameras, views, _ = networks.nouns(case)
    loose = replace(observations, cov=observations.cov * 4)
    result, usual = (self_calibrate(o, markers, cameras, views, datum=Free()) for o in (loose, observations))
    assert result.sigma0 == pytest.approx(usual.sigma0 / 2, rel=0.05)
    np.testing.assert_allclose(result.markers.sigma, 2 * usual.markers.sigma / max(usual.sigma0, 1), rtol=0.05)


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize(("count", "refused"), [(4, True), (5, False), (9, False)])
def test_two_known_markers_in_each_others_place_are_named_as_that(case, held, count, refused):
    index = list(range(count))
    start = known(case, index=index)
    if held:
        start[index] = case.truth.points[index]
    start[[1, 3]] = start[[3, 1]]
    result = run(case, start, datum=Fixed(names(index)) if held else Weighted(names(index), SIGMA))
    assert isinstance(result, NotCalibrated) == refused
    said = result.reason if refused else result.warnings[0]
    what = "held marker" if held else "control point"
    assert f"{what} m01 and {what} m03 are in each other's place in the table" in said
    if not refused:
        assert result.suspect == ("m01", "m03")
        away = result.markers.xyz - case.truth.points[: len(result.markers)]
        assert np.abs(away[[1, 3]]).max() < 6 * result.markers.sigma[[1, 3]].max()


def test_held_markers_that_are_all_off_are_known_as_well_as_they_fit(case):
    squares = []
    for seed in range(6):
        start, index = case.start.points.copy(), list(range(10))
        start[index] = case.truth.points[index] + np.random.default_rng(seed).normal(0, 0.5, (10, 3))
        result = run(case, start, datum=Fixed(names(index)))
        assert isinstance(result, Calibration), result.reason
        assert "held markers are off their table by some 0." in result.warnings[0]
        assert "they were taken as known to that" in result.warnings[0]
        assert result.used.mean() > 0.99  # no mark is to blame
        squares.append((((result.markers.xyz - case.truth.points) / result.markers.sigma) ** 2).mean())
    assert 0.6 < np.sqrt(np.mean(squares)) < 1.6


@pytest.mark.slow
def test_two_of_many_held_markers_in_each_others_place_are_found_in_parts():
    many = networks.make(81, points=220, views=6)
    every = networks.nouns(many)[1].name[:160].tolist()
    start = many.start.points.copy()
    start[:160] = many.truth.points[:160]
    start[[5, 77]] = start[[77, 5]]
    result = run(many, start, datum=Fixed(every))
    assert isinstance(result, Calibration), result.reason
    assert result.suspect == (every[5], every[77])


@pytest.mark.parametrize(("off", "reject", "words"), [
    (0.5, True, "they were taken as known to that"), (0.5, False, "the sigmas do not contain that"),
    (0.0, True, "held marker m02 was left out: 8"), (0.0, False, "held marker m02 is contradicted: 8"),
])  # fmt: skip
def test_control_that_was_not_left_out_is_not_said_to_be(case, off, reject, words):
    index, start = list(range(10)), case.start.points.copy()
    start[index] = case.truth.points[index] + np.random.default_rng(0).normal(0, off, (10, 3))
    start[2] += [0.0, 0.0, 8.0 if off == 0.0 else 0.0]
    result = run(case, start, datum=Fixed(names(index)), reject=reject, max_sigma0=100.0)
    assert isinstance(result, Calibration), result.reason
    assert any(words in w for w in result.warnings)
