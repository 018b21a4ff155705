"""A focal length that changes, or is another one, by less than any single image of a sequence shows."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.geometry import PARAMETERS, Camera, Pose
from windmark.pipeline.focal_series import FOCAL, INTERIOR, _Fit, focal_series, pov_change
from windmark.pipeline.track_results import PoseRow, pov_with_sigma
from windmark.pipeline.verdict.focal import cov_with_focal, focal_unchecked, with_focal
from windmark.pipeline.verdict.lens import by_pose
from windmark.pipeline.verdict.track import track_verdict
from windmark.pipeline.verdict.verdict import DOUBTFUL, GOOD
from windmark.scene import MarkerSet

NOISE = 0.02
CAMERA = Camera((800, 600), 1150.0, k1=-0.08)
RNG = np.random.default_rng(3)
XYZ = RNG.uniform(-0.5, 0.5, (40, 3)) * [400.0, 400.0, 150.0]
TABLE = MarkerSet.make([f"m{i}" for i in range(len(XYZ))], XYZ)
COUNT = 30


def posed(camera: Camera, xyz, spots, pose: Pose):
    """Pose, residuals and covariance of the spots of markers."""
    for _ in range(5):
        place = pose.apply(xyz)
        xy, _, by_xyz, _ = camera.project_jacobian(place)
        by = by_pose(by_xyz, place).reshape(-1, 6)
        pose = Pose.exp(np.linalg.lstsq(by, (spots - xy).reshape(-1), rcond=None)[0]) @ pose
    return pose, camera.project(pose.apply(xyz))[0] - spots, np.linalg.inv(by.T @ by) * NOISE**2


def sequence(focal=lambda t: 1.0, camera=CAMERA, seed=0, true=CAMERA, xyz=XYZ, table=XYZ, far=1250.0, count=COUNT):
    """Rows of a model that sways and comes nearer before a camera whose focal length is ``focal`` times its own."""
    rng, rows = np.random.default_rng(seed), []
    for k in range(count):
        t = k / max(count - 1, 1)
        turn, shift = [0.1 + 0.04 * t, 0.4 + 0.1 * np.sin(5 * t), 0.03 * t], [20 * t, 10 * np.sin(7 * t), far - 40 * t]
        pose = Pose.from_rotvec(turn, shift)
        seen = np.flatnonzero(rng.random(len(table)) < 0.95)
        place = (xyz(t) if callable(xyz) else xyz)[seen]
        spots = replace(true, focal_px=true.focal_px * focal(t)).project(pose.apply(place))[0]
        spots = spots + rng.normal(0, NOISE, spots.shape)
        found, off, cov = posed(camera, table[seen], spots, pose)
        each2, (pov, sigma) = (off**2).sum() / (2 * len(seen) - 6), pov_with_sigma(found, cov)
        rows.append(PoseRow(
            k, f"f{k}", float(k), "tracked", "", True, 0.0, len(seen), len(seen), float(np.sqrt(2 * each2)), pov, sigma,
            found, (seen, np.concatenate([spots, off], axis=1)), excess_px=float(np.sqrt(max(each2 - NOISE**2, 0.0))),
            spot_px=NOISE,
        ))  # fmt: skip
    return rows


def verdict_of(rows, camera=CAMERA):
    series = focal_series(rows, TABLE, camera)
    return track_verdict(rows, "mm", focal=series), series


def test_a_zoom_that_drifts_is_told_with_its_amount_and_its_images_sigmas_hold_it():
    """Distances were 60 sigmas off at the end, "good", as no image shows it."""
    rows = sequence(lambda t: 1 + 0.002 * t)
    assert track_verdict(rows, "mm").word == GOOD
    verdict, series = verdict_of(rows)
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "lens"), verdict
    assert "longer at the end (f29) than at the start (1150.0 -> 115" in verdict.reason
    assert series.found.kind == "drift"
    assert abs(series.found.part - 0.002) < 4 * series.found.sigma < 0.0016
    wide, off = with_focal(rows, series), np.array([r.pov[5] - (1250 - 40 * r.index / 29) for r in rows])
    assert np.abs(off / [r.sigma[5] for r in rows]).max() > 30
    assert np.abs(off / [r.sigma[5] for r in wide]).max() < 3
    cov = cov_with_focal(np.diag([1e-10] * 3 + [1e-4] * 3), rows, series, TABLE, CAMERA)
    assert np.sqrt(cov[5, 5]) == pytest.approx(abs(series.effect[-1, 5]), rel=0.1)


def test_a_refocus_is_told_with_its_image():
    verdict, series = verdict_of(sequence(lambda t: 1.0 + 0.002 * (t > 0.5)))
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "lens")
    assert series.found.kind == "step"
    assert abs(series.found.first - 15) <= 2
    assert f"% longer from f{series.found.first} on" in verdict.reason
    assert not series.part[: series.found.first - 4].any()


@pytest.mark.parametrize(
    ("start", "loose", "end", "either"),
    [(0.0, 0.3, False, False), (-2.0, 0.3, True, False), (0.0, 1.0, False, True), (-2.0, 1.0, False, True)],
)
def test_whether_the_given_one_is_that_of_the_beginning_or_of_the_end_is_left_open_where_it_is(
    start, loose, end, either
):
    """Where the focal length at the beginning is hardly known, either part of the images may be the one that is off."""
    beside, shape = np.zeros(len(INTERIOR)), np.array([0.0, 0.0, 1.0])
    beside[FOCAL] = start
    fit = _Fit(shape, 2.0, 0.1, beside, np.zeros(len(INTERIOR)), loose)
    assert (fit.at_end, fit.either) == (end, either)
    assert np.abs(fit.part).tolist() == ([2.0, 2.0, 2.0] if either else (2 * np.abs(shape - end)).tolist())


def test_a_refocus_that_many_images_tell_is_at_its_end_of_them():
    after, before = (lambda t: 1.0 + 0.003 * (t > 0.55)), (lambda t: 1.0 - 0.003 * (t < 0.55))
    for focal in (after, before):
        verdict, series = verdict_of(sequence(focal))
        assert (series.found.either, series.found.at_end) == (False, focal is before)
        assert "if the camera file" not in verdict.reason


def test_a_focal_length_that_is_another_one_in_all_images_is_told():
    verdict, series = verdict_of(sequence(lambda t: 0.996))
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "lens")
    assert series.found.kind == "constant"
    assert abs(series.found.part + 0.004) < 4 * series.found.sigma
    assert "% shorter than the camera file says" in verdict.reason


def test_what_a_longer_focal_length_does_to_a_pose_is_what_it_does():
    """To first order, against a pose that is found with it."""
    xy = CAMERA.project((pose := Pose.from_rotvec([0.1, 0.4, 0.0], [5.0, 2.0, 1250.0])).apply(XYZ))[0]
    found, off, cov = posed(CAMERA, XYZ, xy, pose)
    other, _, _ = posed(replace(CAMERA, focal_px=1151.15), XYZ, xy, pose)
    every = np.arange(len(XYZ))
    row = PoseRow(0, "f", 0.0, "cold", "", False, 0.0, 40, 40, 0.0, *pov_with_sigma(found, cov), found,
                  (every, np.concatenate([xy, off], axis=1)), spot_px=NOISE)  # fmt: skip
    true = pov_with_sigma(other, cov)[0]
    assert pov_change(row, TABLE, CAMERA, 0.001) == pytest.approx(row.pov - true, rel=0.02, abs=1e-4)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("what", ["plain", "table", "lens", "camera", "short"])
def test_sequences_without_fault_are_good(what, seed):
    """Moving models; a table that is off, a lens of another day's calibration, a camera with its own sigmas."""
    rng, camera, true, table = np.random.default_rng(seed), CAMERA, CAMERA, XYZ
    if what == "table":
        table = XYZ + rng.normal(0, 0.02, XYZ.shape)
    elif what == "lens":
        true = replace(CAMERA, k1=-0.077, cx=CAMERA.cx + 1.5)
    elif what == "camera":
        sigma = {"focal_px": 1.2, "cx": 1.0, "k1": 0.002}
        cov = np.diag([sigma.get(p, 0.0) ** 2 for p in PARAMETERS])
        camera = replace(CAMERA, cov=cov)
        true = replace(CAMERA, **{k: getattr(CAMERA, k) + s * rng.normal() for k, s in sigma.items()})
    rows = sequence(camera=camera, true=true, table=table, seed=seed, count=5 if what == "short" else COUNT)
    markers = MarkerSet.make(TABLE.name, table)
    series = focal_series(rows, markers, camera)
    assert series.found is None
    assert with_focal(rows, series) == rows


