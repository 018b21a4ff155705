"""Films: every frame by its number, lossless ones to the last bit, lossy ones said so."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from windmark import io

av = pytest.importorskip("av")
RNG = np.random.default_rng(3)
GREY8 = RNG.integers(0, 256, (40, 16, 32), dtype=np.uint8)
GREY16 = RNG.integers(0, 65536, (40, 16, 32), dtype=np.uint16)
RGB = RNG.integers(0, 256, (40, 16, 32, 3), dtype=np.uint8)


def write(path, frames, codec, kind, given, rate=100, options=None):
    with av.open(str(path), "w") as out:
        stream = out.add_stream(codec, rate=rate, options=options or {})
        stream.width, stream.height, stream.pix_fmt = 32, 16, kind
        for picture in frames:
            frame = av.VideoFrame.from_ndarray(picture, format=given)
            out.mux(stream.encode(frame if given == kind else frame.reformat(format=kind)))
        out.mux(stream.encode())


@pytest.mark.parametrize(
    ("name", "codec", "kind", "given", "frames"),
    [
        ("a.avi", "rawvideo", "gray", "gray", GREY8), ("b.mkv", "ffv1", "gray", "gray", GREY8),
        ("c.avi", "ffv1", "gray16le", "gray16le", GREY16), ("d.mov", "png", "gray16be", "gray16le", GREY16),
        ("e.mkv", "ffv1", "gray12le", "gray12le", GREY16 >> 4), ("f.avi", "rawvideo", "bgr24", "rgb24", RGB),
        ("g.mov", "png", "rgb24", "rgb24", RGB), ("h.avi", "huffyuv", "rgb24", "rgb24", RGB),
    ],
)  # fmt: skip
def test_lossless(tmp_path, name, codec, kind, given, frames):
    write(tmp_path / name, frames, codec, kind, given)
    with io.frames(tmp_path / name) as film:
        assert (len(film), film.dtype, film.shape) == (40, frames.dtype, frames.shape[1:])
        for k in (*range(40), 3, 39, 0, 17, 18, 5):
            np.testing.assert_array_equal(film[k], frames[k])
        np.testing.assert_allclose(film.time_s, 0.01 * np.arange(40), atol=5e-4)  # MKV counts milliseconds
        assert "loses" not in film.note


@pytest.mark.parametrize(("name", "codec"), [("a.mp4", "libx264"), ("b.mp4", "mpeg4"), ("c.mov", "mpeg2video")])
def test_every_frame_of_a_film_with_key_frames_and_frames_between(tmp_path, name, codec):
    """Frames carry their number as brightness; B-frames are stored in another order than they are shown."""
    level = np.arange(40) * 6 + 8
    pictures = np.broadcast_to(level[:, None, None, None], (40, 16, 32, 3)).astype(np.uint8)
    try:
        write(tmp_path / name, pictures, codec, "yuv420p", "rgb24", rate=Fraction(50), options={"g": "12", "bf": "2"})
    except (av.error.FFmpegError, ValueError):
        pytest.skip(f"this build of FFmpeg has no {codec}")
    with av.open(str(tmp_path / name)) as file:
        shown = [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]
    film = io.frames(tmp_path / name)
    assert len(film) == len(shown) == 40
    for k in (*range(40), *RNG.integers(0, 40, 60).tolist()):
        np.testing.assert_array_equal(film[k], shown[k])
        assert abs(float(film[k].mean()) - level[k]) < 12
    np.testing.assert_allclose(np.diff(film.time_s), 0.02, atol=1e-3)
    assert "loses grey levels" in film.note


def test_a_film_without_pictures(tmp_path):
    with av.open(str(tmp_path / "a.mp4"), "w") as out:
        sound = out.add_stream("aac", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        frame.sample_rate = 8000
        out.mux(sound.encode(frame))
        out.mux(sound.encode())
    with pytest.raises(io.FileError, match="holds no pictures"):
        io.frames(tmp_path / "a.mp4")


def test_a_table_of_more_entries_than_memory_is_damage(tmp_path):
    write(tmp_path / "a.mov", GREY8[:4], "png", "gray", "gray")
    content = bytearray((tmp_path / "a.mov").read_bytes())
    count = content.index(b"stts") + 8
    content[count : count + 4] = (2**31 - 1).to_bytes(4, "big")
    (tmp_path / "a.mov").write_bytes(content)
    with pytest.raises(io.FileError, match="claims more entries than any film has") as caught:
        io.frames(tmp_path / "a.mov")
    assert not isinstance(caught.value.__cause__, MemoryError)
