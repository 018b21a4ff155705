"""Films: every frame by its number, lossless ones to the last bit, lossy ones said so."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from windmark import io
from windmark.io.recordings.gaps import gaps_between, said_of

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


def test_colours_of_ten_bits_fill_sixteen(tmp_path):
    """The decoder stretches them: `bits` is what the pixels have, not what the film has."""
    picture = np.full((16, 32, 3), 255, np.uint8)
    write(tmp_path / "a.mkv", [picture, picture], "ffv1", "yuv420p10le", "rgb24")
    with io.frames(tmp_path / "a.mkv") as film:
        assert film[0].max() > 60000
        assert film.bits == 16


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


# --- films that lack something ------------------------------------------------------------------------
def levels(count=24):
    """Pictures with their number as brightness, and a pattern that moves, so that frames are coded from others."""
    pattern = RNG.integers(0, 120, (64, 160), dtype=np.uint8)
    return [np.roll(pattern, 3 * k, axis=1)[:, :128] + np.uint8(2 * k) for k in range(count)]


def film(path, codec="libx264", frames=None, options=None):
    """Of 64 x 128 pixels at 50 frames a second, a key frame at 0 and 16; B-frames unless the options say otherwise."""
    try:
        with av.open(str(path), "w") as out:
            stream = out.add_stream(codec, rate=50, options=options or {"g": "16", "sc_threshold": "0"})
            stream.width, stream.height, stream.pix_fmt = 128, 64, "gray" if codec == "ffv1" else "yuv420p"
            for picture in frames or levels():
                out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "gray").reformat(format=stream.pix_fmt)))
            out.mux(stream.encode())
    except (av.error.FFmpegError, ValueError):
        pytest.skip(f"this build of FFmpeg has no {codec}")
    return path


def remuxed(source, target, change):
    """The packets again; ``change`` takes each one's number and content and gives its content, or None."""
    with av.open(str(source)) as file, av.open(str(target), "w") as out:
        stream = file.streams.video[0]
        copy = out.add_stream_from_template(stream)
        for k, packet in enumerate(p for p in file.demux(stream) if p.size):
            content = change(k, bytes(packet))
            if content is not None:
                new = av.Packet(content)
                new.pts, new.dts, new.time_base, new.is_keyframe = (
                    packet.pts, packet.dts, packet.time_base, packet.is_keyframe
                )  # fmt: skip
                new.stream = copy
                out.mux(new)
    return target


@pytest.mark.parametrize(("name", "codec"), [("a.mkv", "ffv1"), ("a.avi", "mpeg4"), ("a.mp4", "mpeg4")])
def test_a_film_that_was_cut_off_is_refused(tmp_path, name, codec):
    """Four of eight pictures were read as if they were all."""
    whole = film(tmp_path / name, codec, options={"movflags": "faststart"} if name == "a.mp4" else None)
    assert len(io.frames(whole)) == 24
    content = whole.read_bytes()
    cut = tmp_path / f"cut-{name}"
    cut.write_bytes(content[: int(0.55 * len(content))])
    with pytest.raises(io.FileError, match="cut off"):
        io.frames(cut)


def test_a_film_that_holds_fewer_pictures_than_its_header_says_is_refused(tmp_path):
    whole = film(tmp_path / "a.mp4", "mpeg4")
    content = bytearray(whole.read_bytes())
    at = content.index(b"stts") + 12  # how many samples have the first duration
    assert int.from_bytes(content[at : at + 4], "big") == 24
    content[at : at + 4] = (30).to_bytes(4, "big")
    (tmp_path / "b.mp4").write_bytes(content)
    with pytest.raises(io.FileError, match="tells of 30 pictures, it holds 24"):
        io.frames(tmp_path / "b.mp4")


def without(*numbers):
    return lambda k, content: None if k in numbers else content


def test_pictures_that_a_film_lost_are_named_and_the_others_keep_their_times(tmp_path):
    """MPEG-4 has no numbers of frames: whether they were lost before the film was coded, or after, is open."""
    whole = film(tmp_path / "a.mp4", "mpeg4", options={"g": "16", "bf": "0", "sc_threshold": "1000000000"})
    lost = io.frames(remuxed(whole, tmp_path / "b.mp4", without(5, 6)))
    assert "the film lacks pictures: 2 before frame 5 (" in lost.note
    assert "are coded from what is not there" in lost.note
    np.testing.assert_allclose(lost.time_s, 0.02 * np.delete(np.arange(24), (5, 6)), atol=1e-4)
    assert "lacks" not in io.frames(whole).note


