"""`windmark warmup`: every job of it comes to its end, and one that does not is said."""

import pytest

from windmark.errors import DataError
from windmark.pipeline import warmup


@pytest.mark.slow  # each room's whole job once
def test_every_part_is_compiled():
    shown = []
    assert warmup.compile_all(lambda name, n, count: shown.append((name, n, count)), 2) == {}
    assert [n for _, n, _ in shown] == sorted(n for _, n, _ in shown)
    assert set(warmup.APART) < {name for name, *_ in shown}
    jobs = len(list(warmup.Warmup().jobs()))
    assert {count for *_, count in shown} == {jobs}
    assert max(n for _, n, _ in shown) == jobs - 1


def test_a_part_that_cannot_be_compiled_is_said_and_the_others_go_on(windmark, monkeypatch):
    done = []

    def fails():
        raise DataError("no such thing")

    monkeypatch.setattr(warmup.Warmup, "jobs", lambda self: iter([("one", fails), ("two", lambda: done.append("two"))]))
    answer = windmark("warmup", "--processes", 1, "--json")
    assert answer.code != 0
    assert answer.json["failed"] == {"one": "no such thing"}
    assert done == ["two"]
