"""The verdict: right word and cause from results with planted faults; no word against clean ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from windmark import io, synth
from windmark.errors import WindmarkError, g1
from windmark.pipeline.deform.followed import Followed
from windmark.pipeline.deform.record import FrameRecord as DeformFrame
from windmark.pipeline.infrared.record import FrameRecord
from windmark.pipeline.job import run_project
from windmark.pipeline.project import read_project
from windmark.pipeline.psp.record import PointRecord, SectionRecord
from windmark.pipeline.track_results import PoseRow
from windmark.pipeline.verdict import BAD, CAUSES, DOUBTFUL, GOOD, Finding, Verdict
from windmark.pipeline.verdict.cell import calibration_findings
from windmark.pipeline.verdict.deform import deform_verdict
from windmark.pipeline.verdict.doubts import STEPS
from windmark.pipeline.verdict.errors import error_verdict
from windmark.pipeline.verdict.followed import followed_findings
from windmark.pipeline.verdict.grid import units_findings
from windmark.pipeline.verdict.infrared import infrared_verdict
from windmark.pipeline.verdict.network import _left_out, reconstruct_verdict
from windmark.pipeline.verdict.paint import black_findings, psp_verdict
from windmark.pipeline.verdict.picture import picture_findings, picture_state, series_blur
from windmark.pipeline.verdict.reasons import MOVED
from windmark.pipeline.verdict.registered import REFUSALS, refused
from windmark.pipeline.verdict.run import run_verdict
from windmark.pipeline.verdict.track import track_verdict
from windmark.registration import NotRegistered, register
from windmark.registration.result import CAUSES as REGISTRATION_CAUSES
from windmark.scene import Detections, MarkerSet
from windmark.scene.repeated import ONCE_MORE
from windmark.tasks.calibrate.picture import Picture
from windmark.tasks.deform.task import Sight
from windmark.tasks.psp.taps import TapTable
from windmark.tasks.reconstruct.result import NotReconstructed
from windmark.tasks.unexplained import unexplained

_PROJECT = """\
title = "small"
length_unit = "mm"
[[camera]]
file = "camera.json"
[[image]]
file = "a.tif"
[markers]
file = "markers.csv"
roles = ["model"]
[grid]
file = "model.grid"
[detect]
radius_px = 3
"""


@pytest.fixture(scope="module")
def tunnel():
    return synth.wind_tunnel(11, size_px=(1000, 800), nodes=4000, clutter=None, tip_fraction=0.03)


def judged(folder: Path, test, shot="wind-off", *, camera=None, markers=None, image=None) -> Verdict:
    io.write_camera(folder / "camera.json", camera or test.cameras["cam1"])
    io.write_markers(folder / "markers.csv", markers or test.markers, length_unit="mm")
    io.write_mesh(folder / "model.grid", test.mesh)
    io.write_image(folder / "a.tif", test.shot(shot).image if image is None else image)
    (folder / "project.toml").write_text(_PROJECT)
    try:
        return run_verdict(run_project(read_project(folder / "project.toml"), workers=1))
    except WindmarkError as error:
        return error_verdict(error)


def test_a_clean_job_is_good(tmp_path, tunnel):
    verdict = judged(tmp_path, tunnel)
    assert (verdict.word, verdict.cause, verdict.findings) == (GOOD, "", ())
    assert "29 markers" in verdict.reason
    assert verdict.next_step


def test_wrong_focal_length(tmp_path, tunnel):
    camera = tunnel.cameras["cam1"]
    verdict = judged(tmp_path, tunnel, camera=replace(camera, focal_px=1.08 * camera.focal_px))
    assert (verdict.word, verdict.cause) == (BAD, "focal")


def test_table_in_inches_that_says_millimetres(tmp_path, tunnel):
    m = tunnel.markers
    verdict = judged(tmp_path, tunnel, markers=replace(m, xyz=m.xyz / 25.4, radius=m.radius / 25.4))
    assert verdict.cause == "units"
    assert "inch" in verdict.reason


def test_blurred_picture(tmp_path, tunnel):
    image = tunnel.shot("wind-off").image
    verdict = judged(tmp_path, tunnel, image=gaussian_filter(image.astype(float), 2.6).astype(image.dtype))
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "blurred")


def test_bent_model(tmp_path, tunnel):
    verdict = judged(tmp_path, tunnel, "wind-on")
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "bent")


def test_a_marker_that_is_off_its_table_is_named(tmp_path, tunnel):
    m = tunnel.markers
    seen = np.flatnonzero((m.role == "model") & tunnel.shot("wind-off").perfect.markers.visible)
    xyz = m.xyz.copy()
    xyz[seen[6]] += [4.0, 3.0, 0.0]
    verdict = judged(tmp_path, tunnel, markers=replace(m, xyz=xyz))
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "marker")
    assert str(m.name[seen[6]]) in verdict.reason


def test_markers_scattered_off_their_table(tmp_path, tunnel):
    m = tunnel.markers
    xyz = m.xyz + np.random.default_rng(5).normal(0, 0.5, m.xyz.shape)
    verdict = judged(tmp_path, tunnel, markers=replace(m, xyz=xyz))
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "table")
    off = float(verdict.reason.split("about ")[1].split()[0])
    assert 0.25 < off < 1.0


@pytest.mark.parametrize("what", ["picture", "table"])
def test_a_mirrored_picture_or_table(tmp_path, tunnel, what):
    """Its chance matches 16 of 16 markers: that it "could be chance" is true and helps nobody."""
    m, image = tunnel.markers, tunnel.shot("wind-off").image
    if what == "picture":
        verdict = judged(tmp_path, tunnel, image=image[:, ::-1])
    else:
        verdict = judged(tmp_path, tunnel, markers=replace(m, xyz=m.xyz * [1, 1, -1], normal=m.normal * [1, 1, -1]))
    assert (verdict.word, verdict.cause) == (BAD, "mirrored")
    assert "the picture or the table is mirrored" in verdict.reason


@pytest.mark.parametrize(
    ("change", "cause", "says"),
    [({"normal": -1.0}, "discs", "the normals of the table point into the model"),
     ({"sigma": 30.0}, "units", "the sigmas of the table are in another unit than its places")],
)  # fmt: skip
def test_what_makes_a_table_useless_is_said(tmp_path, tunnel, change, cause, says):
    """They had been "no pose explains the neighbourhood of any three markers", or chance."""
    m = tunnel.markers
    wrong = {k: m.normal * v if k == "normal" else np.full(m.xyz.shape, v) for k, v in change.items()}
    verdict = judged(tmp_path, tunnel, markers=replace(m, **wrong))
    assert (verdict.word, verdict.cause) == (BAD, cause), verdict.reason
    assert says in verdict.reason


def test_a_symmetric_model_under_a_grid_that_hides_it_is_not_called_mirrored(tunnel):
    """Its mirror image is the table with other names, and registers without the grid, as the table does."""
    m = tunnel.markers.take(np.flatnonzero(tunnel.markers.role == "model"))
    half = m.take(np.flatnonzero(np.abs(m.xyz[:, 0]) > 20))
    both = np.concatenate([half.xyz, half.xyz * [-1, 1, 1]]), np.concatenate([half.normal, half.normal * [-1, 1, 1]])
    names = [f"{n}{s}" for s in "ab" for n in half.name.tolist()]
    markers = MarkerSet.make(names, both[0], normal=both[1], radius=np.tile(half.radius, 2))
    camera, pose = tunnel.cameras["cam1"], tunnel.shot("wind-off").view.cam_from_model
    xy, ok = camera.project(pose.apply(markers.xyz))
    seen = ok & camera.in_image(xy) & ((pose.rotate(markers.normal) * pose.apply(markers.xyz)).sum(axis=1) < 0)
    spots = Detections.make(xy[seen], sigma_px=0.02, radius_px=3.0)
    assert register(spots, markers, camera)
    no = NotRegistered("hidden by a grid", "nothing")
    assert unexplained(spots, markers, camera, no, {}) is no


def test_saturated_picture(tmp_path, tunnel):
    image = tunnel.shot("wind-off").image
    level = np.quantile(image, 0.97)
    verdict = judged(tmp_path, tunnel, image=np.minimum(image, level).astype(image.dtype))
    assert verdict.cause == "saturated"


def test_every_refusal_has_a_cause_and_a_next_step():
    assert set(STEPS) <= set(CAUSES)
    assert set(REFUSALS) == set(REGISTRATION_CAUSES)
    for cause in REGISTRATION_CAUSES:
        found = refused(NotRegistered("why", cause), 40)
        assert found.word == BAD
        assert found.cause in CAUSES
        assert found.next_step
    assert refused(NotRegistered(f"camera cam2 is {MOVED[2]}", "wrong_camera"), 40).cause == "moved"
    few = NotRegistered("3 markers", "too_few")
    assert "more markers" in refused(few, 3).next_step  # no spot that is found anew helps a table of three
    assert "detected spots" in refused(few, 40).next_step


def test_a_label_is_what_is_checked_first_where_nothing_fits_with_it():
    """Of a binding label at another marker's spot the next step was "more markers in view"."""
    step = refused(NotRegistered("chance", "weak", options={"fixed": {5: "W02"}}), 40).next_step
    assert step.startswith("check the label W02")
    assert "check the labels W02, W05" in refused(
        NotRegistered("chance", "nothing", options={"fixed": {5: "W02", 7: "W05"}}), 40
    ).next_step
    for without in ({}, {"fixed": {}}, {"fixed": ({}, {})}):
        assert refused(NotRegistered("chance", "weak", options=without), 40).next_step.startswith("more markers")


