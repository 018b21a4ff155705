"""Errors have types of their own, so that a fault of windmark is never told as wrong use: looked up in the sources."""

import ast
import functools
import re
from pathlib import Path

import pytest

import windmark
import windmark.errors

PACKAGE = Path(windmark.__file__).parent
JUDGES = ("app", "pipeline", "tasks")
"""Rooms that judge options, settings and what files say together: all their words are for the user."""
BUILTIN = ("ValueError", "Exception", "BaseException", "ArithmeticError", "KeyError", "LookupError")
RETOLD = {"pipeline/settings.py", "deformation/law.py"}
"""Where a plain error's words go on as a bad file: of TOML and paths, and of what a user's own law says of itself."""


def errors_in(text):
    """What a file says of errors: where some are made, and where they are caught."""
    if "raise" not in text and "except" not in text:
        return []
    return [node for node in ast.walk(ast.parse(text)) if isinstance(node, (ast.Raise, ast.ExceptHandler))]


@functools.cache
def sources():
    """Every file of the package and its errors."""
    return [(p.relative_to(PACKAGE).as_posix(), errors_in(p.read_text("utf-8"))) for p in sorted(PACKAGE.rglob("*.py"))]


def raised(nodes):
    """Line, name and words of all errors that are made there."""
    for node in nodes:
        if isinstance(node, ast.Raise) and node.exc is not None:
            made = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
            yield node.lineno, ast.unparse(made), ast.unparse(node.exc)


def retold(nodes):
    """Lines of handlers that catch a plain `ValueError` and say its words, or their own, in its place."""
    for node in nodes:
        if isinstance(node, ast.ExceptHandler) and node.type is not None and node.name is not None:
            caught = {ast.unparse(n) for n in ast.walk(node.type) if isinstance(n, ast.Name)}
            again = any(isinstance(n, ast.Raise) and n.exc is None for n in ast.walk(node))
            if "ValueError" in caught and not again:
                yield node.lineno


@pytest.mark.slow
def test_the_rooms_that_judge_for_the_user_raise_errors_of_windmarks_own_types():
    plain = [
        f"{file}:{line}: {name}"
        for file, nodes in sources() if file.split("/")[0] in JUDGES
        for line, name, _ in raised(nodes) if name in BUILTIN
    ]  # fmt: skip
    assert plain == []


def test_no_room_says_a_choice_or_an_option_by_a_plain_error():
    plain = [
        f"{file}:{line}: {words}"
        for file, nodes in sources()
        for line, name, words in raised(nodes)
        if name == "ValueError" and re.search(r"\b(?:must|expected) (?:be )?one of\b|\bpath must\b|--[a-z]", words)
    ]  # fmt: skip
    assert plain == []


def test_nobody_tells_a_fault_as_somebody_elses_mistake():
    told = {file for file, nodes in sources() if not file.startswith("io/") for _ in retold(nodes)}
    assert told == RETOLD


def test_the_laws_above_see_what_they_are_for():
    nodes = errors_in("""
try:
    map_it()
except (TypeError, ValueError) as error:
    raise FileError(path, str(error))
raise ValueError(f"unit must be one of {units}")
""")
    assert list(retold(nodes)) == [4]
    assert [name for _, name, _ in raised(nodes)] == ["ValueError", "FileError"]


def test_nothing_has_no_sign():
    assert [windmark.errors.g2(v) for v in (-0.0, 0.0, -0.001)] == ["0", "0", "-0.001"]


def test_a_number_has_the_digits_that_its_sigma_earns():
    pairs = (0.00699, 0.014), (1347.3521, 0.0497), (12.3, 0.0), (5e3, 210.0)
    said = [windmark.errors.plus_minus(*pair) for pair in pairs]
    assert said == ["0.007 ± 0.014", "1347.352 ± 0.050", "12.3", "5000 ± 210"]
