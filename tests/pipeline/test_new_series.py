"""`windmark init --for VERB`: projects and commands from a folder, as its own test data are checked."""

import re
import shlex
from dataclasses import replace

import numpy as np
import pytest

from windmark import io
from windmark.app import init_verb
from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.pipeline.check import check_project
from windmark.pipeline.deform.project import read_deform_project
from windmark.pipeline.folder import look_into
from windmark.pipeline.new_project import choose, common_pattern
from windmark.pipeline.new_series import _unquoted, command, csv_with, ends_of, series_missing
from windmark.scene import MarkerSet, Mesh

CAMERA = Camera((64, 48), 80.0, 1.0, 31.5, 23.5)
POSE = Pose.from_rotvec(np.zeros(3), [0.0, 0.0, 500.0])


@pytest.fixture
def folder(tmp_path):
    """Two cameras with poses, four frames each in a folder of their own, markers of two parts, a grid."""
    for k in (1, 2):
        io.write_camera(tmp_path / f"cam{k}.json", CAMERA, POSE, unit="mm")
    rng = np.random.default_rng(1)
    markers = MarkerSet.make([f"m{k}" for k in range(8)], rng.normal(size=(8, 3)), volume=["body"] * 3 + ["wing"] * 5,
                             role=["model"] * 7 + ["wall"])  # fmt: skip
    io.write_markers(tmp_path / "markers.csv", markers, length_unit="mm")
    io.write_mesh(tmp_path / "model.stl", Mesh.make(np.eye(4, 3) * 5, [[0, 1, 2], [0, 2, 3]], volume=["wing"] * 2))
    (tmp_path / "images").mkdir()
    for camera in (1, 2):
        for k in range(8, 12):
            io.write_image(tmp_path / "images" / f"cam{camera}-{k:03d}.tif", np.full((48, 64), 90 + k, np.uint8))
    return tmp_path


def init(folder, verb, **given):
    init_verb.init(folder, None, given, None, False, False, verb)
    return folder / f"{verb}.toml"


def test_a_deformation_project_is_sound_and_reads_as_one(folder):
    project = init(folder, "deform")
    assert check_project(project).problems == []
    read = read_deform_project(project)
    assert [c.images for c in read.camera] == ["images/cam1-*.tif", "images/cam2-*.tif"]
    assert [v.name for v in read.volume] == ["body", "wing"]


def test_a_law_in_the_file_has_the_ends_of_its_parts_markers_and_works_when_the_hash_is_taken_away(folder, capsys):
    """A wing along y beside a body at y = 0; its first marker is the nearest one to it."""
    xyz = np.array([[-50, 0, 0], [50, 0, 0], [0, 0, 30], [4, 20, 1], [2, 60, 0], [-3, 120, 2], [0, 200, 1], [9, 9, 9]])
    markers = MarkerSet.make([f"m{k}" for k in range(8)], xyz, volume=["body"] * 3 + ["wing"] * 5,
                             role=["model"] * 7 + ["wall"])  # fmt: skip
    io.write_markers(folder / "markers.csv", markers, length_unit="mm")
    project = init(folder, "deform")
    assert "parts: body, wing; each is rigid until the file gives it a law" in capsys.readouterr().out
    head, wing = project.read_text().split('name = "wing"')
    project.write_text(head + 'name = "wing"' + wing.replace("# law", "law", 1).replace("# options", "options", 1))
    (law,) = [v for v in read_deform_project(project).volume if v.law]
    assert law.name == "wing"
    np.testing.assert_allclose(law.options["root"], [2.5, 20, 1], atol=3)
    np.testing.assert_allclose(law.options["tip"], [-0.5, 200, 1], atol=3)
    assert check_project(project).problems == []


@pytest.mark.parametrize("xyz", [np.zeros((5, 3)), np.arange(6.0).reshape(2, 3)])
def test_markers_in_one_place_or_too_few_have_no_ends(xyz):
    markers = MarkerSet.make([f"m{k}" for k in range(len(xyz))], xyz, volume=["wing"] * len(xyz))
    assert ends_of(markers, "wing") is None


def test_a_camera_without_pose_is_named(folder):
    io.write_camera(folder / "cam2.json", CAMERA)
    content = look_into(folder)
    said = series_missing(content, choose(content, {}), "deform")
    assert len(said) == 1
    assert "cam2.json" in said[0]


@pytest.mark.parametrize("verb", ["psp", "infrared"])
def test_what_no_file_says_stands_as_missing_and_check_names_only_that(folder, verb):
    if verb == "psp":
        (folder / "runs.csv").write_text("point,alpha_deg,mach,on,off\n")
        (folder / "paint.csv").write_text("pressure_Pa,temperature_K,ratio\n1e5,293,1\n")
    found = check_project(init(folder, verb))
    assert found.kind == verb
    keys = {re.split(r"[.\[]", p.key)[0] for p in found.problems}
    assert keys <= ({"points"} if verb == "psp" else {"surface", "camera"})
    text = (folder / f"{verb}.toml").read_text()
    assert ('table = "runs.csv"' in text and 'cell = "paint.csv"' in text) == (verb == "psp")


def calibrated(folder, *words):
    """Pictures that are no frames, in a folder of their own."""
    (folder / "calibration").mkdir()
    for word in words:
        for camera in (1, 2):
            for k in range(3):
                picture = np.full((48, 64), 20 + k, np.uint8)
                io.write_image(folder / "calibration" / f"{word}-cam{camera}-{k}.tif", picture)


