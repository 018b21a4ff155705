"""What does not fit together in a project, and what its verb would refuse at once: `check` says it, every time all."""

from typing import Literal

import numpy as np
import pytest

from windmark import io
from windmark.app.project_place import project_in
from windmark.geometry import Camera, Pose
from windmark.io import FileError
from windmark.pipeline.check import check_project
from windmark.pipeline.deform.project import read_deform_project
from windmark.pipeline.plain_numbers import check_numbers
from windmark.pipeline.project import read_project
from windmark.scene import MarkerSet, Mesh

CAMERA = Camera((64, 48), 80.0, 1.0, 31.5, 23.5)
PLATE = Mesh.make(np.array([[0.0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0]]), np.array([[0, 1, 2], [0, 2, 3]]), "plate")

RUN = """\
title = "small"
length_unit = "mm"
[[camera]]
name = "left"
file = "camera.json"
[[image]]
file = "a.tif"
camera = "left"
[markers]
file = "markers.csv"
[detect]
radius_px = 3
[grid]
file = "plate.vtu"
[[section]]
name = "mid"
point = [0, 1.5, 0]
normal = [0, 1, 0]
"""
DEFORM = """\
title = "small"
length_unit = "mm"
[[camera]]
name = "left"
file = "camera.json"
images = "a.tif"
[[camera]]
name = "right"
file = "right.json"
images = "a.tif"
[markers]
file = "markers.csv"
[motion]
free = true
"""


@pytest.fixture
def folder(tmp_path):
    io.write_camera(tmp_path / "camera.json", CAMERA)
    io.write_camera(tmp_path / "right.json", CAMERA)
    xyz = np.random.default_rng(1).uniform([0, 0, 0], [4, 3, 0], (6, 3))
    io.write_markers(tmp_path / "markers.csv", MarkerSet.make([f"m{k}" for k in range(6)], xyz), length_unit="mm")
    io.write_mesh(tmp_path / "plate.vtu", PLATE)
    io.write_image(tmp_path / "a.tif", np.random.default_rng(1).integers(90, 110, (48, 64), dtype=np.uint8))
    return tmp_path


def posed(folder):
    """The cameras stand somewhere."""
    for k, name in enumerate(("camera", "right")):
        io.write_camera(folder / f"{name}.json", CAMERA, Pose.from_rotvec(np.zeros(3), [10.0 * k, 0, 0]), unit="mm")


def problems(folder, text):
    path = folder / "project.toml"
    path.write_text(text)
    return {p.key: p for p in check_project(path).problems}


def test_both_projects_are_sound_where_the_cameras_of_a_deformation_stand_somewhere(folder):
    assert not problems(folder, RUN)
    posed(folder)
    assert not problems(folder, DEFORM)


def test_what_contradicts_itself_is_listed_at_once_each_in_its_line(folder):
    more = RUN.replace('camera = "left"', 'camera = "lefd"')
    more += '[[section]]\nname = "mid"\npoint = [0, 1, 0]\nnormal = [0, 1, 0]\n[align]\nreference = "b"\n'
    found = problems(folder, more)
    assert {key: p.line for key, p in found.items()} == {
        "image[0].camera": 8, "section[1].name": 20, "align.reference": 24,
    }  # fmt: skip
    assert "did you mean left?" in found["image[0].camera"].words
    with pytest.raises(FileError, match=r"section\[1\]\.name: section names must be unique"):
        read_project(folder / "project.toml")


def test_a_wrong_key_does_not_hide_what_contradicts_itself(folder):
    wrong = RUN.replace("radius_px = 3", 'radius = 3\npolarity = "brigt"').replace("normal", "spacing = -1\nnormal")
    found = problems(folder, wrong.replace('camera = "left"', 'camera = "lefd"'))
    assert set(found) == {"detect.radius", "detect.polarity", "section[0].spacing", "image[0].camera"}
    assert "did you mean bright?" in found["detect.polarity"].words
    assert found["detect.polarity"].words.startswith("expected 'auto', 'dark' or 'bright', got 'brigt'")


def test_nothing_is_said_of_what_a_wrong_key_would_have_given(folder):
    """Without the format of the grid, which is misspelt, the values have no file; the user did not forget it."""
    posed(folder)
    more = '[grid]\nfile = "plate.vtu"\n[values]\nblack = 3\n[output]\ngrid = ["vtkk"]\n'
    assert set(problems(folder, DEFORM + more)) == {"output.grid[0]"}
    assert "values" in problems(folder, DEFORM + more.replace('"vtkk"', ""))


def test_a_zone_that_the_grid_has_not(folder):
    (problem,) = problems(folder, RUN.replace('"plate.vtu"', '"plate.vtu"\nvolumes = { wing = ["plato"] }')).values()
    assert (problem.key, problem.line) == ("grid.volumes", 15)
    assert problem.words == "volumes: the file has no zone plato; it has plate"


