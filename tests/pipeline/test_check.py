"""A project is checked as a whole; the kinds of projects; patterns; what lies in a folder; a result had again."""

import json
import re
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import typer

from windmark import io
from windmark.app import init_verb, verify_verb
from windmark.app.cli import app
from windmark.errors import UsageError
from windmark.geometry import Camera
from windmark.io import FileError
from windmark.io.manifest import file_hash
from windmark.pipeline.check import check_project
from windmark.pipeline.deform.project import read_deform_project
from windmark.pipeline.folder import look_into
from windmark.pipeline.kinds import kind_of
from windmark.pipeline.new_project import choose
from windmark.pipeline.new_series import command
from windmark.pipeline.project import read_project
from windmark.pipeline.repeat import Difference, inputs_now, results_again
from windmark.pipeline.toml_lines import line_of, toml_lines
from windmark.scene import MarkerSet

COMMAND = typer.main.get_command(app)
SOUND = """\
title = "small"
length_unit = "mm"

[[camera]]
file = "camera.json"

[[image]]
file = "img*.tif"

[markers]
file = "markers.csv"

[detect]
radius_px = 3
"""


@pytest.fixture
def folder(tmp_path) -> Path:
    io.write_camera(tmp_path / "camera.json", Camera((64, 48), 80.0, 1.0, 31.5, 23.5))
    markers = MarkerSet.make([f"m{k}" for k in range(6)], np.random.default_rng(1).normal(size=(6, 3)))
    io.write_markers(tmp_path / "markers.csv", markers, length_unit="mm")
    for k in (1, 2, 10):
        io.write_image(tmp_path / f"img{k}.tif", np.random.default_rng(k).integers(90, 110, (48, 64), dtype=np.uint8))
    (tmp_path / "project.toml").write_text(SOUND)
    return tmp_path


def test_a_sound_project_has_no_problem_and_its_pattern_is_in_natural_order(folder):
    found = check_project(folder / "project.toml")
    assert found.problems == []
    assert found.kind == "run"
    assert [i.file.name for i in read_project(folder / "project.toml").image] == ["img1.tif", "img2.tif", "img10.tif"]


def test_everything_that_is_wrong_is_listed_at_once_with_its_line(folder):
    text = SOUND.replace("title", "titel").replace("markers.csv", "marker.csv").replace("= 3", "= -3")
    (folder / "project.toml").write_text(text.replace("img*.tif", "pic*.tif"))
    problems = {p.key: p for p in check_project(folder / "project.toml").problems}
    assert {"titel", "title", "markers.file", "detect.radius_px", "image[0].file"} <= set(problems)
    assert "did you mean title" in problems["titel"].words
    assert problems["titel"].line == 1
    assert "did you mean markers.csv" in problems["markers.file"].words
    assert problems["markers.file"].line == 11
    assert problems["detect.radius_px"].line == 14


def test_pictures_of_another_size_and_unreadable_ones(folder):
    io.write_image(folder / "img2.tif", np.zeros((10, 10), np.uint8))
    (folder / "img10.tif").write_bytes(b"II*\0garbage")
    problems = [p for p in check_project(folder / "project.toml").problems if p.key == "image[0].file"]
    assert len(problems) == 2
    assert all(p.line == 8 for p in problems)


def test_a_picture_that_is_there_twice_and_one_that_shows_nothing(folder):
    """Whatever their files are called: of a ratio of a picture with itself every value is 1."""
    io.write_image(folder / "img2.tif", io.read_image(folder / "img1.tif"))
    io.write_image(folder / "img10.tif", np.zeros((48, 64), np.uint8))
    copy, black = [p for p in check_project(folder / "project.toml").problems if p.key == "image[0].file"]
    assert "img2.tif: is the same picture as img1.tif, pixel by pixel" in copy.words
    assert "img10.tif: every pixel is at the level 0: the picture shows nothing" in black.words
    # Empty pictures are not said to be each other's copies as well.
    io.write_image(folder / "img2.tif", np.zeros((48, 64), np.uint8))
    problems = check_project(folder / "project.toml").problems
    assert ["shows nothing" in p.words for p in problems] == [True, True]