def test_pictures_of_a_calibration_are_no_frames(folder):
    calibrated(folder, "dark", "warm", "cold")
    read = read_deform_project(init(folder, "deform"))
    assert [c.images for c in read.camera] == ["images/cam1-*.tif", "images/cam2-*.tif"]
    text = (folder / "deform.toml").read_text()
    assert "# no frames, by their names: calibration/cold-cam1-*.tif, calibration/dark-cam1-*.tif" in text
    text = init(folder, "infrared").read_text()
    assert 'even = ["calibration/cold-cam1-*.tif", "calibration/warm-cam1-*.tif"]' in text
    assert "# no frames, by their names: calibration/dark-cam1-*.tif\n" in text


def test_where_every_name_says_calibration_they_are_frames(folder):
    for k in range(8, 12):
        for camera in (1, 2):
            old = folder / "images" / f"cam{camera}-{k:03d}.tif"
            old.rename(old.with_name(f"white-model-{old.name}"))
    read = read_deform_project(init(folder, "deform"))
    assert [c.images for c in read.camera] == ["images/white-model-cam1-*.tif", "images/white-model-cam2-*.tif"]


def test_a_paint_test_gets_its_dark_pictures_and_its_sensors(folder):
    calibrated(folder, "dark", "flat")
    taps = "name,x,y,z,role\nT1,0,0,0,tap\nT2,1,0,0,tap\n"
    (folder / "taps.csv").write_text(taps)
    (folder / "wells.csv").write_text("name,x,y,z,role\nW1,0,0,0,virtual\n")
    (folder / "pressures.csv").write_text("point,name,pressure_Pa\np1,T2,5e4\np1,T1,5e4\n")
    (folder / "kelvins.csv").write_text("point,name,temperature_K\np1,W1,300\n")
    text = init(folder, "psp").read_text()
    assert '[taps]\nfile = "taps.csv"\npressures = "pressures.csv"' in text
    assert 'thermocouples = "wells.csv"\nreadings = "kelvins.csv"' in text
    assert '[radiometry]\ndark = "calibration/dark-{camera}-*.tif"\nflat = "calibration/flat-{camera}-*.tif"' in text
    (folder / "psp.toml").unlink()
    (folder / "more.csv").write_text(taps)  # which of the two is meant is nobody's to guess
    (folder / "calibration" / "dark-cam2-0.tif").rename(folder / "calibration" / "cam2-dark.tif")
    text = init(folder, "psp").read_text()
    assert "# [taps]" in text
    assert '# dark = "dark-{camera}-*.tif"' in text


def test_commands_of_verbs_without_a_project(folder):
    content = look_into(folder)
    line, missing = command(content, choose(content, {}), "calibrate")
    words = shlex.split(line)
    assert words[:2] == ["windmark", "calibrate"]
    assert words[words.index("-m") + 1] == str(folder / "markers.csv")
    assert words[words.index("--unit") + 1] == "mm"
    assert words[words.index("--datum") + 1] == "free"
    assert "-o" not in words
    assert missing == []
    known = replace(content.markers[folder / "markers.csv"], sigma=np.full((8, 3), 0.1))
    content.markers[folder / "markers.csv"] = known
    line, _ = command(content, choose(content, {}), "calibrate", folder / "out")
    assert line.endswith(f"--datum weighted -o {folder / 'out'}")
    line, missing = command(content, choose(content, {"unit": "mm"}), "reconstruct")
    assert "<camera.json>" in line
    assert len(missing) == 1
    assert not list(folder.glob("*.toml"))


def test_a_reconstruction_is_told_the_table_of_primaries_and_another_one_only_where_it_is_named(folder, capsys):
    markers = io.read_markers(folder / "markers.csv", roles=None)
    primary = replace(markers, role=np.full(8, "primary")).take(range(5))
    io.write_markers(folder / "known.csv", primary, length_unit="mm")
    for given, name in (({}, "known.csv"), ({"markers": folder / "markers.csv"}, "markers.csv")):
        init_verb.init(folder, None, given, None, False, False, "reconstruct")
        assert f"-p {folder / name} " in capsys.readouterr().out


def test_patterns_stand_for_exactly_these_files(folder):
    some = sorted((folder / "images").glob("cam1-*"))
    assert common_pattern(some) == str(folder / "images" / "cam1-*.tif")
    assert common_pattern(some[:2]) == str(folder / "images" / "cam1-00*.tif")
    assert common_pattern([some[0], some[2]]) is None


def test_two_tables_that_could_be_meant_are_none(folder):
    (folder / "a.csv").write_text("pressure_Pa,temperature_K,ratio\n")
    assert csv_with(folder, {"ratio"}) == folder / "a.csv"
    (folder / "b.csv").write_text("# a comment\nratio_1,ratio\n")
    assert csv_with(folder, {"ratio"}) is None


def test_an_unknown_verb_is_refused(folder):
    with pytest.raises(UsageError, match="reconstruct, got track"):
        init(folder, "track")


@pytest.mark.parametrize(("pattern", "written"), [
    ("photos/a*.tif", "photos/a*.tif"), ("a b*.tif", "'a b'*.tif"), ("run(1)/f*;x.tif", "'run(1)/f'*';x.tif'"),
])  # fmt: skip
def test_a_pattern_keeps_its_star_and_has_the_rest_quoted(pattern, written):
    assert _unquoted(pattern) == written
