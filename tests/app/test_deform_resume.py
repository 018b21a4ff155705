"""`windmark deform` stopped at any moment: what was measured is readable, and goes on to the same bytes."""

import csv
import errno
import functools
import os
import re
import shutil
import signal
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray
from killing import in_child, killed_at
from test_deform_verb import SECOND, without_values

from windmark import io
from windmark.app import deform_verb
from windmark.io.journal import AppendedFile
from windmark.pipeline import resume
from windmark.pipeline.deform import outputs
from windmark.pipeline.journal_values import loaded
from windmark.pipeline.resume import JOURNAL, STATE, TITLE, measured

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("all_undrawn")]  # whole series, stopped and gone on with

FRAMES = 6
FEW = 3
TABLES = ("cameras.csv", "span.csv", "markers.csv", "points-taps.csv", "units.json", "deformation.gif")


@pytest.fixture(scope="module")
def of_two(bending, tmp_path_factory):
    """By two cameras, with grids and their values of every third frame: some behind the one at which a run ends."""
    folder = bending(FRAMES, tmp_path_factory.mktemp("resume"))
    text = (folder / "deform.toml").read_text()
    for usual, here in (("every = 1\n", "every = 3\n"), ('zero = ["0", "1"]', 'zero = ["0"]')):
        assert usual in text
        text = text.replace(usual, here)
    (folder / "deform.toml").write_text(text)
    return folder


@pytest.fixture(scope="module")
def made(of_two, tmp_path_factory):
    """The same by one of them and without grids: what is kept and told does not depend on these, and takes a third
    of the time.
    """
    folder = tmp_path_factory.mktemp("one") / "test"
    shutil.copytree(of_two, folder, ignore=shutil.ignore_patterns("cam2*", "whole"))
    text = (folder / "deform.toml").read_text()
    assert SECOND in text
    (folder / "deform.toml").write_text(text.replace(SECOND, ""))
    without_values(folder)
    return folder


@pytest.fixture
def first_pictures(made, tmp_path):
    """The pictures of the first frames, where a live run need not measure them all."""
    place = tmp_path / "incoming"
    place.mkdir()
    for k in range(FEW):
        for picture in (made / "images").glob(f"*-{k:04d}.tif"):
            shutil.copy(picture, place)
    return place


@pytest.fixture(scope="module")
def whole(made, windmark):
    """Results of a run that nobody disturbed."""
    assert windmark("deform", made / "deform.toml", "-o", made / "whole").code == 0
    return made / "whole"


def rows(path):
    with open(path, newline="") as stream:
        return list(csv.DictReader(stream))


def without_seconds(path):
    """The table but for wall times, which no two runs have the same."""
    return [{k: v for k, v in row.items() if k != "seconds"} for row in rows(path)]


def series(path):
    """Type, shape, bytes and attributes of every variable but the seconds, as they stand in the file."""
    with h5py.File(path) as file:
        found = {name: (v.dtype, v.shape, v[()].tobytes(), {k: str(v.attrs[k]) for k in v.attrs})
                 for name, v in file.items() if name != "seconds"}  # fmt: skip
    assert not any(dtype.hasobject for dtype, *_ in found.values())  # their bytes would be addresses
    return found


def assert_same(one, other):
    for name in TABLES:
        assert (one / name).read_bytes() == (other / name).read_bytes(), name
    assert without_seconds(one / "deformation.csv") == without_seconds(other / "deformation.csv")
    for file in (one / "grid").glob("*"):
        assert file.read_bytes() == (other / "grid" / file.name).read_bytes(), file.name
    shown = [re.findall("What the cameras saw: [^<]*", (out / "report.html").read_text(encoding="utf-8"))
             for out in (one, other)]  # fmt: skip
    assert shown[0] == shown[1] != []  # the first frame and the worst, also where they were measured before the stop
    a, b = series(one / "deformation.nc"), series(other / "deformation.nc")
    assert a.keys() == b.keys()
    assert [name for name in a if a[name] != b[name]] == []
    assert {f.name for f in one.iterdir()} == {f.name for f in other.iterdir()}


def assert_readable(folder):
    """Every frame of the journal is whole in the tables; the series opens."""
    count = measured(folder)
    table = rows(folder / "deformation.csv")
    assert len(table) >= count
    assert all(len(row) == len(table[0]) and None not in row.values() for row in table[:count])
    with xarray.open_dataset(folder / "deformation.nc") as found:
        assert found.sizes["frame"] <= count
    return count


