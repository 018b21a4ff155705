"""`windmark track` stopped at any moment: what was measured goes on to the same bytes, or is made do with."""

import csv
import os
import shutil
import signal

import numpy as np
import pytest
from killing import in_child, killed_at

from windmark import io, synth
from windmark.io.journal import AppendedFile
from windmark.pipeline import resume, same_run, track_series
from windmark.pipeline.resume import STATE, measured

pytestmark = pytest.mark.slow  # whole series, stopped and gone on with

FRAMES = 8
TABLES = ("poses.csv", "matches.csv", "camera.json", "motion.png")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A swinging model; one image shows nothing, one cannot be read."""
    place = tmp_path_factory.mktemp("sequence")
    test = synth.wind_tunnel(4, size_px=(800, 640), nodes=8_000, sensor=None)
    io.write_camera(place / "camera.json", test.cameras["cam1"])
    io.write_markers(place / "markers.csv", test.markers)
    (place / "images").mkdir()
    for k, (image, _) in enumerate(synth.tunnel_sequence(test, synth.swinging(FRAMES), seed=4)):
        io.write_image(place / "images" / f"f{k}.tif", np.zeros_like(image) if k == 3 else image)
    (place / "images" / "f5.tif").write_bytes(b"II*\0half")
    return place


def asked(made, out, *more):
    return ("track", made / "images", "-m", made / "markers.csv", "-c", made / "camera.json", "--unit", "mm", "-o", out,
            *more)  # fmt: skip


@pytest.fixture(scope="module")
def whole(made, windmark):
    """Results of a run that nobody disturbed."""
    assert windmark(*asked(made, made / "whole")).code == 0
    return made / "whole"


def assert_same(one, other):
    for name in TABLES:
        assert (one / name).read_bytes() == (other / name).read_bytes(), name
    assert {f.name for f in one.iterdir()} == {f.name for f in other.iterdir()}
    with_times = ("seconds", "median_seconds", "folder")
    a, b = ({k: v for k, v in io.read_json(f / "summary.json").items() if k not in with_times} for f in (one, other))
    assert a == b
    a, b = (io.read_json(f / "manifest.json") for f in (one, other))
    read = [sorted((os.path.basename(entry["file"]), entry["sha256"]) for entry in m["inputs"]) for m in (a, b)]
    assert read[0] == read[1]  # the first run's pictures, too
    assert a["options"].keys() == b["options"].keys()


def rows(path):
    return list(csv.DictReader(path.read_text().splitlines()))


@pytest.mark.parametrize(("frames", "how"), [(1, signal.SIGKILL), (4, signal.SIGKILL), (6, signal.SIGTERM)])
def test_killed_and_resumed_is_the_same_as_undisturbed(made, whole, windmark, tmp_path, frames, how, monkeypatch):
    out, beside = tmp_path / "out", tmp_path / ".windmark-out" / "new"
    killed_at(beside, frames, lambda: windmark(*asked(made, out)), how)
    assert not out.exists()
    count = measured(beside)
    assert frames <= count < FRAMES
    followed, real = [], track_series.follow

    def counted(images, *arguments, **options):
        for frame in real(images, *arguments, **options):
            followed.append(frame.name)
            yield frame

    monkeypatch.setattr(track_series, "follow", counted)
    done = windmark(*asked(made, out, "--resume"))
    assert done.code == 0, done.err
    assert len(followed) in (FRAMES - count, FRAMES - count + 1)  # none of the first run's is measured again
    assert_same(shutil.copytree(whole, tmp_path / "whole"), out)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out", "whole"]  # nothing is left, hidden or not


def test_stopped_between_the_journal_and_what_is_handed_on(made, whole, windmark, tmp_path):
    """The row of the third image is in the journal and its state is not: the run begins with it again."""
    out, real = tmp_path / "out", resume.replaced_file

    def killed(folder, name, content):
        if name == STATE and int.from_bytes(content[:8], "little") == 3:
            os._exit(9)
        real(folder, name, content)

    def run():
        resume.replaced_file = killed
        windmark(*asked(made, out))

    os.waitpid(in_child(run), 0)
    assert measured(tmp_path / ".windmark-out" / "new") == 3
    done = windmark(*asked(made, out, "--resume"))
    assert done.code == 0, done.err
    assert_same(shutil.copytree(whole, tmp_path / "whole"), out)


def test_interrupted_as_soon_as_the_state_is_in_its_place(made, whole, windmark, tmp_path):
    """The third row is not taken back then: it would leave a state that belongs to no row, and nothing could go on."""
    out, real = tmp_path / "out", resume.replaced_file

    def interrupted(folder, name, content):
        real(folder, name, content)
        if name == STATE and int.from_bytes(content[:8], "little") == 3:
            os.kill(os.getpid(), signal.SIGINT)

    def run():
        resume.replaced_file = interrupted
        windmark(*asked(made, out))

    os.waitpid(in_child(run), 0)
    assert measured(tmp_path / ".windmark-out" / "new") == 3
    done = windmark(*asked(made, out, "--resume"))
    assert done.code == 0, done.err
    assert_same(shutil.copytree(whole, tmp_path / "whole"), out)


def test_finish_makes_results_of_what_was_measured(made, whole, windmark, tmp_path):
    out, beside = tmp_path / "out", tmp_path / ".windmark-out" / "new"
    killed_at(beside, 4, lambda: windmark(*asked(made, out)))
    count = measured(beside)
    done = windmark(*asked(made, out, "--finish", "--json"))
    assert (done.code, done.json["images"]) == (0, count)
    assert rows(out / "poses.csv") == rows(whole / "poses.csv")[:count]
    assert io.read_camera(out / "camera.json")[1] is not None
    assert not beside.exists()


def test_what_has_changed_since_is_named(made, windmark, tmp_path):
    copy, out = tmp_path / "test", tmp_path / "out"
    shutil.copytree(made, copy, ignore=shutil.ignore_patterns("whole*"))
    markers, image, beside = copy / "markers.csv", copy / "images" / "f1.tif", tmp_path / ".windmark-out" / "new"
    killed_at(beside, 3, lambda: windmark(*asked(copy, out)))
    for change, more, expected in (
        (lambda: None, ("--merit-max", 0.6), "--merit-max has changed since"),
        (lambda: None, ("--change-deg", 0.4), "--change-deg has changed since"),
        (lambda: None, ("-r", 2.5), "--radius has changed since"),
        (lambda: markers.write_text(markers.read_text() + "\n"), (), "--markers has changed since"),
        (lambda: io.write_image(image, np.ones((640, 800), np.uint16)), (), "the pictures of frame f1.tif"),
        (lambda: (copy / "images" / "f0.tif").rename(copy / "images" / "f99.tif"), (), "the pictures of frame f0.tif"),
    ):
        kept = {f: f.read_bytes() for f in (markers, image)}
        change()
        done = windmark(*asked(copy, out, "--resume", *more))
        assert (done.code, expected in done.err) == (2, True), done.err
        assert measured(beside) >= 3  # and is still there
        for file, content in kept.items():
            file.write_bytes(content)
    (copy / "images" / "f99.tif").rename(copy / "images" / "f0.tif")
    assert windmark(*asked(copy, out, "--resume")).code == 0


def test_nothing_to_go_on_with(made, windmark, tmp_path):
    for option in ("--resume", "--finish"):
        done = windmark(*asked(made, tmp_path / "none", option))
        assert (done.code, "no run that was stopped" in done.err) == (2, True)
        assert list(tmp_path.iterdir()) == []
    done = windmark(*asked(made, tmp_path / "none", "--resume", "--finish"))
    assert (done.code, "leave out --resume" in done.err) == (2, True)


@pytest.mark.parametrize(("file", "kept"), [("journal", 2), ("new", 3)])
def test_a_full_disk_is_told_and_keeps_what_is_measured(made, whole, windmark, tmp_path, monkeypatch, file, kept):
    """The fifth write to a file finds the disk full, and takes half of it."""
    out, append, count = tmp_path / "out", AppendedFile.append, {"n": 0}

    def full(self, content):
        if file == self.path.name:
            count["n"] += 1
            if count["n"] == 5:
                os.write(self._file.fileno(), content[: len(content) // 2])
                self.take_back(self.size)
                raise io.FileError(self.path, "cannot be written: the disk is full")
        append(self, content)

    monkeypatch.setattr(AppendedFile, "append", full)
    done = windmark(*asked(made, out))
    monkeypatch.undo()
    assert done.code == 2
    assert f"the disk is full; {kept} frames are kept: --resume goes on with them" in done.err
    assert windmark(*asked(made, out, "--resume")).code == 0
    assert_same(shutil.copytree(whole, tmp_path / "whole"), out)


def test_a_series_of_another_verb_is_not_gone_on_with(made, windmark, tmp_path):
    out, beside = tmp_path / "out", tmp_path / ".windmark-out" / "new"
    killed_at(beside, 2, lambda: windmark(*asked(made, out)))
    with pytest.raises(io.FileError, match="it was begun by windmark track"):
        same_run.check_begun(beside, same_run.made_with("deform", {}, []))
