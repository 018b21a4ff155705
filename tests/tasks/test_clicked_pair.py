"""A wrong click is named or said to be unchecked, whatever it does to F; without a camera nothing is matched."""

from dataclasses import replace

import clicked_scenes as sweep
import numpy as np
import pytest

from windmark.geometry import PARAMETERS, Pose, triangulate
from windmark.geometry.two_view import relative_pose_refine
from windmark.scene import Detections
from windmark.tasks.clicked_pair import Clicks, clicked_pair, places


def spots_and_clicks(seed, number, cameras=False, shape="block"):
    camera, noise = (sweep.scenes.CAMERA, 0.1) if cameras else (sweep.PINHOLE, 1.0)
    _, _, spots = sweep.pictures(shape, seed, camera, noise)
    clicks = [s[:number].copy() for s in spots]
    return spots, clicks, (camera, camera) if cameras else None


def solved(spots, clicks, cameras):
    a, b = (Detections.make(s, sigma_px=0.1) for s in spots)
    return clicked_pair(a, b, Clicks(*clicks, tuple(str(k) for k in range(len(clicks[0])))), cameras)


@pytest.mark.parametrize("kind", ["no camera", "camera", "bare"])
@pytest.mark.parametrize(("number", "seed"), [(9, 1), (11, 2), (12, 3), (14, 4)])
def test_a_wrong_click_is_never_silent(kind, number, seed):
    row = sweep.one("wing" if seed % 2 else "block", number, seed, kind, True)
    assert row is not None
    columns = dict(zip(sweep.COLUMNS, row, strict=True))
    assert columns["silent, off"] == 0
    assert columns["refused"] + columns["named"] + columns["unchecked"] + columns["silent"] == 1


@pytest.mark.slow
def test_the_click_that_alone_fixes_the_geometry_is_unchecked_and_so_is_a_wrong_one_there():
    """All but one on one side of the picture: the far one has no other near its line."""
    spots, clicks, _ = spots_and_clicks(5, 40)
    order = np.argsort(clicks[0][:, 0])
    chosen = np.r_[order[:11], order[-1]]
    clicks = [c[chosen] for c in clicks]
    found = solved(spots, clicks, None)
    assert found, found.reason
    assert found.unchecked[11]
    assert found.shows_px[11] > 10
    assert any("hangs on" in n for n in found.notes)
    for far in (15.0, 60.0):
        wrong = clicks[1].copy()
        wrong[11] += [0.0, far]
        again = solved([spots[0], np.vstack([spots[1], wrong[11]])], [clicks[0], wrong], None)
        assert not again or again.wrong[11] or again.unchecked[11]


def test_without_a_camera_only_clicks_are_matches_and_with_one_the_others_too():
    for cameras in (False, True):
        found = solved(*spots_and_clicks(7, 12, cameras))
        assert found, found.reason
        assert not found.wrong.any()
        assert (len(found.spot_a) > 12) == cameras
        assert found.by_hand.sum() == 12
        if cameras:
            assert not found.unchecked.any()


def test_no_spots_and_clicks_beside_them():
    spots, clicks, _ = spots_and_clicks(7, 12)
    none = Detections.make(np.zeros((0, 2)))
    found = clicked_pair(none, none, Clicks(*clicks, tuple("abcdefghijkl")), None)
    assert not found
    assert "0 matches" in found.reason
    clicks[0][3] += [0, 4000]
    found = solved(spots, clicks, None)
    assert found.wrong[3]
    assert not found.unchecked[3]
    assert any("click 3: no spot" in n for n in found.notes)


@pytest.mark.slow
def test_the_camera_s_covariance_is_in_that_of_the_pose():
    """Cameras drawn from it turn the refined pose by what it adds: 60 draws, in the directions that it adds to."""
    _, _, spots = sweep.pictures("block", 7, sweep.scenes.CAMERA, 0.05)
    a, b = (Detections.make(s, sigma_px=0.05) for s in spots)
    clicks = Clicks(spots[0][:12], spots[1][:12], tuple(str(k) for k in range(12)))
    exact, sigma = replace(sweep.scenes.CAMERA, cov=None), np.zeros(len(PARAMETERS))
    sigma[PARAMETERS.index("focal_px")], sigma[PARAMETERS.index("aspect")], sigma[PARAMETERS.index("cx")] = 8, 2e-3, 6
    known = replace(exact, cov=np.diag(sigma**2))
    plain, added = clicked_pair(a, b, clicks, (exact, exact)), clicked_pair(a, b, clicks, (known, replace(known)))
    assert any("an aspect 1 % off by" in note for note in plain.notes)
    assert not any("no covariance" in note for note in added.notes)
    values, axes = np.linalg.eigh(added.pose_cov - plain.pose_cov)
    assert (values > -1e-12).all()
    told, rng, off = values > 1e-3 * values.max(), np.random.default_rng(3), []
    assert told.sum() in (2, 3)
    xy = a.xy[plain.spot_a], b.xy[plain.spot_b]
    for _ in range(60):
        other = exact.with_parameters(exact.parameters() + rng.normal(0, sigma))
        found = relative_pose_refine(plain.pose, *xy, other, other).b_from_a
        off.append(((axes[:, told].T @ (found @ plain.pose.inverse()).log()) ** 2 / values[told]).mean())
    assert 0.6 < np.mean(off) < 1.5  # chi^2 of 120 numbers or more is 1 +- 0.13, and the step is to first order


