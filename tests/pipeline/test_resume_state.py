"""What a stopped series hands on, when another version of windmark has written it."""

import pickle

import numpy as np
import pytest

from windmark.errors import DataError
from windmark.pipeline.journal_values import dumped
from windmark.pipeline.resume import Stopped
from windmark.tasks.follow import FollowedFrame


def test_what_was_handed_on_comes_back():
    frame = FollowedFrame(3, "f3", 3.0, "tracked", "")
    back = Stopped({}, {}, state=dumped({"index": 4, "frame": frame}, {})).handed_on({})
    assert back["index"] == 4
    assert (back["frame"].name, back["frame"].status) == ("f3", "tracked")
    assert np.isnan(back["frame"].time_s)
    assert Stopped({}, {}).handed_on({}) == {}


def test_a_noun_that_is_elsewhere_now_is_a_reason_and_no_fault():
    content = dumped({"frame": FollowedFrame(3, "f3", 3.0, "tracked", "")}, {})
    assert content.count(b"windmark.tasks.follow") == 1
    older = content.replace(b"windmark.tasks.follow", b"windmark.pipeline.trac")  # as long: lengths are in the pickle
    for state in (older, content[:-9], pickle.dumps(print)):
        with pytest.raises(DataError, match=r"written by another version of windmark, or is damaged .*--finish keeps"):
            Stopped({}, {}, state=state).handed_on({})