def test_a_section_without_a_direction_and_one_that_misses(folder):
    found = problems(folder, RUN.replace("normal = [0, 1, 0]", "normal = [0, 0, 0]"))
    assert found["section[0].normal"].words == "is zero; expected a direction"
    found = problems(folder, RUN.replace("1.5", "15"))
    assert found["section[0]"].line == 15
    assert "does not meet the grid" in found["section[0]"].words


def test_cameras_of_which_nobody_knows_where_they_stand(folder):
    found = problems(folder, DEFORM)
    assert {key: p.line for key, p in found.items()} == {"camera[0].file": 5, "camera[1].file": 9}
    assert all(".json has no pose" in p.words for p in found.values())
    known = problems(folder, RUN.replace('file = "camera.json"', 'file = "camera.json"\npose = "known"'))
    assert set(known) == {"camera[0].file"}


def test_two_cameras_with_one_file(folder):
    posed(folder)
    found = problems(folder, DEFORM.replace("right.json", "camera.json"))
    assert found["camera[1].file"].words.startswith("cameras left and right have the same file")


def test_what_the_verb_itself_refuses_is_found_too(folder):
    posed(folder)
    found = problems(folder, DEFORM + '[[volume]]\nname = "flap"\nlaw = "bend_twist"\n')
    assert set(found) == {"volume[0].law"} or set(found) == {"volume[0].name"}
    with_label = RUN.replace('camera = "left"', 'camera = "left"\nlabels = { m77 = [3, 4] }')
    assert problems(folder, with_label)["image[0].labels.m77"].line == 9


def test_names_in_another_table(folder):
    posed(folder)
    more = '[stations]\nvolume = "wing"\nstart = [0, 0, 0]\nend = [1, 0, 0]\n[sequence]\nclock = "lift"\n'
    found = problems(folder, DEFORM + more)
    assert {"stations.volume", "sequence.clock", "sequence"} == set(found)
    (folder / "d.toml").write_text(DEFORM + more.split("[sequence]", maxsplit=1)[0])
    with pytest.raises(FileError, match="'wing' is not the name of a volume; expected one of"):
        read_deform_project(folder / "d.toml")


def test_a_wind_off_frame_that_is_not_there(folder):
    posed(folder)
    (problem,) = problems(folder, DEFORM + '[sequence]\nzero = ["9"]\n').values()
    assert (problem.key, problem.line) == ("sequence.zero", 16)
    assert "frame 9 has no image" in problem.words


def test_everything_that_is_wrong_with_a_deformation_test_at_once(folder):
    posed(folder)
    wrong = ('[[volume]]\nname = "wing"\nlaw = "beem"\nparent = "bdy"\n[stations]\nvolume = "wong"\n'
             'start = [0, 0, 0]\nend = [1, 0, 0]\n[sequence]\nclock = "cam7"\n')  # fmt: skip
    found = problems(folder, DEFORM + wrong)
    assert {"volume[0].law", "volume[0].parent", "stations.volume", "sequence.clock"} <= set(found)
    assert "did you mean beam?" in found["volume[0].law"].words
    assert found["volume[0].parent"].line == found["volume[0].law"].line + 1
    two = '[[volume]]\nname = "wing"\nlaw = "beam"\noptions = { roof = 1 }\n[sequence]\nzero = ["77"]\n'
    assert {"volume[0].law", "sequence.zero"} <= set(problems(folder, DEFORM + two))


def test_stations_that_end_at_the_root(folder):
    """The tip would stand still, with a sigma of 0."""
    posed(folder)
    markers = MarkerSet.make([f"m{k}" for k in range(6)], [[k % 2, 0.5 * k, 0] for k in range(6)], volume="wing")
    io.write_markers(folder / "markers.csv", markers, length_unit="mm")
    wing = '[[volume]]\nname = "wing"\nlaw = "beam"\noptions = { root = [0, 0, 0], tip = [0, 3, 0] }\n'
    stations = '[stations]\nvolume = "wing"\nstart = [0, 0, 0]\nend = [0, 3, 0]\n'
    assert not problems(folder, DEFORM + wing + stations)
    exchanged = '[stations]\nvolume = "wing"\nstart = [0, 3, 0]\nend = [0, 0, 0]\n'
    found = problems(folder, DEFORM + wing + exchanged)
    assert "not the last one, which is reported as the tip" in found["stations.end"].words
    far = '[stations]\nvolume = "wing"\nstart = [0, 0, 0]\nend = [0, 30, 0]\n'
    found = problems(folder, DEFORM + wing + far)
    assert "beyond the markers of wing, which span 2.69 mm" in found["stations.end"].words
    inboard = '[stations]\nvolume = "wing"\nstart = [0, -3, 0]\nend = [0, -0.1, 0]\n'
    found = problems(folder, DEFORM + wing + inboard)
    assert "moves its markers but none of the stations" in found["stations.start"].words
    inches = '[stations]\nvolume = "wing"\nstart = [0, 0, 0]\nend = [0, 0.1, 0]\n'
    found = problems(folder, DEFORM + wing + inches)
    assert found["stations.start"].words.endswith("the markers of wing 2.69 mm: they are rather in inch")
    law = problems(folder, DEFORM + wing.replace('"beam"', '"beem"'))["volume[0].law"].words
    assert "did you mean beam?" in law


