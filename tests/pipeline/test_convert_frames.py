"""Recordings into other recordings: every bit, the time stamps, and what is lost is said."""

import h5py
import numpy as np
import pytest
from camera_files import write_cine, write_mraw

from windmark import io
from windmark.pipeline.convert_frames import FrameOptions, choose, convert_frames, lines

RNG = np.random.default_rng(11)
GREY = RNG.integers(0, 4096, (6, 9, 14), dtype=np.uint16)
RGB = RNG.integers(0, 256, (4, 8, 10, 3), dtype=np.uint8)
TIMES = np.array([-1, 0, 1, 2, 4, 5]) * 0.25


@pytest.fixture
def folder(tmp_path):
    write_cine(tmp_path / "grey.cine", list(GREY), 16, real_bits=12, times=1e9 + TIMES, trigger_s=1e9)
    write_mraw(tmp_path / "rgb.mraw", list(RGB), 8, colour="Color", rate=50)
    with h5py.File(tmp_path / "float.h5", "w") as file:
        file["images"] = np.where(GREY % 7 == 0, np.nan, GREY).astype(np.float32)
    return tmp_path


@pytest.mark.parametrize("target", ["out.tif", "out.h5", "out.nc", "out.avi", "out.mkv", "out"])
@pytest.mark.parametrize(("source", "expected"), [("grey.cine", GREY), ("rgb.mraw", RGB), ("float.h5", None)])
def test_every_bit(folder, source, expected, target):
    if target.endswith(("avi", "mkv")):
        pytest.importorskip("av")
        if expected is None:
            with pytest.raises(ValueError, match="a film cannot hold float32"):
                convert_frames([folder / source], folder / target)
            assert not (folder / target).exists()
            return
    record = convert_frames([folder / source], folder / target)
    expected = np.stack(list(io.frames(folder / source))) if expected is None else expected
    np.testing.assert_array_equal(np.stack(list(io.frames(folder / target))), expected)
    assert record["frames"] == len(expected)
    assert record["read_back"] == {"frames": len(expected), "same": len(expected)}
    assert "every pixel is the same" in lines(record)[-1]


@pytest.mark.parametrize("target", ["out.h5", "out.nc"])
def test_time_stamps_are_kept_or_said_to_be_lost(folder, target):
    convert_frames([folder / "grey.cine"], folder / target)
    again = io.frames(folder / target)
    np.testing.assert_allclose(again.time_s, TIMES, atol=1e-6)
    assert again.start == io.frames(folder / "grey.cine").start
    assert "left out: the time stamps" in convert_frames([folder / "grey.cine"], folder / "a.tif")["notes"]
    pytest.importorskip("av")
    assert (
        "left out: the time stamps, which are not even"
        in (convert_frames([folder / "grey.cine"], folder / "a.avi")["notes"])
    )
    convert_frames([folder / "rgb.mraw"], folder / "b.avi")
    np.testing.assert_allclose(np.diff(io.frames(folder / "b.avi").time_s), 0.02)


def test_some_frames_and_several_sources(folder):
    record = convert_frames([folder / "grey.cine"], folder / "some.h5", FrameOptions("1:6:2"))
    np.testing.assert_array_equal(np.stack(list(io.frames(folder / "some.h5"))), GREY[1:6:2])
    np.testing.assert_allclose(io.frames(folder / "some.h5").time_s, TIMES[1:6:2], atol=1e-6)
    assert record["frames"] == 3
    io.write_image(folder / "a.tif", GREY[0])
    convert_frames([folder / "a.tif", folder / "grey.cine[4]"], folder / "pair.h5")
    np.testing.assert_array_equal(io.read_image(folder / "pair.h5[1]"), GREY[4])
    convert_frames([folder / "grey.cine"], folder / "one.png", FrameOptions("-1"))
    np.testing.assert_array_equal(io.read_image(folder / "one.png"), GREY[5])
    convert_frames([folder / "grey.cine"], folder / "many", FrameOptions("0:2", "png"))
    assert sorted(p.name for p in (folder / "many").iterdir()) == [
        "grey-000000.png", "grey-000001.png", "manifest.json",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "message"),
    [("a", "must be first:stop:step"), ("1:2:3:4", "must be first:stop:step"), ("::0", "must be first:stop:step"),
     ("9", "names none of the 6 frames"), ("4:2", "names none of the 6 frames"), ("", "must be first:stop:step")],
)  # fmt: skip
def test_frames_that_are_none(folder, text, message):
    with pytest.raises(ValueError, match=message):
        choose(io.frames(folder / "grey.cine"), text)


@pytest.mark.parametrize(
    ("target", "message"),
    [("out.png", "holds one picture"), ("out.xyz", "path must end in"), ("grey.cine", "is the source itself")],
)
def test_targets_that_cannot_be(folder, target, message):
    before = sorted(p.name for p in folder.iterdir())
    with pytest.raises(ValueError, match=message):
        convert_frames([folder / "grey.cine"], folder / target)
    assert sorted(p.name for p in folder.iterdir()) == before


def test_a_frame_that_cannot_be_read_leaves_no_target(folder):
    io.write_image(folder / "f1.tif", GREY[0])
    io.write_image(folder / "f2.tif", GREY[0][:4])
    for target in ("out.h5", "out.tif", "out"):
        with pytest.raises(io.FileError, match="f2: is uint16"):
            convert_frames([folder / "f*.tif"], folder / target)
        assert not (folder / target).exists()


def test_a_folder_holds_one_recording(folder, tmp_path):
    """A shorter recording left the last pictures of the longer one before it, and both were read as one."""
    many, said = tmp_path / "many", []
    convert_frames([folder / "grey.cine"], many)
    (many / "notes.txt").write_text("mine")
    record = convert_frames([folder / "grey.cine"], many, FrameOptions("0:2"), say=said.append)
    assert record["read_back"] == {"frames": 2, "same": 2}
    np.testing.assert_array_equal(np.stack(list(io.frames(many))), GREY[:2])
    assert (many / "notes.txt").read_text() == "mine"
    assert said == []
    assert sorted(p.name for p in many.iterdir()) == [
        "grey-000000.tif", "grey-000001.tif", "manifest.json", "notes.txt",
    ]  # fmt: skip


def test_others_pictures_do_not_become_part_of_a_recording(folder, tmp_path):
    many = tmp_path / "many"
    many.mkdir()
    io.write_image(many / "mine.tif", GREY[0])
    with pytest.raises(io.FileError, match=r"many: holds mine\.tif, which no conversion wrote"):
        convert_frames([folder / "grey.cine"], many)
    assert [p.name for p in many.iterdir()] == ["mine.tif"]
