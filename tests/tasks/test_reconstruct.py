"""`reconstruct`: the paper's case at observation level, and every way to say no."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "epipolar"))
import reconstruct_scenes as scenes

from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.scene import Detections, MarkerCovariance, MarkerSet, View
from windmark.tasks.reconstruct import NotReconstructed, reconstruct
from windmark.tasks.reconstruct.task import Task
from windmark.tasks.reconstruct.ties import tied_pairs

SIGMA = 0.02


def primaries(case, seed=0, count=6):
    picked = case.primary[:count]
    noise = np.random.default_rng(seed).normal(0, SIGMA, (len(picked), 3))
    return MarkerSet.make(
        [f"P{k}" for k in range(len(picked))], case.xyz[picked] + noise, sigma=np.full((len(picked), 3), SIGMA)
    )


def identities(result, case):
    """(N,) true marker of each track, -1 for none, and the number of links to others."""
    tracks, wrong = result.tracks, 0
    label = np.array([case.labels[v][s] for v, s in zip(tracks.view, tracks.detection, strict=True)])
    who = np.full(len(result.markers), -1)
    for k in range(len(who)):
        names, votes = np.unique(label[tracks.track == k], return_counts=True)
        who[k] = names[votes.argmax()]
        wrong += int((label[tracks.track == k] != who[k]).sum())
    return who, wrong


@pytest.mark.slow
@pytest.mark.parametrize(("model", "path"), [("plate", "walk"), ("model", "walk"), ("plate", "cloud")])
def test_unknown_markers_are_found_without_labels_or_poses(model, path):
    case = scenes.make(11, model, path, views=9, points=60)
    result = reconstruct(case.detections, case.camera, primaries(case))
    assert result, result.reason
    assert all(v.cam_from_model is not None for v in result.views)
    who, wrong = identities(result, case)
    assert wrong == 0
    assert (who >= 0).all()
    assert len(np.unique(who)) == len(who)
    assert np.isin(np.flatnonzero(case.views_of >= 3), who).all()
    error = result.markers.xyz - case.xyz[who]
    assert np.sqrt((error**2).sum(axis=1).mean()) < 3 * np.sqrt((result.markers.sigma**2).sum(axis=1).mean())
    for k, name in enumerate(result.markers.name):
        if name.startswith("P"):
            assert who[k] == case.primary[int(name[1:])]
            assert result.markers.role[k] == "primary"
    assert 0.8 < result.calibration.sigma0 < 1.2


def test_labels_of_one_picture_name_the_primaries():
    case = scenes.make(12, "plate", views=6, points=60)
    seen = {int(m): s for s, m in enumerate(case.labels[2]) if m >= 0}
    known = [m for m in case.primary if m in seen][:3]
    primary = MarkerSet.make([f"P{m}" for m in known], case.xyz[known])
    result = reconstruct(case.detections, case.camera, primary, labels={"2": {seen[m]: f"P{m}" for m in known}})
    assert result, result.reason
    who, wrong = identities(result, case)
    assert wrong == 0
    for k, name in enumerate(result.markers.name):
        if name.startswith("P"):
            assert who[k] == int(name[1:])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "wrong"),
    [("model", 0.93), ("model", 1.5), ("model", 0.7), ("plate", 1.05), ("plate", 1.3)],
)
def test_a_focal_length_that_is_far_off_is_the_reason_of_the_refusal(kind, wrong):
    views, points = (6, 60) if kind == "model" else (5, 45)
    case = scenes.make(12, kind, "walk", views=views, points=points)
    given = replace(case.camera, focal_px=case.camera.focal_px * wrong)
    answer = reconstruct(case.detections, given, primaries(case))
    assert isinstance(answer, NotReconstructed)
    assert answer.cause == "focal"
    seen = float(answer.reason.split("a focal length of ")[1].split()[0])
    assert seen == pytest.approx(case.camera.focal_px, rel=0.01)


def test_a_picture_of_another_focal_length_is_left_out_for_that():
    """It fits elsewhere, almost, again and again: farther away."""
    rng = np.random.default_rng(7)
    xyz, camera = rng.uniform(-1, 1, (20, 3)) * [2, 1.5, 0.4], Camera((640, 480), 800.0)
    eyes = [(-1, 0, 6), (1, 0.3, 6), (0, 1, 6.2), (0.3, -1, 5.8), (-1, 1, 6)]
    poses = [Pose.look_at(eye, [0, 0, 0], [0, 1, 0]) for eye in eyes]
    spots = []
    for k, pose in enumerate(poses):
        used = replace(camera, focal_px=816.0) if k == 4 else camera
        xy = used.project(pose.apply(xyz))[0] + rng.normal(0, 0.01, (20, 2))
        spots.append(Detections.make(xy, sigma_px=0.01))
    known = MarkerSet.make([f"p{k}" for k in range(6)], xyz[:6], sigma=1e-4, role="primary")
    result = reconstruct(spots, camera, known)
    assert result, result.reason
    assert list(result.dropped) == ["4"]
    assert "another focal length: it shows 816 px, 2 % longer" in result.dropped["4"]


@pytest.mark.slow
def test_a_free_focal_length_is_found_from_far_off_by_three_pictures_that_fit_together():
    case = scenes.make(12, "model", "walk", views=6, points=60)
    rough = replace(case.camera, focal_px=case.camera.focal_px * 1.3)
    result = reconstruct(case.detections, rough, primaries(case), free=("focal_px",))
    assert result, result.reason
    assert not result.dropped
    found = result.cameras["camera"].focal_px
    assert abs(found - case.camera.focal_px) < 4 * result.calibration.sigma("camera", "focal_px")


def test_a_focal_length_that_is_a_little_off_is_a_doubt_and_the_right_one_none():
    case = scenes.make(12, "plate", "walk", views=6, points=60)
    given = replace(case.camera, focal_px=case.camera.focal_px * 0.997)
    result = reconstruct(case.detections, given, primaries(case))
    assert result, result.reason
    assert [d.cause for d in result.doubts] == ["focal"]
    assert not reconstruct(case.detections, case.camera, primaries(case)).doubts


def test_labels_that_are_exchanged_in_one_of_three_pictures_are_named():
    case = scenes.make(12, "plate", views=6, points=60)
    seen = [{int(m): s for s, m in enumerate(label) if m >= 0} for label in case.labels]
    known = [m for m in case.primary if all(m in mine for mine in seen[:3])][:5]
    primary = MarkerSet.make([f"P{m}" for m in known], case.xyz[known])
    labels = {str(v): {seen[v][m]: f"P{m}" for m in known} for v in range(3)}
    right = reconstruct(case.detections, case.camera, primary, labels=labels)
    assert right, right.reason
    assert not right.doubts
    a, b = sorted(f"P{m}" for m in known[:2])
    change = {a: b, b: a}
    labels["1"] = {s: change.get(name, name) for s, name in labels["1"].items()}
    result = reconstruct(case.detections, case.camera, primary, labels=labels)
    assert result, result.reason
    assert f"{a} and {b} are exchanged in the labels of 1" in [str(d) for d in result.doubts]
    assert result.markers.xyz[result.markers.name == a] == pytest.approx(
        right.markers.xyz[right.markers.name == a], abs=1e-3
    )


@pytest.mark.slow
def test_primaries_of_one_survey_share_their_errors():
    """The survey is 0.4 off as a whole: its joint covariance says so, and the frame is no surer than that."""
    case = scenes.make(11, "plate", "walk", views=6, points=45)
    plain = primaries(case)
    shared = np.tile(0.4 * np.eye(3), (len(plain), 1))
    cov = MarkerCovariance(plain.name, SIGMA**2 * np.eye(len(shared)) + shared @ shared.T)
    surveyed = replace(plain, xyz=plain.xyz + np.array([0.5, -0.3, 0.2]))
    result = reconstruct(case.detections, case.camera, surveyed, primary_cov=cov)
    assert result, result.reason
    assert not result.warnings
    who, _ = identities(result, case)
    off = (result.markers.xyz - case.xyz[who]) / result.markers.sigma
    assert result.markers.sigma.min() > 0.39
    assert np.abs(off).max() < 4
    alone = reconstruct(case.detections, case.camera, surveyed)
    who, _ = identities(alone, case)
    assert np.abs((alone.markers.xyz - case.xyz[who]) / alone.markers.sigma).max() > 6
    with pytest.raises(UsageError, match="names the marker 'zz'"):
        reconstruct(case.detections, case.camera, plain, primary_cov=MarkerCovariance(["zz"], np.eye(3)))


def test_primaries_without_labels_are_named_by_their_place():
    case = scenes.make(12, "plate", views=6, points=60)
    seen = {int(m): s for s, m in enumerate(case.labels[2]) if m >= 0}
    known = [int(m) for m in case.primary if m in seen][:3]
    more = [int(m) for m in case.primary if m not in known]
    table = case.xyz[[*known, *more]].copy()
    table[-1] += 2.0
    names = [f"P{m}" for m in (*known, *more)]
    primary = MarkerSet.make(names, table, sigma=np.full(table.shape, SIGMA))
    result = reconstruct(case.detections, case.camera, primary, labels={"2": {seen[m]: f"P{m}" for m in known}})
    assert result, result.reason
    who, _ = identities(result, case)
    place = {n: k for k, n in enumerate(result.markers.name)}
    assert names[-1] not in place
    assert all(who[place[n]] == int(n[1:]) and result.markers.role[place[n]] == "primary" for n in names[:-1])
    assert result.calibration.markers.name.tolist() == result.markers.name.tolist()


def test_given_poses_and_rough_coordinates_are_other_beginnings():
    case = scenes.make(13, "plate", views=6, points=60)
    rough, _ = case.perturbed(1)
    views = [View(f"v{k}", cam_from_model=Pose(rough.rotation[k], rough.translation[k])) for k in range(6)]
    given = reconstruct(case.detections, case.camera, primaries(case), views=views)
    assert set(given.found_by.values()) == {"given"}
    table = MarkerSet.make(
        [f"r{k}" for k in range(40)], case.xyz[:40] + np.random.default_rng(2).normal(0, 0.3, (40, 3))
    )
    begun = reconstruct(case.detections, case.camera, primaries(case), rough=table)
    assert set(begun.found_by.values()) == {"register"}
    for result in (given, begun):
        who, wrong = identities(result, case)
        assert wrong == 0
        assert np.isin(np.flatnonzero(case.views_of >= 3), who).all()


def test_a_picture_that_is_there_twice_takes_part_once():
    case = scenes.make(13, "plate", views=6, points=60)
    rough, _ = case.perturbed(1)
    poses = [Pose(rough.rotation[k], rough.translation[k]) for k in (*range(6), 1)]
    views = [View(f"v{k}", cam_from_model=pose) for k, pose in enumerate(poses)]
    once = reconstruct(case.detections, case.camera, primaries(case), views=views[:6])
    both = reconstruct([*case.detections, case.detections[1]], case.camera, primaries(case), views=views)
    assert both.dropped["v6"].startswith("v1 once more")
    assert len(both.markers) == len(once.markers)
    np.testing.assert_allclose(both.markers.sigma, once.markers.sigma, rtol=1e-6)


def test_given_poses_find_the_primaries_by_their_places():
    """A square of primaries fits in eight ways; the poses say which. The spots are worse than they say, too."""
    case = scenes.make(13, "plate", views=6, points=46)
    rng = np.random.default_rng(3)
    side = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) * 150
    xyz = np.concatenate([case.xyz, side])
    spots, labels = [], []
    for v in range(6):
        pose = Pose(case.poses.rotation[v], case.poses.translation[v])
        mixed = rng.permutation(len(xyz))
        xy = case.camera.project(pose.apply(xyz[mixed]))[0] + rng.normal(0, 0.3, (len(xyz), 2))
        inside = case.camera.in_image(xy)
        spots.append(Detections.make(xy[inside], sigma_px=0.05))
        labels.append(mixed[inside])
    case = replace(case, xyz=xyz, detections=tuple(spots), labels=tuple(labels))
    poses, _ = case.perturbed(1, 0.02, 0.2)
    views = [View(f"v{k}", cam_from_model=Pose(poses.rotation[k], poses.translation[k])) for k in range(6)]
    primary = MarkerSet.make(list("abcd"), side, sigma=np.full((4, 3), SIGMA))
    result = reconstruct(spots, case.camera, primary, views=views, model_px=0.3)
    assert result, result.reason
    assert 0.8 < result.calibration.sigma0 < 1.2
    who, wrong = identities(result, case)
    assert wrong == 0
    place = {str(n): int(w) for n, w in zip(result.markers.name, who, strict=True)}
    assert [place[n] for n in "abcd"] == [46, 47, 48, 49]
    assert refused(case, primary, model_px=0.3).cause == "ambiguous"


def test_useless_pictures_are_dropped_and_named():
    case = scenes.make(14, "plate", views=5, points=50)
    rng = np.random.default_rng(0)
    clutter = Detections.make(rng.uniform(0, 2000, (60, 2)), sigma_px=0.1)
    nothing = Detections.make(np.zeros((0, 2)))
    result = reconstruct([*case.detections[:3], clutter, *case.detections[3:], nothing], case.camera, primaries(case))
    assert result
    assert set(result.dropped) == {"3", "6"}
    assert "spots" in result.dropped["6"]
    assert result.views[3].cam_from_model is None


def refused(case, primary, **more):
    answer = reconstruct(case.detections, case.camera, primary, **more)
    assert isinstance(answer, NotReconstructed)
    assert answer.reason
    return answer


def test_failures_say_why():
    case = scenes.make(15, "plate", views=4, points=40)
    assert refused(case, primaries(case, count=2)).cause == "few_primaries"
    line = MarkerSet.make(["a", "b", "c", "d"], np.outer([0.0, 1, 2, 5], [1.0, 2, 0]))
    assert refused(case, line).cause == "line"
    other = MarkerSet.make(list("abcdef"), np.random.default_rng(5).uniform(-300, 300, (6, 3)))
    assert refused(case, other).cause == "not_found"
    assert refused(case, primaries(case, count=3)).cause == "not_found"
    alone = replace(case, detections=case.detections[:1])
    assert refused(alone, primaries(case)).cause == "too_few"
    clutter = [Detections.make(np.random.default_rng(k).uniform(0, 2000, (50, 2)), sigma_px=0.1) for k in range(4)]
    assert refused(replace(case, detections=tuple(clutter)), primaries(case)).cause == "no_pair"


def two_halves(primary_in_both):
    """Pictures of two sets of markers that share none, or the six primaries only."""
    case = scenes.make(31, "plate", views=8, points=44, missing=0.0)
    side = (case.xyz[:, 0] > 0).astype(int)
    if primary_in_both:
        side[case.primary] = 2
    spots, labels = [], []
    for v, (every, label) in enumerate(zip(case.detections, case.labels, strict=True)):
        mine = np.flatnonzero((label >= 0) & np.isin(side[label], [v // 4, 2]))
        spots.append(every.take(mine))
        labels.append(label[mine])
    return replace(case, detections=tuple(spots), labels=tuple(labels))


@pytest.mark.slow
def test_groups_that_share_nothing_are_named():
    case = two_halves(primary_in_both=False)
    left = np.flatnonzero(case.xyz[:, 0] < 0)
    far = left[np.argsort(-np.abs(case.xyz[left] @ [0.7, 1.0, 0]))[:6]]
    primary = MarkerSet.make([f"P{k}" for k in far], case.xyz[far], sigma=np.full((6, 3), SIGMA))
    result = reconstruct(case.detections, case.camera, primary)
    assert result, result.reason
    assert set(result.dropped) == {"4", "5", "6", "7"}
    assert "connected with 5, 6, 7, but with none of the pictures that have the primary" in result.dropped["4"]
    assert identities(result, case)[1] == 0


@pytest.mark.slow
def test_pictures_that_nothing_connects_are_the_reason_where_the_others_lack_the_primaries():
    case = two_halves(primary_in_both=False)
    spots = [d if v < 4 else d.take(np.arange(10)) for v, d in enumerate(case.detections)]
    answer = refused(replace(case, detections=tuple(spots)), primaries(case))
    assert answer.cause == "unconnected"
    for words in ("4 pictures (4, 5, 6, 7) could not be connected", "0, 1, 2, 3", "no four of 6 primary markers"):
        assert words in answer.reason
    assert answer.dropped == dict.fromkeys("4567", "could not be connected with the others")


@pytest.mark.slow
def test_groups_are_joined_by_the_primaries():
    case = two_halves(primary_in_both=True)
    result = reconstruct(case.detections, case.camera, primaries(case))
    assert result, result.reason
    assert not result.dropped
    who, wrong = identities(result, case)
    assert wrong == 0
    assert np.isin(np.flatnonzero(case.views_of >= 3), who).all()
    error = result.markers.xyz - case.xyz[who]
    assert np.sqrt((error**2).sum(axis=1).mean()) < 3 * np.sqrt((result.markers.sigma**2).sum(axis=1).mean())


def test_matches_by_hand_give_the_others_by_epipolar_lines():
    case = scenes.make(35, "plate", "walk", views=5, points=60)
    seen = [{int(m): s for s, m in enumerate(label) if m >= 0} for label in case.labels]
    shared = sorted(seen[0].keys() & seen[2].keys())
    hand = shared[:: len(shared) // 9][:9]
    labels = {str(v): {seen[v][m]: f"hand {m}" for m in hand} for v in (0, 2)}
    task = Task.checked(case.detections, case.camera, primaries(case), None, labels, (), 0)
    pair = next(tied_pairs(task, task.usable))
    assert (pair.first, pair.second) == (0, 2)
    assert len(pair.a) > 0.7 * len(shared)
    assert (case.labels[0][pair.a] == case.labels[2][pair.b]).mean() > 0.97
    result = reconstruct(case.detections, case.camera, primaries(case), labels=labels)
    assert result, result.reason
    assert {result.found_by["0"], result.found_by["2"]} == {"pair"}
    assert identities(result, case)[1] == 0


def test_labels_on_several_points_are_refused():
    case = scenes.make(33, "plate", views=5, points=50)
    seen = [{int(m): s for s, m in enumerate(label) if m >= 0} for label in case.labels]
    common = sorted(set.intersection(*map(set, seen)))
    primary = MarkerSet.make([f"P{m}" for m in common[:4]], case.xyz[common[:4]])
    labels = {str(v): {seen[v][common[(k + v) % 4]]: f"P{common[k]}" for k in range(3)} for v in range(5)}
    answer = refused(case, primary, labels=labels)
    assert answer.cause == "not_found"
    assert "labels are wrong" in answer.reason


def test_labels_and_a_rough_camera_are_enough_on_a_regular_sheet():
    """Two views of a lattice can always be shifted against each other; four labels in each picture decide."""
    camera = replace(scenes.CAMERA, k1=-0.2, k2=0.1)
    x, y = np.meshgrid(np.arange(-4, 5) * 80.0, np.arange(-3, 4) * 80.0)
    case = scenes.make(34, "plate", "cloud", views=6, points=20, camera=camera)
    xyz = np.stack([x.ravel(), y.ravel(), np.random.default_rng(3).normal(0, 1, x.size)], axis=1)
    corner = [0, 8, 54, 62]
    rng, spots, labels, truth = np.random.default_rng(4), [], {}, []
    for v in range(6):
        pose = Pose(case.poses.rotation[v], case.poses.translation[v])
        xy, _ = camera.project(pose.apply(xyz))
        inside = np.flatnonzero(camera.in_image(xy))
        mixed = rng.permutation(inside)
        spots.append(Detections.make(xy[mixed] + rng.normal(0, 0.1, (len(mixed), 2)), sigma_px=0.1))
        labels[str(v)] = {int(np.flatnonzero(mixed == c)[0]): f"c{c}" for c in corner if c in inside}
        truth.append(mixed)
    case = replace(case, camera=camera, xyz=xyz, detections=tuple(spots), labels=tuple(truth))
    assert sum(len(mine) == 4 for mine in labels.values()) >= 3
    primary = MarkerSet.make([f"c{c}" for c in corner], xyz[corner], sigma=np.full((4, 3), SIGMA))
    rough = replace(camera, focal_px=1.05 * camera.focal_px, k1=0.0, k2=0.0, p1=0.0, p2=0.0)
    result = reconstruct(case.detections, rough, primary, labels=labels, free=("focal_px", "k1", "k2", "p1", "p2"))
    assert result, result.reason
    who, wrong = identities(result, case)
    assert wrong == 0
    assert len(np.unique(who)) == len(who) == len(xyz)
    found = result.cameras["camera"]
    assert abs(found.focal_px - camera.focal_px) < 4 * result.calibration.sigma("camera", "focal_px")
    assert abs(found.k1 - camera.k1) < 4 * result.calibration.sigma("camera", "k1")


def test_a_camera_that_only_turns_is_named():
    case = scenes.make(16, "plate", views=1, points=60)
    rng, first = np.random.default_rng(0), Pose(case.poses.rotation[0], case.poses.translation[0])
    spots = []
    for _ in range(4):
        turn = Pose.from_rotvec(rng.normal(0, 0.03, 3), np.zeros(3))
        xy, _ = case.camera.project((turn @ first).apply(case.xyz))
        inside = case.camera.in_image(xy)
        spots.append(Detections.make(xy[inside] + rng.normal(0, 0.1, xy[inside].shape), sigma_px=0.1))
    answer = refused(replace(case, detections=tuple(spots)), primaries(case))
    assert answer.cause == "baseline"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 12])
def test_a_mirrored_table_of_primaries_is_named(seed):
    """Four of six nearly in a plane were recognised, and the markers 600 mm off: "W55 is not where its table says"."""
    case = scenes.make(seed, "model", "walk", views=7, points=60)
    right = primaries(case)
    for axis in np.eye(3)[:2]:
        no = refused(case, replace(right, xyz=right.xyz * (1 - 2 * axis)))
        assert no.cause == "mirrored", no.reason
        assert "one of its axes has the wrong sign" in no.reason
    assert reconstruct(case.detections, case.camera, right)


def test_symmetric_primaries_are_ambiguous():
    case = scenes.make(17, "plate", views=5, points=50)
    square = np.array([[300.0, 200, 0], [-300, 200, 0], [-300, -200, 0], [300, -200, 0]])
    xyz = np.concatenate([case.xyz[4:], square])
    rng, spots = np.random.default_rng(1), []
    for v in range(5):
        pose = Pose(case.poses.rotation[v], case.poses.translation[v])
        xy, _ = case.camera.project(pose.apply(xyz))
        inside = case.camera.in_image(xy)
        spots.append(Detections.make(xy[inside] + rng.normal(0, 0.1, xy[inside].shape), sigma_px=0.1))
    primary = MarkerSet.make(list("abcd"), square, sigma=np.full((4, 3), SIGMA))
    assert refused(replace(case, detections=tuple(spots)), primary).cause == "ambiguous"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"labels": {"9": {0: "P0"}}}, "unknown views 9"),
        ({"labels": {"0": {0: "X"}}}, "'X' is no primary"),
        ({"labels": {"0": {9999: "P0"}}}, "spot 9999"),
        ({"labels": {"0": {0: "P0", 1: "P0"}}}, "one marker to two spots"),
        ({"free": ("zoom",)}, "'zoom'"),
        ({"model_px": -0.1}, "model_px must be 0 or more, got -0.1"),
        ({"views": [View("a")]}, "one view per picture"),
        ({"views": [View("a")] * 3}, "unique"),
    ],
)
def test_wrong_arguments_are_named(options, words):
    case = scenes.make(18, "plate", views=3, points=30)
    with pytest.raises(ValueError, match=words):
        reconstruct(case.detections, case.camera, primaries(case), **options)