def test_what_explains_comes_first_and_one_bad_image_makes_no_job_bad():
    few = Finding(BAD, "few", "few markers", "more", "a")
    blurred = Finding(DOUBTFUL, "blurred", "blurred", "focus", "a")
    both = Verdict.of([few, blurred], 3, "", "")
    assert (both.word, both.cause) == (DOUBTFUL, "blurred")
    assert both.reason.startswith("a: ")
    alone = Verdict.of([few], 1, "", "")
    assert alone.word == BAD
    every = Verdict.of([few.at(name) for name in "abc"], 3, "", "")
    assert every.word == BAD
    assert "2 more of 3" in every.reason


def test_record_and_back():
    verdict = Verdict.of([Finding(BAD, "units", "inches", "convert", "a")], 1, "", "")
    assert Verdict.of_record(verdict.record()) == verdict


def test_finding_refuses_what_is_no_cause():
    with pytest.raises(ValueError, match="cause"):
        Finding(BAD, "bad luck", "why", "what")


def test_picture_without_spots_and_flat_pictures():
    for image in (np.zeros((40, 50), np.uint8), np.full((40, 50), 7.5), np.full((40, 50), np.nan)):
        state = picture_state(image, None, "dark")
        assert not [f for f in picture_findings(state) if f.cause == "blurred"]


