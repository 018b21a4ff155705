"""Examples in the docstrings of what is public run as they are written, and nothing public is without one."""

import doctest
import inspect

import pytest

import windmark as wm

FINDER = doctest.DocTestFinder(exclude_empty=True)
PUBLIC = {
    name: thing
    for name in wm.__all__
    if inspect.isclass(thing := getattr(wm, name)) or inspect.isfunction(thing)
}  # fmt: skip


def examples() -> list[doctest.DocTest]:
    """Those of the public names, and of their methods."""
    out = []
    for name, thing in PUBLIC.items():
        out += [t for t in FINDER.find(thing, f"wm.{name}", module=False, globs={}) if t.examples]
    return out


@pytest.mark.parametrize("example", examples(), ids=lambda e: e.name)
def test_example(example):
    failures, tried = doctest.DocTestRunner(verbose=False).run(example)
    assert tried
    assert not failures


def test_all_that_is_public_has_an_example():
    """In its own docstring: that of a method is none of its class."""
    with_one = {e.name for e in examples()}
    assert [name for name in PUBLIC if f"wm.{name}" not in with_one] == []


def test_examples_show_what_comes_out():
    """One that expects no output at all could not fail but by an error."""
    assert [e.name for e in examples() if not any(line.want for line in e.examples)] == []


def test_examples_stand_for_themselves():
    """They import what they use, so that they run where a reader puts them."""
    assert [e.name for e in examples() if "import windmark as wm\n" not in [x.source for x in e.examples]] == []
