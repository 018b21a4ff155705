"""A paint test's point from arrays: sampling with noise and pose errors, lamps, calibration modes, sides seen."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.errors import DataError
from windmark.geometry import Camera, Pose
from windmark.paint import LoadReference, NodeField, SternVolmer, fit_paint, pressure_map
from windmark.scene import Mesh, structured_triangles
from windmark.tasks.psp import (
    UNSEEN_SIDE,
    Lamp,
    ModelPicture,
    Patches,
    Sampling,
    SectionWanted,
    cut_sections,
    ratio_of,
    sample_picture,
    section_loads,
    seen_loads,
    seen_sides,
    shown_areas,
    two_colours,
)
from windmark.tasks.psp.few_modes import COLUMNS, pressure_of
from windmark.tasks.psp.lamps import lit

CAMERA = Camera((160, 120), 200.0)
ABOVE = Pose.look_at(np.array([0.0, 0.0, 100.0]), np.zeros(3), [0.0, 1.0, 0.0])
"""Two pixels per unit."""


def plate(n=15, size=40.0):
    x, y = np.meshgrid(np.linspace(-size / 2, size / 2, n), np.linspace(-size / 2, size / 2, n))
    xyz = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    return Mesh.make(xyz, structured_triangles(n, n), "wing")


def picture(light, variance=0.0, mesh=None, name="a", moves=None, camera="cam1"):
    mesh = plate() if mesh is None else mesh
    moves = np.zeros((len(mesh.vertices), 3, 1)) if moves is None else moves
    return ModelPicture(name, camera, light, np.broadcast_to(variance, light.shape), CAMERA, ABOVE, mesh, moves)


def slope(per_px=2.0):
    return 500 + per_px * np.arange(160)[None].repeat(120, axis=0).astype(float)


def test_values_lie_on_the_surface_where_it_is_and_nothing_at_its_rim():
    mesh = plate()
    seen = sample_picture(picture(slope()), Sampling(edge_px=3))
    xy, _ = CAMERA.project(ABOVE.apply(mesh.vertices))
    on = np.isfinite(seen.value)
    np.testing.assert_allclose(seen.value[on], 500 + 2 * xy[on, 0], rtol=1e-6)
    inner = (np.abs(mesh.vertices[:, :2]) < 17).all(axis=1)
    assert on[inner].all()
    rim = (np.abs(mesh.vertices[:, :2]) > 19.9).any(axis=1)
    assert not on[rim].any()
    assert (seen.weight[on] > 0).all()


@pytest.mark.parametrize("values", ["nearest", "linear", "cubic", "footprint"])
def test_the_variance_is_that_of_the_noise(values):
    rng, how = np.random.default_rng(4), Sampling(values=values)
    found = [sample_picture(picture(slope() + 5 * rng.standard_normal((120, 160)), 25.0), how) for _ in range(150)]
    true = sample_picture(picture(slope(), 25.0), how)
    on = np.isfinite(true.value)
    square = np.mean([(f.value[on] - true.value[on]) ** 2 / f.variance[on] for f in found], axis=0)
    assert np.mean(square) == pytest.approx(1, abs=0.04)
    assert (np.abs(square - 1) < 0.5).all()


def test_all_pixels_of_a_node_have_far_less_noise_than_those_round_it():
    """36 pixels each; the plane through them has the noise of their mean."""
    variance = {kind: np.nanmedian(sample_picture(picture(slope(), 25.0), Sampling(values=kind)).variance)
                for kind in ("nearest", "linear", "cubic", "footprint")}  # fmt: skip
    assert variance["nearest"] == 25
    assert variance["footprint"] == pytest.approx(25 / 33, rel=0.15)
    assert variance["footprint"] < 0.1 * variance["linear"] < 0.1 * variance["cubic"]


@pytest.mark.parametrize("values", ["linear", "footprint"])
def test_what_is_no_paint_does_not_count_for_the_nodes_beside_it(values):
    """A dark marker of 2 units between nodes 2.9 apart, from its own side only."""
    mesh = plate()
    x, y = np.mgrid[:120, :160][::-1]
    light = np.where((x - 83) ** 2 + (y - 60) ** 2 < 4**2, 100.0, 500.0)
    at = CAMERA.project(ABOVE.apply(np.array([[1.5, 0.0, 0.0]])))[0][0]
    assert np.abs(at - [83, 60]).max() < 1
    place, radius, up = np.array([[1.5, 0.0, 0.0]]), np.array([2.6]), np.array([[0.0, 0.0, 1.0]])
    near = np.linalg.norm(mesh.vertices - place, axis=1)
    beside = (near > 2.6) & (near < 6)
    patches = {side: Patches(mesh, place, radius, side * up) for side in (1, -1)}
    seen = {side: sample_picture(picture(light), Sampling(values=values, patches=of)) for side, of in patches.items()}
    np.testing.assert_allclose(seen[1].value[beside], 500)
    assert (np.abs(seen[-1].value[beside] - 500).max() > 20) == (values == "footprint")


def test_pose_errors_move_values_along_the_pictures_slope():
    mesh = plate()
    moves = np.zeros((len(mesh.vertices), 3, 2))
    moves[:, 0, 0], moves[:, 1, 1] = 0.1, 0.3  # one sigma: 0.1 units along x, 0.3 along y; 2 px per unit
    columns = sample_picture(picture(slope(), moves=moves), Sampling()).columns
    on = np.abs(columns[:, 0]) > 0
    assert on.sum() > 100
    np.testing.assert_allclose(np.abs(columns[on, 0]), 2.0 * 0.1 * 2, rtol=1e-3)
    np.testing.assert_allclose(columns[on, 1], 0, atol=1e-3)


def test_pixels_that_cannot_be_used_leave_their_nodes_out():
    light = slope()
    light[40:60, 60:80] = np.nan
    seen = sample_picture(picture(light), Sampling())
    xy, _ = CAMERA.project(ABOVE.apply(plate().vertices))
    hole = (xy > [60, 40]).all(axis=1) & (xy < [79, 59]).all(axis=1)
    assert hole.sum() > 5
    assert np.isnan(seen.value[hole]).all()


def test_the_ratio_is_formed_on_the_model_and_pictures_may_move_and_flicker():
    """The model is 6 px aside with wind; its paint has a pattern, the wind takes away 30 % of the light."""
    mesh, rng = plate(), np.random.default_rng(2)
    shift = Pose(np.eye(3), np.array([3.0, 0.0, 0.0]))

    def shown(mesh, dim, lamp):
        x = np.arange(160)[None].repeat(120, axis=0)
        centre = CAMERA.project(ABOVE.apply(mesh.vertices.mean(axis=0)[None]))[0][0, 0]
        light = lamp * dim * (2000 + 300 * np.sin((x - centre) / 15))
        return light + np.sqrt(light) * rng.standard_normal(light.shape), light

    on, off = [], []
    for lamp in (0.99, 1.0, 1.01):
        noisy, light = shown(mesh.moved(shift.apply(mesh.vertices)), 0.7, lamp)
        on.append(picture(noisy, light, mesh.moved(shift.apply(mesh.vertices)), f"on {lamp}"))
        noisy, light = shown(mesh, 1.0, lamp)
        off.append(picture(noisy, light, mesh, f"off {lamp}"))
    got = ratio_of(on, off)
    known = got.ratio.known
    assert known.sum() > 100
    # From node to node: what the lamps leave open is the same for all.
    z = (got.ratio.value[known] - 1 / 0.7) / np.sqrt(got.ratio.white[known])
    assert abs(np.mean(got.ratio.value[known]) * 0.7 - 1) < 0.01
    alone = (got.ratio.value[known] * 0.7 - 1) / (0.7 * np.sqrt(got.ratio.white[known]))
    assert np.abs(z).max() < 3.6
    assert 0.8 < alone.std() < 1.25  # the lamps' part is the same for all nodes
    assert not got.left_out
    unmoved = ratio_of(on, [picture(p.light, p.variance, on[0].mesh, p.name) for p in off])
    assert np.nanstd(unmoved.ratio.value) > 2 * np.nanstd(got.ratio.value)


def test_the_lamps_mode_is_larger_where_few_pictures_show_the_flicker():
    """Student's factor by the pictures of one camera: what another camera sees is the same flicker again."""
    rng, lamps = np.random.default_rng(6), np.array([0.99, 1.0, 1.01])

    def shown(count, camera):
        return [picture(v * slope() * (1 + 1e-4 * rng.standard_normal((120, 160))), 1e-2, name=f"{camera} {v}",
                        camera=camera) for v in lamps[:count]]  # fmt: skip

    for cameras in (("cam1",), ("cam1", "cam2")):
        got = ratio_of([p for c in cameras for p in shown(3, c)], [p for c in cameras for p in shown(3, c)])
        assert got.flicker == pytest.approx(0.01, rel=0.05)
        column = got.ratio.modes[:, got.ratio.names.index("lamps")][got.ratio.known]
        np.testing.assert_allclose(column, 2.776 / 1.96 * 0.01 * np.sqrt(2 / 3), rtol=0.1)