def test_series_without_any_result_are_bad():
    nan = np.full(6, np.nan)
    none = (np.zeros(0, np.int64), np.zeros((0, 4)))
    row = PoseRow(0, "a", 0.0, "lost", "no pose", False, 0.0, 0, 0, np.nan, nan, nan, None, none)
    for verdict in (track_verdict([row], "mm"), track_verdict([], "mm"), deform_verdict([]), psp_verdict([]),
                    infrared_verdict([])):  # fmt: skip
        assert verdict.word == BAD
        assert verdict.reason
        assert verdict.next_step


def test_units_of_three_markers_say_nothing(tunnel):
    assert units_findings(tunnel.markers.take([0, 1, 2]), tunnel.mesh, "mm") == []


@pytest.mark.parametrize(("value", "words"), [(0.0109, "0.01"), (0.36, "0.4"), (2.2, "2"), (0.0, "0")])
def test_an_estimate_has_one_digit(value, words):
    assert g1(value) == words


@pytest.mark.parametrize(
    ("reason", "cause"),
    [
        ("no wind-off frame can be used; a camera is not where it is said to be, or is another one", "moved"),
        ("a camera is not where it is said to be, or is another one: the given focal length of 1700 px", "focal"),
        ("no such file", "file"),
    ],
)
def test_a_series_that_gives_up_names_the_camera_at_fault(reason, cause):
    assert error_verdict(WindmarkError(reason)).cause == cause


def frames(**figures):
    return [FrameRecord(f"f{k}", k, 0.1 * k, {}, "reduced", **{"median_T": 300.0, **figures}) for k in range(4)]


