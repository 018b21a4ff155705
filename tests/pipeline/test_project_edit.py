"""Names and exclusions written into a project file: only what was asked for changes, the user's text stays."""

import json
import tomllib

import numpy as np
import pytest
from PIL import Image

from windmark.errors import UsageError, WindmarkError
from windmark.pipeline.project import read_project
from windmark.pipeline.project_edit import SpotEdit, edit_spots

HEAD = """\
# Test 42, run 7. Ask Maria before changing this.
title = "a # in a title, and [[image]] too"   # said by the customer
length_unit = 'mm'

[[camera]]
file = "camera.json"

"""
TAIL = """
[markers]
file = "markers.csv"  # measured in May
[detect]
radius_px = 4.0
"""
WRITTEN = {
    "nothing": '[[image]]\nfile = "a.png"  # the first\n',
    "inline": '[[image]]\nfile = "a.png"\nlabels = { old = [1, 2], "T 9" = [3.0, 4] } # by eye\n'
              'exclude = [[5, 6], [7, 8]]',
    "table": '[[image]]\nfile = "a.png"\nexclude = [\n  [5, 6], # a rivet\n  [7, 8]\n]\nchannel = "grey"\n'
             '[image.labels]\nold = [1, 2]  # sure\n"T 9" = [\n 3.0,\n 4 ]\n',
    "dotted": '[[image]]\n  file = "a.png"\n  labels.old = [1, 2]\n  labels."T 9" = [3.0, 4]\n'
              '  exclude = [[5,6],[7,8],]\n',
    "last line": '[[image]]\nfile = "a.png"\n[image.labels]\nold = [1, 2]\n"T 9" = [3.0, 4]',
}  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    for name in ("a.png", "b.png"):
        Image.fromarray(np.full((8, 8), 90, np.uint8)).save(tmp_path / name)
    (tmp_path / "camera.json").write_text("{}")
    (tmp_path / "markers.csv").write_text("name,x,y,z\n")
    return tmp_path


def project(folder, images, tail=TAIL):
    path = folder / "project.toml"
    path.write_bytes((HEAD + images + tail).encode("utf-8"))
    read_project(path)
    return path


def lines_gone(before, after):
    """Lines of the text before that are not in the one after."""
    left = after.splitlines()
    return [line for line in before.splitlines() if line not in left]


@pytest.mark.parametrize("images", WRITTEN.values(), ids=WRITTEN)
@pytest.mark.parametrize("name", ["new", "T 9", "old", "Flügel.\"2\"", "a.b"])
def test_a_name_is_written_whatever_way_the_others_are(folder, images, name):
    path = project(folder, images + "\n", '\n[[image]]\nfile = "b.png"\n' + TAIL)
    before, old = path.read_text("utf-8"), tomllib.loads(path.read_text("utf-8"))
    edit_spots(path, "a", SpotEdit(label=(name, (10.126, 20.0))))
    after = path.read_text("utf-8")
    new = tomllib.loads(after)
    assert new["image"][0].get("labels") == {**old["image"][0].get("labels", {}), name: [10.13, 20.0]}
    assert new["image"][0].get("exclude") == old["image"][0].get("exclude")
    assert {**new, "image": new["image"][1:]} == {**old, "image": old["image"][1:]}
    assert after.startswith(HEAD)
    assert after.endswith(TAIL)
    assert after.count("#") == before.count("#")
    assert len(lines_gone(before, after)) <= 3  # of an entry that was replaced
    assert read_project(path).image[0].labels[name] == (10.13, 20.0)


@pytest.mark.parametrize("images", WRITTEN.values(), ids=WRITTEN)
def test_a_spot_is_excluded_and_taken_in_again(folder, images):
    path = project(folder, images + "\n")
    old = tomllib.loads(path.read_text("utf-8"))["image"][0].get("exclude", [])
    edit_spots(path, "a", SpotEdit(exclude=(1.5, 2.25)))
    assert tomllib.loads(path.read_text("utf-8"))["image"][0]["exclude"] == [*old, [1.5, 2.25]]
    for k in reversed(range(len(old) + 1)):
        edit_spots(path, "a", SpotEdit(drop_excluded=[k]))
        assert list(read_project(path).image[0].exclude) == [tuple(p) for p in old[:k]]
    text = path.read_text("utf-8")
    assert text.startswith(HEAD)
    assert text.endswith(TAIL)