@pytest.mark.parametrize(("suffix", "b_frames"), [("mp4", "0"), ("mp4", "2"), ("mkv", "0"), ("avi", "0")])
def test_frames_that_are_coded_from_lost_ones_are_refused(tmp_path, b_frames, suffix):
    """FFmpeg decodes them from what is nearest: poses were 11 sigmas off."""
    options = {"g": "16", "bf": b_frames, "b-pyramid": "none", "sc_threshold": "0"}
    whole = film(tmp_path / f"a.{suffix}", options=options)
    packets = [p for p in av.open(str(whole)).demux(video=0) if p.size]
    hit = [k for k, p in enumerate(packets) if k < 12 and not p.is_disposable][3]
    rest = [p for k, p in enumerate(packets) if k != hit]
    lost = io.frames(remuxed(whole, tmp_path / f"b.{suffix}", without(hit)))
    shown = sorted(p.pts for p in rest)
    end = next(k for k, p in enumerate(rest) if k and p.is_keyframe)
    orphans = {shown.index(p.pts) for p in rest[hit:end]}
    good = io.frames(whole)
    kept = sorted(p.pts for p in packets)
    for k in range(len(lost)):
        if k in orphans:
            with pytest.raises(io.FileError, match="is coded from one that was lost"):
                lost[k]
        else:
            np.testing.assert_array_equal(lost[k], good[kept.index(shown[k])])
    assert "the film lacks pictures: 1 before frame" in lost.note
    assert "not there" not in lost.note
    assert "lacks" not in good.note


def test_pictures_that_were_dropped_before_the_film_was_coded_spoil_no_frame(tmp_path):
    with av.open(str(tmp_path / "a.mp4"), "w") as out:
        stream = out.add_stream("libx264", rate=50, options={"g": "24"})
        stream.width, stream.height, stream.pix_fmt = 128, 64, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        for k, picture in enumerate(levels()):
            if k not in (5, 6, 15):
                frame = av.VideoFrame.from_ndarray(picture, "gray").reformat(format="yuv420p")
                frame.pts, frame.time_base = 20 * k, Fraction(1, 1000)
                out.mux(stream.encode(frame))
        out.mux(stream.encode())
    dropped = io.frames(tmp_path / "a.mp4")
    assert "lacks pictures: 2 before frame 5, 1 before frame 13" in dropped.note
    assert "not there" not in dropped.note
    assert len([dropped[k] for k in range(len(dropped))]) == 21


@pytest.mark.parametrize("b_frames", ["0", "2"])
def test_frames_that_the_decoder_fills_in_are_refused_and_what_is_coded_from_them(tmp_path, b_frames):
    """FFmpeg said nothing of damage while it decoded slices side by side, and gave a picture that nobody took."""
    whole = film(tmp_path / "a.mp4", options={"g": "16", "bf": b_frames, "sc_threshold": "0", "crf": "8"})
    order = [p.pts for p in av.open(str(whole)).demux(video=0) if p.size]
    hit = next(k for k, pts in enumerate(order) if pts == sorted(order)[6])

    def spoil(k, content):
        half = len(content) // 3
        return content if k != hit else content[:half] + bytes(b ^ 0x5A for b in content[half:])

    good, bad = io.frames(whole), io.frames(remuxed(whole, tmp_path / "b.mp4", spoil))
    refused = []
    for k in (*range(24), 20, 7, 3):
        try:
            picture = bad[k]
        except io.FileError:
            refused.append(k)
        else:
            np.testing.assert_array_equal(picture, good[k])
    with pytest.raises(io.FileError, match="frame 6 is not whole"):
        bad[6]
    assert set(range(6, 16)) <= set(refused)
    assert not {0, *range(16, 24)} & set(refused)
    assert 7 in refused[-2:]


def test_what_gaps_may_have_spoilt_goes_from_each_to_the_next_frame_that_is_coded_by_itself():
    keys = np.array([0, 10, 20])
    assert said_of({}, keys, 30) == ""
    assert said_of({10: 2}, keys, 30) == "by its time stamps the film lacks pictures: 2 before frame 10"
    assert said_of({13: 2}, None, 30) == "by its time stamps the film lacks pictures: 2 before frame 13"
    assert said_of({13: 2}, keys, 30).endswith("coded, frames 13 to 19 are coded from what is not there)")
    assert "frame 19 are coded" in said_of({19: 1}, keys, 30)
    assert "frames 25 to 29 and those behind other gaps are coded" in said_of({25: 1, 27: 1}, keys, 30)


def test_gaps_are_told_at_a_constant_rate_only():
    assert gaps_between([0, 512, 1024, 2560, 3072]) == {3: 2}
    assert gaps_between([0, 1, 2, 5, 6]) == {3: 2}
    assert gaps_between([0, 33, 67, 100, 133, 233, 267], rounded=True) == {5: 2}  # 30 a second in milliseconds
    assert gaps_between([0, 1, 2, 4, 5, 6, 8, 9], rounded=True) == {}  # 800 a second: rounding
    assert gaps_between([0, 40, 95, 130, 190, 220, 300]) == {}  # a rate that varies
    assert gaps_between([0, 512, 1024]) == {}
    assert gaps_between([0]) == {}


def test_notes_of_pictures_are_those_of_their_recordings(tmp_path):
    lossy, lossless = film(tmp_path / "a.mp4"), film(tmp_path / "b.mkv", "ffv1")
    ((address, note),) = io.notes_of(io.pictures([lossy, lossless]))
    assert address == str(lossy)
    assert "loses grey levels" in note
