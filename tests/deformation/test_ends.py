"""Laws that end within what a model does: the search comes back from there, or says where that was."""

import re

import numpy as np
import pytest

from windmark.deformation import Deformation, LawError, Volume, check_law, identify, law, laws_of_source
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet, Observations, View

X, Y = (v.ravel() for v in np.meshgrid([0.0, 40.0, 80.0], np.linspace(50.0, 400.0, 8)))
XYZ = np.column_stack([X, Y, 0.0 * X])
MARKERS = MarkerSet.make([f"m{i}" for i in range(24)], XYZ, volume="wing")
CAMERA, AWAY = Camera((640, 480), 800.0), Pose.look_at([300, 200, 700], [40, 200, 0], [0, 1, 0])

SOURCE = """import numpy as np
from windmark.deformation import law
@law(tip="mm")
def wing(xyz, tip):
    {end}
    return xyz + np.outer((xyz[:, 1] / 400.0) ** 2, [0.0, 0.0, tip])
"""
RAISES = "if tip < -4: raise ValueError('beyond the table')"
NO_NUMBERS = "tip = tip * np.sqrt(4.0 + tip) / np.sqrt(4.0 + tip)"


def law_of(end):
    with np.errstate(all="ignore"):
        return laws_of_source(SOURCE.format(end=end), "law.py")["wing"]


def state(own, tip):
    true = XYZ + np.outer((Y / 400.0) ** 2, [0.0, 0.0, tip])
    xy = CAMERA.project(AWAY.apply(true))[0]
    seen = Observations(np.zeros(24, dtype=int), np.arange(24), xy, np.tile(0.01 * np.eye(2), (24, 1, 1)))
    return identify(seen, MARKERS, [Volume("wing", own)], CAMERA, [View("cam1", cam_from_model=AWAY)],
                    free_motion=False)  # fmt: skip


@pytest.mark.parametrize(
    ("end", "words"),
    [
        (RAISES, r"law\.py:5: ValueError: beyond the table at wing\.tip = -\d"),
        (NO_NUMBERS, r"law of wing gives no numbers for 24 of its 24 markers at wing\.tip = -\d"),
    ],
)
def test_a_state_beyond_the_end_of_a_law_is_refused_with_what_the_law_said(end, words):
    own = law_of(end)
    answer = state(own, -9.0)
    assert not answer
    assert answer.cause == "law"
    assert re.search(words, answer.reason)
    near = state(own, -3.9)  # the search may step beyond and come back
    assert isinstance(near, Deformation)
    assert near.q == pytest.approx([-3.9], abs=1e-3)


@pytest.mark.parametrize("end", [RAISES, NO_NUMBERS])
def test_the_check_says_where_a_law_ends_on_either_side(end):
    (remark,) = check_law(law_of(end), XYZ)
    assert "has no place beyond tip = -4 mm" in remark
    assert "state a bound (lower)" in remark


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_check_finds_a_jump_on_either_side_far_from_the_start(side):
    jump = f"tip = tip + (0.5 if {side} * tip > 3.1 else 0.0)"
    with pytest.raises(LawError, match=f"is not continuous in tip near {3.1 * side}"):
        check_law(law_of(jump), XYZ)


def test_a_jump_within_a_stated_bound_is_found_and_one_beyond_it_is_none_of_its_business():
    def made(**bounds):
        @law(tip={"unit": "mm", **bounds})
        def wing(xyz, tip):
            return xyz + np.outer((xyz[:, 1] / 400.0) ** 2, [0.0, 0.0, tip + (0.5 if tip > 60.0 else 0.0)])

        return wing

    assert check_law(made(), XYZ) == ()
    assert check_law(made(upper=50.0), XYZ) == ()
    with pytest.raises(LawError, match="is not continuous in tip near 60"):
        check_law(made(upper=100.0), XYZ)


def test_kinks_tables_and_bends_far_from_the_start_are_no_jumps():
    smooth = (
        lambda tip: min(tip, 2.0), lambda tip: np.tanh(5.0 * tip), lambda tip: np.exp(tip) - 1.0,
        lambda tip: np.interp(tip, [-10.0, -2.0, 0.0, 1.0, 10.0], [-9.0, -3.0, 0.0, 2.0, 30.0]),
        lambda tip: tip + (np.sqrt(tip - 2.0) if tip > 2.0 else 0.0),
    )  # fmt: skip
    for bent in smooth:

        @law(tip="mm")
        def wing(xyz, tip, *, bent=bent):
            return xyz + np.outer((xyz[:, 1] / 400.0) ** 2, [0.0, 0.0, bent(tip)])

        assert not [remark for remark in check_law(wing, XYZ) if "effect" not in remark and "slope" not in remark]
