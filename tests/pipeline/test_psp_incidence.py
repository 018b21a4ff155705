"""Every picture has the incidence of its own state: of one that is another point's, the point says so."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from windmark.errors import DataError
from windmark.paint import LoadReference, NodeField, integrate_loads
from windmark.pipeline.psp import REDUCED, PointRecord
from windmark.pipeline.psp.entries import TableEntry
from windmark.pipeline.psp.incidence import (
    SIDESLIP,
    apart_deg,
    at_incidence,
    of_one_state,
    pitch_sigma_deg,
    seen_angles,
    unsaid_sideslip,
)
from windmark.pipeline.psp.pictures import Found
from windmark.pipeline.verdict import DOUBTFUL, GOOD
from windmark.pipeline.verdict.paint import psp_verdict
from windmark.scene import Mesh
from windmark.tasks.psp import Scatter
from windmark.tasks.psp.loads import between_incidences

ENTRY = TableEntry(table="points.csv")


def found(*alphas, betas=None, rest=(0.0, 0.0)):
    """Pictures by two cameras of states at these incidences, and sideslips, of a model at ``rest``."""
    def axes(alpha, beta):
        return LoadReference(1, 1, 1, alpha_deg=alpha, beta_deg=beta).wind_axes()

    def state(alpha, beta):
        # The wind's axes in the model are turned from those at rest to those of the state.
        return SimpleNamespace(tunnel_from_model=SimpleNamespace(rotation=axes(*rest).T @ axes(alpha, beta)))

    pictures = [(SimpleNamespace(name=f"{k}-{c}", camera=c), k) for k in range(len(alphas)) for c in "xy"]
    names = tuple(p.name for p, _ in pictures)
    states = tuple(map(state, alphas, betas or [0.0] * len(alphas)))
    return Found(tuple(p for p, _ in pictures), states, tuple(map(float, range(len(alphas)))),
                 names=names, followed=tuple(range(len(alphas))), instants=tuple(k for _, k in pictures))  # fmt: skip


def test_pictures_at_the_tables_incidence_are_left_as_they_are():
    given = found(2.03, 1.9, 2.2)
    kept, angles = at_incidence(ENTRY, 2.0, given)
    assert kept is given
    assert angles == pytest.approx((2.03, 0.0), abs=1e-9)
    assert of_one_state(ENTRY, given, "wind-off") is given


@pytest.mark.parametrize("at", [0, 2])
def test_those_of_another_incidence_do_not_count_and_are_named(at):
    alphas = [2.0, 2.1, 2.05]
    alphas[at] = 4.0
    kept, (alpha, _) = at_incidence(ENTRY, 2.0, found(*alphas))
    others = [k for k in range(3) if k != at]
    assert [p.name for p in kept.pictures] == [f"{k}-{c}" for k in others for c in "xy"]
    assert kept.rms_px == tuple(map(float, others))
    assert kept.instants == (0, 0, 1, 1)
    assert len(kept.names) == 6
    assert alpha == pytest.approx(alphas[others[0]])
    assert [b.name for b in kept.bad] == [f"{at}-x", f"{at}-y"]
    why = "it shows an incidence of 4.00 degrees, the table of points says 2: it is of another point"
    assert kept.bad[0].why == why
    assert kept.several == (f"2 of 6 pictures show another incidence (4.00 degrees) than the table of points says (2) "
                            f"and do not count: {at}-x, {at}-y",)  # fmt: skip


def test_most_of_another_incidence_refuse_the_point():
    with pytest.raises(DataError, match=r"^2 of 3 of its pictures show an incidence of 4\.00 degrees, the table of"):
        at_incidence(ENTRY, 2.0, found(2.0, 4.0, 4.1))
    with pytest.raises(DataError, match=r"^its pictures show an incidence of 4\.00 degrees.*were exchanged"):
        at_incidence(ENTRY, 2.0, found(4.0, 4.0))


def test_wind_off_pictures_of_several_incidences_are_said():
    told = of_one_state(ENTRY, found(0.0, 0.0, 2.0), "wind-off").several
    assert told == ("wind-off pictures are of several states: the incidence is 0.00 degrees in 0-x and 2.00 in 2-x",)


def test_angles_are_those_of_the_wind_in_the_models_axes_at_rest_or_not():
    """Also far from zero, where the sine of the pitch is no incidence any more."""
    for alpha, beta in ((4.0, 5.0), (30.0, -15.0), (-8.0, 0.0)):
        np.testing.assert_allclose(seen_angles(ENTRY, found(alpha, betas=[beta]).states), [[alpha, beta]], atol=1e-9)
        entry = TableEntry(table="points.csv", alpha_at_rest_deg=3.0, beta_at_rest_deg=2.0)
        states = found(alpha, betas=[beta], rest=(3.0, 2.0)).states
        np.testing.assert_allclose(seen_angles(entry, states), [[alpha, beta]], atol=1e-9)
    nose_up, nose_to_starboard = (Rotation.from_euler(axis, angle, degrees=True).as_matrix() for axis, angle in
                                  (("y", 4.0), ("z", -5.0)))  # fmt: skip
    states = tuple(SimpleNamespace(tunnel_from_model=SimpleNamespace(rotation=r)) for r in (nose_up, nose_to_starboard))
    np.testing.assert_allclose(seen_angles(ENTRY, states), [[4.0, 0.0], [0.0, -5.0]], atol=1e-9)


def test_a_sideslip_that_the_table_says_is_compared_as_the_incidence_is():
    given = found(2.0, 2.1, betas=[-5.1, -4.9])
    kept, angles = at_incidence(ENTRY, 2.0, given, beta_deg=-5.0)
    assert kept is given
    assert angles == pytest.approx((2.0, -5.1))
    with pytest.raises(DataError, match=r"^its pictures show a sideslip of -5\.10 degrees, the table of points says 0"):
        at_incidence(ENTRY, 2.0, given, beta_deg=0.0)
    with pytest.raises(DataError, match=r"says 5: its sign is the other one .*points\.beta_at_rest_deg") as turned:
        at_incidence(ENTRY, 2.0, given, beta_deg=5.0)
    failed = PointRecord("p1", 2.0, {}, "failed", str(turned.value))
    assert psp_verdict([failed]).next_step.startswith("turn the sign of beta_deg")
    one = found(2.0, 2.0, 4.0, betas=[0.1, 5.0, 0.1])
    with pytest.raises(DataError, match=r"^2 of 3 of its pictures show a sideslip of 5\.00 degrees"):
        at_incidence(ENTRY, 2.0, one, beta_deg=0.0)
    kept, _ = at_incidence(ENTRY, 2.0, found(2.0, 2.0, 2.0, betas=[0.1, 5.0, 0.1]), beta_deg=0.0)
    assert [p.name for p in kept.pictures] == ["0-x", "0-y", "2-x", "2-y"]
    assert kept.bad[0].why == "it shows a sideslip of 5.00 degrees, the table of points says 0: it is of another point"
    assert "show another sideslip (5.00 degrees) than the table of points says (0)" in kept.several[0]


def test_a_sideslip_that_no_table_says_is_told_and_doubts_loads():
    given = found(2.0, 2.0, betas=[-5.0, -5.0])
    assert at_incidence(ENTRY, 2.0, given)[0] is given
    assert unsaid_sideslip(ENTRY, -5.0, -5.0) == []
    assert unsaid_sideslip(ENTRY, float("nan"), 0.4) == []
    (words,) = unsaid_sideslip(ENTRY, float("nan"), -5.0)
    assert words.startswith(f"{SIDESLIP} of -5.00 degrees, of which the table of points says nothing")
    point = PointRecord(**{**vars(POINT), "remarks": (words,)})
    assert psp_verdict([point]).word == GOOD
    verdict = psp_verdict([PointRecord(**{**vars(point), "loads": {"all": {}}})])
    assert (verdict.word, verdict.reason) == (DOUBTFUL, words)
    told = of_one_state(ENTRY, found(2.0, 2.0, betas=[0.0, 5.0]), "wind-on").several
    assert told == ("wind-on pictures are of several states: the sideslip is 0.00 degrees in 0-x and 5.00 in 1-x",)


POINT = PointRecord("p1", 0.0, {}, REDUCED, seen=0.9, median_sigma_cp=0.01, flicker=0.01)
GROUPS = (("a", "b"), ("c", "d"))


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"several": ("2 of 6 pictures show another incidence",)}, "2 of 6 pictures show"),
        ({"scatter": (Scatter(1.0, 0.001, GROUPS), Scatter(18.0, 0.027, GROUPS))},
         "differ by 2.7 % of the light from one to the other, 18 times their noise: a, b from c, d"),
        ({"flicker": 0.07}, "the light differs by 7 % from picture to picture"),
    ],
)  # fmt: skip
def test_a_point_of_several_states_is_doubted(more, words):
    verdict = psp_verdict([PointRecord(**{**vars(POINT), **more})])
    assert verdict.word == DOUBTFUL
    assert words in verdict.reason


def test_noise_large_or_small_is_no_doubt():
    for scatter in (Scatter(1.4, 0.04, GROUPS), Scatter(6.0, 0.004, GROUPS)):
        assert psp_verdict([PointRecord(**{**vars(POINT), "scatter": (scatter,)})]).word == GOOD


def pitched(alpha, sigma_deg=0.01):
    """A state whose motion is known to this sigma in every turn."""
    state = found(alpha).states[0]
    s, c = np.sin(np.radians(alpha)), np.cos(np.radians(alpha))
    state.tunnel_from_model.rotation = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    state.slices, state.cov = {"motion": slice(2, 8)}, np.eye(8) * np.radians(sigma_deg) ** 2
    return state


def test_the_incidence_has_the_sigma_of_its_motion():
    assert pitch_sigma_deg(pitched(4.0)) == pytest.approx(0.01)
    held = pitched(4.0)
    held.slices = {}
    assert pitch_sigma_deg(held) == 0


def test_what_pictures_and_table_differ_by_within_the_limit_is_in_the_loads():
    states = tuple(pitched(a) for a in (4.0, 4.002, 3.998))
    assert apart_deg(ENTRY, 4.0, states) == 0
    assert apart_deg(ENTRY, 4.015, states) == 0  # within twice the sigma
    apart = apart_deg(ENTRY, 4.45, states)
    assert apart == pytest.approx(-0.45)
    plate = Mesh.make([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], "wing")
    at = {a: LoadReference(2.0, 2.0, 1.0, alpha_deg=a) for a in (4.0, 4.45)}
    cp = NodeField.make(np.full(4, -0.5)).with_mode("taps", np.full(4, 0.005))
    right, wrong = (integrate_loads(plate, cp, of) for of in at.values())
    said: list[str] = []
    assert between_incidences(wrong, at[4.45], 0.0, said) is wrong
    assert between_incidences(wrong, at[4.45], 0.05, said) is wrong  # within the sigma: a sting bends by as much
    assert said == []
    done = between_incidences(wrong, at[4.45], apart, said)
    assert said[0].startswith("the pictures show an incidence of 4.00 degrees, the table of points says 4.45: loads")
    for name in ("CD", "CL", "CC"):
        (value, sigma), (true, _) = done.row("wing")[name], right.row("wing")[name]
        assert abs(value - true) <= 1.96 * sigma
    assert done.row("wing")["CD"][1] == pytest.approx(0.5 * np.radians(0.45) / np.sqrt(2), rel=0.02)
    assert done.row("wing")["CN"] == wrong.row("wing")["CN"]
    assert done.dominant("all", "CD")[0][0] == "incidence"
