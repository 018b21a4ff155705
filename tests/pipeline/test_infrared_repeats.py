"""A picture that repeats the one before is no measurement of its time: it is taken out, and told."""

from types import SimpleNamespace

import numpy as np

from windmark import io
from windmark.geometry import Camera, Pose
from windmark.pipeline.infrared.record import FAILED, REDUCED, FrameRecord
from windmark.pipeline.infrared.repeats import repeated_in, without_repeats
from windmark.pipeline.verdict import DOUBTFUL, GOOD
from windmark.pipeline.verdict.infrared import infrared_verdict
from windmark.tasks.deform.task import FrameImages, Shot, Station

TEST = SimpleNamespace(stations=[Station(n, Camera((4, 3), 9.0), Pose.identity()) for n in ("a", "b")])
TEST.station = lambda name: next(s for s in TEST.stations if s.name == name)


def frames(*contents, **more):
    """Frames of cameras a and b: numbers of their pictures, 0 where a camera has none."""
    out = []
    for k, own in enumerate(contents):
        images = {n: np.full((3, 4), v, np.uint16) for n, v in zip("ab", own, strict=True) if v}
        out.append(FrameImages(f"{k}", float(k), images, **more))
    return out


def left(given, before=()):
    return [(sorted(f.images), repeated_in(f)) for f in without_repeats(given, before, TEST)]


def test_pictures_that_are_new_are_left_as_they_are():
    given = frames((1, 2), (2, 1), (1, 2))
    assert [*without_repeats(given, (), TEST)] == given


def test_a_picture_that_repeats_the_one_before_is_missing_also_after_a_gap():
    given = frames((1, 5), (1, 6), (1, 6), (0, 7), (1, 8), (2, 8))
    both, b = ["a", "b"], ["b"]
    assert left(given) == [(both, ()), (b, ("a",)), ([], ("a", "b")), (b, ()), (b, ("a",)), (["a"], ("b",))]


def test_a_run_that_goes_on_knows_the_pictures_before():
    given = frames((1, 5), (0, 6), (1, 6), (2, 7))
    for k in range(len(given)):
        assert left(given[k:], given[:k]) == left(given)[k:]


def test_what_cannot_be_read_is_told_of_elsewhere_and_nearest_pictures_are_not_asked(tmp_path):
    (tmp_path / "x.tif").write_bytes(b"nothing")
    bad = FrameImages("0", 0.0, {"a": tmp_path / "x.tif"})
    assert [*without_repeats([bad, bad], (), TEST)] == [bad, bad]
    assert isinstance(bad.images["a"], io.PictureFile)
    near = frames((1, 2), (1, 3), shots={"a": (Shot(0.0, None),)})
    assert [*without_repeats(near, (), TEST)] == near


def records(repeated):
    same = {"pictures": {}, "seen": 0.3, "median_T": 300.0, "median_sigma_T": 0.1}
    return [FrameRecord(f"{k}", k, 0.1 * k, status=REDUCED, repeated=("b",) if k in repeated else (), **same)
            for k in range(100)]  # fmt: skip


def test_a_verdict_doubts_a_run_of_which_a_camera_dropped_more_than_some():
    assert infrared_verdict(records([7])).word == GOOD
    found = infrared_verdict(records([3, 5, 7, 9]))
    assert (found.word, found.cause) == (DOUBTFUL, "lost")
    assert found.reason == "4 of 100 pictures of b repeat the one before and do not count (frames 3, 5, 7, 9)"
    lost = [*records([]), FrameRecord("x", 100, 10.0, {}, FAILED, "r", repeated=("a", "b"))]
    assert infrared_verdict(lost).word == GOOD