def test_an_infrared_run_is_judged_by_what_its_cameras_see_and_by_its_sigma():
    assert infrared_verdict(frames(seen=0.3, median_sigma_T=0.1)).word == GOOD  # cameras see one side of a model
    fewer = [*frames(seen=0.3, median_sigma_T=0.1)[:1], *frames(seen=0.1, median_sigma_T=0.1)[1:]]
    assert infrared_verdict(fewer).cause == "covered"
    flux = {"seen": 0.3, "median_sigma_T": 0.1, "median_q": 39.0}
    assert infrared_verdict(frames(**flux, median_sigma_q=9.0)).word == GOOD
    unknown = infrared_verdict(frames(**flux, median_sigma_q=99.0))
    assert (unknown.word, unknown.cause) == (DOUBTFUL, "weak")
    assert "heat fluxes are known to 99 W/m² (median, 1 sigma), which is more than they are" in unknown.reason
    verdict = infrared_verdict(frames(seen=0.3, median_sigma_T=190.0))
    assert (verdict.word, verdict.cause) == (BAD, "units")
    assert "known to 190 K only" in verdict.reason


def test_a_point_of_a_polar_is_judged_by_the_side_that_cameras_show():
    point = PointRecord("p1", 0.0, {}, "reduced", seen=0.33, median_sigma_cp=0.01, flicker=0.0, shown={"all": 0.36})
    verdict = psp_verdict([point])
    assert verdict.word == GOOD
    assert "loads are of the 36 % of the area that cameras show" in verdict.reason
    assert psp_verdict([replace(point, seen=0.1)]).cause == "covered"


def test_loads_that_were_asked_for_and_are_refused_are_doubted():
    said = "no loads: integrate_loads: zone07 of wing lies upon zone01 of wing: 49.8 % of the area of wing is twice"
    point = PointRecord("p1", 0.0, {}, "reduced", remarks=(said,), seen=0.9, median_sigma_cp=0.01, flicker=0.0)
    verdict = psp_verdict([point])
    assert (verdict.word, verdict.cause, verdict.reason) == (DOUBTFUL, "lost", said.replace("integrate_loads: ", ""))


def test_thermocouples_that_contradict_each_other_are_doubted_and_one_left_out_is_not():
    said = "thermocouples contradict each other: 14 times as much as their sigmas say"
    point = PointRecord("p1", 0.0, {}, "reduced", remarks=(said,), seen=0.9, median_sigma_cp=0.01, flicker=0.0)
    verdict = psp_verdict([point])
    assert (verdict.word, verdict.cause, verdict.reason) == (DOUBTFUL, "temperature", said)
    assert psp_verdict([replace(point, remarks=("thermocouples that do not count: T3 (8 K)",))]).word == GOOD


def test_thermocouples_that_contradict_recovery_are_doubted_where_no_tap_checks_the_level():
    said = "thermocouples and recovery contradict each other: the wall is at 305 K by readings (median)"
    point = PointRecord("p1", 0.0, {}, "reduced", remarks=(said,), seen=0.9, median_sigma_cp=0.01, flicker=0.0)
    verdict = psp_verdict([point])
    assert (verdict.word, verdict.cause, verdict.reason) == (DOUBTFUL, "temperature", said)
    fit = {"scatter_Pa": 90.0, "noise_Pa": 100.0, "rms_Pa": 90.0}
    assert psp_verdict([replace(point, fit=fit)]).word == GOOD


def test_a_calibration_that_is_extrapolated_is_doubted_but_where_taps_say_how_it_holds():
    said = "the paint's calibration is extrapolated: 54 % of the nodes lie outside it"
    point = PointRecord("p1", 0.0, {}, "reduced", remarks=(said,), seen=0.9, median_sigma_cp=0.01, flicker=0.0)
    verdict = psp_verdict([point])
    assert (verdict.word, verdict.cause, verdict.reason) == (DOUBTFUL, "weak", said)
    fit = {"scatter_Pa": 0.0, "rms_Pa": 100.0, "leave_one_out_rms_Pa": 120.0, "noise_Pa": 100.0, "slope_free": 1.0}
    assert psp_verdict([replace(point, fit=fit)]).word == GOOD
    little = "5 % of the nodes lie outside the paint's calibration in pressure (60000 to 130000 Pa)"
    assert psp_verdict([replace(point, remarks=(little,))]).word == GOOD


