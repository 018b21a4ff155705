"""`windmark verify` where the result cannot be had again: its verdict is on that, not the one of then."""

import shutil

import pytest

from windmark.app.verify_verb import _within, compared
from windmark.pipeline.repeat import Difference
from windmark.pipeline.verdict import DOUBTFUL

pytestmark = pytest.mark.usefixtures("all_undrawn")

REGISTER = ("register", "wind-off.tif", "-m", "markers.csv", "-c", "camera.json", "-r", 4, "--unit", "mm", "-o", "out")


@pytest.mark.slow
def test_a_result_that_was_changed_is_not_good(virtual_test, tmp_path, windmark, monkeypatch):
    for name in ("wind-off.tif", "markers.csv", "camera.json"):
        shutil.copy(virtual_test[0] / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    assert windmark(*REGISTER).code == 0
    (tmp_path / "out" / "summary.json").write_text((tmp_path / "out" / "summary.json").read_text() + "\n")
    done = windmark("verify", "out")
    assert done.code == 1
    assert "NOT the same" in done.out
    assert "doubtful: the result cannot be had again: it was changed or taken away since: summary.json" in done.out
    assert "● good" not in done.out


@pytest.mark.parametrize(
    ("options", "where"), [({"seed": 1}, "."), ({"folder": ".."}, "results"), ({"output": "."}, ".")]
)
def test_a_result_in_the_folder_that_its_verb_was_given_is_compared_there(tmp_path, options, where):
    assert _within({"options": options}, tmp_path / "results") == where


@pytest.mark.parametrize(
    ("found", "words", "step"),
    [
        (Difference(inputs={"a.tif": "changed", "b.tif": "changed"}, numbers={"x": ["1"]}),
         "its input is another one: a.tif changed (and 1 more)", "take that file back"),
        (Difference(touched=["poses.csv"]), "changed or taken away since: poses.csv", "run the job again"),
        (Difference(versions={"numpy": ("2.1", "2.2")}, numbers={"x": ["1"]}), "numpy was 2.1 and is 2.2", "versions"),
        (Difference(numbers={"x": ["1"]}), "the same inputs and versions give other numbers", "report it"),
    ],
)  # fmt: skip
def test_what_is_not_as_it_was_is_the_reason(found, words, step):
    verdict = compared(found)
    assert verdict.word == DOUBTFUL
    assert words in verdict.reason
    assert step in verdict.next_step