def test_results_do_not_go_among_the_inputs(folder):
    found = problems(folder, RUN + '[output]\nfolder = "."\n')
    assert "is the folder of the project itself" in found["output.folder"].words
    with pytest.raises(FileError, match=r"output\.folder"):
        read_project(folder / "project.toml")


@pytest.mark.parametrize(("where", "says"), [
    ("..", "above the folder of the project"), ("../..", "above the folder of the project"), ("/", "is a whole disk"),
    ("HOME", "is your home folder"), ("a.tif", "a.tif: this is a file; expected a folder"),
])  # fmt: skip
def test_results_do_not_go_among_other_files(folder, monkeypatch, where, says):
    """A folder above the project, a disk and the home folder were taken; `check` called a file sound that `run` could
    not write into.
    """
    home = folder / "home"
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("USERPROFILE", str(home))
    text = RUN + f'[output]\nfolder = "{home.as_posix() if where == "HOME" else where}"\n'
    assert says in problems(folder, text)["output.folder"].words
    with pytest.raises(FileError, match=says):
        read_project(folder / "project.toml")


@pytest.mark.parametrize("where", ["results", "home/results", "../beside"])
def test_results_go_into_a_folder_of_their_own(folder, where):
    (folder / "results").mkdir()
    (folder / "results" / "notes.txt").write_text("mine")
    assert not problems(folder, RUN + f'[output]\nfolder = "{where}"\n')


def test_a_folder_stands_for_its_only_project(folder):
    (folder / "project.toml").write_text(RUN)
    assert project_in(folder) == folder / "project.toml"


@pytest.mark.parametrize(("value", "says"), [
    ("true", "expected a number, got true"), ("[3, false]", "expected a number, got false"),
    ("inf", "expected a finite number"), ("nan", "expected a finite number"), ("4e9", "less than or equal to 1000"),
    ("0.5", "greater than or equal to 1"), ('"4.0"', "expected a number, without quotes, got '4.0'"),
])  # fmt: skip
def test_what_is_no_number_is_not_taken_for_one(folder, value, says):
    """true was a radius of 1 px, inf one without end."""
    assert says in problems(folder, RUN.replace("radius_px = 3", f"radius_px = {value}"))["detect.radius_px"].words


def test_what_may_be_no_number_is_taken_as_it_is(folder):
    assert not problems(folder, RUN.replace("radius_px = 3", "radius_px = [3, 4.5]") + "[output]\npixels = true\n")
    check_numbers(int | None, None)
    check_numbers(float | str, "4.0")
    check_numbers(Literal["auto"] | float, "auto")
    check_numbers(bool | float, True)
    check_numbers(dict[str, float], {"a": "its own matter"})


def test_an_empty_name_is_not_a_file_that_is_missing(folder):
    found = problems(folder, RUN.replace('"camera.json"', '""'))
    assert "is empty, or the project's own folder" in found["camera[0].file"].words


def test_flaps_whose_volumes_are_exchanged_are_found_by_where_their_hinges_lie(folder):
    posed(folder)
    flap = '[[volume]]\nname = "{}"\nlaw = "hinge"\noptions = {{ start = [0, {}, 0], end = [0, {}, 0] }}\n'
    text = DEFORM + flap.format("inner", 0, 2) + flap.format("outer", 3, 5)
    places = np.array([[1.0, 0.1, 0], [2, 1, 0], [1, 1.9, 0], [1, 3.1, 0], [2, 4, 0], [1, 4.9, 0]])
    for volumes, wrong in ((["inner"] * 3 + ["outer"] * 3, []), (["outer"] * 3 + ["inner"] * 3, ["inner", "outer"])):
        table = MarkerSet.make([f"m{k}" for k in range(6)], places, volume=volumes)
        io.write_markers(folder / "markers.csv", table, length_unit="mm")
        found = problems(folder, text)
        assert sorted(found) == [f"volume[{k}].options" for k in range(len(wrong))]
        assert all(f"the hinge of {v} (start to end) lies beside" in p.words
                   for v, p in zip(wrong, found.values(), strict=True))  # fmt: skip