def test_a_section_that_is_missing_is_doubted():
    said = "section far: the plane does not meet the grid"
    point = PointRecord("p1", 0.0, {}, "reduced", remarks=(said,), seen=0.9, median_sigma_cp=0.01, flicker=0.0)
    assert psp_verdict([point]).word == GOOD
    verdict = psp_verdict([point], sections=["far"])
    assert (verdict.word, verdict.cause, verdict.reason) == (DOUBTFUL, "lost", f"left out: {said}")


def test_a_section_without_loads_is_doubted_by_name():
    none, flags = np.zeros(0), np.zeros(0, bool)
    cut = SectionRecord("tip", np.zeros((0, 3)), none, flags, none, none, np.zeros(0, np.int32), none, none, none)
    blind = replace(cut, name="root", why="no camera shows any of it")
    point = PointRecord("p1", 0.0, {}, "reduced", seen=0.9, median_sigma_cp=0.01, flicker=0.0, sections=(cut,))
    assert psp_verdict([point], sections=["tip"]).word == GOOD
    verdict = psp_verdict([replace(point, sections=(cut, blind))], sections=["tip", "root"])
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "lost")
    assert verdict.reason == "no loads of section root: no camera shows any of it"


def test_a_level_without_light_that_nothing_says_is_doubted():
    point = PointRecord("p1", 0.0, {}, "reduced", seen=0.9, median_sigma_cp=0.01, flicker=0.0)
    verdict = psp_verdict([point], further=black_findings(["cam1", "cam2"]))
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "weak")
    assert "of cam1 and cam2 is taken as 0, and no sigma has it" in verdict.reason
    assert "radiometry.black" in verdict.next_step


def test_taps_that_disagree_by_more_than_the_sigmas_explain_are_doubted():
    """Readings of another point, or names shifted by a row: the scatter goes into every sigma, and all was good."""
    fit = {"scatter_Pa": 0.0, "noise_Pa": 300.0, "rms_Pa": 250.0, "leave_one_out_rms_Pa": 260.0, "slope_free": 1.0}
    point = PointRecord("p1", 0.0, {}, "reduced", seen=0.9, median_sigma_cp=0.01, flicker=0.0, fit=fit)
    assert psp_verdict([point]).word == GOOD
    off = psp_verdict([replace(point, fit=fit | {"scatter_Pa": 3700.0, "rms_Pa": 3500.0})])
    assert (off.word, off.cause) == (DOUBTFUL, "taps")
    assert "differ by 3700 Pa beyond their sigmas, which explain 300 Pa" in off.reason
    assert "no tap checks their level" in psp_verdict([replace(point, fit={})]).reason


def test_a_flicker_that_nothing_says_is_doubted_unless_taps_take_it_out():
    point = PointRecord("p1", 0.0, {}, "reduced", seen=0.9, median_sigma_cp=0.01)
    verdict = psp_verdict([point, replace(point, name="p2")])
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "weak")
    assert "no sigma has the lamps' flicker" in verdict.reason
    assert "radiometry.lamp_flicker" in verdict.next_step
    assert psp_verdict([replace(point, flicker=0.0)]).word == GOOD
    fit = {"scatter_Pa": 10.0, "rms_Pa": 10.0, "leave_one_out_rms_Pa": 11.0, "slope_free": 1.0}
    assert psp_verdict([replace(point, fit=fit)]).word == GOOD
    only_offset = psp_verdict([replace(point, fit=fit | {"slope_free": 0.0})])
    assert (only_offset.word, only_offset.cause) == (DOUBTFUL, "weak")


def test_a_table_in_another_unit_explains_why_no_point_came_out(tunnel):
    small = replace(tunnel.markers, xyz=tunnel.markers.xyz / 25.4)
    lost = PointRecord("p1", 0.0, {}, "failed", "a camera is not where it is said to be")
    verdict = psp_verdict([lost], units_findings(small, tunnel.mesh, "mm"))
    assert (verdict.word, verdict.cause) == (BAD, "units")
    assert psp_verdict([lost]).cause == "moved"


