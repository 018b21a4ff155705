"""How the program ends when something outside of it goes wrong: signals, a full standard output, odd project files."""

import os
import signal
import subprocess
import sys
import time
import weakref

import pytest

from windmark.app import cli

WINDMARK = [sys.executable, "-m", "windmark.app.cli"]


@pytest.mark.skipif(os.name == "nt", reason="signals are sent in another way on Windows")
def test_sigterm_tidies_up_as_ctrl_c_does(tmp_path):
    process = subprocess.Popen([*WINDMARK, "simulate", tmp_path / "test", "--photos", "40"], stderr=subprocess.PIPE)
    while process.poll() is None and not (tmp_path / ".windmark-test" / "new").is_dir():
        time.sleep(0.01)
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert said.decode() == "windmark: interrupted; nothing was written\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="the system has no /dev/full")
@pytest.mark.parametrize("arguments", [["--version"], ["laws", "--json"]])
def test_a_full_standard_output_is_said(arguments):
    with open("/dev/full", "w") as full:
        done = subprocess.run([*WINDMARK, *arguments], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].endswith("the disk is full")
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr


def test_a_project_file_nested_too_deeply(windmark, tmp_path):
    (tmp_path / "deep.toml").write_text("a = " + "[" * 3000 + "]" * 3000)
    done = windmark("run", tmp_path / "deep.toml")
    assert done.code == 2
    assert "deep.toml: is nested too deeply" in done.err


@pytest.mark.skipif(os.name == "nt", reason="links need rights on Windows")
def test_links_in_a_circle(windmark, tmp_path):
    (tmp_path / "loop.toml").symlink_to(tmp_path / "loop.toml")
    done = windmark("run", tmp_path / "loop.toml")
    assert done.code == 2
    assert "loop.toml: its links lead in a circle" in done.err
    done = windmark("simulate", tmp_path / "loop.toml" / "out")
    assert done.code == 2
    assert "its links lead in a circle" in done.err


def test_what_the_system_refuses_is_said_in_words(windmark, monkeypatch, tmp_path):
    from windmark.app import simulate_verb

    def refused(*_):
        raise OSError(5, "Input/output error", "/some/disk")

    monkeypatch.setattr(simulate_verb, "simulate", refused)
    done = windmark("simulate", tmp_path / "out")
    assert done.code == 2
    assert done.err == "windmark: /some/disk: the disk has a fault\n"


def test_ctrl_c_while_an_object_is_taken_away_is_not_lost(monkeypatch):
    """Python drops what a finalizer raises: a run went on to its end as if nobody had pressed it."""

    def interrupted(_):
        raise KeyboardInterrupt

    class Thing:
        pass

    monkeypatch.setattr(sys, "unraisablehook", cli._unraisable)
    thing = Thing()
    noticed = weakref.ref(thing, interrupted)
    del thing
    with pytest.raises(KeyboardInterrupt):
        time.sleep(0.2)
    assert noticed() is None
