"""Examples in the docstrings of what is public run as they are written."""

import doctest
import inspect

import pytest

import windmark as wm

FINDER = doctest.DocTestFinder(exclude_empty=True)


def examples() -> list[doctest.DocTest]:
    """Those of the public names, and of their methods."""
    out = []
    for name in wm.__all__:
        thing = getattr(wm, name)
        if inspect.isclass(thing) or inspect.isfunction(thing):
            out += [t for t in FINDER.find(thing, f"wm.{name}", module=False, globs={}) if t.examples]
    return out


@pytest.mark.parametrize("example", examples(), ids=lambda e: e.name)
def test_example(example):
    failures, tried = doctest.DocTestRunner(verbose=False).run(example)
    assert tried
    assert not failures


def test_the_main_verbs_have_examples():
    assert {"wm.detect", "wm.register", "wm.map_pixels", "wm.sample"} <= {e.name for e in examples()}
