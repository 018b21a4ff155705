"""`windmark deform --watch` ended on the way: by a kill, after which it goes on, or by a signal, as is meant to be."""

import csv
import json
import os
import shutil
import signal
from collections import Counter

import pytest
from killing import in_child, killed_at
from test_deform_verb import without_grids

from windmark import io
from windmark.app import series_folder
from windmark.io.manifest import CHANGED
from windmark.pipeline import resume
from windmark.pipeline.deform import run as deform_run
from windmark.pipeline.resume import measured

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("all_undrawn")]  # whole live runs, ended in many ways

FRAMES = 6
WITH_TIMES = ("deformation.csv", "deformation.nc", "report.html", "summary.json", "manifest.json")


@pytest.fixture(scope="module")
def of_grids(bending, tmp_path_factory):
    folder = bending(FRAMES, tmp_path_factory.mktemp("live"))
    text = (folder / "deform.toml").read_text()
    assert 'zero = ["0", "1"]' in text
    (folder / "deform.toml").write_text(text.replace('zero = ["0", "1"]', 'zero = ["0"]'))  # each costs as three others
    return folder


@pytest.fixture(scope="module")
def made(of_grids, tmp_path_factory):
    """The same without grids, their values and points, where no file of these is asked for: half of a frame's time."""
    folder = shutil.copytree(of_grids, tmp_path_factory.mktemp("few") / "test")
    without_grids(folder)
    return folder


@pytest.fixture(scope="module")
def whole(made, windmark):
    """Results of a live run that nobody disturbed."""
    assert windmark(*command(made, made / "whole")).code == 0
    return made / "whole"


def command(made, out):
    return "deform", made / "deform.toml", "-o", out, "--watch", made / "images", "--idle", 0.5


def untimed(path):
    with open(path, newline="") as stream:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(stream)]


def test_killed_amid_its_frames_and_resumed_it_is_the_same_as_undisturbed(of_grids, windmark, tmp_path):
    """Bytes of every table, also of what became of every file; the manifest named the run's own journal as an input."""
    whole, out = tmp_path / "whole", tmp_path / "out"
    assert windmark(*command(of_grids, whole)).code == 0
    killed_at(out, 3, lambda: windmark(*command(of_grids, out)))
    assert 3 <= measured(out) < FRAMES
    done = windmark(*command(of_grids, out), "--resume")
    assert done.code == 0, done.err
    files = {p.relative_to(whole) for p in whole.rglob("*") if p.is_file()}
    assert {p.relative_to(out) for p in out.rglob("*") if p.is_file()} == files
    for name in files:
        if name.name not in WITH_TIMES:
            assert (out / name).read_bytes() == (whole / name).read_bytes(), name
    assert untimed(out / "deformation.csv") == untimed(whole / "deformation.csv")
    first, second = (json.loads((folder / "manifest.json").read_text()) for folder in (out, whole))
    assert [i["sha256"] for i in first["inputs"]] == [i["sha256"] for i in second["inputs"]]
    assert not [i for i in first["inputs"] if ".windmark" in i["file"] or i["file"] in first["outputs"]]


def test_the_pictures_of_the_frames_before_it_was_killed_are_inputs_too(made, windmark, tmp_path):
    """The manifest had those that came later only, and one that had been replaced since was not told of."""
    out, incoming = tmp_path / "out", tmp_path / "incoming"
    shutil.copytree(made / "images", incoming)
    arguments = ("deform", made / "deform.toml", "-o", out, "--watch", incoming, "--idle", 0.5)
    killed_at(out, 3, lambda: windmark(*arguments))
    shutil.copyfile(incoming / "cam1-0004.tif", incoming / "cam1-0001.tif")
    done = windmark(*arguments, "--resume")
    assert done.code == 0, done.err
    inputs = json.loads((out / "manifest.json").read_text())["inputs"]
    pictures = {entry["file"].rpartition("/")[2]: entry for entry in inputs if "incoming" in entry["file"]}
    assert set(pictures) == {path.name for path in incoming.iterdir()}
    assert [name for name, entry in pictures.items() if entry.get(CHANGED)] == ["cam1-0001.tif"]
    assert "1 files changed after they had been read: measured is what was in them then: cam1-0001.tif" in done.out


