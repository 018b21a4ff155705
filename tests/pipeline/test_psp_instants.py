"""Pictures of several cameras are of one instant by their numbers, not by their places in the lists."""

import numpy as np

from windmark.pipeline.psp.instants import alone_words, by_instant, in_order
from windmark.pipeline.psp.taken import Taken
from windmark.tasks.psp.levels import _mean_columns


def taken(camera, *keys):
    return [Taken(f"{camera}-{key}.tif", None, key=key) for key in keys]


def names(instants):
    return [{camera: picture.key for camera, picture in of.items()} for of in instants]


def test_all_there_are_paired_as_they_are_and_nothing_is_said():
    raw = {"a": taken("a", "0", "1", "2"), "b": taken("b", "0", "1", "2")}
    paired = by_instant(raw)
    assert names(paired) == [{"a": k, "b": k} for k in "012"]
    assert alone_words("wind-on", paired, list(raw)) == {}


def test_a_missing_picture_leaves_its_partner_alone_and_no_other():
    raw = {"a": taken("a", "0", "1", "2"), "b": taken("b", "1", "2")}
    paired = by_instant(raw)
    assert names(paired) == [{"a": "0"}, {"a": "1", "b": "1"}, {"a": "2", "b": "2"}]
    assert alone_words("wind-on", paired, list(raw)) == {
        "wind-on pictures of b": "1 of 3 are not there; what other cameras show then counts alone: a-0.tif"
    }


def test_ten_is_after_two():
    assert [p.key for p in in_order(taken("a", "1", "10", "2"))] == ["1", "2", "10"]
    assert [p.name for p in in_order(taken("a", "1", "1", "0"))] == ["a-1.tif", "a-1.tif", "a-0.tif"]
    assert [next(iter(of.values())).key for of in by_instant({"a": taken("a", "10", "2")})] == ["2", "10"]


def test_cameras_that_each_count_for_themselves_are_paired_by_place():
    assert names(by_instant({"a": taken("a", "0", "1"), "b": taken("b", "700", "701")})) == [
        {"a": "0", "b": "700"}, {"a": "1", "b": "701"}
    ]  # fmt: skip
    assert len(by_instant({"a": taken("a", "0", "0"), "b": taken("b", "0", "1")})) == 2
    # One counts from 0, the other from 1; with a gap in either the numbers are those of the instants.
    counted = {"a": taken("a", "0", "1", "2"), "b": taken("b", "1", "2", "3")}
    assert names(by_instant(counted)) == [{"a": "0", "b": "1"}, {"a": "1", "b": "2"}, {"a": "2", "b": "3"}]
    lacking = {"a": taken("a", "0", "1", "3"), "b": taken("b", "1", "2", "3")}
    assert names(by_instant(lacking)) == [{"a": "0"}, {"a": "1", "b": "1"}, {"b": "2"}, {"a": "3", "b": "3"}]


def test_states_that_leave_other_directions_open_have_columns_of_their_own():
    rng = np.random.default_rng(1)
    columns = [rng.normal(size=(4, width)) for width in (3, 3, 5)]
    even = _mean_columns(columns[:2], [3])
    assert (even == np.mean(columns[:2], axis=0) / np.sqrt(2)).all()
    mixed = _mean_columns(columns, [3, 5])
    assert mixed.shape == (4, 8)
    assert np.allclose(mixed[:, :3], np.sum(columns[:2], axis=0) / (3 * np.sqrt(2)))
    assert np.allclose(mixed[:, 3:], columns[2] / 3)
    assert _mean_columns(columns[:2], [3, 5]).shape == (4, 8)