def test_killed_twice_and_resumed_is_the_same_as_undisturbed(of_two, windmark, tmp_path_factory, tmp_path):
    """SIGKILL: the folder was a hidden one with a NetCDF file that nothing could open, and no verb went on."""
    whole, out = tmp_path_factory.mktemp("undisturbed") / "out", tmp_path / "out"
    assert windmark("deform", of_two / "deform.toml", "-o", whole).code == 0
    beside = tmp_path / ".windmark-out" / "new"
    for frames, more in ((1, ()), (4, ("--resume",))):
        killed_at(beside, frames, lambda more=more: windmark("deform", of_two / "deform.toml", "-o", out, *more))
        assert not out.exists()
        assert frames <= assert_readable(beside) < FRAMES
    done = windmark("deform", of_two / "deform.toml", "-o", out, "--resume")
    assert done.code == 0, done.err
    assert_same(whole, out)
    assert len([*(out / "grid").iterdir()]) == FRAMES / 3
    assert [p.name for p in tmp_path.iterdir()] == ["out"]  # nothing is left beside it, hidden or not


def test_killed_before_the_first_frame_has_handed_anything_on(made, whole, windmark, tmp_path):
    """Its record is in the journal and its state is not: the run begins with it again."""
    out = tmp_path / "out"
    real = resume.replaced_file

    def killed(folder, name, content):
        if name == STATE and int.from_bytes(content[:8], "little") == 1:
            os._exit(9)
        real(folder, name, content)

    def run():
        resume.replaced_file = killed
        windmark("deform", made / "deform.toml", "-o", out)

    os.waitpid(in_child(run), 0)
    assert measured(tmp_path / ".windmark-out" / "new") == 1
    done = windmark("deform", made / "deform.toml", "-o", out, "--resume")
    assert done.code == 0, done.err
    assert_same(whole, out)


def test_interrupted_between_tables_and_journal(made, whole, windmark, tmp_path):
    """The frame is in all of them or in none: the interrupt waits until it is. Once before the state, once behind."""
    out = tmp_path / "out"
    real = resume.replaced_file

    def run(at, when, *more):
        def interrupted(folder, name, content):
            here = name == STATE and int.from_bytes(content[:8], "little") == at
            if here and when == "before":
                os.kill(os.getpid(), signal.SIGINT)
            real(folder, name, content)
            if here and when == "after":
                os.kill(os.getpid(), signal.SIGINT)

        resume.replaced_file = interrupted
        windmark("deform", made / "deform.toml", "-o", out, *more)

    for at, when, more in ((2, "before", ()), (4, "after", ("--resume",))):
        os.waitpid(in_child(functools.partial(run, at, when, *more)), 0)
        assert measured(tmp_path / ".windmark-out" / "new") == at
    done = windmark("deform", made / "deform.toml", "-o", out, "--resume")
    assert done.code == 0, done.err
    assert_same(whole, out)


def test_finish_makes_results_of_what_was_measured(made, whole, windmark, tmp_path):
    out, beside = tmp_path / "out", tmp_path / ".windmark-out" / "new"
    killed_at(beside, 4, lambda: windmark("deform", made / "deform.toml", "-o", out))
    count = measured(beside)
    done = windmark("deform", made / "deform.toml", "-o", out, "--finish", "--json")
    assert (done.code, done.json["frames"]) == (0, count)
    assert without_seconds(out / "deformation.csv") == without_seconds(whole / "deformation.csv")[:count]
    assert (out / "report.html").exists()
    assert not beside.exists()


def test_stopped_between_the_tables_and_the_journal(made, whole, windmark, tmp_path):
    """A state one frame behind its journal, half a record, half a row: the run goes on from the last whole frame."""
    out, beside = tmp_path / "out", tmp_path / ".windmark-out" / "new"
    killed_at(beside, 3, lambda: windmark("deform", made / "deform.toml", "-o", out))
    state = (beside / STATE).read_bytes()
    killed_at(beside, measured(beside) + 1, lambda: windmark("deform", made / "deform.toml", "-o", out, "--resume"))
    (beside / STATE).write_bytes(state)
    with open(beside / JOURNAL, "ab") as stream:
        stream.write(b"\x40\0\0\0\0\0\0\0half")
    with open(beside / "markers.csv", "ab") as stream:
        stream.write(b"7,W0")
    ahead = measured(beside) - int.from_bytes(state[:8], "little")
    done = windmark("deform", made / "deform.toml", "-o", out, "--resume")
    if ahead == 1:
        assert done.code == 0, done.err
        assert_same(whole, out)
    else:
        assert done.code == 2
        assert "--finish keeps what it has measured" in done.err


