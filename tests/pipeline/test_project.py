"""The project file: every mistake is named before any work starts."""

import pytest

from windmark.io import FileError
from windmark.pipeline.project import read_project

GOOD = """
title = "t"
length_unit = "mm"
[[camera]]
file = "camera.json"
[[image]]
file = "a.tif"
[markers]
file = "markers.csv"
[grid]
file = "wing.grid"
[detect]
radius_px = 3
"""


@pytest.fixture
def write(tmp_path):
    for name in ("camera.json", "a.tif", "b.tif", "markers.csv", "wing.grid"):
        (tmp_path / name).touch()

    def written(text):
        path = tmp_path / "project.toml"
        path.write_text(text)
        return path

    return written


def test_a_unit_that_is_missing_is_asked_for_with_those_there_are(write):
    with pytest.raises(FileError, match="length_unit: is missing; expected in, ft, mm, cm or m"):
        read_project(write(GOOD.replace('length_unit = "mm"\n', "")))


def test_a_good_project_has_absolute_paths_and_defaults(write, tmp_path):
    project = read_project(write(GOOD))
    assert project.image[0].file == tmp_path / "a.tif"
    assert project.image[0].label == "a"
    assert project.output.folder == tmp_path / "results"
    assert project.detect.radius_px == 3
    assert project.camera_of(project.image[0]).name == "camera"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("radius_px = 3", "radius_px = 3\nradios = 2"), ["detect.radios", "unknown key", "merit_max"]),
        (("[grid]", "[gird]"), ["gird", "unknown key", "grid"]),
        (("radius_px = 3", "radius_px = -3"), ["detect.radius_px", "greater than or equal to 1", "-3"]),
        (("radius_px = 3", 'radius_px = "big"'), ["detect.radius_px", "big"]),
        (('length_unit = "mm"', ""), ["length_unit", "missing"]),
        (('length_unit = "mm"', 'length_unit = "furlong"'), ["length_unit", "furlong", "mm"]),
        (('file = "a.tif"', 'file = "z.tif"'), ["image[0].file", "z.tif"]),
        (("[grid]", '[align]\nreference = "z"\n[grid]'), ["align", "'z'"]),
        (("[detect]\nradius_px = 3", ""), ["[detect] is missing"]),
        (('[[image]]\nfile = "a.tif"', ""), ["image"]),
        (('file = "a.tif"', 'file = "a.tif"\n[[image]]\nfile = "a.tif"'), ["unique", "a"]),
        (('file = "a.tif"', 'file = "a.tif"\nname = "../x"'), ["file names"]),
        (("title", "path = 3\ntitle"), ["path", "unknown key"]),
        (("[grid]", "[grid"), ["TOML"]),
    ],
)
def test_mistakes_name_the_file_the_key_and_the_expectation(write, change, words):
    path = write(GOOD.replace(*change))
    with pytest.raises(FileError) as error:
        read_project(path)
    for word in ["project.toml", *words]:
        assert word in str(error.value)


def test_two_cameras_need_a_name_in_each_image(write):
    second = '[[camera]]\nname = "second"\nfile = "camera.json"\n'
    with pytest.raises(FileError, match="say which camera took it"):
        read_project(write(GOOD.replace("[markers]", second + "[markers]")))


def test_a_view_needs_a_grid(write):
    view = '[[view]]\nname = "top"\ndirection = [0,0,-1]\nup = [0,1,0]\n'
    text = GOOD.replace('[grid]\nfile = "wing.grid"', view)
    with pytest.raises(FileError, match="need a grid"):
        read_project(write(text))