def test_a_focal_length_in_millimetres_is_a_thing_to_correct(folder):
    io.write_camera(folder / "camera.json", Camera((64, 48), 2.0, 1.0, 31.5, 23.5))
    (problem,) = check_project(folder / "project.toml").problems
    assert (problem.key, problem.line) == ("camera[0].file", 5)
    assert "as no lens does: is it in pixels (not in mm" in problem.words


def test_unit_that_contradicts_the_files(folder):
    (folder / "project.toml").write_text(SOUND.replace('"mm"', '"in"'))
    (problem,) = check_project(folder / "project.toml").problems
    assert problem.key == "markers.file"
    assert "mm" in problem.words


@pytest.mark.parametrize("text", ["", "[", "a = 1", "camera = 3\nimage = 4\nmarkers = 5", "[[image]]\n[[camera]]\n"])
def test_half_written_projects_are_explained(folder, text):
    (folder / "project.toml").write_text(text)
    if text == "[":
        with pytest.raises(FileError, match="TOML"):
            check_project(folder / "project.toml")
    else:
        assert check_project(folder / "project.toml").problems


def test_a_pattern_with_a_name_or_without_a_match_is_refused(folder):
    (folder / "project.toml").write_text(SOUND.replace('"img*.tif"', '"img*.tif"\nname = "one"'))
    with pytest.raises(FileError, match="of one picture"):
        read_project(folder / "project.toml")
    (folder / "project.toml").write_text(SOUND.replace("img*", "none*"))
    with pytest.raises(FileError):
        read_project(folder / "project.toml")


def test_the_wrong_verb_names_the_right_one(folder):
    with pytest.raises(FileError, match=re.escape(f"windmark run {folder / 'project.toml'}")):
        read_deform_project(folder / "project.toml")
    other = folder / "deform.toml"
    other.write_text('title = "t"\nlength_unit = "mm"\n[[volume]]\nname = "wing"\n')
    with pytest.raises(FileError, match=re.escape(f"windmark deform {other}")):
        read_project(other)


def test_kinds():
    assert kind_of({"image": []}) == "run"
    assert kind_of({"camera": [{"images": "a*"}]}) == "deform"
    assert kind_of({"paint": {}, "volume": []}) == "psp"
    assert kind_of({"surface": {}, "sequence": {}}) == "infrared"
    assert kind_of({"image": [], "volume": []}) is None
    assert kind_of({}) is None


def test_lines_of_keys():
    text = 'a = 1\n[[b]]\nc = """\nd = 2\n"""\n[[b]]\n"c e" = 3\n[b.f]\ng.h = 4\n'
    lines = toml_lines(text)
    assert lines[("a",)] == 1
    assert lines[("b", 0, "c")] == 3
    assert ("b", 0, "d") not in lines
    assert lines[("b", 1, "c e")] == 7
    assert lines[("b", 1, "f", "g", "h")] == 9
    assert line_of(lines, ("b", 1, "nothing")) == 6
    assert line_of(lines, ("nothing",)) is None


def test_lists_of_several_lines_are_no_headers():
    text = """a = [
  [10, 20],
  [[30, 40], [1, 2]],   # ] not the end
  "[b]", 'c = 1',
]
[[d]]
e = [ {f = 1},
      {f = "wrong"} ]
[g]
h = '''
[i]
'''
j = [
  [5]
]
"""
    lines = toml_lines(text)
    assert (("d", 0, "e", 1, "f") in lines, lines[("d", 0, "e", 1, "f")]) == (True, 8)
    assert [lines[k] for k in [("a",), ("a", 0), ("a", 1, 1), ("a", 3), ("d", 0), ("g", "h"), ("g", "j")]] == [
        1, 2, 3, 4, 6, 10, 13,
    ]  # fmt: skip
    assert {k[0] for k in lines} == {"a", "d", "g"}


