"""Times of the frames of an infrared run that contradict what its recordings say of themselves."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from windmark import io
from windmark.pipeline.deform.frames import FrameTable
from windmark.pipeline.deform.timeline import Timeline
from windmark.pipeline.infrared.times import frame_times
from windmark.tasks.deform.task import FrameImages

COUNT = 6


def asked(*, table=None, rate=None, recorded=None, kind="Photron", stamps=None, clock=""):
    """Times of six frames of one camera, by whatever says them."""
    frames = SimpleNamespace(kind=kind, time_s=None if recorded is None else np.arange(COUNT) * recorded)
    images = [{"cam1": Path("a.tif") if recorded is None else io.Frame(frames, k)} for k in range(COUNT)]
    line = Timeline([
        FrameImages(str(k), float(k), images[k], time_s=np.nan if stamps is None else k * stamps) for k in range(COUNT)
    ], clock)  # fmt: skip
    known = FrameTable() if table is None else FrameTable(tuple(map(str, range(COUNT))), np.arange(COUNT) * table)
    project = SimpleNamespace(path=Path("p.toml"), heat=None,
                              sequence=SimpleNamespace(rate_hz=rate, frames=None if table is None else Path("f.csv")))
    return frame_times(project, line, known)[0]


@pytest.mark.parametrize(("given", "words"), [
    ({"table": 50.0, "recorded": 0.05}, r"f\.csv: time_s: says 50 s from frame to frame, the pictures of cam1"),
    ({"table": 50.0, "stamps": 0.05}, "stamps 0.05 s apart: one of them is wrong, or times are not in seconds"),
    ({"rate": 2000.0, "recorded": 0.05}, r"p\.toml: time_s: says 0.0005 s from frame to frame"),
])  # fmt: skip
def test_times_that_the_recording_contradicts_are_refused(given, words):
    with pytest.raises(io.FileError, match=words):
        asked(**given)


@pytest.mark.parametrize("given", [
    {"table": 0.05, "recorded": 0.0499}, {"rate": 20.0, "recorded": 0.05}, {"table": 0.05, "stamps": 0.05},
    {"table": 0.05}, {"table": 0.05, "recorded": 0.04, "kind": "film (ffv1)"}, {"stamps": 0.05, "clock": "cam1"},
    {"table": 0.001, "recorded": 0.04, "kind": "film (ffv1)"},
])  # fmt: skip
def test_times_that_agree_and_a_film_that_is_shown_slowly_are_taken(given):
    assert np.isfinite(asked(**given)).all()