def test_a_model_that_bends_a_little_more_from_image_to_image_is_no_zoom():
    high = (XYZ[:, 0] / 200) ** 2
    rows = sequence(xyz=lambda t: XYZ + 8.0 * t * np.outer(high, [0, 0, 1]))
    series = focal_series(rows, TABLE, CAMERA)
    verdict = track_verdict(rows, "mm", focal=series)
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "bent"), verdict
    assert "bends more and more from the first image to the last" in verdict.reason
    assert with_focal(rows, series) == rows


def test_what_a_flat_model_far_away_does_not_tell_is_said():
    flat = XYZ * [1.0, 1.0, 0.0]
    table = MarkerSet.make(TABLE.name, flat)
    rows = sequence(xyz=flat, table=flat, far=4000.0, count=5)
    series = focal_series(rows, table, CAMERA)
    assert series.found is None
    (said,) = focal_unchecked(rows, series, table, CAMERA, "mm")
    assert said.what == "focal length"
    assert "taken from the camera file" in said.words
    assert "these 5 images together, and 0.1 % of it changes distances by 4 mm" in said.words
    assert not focal_unchecked([], series, table, CAMERA, "mm")


def test_few_markers_and_images_without_pose_tell_nothing():
    rows = sequence(xyz=XYZ[:6], table=XYZ[:6], count=4)
    lost = replace(rows[1], cam_from_model=None, matches=(np.zeros(0, int), np.zeros((0, 4))), matched=0)
    markers = MarkerSet.make(TABLE.name[:6], XYZ[:6])
    series = focal_series([rows[0], lost, *rows[2:]], markers, CAMERA)
    assert series.found is None
    assert np.isinf(series.shown)
    assert "a deviation would go unnoticed" in focal_unchecked(rows, series, markers, CAMERA, "mm")[0].words
