"""Which images are one instant: on the disk and as they arrive."""

from types import SimpleNamespace

import numpy as np
import pytest
from camera_files import write_cine

from windmark import io
from windmark.io import FileError
from windmark.pipeline.deform.frames import frames_on_disk, instants_of, read_frame_table
from windmark.pipeline.deform.names import instant_of, key_of, kind_of, number_of, order, stamp_ns, stamp_text


def project(folder, *patterns, frames=None):
    cameras = [
        SimpleNamespace(name=f"cam{k + 1}", patterns=(p,), has_clock=False, times=None) for k, p in enumerate(patterns)
    ]
    sequence = SimpleNamespace(frames=frames, rate_hz=None)
    return SimpleNamespace(path=folder / "p.toml", camera=cameras, sequence=sequence)


def touch(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"image")


@pytest.mark.parametrize(
    ("stem", "key"),
    [
        ("cam1-0007", "7"), ("run12_cam2_000", "0"), ("wind-off", "wind-off"), ("a2b", "2"), ("²", "²"),
        ("cam1-20261122140005", "20261122140005"),
        ("cam1_20261122-140005", "20261122140005"),
        ("cam1_20261122T140005.123", "20261122140005123"),
        ("20261122_140005_0012", "12"),  # a counter behind a stamp counts
        ("20261322-140005", "140005"),  # no month 13: two numbers
        ("run-0" + "9" * 5000, "9" * 5000),
    ],
)  # fmt: skip
def test_the_frame_is_the_last_number(stem, key):
    assert key_of(stem) == key


def test_frames_are_paired_by_number_and_gaps_stay(tmp_path):
    touch(tmp_path, "a/c1-1.tif", "a/c1-2.tif", "a/c1-10.tif", "b/c2-2.tif", "b/c2-10.tif")
    frames = frames_on_disk(project(tmp_path, "a/*.tif", "b/*.tif"))
    assert [f.key for f in frames] == ["1", "2", "10"]
    assert [f.instant for f in frames] == [1.0, 2.0, 10.0]
    assert [sorted(f.images) for f in frames] == [["cam1"], ["cam1", "cam2"], ["cam1", "cam2"]]


def test_date_stamps_are_times_of_their_own(tmp_path):
    """A minute's end: as numbers the two pictures were 41 apart; and names with a hyphen fell back at midnight."""
    touch(tmp_path, "a/c-20261122235959.tif", "a/c-20261123000001.tif", "b/c-20261122-235959.500.tif",
          "b/c-20261123-000000.250.tif")  # fmt: skip
    frames = frames_on_disk(project(tmp_path, "a/*.tif"))
    assert [(f.key, f.instant, f.time_s) for f in frames] == [
        ("20261122235959", 0.0, 0.0), ("20261123000001", 2.0, 2.0)
    ]  # fmt: skip
    assert [number_of(f.key, 7) for f in frames] == [20261122235959, 20261123000001]
    assert stamp_text("20261122235959") == "2026-11-22T23:59:59"
    made = instants_of(project(tmp_path, "b/*.tif"))
    assert [f.instant for f in made.frames] == [0.0, 0.75]
    said = "the pictures' names are time stamps (20261122235959500 is 2026-11-22T23:59:59.500)"
    assert made.remarks[0].startswith(said)
    assert stamp_ns("20260230000000") is stamp_ns("12345678901234") is None  # no 30th of February; no date


def test_long_numbers_keep_their_order(tmp_path):
    """Float64 does not tell numbers of 17 digits apart, a 64-bit integer none of 20."""
    near = [str(10**17 + k) for k in (1, 2, 10)]
    touch(tmp_path, *(f"a/c-{k}.tif" for k in near), *(f"b/c-{10**19 + k}.tif" for k in (9, 10)), "b/c-12.tif")
    assert [f.instant for f in frames_on_disk(project(tmp_path, "a/*.tif"))] == [0.0, 1.0, 9.0]
    made = instants_of(project(tmp_path, "b/*.tif"))
    assert [(f.key, f.instant) for f in made.frames] == [("12", 0.0), (str(10**19 + 9), 1.0), (str(10**19 + 10), 2.0)]
    assert [number_of(f.key, k) for k, f in enumerate(made.frames)] == [12, 1, 2]
    assert "2 frames have numbers of more than 18 digits" in made.remarks[0]
    assert instant_of("7", kind_of(["7"]), "5", 0) == 7.0


def test_names_are_in_natural_order(tmp_path):
    assert sorted(["b10x", "b9x", "12", "a", "7"], key=lambda k: order(k)) == ["7", "12", "a", "b9x", "b10x"]


def test_a_long_table_of_frames_takes_linear_time(tmp_path):
    """20,000 frames were compared with each other, and looked for one by one."""
    (tmp_path / "f.csv").write_text("frame\n" + "\n".join(map(str, range(20_000))) + "\n")
    table = read_frame_table(project(tmp_path, frames=tmp_path / "f.csv"))
    assert [table.row(str(k)) for k in range(20_000)] == list(range(20_000))


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
