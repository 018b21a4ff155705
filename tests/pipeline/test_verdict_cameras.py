"""The verdict where cameras, their interior, taps or sentences speak against a result; no word where they do not."""

from dataclasses import replace

import numpy as np
import pytest

from windmark import synth
from windmark.errors import WindmarkError
from windmark.paint import CamerasApart
from windmark.pipeline.infrared.record import FrameRecord
from windmark.pipeline.psp.record import PointRecord
from windmark.pipeline.verdict import BAD, DOUBTFUL, GOOD
from windmark.pipeline.verdict.errors import error_verdict
from windmark.pipeline.verdict.infrared import infrared_verdict
from windmark.pipeline.verdict.lens import OtherInterior, other_interior
from windmark.pipeline.verdict.paint import psp_verdict
from windmark.pipeline.verdict.registered import Sighting, registered_findings, spot_px, what_is_left
from windmark.pipeline.verdict.resized import in_pixels_of
from windmark.pipeline.verdict.series import lost_findings
from windmark.pipeline.verdict.verdict import Verdict
from windmark.registration import register
from windmark.scene import Detections
from windmark.tasks.psp.taps import TapTable

POINT = PointRecord("p1", 0.0, {}, "reduced", seen=0.9, median_sigma_cp=0.01, flicker=0.0)


@pytest.fixture(scope="module")
def seen():
    """A wing before a camera: its spots are exact but for 0.01 px, so that the camera alone can be wrong."""
    test = synth.wind_tunnel(11, size_px=(1000, 800), nodes=4000, clutter=None)
    shot = test.shot("wind-off").perfect
    use = np.flatnonzero(shot.markers.visible & (test.markers.role == "model"))
    xy = shot.markers.ellipse_xy[use] + np.random.default_rng(3).normal(0, 0.01, (len(use), 2))
    spots = Detections.make(xy, cov=np.tile(np.eye(2) * 1e-4, (len(use), 1, 1)), radius_px=np.full(len(use), 3.0))
    return test.cameras["cam1"], spots, test.markers.take(use)


def answer(seen, **off):
    camera, spots, markers = seen
    got = register(spots, markers, replace(camera, cov=None, **{k: getattr(camera, k) + v for k, v in off.items()}))
    assert got, got.reason
    return got


def findings(seen, got):
    return registered_findings(Sighting(got, seen[1], seen[2], unit="mm"))


def test_the_right_camera_is_not_doubted(seen):
    got = answer(seen)
    assert findings(seen, got) == []
    assert other_interior(got, spot_px(got, seen[1])).lead < 3


@pytest.mark.parametrize("off", [{"cx": 13.0}, {"focal_px": 17.0}])
def test_a_camera_that_is_a_little_off_is_told_by_what_it_does_to_the_pose(seen, off):
    """Residuals of a few hundredths of a pixel were "the spots' noise", the camera 5 to 15 mm from where it stood."""
    got = answer(seen, **off)
    other = other_interior(got, spot_px(got, seen[1]))
    truth = answer(seen).cam_from_model.center
    assert other.shift == pytest.approx(float(np.linalg.norm(got.cam_from_model.center - truth)), rel=0.6)
    (found,) = findings(seen, got)
    assert (found.word, found.cause) == (DOUBTFUL, "lens")
    assert "have the pattern of another lens, focal length or principal point" in found.reason
    assert "of its sigmas" in found.reason


def test_a_pose_of_which_a_direction_is_known_exactly_has_a_step_in_sigmas_too(seen):
    """Turns and shifts that are one motion: their covariance has no factor."""
    got = answer(seen, cx=13.0)
    one = np.array([0.001, 0.0, 0.0, 0.0, 1.0, 0.0])
    cov = got.cov.copy()
    cov[:6, :6] = np.diag([0.0, 1e-6, 1e-6, 1.0, 0.0, 1.0]) + np.outer(one, one)
    assert np.isfinite(other_interior(replace(got, cov=cov), spot_px(got, seen[1])).sigmas)


