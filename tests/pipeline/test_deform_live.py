"""Pictures as they arrive: what is whole, what is tried again, and one row for every frame that is seen."""

import os
import signal
import sys
import time
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

from windmark import io
from windmark.io import FileError
from windmark.pipeline.deform import live as watching
from windmark.pipeline.deform.inbox import READ_AT_ONCE, Inbox
from windmark.pipeline.deform.live import Watch, watch

SIZE = (40, 60)
PATIENCE_S = 0.6


def project(folder, *patterns, settle_s=0.02, patience_s=PATIENCE_S):
    cameras = [
        SimpleNamespace(name=f"cam{k + 1}", patterns=(p,), has_clock=False, times=None) for k, p in enumerate(patterns)
    ]
    return SimpleNamespace(
        path=folder / "p.toml", camera=cameras, watch=SimpleNamespace(settle_s=settle_s, patience_s=patience_s)
    )


def picture(folder, *names):
    rng = np.random.default_rng(3)
    for name in names:
        io.write_image(folder / name, rng.integers(1, 200, SIZE, dtype=np.uint8))


def content(folder):
    """The bytes of a picture, rows one after the other behind a header."""
    picture(folder, "whole.tif")
    data = (folder / "whole.tif").read_bytes()
    (folder / "whole.tif").unlink()
    return data


def fates(of):
    return {a.file: a.fate for a in of.told}


class Clock:
    """Time that only the test moves on."""

    def __init__(self, inbox):
        self.now, self.inbox = 100.0, inbox

    def after(self, seconds):
        """Files of which it is known what they are, so many seconds later."""
        self.now += seconds
        self.inbox.look(self.now)
        return [(f.path.name, fate, reason) for f, fate, reason in self.inbox.settled(self.now)]


class Time:
    """The module's clock: sleeping moves it on, and lets happen what is due by then."""

    def __init__(self):
        self.now, self.due = 100.0, []

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds
        while self.due and self.due[0][0] <= self.now - 100:
            self.due.pop(0)[1]()


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    made = Time()
    monkeypatch.setattr(watching, "time", made)
    return made


@pytest.fixture
def inbox(tmp_path):
    return Clock(Inbox(project(tmp_path, "c1-*.tif"), tmp_path))


def test_a_frame_is_handed_on_when_all_cameras_have_it_or_a_later_one_is_complete(tmp_path):
    picture(tmp_path, "c1-1.tif", "c1-2.tif", "c2-2.tif", "c1-3.tif")
    (tmp_path / "other.txt").write_text("no picture")
    arriving = Watch(project(tmp_path, "c1-*.tif", "c2-*.tif"), tmp_path, idle_s=0.3)
    got = [(f.key, sorted(f.images)) for f in arriving]
    assert got == [("1", ["cam1"]), ("2", ["cam1", "cam2"]), ("3", ["cam1"])]  # the last one when nothing more comes
    assert arriving.foreign == ["other.txt"]


