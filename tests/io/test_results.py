"""A folder of results holds the files of one run, whatever stands in it and whatever ends the run."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from children import ended

from windmark.io import FileError, result_folder, staging
from windmark.io import exchange as moves
from windmark.io import results as module
from windmark.io.text import read_text


def names(folder):
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if not p.is_dir())


def fill(folder, files, *, refused=False, keep=False, say=lambda _: None, then=lambda: None, **more):
    with result_folder(folder, {"verb": "test"}, say=say, **more) as out:
        for name, text in files.items():
            (out.place / name).parent.mkdir(parents=True, exist_ok=True)
            (out.place / name).write_text(text)
        out.refused, out.keep = refused, keep
        then()


def throw(error):
    raise error


def read(folder):
    return {name: (folder / name).read_text() for name in names(folder) if not name.endswith("manifest.json")}


@pytest.fixture(params=["swap", "moves", "inside"])
def out(request, tmp_path, monkeypatch):
    """A target, in each of the ways a result can be put into it."""
    target = tmp_path / "out"
    if request.param == "moves":
        monkeypatch.setattr(moves, "_rename_exchange", lambda a, b: False)
    if request.param == "inside":  # a mount point: nothing that stands beside it can be moved into it
        target.mkdir()
        real = os.replace

        def on_another_disk(source, place, *rest):
            inside = [Path(p).is_relative_to(target) for p in (source, place)]
            if inside[0] != inside[1]:
                raise OSError(errno.EXDEV, "Invalid cross-device link", str(source), None, str(place))
            return real(source, place, *rest)

        monkeypatch.setattr(os, "replace", on_another_disk)
        monkeypatch.setattr(os, "rename", on_another_disk)
    return target


def test_the_folder_holds_exactly_the_files_of_one_run(out):
    fill(out, {"a.csv": "1", "cam/b.csv": "1", "cam/deep/c.csv": "1"})
    fill(out, {"a.csv": "2", "d.csv": "2"})
    assert read(out) == {"a.csv": "2", "d.csv": "2"}
    assert sorted(p.name for p in out.iterdir()) == ["a.csv", "d.csv", "manifest.json"]
    assert [p.name for p in out.parent.iterdir()] == ["out"]


def test_what_others_wrote_stays(out):
    fill(out, {"a.csv": "1", "cam/b.csv": "1"})
    (out / "notes.txt").write_text("mine")
    (out / "cam" / "mine.txt").write_text("mine")
    (out / "link").symlink_to(out.parent)
    fill(out, {"a.csv": "2"})
    assert read(out) == {"a.csv": "2", "notes.txt": "mine", "cam/mine.txt": "mine"} | (
        {"link": ""} if (out / "link").is_file() else {}
    )
    assert (out / "link").is_symlink()


def test_what_was_changed_or_stands_in_the_way_is_kept_and_said(out):
    said = []
    fill(out, {"a.csv": "1", "b.csv": "1"})
    (out / "b.csv").write_text("edited")
    (out / "c.csv").write_text("mine")
    fill(out, {"a.csv": "2", "b.csv": "2", "c.csv": "2"}, say=said.append)
    kept = next(iter([*out.parent.glob("out.kept-1"), *out.glob("kept-1")]))
    assert read(kept) == {"b.csv": "edited", "c.csv": "mine"}
    assert {name: text for name, text in read(out).items() if "kept" not in name} == {
        "a.csv": "2", "b.csv": "2", "c.csv": "2",
    }  # fmt: skip
    assert len(said) == 1
    assert "b.csv, c.csv" in said[0]
    assert str(kept) in said[0]


def test_a_refused_run_keeps_the_good_result_apart(out):
    fill(out, {"report.html": "good", "cam/nodes.csv": "good"})
    for _ in range(2):  # the second refusal replaces the first one
        fill(out, {"report.html": "no"}, refused=True)
    kept = [*out.parent.glob("out.kept-*"), *out.glob("kept-*")]
    assert [read(k) for k in kept] == [{"report.html": "good", "cam/nodes.csv": "good"}]
    assert {n: t for n, t in read(out).items() if "kept" not in n} == {"report.html": "no"}


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError, SystemExit])
def test_any_exception_leaves_the_old_result(out, error):
    fill(out, {"a.csv": "1"})
    before = (out / "manifest.json").read_bytes()
    with pytest.raises(error):
        fill(out, {"a.csv": "2"}, then=lambda: throw(error))
    assert read(out) == {"a.csv": "1"}
    assert (out / "manifest.json").read_bytes() == before
    assert [p.name for p in out.parent.iterdir()] == ["out"]


def test_the_manifest_is_the_same_for_the_same_result(tmp_path):
    source = tmp_path / "input.csv"
    source.write_text("x")
    written = []
    for _ in range(2):
        with result_folder(tmp_path / "out", {"verb": "test", "options": {"seed": 1}}) as out:
            read_text(source)
            (out.place / "a.csv").write_text("1")
        written.append((tmp_path / "out" / "manifest.json").read_text())
    assert written[0] == written[1]
    found = json.loads(written[0])
    digest = "6b86b273ff34fce19d6b804eff5a3f5747ada4eaa22f1d49c01e52ddb7875b4b"  # of the text "1"
    assert found["outputs"] == {"a.csv": digest}
    assert [(i["file"], i["bytes"]) for i in found["inputs"]] == [("../input.csv", 1)]
    assert (found["verb"], found["options"], found["refused"]) == ("test", {"seed": 1}, False)
    assert {"python", "numpy", "windmark"} <= set(found["versions"])


@pytest.mark.parametrize("live", [False, True])
def test_an_input_that_was_edited_while_the_run_was_at_work_is_said(tmp_path, live):
    """The manifest had the hash of a project that was never read."""
    said = []
    for name in ("project.toml", "markers.csv"):
        (tmp_path / name).write_text("before")
    with result_folder(tmp_path / "out", live=live, say=said.append) as out:
        (out.place / "a.csv").write_text(read_text(tmp_path / "project.toml") + read_text(tmp_path / "markers.csv"))
        (tmp_path / "project.toml").write_text("edited")
        os.utime(tmp_path / "project.toml", (1, 1))
    inputs = {entry["file"]: entry for entry in json.loads((tmp_path / "out" / "manifest.json").read_text())["inputs"]}
    assert [name for name, entry in inputs.items() if entry.get("changed_since_read")] == ["../project.toml"]
    words = "was changed after it had been read: the result is of what was in it then"
    assert said == [f"{tmp_path / 'project.toml'}: {words}"]


def test_moves_that_fail_are_taken_back(tmp_path, monkeypatch):
    out = tmp_path / "out"
    fill(out, {"a": "1", "b": "1", "c": "1"})
    (out / "notes.txt").write_text("mine")  # so that files are moved one by one
    real = os.replace
    for fails_at in range(1, 20):  # the first one is the trial before the work
        calls = []

        def once(source, place, calls=calls, fails_at=fails_at):
            calls.append(place)
            if len(calls) - 1 == fails_at:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(place))
            real(source, place)

        with monkeypatch.context() as patch:
            patch.setattr(os, "replace", once)
            if fails_at > 11:  # the journal, the manifest, the journal, 4 files away, 4 files in their place
                fill(out, {"a": "2", "b": "2", "d": "2"})
                break
            with pytest.raises(FileError, match="the disk is full"):
                fill(out, {"a": "2", "b": "2", "d": "2"})
        assert read(out) == {"a": "1", "b": "1", "c": "1", "notes.txt": "mine"}
        assert (out / "manifest.json").exists()
        assert [p.name for p in tmp_path.iterdir()] == ["out"]
    assert read(out) == {"a": "2", "b": "2", "d": "2", "notes.txt": "mine"}


def killed_at_move(target, at):
    """A run that is killed before so many moves of files, with 0 before the first."""
    real, calls = moves.replace_file, []

    def replace(source, place):
        calls.append(place)
        if len(calls) == at:
            os.kill(os.getpid(), signal.SIGKILL)
        real(source, place)

    moves.replace_file = replace
    with result_folder(target) as out:
        for name in ("a", "b", "new/d"):
            (out.place / name).parent.mkdir(exist_ok=True)
            (out.place / name).write_text("2")
        if at == 0:
            os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.skipif(os.name == "nt", reason="there is no SIGKILL")
@pytest.mark.parametrize("at", range(12))
def test_a_kill_between_two_moves_is_made_good_by_the_next_run(tmp_path, at):
    out, said = tmp_path / "out", []
    fill(out, {"a": "1", "b": "1", "c": "1"})
    (out / "b").write_text("edited")
    (out / "notes.txt").write_text("mine")
    assert ended(lambda: killed_at_move(out, at)) == (-signal.SIGKILL if at < 11 else 0)
    if at < 2:  # before the manifest was written
        assert read(out) == {"a": "1", "b": "edited", "c": "1", "notes.txt": "mine"}
        assert any((tmp_path / ".windmark-out" / "new").iterdir())
    else:  # whatever was left, all of it or some moves, is done before anything else
        with pytest.raises(RuntimeError):
            fill(out, {"z": "3"}, then=lambda: throw(RuntimeError), say=said.append)
        assert read(out) == {"a": "2", "b": "2", "new/d": "2", "notes.txt": "mine"}
        assert json.loads((out / "manifest.json").read_text())["outputs"].keys() == {"a", "b", "new/d"}
        assert read(tmp_path / "out.kept-1") == {"b": "edited"}
        assert [text for text in said if "this is done now" in text] == said[-1:]
        assert bool(said) == (at < 11)
    fill(out, {"a": "3"}, say=said.append)
    assert at > 1 or "was left by a run that was killed; removed" in said[0]
    assert read(out) == {"a": "3", "notes.txt": "mine"}
    assert not list(tmp_path.rglob(".windmark*"))


def killed_at_exchange(target, at):
    """A run that is killed before folders are exchanged in one step, or after it, where the older one is removed."""
    real = moves._swapped

    def swapped(staging):
        if at == "before":
            os.kill(os.getpid(), signal.SIGKILL)
        assert real(staging)
        (staging.new / "manifest.json").unlink(missing_ok=at == "new")  # its removal has begun
        os.kill(os.getpid(), signal.SIGKILL)

    moves._swapped = swapped
    with result_folder(target) as out:
        for name in ("a", "b"):
            (out.place / name).write_text("2")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="folders are exchanged in one step on Linux")
@pytest.mark.parametrize("resume", [False, True])
@pytest.mark.parametrize("older", [True, False])
@pytest.mark.parametrize("at", ["before", "after"])
def test_a_kill_beside_the_exchange_in_one_step_loses_no_whole_result(tmp_path, at, older, resume):
    """Killed behind its manifest and before the exchange, it was removed by the next run; killed behind the exchange,
    `resume` took what was left of the older result for frames to go on with."""
    out, said = tmp_path / "out", []
    if older:
        fill(out, {"a": "1", "c": "1"})
    when = at if older or at == "before" else "new"
    assert ended(lambda: killed_at_exchange(out, when)) == -signal.SIGKILL
    with contextlib.suppress(RuntimeError), result_folder(out, resume=resume, say=said.append) as made:
        assert not made.resumed
        assert not list(made.place.iterdir())
        raise RuntimeError
    assert read(out) == {"a": "2", "b": "2"}
    assert ["this is done now" in text for text in said] == [True] * (at == "before")
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.skipif(os.name == "nt", reason="there is no SIGKILL")
def test_a_whole_result_that_a_power_failure_cut_is_not_put_in_its_place(tmp_path):
    out, said = tmp_path / "out", []
    fill(out, {"a": "1"})
    assert ended(lambda: killed_at_exchange(out, "before")) == -signal.SIGKILL
    (tmp_path / ".windmark-out" / "new" / "b").write_bytes(b"")
    with pytest.raises(RuntimeError):
        fill(out, {"z": "3"}, then=lambda: throw(RuntimeError), say=said.append)
    assert read(out) == {"a": "1"}
    assert "was left by a run that was killed; removed" in said[0]


def test_what_was_kept_to_be_gone_on_with_is_no_result_of_the_next_run(tmp_path, monkeypatch):
    """The exchange fails; the frames stay and can be gone on with, as the message says."""

    def refused(*_):
        raise FileError(tmp_path / "out", "cannot be written: the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(module, "exchange", refused)
        with pytest.raises(FileError, match="the disk is full"):
            fill(tmp_path / "out", {"series.csv": "1"}, keep=True)
    assert not (tmp_path / "out").exists()
    with result_folder(tmp_path / "out", resume=True) as made:
        assert made.resumed
        assert [p.name for p in made.place.iterdir()] == ["series.csv"]


def test_what_a_killed_run_left_can_be_taken_over(tmp_path):
    out, hidden = tmp_path / "out", tmp_path / ".windmark-out"
    (hidden / "new").mkdir(parents=True)
    (hidden / "new" / "series.csv").write_text("half")
    with result_folder(out, resume=True) as made:
        assert made.resumed
        assert (made.place / "series.csv").read_text() == "half"
    assert read(out) == {"series.csv": "half"}
    with result_folder(out, resume=True) as made:
        assert not made.resumed


# --- two runs, one folder ------------------------------------------------------------------


@pytest.mark.parametrize("place", ["beside", "inside"])
def test_a_second_run_is_refused_at_once(tmp_path, place, monkeypatch):
    out = tmp_path / "out"
    out.mkdir()
    real = staging.hidden_places
    if place == "inside":  # the first run could not write beside the target
        monkeypatch.setattr(staging, "hidden_places", lambda target: real(target)[1:])
    with result_folder(out):
        monkeypatch.setattr(staging, "hidden_places", real)
        with pytest.raises(FileError, match=rf"out: another run writes into this folder \(process {os.getpid()} on "):
            fill(out, {"a": "2"})
    fill(out, {"a": "3"})
    assert read(out) == {"a": "3"}


def test_a_lock_dies_with_its_process(tmp_path):
    code = (
        "import sys, time\nfrom windmark.io import result_folder\n"
        "with result_folder(sys.argv[1]):\n    print('here', flush=True)\n    time.sleep(600)\n"
    )
    held = subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "out")], stdout=subprocess.PIPE)
    try:
        held.stdout.readline()
        with pytest.raises(FileError, match=f"process {held.pid} on"):
            fill(tmp_path / "out", {"a": "1"})
    finally:
        held.kill()
        held.communicate()
    fill(tmp_path / "out", {"a": "1"})
    assert read(tmp_path / "out") == {"a": "1"}
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


# --- live ---------------------------------------------------------------------------------


def test_live_results_grow_in_their_place_and_keep_the_older_one(tmp_path):
    out, said = tmp_path / "out", []
    fill(out, {"a.csv": "1", "b.csv": "1"})
    (out / "notes.txt").write_text("mine")
    with result_folder(out, live=True, say=said.append) as made:
        (made.place / "a.csv").write_text("2")
        assert read(out) == {"a.csv": "2", "notes.txt": "mine"}
    assert read(tmp_path / "out.kept-1") == {"a.csv": "1", "b.csv": "1"}
    assert json.loads((out / "manifest.json").read_text())["outputs"].keys() == {"a.csv"}
    assert "kept in" in said[0]


def test_a_live_run_that_was_killed_is_kept_whole(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    os.utime(out / "notes.txt", (1, 1))
    with pytest.raises(RuntimeError):
        fill(out, {"a.csv": "1"}, live=True, then=lambda: throw(RuntimeError))
    fill(out, {"b.csv": "2"})
    assert read(out) == {"b.csv": "2", "notes.txt": "mine"}
    assert read(tmp_path / "out.kept-1") == {"a.csv": "1"}


@pytest.mark.parametrize(
    ("older", "begun", "stays"),
    [
        (False, False, "nothing was put there"),
        (True, False, "the result that was there is as it was"),
        (True, True, "what is there is unfinished"),
    ],
)
def test_where_a_live_run_finds_the_disk_full_it_is_said_what_is_there(tmp_path, monkeypatch, older, begun, stays):
    """At the beginning the older result was untouched, and nobody said so."""
    out = tmp_path / "out"
    if older:
        fill(out, {"a.csv": "1"})

    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(out))

    def end():
        raise FileError(out / "a.csv", "cannot be written: the disk is full") from OSError(errno.ENOSPC, "full")

    with monkeypatch.context() as patch:
        if not begun:
            patch.setattr(Path, "mkdir", full)
        with pytest.raises(FileError, match=f"the disk is full; .* has .* MB free; {stays}$"):
            fill(out, {"a.csv": "2"}, live=True, then=end)
    if older and not begun:
        assert read(out) == {"a.csv": "1"}


# --- the output is tried before the work ----------------------------------------------------


def refused(path, words):
    with pytest.raises(FileError, match=words), result_folder(path):
        pytest.fail("the work has begun")


def test_outputs_that_can_never_be(tmp_path):
    (tmp_path / "file").write_text("x")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    refused(tmp_path / "file", "this is a file; expected a folder")
    refused(tmp_path / "file" / "out", "a part of its path is a file")
    refused(tmp_path / "loop", "links lead in a circle")
    refused(tmp_path / "loop" / "out", "links lead in a circle")
    refused(tmp_path / ("n" * 300), "the name is too long")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "loop"]
    (tmp_path / "out" / "report.html").mkdir(parents=True)
    refused(tmp_path / "out", r"report\.html: this is a folder, and the result needs a file of this name")
    assert (tmp_path / "out" / "report.html").is_dir()


def test_a_parent_that_cannot_be_written_to(tmp_path, monkeypatch):
    real = Path.mkdir

    def denied(self, *rest, **more):
        if self.parent == tmp_path and not self.exists():  # root may write anywhere
            raise PermissionError(errno.EACCES, "Permission denied", str(self))
        return real(self, *rest, **more)

    (tmp_path / "out").mkdir()
    monkeypatch.setattr(Path, "mkdir", denied)
    refused(tmp_path / "new", "new: cannot be written: permission denied")
    fill(tmp_path / "out", {"a": "1"})  # the folder itself can
    assert read(tmp_path / "out") == {"a": "1"}
    assert not list(tmp_path.rglob(".windmark*"))


def test_folders_made_above_a_result_that_did_not_come_are_removed(tmp_path):
    with pytest.raises(RuntimeError):
        fill(tmp_path / "a" / "b" / "out", {"x": "1"}, then=lambda: throw(RuntimeError))
    assert not list(tmp_path.iterdir())
    fill(tmp_path / "a" / "b" / "out", {"x": "1"})
    assert read(tmp_path / "a" / "b" / "out") == {"x": "1"}


def test_a_full_disk_names_the_folder(tmp_path):
    fill(tmp_path / "out", {"a": "1"})
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with pytest.raises(FileError, match="out: cannot be written: the disk is full"):
        fill(tmp_path / "out", {"a": "2"}, then=lambda: throw(full))
    assert read(tmp_path / "out") == {"a": "1"}


@pytest.mark.parametrize("older", [True, False])
def test_a_full_disk_is_named_and_what_was_there_is_said(tmp_path, older):
    if older:
        fill(tmp_path / "out", {"a": "1"})
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    stays = "the result that was there is as it was" if older else "nothing was put there"
    with pytest.raises(FileError, match=rf"the disk is full; disk /.* has [\d.]+ of [\d.]+ MB free; {stays}$"):
        fill(tmp_path / "out", {"a": "2"}, then=lambda: throw(full))
    with pytest.raises(FileError) as caught:  # no size is told where the disk's space is not the reason
        fill(tmp_path / "out", {"a": "2"}, then=lambda: throw(OSError(errno.EFBIG, "too large")))
    assert caught.value.what == f"cannot be written: the file is larger than is allowed; {stays}"


def test_a_disk_too_full_for_the_name_of_the_process_keeps_nothing_of_ours(tmp_path, monkeypatch):
    """It made the hidden folder, could not write into it, and left it there, in the older result, too."""
    fill(tmp_path / "out", {"a": "1"})
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with monkeypatch.context() as patch:
        for call in ("write", "pwrite"):
            patch.setattr(os, call, lambda *_: throw(full))
        with pytest.raises(FileError, match="the disk is full"):
            fill(tmp_path / "out", {"a": "2"})
    assert read(tmp_path / "out") == {"a": "1"}
    assert not [*tmp_path.rglob(".windmark*")]


def test_a_disk_without_room_for_one_more_file_keeps_no_folder(tmp_path, monkeypatch):
    fill(tmp_path / "out", {"a": "1"})
    opened = os.open

    def full(path, flags, *rest, **more):
        if flags & os.O_CREAT:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        return opened(path, flags, *rest, **more)

    with monkeypatch.context() as patch:
        patch.setattr(os, "open", full)
        with pytest.raises(FileError, match="the disk is full"):
            fill(tmp_path / "out", {"a": "2"})
    assert read(tmp_path / "out") == {"a": "1"}
    assert not [*tmp_path.rglob(".windmark*")]


def test_a_disk_too_full_for_the_trial_keeps_nothing_of_it(tmp_path, monkeypatch):
    """The file that is moved for a trial was made, could not be written, and stayed with its hidden folder."""
    fill(tmp_path / "out", {"a": "1"})
    write = Path.write_bytes

    def full(self, data):
        if self.name == ".windmark-probe":
            self.touch()
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(self, data)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with pytest.raises(FileError, match="the disk is full"):
            fill(tmp_path / "out", {"a": "2"})
    assert read(tmp_path / "out") == {"a": "1"}
    assert not [*tmp_path.rglob(".windmark*")]


def test_an_error_of_the_work_is_not_blamed_on_the_result(tmp_path):
    for error in (OSError("unable to decode"), FileNotFoundError(errno.ENOENT, "no such file", "/input.tif")):
        with pytest.raises(type(error)) as caught:
            fill(tmp_path / "out", {}, then=lambda error=error: throw(error))
        assert caught.value is error


def test_a_fault_of_a_file_names_the_place_where_it_would_be(tmp_path):
    fault = FileError(tmp_path / ".windmark-out" / "new" / "a.csv", "cannot be written: the disk is full")
    with pytest.raises(FileError, match=rf"^{tmp_path}/out/a\.csv: cannot be written: the disk is full$"):
        fill(tmp_path / "out", {}, then=lambda: throw(fault))


def test_what_can_be_gone_on_with_is_kept(tmp_path):
    def half(*, resume):
        with result_folder(tmp_path / "out", resume=resume) as out:
            out.keep = True
            (out.place / "series.csv").write_text("half")
            raise RuntimeError

    for resume in (False, True):
        with pytest.raises(RuntimeError):
            half(resume=resume)
        assert (tmp_path / ".windmark-out" / "new" / "series.csv").read_text() == "half"
    with result_folder(tmp_path / "out", resume=True) as out:
        assert out.resumed
    assert read(tmp_path / "out") == {"series.csv": "half"}
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_live_run_goes_on_in_what_another_one_left(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    os.utime(out / "notes.txt", (1, 1))
    with pytest.raises(RuntimeError):
        fill(out, {"a.csv": "1"}, live=True, then=lambda: throw(RuntimeError))
    with result_folder(out, live=True, resume=True) as made:
        assert made.resumed
        (made.place / "b.csv").write_text("2")
    assert json.loads((out / "manifest.json").read_text())["outputs"].keys() == {"a.csv", "b.csv"}
    with pytest.raises(FileError, match="came to its end"), result_folder(out, live=True, resume=True):
        pass
    assert read(out) == {"a.csv": "1", "b.csv": "2", "notes.txt": "mine"}


def test_a_shell_in_the_target_does_not_end_up_in_a_removed_folder(tmp_path, monkeypatch):
    out = tmp_path / "out"
    fill(out, {"a": "1"})
    monkeypatch.chdir(out)
    inode = out.stat().st_ino
    fill(out, {"a": "2"})
    assert out.stat().st_ino == inode
    assert read(out) == {"a": "2"}


@pytest.mark.skipif(os.name == "nt", reason="signals are sent in another way on Windows")
def test_an_interruption_waits_for_the_exchange(tmp_path, monkeypatch):
    real = module.exchange

    def interrupted(*rest):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)
        real(*rest)

    monkeypatch.setattr(module, "exchange", interrupted)
    with pytest.raises(KeyboardInterrupt, match="had been written whole before"):
        fill(tmp_path / "out", {"a": "1"})
    assert read(tmp_path / "out") == {"a": "1"}