def test_markers_scattered_off_their_table_have_no_such_pattern(seen):
    camera, spots, markers = seen
    leads = []
    for seed in range(12):
        rng = np.random.default_rng([4, seed])
        got = register(spots, replace(markers, xyz=markers.xyz + rng.normal(0, 0.05, markers.xyz.shape)), camera)
        leads.append(other_interior(got, spot_px(got, spots)).lead)
    assert np.mean(np.array(leads) > 6) < 0.1


def test_a_table_that_is_off_smoothly_is_no_lens(seen):
    """A bent model leaves a pattern that a lens explains far better than scatter does."""
    camera, spots, markers = seen
    u = (markers.xyz - markers.xyz.mean(axis=0)) / np.ptp(markers.xyz, axis=0).max()
    leads = []
    for seed in range(8):
        along, way = np.random.default_rng([5, seed]).standard_normal((2, 3))
        bent = replace(markers, xyz=markers.xyz + np.outer((u @ along) ** 2, way))
        got = register(spots, bent, camera)
        other = other_interior(got, spot_px(got, spots))
        leads.append(other.lead)
        assert not other.told
        assert not {"lens", "focal", "camera"} & {f.cause for f in findings(seen, got)}
    assert max(leads) > 10


def test_where_lens_and_table_are_about_as_likely_both_are_said():
    found = OtherInterior(lead=15.0, likelier=-2.4, shift=3.0).said("residuals of 0.4 px", "mm", 0.21)
    assert found.cause == "table"
    assert found.reason.startswith("markers about 0.2 mm off their table: residuals of 0.4 px; another lens or focal")
    assert "is 2 nats less likely" in found.reason
    assert "calibrate the camera" in found.next_step


def test_what_is_left_is_called_noise_only_where_it_is():
    assert what_is_left(0.012, 0.0) == "residuals of 0.012 px RMS are the spots' noise"
    assert "0.04 px per coordinate of it table and lens, not noise" in what_is_left(0.077, 0.04)


def test_cameras_of_a_paint_test_that_contradict_each_other_are_doubted():
    assert psp_verdict([replace(POINT, apart=(CamerasApart("cam1", "cam2", 1.5, 0.006),))]).word == GOOD
    verdict = psp_verdict([replace(POINT, apart=(CamerasApart("cam1", "cam2", 74.0, 0.0),))])
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "cameras")
    assert "ratios of cam1 and cam2 differ by 74 times their sigmas" in verdict.reason
    local = psp_verdict([replace(POINT, apart=(CamerasApart("cam1", "cam2", 1.0, 0.043),))])
    assert (local.word, local.cause) == (DOUBTFUL, "cameras")
    assert "contradict each other on 4.3 % of the nodes that both see" in local.reason


def test_infrared_cameras_that_contradict_each_other_in_some_frames_are_doubted():
    def run(bad):
        return [
            FrameRecord(f"f{k}", k, 0.1 * k, {}, "reduced", seen=0.3, median_T=300.0, median_sigma_T=0.1,
                        apart=(CamerasApart("cam1", "cam2", 10.0 if k < bad else 0.3, 0.0),))
            for k in range(20)
        ]  # fmt: skip

    assert infrared_verdict(run(2)).word == GOOD  # a tenth of the frames, as of everything else
    verdict = infrared_verdict(run(8))
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "cameras")
    assert "differ by 10 times their sigmas where both see in 8 of 20 frames" in verdict.reason


def test_taps_that_are_only_compared_are_judged_too():
    def taps(off):
        sigma = np.full(12, 0.01)
        return TapTable(tuple("abcdefghijkl"), np.zeros(12), 0.1 * sigma, np.full(12, off), sigma, ("",) * 12)

    good = psp_verdict([replace(POINT, taps=taps(0.01))])
    assert good.word == GOOD
    assert "no tap checks" not in good.reason
    verdict = psp_verdict([replace(POINT, taps=taps(0.07))])
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "taps")
    assert "differ by 0.07 in Cp (RMS), 10 times their sigmas" in verdict.reason
    assert np.isnan(TapTable((), *[np.zeros(0)] * 4, ()).typical)