def test_what_has_changed_since_is_named(made, windmark, tmp_path):
    copy = tmp_path / "test"
    shutil.copytree(made, copy, ignore=shutil.ignore_patterns("whole*", "deformation*"))
    project, beside = copy / "deform.toml", copy / ".windmark-deformation" / "new"
    markers, image, later = copy / "markers.csv", *(copy / "images" / f"cam1-000{k}.tif" for k in (1, 5))
    project.write_text(project.read_text().replace('zero = ["0"]', 'zero = ["0", "5"]'))
    killed_at(beside, 3, lambda: windmark("deform", project))
    text = project.read_text()
    for change, expected in (
        (lambda: project.write_text(text.replace("radius_px = 2.5", "radius_px = 2.6")), "[look] of the project"),
        (lambda: markers.write_text(markers.read_text() + "\n"), "markers.file"),
        (lambda: io.write_image(image, np.ones((400, 640), np.uint16)), "frame 1 have changed"),
        # Not measured yet: the frames before it had another zero than those behind.
        (lambda: shutil.copyfile(image, later), "a picture of the wind-off frame 5 has changed"),
    ):
        kept = {f: f.read_bytes() for f in (project, markers, image, later)}
        change()
        done = windmark("deform", project, "--resume")
        assert done.code == 2
        assert expected in done.err, done.err
        assert measured(beside) >= 3  # and is still there
        for file, content in kept.items():
            file.write_bytes(content)
    assert windmark("deform", project, "--resume").code == 0


def test_a_table_that_somebody_has_saved_is_not_gone_on_with(made, windmark, tmp_path):
    """By a spreadsheet, with its own signs between the cells: rows of two kinds stood in one table.

    What the run that was killed had begun to add behind its last frame may be lost, so all of the table goes.
    """
    out, beside = tmp_path / "out", tmp_path / ".windmark-out" / "new"
    killed_at(beside, 2, lambda: windmark("deform", made / "deform.toml", "-o", out))
    for name, option, saved in (
        ("deformation.csv", "--resume", lambda content: content.replace(b",", b";")),
        ("deformation.csv", "--finish", lambda content: content.replace(b"\n", b"\r\n")),
        ("points-taps.csv", "--resume", lambda content: b""),
    ):
        content = (beside / name).read_bytes()
        (beside / name).write_bytes(saved(content))
        done = windmark("deform", made / "deform.toml", "-o", out, option)
        assert done.code == 2
        assert f"{name}: was changed since the run was stopped" in done.err
        (beside / name).write_bytes(content)
    assert windmark("deform", made / "deform.toml", "-o", out, "--resume").code == 0


def test_nothing_to_go_on_with(made, windmark, tmp_path):
    for option in ("--resume", "--finish"):
        done = windmark("deform", made / "deform.toml", "-o", tmp_path / "none", option)
        assert done.code == 2
        assert "no run that was stopped" in done.err
        assert list(tmp_path.iterdir()) == []