def test_a_pause_while_it_is_written_is_no_end(tmp_path, inbox):
    """Cut off in the middle for 60 ms: it was taken as whole, lost, and never looked at again."""
    data, file = content(tmp_path), tmp_path / "c1-1.tif"
    file.write_bytes(data[: len(data) // 2])
    assert inbox.after(0) == inbox.after(0.03) == inbox.after(0.06) == []
    with open(file, "ab") as stream:
        stream.write(data[len(data) // 2 :])
    assert inbox.after(0.01) == inbox.after(0.01) == []
    assert inbox.after(0.03) == [("c1-1.tif", "measured", "")]


def test_a_file_made_in_its_full_size_is_whole_when_its_end_is_there(tmp_path, inbox):
    """Half-black pictures were measured."""
    data, file = content(tmp_path), tmp_path / "c1-1.tif"
    picture(tmp_path, "c1-0.tif")
    file.write_bytes(data[: len(data) // 2] + bytes(len(data) - len(data) // 2))
    inbox.after(0)
    assert inbox.after(0.1) == [("c1-0.tif", "measured", "")]
    assert inbox.after(0.1) == []
    with open(file, "r+b") as stream:
        stream.write(data)
    inbox.after(0.01)
    assert inbox.after(0.1) == [("c1-1.tif", "measured", "")]
    file = tmp_path / "c1-2.tif"  # whatever it shows, it stays so: taken, and said
    file.write_bytes(data[: len(data) // 2] + bytes(len(data) - len(data) // 2))
    inbox.after(0)
    assert inbox.after(0.5) == []
    ((_, fate, reason),) = inbox.after(PATIENCE_S)
    assert (fate, reason.endswith("rows are empty, which stayed so for 0.6 s")) == ("measured", True)


def test_pictures_that_end_in_the_dark_are_taken_at_once_where_most_do(tmp_path, inbox):
    """One that stayed half black was the measure of all others: of those, too, that were just being filled."""
    data = content(tmp_path)
    half = data[: len(data) // 2] + bytes(len(data) - len(data) // 2)
    for k, last_is_odd in enumerate([False, True, True, False]):
        (tmp_path / f"c1-{k}.tif").write_bytes(half if k else data)
        inbox.after(0)
        found = inbox.after(0.1)
        assert bool(found) != last_is_odd, k
        if last_is_odd:
            ((_, fate, reason),) = inbox.after(PATIENCE_S)
            assert (fate, "rows are empty" in reason) == ("measured", True)


def test_a_frame_with_a_picture_that_stays_half_black_says_so(tmp_path):
    data = content(tmp_path)
    (tmp_path / "c1-1.tif").write_bytes(data[: len(data) // 2] + bytes(len(data) - len(data) // 2))
    (frame,) = Watch(project(tmp_path, "c1-*.tif"), tmp_path, idle_s=0.5)
    assert list(frame.images) == ["cam1"]
    assert "rows are empty, which stayed so" in frame.odd["cam1"]


def test_a_content_that_changes_while_date_and_size_stay_is_not_whole(tmp_path, inbox):
    """As over a network whose dates lag behind."""
    data, file = content(tmp_path), tmp_path / "c1-1.tif"
    stat = None
    for level in (1, 2, 3):
        file.write_bytes(data[:-5] + bytes([level] * 5))
        if stat is not None:
            os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))
        stat = file.stat()
        assert inbox.after(0.1) == []
    assert inbox.after(0.5) == [("c1-1.tif", "measured", "")]


@pytest.mark.parametrize("name", ["c1-2.bmp", "c1-2.tif", "c1-2.jpg"])
def test_a_part_that_is_filled_last_is_no_matter_of_the_last_rows(tmp_path, name):
    """Of a BMP the last rows come first in the file, a copy in pieces has the middle last: half of it was measured."""
    inbox = Clock(Inbox(project(tmp_path, "c1-*"), tmp_path))
    rng, size = np.random.default_rng(4), (200, 300)
    for k in (0, 1):  # what is usual
        io.write_image(tmp_path / f"c1-{k}{name[-4:]}", rng.integers(1, 200, size, dtype=np.uint8))
    assert inbox.after(0) == []
    assert len(inbox.after(0.1)) == 2
    file = tmp_path / name
    io.write_image(file, rng.integers(1, 200, size, dtype=np.uint8))
    data, third = file.read_bytes(), file.stat().st_size // 3
    parts = [data[: 2 * third] + bytes(len(data) - 2 * third)]
    parts += [data[:third] + bytes(third) + data[2 * third :]] if name != "c1-2.bmp" else []
    for part in parts:
        file.write_bytes(part)
        assert inbox.after(0) == inbox.after(0.3) == inbox.after(0.2) == []
    file.write_bytes(data)
    inbox.after(0.01)
    assert inbox.after(0.1) == [(name, "measured", "")]


def test_a_dark_part_that_grows_a_little_is_no_part_that_is_missing(tmp_path, inbox):
    """A black background of a model that moves: every second picture would wait for as long as patience lasts."""
    for k, dark in enumerate([80, 84, 78, 95, 88]):
        image = np.full((200, 300), 90, np.uint8)
        image[20 : 20 + dark] = 0
        io.write_image(tmp_path / f"c1-{k}.tif", image)
        inbox.after(0)
        assert len(inbox.after(0.1 if k else 0.7)) == 1  # of the first it is not known yet how dark they are


def test_a_file_that_is_removed_and_written_again_is_another_one(tmp_path, inbox):
    """On many disks it has the number of the first one: it was never looked at, and its frame measured without it."""
    data, file = content(tmp_path), tmp_path / "c1-1.tif"
    file.write_bytes(data[:100])
    assert inbox.after(0) == []
    file.rename(tmp_path / "number")
    stat = tmp_path.stat()
    (fate,) = inbox.after(0.01)
    assert fate[:2] == ("c1-1.tif", "gone")
    (tmp_path / "number").write_bytes(data)
    (tmp_path / "number").rename(file)
    os.utime(tmp_path, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    inbox.after(0.6)
    assert inbox.after(0.1) == [("c1-1.tif", "measured", "")]


def test_a_folder_that_was_away_brings_nothing_new(tmp_path, inbox):
    """A share whose place is an empty folder for a while."""
    picture(tmp_path, "c1-1.tif", "c1-2.tif")
    inbox.after(0)
    assert len(inbox.after(0.1)) == 2
    (tmp_path / "away").mkdir()
    for name in ("c1-1.tif", "c1-2.tif"):
        (tmp_path / name).rename(tmp_path / "away" / name)
    assert inbox.after(0.6) == []
    for name in ("c1-1.tif", "c1-2.tif"):
        (tmp_path / "away" / name).rename(tmp_path / name)
    assert inbox.after(0.6) == inbox.after(0.6) == []
    assert not inbox.inbox.waiting


def test_a_file_that_goes_on_changing_is_given_up(tmp_path, inbox):
    """All frames behind it waited for ever, and so did the end."""
    data, file = content(tmp_path), tmp_path / "c1-1.tif"
    for k in range(20):
        file.write_bytes(data[: 100 + k])
        assert inbox.after(0.45 * PATIENCE_S) == []
    found = []
    for k in range(20, 30):
        file.write_bytes(data[: 100 + k])
        found += inbox.after(0.45 * PATIENCE_S)
    assert found == [("c1-1.tif", "unreadable", "it went on changing (tried for 6.2 s)")]


def test_folders_below_are_those_that_the_patterns_name(tmp_path):
    """With a wildcard in the folder's name nothing was seen, and with .. the folder above was watched, too."""
    watched = tmp_path / "watched"
    for name in ("run 7", "run [8]", "other"):
        (watched / name).mkdir(parents=True)
        picture(watched / name, f"c1-{len(name)}.tif")
    picture(tmp_path, "c1-99.tif")
    patterns = (str(tmp_path / folder / "c1-*.tif") for folder in ("run*", ".."))
    inbox = Clock(Inbox(project(tmp_path, *patterns), watched))
    inbox.after(0)
    assert [name for name, *_ in inbox.after(0.1)] == ["c1-5.tif", "c1-7.tif"]
    (watched / "run 9").mkdir()
    picture(watched / "run 9", "c1-9.tif")
    inbox.after(0.1)
    assert [name for name, *_ in inbox.after(0.1)] == ["c1-9.tif"]


def test_of_many_files_the_first_frames_are_read_first(tmp_path):
    """With thousands there at once no frame was measured, and no Ctrl-C heard, before all had been read and decoded."""
    picture(tmp_path, *(f"c{c}-{k}.tif" for c in (1, 2) for k in range(40)))
    box = Inbox(project(tmp_path, "c1-*.tif", "c2-*.tif"), tmp_path)
    box.look(0.0)
    read = [[f.key for f, *_ in box.settled(0.05 * k)] for k in range(12)]
    assert max(map(len, read)) == READ_AT_ONCE
    first = [key for keys in read for key in keys]
    assert len(first) == 80
    assert first == sorted(first, key=int)


def test_a_file_that_is_renamed_when_it_is_whole_is_no_foreign_one(tmp_path, inbox):
    """Every picture was told of twice at the end: as measured, and as one that matches no camera's pattern."""
    (tmp_path / "c1-1.tif.part").write_bytes(content(tmp_path))
    (tmp_path / "notes.txt").write_text("mine")
    assert inbox.after(0.0) == []
    assert sorted(inbox.inbox.foreign) == ["c1-1.tif.part", "notes.txt"]
    (tmp_path / "c1-1.tif.part").rename(tmp_path / "c1-1.tif")
    told = [fate for _ in range(4) for fate in inbox.after(0.6)]
    assert told == [("c1-1.tif", "measured", "")]
    assert inbox.inbox.foreign == ["notes.txt"]


@pytest.mark.parametrize("shift_s", [-3600.0, 3600.0])
def test_dates_of_files_do_not_matter(tmp_path, inbox, shift_s):
    """A file dated an hour ahead was never taken."""
    picture(tmp_path, "c1-1.tif")
    os.utime(tmp_path / "c1-1.tif", (time.time() + shift_s,) * 2)
    assert inbox.after(0) == []
    assert inbox.after(0.03) == [("c1-1.tif", "measured", "")]


def test_what_cannot_be_read_is_tried_until_patience_ends(tmp_path, inbox):
    (tmp_path / "c1-1.tif").write_bytes(b"II*\0 no image")
    (tmp_path / "c1-2.tif").write_bytes(b"")
    picture(tmp_path, "c1-3.tif")
    inbox.after(0)
    (tmp_path / "c1-3.tif").unlink()
    assert [(n, f) for n, f, _ in inbox.after(0.1)] == [("c1-3.tif", "gone")]
    assert inbox.after(0.3) == []
    found = {name: (fate, reason) for name, fate, reason in inbox.after(0.5)}
    assert found["c1-1.tif"][0] == found["c1-2.tif"][0] == "unreadable"
    assert found["c1-2.tif"][1] == "it is empty (tried for 0.9 s)"


def test_a_frame_in_the_tick_of_the_folders_date_is_seen(tmp_path, inbox):
    """Listed, then one more file whose coming does not change the folder's date: it was never seen."""
    inbox.after(0)
    stat = tmp_path.stat()
    picture(tmp_path, "c1-1.tif")
    os.utime(tmp_path, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    inbox.after(0.1)
    inbox.after(0.5)
    assert inbox.after(0.1) == [("c1-1.tif", "measured", "")]


def test_every_frame_has_one_row_and_every_file_a_fate(tmp_path):
    """Disorder, duplicates, an unreadable one, one of another kind: nothing vanishes."""
    picture(tmp_path, "c1-5.tif", "c1-07.tif")
    (tmp_path / "c1-6.tif").write_bytes(b"II*\0 no image")
    arriving = Watch(project(tmp_path, "c*.tif"), tmp_path, idle_s=0.5)
    frames = []
    for frame in arriving:
        frames.append((frame.key, frame.skipped and frame.skipped[0], sorted(frame.images), sorted(frame.missing)))
        if frame.key == "7":
            picture(tmp_path, "c1-3.tif", "c1-7.tif", "cam-x.tif")
    assert frames == [
        ("5", None, ["cam1"], []), ("6", None, [], ["cam1"]), ("7", None, ["cam1"], []), ("3", "late", [], []),
        ("cam-x", "late", [], []),
    ]  # fmt: skip
    assert fates(arriving) == {
        "c1-5.tif": "measured", "c1-6.tif": "unreadable", "c1-07.tif": "measured", "c1-3.tif": "late",
        "c1-7.tif": "duplicate", "cam-x.tif": "late",
    }  # fmt: skip
    assert "arrived after frame 7 had been measured" in next(a.reason for a in arriving.told if a.key == "3")


def test_two_files_of_one_frame_before_it_is_measured(tmp_path):
    picture(tmp_path, "c1-1.tif", "c1-01.tif")
    arriving = Watch(project(tmp_path, "c1-*.tif"), tmp_path, idle_s=0.2)
    (frame,) = arriving
    assert frame.images["cam1"].name == "c1-01.tif"
    assert frame.odd == {"cam1": "c1-01.tif: c1-1.tif is the same frame"}
    assert fates(arriving) == {"c1-01.tif": "measured", "c1-1.tif": "duplicate"}


def test_frames_that_overtake_each_other_are_taken_in_order(tmp_path, clock):
    """The second camera's pictures come in another order: none is handed on without it."""
    picture(tmp_path, "c1-1.tif", "c1-2.tif", "c2-2.tif")
    clock.due = [(0.08, lambda: picture(tmp_path, "c2-1.tif"))]
    got = [(f.key, len(f.images)) for f in watch(project(tmp_path, "c1-*.tif", "c2-*.tif"), tmp_path, idle_s=0.5)]
    assert got == [("1", 2), ("2", 2)]


def test_a_picture_that_is_written_again_while_its_frame_waits_is_looked_at_again(tmp_path, clock):
    """Overwritten, or gone, when the other camera's picture came: half of it was measured, and nothing said."""
    data = content(tmp_path)
    file = {k: tmp_path / f"c1-{k}.tif" for k in (1, 2, 3)}
    for path in file.values():
        path.write_bytes(data)

    def again():
        file[1].write_bytes(data[: len(data) // 2] + bytes(len(data) - len(data) // 2))
        file[2].unlink()
        file[3].write_bytes(data[:99])
        picture(tmp_path, "c2-1.tif", "c2-2.tif", "c2-3.tif", "c1-4.tif")

    clock.due = [(0.2, again), (0.5, lambda: file[1].write_bytes(data)), (2.5, lambda: picture(tmp_path, "c2-4.tif"))]
    arriving = Watch(project(tmp_path, "c1-*.tif", "c2-*.tif", patience_s=2.0), tmp_path, idle_s=0.5)
    got = [(f.key, sorted(f.images), *f.missing.values()) for f in arriving]
    assert got[0] == ("1", ["cam1", "cam2"])
    assert got[1] == ("2", ["cam2"], "c1-2.tif: it was renamed or removed before it could be read")
    assert got[2][:2] == ("3", ["cam2"])
    assert got[3] == ("4", ["cam1", "cam2"])
    told = fates(arriving)
    assert (told["c1-1.tif"], told["c1-2.tif"], told["c1-3.tif"]) == ("measured", "gone", "unreadable")
    assert len(arriving.told) == len(told)


def test_a_picture_that_is_renamed_while_its_frame_waits_is_the_same_one(tmp_path, clock):
    """Written under a name of the same frame, it was whole; under its final one it was a duplicate, and then gone."""
    picture(tmp_path, "c1-1.tmp.tif")
    clock.due = [(0.2, lambda: (tmp_path / "c1-1.tmp.tif").rename(tmp_path / "c1-1.tif")),
                 (0.6, lambda: picture(tmp_path, "c2-1.tif"))]  # fmt: skip
    arriving = Watch(project(tmp_path, "c1-*.tif", "c2-*.tif", patience_s=2.0), tmp_path, idle_s=0.5)
    (frame,) = arriving
    assert {camera: path.name for camera, path in frame.images.items()} == {"cam1": "c1-1.tif", "cam2": "c2-1.tif"}
    assert frame.odd == {}
    assert fates(arriving) == {"c1-1.tmp.tif": "gone", "c1-1.tif": "measured", "c2-1.tif": "measured"}


def test_a_file_that_is_gone_leaves_no_frame_that_others_are_too_late_for(tmp_path, clock):
    """A temporary name with a number in it: frame 4711 was dealt with, and all others came after it."""
    picture(tmp_path, "c1-1.tif")
    (tmp_path / "c1-tmp4711.tif").write_bytes(b"II*\0")
    clock.due = [
        (0.1, lambda: (tmp_path / "c1-tmp4711.tif").rename(tmp_path / "c1-2.tif")),
        (0.2, lambda: picture(tmp_path, "c1-2.tif")), (1.5, lambda: picture(tmp_path, "c1-3.tif")),
    ]  # fmt: skip
    got = [(f.key, sorted(f.images)) for f in watch(project(tmp_path, "c1-*.tif"), tmp_path, idle_s=2.0)]
    assert got == [("1", ["cam1"]), ("2", ["cam1"]), ("3", ["cam1"]), ("4711", [])]


def test_a_camera_that_delivers_nothing_does_not_hold_up_the_others(tmp_path):
    """Nothing was handed on before the end."""
    picture(tmp_path, "c1-1.tif")
    arriving = iter(Watch(project(tmp_path, "c1-*.tif", "c2-*.tif"), tmp_path))
    assert sorted(next(arriving).images) == ["cam1"]


def test_stamps_and_long_numbers_as_they_arrive(tmp_path):
    picture(tmp_path, "c1-20261122235959.tif", "c1-20261123000001.tif")
    got = [(f.key, f.instant, f.time_s) for f in watch(project(tmp_path, "c1-*.tif"), tmp_path, idle_s=0.2)]
    assert got == [("20261122235959", 0.0, 0.0), ("20261123000001", 2.0, 2.0)]
    (tmp_path / "long").mkdir()
    picture(tmp_path / "long", *(f"c1-{10**19 + k}.tif" for k in (9, 10)))
    got = [(f.key, f.instant) for f in watch(project(tmp_path, "c1-*.tif"), tmp_path / "long", idle_s=0.2)]
    assert got == [(str(10**19 + 9), 0.0), (str(10**19 + 10), 1.0)]


def test_it_ends_after_so_many_frames_and_says_what_is_left(tmp_path):
    picture(tmp_path, *(f"c1-{k}.tif" for k in range(5)))
    arriving = Watch(project(tmp_path, "c1-*.tif"), tmp_path, stop_after=3)
    frames = list(arriving)
    assert [f.skipped is None for f in frames] == [True, True, True, False, False]
    assert frames[4].skipped == ("left", "the run ended after 3 frames, as asked for")
    # The files of frames that were left were said to be measured.
    assert [a.fate for a in arriving.told] == [*["measured"] * 3, *["left"] * 2]


@pytest.mark.slow
@pytest.mark.parametrize("stop_after", [None, 2])
def test_interrupted_at_any_of_its_lines_every_file_told_of_has_its_frame(tmp_path, monkeypatch, stop_after):
    """Ctrl-C between two lists: a frame was in none, and the table of files had one that no other table knew."""
    picture(tmp_path, "c1-2.tif", "c1-3.tif", "c2-3.tif", "c1-4.tif", "c2-4.tif", "c1-5.tif")

    def run(at):
        """Keys of the frames handed on or left, and of those told of, the signal coming after ``at`` lines; these."""
        lines, handed = [], []
        arriving = Watch(project(tmp_path, "c1-*.tif", "c2-*.tif"), tmp_path, idle_s=0.3, stop_after=stop_after)
        monkeypatch.setattr(watching, "time", clock := Time())
        clock.due = [(0.1, lambda: picture(tmp_path, "c2-2.tif", "c1-1.tif"))]

        def line(frame, event, _):
            if frame.f_code.co_filename != watching.__file__:
                return None
            if event == "line":
                lines.append(frame.f_lineno)
                if len(lines) == at:
                    signal.raise_signal(signal.SIGINT)
            return line

        before = sys.gettrace()
        sys.settrace(line)
        try:
            handed.extend(frame.key for frame in arriving)
        except KeyboardInterrupt:
            sys.settrace(before)
            handed.extend(f.key for f in arriving.left("ended") if f.key not in handed)
        finally:
            sys.settrace(before)
        (tmp_path / "c2-2.tif").unlink(missing_ok=True)
        (tmp_path / "c1-1.tif").unlink(missing_ok=True)
        return handed, {a.key for a in arriving.told}, lines

    whole, told, lines = run(0)
    assert told == set(whole) == {"1", "2", "3", "4", "5"}
    times = Counter()
    for at, number in enumerate(lines, 1):  # every line the first times that it runs
        times[number] += 1
        if times[number] > 4:
            continue
        handed, told, _ = run(at)
        assert len(handed) == len(set(handed)), at
        assert told <= set(handed), at


def test_going_on_leaves_what_was_dealt_with_alone(tmp_path):
    picture(tmp_path, "c1-1.tif", "c1-2.tif", "c1-3.tif")
    arriving = Watch(project(tmp_path, "c1-*.tif"), tmp_path, idle_s=0.2)
    arriving.go_on(["1", "2"], {("cam1", "c1-1.tif"): None, ("cam1", "c1-2.tif"): None}, 2)
    assert [(f.key, f.instant) for f in arriving] == [("3", 3.0)]
    assert fates(arriving) == {"c1-3.tif": "measured"}


@pytest.mark.parametrize("measured", [2, 3])
def test_what_was_measured_before_it_went_on_counts(tmp_path, measured):
    """As many frames again were measured as were asked for."""
    picture(tmp_path, *(f"c1-{k}.tif" for k in range(6)))
    arriving = Watch(project(tmp_path, "c1-*.tif"), tmp_path, stop_after=3)
    done = [str(k) for k in range(measured)]
    arriving.go_on(done, {("cam1", f"c1-{k}.tif"): None for k in done}, measured)
    assert [f.key for f in arriving if f.skipped is None] == ["2"][: 3 - measured]


def test_a_file_that_changes_after_it_was_read_is_said(tmp_path):
    picture(tmp_path, "c1-1.tif")
    arriving = Watch(project(tmp_path, "c1-*.tif"), tmp_path, idle_s=0.1)
    assert len(list(arriving)) == 1
    assert arriving.changed_since() == []
    (tmp_path / "c1-1.tif").write_bytes(b"something else")
    assert arriving.changed_since() == ["c1-1.tif"]


def test_there_must_be_a_folder(tmp_path):
    with pytest.raises(FileError, match="is no folder"):
        watch(project(tmp_path, "*.tif"), tmp_path / "none")