def test_wind_off_frames_that_differ_are_doubted():
    six, none = np.zeros(6), np.zeros(0)
    rows = [
        DeformFrame(k, str(k), 0.1 * k, 0.1 * k, "tracked", "", 0.1, 80, 0, 0.01, 1.0, np.array([q]), np.array([0.01]),
                    six, six, none, none)
        for k, q in enumerate((0, 0.005, 4, 9))
    ]  # fmt: skip
    assert deform_verdict(rows, zero=["0", "1"], parameters=["wing.bend_2"]).word == GOOD
    assert deform_verdict(rows, zero=["3"]).word == GOOD  # a single one has nothing to differ from
    verdict = deform_verdict(rows, zero=["2", "3"], parameters=["wing.bend_2"])
    assert verdict.word == DOUBTFUL
    assert "wind-off frames 2 and 3 differ in wing.bend_2 by 56 %" in verdict.reason


def test_pictures_of_a_frame_long_before_are_doubted():
    six, none = np.zeros(6), np.zeros(0)

    def rows(pictures, again=()):
        """Records of frames by what their pictures of both cameras are; ``again``: told already."""
        return [
            DeformFrame(k, str(k), 0.1 * k, 0.1 * k, "tracked", "", 0.1, 80, 0, 0.01, 1.0, none, none, six, six,
                        cameras={n: Sight(20, 20, f"the picture before ({ONCE_MORE})" if k in again else "", 0.0,
                                          picture=p) for n, p in zip(("cam1", "cam2"), both, strict=True)})
            for k, both in enumerate(pictures)
        ]  # fmt: skip

    assert deform_verdict(rows([(1, 2), (3, 1), (5, 6), (0, 8), (0, 9)])).word == GOOD  # 0: between two pictures
    verdict = deform_verdict(rows([(1, 2), (3, 4), (5, 6), (1, 2), (3, 7)]))
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "file")
    assert "cam1 and cam2 in frame 3 (and 1 more such frames) is that of frame 0 bit by bit" in verdict.reason
    adjacent = deform_verdict(rows([(1, 2), (3, 4), (3, 4)], again=(2,)))
    assert [f.cause for f in adjacent.findings] == ["file"]
    assert "bit by bit" not in adjacent.reason


def test_what_all_frames_say_together_is_doubted_as_the_last_one_knows_it():
    six, none = np.zeros(6), np.zeros(0)
    fine = DeformFrame(0, "0", 0.0, 0.0, "tracked", "", 0.1, 80, 0, 0.01, 1.0, none, none, six, six, none, none)
    words = [f"pictures of cam2 show the model {n} frames earlier than those of cam1" for n in (1.2, 1.0)]
    two = [replace(fine, index=40 + k, key=str(40 + k), series=(("late", w),), warnings=(w,), causes=("late",))
           for k, w in enumerate(words)]  # fmt: skip
    every = [replace(fine, index=k, key=str(k)) for k in range(40)]
    left = replace(fine, index=42, key="42", status="left", reason="the run was ended")
    verdict = deform_verdict([*every, *two, left])
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "late")
    assert verdict.reason == f"{words[1]}; sigmas contain it from frame 40 on"
    assert len(verdict.findings) == 1
    assert "pair the cameras' pictures by time" in verdict.next_step
    assert deform_verdict([*every, *two, replace(fine, index=43, key="43")]).word == GOOD  # later ones took it back


def test_a_marker_on_a_wall_that_all_frames_show_elsewhere_hides_no_other_marker():
    six, none = np.zeros(6), np.zeros(0)
    fine = DeformFrame(0, "0", 0.0, 0.0, "tracked", "", 0.1, 80, 0, 0.01, 1.0, none, none, six, six, none, none)
    wall = "W03 is not where its table has it, by all frames together"
    other = "m10 is 0.8 mm from where its table has it"
    all_say = [replace(fine, index=k, key=str(k), series=(("marker", wall),), warnings=(wall, other),
                       causes=("marker", "marker")) for k in range(5)]  # fmt: skip
    reasons = [f.reason for f in deform_verdict(all_say).findings]
    assert [wall in r for r in reasons].count(True) == 1
    assert any(other in r for r in reasons)


def test_a_part_that_may_have_slipped_in_one_frame_of_many_is_said_and_a_wild_spot_is_not():
    """Its numbers are off by a spacing there, which no sigma has; those of the other are hardly off."""
    words = "panel may be slipped by one spacing of 25 mm"
    for cause, said in (("layout", [f"frame 7: {words}"]), ("marker", [])):
        of_one = ((cause, words),)
        instants = [Followed(f"frame {k}", {}, of_one if k == 7 else ()) for k in range(100)]
        assert [f.reason for f in followed_findings(instants, "mm")] == said


