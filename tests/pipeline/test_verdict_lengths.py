"""Lengths that a project says itself are doubted where the model on the grid cannot have them, and else never."""

from dataclasses import replace

import numpy as np
import pytest

from windmark import synth
from windmark.pipeline.psp.entries import LoadsEntry, SectionEntry
from windmark.pipeline.verdict.lengths import lamp_findings, reference_findings, section_findings, wall_findings
from windmark.scene import Mesh

WING = Mesh.make(np.array([[0.0, 0, 0], [400, 0, 0], [400, 600, 0], [0, 600, 40]]), np.array([[0, 1, 2], [0, 2, 3]]))
LOADS = {"area": 95884.8, "chord": 181.6, "span": 600.0, "moment_point": (130.0, 0.0, 0.0)}


def doubted(unit="mm", mesh=WING, **other):
    """The keys that are doubted."""
    found = reference_findings(mesh, LoadsEntry(**{**LOADS, **other}), unit)
    assert all(f.cause == "units" for f in found)
    return [f.reason.split(" is ")[0] for f in found]


def test_a_reference_area_in_another_unit_is_doubted():
    assert doubted(span=None) == []
    assert doubted(area=1.0, chord=1.0, span=None) == []  # loads over the dynamic pressure
    assert doubted(area=0.0958848, chord=0.1816, span=None) == ["loads.area", "loads.chord"]
    (found,) = reference_findings(WING, LoadsEntry(area=148.6, chord=181.6), "mm")
    assert found.next_step == "give loads.area in mm²"


def test_a_span_in_another_unit_is_doubted_by_the_grid_or_beside_area_and_chord():
    assert doubted(span=0.6) == ["loads.span"]
    assert doubted(span=600e3) == ["loads.span"]
    inches = reference_findings(WING, LoadsEntry(**{**LOADS, "span": 600 / 25.4}), "mm")
    assert [f.reason for f in inches] == ["loads.area is 9.588e+04 mm², loads.chord times loads.span is 4290 mm²"]


@pytest.mark.parametrize("other", [
    {}, {"span": 1200.0}, {"span": 1.0}, {"area": 1.0, "span": 1.0, "chord": 1.0}, {"span": None},
])  # fmt: skip
def test_references_of_half_models_and_none_are_not_doubted(other):
    assert doubted(**other) == []


@pytest.mark.parametrize("chord", [60.0, 800.0])
def test_references_of_missiles_are_not_doubted(chord):
    body = replace(WING, vertices=WING.vertices * [2, 0.1, 1.5])
    assert doubted(mesh=body, area=np.pi * 30**2, chord=chord, span=60.0) == []


def test_a_moment_point_in_another_unit_is_doubted():
    assert doubted(moment_point=(0.13, 0.0, 0.0)) == ["loads.moment_point"]
    (found,) = reference_findings(WING, LoadsEntry(**{**LOADS, "moment_point": (0.13, 0.0, 0.0)}), "mm")
    assert "that is the origin and no place beside it; in m or ft it would be inside it" in found.reason
    assert doubted(moment_point=(130e3, 0.0, 0.0)) == ["loads.moment_point"]
    metres = replace(WING, vertices=WING.vertices / 1000)
    assert doubted("m", metres, area=0.0959, chord=0.1816, span=0.6) == ["loads.moment_point"]
    # The origin itself, but for rounding; a sting's balance behind the model; half a millimetre below the wing's plane.
    for point in ((0.0, 0.0, 0.0), (1e-13, 0.0, 0.0), (1500.0, 0.0, 0.0), (0.0, 0.0, -0.3), (2.0, 0.0, 1.0)):
        assert doubted(moment_point=point) == []


def cuts(*places, normal=(0.0, 1.0, 0.0)):
    return [SectionEntry(name=f"s{k}", point=tuple(y * n for n in normal), normal=normal) for k, y in enumerate(places)]


def test_sections_that_are_all_one_cut_and_spread_over_the_model_in_another_unit_are_doubted():
    (found,) = section_findings(WING, cuts(0.18, 0.33, 0.48), "mm")
    assert found.cause == "units"
    assert found.reason == ("sections s0, s1, s2 lie within 0.3 mm beside the origin, the model is 600 mm across them; "
                            "in m or ft they would spread over it")  # fmt: skip
    assert section_findings(WING, cuts(180.0, 330.0, 480.0), "mm") == []
    assert section_findings(WING, cuts(), "mm") == []


@pytest.mark.parametrize("places", [
    (0.1,), (0.0,), (-0.1, 0.1), (0.1, 180.0), (0.0, 180.0), (1e-9, 2e-9), (5.0, 9.0, 13.0), (0.2, 0.2),
])  # fmt: skip
def test_sections_beside_the_plane_of_symmetry_are_not_doubted(places):
    whole = replace(WING, vertices=WING.vertices - [0, 300, 0])
    assert section_findings(whole, cuts(*places), "mm") == []


def test_a_wall_whose_temperature_varies_from_node_to_node_is_doubted():
    (found,) = wall_findings(WING, 0.165, "mm")
    assert found.reason.startswith("temperature.length is 0.165 mm on a model of 720 mm")
    for length in (None, 5.0, 165.0, 1e9):
        assert wall_findings(WING, length, "mm") == []


def test_lamps_at_the_model_are_doubted():
    mesh = synth.wind_tunnel(11, size_px=(100, 80), nodes=1000, clutter=None, tip_fraction=0.03).mesh
    right = [(-350.0, 950.0, 1500.0), (800.0, 100.0, 1250.0)]
    assert lamp_findings(mesh, right, "mm") == []
    (found,) = lamp_findings(mesh, [right[0], (100.0, 100.0, 20.0)], "mm")
    assert found.cause == "units"
    assert found.reason.startswith("lamp 2 stands ")
    assert len(lamp_findings(mesh, np.array(right) * 1000, "mm")) == 2
