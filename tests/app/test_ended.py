"""How the program ends when something outside of it goes wrong: signals, a full standard output, odd project files."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
import weakref

import numba as nb
import numpy as np
import pytest

from windmark.app import cli, console
from windmark.io.written import begin_command

pytestmark = pytest.mark.slow  # processes that are ended from outside

WINDMARK = [sys.executable, "-m", "windmark.app.cli"]


@pytest.mark.skipif(os.name == "nt", reason="signals are sent in another way on Windows")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_queue_or_a_closing_terminal_ends_a_run_as_ctrl_c_does(tmp_path, name):
    process = subprocess.Popen([*WINDMARK, "simulate", tmp_path / "test", "--photos", "40"], stderr=subprocess.PIPE)
    while process.poll() is None and not (tmp_path / ".windmark-test" / "new").is_dir():
        time.sleep(0.01)
    process.send_signal(getattr(signal, name))
    if name == "SIGHUP":  # shell and kernel both send it
        process.send_signal(signal.SIGHUP)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert said.decode() == "windmark: interrupted; nothing was written\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.name == "nt", reason="Windows has no terminals of this kind")
def test_a_terminal_that_closes_leaves_nothing_half_done(tmp_path):
    """Standard output and error are gone then, too: neither may break off the tidying up."""
    import pty

    pid, terminal = pty.fork()
    if pid == 0:
        try:
            os.execv(WINDMARK[0], [*WINDMARK, "simulate", str(tmp_path / "test"), "--photos", "40"])
        finally:
            os._exit(99)
    while not (tmp_path / ".windmark-test" / "new").is_dir():
        assert os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None
        time.sleep(0.01)
    os.close(terminal)
    _, status = os.waitpid(pid, 0)
    assert os.WIFEXITED(status)
    assert not list(tmp_path.iterdir())


def test_ctrl_c_before_a_verb_is_at_work_is_no_traceback(monkeypatch, capsys):
    """While the command line was being set up, a signal ended in a traceback with exit code 1."""

    def interrupted(**_):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "app", interrupted)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    begin_command()  # what other tests wrote in this process is another command's
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 130
    assert capsys.readouterr().err == "windmark: interrupted; nothing was written\n"


@nb.njit(nogil=True)
def _long(n):
    total = 0.0
    for i in range(n):
        total += np.sin(1.0 * i)
    return np.full(3, total), np.full(3, total)


@pytest.mark.skipif(os.name == "nt", reason="signals are sent in another way on Windows")
def test_ctrl_c_amid_a_kernel_is_no_fault_of_windmark():
    """Raised while numba hands the arrays over it came out as a SystemError: "a fault of windmark", exit code 3."""
    _long(3)
    before = signal.signal(signal.SIGINT, cli._ended)
    ctrl_c = threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT))
    woken, late = threading.Event(), threading.Timer(8, lambda: None)
    try:
        late.start()
        ctrl_c.start()
        with pytest.raises(KeyboardInterrupt):
            _run_and_wait(60_000_000, woken)
        assert late.is_alive(), "the wait behind the kernel went on to its end"
    finally:
        late.cancel()
        ctrl_c.join()
        signal.signal(signal.SIGINT, before)


def _run_and_wait(n, woken):
    _long(n)
    woken.wait(10)  # the signal is sent again a moment after the kernel, and wakes up what waits for a lock


@pytest.mark.skipif(os.name == "nt", reason="the signal is one of POSIX")
def test_what_nohup_asks_for_holds(tmp_path):
    code = ("import signal, sys; signal.signal(signal.SIGHUP, signal.SIG_IGN); sys.argv[1:] = ['--version']\n"
            "from windmark.app.cli import main\ntry:\n    main()\nexcept SystemExit:\n    "
            "print(signal.getsignal(signal.SIGHUP) == signal.SIG_IGN)")  # fmt: skip
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.splitlines()[-1] == "True"


@pytest.mark.skipif(os.name == "nt", reason="pipes end in another way on Windows")
@pytest.mark.parametrize("arguments", [["--version"], ["laws"], ["laws", "--json"]])
def test_a_reader_that_has_had_enough_is_no_failure(arguments):
    """``windmark laws | head -1`` ended with code 1, which says that the data say no."""
    reads, writes = os.pipe()
    os.close(reads)
    done = subprocess.run([*WINDMARK, *arguments], stdout=writes, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writes)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(os.name == "nt", reason="streams are closed by a shell of POSIX")
@pytest.mark.parametrize("closed", ["1>&-", "2>&-", "0<&- 1>&- 2>&-"])
def test_closed_streams_lead_to_nowhere(tmp_path, closed):
    """The next file that was opened took their number, and what a library prints went into it."""
    code = ("import os, sys; sys.argv[1:] = ['--version']\nfrom windmark.app.cli import main\ntry:\n    main()\n"
            "except SystemExit as end:\n    with open(r'%s', 'w') as stream:\n        "
            "print(stream.fileno() > 2, end.code, file=stream)" % (tmp_path / "out.txt"))  # fmt: skip
    command = subprocess.list2cmdline([sys.executable, "-c"]) + ' "$CODE" ' + closed
    done = subprocess.run(["sh", "-c", command], env={**os.environ, "CODE": code}, capture_output=True, check=False)
    assert done.returncode == 0
    assert (tmp_path / "out.txt").read_text() == "True 0\n"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="the system has no /dev/full")
def test_a_narration_that_nobody_can_read_does_not_end_the_run(monkeypatch, capsys):
    with open("/dev/full", "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        tell = console.Narration()
        for k in range(3):
            tell(f"frame {k}")
        monkeypatch.undo()
        with contextlib.suppress(OSError):
            full.close()
    said = capsys.readouterr().err
    assert said == "windmark: standard output: cannot be written: the disk is full; the run goes on without it\n"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="the system has no /dev/full")
@pytest.mark.parametrize("arguments", [["--version"], ["laws", "--json"]])
def test_a_full_standard_output_is_said(arguments):
    with open("/dev/full", "w") as full:
        done = subprocess.run([*WINDMARK, *arguments], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == "windmark: standard output: cannot be written: the disk is full"
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
