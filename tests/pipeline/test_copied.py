"""A picture of a job that is another one of it, whatever its file is called."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.geometry import Camera
from windmark.pipeline.results import ImageResult, RunResult
from windmark.pipeline.same_picture import copies_among, shown_by
from windmark.pipeline.verdict import DOUBTFUL
from windmark.pipeline.verdict.run import run_verdict

CAMERA = Camera((80, 60), 100.0)


def exposures(count: int, seed: int = 1) -> list[np.ndarray]:
    """Of one state: they differ by their noise alone."""
    rng = np.random.default_rng(seed)
    return [np.rint(rng.normal(1000, 3, (60, 80))).astype(np.uint16) for _ in range(count)]


def test_wind_on_that_is_wind_off_is_named():
    """Both were registered, every ratio was exactly 1, and that was good."""
    off, other = exposures(2)
    images = tuple(ImageResult(name, image, CAMERA) for name, image in [("off", off), ("on", off.copy()), ("b", other)])
    verdict = run_verdict(RunResult(SimpleNamespace(length_unit="mm", section=()), None, None, images, {}))
    (found,) = [f for f in verdict.findings if "same picture" in f.reason]
    assert (found.word, found.cause, found.where) == (DOUBTFUL, "file", "on")
    assert "it is the same picture as off, pixel by pixel" in found.reason


@pytest.mark.parametrize("blank", [np.zeros((60, 80), np.uint8), np.full((60, 80), 7.0)])
def test_two_exposures_are_none_and_pictures_that_show_nothing_tell_nothing(blank):
    many = [(str(k), shown_by(image)) for k, image in enumerate(exposures(40))]
    assert copies_among(many) == []
    assert shown_by(blank) == b""
    assert copies_among([("a", shown_by(blank)), ("b", shown_by(blank))]) == []
    assert copies_among([*many, ("once more", many[3][1]), ("and", many[3][1])]) == [("once more", "3"), ("and", "3")]
