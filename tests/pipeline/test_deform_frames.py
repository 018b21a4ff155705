"""Which images are one instant: on the disk and as they arrive."""

import os
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from camera_files import write_cine

from windmark import io
from windmark.io import FileError
from windmark.pipeline.deform.frames import frames_on_disk, key_of, read_frame_table, watch


def project(folder, *patterns, frames=None):
    cameras = [SimpleNamespace(name=f"cam{k + 1}", patterns=(p,), has_clock=False) for k, p in enumerate(patterns)]
    return SimpleNamespace(path=folder / "p.toml", camera=cameras, sequence=SimpleNamespace(frames=frames))


def touch(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"image")
        old = time.time() - 1  # written a while ago
        os.utime(folder / name, (old, old))


@pytest.mark.parametrize(
    ("stem", "key"), [("cam1-0007", "7"), ("run12_cam2_000", "0"), ("wind-off", "wind-off"), ("a2b", "2")]
)
def test_the_frame_is_the_last_number(stem, key):
    assert key_of(stem) == key


def test_frames_are_paired_by_number_and_gaps_stay(tmp_path):
    touch(tmp_path, "a/c1-1.tif", "a/c1-2.tif", "a/c1-10.tif", "b/c2-2.tif", "b/c2-10.tif")
    frames = frames_on_disk(project(tmp_path, "a/*.tif", "b/*.tif"))
    assert [f.key for f in frames] == ["1", "2", "10"]
    assert [f.instant for f in frames] == [1.0, 2.0, 10.0]
    assert [sorted(f.images) for f in frames] == [["cam1"], ["cam1", "cam2"], ["cam1", "cam2"]]


def test_names_without_numbers_count_one_by_one(tmp_path):
    touch(tmp_path, "a/off.tif", "a/on.tif")
    assert [(f.key, f.instant) for f in frames_on_disk(project(tmp_path, "a/*.tif"))] == [("off", 0.0), ("on", 1.0)]


def test_two_images_of_one_frame_are_refused(tmp_path):
    touch(tmp_path, "a/x-1.tif", "a/y-01.tif")
    with pytest.raises(FileError, match="both frame 1 of camera cam1"):
        frames_on_disk(project(tmp_path, "a/*.tif"))


def test_the_table_of_frames(tmp_path):
    (tmp_path / "f.csv").write_text("frame,alpha_deg,time_s\n0001,1.5,0.1\n2,2.5,0.2\n")
    table = read_frame_table(project(tmp_path, frames=tmp_path / "f.csv"))
    assert table.row("2") == 1
    assert table.row("7") is None
    assert table.time_s.tolist() == [0.1, 0.2]
    assert table.columns["alpha_deg"].tolist() == [1.5, 2.5]
    (tmp_path / "f.csv").write_text("frame\n1\n01\n")
    with pytest.raises(FileError, match="frame 1 is there more than once"):
        read_frame_table(project(tmp_path, frames=tmp_path / "f.csv"))


def test_a_frame_is_handed_on_when_all_cameras_have_it_or_a_later_one_is_complete(tmp_path):
    touch(tmp_path, "c1-1.tif", "c1-2.tif", "c2-2.tif", "c1-3.tif", "other.txt")
    arriving = watch(project(tmp_path, "c1-*.tif", "c2-*.tif"), tmp_path, idle_s=0.2)
    got = [(f.key, sorted(f.images)) for f in arriving]
    assert got == [("1", ["cam1"]), ("2", ["cam1", "cam2"]), ("3", ["cam1"])]  # the last one when nothing more comes


def test_files_that_still_grow_wait(tmp_path):
    touch(tmp_path, "c1-1.tif")
    (tmp_path / "c1-2.tif").write_bytes(b"")  # opened, nothing in it yet

    def finish():
        time.sleep(0.15)
        (tmp_path / "c1-2.tif").write_bytes(b"image")

    writer = threading.Thread(target=finish)
    writer.start()
    keys = [f.key for f in watch(project(tmp_path, "c1-*.tif"), tmp_path, idle_s=1.0)]
    writer.join()
    assert keys == ["1", "2"]


def test_it_ends_after_so_many_frames(tmp_path):
    touch(tmp_path, *(f"c1-{k}.tif" for k in range(5)))
    assert len(list(watch(project(tmp_path, "c1-*.tif"), tmp_path, stop_after=3))) == 3


def test_there_must_be_a_folder(tmp_path):
    with pytest.raises(FileError, match="is no folder"):
        next(watch(project(tmp_path, "*.tif"), tmp_path / "none"))


def test_recordings_are_frames_of_their_number(tmp_path):
    (tmp_path / "a").mkdir()
    stack = np.arange(3 * 20, dtype=np.uint16).reshape(3, 4, 5)
    write_cine(tmp_path / "a" / "run7.cine", list(stack), 16, times=1e9 + 0.5 * np.arange(3), trigger_s=1e9)
    io.write_images(tmp_path / "b.tif", stack[:2])
    for pattern in ("a/run7.cine", "a/*.cine"):
        frames = frames_on_disk(project(tmp_path, pattern, "b.tif"))
        assert [(f.key, sorted(f.images)) for f in frames] == [
            ("0", ["cam1", "cam2"]), ("1", ["cam1", "cam2"]), ("2", ["cam1"])
        ]  # fmt: skip
        np.testing.assert_array_equal(io.read_grey(frames[2].images["cam1"]), stack[2])
        assert abs(frames[1].images["cam1"].time_s - 0.5) < 1e-6
    (frame,) = frames_on_disk(project(tmp_path, "a/run7.cine[2]"))
    assert frame.key == "2"
