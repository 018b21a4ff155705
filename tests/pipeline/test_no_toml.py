"""What is said of a file that is no project."""

import re

import numpy as np
import pytest

from windmark import io
from windmark.io import FileError
from windmark.pipeline.settings import read_settings


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("rig.json", b'\n{"cameras": 1}', "is a JSON file, as those of cameras and rigs; expected a windmark project"),
        ("camera.xml", b"<?xml version='1.0'?>", "is an XML file; expected a windmark project"),
        ("x.csv", b"name,x,y,z\nA,1,2,3\n", "is a table; expected a windmark project"),
        ("p.toml", "a = 'ü'".encode("utf-16"), "is no text in UTF-8; expected a windmark project"),
        ("p.toml", b"[grid]\na = 1\n\na = 2\n", "line 4: a key is given twice (a); give it once"),
        ("p.toml", b"[grid]\na = 1\n[grid]\nb = 2\n", "line 3: a table is given twice ([grid]); give it once"),
        ("p.toml", b"a = \n", "is not valid TOML (Invalid value (at line 1, column 5)); expected a windmark project"),
    ],
)
def test_what_is_no_project_is_named(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FileError, match=re.escape(words)):
        read_settings(tmp_path / name)


@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.jpg"])
def test_a_picture_is_named_as_that(tmp_path, name):
    io.write_image(tmp_path / "a.tif", np.zeros((8, 8), np.uint8))
    signs = {"a.png": b"\x89PNG\r\n", "a.jpg": b"\xff\xd8\xff\xe0"}
    if name in signs:
        (tmp_path / name).write_bytes(signs[name])
    with pytest.raises(FileError, match="is a picture; expected a windmark project"):
        read_settings(tmp_path / name)
