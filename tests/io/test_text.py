"""JSON: everything comes back, nothing is guessed."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from windmark.io import FileError, read_json, to_json, write_json

text = st.text(st.characters(codec="utf-8"))
values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | text,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(text, inner, max_size=4),
    max_leaves=12,
)


@given(value=values)
def test_round_trip(one_folder, value):
    path = one_folder / "v.json"
    write_json(path, {"value": value})
    assert read_json(path) == {"value": value}


def test_numpy_dataclass_path_and_what_json_lacks(tmp_path):
    @dataclass
    class Point:
        x: float
        n: np.int64

    write_json(
        tmp_path / "v.json",
        {
            "a": np.eye(2),
            "b": np.float32(0.5),
            "c": (np.bool_(True), None),
            "d": Point(np.nan, np.int64(3)),
            "e": [np.inf, -np.inf, 0.1],
            "f": Path("x") / "y",
            "g": np.array(["s"]),
            3: {},
            "h": [],
        },
    )
    assert read_json(tmp_path / "v.json") == {
        "a": [[1, 0], [0, 1]], "b": 0.5, "c": [True, None], "d": {"x": None, "n": 3},
        "e": [None, None, 0.1], "f": str(Path("x") / "y"), "g": ["s"], "3": {}, "h": [],
    }  # fmt: skip


def test_rows_of_numbers_stay_on_one_line(tmp_path):
    write_json(tmp_path / "v.json", {"m": np.eye(2), "µ": 1})
    assert (tmp_path / "v.json").read_text("utf-8") == (
        '{\n  "m": [\n    [1.0, 0.0],\n    [0.0, 1.0]\n  ],\n  "µ": 1\n}\n'
    )


def test_the_text_to_print_is_the_text_of_the_file(tmp_path):
    value = {"a": np.eye(2), "b": {"c": np.nan}}
    write_json(tmp_path / "v.json", value)
    assert to_json(value) + "\n" == (tmp_path / "v.json").read_text()


def test_what_cannot_be_written_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"write_json: a\.b\[1\] is a complex, which JSON cannot hold"):
        write_json(tmp_path / "v.json", {"a": {"b": [1, 1j]}})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a": 1,\n "b": }', "line 2: not JSON"),
        ('{"a": 1, "a": 2}', "key 'a': the key is there more than once"),
        ('{"a": NaN}', "NaN is not JSON"),
        ('{"a": -Infinity}', "-Infinity is not JSON"),
        ("[" * 100_000, "nested too deep"),
        ('{"a": ' + "1" * 10_000 + "}", "a number too long"),
        (" ", "the file is empty"),
    ],
)
def test_bad_json(tmp_path, text, message):
    (tmp_path / "v.json").write_text(text)
    with pytest.raises(FileError, match=message):
        read_json(tmp_path / "v.json")


def test_byte_order_mark_is_accepted(tmp_path):
    (tmp_path / "v.json").write_bytes(b"\xef\xbb\xbf" + json.dumps({"a": 1}).encode())
    assert read_json(tmp_path / "v.json") == {"a": 1}