def test_missing_and_binary_files_are_clear(tmp_path):
    with pytest.raises(FileError, match="no such file"):
        read_project(tmp_path / "absent.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(bytes(range(256)))
    with pytest.raises(FileError, match="TOML"):
        read_project(binary)


RIG = GOOD.replace(
    'file = "camera.json"\n[[image]]\nfile = "a.tif"',
    """name = "left"
file = "camera.json"
[[camera]]
name = "right"
file = "camera.json"
[[image]]
file = "a.tif"
camera = "left"
[[image]]
file = "b.tif"
camera = "right"
[rig]""",
)


def test_images_of_a_rig_are_of_one_instant(write):
    project = read_project(write(RIG))
    assert project.rig_cameras == ("left", "right")
    assert [[i.label for i in group] for group in project.instants] == [["a", "b"]]
    assert read_project(write(GOOD)).instants == ()
    other = RIG.replace('file = "b.tif"', 'file = "b.tif"\npoint = "2"').replace('"a.tif"', '"a.tif"\npoint = "1"')
    assert read_project(write(other)).instants == ()
    turned = read_project(write(RIG.replace("[rig]", '[rig]\ncameras = ["right", "left"]')))
    assert [[i.label for i in group] for group in turned.instants] == [["b", "a"]]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[rig]", '[rig]\nfile = "none.json"', "rig.file"),
        ("[rig]", '[rig]\ncameras = ["left", "top"]', "'top' is not the name of a camera; they are left, right"),
        ("[rig]", '[rig]\ncameras = ["left", "left"]', "named once"),
        ("[rig]", '[rig]\ncameras = ["left"]', "rig.cameras"),
        ("[rig]", '[rig]\ntrust = ["top"]', "'top' is not a camera of the rig"),
        ('name = "left"', 'name = "left"\npose = "known"', "at least two cameras whose pose is to be found, got right"),
        ('"b.tif"\ncamera = "right"', '"b.tif"\ncamera = "left"', "images a and b are both of camera left"),
        ('"b.tif"', '"b.tif"\npoint = "1"', "image a has no point while others have one"),
    ],
)
def test_a_rig_that_does_not_fit_is_refused(write, old, new, words):
    with pytest.raises(FileError) as error:
        read_project(write(RIG.replace(old, new)))
    assert words in str(error.value)


def test_a_rig_takes_no_camera_of_known_pose(write):
    third = '[[camera]]\nname = "top"\nfile = "camera.json"\npose = "known"\n[rig]\n'
    assert read_project(write(RIG.replace("[rig]", third))).rig_cameras == ("left", "right")
    with pytest.raises(FileError, match="the pose of camera top is known"):
        read_project(write(RIG.replace("[rig]", third + 'cameras = ["left", "right", "top"]')))


def test_binding_is_for_labels(write):
    binding = GOOD + "[register]\nbinding = true\n"
    with pytest.raises(FileError, match="no image has labels"):
        read_project(write(binding))
    project = read_project(write(binding.replace('"a.tif"', '"a.tif"\nlabels = { w03 = [5, 6] }')))
    assert project.register_.binding


@pytest.mark.parametrize(
    ("value", "words"),
    [("5", "expected a path, as text in quotes, got 5"), ("true", "expected a path, as text in quotes, got true")],
)
def test_what_is_no_path_is_said_without_words_of_python(write, value, words):
    with pytest.raises(FileError) as error:
        read_project(write(GOOD.replace('"camera.json"', value)))
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = " + "[" * 2000 + "]" * 2000, "is nested too deeply"),
        ("a = " + "1" * 5000, "is not valid TOML"),
        ("a." * 20_000 + "b = 1", "a key has over 100 parts"),
        ("[detect]\n" + "x" * 400_000, "not valid TOML"),  # took the square of its length
        (GOOD.replace("a.tif", "x" * 5000), "it is too long"),
        (GOOD.replace("camera.json", "x" * 5000), "the name is too long; expected the path of an existing file"),
        (GOOD.replace("camera.json", "a\\u0000b"), "null (byte|character).*; expected the path of an existing file"),
    ],
)
def test_files_that_are_too_much_for_the_library(write, text, words):
    with pytest.raises(FileError, match=words) as error:
        read_project(write(text))
    assert len(str(error.value)) < 1200