def test_a_flicker_known_beforehand_counts_unless_pictures_contradict_it():
    rng = np.random.default_rng(8)

    def shown(lamps):
        return [picture(v * slope() * (1 + 1e-4 * rng.standard_normal((120, 160))), 1e-2, name=f"{v}") for v in lamps]

    def lamps_of(got):
        return got.ratio.modes[:, got.ratio.names.index("lamps")][got.ratio.known]

    one = ratio_of(shown([1.0]), shown([1.0]))
    assert np.isnan(one.flicker)
    assert "lamps" not in one.ratio.names
    assert two_colours(one, one).flicker == 0
    got = ratio_of(shown([1.0]), shown([1.0]), flicker=0.002)
    assert got.flicker == 0.002
    np.testing.assert_allclose(lamps_of(got), 0.002 * np.sqrt(2), rtol=1e-2)
    uneven = [0.99, 1.0, 1.01]
    for known, counts, factor in ((0.02, 0.02, 1), (0.006, 0.006, 1), (0.002, 0.01, 2.776 / 1.96), (0.0, 0.01, 1.416)):
        got = ratio_of(shown(uneven), shown(uneven), flicker=known)
        assert got.flicker == pytest.approx(counts, rel=0.05)
        np.testing.assert_allclose(lamps_of(got), factor * counts * np.sqrt(2 / 3), rtol=0.1)