def test_killed_when_it_was_to_end_and_resumed_what_was_left_is_measured(made, whole, windmark, tmp_path):
    """Ctrl-C twice, or a queue that does not wait: --resume kept frames as left whose pictures were there."""
    out = tmp_path / "out"

    def killed(*_):
        os._exit(9)

    def run():
        signal.signal(signal.SIGINT, signal.default_int_handler)
        deform_run.write_grid_series = killed
        windmark(*command(made, out))

    killed_at(out, 3, run, signal.SIGINT)
    assert measured(out) == FRAMES
    statuses = [row["status"] for row in untimed(out / "deformation.csv")]
    assert statuses[-1] == "left"
    assert statuses[0] != "left"
    done = windmark(*command(made, out), "--resume")
    assert done.code == 0, done.err
    for name in ("cameras.csv", "markers.csv", "span.csv", "arrivals.csv"):
        assert (out / name).read_bytes() == (whole / name).read_bytes(), name
    assert untimed(out / "deformation.csv") == untimed(whole / "deformation.csv")


def test_who_begins_a_second_run_is_not_told_to_resume_the_first(made, windmark, tmp_path):
    """"holds 2 frames of a run that was stopped; --resume goes on with them": that run was at work."""
    out = tmp_path / "out"
    killed_at(out, 2, lambda: windmark(*command(made, out)))
    with io.result_folder(out, live=True, resume=True):
        done = windmark(*command(made, out))
    assert done.code == 2
    assert "another run writes into this folder" in done.err


@pytest.mark.parametrize("signalled", [signal.SIGINT, signal.SIGTERM])
def test_ended_by_a_signal_its_first_frames_are_those_of_a_whole_run(made, whole, windmark, tmp_path, signalled):
    out = tmp_path / "out"

    def run():
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # as `main` has it
        signal.signal(signal.SIGINT, signal.default_int_handler)
        (tmp_path / "code").write_text(str(windmark(*command(made, out)).code))

    killed_at(out, 3, run, signalled)
    assert (tmp_path / "code").read_text() == "0"
    rows, usual = untimed(out / "deformation.csv"), untimed(whole / "deformation.csv")
    done = [row["frame"] for row in rows if row["status"] != "left"]
    assert 2 <= len(done) < FRAMES  # the one at hand may be taken back
    assert rows[: len(done)] == usual[: len(done)]
    assert all(row["reason"] == "the run was ended before it was measured" for row in rows[len(done) :])
    for name in ("cameras.csv", "markers.csv", "span.csv", "arrivals.csv"):
        mine, theirs = ([r for r in untimed(folder / name) if r["frame"] in done] for folder in (out, whole))
        assert mine == theirs, name
    assert not (out / resume.HIDDEN).exists()
    files = untimed(out / "arrivals.csv")
    assert {row["frame"] for row in files} <= {row["frame"] for row in rows}
    # Those of frames that were left were counted as measured.
    assert all((row["fate"] == "measured") == (row["frame"] in done) for row in files)
    counts = json.loads((out / "summary.json").read_text())["files"]
    assert counts == Counter(row["fate"] for row in files)


def test_a_live_run_killed_behind_its_manifest_is_a_whole_result(made, windmark, tmp_path):
    """Its journal stayed: the next live run was refused for frames that were all in the result."""
    out, few = tmp_path / "out", tmp_path / "incoming"
    shutil.copytree(made / "images", few, ignore=shutil.ignore_patterns("*-000[2-9].tif"))
    asked = ("deform", made / "deform.toml", "-o", out, "--watch", few, "--idle", 0.5)

    def killed(folder):
        if series_folder.came_to_its_end(folder):
            os._exit(9)

    def run():
        series_folder.clear = killed
        windmark(*asked)

    os.waitpid(in_child(run), 0)
    assert measured(out) == 2
    content = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    done = windmark(*asked, "--resume")
    assert done.code == 2
    assert "came to its end" in done.err
    assert {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()} == content
    assert windmark(*asked).code == 0
    assert not (out / resume.HIDDEN).exists()