def test_residuals_are_doubted_where_most_of_them_is_no_noise():
    doubts = (("noise", "residuals are 1.2 times as large as stated (sigma0)"),)
    point = PointRecord("p1", 0.0, {}, "reduced", seen=0.9, median_sigma_cp=0.01, flicker=0.0)
    words = {}
    for sigma0 in (1.2, 1.5):
        words[sigma0] = psp_verdict([replace(point, followed=(Followed("wind-on", {}, doubts, sigma0),))]).word
    assert words == {1.2: GOOD, 1.5: DOUBTFUL}


def test_one_frame_of_many_that_the_laws_do_not_explain_is_named():
    """One torn picture of forty: the frame was "misfit", and the test "good"."""
    six, none = np.zeros(6), np.zeros(0)
    fine = DeformFrame(0, "0", 0.0, 0.0, "tracked", "", 0.1, 80, 0, 0.01, 1.1, none, none, six, six, none, none)
    every = [replace(fine, index=k, key=str(k)) for k in range(40)]
    assert deform_verdict(every).word == GOOD
    words = "residuals are 5 times as large as stated (sigma0)"
    torn = replace(every[7], status="misfit", sigma0=5.0, warnings=(words,), causes=("noise",))
    verdict = deform_verdict([*every[:7], torn, *every[8:]])
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "picture")
    assert "frame 7 does not fit as the others do" in verdict.reason
    assert "in other frames 1.1" in verdict.reason
    # Where most are off by their tables, one that is off a little more is no other case.
    slightly = [replace(r, sigma0=1.4) for r in every]
    assert deform_verdict([replace(slightly[0], status="misfit", sigma0=1.5), *slightly[1:]]).word == GOOD


def test_a_camera_out_of_focus_is_named_in_a_series():
    """Sharp in one camera, blurred in the other: where more than a tenth of its pictures are."""
    sharp, soft = Sight(20, 20, "", 0.0, 0.7, 3.0), Sight(20, 20, "", 0.0, 2.5, 3.0)
    point = PointRecord("p1", 0.0, {}, "reduced", seen=0.33, median_sigma_cp=0.01, flicker=0.0, shown={"all": 0.36})
    on, off = Followed("wind-on", {"cam1": sharp, "cam2": soft}), Followed("wind-off", {"cam1": sharp})
    verdict = psp_verdict([replace(point, followed=(on, off))])
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "blurred")
    assert "pictures of cam2 are blurred by 2.5 px (1 sigma) at markers of 3 px radius" in verdict.reason
    assert "cam1" not in " ".join(f.reason for f in verdict.findings)
    assert psp_verdict([replace(point, followed=(off,))]).word == GOOD
    records = [replace(r, seen=0.3, median_sigma_T=0.1, followed=replace(on, key="frame 1")) for r in frames()]
    assert infrared_verdict(records).cause == "blurred"
    assert not series_blur([("cam1", 0.7, 3.0)] * 10 + [("cam1", 2.5, 3.0)])
    assert series_blur([("cam1", 0.7, 3.0)] * 8 + [("cam1", 2.5, 3.0)] * 2)
    assert not series_blur([("cam1", 1.0, 3.0)])


def test_blurred_pictures_explain_why_nothing_was_reconstructed():
    none = NotReconstructed("no two pictures could be matched", "no_pair")
    spots = Detections.make(np.zeros((0, 2)))
    pictures = [Picture(f"P{k}", "camera", (640, 480), spots, blur_px=2.6, radius_px=2.7) for k in range(3)]
    verdict = reconstruct_verdict(none, "mm", pictures)
    assert (verdict.word, verdict.cause) == (BAD, "blurred")
    assert verdict.reason.endswith("not reconstructed: no two pictures could be matched")
    assert reconstruct_verdict(none, "mm", [replace(p, blur_px=np.nan) for p in pictures]).cause == "no match"