@pytest.mark.slow
def test_places_are_off_by_what_their_ellipsoids_say():
    """The pose's covariance is in them: without it they would be off by several sigma."""
    off, bare = [], []
    for seed in range(4):
        camera = sweep.scenes.CAMERA
        true, poses, spots = sweep.pictures("block", seed, camera, 0.1)
        detections = tuple(Detections.make(s, sigma_px=0.1) for s in spots)
        names = tuple(str(k) for k in range(12))
        found = clicked_pair(*detections, Clicks(*(s[:12].copy() for s in spots), names), (camera, camera))
        assert found, found.reason
        at = places(found, detections, (camera, camera))
        step = poses[1] @ poses[0].inverse()
        known = triangulate(camera, [Pose.identity(), step], np.array(true)[:, found.spot_a]).xyz
        error = at.xyz - known / np.linalg.norm(step.translation)
        right = found.spot_a == found.spot_b
        assert right.all()
        off += np.einsum("ni,nij,nj->n", error, np.linalg.inv(at.cov), error).tolist()
        exact = places(replace(found, pose_cov=None), detections, (camera, camera))
        bare += np.einsum("ni,nij,nj->n", error, np.linalg.inv(exact.cov), error).tolist()
    assert 1.0 < np.mean(off) < 6.0  # 3 on average; those of one pair are not independent
    assert np.mean(bare) > 2 * np.mean(off)


def rows_of(seed, hidden):
    """A plate of rows along the epipolar lines: spots of both pictures with their numbers on it, and eight clicks.

    Where some is hidden the first picture lacks the left columns and the second one the right ones: shifted by as many
    columns, more spots match than as they are.
    """
    rng = np.random.default_rng(seed)
    x, y = (v.ravel() for v in np.meshgrid(np.arange(12) * 25.0 - 137, np.arange(6) * 25.0 - 62))
    xyz, camera = np.c_[x, y, np.sqrt(300.0**2 - y**2) - 300], replace(sweep.PINHOLE, focal_px=2500.0)
    spots, number = [], []
    for side in (-1, 1):
        angle = side * np.radians(8.0)
        pose = Pose.look_at([620 * np.sin(angle), 0, 620 * np.cos(angle)], [0, 0, 0], [0, 1, 0])
        xy = camera.project(pose.apply(xyz))[0] + rng.normal(0, 0.05, (len(xyz), 2))
        seen = rng.permutation(np.flatnonzero((x * side < 90) if hidden else np.isfinite(x)))
        spots.append(xy[seen])
        number.append(seen)
    both = rng.choice(np.intersect1d(*number), 8, replace=False)
    where = [[n.tolist().index(k) for k in both] for n in number]
    clicks = [s[w] for s, w in zip(spots, where, strict=True)]
    return spots, clicks, (camera, camera), number


@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_of_rows_along_the_lines_clicks_decide_and_not_how_many_spots_match(seed, hidden):
    spots, clicks, cameras, (a, b) = rows_of(seed, hidden)
    found = solved(spots, clicks, cameras)
    assert found, found.reason
    assert not found.wrong.any(), "they are right, all of them"
    assert found.by_hand.sum() == 8
    assert (a[found.spot_a] == b[found.spot_b]).all()
    assert len(found.spot_a) > 0.9 * len(np.intersect1d(a, b))


def test_a_click_one_pitch_off_is_wrong_among_right_ones():
    spots, clicks, cameras, (a, b) = rows_of(3, False)
    meant = [int(a[np.flatnonzero((spots[0] == c).all(axis=1))[0]]) for c in clicks[0]]
    bad = next(k for k, m in enumerate(meant) if m % 12 < 11 and m + 1 not in meant)
    clicks[1][bad] = spots[1][b == meant[bad] + 1][0]
    found = solved(spots, clicks, cameras)
    assert found, found.reason
    assert found.wrong.tolist() == [k == bad for k in range(8)]
    assert (a[found.spot_a] == b[found.spot_b]).all()


def test_clicks_of_which_most_are_wrong_are_refused():
    """Their second places are exchanged in pairs: what grows from some contradicts others, and no pattern has most."""
    spots, clicks, cameras, _ = rows_of(4, False)
    clicks[1][:6] = clicks[1][[1, 0, 3, 2, 5, 4]]
    assert not solved(spots, clicks, cameras)
