"""Why a state is none of the model."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from windmark.deformation import Volume, Volumes, function_law
from windmark.geometry import Pose
from windmark.pipeline.verdict.reasons import told_by
from windmark.scene import Doubt
from windmark.tasks.deform.memory import Memory, predicted
from windmark.tasks.deform.states import both_reasons, implausible

BENT = Doubt(("wing",), "law of {} too simple: what is left looks like twist of 0.7 deg at W31", "bent")
MOVED = Doubt(("a",), "{} lost 19 of its 44 spots: it moved, or has wrong labels", "picture")
MARKER = Doubt(("W03",), "{} is 0.4 mm from where its table has it", "marker")
@dataclass(frozen=True)
class Deformed:
    """What a prediction takes of a state."""

    volumes: Any
    placed: Any
    q: Any
    tunnel_from_model: Any
    cam_from_tunnel: Any


MANY = "30 of 100 spots contradict the others"


@pytest.mark.parametrize(("doubts", "words"), [
    ((), MANY),
    ((MARKER,), MANY),
    ((MARKER, BENT), f"law of wing too simple: what is left looks like twist of 0.7 deg at W31 ({MANY})"),
    ((BENT, MOVED), f"a lost 19 of its 44 spots: it moved, or has wrong labels ({MANY})"),
])  # fmt: skip
def test_what_its_doubts_tell_is_the_reason(doubts, words):
    """A wing that twists under a law that only bends gave "30 of 100 spots contradict the others" and no next step."""
    state = SimpleNamespace(rms_px=0.5, used=np.arange(100) >= 30, doubts=doubts)
    assert implausible(state) == words
    assert implausible(SimpleNamespace(rms_px=0.5, used=np.arange(100) >= 20, doubts=doubts)) is None


def test_both_looks_are_told_once_where_a_law_lacks_something():
    lacks = f"{BENT} ({MANY})"
    assert both_reasons(MANY, lacks) == lacks
    assert both_reasons(lacks, MANY) == f"{lacks}; {MANY}"
    assert both_reasons("", MANY) == MANY
    cause, step = told_by(lacks)
    assert cause == "bent"
    assert "windmark laws" in step


def test_a_prediction_stays_where_its_law_gives_places():
    """A law with an arcsin has none beyond some bending; a wing that speeds towards it was predicted there, and the
    series ended."""
    wing = Volume("wing", function_law(lambda xyz, tip: xyz + np.array([0, 0, 1]) * (tip if tip < 5 else np.nan), {}))
    volumes = Volumes.of([wing])
    xyz = np.eye(3)
    state = Deformed(volumes, volumes.bind(xyz, np.array(["wing"] * 3)), np.array([4.0]), Pose.identity(), {})
    for speed, there in ((0.5, 4.5), (2.0, 4.0)):
        found = predicted(Memory(state, 0.0, {"law": np.array([speed])}), 1.0)
        assert found.q == pytest.approx([there])