@pytest.mark.parametrize("images", list(WRITTEN.values())[1:], ids=list(WRITTEN)[1:])
def test_labels_go_one_by_one(folder, images):
    path = project(folder, images + "\n")
    for k, name in enumerate(["old", "T 9"]):
        edit_spots(path, "a", SpotEdit(drop_labels=[name]))
        assert len(read_project(path).image[0].labels) == 1 - k
    assert path.read_text("utf-8").endswith(TAIL)


def test_a_comment_within_an_array_stays(folder):
    path = project(folder, WRITTEN["table"])
    edit_spots(path, "a", SpotEdit(drop_excluded=[1], exclude=(9, 9)))
    assert "# a rivet" in path.read_text()
    assert read_project(path).image[0].exclude == ((5, 6), (9, 9))


def test_windows_line_ends_and_a_byte_order_mark_stay(folder):
    path = project(folder, WRITTEN["table"])
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    edit_spots(path, "a", SpotEdit(label=("N", (1, 1)), exclude=(9, 9)))
    content = path.read_bytes()
    assert content.startswith(b"\xef\xbb\xbf#")
    assert content.count(b"\r\n") == content.count(b"\n")
    assert read_project(path).image[0].labels["N"] == (1, 1)


def test_a_pattern_becomes_one_table_for_each_picture(folder):
    path = project(folder, '[[image]]\nfile = "*.png"  # all of them\n')
    edit_spots(path, "b", SpotEdit(label=("N", (1, 1))))
    one, other = read_project(path).image
    assert [one.file.name, other.file.name] == ["a.png", "b.png"]
    assert (one.labels, other.labels) == ({}, {"N": (1, 1)})
    assert path.read_text().count("# all of them") == 2


def test_a_pattern_is_of_the_projects_folder_from_wherever_it_is_read(folder, monkeypatch):
    path = project(folder, '[[image]]\nfile = "*.png"\n')
    monkeypatch.chdir(folder.parent)
    images = read_project(path.relative_to(folder.parent)).image
    assert [i.file for i in images] == [(folder / n).resolve() for n in ("a.png", "b.png")]


def test_two_pictures_of_one_name_keep_the_names_that_the_pattern_gave_them(folder):
    for sub in ("p", "q"):
        (folder / sub).mkdir()
        Image.fromarray(np.full((8, 8), 90, np.uint8)).save(folder / sub / "x.png")
    path = project(folder, '[[image]]\nfile = "?/x.png"\n')
    names = [i.label for i in read_project(path).image]
    edit_spots(path, names[1], SpotEdit(exclude=(1, 1)))
    assert [i.label for i in read_project(path).image] == names
    assert [len(i.exclude) for i in read_project(path).image] == [0, 1]


@pytest.mark.parametrize(("text", "said"), [
    ('image = [ { file = "a.png" } ]\n', "by hand"),
    ('[[image]]\nfile = "b.png"\n', "no image a"),
])  # fmt: skip
def test_what_cannot_be_edited_is_said_and_left_as_it_was(folder, text, said):
    path = folder / "project.toml"
    path.write_text('title = "t"\nlength_unit = "mm"\n' + text + '[[camera]]\nfile = "camera.json"\n' + TAIL)
    before = path.read_bytes()
    with pytest.raises(UsageError, match=said):
        edit_spots(path, "a", SpotEdit(exclude=(1, 1)))
    assert path.read_bytes() == before


def test_what_would_be_no_project_is_not_written(folder):
    path = project(folder, WRITTEN["inline"])
    before = path.read_bytes()
    with pytest.raises(WindmarkError):
        edit_spots(path, "a", SpotEdit(exclude=(float("nan"), float("inf"))))
    (folder / "markers.csv").unlink()  # what the project names is looked for, too
    with pytest.raises(WindmarkError, match=r"markers\.csv"):
        edit_spots(path, "a", SpotEdit(exclude=(1, 1)))
    assert path.read_bytes() == before


def test_a_json_string_is_what_a_name_becomes(folder):
    path = project(folder, WRITTEN["nothing"])
    edit_spots(path, "a", SpotEdit(label=("a\\b\t", (1, 1))))
    assert json.dumps("a\\b\t") in path.read_text()
    assert list(read_project(path).image[0].labels) == ["a\\b\t"]
