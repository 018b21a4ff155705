"""Usage lines, help and refusals of the command line: what has to be given is shown, and in words."""

import json
import re
import subprocess
import sys

import pytest
import typer.main

import windmark
from windmark.app.cli import app
from windmark.app.command_line import command_line
from windmark.app.commands.usage import worded


def commands(group=None, path=()):
    """Every command with its path."""
    group = group or typer.main.get_command(app)
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name), command


def refused(words, monkeypatch, capsys):
    """Standard error and output of a call of wrong usage."""
    monkeypatch.setattr("sys.argv", ["windmark", *words])
    assert command_line(app, "--json" in words) == 2
    return capsys.readouterr()


def test_usage_shows_all_that_has_to_be_given_and_help_has_no_words_of_python(windmark):
    seen = 0
    for path, command in commands():
        text = windmark(*path, "--help").out
        usage = " ".join(text.partition("\n\n")[0].split())
        for param in command.params:
            if param.required and param.param_type_name == "option":
                seen += 1
                assert re.search(rf" {min(param.opts, key=len)} <[a-z |]+>", usage), (path, param.name, usage)
        assert usage.endswith("[OPTIONS]"), path
        assert not re.search(r"<[^>\n]*(list\[|\bstr\b|\bfloat\b|\bint\b|Path)", text), path
    assert seen > 8


def test_the_usage_of_one_verb(windmark):
    usage = " ".join(windmark("register", "--help").out.partition("\n\n")[0].split())
    assert usage.endswith(" register {image} -m <path> -c <path> --unit <text> [OPTIONS]")
    assert "convert {SOURCE... TARGET} [OPTIONS]" in windmark("convert", "--help").out


def test_an_option_that_may_be_given_again_says_so_once():
    for path, command in commands():
        for param in command.params:
            if param.param_type_name == "option" and param.multiple:
                _, said = worded(param.get_help_record(typer.Context(command)), param)
                assert len(re.findall("several times|twice|for each", said)) == 1, (path, param.name, said)


def test_all_that_lacks_is_named_at_once(monkeypatch, capsys):
    said = refused(["register"], monkeypatch, capsys).err
    assert "Missing argument 'image' and options '--markers' / '-m', '--camera' / '-c', '--unit'." in said
    said = refused(["register", "a.png", "-m", "m.csv", "--unit", "mm"], monkeypatch, capsys).err
    assert "Missing option '--camera' / '-c'." in said


@pytest.mark.parametrize("words", [["register", "a.png"], ["detect", "a.png", "--no-such"], ["no-such-verb"]])
def test_wrong_usage_has_a_verdict_for_machines(words, monkeypatch, capsys):
    record = json.loads(refused([*words, "--json"], monkeypatch, capsys).out)
    verdict = record["verdict"]
    assert (verdict["word"], verdict["cause"], verdict["reason"]) == ("bad", "usage", record["error"])
    assert "--help" in verdict["next_step"]


def test_many_options_stand_under_headings():
    for path, command in commands():
        options = [p for p in command.params if p.param_type_name == "option"]
        bare = [p.opts[0] for p in options if not getattr(p, "rich_help_panel", None)]
        assert len(options) <= 6 or path == ("init",) or not bare, (path, bare)


@pytest.mark.parametrize("words", [
    ("register", "P*.tif", "-m", "m.csv", "-c", "c.json", "--unit", "mm"),
    ("epipolar", "P*.tif", "Q.tif", "-m", "m.csv"),
    ("resect", "P*.tif", "-c", "c.json", "-g", "g.stl", "--unit", "mm"),
])  # fmt: skip
def test_a_pattern_of_several_pictures_where_one_is_wanted(windmark, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    for name in ("P01.tif", "P02.tif"):
        (tmp_path / name).write_bytes(b"")
    done = windmark(*words)
    assert done.code == 2
    assert "P*.tif: 2 files match this pattern, P01.tif to P02.tif; expected one picture: name it" in done.err


def test_python_m_is_the_command():
    """On Windows the folder of scripts is often not on the path."""
    done = subprocess.run([sys.executable, "-m", "windmark", "-V"], capture_output=True, text=True, check=True)
    assert done.stdout == f"windmark {windmark.__version__}\n"
    done = subprocess.run([sys.executable, "-m", "windmark", "detect"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "windmark detect" in done.stderr
    assert "__main__" not in done.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["detect", "a.png", "--polarity", "dark", "--polarity", "bright"], "--polarity is given 2 times; expected"),
        (["detect", "a.png", "--channel=red", "-r", "3", "--channel", "blue"], "--channel is given 2 times"),
        (["run", "p.toml", "-o", "x", "--output", "y"], "--output / -o is given 2 times"),
        (["calibrate", "a.png", "-m", "m.csv", "--unit", "mm", "--reject", "--no-reject", "-o", "x"],
         "--reject / --no-reject is given 2 times"),
    ],
)  # fmt: skip
def test_an_option_with_one_value_is_given_once(words, said, monkeypatch, capsys):
    """The last one counted, in silence."""
    assert said in refused(words, monkeypatch, capsys).err
    done = json.loads(refused([*words, "--json"], monkeypatch, capsys).out)
    assert said in done["verdict"]["reason"]
    assert done["verdict"]["cause"] == "usage"


@pytest.mark.parametrize("words", [["--radius", "3", "--radius", "5"], ["--json", "--json"], ["-r", "3", "-r", "3"]])
def test_lists_and_flags_may_be_repeated(words, monkeypatch, capsys):
    told = refused(["detect", "no-such.png", *words], monkeypatch, capsys)
    assert "times" not in told.err + told.out
    assert "no-such.png" in told.err + told.out
