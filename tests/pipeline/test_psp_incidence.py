"""Every picture has the incidence of its own state: of one that is another point's, the point says so."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.errors import DataError
from windmark.paint import LoadReference, NodeField, integrate_loads
from windmark.pipeline.psp import REDUCED, PointRecord
from windmark.pipeline.psp.entries import TableEntry
from windmark.pipeline.psp.incidence import (
    apart_deg,
    at_incidence,
    of_one_state,
    pitch_sigma_deg,
)
from windmark.pipeline.psp.pictures import Found
from windmark.pipeline.verdict import DOUBTFUL, GOOD
from windmark.pipeline.verdict.paint import psp_verdict
from windmark.scene import Mesh
from windmark.tasks.psp import Scatter
from windmark.tasks.psp.loads import between_incidences

ENTRY = TableEntry(table="points.csv")


def found(*alphas):
    """Pictures by two cameras of states at these incidences."""
    def state(alpha):
        rotation = np.eye(3)
        rotation[0, 2] = np.sin(np.radians(alpha))
        return SimpleNamespace(tunnel_from_model=SimpleNamespace(rotation=rotation))

    pictures = [(SimpleNamespace(name=f"{k}-{c}", camera=c), k) for k in range(len(alphas)) for c in "xy"]
    names = tuple(p.name for p, _ in pictures)
    return Found(tuple(p for p, _ in pictures), tuple(map(state, alphas)), tuple(map(float, range(len(alphas)))),
                 names=names, followed=tuple(range(len(alphas))), instants=tuple(k for _, k in pictures))  # fmt: skip


def test_pictures_at_the_tables_incidence_are_left_as_they_are():
    given = found(2.03, 1.9, 2.2)
    kept, alpha = at_incidence(ENTRY, 2.0, given)
    assert kept is given
    assert alpha == pytest.approx(2.03)
    assert of_one_state(ENTRY, given, "wind-off") is given


@pytest.mark.parametrize("at", [0, 2])
def test_those_of_another_incidence_do_not_count_and_are_named(at):
    alphas = [2.0, 2.1, 2.05]
    alphas[at] = 4.0
    kept, alpha = at_incidence(ENTRY, 2.0, found(*alphas))
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
