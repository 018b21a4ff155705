"""docs/conventions.md, what is said at the edges: every row has a sentence, and tests that are there."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SECTION = "### What is said at the edges, and which test keeps it"
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in (ROOT / "docs" / "conventions.md").read_text("utf-8").split(SECTION)[1].splitlines()
    if line.startswith("| ")
][1:]


def functions_of(file):
    return {node.name for node in ast.parse((ROOT / file).read_text("utf-8")).body if isinstance(node, ast.FunctionDef)}


def test_the_rows_are_counted():
    assert len(ROWS) >= 20
    assert len({row[0] for row in ROWS}) == len(ROWS)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_a_row_has_what_is_read_and_tests_that_are_there(row):
    _, said, tests = row
    assert said
    file, named = "", re.findall(r"`([^`]*)::(test_\w+)`", tests)
    assert named
    for place, name in named:
        file = place or file  # a second test of the same file
        assert name in functions_of(file), f"{file}::{name}"
