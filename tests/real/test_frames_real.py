"""A real recording of a high-speed camera, bit for bit, against the figures of its README."""

from __future__ import annotations

import numpy as np
import pytest

from windmark import io


@pytest.mark.parametrize("name", ["12bitMRAW.mraw", "12bitMRAW.cih"])
def test_photron_recording(shared_data, name):
    path = shared_data / "photron-mraw" / name
    if not path.is_file():
        pytest.skip("the set photron-mraw is absent")
    with io.frames(path) as frames:
        assert (len(frames), frames.size_px, frames.dtype, frames.bits) == (2, (1024, 1024), np.uint16, 12)
        assert (int(frames[0].min()), int(frames[0].max())) == (0, 4095)
        assert [int(f.sum(dtype=np.int64)) for f in frames] == [1761301424, 1763922266]
        assert int(frames[0][512, 512]) == 2279
        assert int(frames[1][100, 200]) == 1290
        np.testing.assert_allclose(frames.time_s, [0, 0.001])
        assert frames.start == "2020-09-01T10:34"
    # Unpacked in the wrong order neighbours would differ by the lower bits of each other: combing along the rows.
    picture = io.read_image(f"{path}[1]").astype(float)
    along, across = (np.abs(np.diff(picture, axis=a)).mean() for a in (1, 0))
    assert 0.8 < along / across < 1.25