@pytest.mark.parametrize(
    ("reason", "cause"),
    [
        ("units of p_inf, q_inf or p_off are mixed, or pictures with wind and without were exchanged", "units"),
        ("the table of points says 4: rows and pictures were exchanged, or", "lost"),
        ("is another one: camera cam1: the given lens does not fit: with k1 = -0.1, a camera is not where it is said "
         "to be", "camera"),
        ("a camera is not where it is said to be, or is another one", "moved"),
        ("they fit worse (by 28 nats): are radii and normals right, and in the unit of the places?", "discs"),
        ("off-cam1-0.tif: 3 % of the picture is saturated; at most 2 % may be", "saturated"),
        ("no such file", None),
    ],
)  # fmt: skip
def test_a_sentence_tells_its_cause_wherever_it_ends_a_job(reason, cause):
    assert error_verdict(WindmarkError(reason)).cause == (cause or "file")
    (found,) = lost_findings([("p5", reason)], 2, "points")
    assert found.cause == (cause or "lost")
    none = psp_verdict([PointRecord("p1", 0.0, {}, "failed", reason)])
    assert (none.word, none.cause) == (BAD, cause or "no match")


# --- pictures of another size than the camera's --------------------------------------------------------
def test_a_camera_of_pictures_of_another_size_is_the_reason_for_a_bent_model(seen):
    """Of a binned picture only the file's size had been halved: "the model is bent by 0.84 %"."""
    camera, spots, markers = seen
    half = in_pixels_of(camera, 0.5)
    assert (half.focal_px, half.cx) == (camera.focal_px / 2, (camera.cx + 0.5) / 2 - 0.5)
    small = replace(spots, xy=(spots.xy + 0.5) / 2 - 0.5, cov=spots.cov)
    wrong = replace(camera, size_px=(500, 400), cov=None)
    got = register(small, markers, wrong)
    assert got, got.reason
    assert got.deformation is not None
    found = registered_findings(Sighting(got, small, markers, unit="mm"))
    verdict = Verdict.of(found, 1, "", "")
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "camera")
    assert "with 0.5 times the focal length" in verdict.reason
    assert "bent" in [f.cause for f in found]


def test_a_model_that_is_bent_is_not_said_to_be_another_size_of_pictures(seen):
    camera, spots, markers = seen
    u = markers.xyz - markers.xyz.mean(axis=0)
    along = np.linalg.svd(u, full_matrices=False)[2]
    bent = replace(markers, xyz=markers.xyz + np.outer((u @ along[0]) ** 2 / 4e4, along[2]))
    got = register(spots, bent, camera, max_deformation=0.02)
    assert got, got.reason
    assert got.deformation is not None
    found = registered_findings(Sighting(got, spots, bent, unit="mm"))
    assert [f.cause for f in found][:1] == ["bent"]


def test_a_camera_whose_calibration_ends_below_the_model_is_named_with_range_and_temperatures():
    """All of its nodes are lost in all frames; the other camera's temperatures are right, and are all that is left."""

    def records(frames):
        common = {"seen": 0.3, "median_sigma_T": 0.1, "cameras": ("cam1",)}
        return [FrameRecord(f"f{k}", k, 0.1 * k, {}, "reduced", median_T=303.0 + 0.1 * k, **common,
                            beyond={"cam2": "279.2 to 295.8 K"} if k in frames else {}) for k in range(60)]  # fmt: skip

    found = infrared_verdict(records(range(60)))
    assert (found.word, found.cause) == ("doubtful", "lost")
    assert found.reason == (
        "cam2: most of the nodes that it shows have no temperature in 60 of 60 frames: beyond its calibration "
        "(279.2 to 295.8 K); camera cam1 sees 303 to 309 K (medians)"
    )
    assert infrared_verdict(records([3])).word == "good"
