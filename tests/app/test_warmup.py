"""`windmark warmup`: every job of it comes to its end, and one that does not is said."""

import pytest

from windmark.errors import DataError
from windmark.pipeline import warmup


@pytest.mark.slow  # each room's whole job once
def test_every_part_is_compiled():
    shown = []
    assert warmup.compile_all(lambda name, n, count: shown.append((name, n, count))) == {}
    assert [n for _, n, _ in shown] == list(range(len(shown)))
    assert {count for *_, count in shown} == {len(shown)}


def test_a_part_that_cannot_be_compiled_is_said_and_the_others_go_on(windmark, monkeypatch):
    done = []

    def fails():
        raise DataError("no such thing")

    monkeypatch.setattr(warmup.Warmup, "jobs", lambda self: iter([("one", fails), ("two", lambda: done.append("two"))]))
    answer = windmark("warmup", "--json")
    assert answer.code != 0
    assert answer.json["failed"] == {"one": "no such thing"}
    assert done == ["two"]