def test_what_all_pictures_of_a_camera_err_by_stays_in_their_mean():
    """Dark and flat are the same pixels' error in each of five pictures."""
    rng, mesh, z = np.random.default_rng(9), plate(), []
    for _ in range(16):
        same = 3 * rng.standard_normal((120, 160))
        # Wind-off from elsewhere on the sensor: another error.
        on, off = ([replace(picture(slope() + e + 4 * rng.standard_normal((120, 160)), 25.0, mesh, name=f"{k}"),
                            lasting=np.full((120, 160), 9.0)) for k in range(5)]
                   for e in (same, same[::-1, ::-1]))  # fmt: skip
        got = ratio_of(on, off).ratio
        z.append(((got.value - 1) / np.sqrt(got.white))[got.known])
    assert np.std(z) == pytest.approx(1.0, abs=0.05)


def test_pictures_of_one_kind_alone_are_refused():
    with pytest.raises(DataError, match="with wind and without"):
        ratio_of([picture(slope())], [picture(slope(), camera="cam2")])


def test_light_of_lamps_falls_with_distance_and_angle():
    mesh = plate(5)
    middle = len(mesh.vertices) // 2
    near, far = (lit(mesh, [Lamp((0, 0, z), 1e4)])[middle] for z in (100.0, 200.0))
    assert near == pytest.approx(1.0)
    assert far == pytest.approx(0.25)
    aside = lit(mesh, [Lamp((100.0 * np.sqrt(3), 0, 100.0), 1e4)])[middle]  # 60 degrees, twice as far
    assert aside == pytest.approx(0.5 / 4)
    assert np.isnan(lit(mesh, [Lamp((0, 0, -100.0))])).all()
    assert (lit(mesh, []) == 1).all()


def test_few_modes_of_the_calibration_keep_its_variance():
    true = SternVolmer(np.array([[0.17, 6e-4], [0.88, 7e-3], [-0.05, -3e-4]]), 1e5, 293.15, (2e4, 1.3e5), (278, 313))
    rng = np.random.default_rng(7)
    p, t = (a.ravel() for a in np.meshgrid(np.linspace(2e4, 1.3e5, 12), np.linspace(278, 313, 8)))
    ratio = true.ratio(p, t) * (1 + 0.002 * rng.standard_normal(len(p)))
    law = fit_paint(p, t, ratio, p_ref=1e5, t_ref=293.15, ratio_sigma=0.002 * ratio, order=(4, 3)).law
    at = NodeField.make(np.linspace(0.35, 0.9, 50)).with_mode("lamps", 0.001)
    warm = NodeField.make(np.linspace(298.0, 302.0, 50)[::-1], unit="K")
    few, all_of_them = (f(law, at, warm, p_off=1e5, t_off=293.0) for f in (pressure_of, pressure_map))
    assert len(all_of_them.field.names) > len(few.field.names) - 1
    assert len(few.field.names) <= COLUMNS + 1
    np.testing.assert_allclose(few.field.value, all_of_them.field.value)
    np.testing.assert_allclose(few.field.variance, all_of_them.field.variance, rtol=1e-6)
    noise = np.median(few.field.white / few.field.variance)
    assert noise < 0.05  # hardly anything of a shared error counts as independent