def test_a_wrong_key_behind_a_list_of_several_lines_has_its_line(folder):
    project = folder / "project.toml"
    text = project.read_text() + '\n[[image]]\nfile = "p0.tif"\nexclude = [\n  [10, 20],\n  [30, 40],\n]\nchanel = 2\n'
    project.write_text(text)
    wrong = [p for p in check_project(project).problems if "chanel" in p.key]
    assert [p.line for p in wrong] == [text[: text.index("chanel")].count("\n") + 1]


def test_init_makes_a_project_that_is_sound(folder):
    (folder / "project.toml").unlink()
    init_verb.init(folder, None, {}, None, False, False)
    assert check_project(folder / "project.toml").problems == []
    assert len(read_project(folder / "project.toml").image) == 3
    with pytest.raises(UsageError, match="not written over"):
        init_verb.init(folder, None, {}, None, False, False)


def test_init_says_what_is_missing(folder, capsys):
    for name in ("project.toml", "markers.csv"):
        (folder / name).unlink()
    (folder / "broken.png").write_bytes(b"\x89PNG nothing")
    init_verb.init(folder, None, {}, None, False, False)
    said = capsys.readouterr().out
    assert "missing: a marker table" in said
    assert "missing: the length unit" in said
    assert "left out: broken.png" in said
    assert check_project(folder / "project.toml").problems


def test_two_cameras_of_one_size_are_told_by_their_names(folder):
    (folder / "camera.json").rename(folder / "cam01.json")
    io.write_camera(folder / "cam02.json", Camera((64, 48), 90.0, 1.0, 31.5, 23.5))
    content = look_into(folder)
    choice = choose(content, {"unit": "mm"})
    assert choice.cameras[folder / "img1.tif"] == folder / "cam01.json"
    assert choice.cameras[folder / "img2.tif"] == folder / "cam02.json"
    assert choice.cameras[folder / "img10.tif"] is None
    assert any("img10.tif" in words for words in choice.missing)


def test_of_two_marker_tables_that_differ_init_takes_none_unsaid(folder, capsys):
    """It took the one whose name comes first: markers-2019.csv, in which everything is 7 mm beside its place."""
    (folder / "project.toml").unlink()
    markers = io.read_markers(folder / "markers.csv")
    old = replace(markers, xyz=markers.xyz + np.array([7.0, 0, 0]))
    io.write_markers(folder / "markers-2019.csv", old, length_unit="mm")
    init_verb.init(folder, None, {}, None, False, False)
    said = capsys.readouterr().out
    assert "missing: the marker table: it may be markers-2019.csv or markers.csv, which differ (--markers FILE)" in said
    assert 'file = "markers-2019.csv"' not in (folder / "project.toml").read_text()
    assert choose(look_into(folder), {"markers": folder / "markers.csv"}).markers == folder / "markers.csv"
    assert "the marker table (-m): it may be" in " ".join(command(look_into(folder), choose(look_into(folder), {}),
                                                                  "calibrate")[1])  # fmt: skip


def test_a_copy_of_a_marker_table_or_a_part_of_it_is_no_other_one(folder):
    markers = io.read_markers(folder / "markers.csv")
    io.write_markers(folder / "copy.csv", markers, length_unit="mm")
    io.write_markers(folder / "part.csv", markers.take(range(4)), length_unit="mm")
    choice = choose(look_into(folder), {})
    assert choice.markers == folder / "copy.csv"
    assert not any("marker table" in words for words in choice.missing)


def test_a_camera_file_that_is_cut_off_is_named(folder, capsys):
    (folder / "project.toml").unlink()
    (folder / "camera.json").write_text("{")
    init_verb.init(folder, None, {}, None, False, False)
    said = capsys.readouterr().out
    assert "missing: a camera file" in said
    assert "left out: camera.json: " in said