def test_begun_anew_says_what_is_dropped(made, windmark, tmp_path):
    out, beside = tmp_path / "out", tmp_path / ".windmark-out" / "new"
    killed_at(beside, 2, lambda: windmark("deform", made / "deform.toml", "-o", out))
    done = windmark("deform", made / "deform.toml", "-o", out)
    assert done.code == 0
    assert "was left by a run that was killed; removed" in done.err
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_full_disk_is_told_and_keeps_what_is_written(made, whole, windmark, tmp_path, monkeypatch):
    """A write to a file finds the disk full, and takes half of it: to a table, gone on with, to the journal, again."""
    out, beside = tmp_path / "out", tmp_path / ".windmark-out" / "new"
    append = AppendedFile.append
    for file, at, frames, more in (
        ("markers.csv", 3, 1, ()),  # behind its head and the first frame
        ("journal", 2, 2, ("--resume",)),
        ("new", 3, 3, ("--resume",)),  # behind the series and the third frame's state
    ):
        count = {"n": 0}

        def full(self, content, file=file, at=at, count=count):
            if file == self.path.name:
                count["n"] += 1
                if count["n"] == at:
                    os.write(self._file.fileno(), content[: len(content) // 2])
                    self.take_back(self.size)
                    raise io.FileError(self.path, "cannot be written: the disk is full")
            append(self, content)

        with monkeypatch.context() as patch:
            patch.setattr(AppendedFile, "append", full)
            done = windmark("deform", made / "deform.toml", "-o", out, *more)
        assert done.code == 2
        assert "the disk is full" in done.err
        kept = re.search(r"(\d+) frames are kept: --resume goes on with them, --finish makes do with them", done.err)
        assert kept is not None, done.err
        assert assert_readable(beside) == int(kept.group(1)) == len(rows(beside / "deformation.csv")) == frames
    assert windmark("deform", made / "deform.toml", "-o", out, "--resume").code == 0
    assert_same(whole, out)


def test_a_series_that_somebody_looks_at_is_written_later(made, whole, windmark, tmp_path, monkeypatch):
    """Windows does not replace an open file: the run ended there, with all frames still to come."""
    replace, refused = os.replace, []

    def held(source, target, *rest):
        if Path(target).name == "deformation.nc" and Path(target).exists() and len(refused) < 2:
            refused.append(len(rows(Path(target).with_name("deformation.csv"))))
            raise PermissionError(errno.EACCES, "The process cannot access the file", str(target))
        replace(source, target, *rest)

    monkeypatch.setattr(outputs, "CHUNK", 2)
    monkeypatch.setattr(os, "replace", held)
    done = windmark("deform", made / "deform.toml", "-o", tmp_path / "out")
    monkeypatch.undo()
    assert done.code == 0, done.err
    assert refused == [2, 4]
    assert_same(whole, tmp_path / "out")


def test_a_disk_that_is_really_full(made, windmark, tmp_path, monkeypatch):
    """A limit on the size of files, below what the journal needs: the system refuses within a write.

    What all frames say together, which is large from the first one on and does not grow, is left out for it.
    """
    import resource

    from windmark.tasks.deform.series import Series

    out, beside = tmp_path / "out", tmp_path / ".windmark-out" / "new"
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

    def limited():
        resource.setrlimit(resource.RLIMIT_FSIZE, (190_000, 190_000))
        monkeypatch.setattr(Series, "of", lambda _: None)  # in the child alone
        done = windmark("deform", made / "deform.toml", "-o", out)
        (tmp_path / "said").write_bytes(b"")
        os.write(os.open(tmp_path / "said", os.O_WRONLY), done.err[:4000].encode())

    os.waitpid(in_child(limited), 0)
    said = (tmp_path / "said").read_text()
    assert "larger than is allowed" in said
    assert "frames are kept" in said
    count = assert_readable(beside)
    assert 0 < count == len(rows(beside / "deformation.csv")) < FRAMES
    assert windmark("deform", made / "deform.toml", "-o", out, "--resume").code == 0


@pytest.mark.parametrize("live", [False, True])
def test_a_disk_that_is_full_when_the_report_is_drawn_keeps_the_frames(
    made, windmark, tmp_path, monkeypatch, live, first_pictures
):
    """That they are kept was not said, and the next live run refused them."""
    out, images = tmp_path / "out", ("--watch", first_pictures, "--idle", 0.5)
    command = ["deform", made / "deform.toml", "-o", out, *(images if live else ())]
    frames = FEW if live else FRAMES

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(deform_verb, "deform_page", full)
        done = windmark(*command)
    assert done.code == 2
    assert "the disk is full" in done.err
    assert f"{frames} frames are kept: --resume goes on with them" in done.err
    done = windmark(*command, "--resume", "--json")
    assert (done.code, done.json["frames"]) == (0, frames)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["incoming", "out"]


def test_a_disk_that_is_full_before_the_first_frame_leaves_nothing_hidden(
    made, windmark, tmp_path, monkeypatch, first_pictures
):
    """A watched run writes into its folder itself: a journal without a frame stayed there."""
    out = tmp_path / "out"

    def full(*_, **__):
        raise io.FileError(out / "deformation.csv", "cannot be written: the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(outputs.Writer, "add", full)
        done = windmark("deform", made / "deform.toml", "-o", out, "--watch", first_pictures, "--idle", 0.5)
    assert done.code == 2
    assert "the disk is full" in done.err
    assert "are kept" not in done.err
    assert not list(out.rglob(".*"))
    again = ("deform", made / "deform.toml", "-o", out, "--watch", first_pictures, "--idle", 0.5)
    assert windmark(*again, "--resume", "--json").json["frames"] == FEW


def test_a_journal_makes_nothing_but_values():
    """Unpickling calls no function, whatever a journal asks for."""
    import pickle

    class Evil:
        def __reduce__(self):
            return os.mkdir, ("/tmp/never",)

    class Opens:
        def __reduce__(self):
            return AppendedFile, (Path("/tmp/never"),)

    for value in (Evil(), Opens(), print):
        with pytest.raises(pickle.UnpicklingError, match="no place in a journal"):
            loaded(pickle.dumps(value), {})
    assert not Path("/tmp/never").exists()
    assert TITLE.isascii()