def test_a_side_that_no_camera_shows_is_named_and_has_no_loads():
    upper, lower = plate(), plate()
    both = Mesh.make(
        np.concatenate([upper.vertices, lower.vertices - [0, 0, 1]]),
        np.concatenate([upper.triangles, lower.triangles[:, ::-1] + len(upper.vertices)]), "wing",
    )  # fmt: skip
    cp = NodeField.make(np.where(np.arange(len(both.vertices)) < len(upper.vertices), -0.5, np.nan), 0.01)
    assert shown_areas(both, cp.known) == pytest.approx({"wing": 0.5, "all": 0.5}, abs=0.01)
    assert set(seen_sides(both, cp.known).volume.tolist()) == {"wing", f"wing{UNSEEN_SIDE}"}
    remarks: list[str] = []
    loads = seen_loads(both, cp, LoadReference(1600.0, 40.0, 40.0), 0.5, remarks)
    assert loads is not None
    assert loads.row("wing")["CL"][0] == pytest.approx(0.5)
    assert "50 % of its area is on a side that no camera shows" in remarks[0]
    assert "are not estimated: a Cp of 0.1 all over it makes CL +0.1, CD +0, Cm " in remarks[0]


def test_loads_of_a_section_are_those_of_the_side_that_is_shown():
    """A flat box whose top alone has values: Cp = -0.4 over the front half of its chord; its rim is not seen."""
    upper, lower = plate(41), plate(41)
    mesh = Mesh.make(
        np.concatenate([upper.vertices, lower.vertices - [0, 0, 1e-3]]),
        np.concatenate([upper.triangles, lower.triangles[:, ::-1] + len(upper.vertices)]), "wing",
    )  # fmt: skip
    x = mesh.vertices[:, 0]
    top = (np.arange(len(x)) < len(upper.vertices)) & (np.abs(x) < 19.5)
    cp = NodeField.make(np.where(top, np.where(x < 0.5, -0.4, 0.0), np.nan), 0.01).with_mode("offset", 0.02)
    wanted = [SectionWanted("here", (0, 0.3, 0), (0, 1, 0)), SectionWanted("nowhere", (0, 99, 0), (0, 1, 0))]
    (one,) = section_loads(mesh, cp, wanted, LoadReference(1, 1, 1))
    got = one.loads
    assert (one.name, one.why) == ("here", "")
    assert one.shown == pytest.approx(0.5, abs=0.02)
    assert got.chord[0] == pytest.approx(40)
    # Half a cell more than half the chord; the moment about a quarter of the chord.
    assert got.value[0, 0] == pytest.approx(0.4 * 20.5 / 40, abs=2e-3)
    assert got.value[0, 2] == pytest.approx(0.0, abs=2e-3)
    assert got.sigma[0, 0] == pytest.approx(0.02, rel=0.05)
    assert got.unseen[0] < 0.06


def test_a_plane_that_misses_is_said():
    remarks: list[str] = []
    mesh = plate()
    wanted = [SectionWanted("here", (0, 0, 0), (0, 1, 0)), SectionWanted("nowhere", (0, 99, 0), (0, 1, 0))]
    taps = np.array([[10.0, 0.01, 0.0], [10.0, 5.0, 0.0]])
    cut = cut_sections(mesh, NodeField.make(mesh.vertices[:, 0]), wanted, LoadReference(1, 1, 1), taps, remarks)
    assert [s.name for s in cut] == ["here"]
    assert cut[0].taps.tolist() == [0]
    assert cut[0].tap_x_c[0] == pytest.approx(0.75)
    np.testing.assert_allclose(cut[0].profile.cp.value, 40 * cut[0].profile.x_c - 20, atol=1e-9)
    assert "section nowhere" in remarks[0]
