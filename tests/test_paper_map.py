"""docs/paper-map.md: every row leads to a command that exists, a verb, a test and a picture.

That the commands do what they say is shown by ``python docs/run_paper_map.py``, which runs them all.
"""

import importlib
import importlib.util
import sys
from pathlib import Path

import click
import pytest
import typer

import windmark
from windmark.app.cli import app

ROOT = Path(__file__).parents[1]
_SPEC = importlib.util.spec_from_file_location("run_paper_map", ROOT / "docs" / "run_paper_map.py")
paper_map = importlib.util.module_from_spec(_SPEC)
sys.modules[_SPEC.name] = paper_map  # dataclasses look their module up
_SPEC.loader.exec_module(paper_map)
ROWS = paper_map.rows()


def test_the_rows_are_counted():
    assert [row.number for row in ROWS] == list(range(1, len(ROWS) + 1))
    assert len(ROWS) >= 78
    assert len(paper_map.data_commands()) == 8


@pytest.mark.parametrize("row", ROWS, ids=lambda row: str(row.number))
def test_a_row_names_what_there_is(row):
    assert row.commands
    assert row.python
    assert row.tests
    for name in row.python:
        named(name)
    for name in row.tests:
        assert (ROOT / name).exists(), name
    for name in row.figures:
        assert (ROOT / "docs" / name).is_file(), name
    for command in row.commands:
        parsed(command.words)


def named(name):
    """A public name: wm.verb, room.verb, or a module."""
    target = name.removeprefix("wm.")
    try:
        importlib.import_module(f"windmark.{target}")
        return
    except ModuleNotFoundError:
        pass
    module, _, attribute = target.rpartition(".")
    place = importlib.import_module(f"windmark.{module}") if module and module[0].islower() else windmark
    here = getattr(place, module) if module and not module[0].islower() else place
    assert hasattr(here, attribute), name


GROUP = typer.main.get_command(app)


def parsed(words):
    """The verb takes these options; nothing is run."""
    command = GROUP
    arguments = list(words[1:])
    while isinstance(command, click.Group) or hasattr(command, "commands"):
        command = command.commands[arguments.pop(0)]
    command.make_context(words[1], arguments)


def test_every_verb_has_its_row():
    shown = {command.words[1] for row in ROWS for command in row.commands} | {"simulate", "demo"}
    shown |= {"init", "check", "verify", "doctor", "warmup", "view"}  # round the work: nothing of theirs is the paper's
    assert set(GROUP.commands) <= shown