@pytest.mark.parametrize(("out", "count", "said"), [(1, 5, False), (2, 20, False), (2, 10, True), (3, 20, True)])
def test_pictures_that_took_no_part_are_doubted_where_they_are_no_single_ones(out, count, said):
    reasons = {f"P{k}": "out of focus" for k in range(out)}
    found = _left_out(reasons, count)
    assert [(f.word, f.cause) for f in found] == ([(DOUBTFUL, "lost")] if said else [])
    assert not said or found[0].reason == f"{out} of {count} pictures took no part; P0: out of focus"


def test_one_picture_that_is_there_twice_is_said_of_any_series():
    fine = Sight(20, 20, "", 0.0, 0.7, 3.0)
    copy = replace(fine, reason=f"the picture before once more ({ONCE_MORE}): it is of another instant")
    instants = [Followed(f"frame {k}", {"cam1": copy if k == 40 else fine}) for k in range(100)]
    (found,) = followed_findings(instants, "mm")
    assert (found.word, found.cause) == (DOUBTFUL, "file")
    assert found.reason.startswith("cam1 shows in frame 40 what it showed before")
    assert not followed_findings(instants[:40], "mm")
    both = [*instants, Followed("frame 100", {"cam1": copy, "cam2": copy, "cam3": copy})]
    (found,) = followed_findings(both[60:], "mm")
    assert found.reason.startswith("cam1, cam2 and cam3 show in frame 100 what they showed before")
    assert "more such" not in found.reason
    assert "and 3 more such" in followed_findings(both, "mm")[0].reason


def test_what_following_found_is_said_of_every_series():
    """A camera that is left out, a law that is too simple, a marker beside its place: alike in all of them."""
    point = PointRecord("p1", 0.0, {}, "reduced", seen=0.33, median_sigma_cp=0.01, flicker=0.0, shown={"all": 0.36})
    fine = Sight(20, 20, "", 0.0, 0.7, 3.0)
    why = "left out, it contradicts cam2: a camera is not where it is said to be"
    said = {
        "moved": Followed("wind-on picture 1", {"cam1": Sight(0, 0, why), "cam2": fine}),
        "bent": Followed("wind-on picture 1", {"cam1": fine}, (("bent", "law of wing too simple"),)),
        "marker": Followed("wind-on picture 1", {"cam1": replace(fine, odd={"W10": (8.1, 7.6)})}),
    }  # fmt: skip
    words = {
        "moved": "cam1 in wind-on picture 1 of p1: left out",
        "bent": "wind-on picture 1 of p1: law of wing too simple",
        "marker": "W10 is 8.1 px (about 8 mm) from where its table has it",
    }
    for cause, followed in said.items():
        verdict = psp_verdict([replace(point, followed=(followed,))], unit="mm")
        assert (verdict.word, verdict.cause) == (DOUBTFUL, cause)
        assert words[cause] in verdict.reason
        clean = [replace(followed, cameras={"cam1": fine}, doubts=())] * 10
        assert psp_verdict([replace(point, followed=(*clean, followed))], unit="mm").word == GOOD  # one of eleven
        records = [replace(r, seen=0.3, median_sigma_T=0.1, followed=followed) for r in frames()]
        assert infrared_verdict(records, unit="mm").cause == cause


def test_a_polar_whose_taps_were_not_fitted_is_doubted():
    none = np.zeros(0)
    taps = TapTable((), none, none, none, none, (), "the taps' readings are 0.01 times what the paint shows")
    point = PointRecord("p1", 0.0, {}, "reduced", seen=0.33, median_sigma_cp=0.01, flicker=0.0, shown={"all": 0.36})
    verdict = psp_verdict([replace(point, taps=taps)])
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "taps")
    assert "not fitted to the taps: the taps' readings are 0.01 times" in verdict.reason
    assert psp_verdict([replace(point, taps=replace(taps, unfitted=""))]).word == GOOD


def test_a_cell_whose_isotherms_have_a_reference_each_makes_a_test_doubtful():
    point = PointRecord("p1", 0.0, {}, "reduced", seen=0.9, median_sigma_cp=0.01, flicker=0.0)
    said = "I_ref / I is exactly 1 at 100000 Pa at all temperatures (285 to 312)"
    verdict = psp_verdict([point], further=calibration_findings(("residuals are small", said)))
    assert (verdict.word, verdict.cause, verdict.reason) == (DOUBTFUL, "weak", said)
    assert psp_verdict([point], further=calibration_findings(("residuals are small",))).word == GOOD
