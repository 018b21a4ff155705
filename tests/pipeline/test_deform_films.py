"""Cameras whose films lack pictures: their frames keep the number of their instant."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.pipeline.deform.frames import instants_of

av = pytest.importorskip("av")


def film(path, lost=()):
    with av.open(str(path), "w") as out:
        stream = out.add_stream("rawvideo", rate=50)
        stream.width, stream.height, stream.pix_fmt = 32, 16, "gray"
        for k in range(8):
            packets = stream.encode(av.VideoFrame.from_ndarray(np.full((16, 32), k, np.uint8), "gray"))
            out.mux([] if k in lost else packets)
        out.mux(stream.encode())


def test_frames_behind_a_gap_are_paired_with_those_of_their_instant(tmp_path):
    """All frames behind a lost one were paired with those of the instant before: "cam2 is not where it should be"."""
    film(tmp_path / "cam1.mkv")
    film(tmp_path / "cam2.mkv", lost=(3, 5))
    cameras = tuple(
        SimpleNamespace(name=n, patterns=(f"{n}.mkv",), has_clock=False, times=None) for n in ("cam1", "cam2")
    )
    sequence = SimpleNamespace(rate_hz=50.0, clock=None, max_lag_s=None)
    found = instants_of(SimpleNamespace(path=tmp_path / "p.toml", camera=cameras, sequence=sequence))
    shown = {f.key: [int(f.images[n].read()[0, 0]) for n in ("cam1", "cam2") if n in f.images] for f in found.frames}
    assert shown == {str(k): [k] if k in (3, 5) else [k, k] for k in range(8)}
    assert any("cam2.mkv: by its time stamps the film lacks pictures: 1 before frame 3" in r for r in found.remarks)
    assert any("cam2: frames are counted with those that its film lacks" in r for r in found.remarks)
    assert not any("cam1" in r for r in found.remarks)