def test_asking_that_is_interrupted_writes_nothing(folder, monkeypatch):
    import typer

    (folder / "project.toml").unlink()
    (folder / "markers.csv").unlink()
    monkeypatch.setattr(init_verb.sys, "stdin", _Terminal())
    monkeypatch.setattr(init_verb.sys, "stderr", _Terminal())

    def interrupted(*args, **options):
        raise typer.Abort

    monkeypatch.setattr(init_verb.typer, "prompt", interrupted)
    with pytest.raises(KeyboardInterrupt):
        init_verb.init(folder, None, {}, None, True, False)
    assert not (folder / "project.toml").exists()


class _Terminal:
    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        return len(text)

    def flush(self) -> None:
        pass


@pytest.mark.parametrize("what", ["nothing", "only text"])
def test_init_of_a_folder_without_a_test(tmp_path, what):
    if what == "only text":
        (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(UsageError, match="nothing of a test"):
        init_verb.init(tmp_path, None, {}, None, False, False)


def written(place: Path, name: str, **change) -> Path:
    out = place / name
    out.mkdir()
    value = change.get("value", 1.0)
    (out / "poses.csv").write_text(f"image,x,sigma_x,note\na,{value},0.1,fine\n")
    (out / "summary.json").write_text(json.dumps({"rms_px": change.get("rms", 0.5), "seconds": {"a": value}}))
    (out / "picture.png").write_bytes(b"1")
    files = {p.name: file_hash(p) for p in out.iterdir()}
    (out / "manifest.json").write_text(json.dumps({"outputs": files}))
    return out


def test_a_result_is_the_same_within_a_tenth_of_its_sigma(tmp_path):
    old, near, far = (written(tmp_path, n, value=v) for n, v in (("old", 1.0), ("near", 1.005), ("far", 1.05)))
    found = Difference()
    results_again(old, near, found)
    assert found.repeated
    assert "poses.csv" in found.same
    found = Difference()
    results_again(old, far, found)
    assert not found.repeated
    assert "0.5 sigma" in found.numbers["poses.csv"][0]
    found = Difference()
    results_again(old, written(tmp_path, "rms", rms=0.51), found)
    assert "rms_px" in found.numbers["summary.json"][0]


def test_how_long_something_took_is_no_number_of_a_result(tmp_path):
    old, again = written(tmp_path, "old"), written(tmp_path, "again")
    for place, took in ((old, 0.06), (again, 0.09)):
        (place / "poses.csv").write_text(f"image,x,seconds,latency_ms\na,1,{took},{took}\n")
        (place / "summary.json").write_text(json.dumps({"rms_px": 0.5, "median_frame_ms": took}))
        with h5py.File(place / "all.nc", "w") as stream:
            stream["seconds"], stream["x"], stream["x_sigma"] = [took], [1.0 + took / 1000], [0.01]
    found = Difference()
    for place in (old, again):
        files = {p.name: file_hash(p) for p in place.iterdir() if p.name != "manifest.json"}
        (place / "manifest.json").write_text(json.dumps({"outputs": files}))
    results_again(old, again, found)
    assert found.repeated
    assert "all.nc" in found.same
    with h5py.File(again / "all.nc", "a") as stream:
        stream["x"][...] = [1.01]
    found = Difference()
    results_again(old, again, found)
    assert found.numbers["all.nc"] == ["x[0]: 1.00006, now 1.01 (1 numbers differ)"]


def test_what_lies_beside_a_result_is_none_of_its_files(tmp_path):
    old, again = written(tmp_path, "old"), written(tmp_path, "again")
    (old / "results").mkdir()
    (old / "results" / "report.html").write_text("of another run, in the folder of a synthetic test")
    found = Difference()
    results_again(old, again, found)
    assert found.repeated
    (again / "poses.csv").unlink()
    found = Difference()
    results_again(old, again, found)
    assert found.lost == ["poses.csv"]


def test_a_file_that_cannot_be_read_is_named_and_the_others_are_still_compared(tmp_path):
    old, again = written(tmp_path, "old"), written(tmp_path, "again", value=1.05)
    for place in (old, again):
        with h5py.File(place / "all.nc", "w") as stream:
            stream["x"] = np.arange(500.0)
        (place / "made.json").write_text(json.dumps({"x": 1}))
        files = {p.name: file_hash(p) for p in place.iterdir() if p.name != "manifest.json"}
        (place / "manifest.json").write_text(json.dumps({"outputs": files}))
    whole = (old / "all.nc").read_bytes()
    (old / "all.nc").write_bytes(whole[:-100])
    (old / "made.json").write_text('{"x": ')
    (old / "summary.json").write_text("")
    found = Difference()
    results_again(old, again, found)
    assert not found.repeated
    for name in ("all.nc", "made.json", "summary.json"):
        assert found.numbers[name][0].startswith("cannot be read any more: "), name
    assert "0.5 sigma" in found.numbers["poses.csv"][0]
    assert "picture.png" in found.same


def test_inputs_that_changed_are_named(tmp_path):
    out = written(tmp_path, "out")
    table = tmp_path / "markers.csv"
    table.write_text("1")
    manifest = {
        "inputs": [{"file": "../markers.csv", "sha256": file_hash(table)}, {"file": "../gone.csv", "sha256": "0"}],
        "versions": {"numpy": "0.1"}, "outputs": {n: file_hash(out / n) for n in ("poses.csv", "picture.png")},
    }  # fmt: skip
    table.write_text("2")
    (out / "poses.csv").write_text("image\n")
    found = Difference()
    inputs_now(out, manifest, found)
    assert found.inputs == {"../markers.csv": "changed", "../gone.csv": "missing"}
    assert found.versions["numpy"][0] == "0.1"
    assert found.touched == ["poses.csv"]
    assert not found.repeated


def test_the_command_line_of_a_manifest(tmp_path):
    manifest = {
        "verb": "run", "options": {"project": "../project.toml", "roles": ["model", "wall"], "binding": True,
                                   "no_occlusion": False, "max_time": 3.0},
    }  # fmt: skip
    out = tmp_path / "results"
    words = verify_verb.arguments(COMMAND, manifest, out, tmp_path / "again")
    assert words[0] == "run"
    assert words[-1] == str(tmp_path / "project.toml")
    assert words.count("--roles") == 2
    assert "--binding" in words
    assert "--no-occlusion" not in words
    assert words[words.index("--output") + 1] == str((tmp_path / "again").resolve())
    with pytest.raises(UsageError, match="does not have"):
        verify_verb.arguments(COMMAND, {"verb": "nothing"}, out, tmp_path / "again")
    with pytest.raises(UsageError, match="lacks"):
        verify_verb.arguments(COMMAND, {"verb": "run", "options": {"nope": 1}}, out, tmp_path / "again")


def test_verify_of_what_is_no_result(tmp_path):
    with pytest.raises(UsageError, match="manifest"):
        verify_verb.verify(COMMAND, tmp_path, None, False)


def test_lists_of_places_are_read(folder):
    project = folder / "project.toml"
    project.write_text(project.read_text() + '\n[[points]]\nfile = "wanted.csv"\n')
    table = "name,x,y,z\na,1,2,3\n"
    for text, words in (("name,x,y\na,1,2\n", "no column 'z'"), (f"# length unit: ft\n{table}", "are in ft")):
        (folder / "wanted.csv").write_text(text)
        problem, no_grid = check_project(project).problems
        assert "points, lines and alignment need a grid" in no_grid.words
        assert problem.key == "points[0].file"
        assert words in problem.words
    (folder / "wanted.csv").write_text(table)
    found = check_project(project)
    assert len(found.problems) == 1
    assert "1 places of wanted.csv" in found.read
