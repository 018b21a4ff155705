"""The check of a layout before the test: campaign, symmetries, advice, sigma of the pose, table."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes

from windmark.adjust import refine_pose
from windmark.geometry import Camera
from windmark.pipeline.verdict.layout import layout_verdict
from windmark.registration import register
from windmark.registration.search.field import extents
from windmark.scene import MarkerSet, Mesh
from windmark.tasks.marker_check import Change, CheckSettings, Stage, advice, check, check_markers, run_campaign
from windmark.tasks.marker_check.candidates import candidates, on_mesh
from windmark.tasks.marker_check.settings import (
    DEFAULT_CAMERA,
    azimuth_elevation_deg,
    direction_of,
    spread_directions,
)
from windmark.tasks.marker_check.weakness import pose_sigmas

FRONT = CheckSettings(view_from=(0, 90), within_deg=40, views=48)
UP = np.array([0.0, 0.0, 1.0])


def grid(columns=6, rows=4, moved=()):
    """A regular sheet, pitch 50 mm; ``moved``: (row, column, dx, dy)."""
    xyz = np.stack(np.meshgrid(np.arange(columns) * 50.0, np.arange(rows) * 50.0, [0.0]), axis=-1).reshape(-1, 3)
    for row, column, dx, dy in moved:
        xyz[row * columns + column, :2] += dx, dy
    names = [f"P{i + 1:02d}" for i in range(len(xyz))]
    return MarkerSet.make(names, xyz, normal=np.tile(UP, (len(xyz), 1)), radius=3.0)


def airplane(*, normals=True, exact=True):
    """Flat, with a plane of symmetry, markers on the upper side only."""
    rng = np.random.default_rng(8)
    right = rng.uniform([0, 40, 0], [400, 500, 0], (14, 3))
    body = rng.uniform([-300, 0, 0], [600, 0, 0], (8, 3))
    left = right * [1, -1, 1] + (0 if exact else rng.normal(0, 8, right.shape) * [1, 1, 0])
    xyz = np.concatenate([right, left, body])
    normal = np.tile(UP, (len(xyz), 1)) if normals else None
    return MarkerSet.make([f"m{i:02d}" for i in range(len(xyz))], xyz, normal=normal, radius=3.0)


def stage(markers, settings=FRONT, mesh=None):
    return Stage(markers, DEFAULT_CAMERA, mesh, settings)


@pytest.fixture(scope="module")
def grid_check():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(advice, "VERIFIED", 48)  # views of each proposal; what it is worth, fresh views say
        return check_markers(grid(), "mm", settings=replace(FRONT, views=24))


@pytest.fixture
def no_views(monkeypatch):
    """A check without its campaign, which takes its time and has no say in what the table itself tells."""
    monkeypatch.setattr(check, "run_campaign", lambda stage, **_: run_campaign(stage, only=np.zeros(0, dtype=int)))


def fresh_views(markers, seed, count=100):
    """Random views that have nothing to do with the check's own: (right, wrong) of ``count``."""
    rng = np.random.default_rng([987, seed])
    right = wrong = 0
    for _ in range(count):
        camera, pose = scenes.random_view(rng, markers, fov_deg=(20, 40), tilt_max_deg=40)
        scene = scenes.image_of(rng, markers, camera, pose, hidden=0.3, false=0.5, noise_px=0.2)
        answer = register(scene.detections, markers, camera)
        good = bool(answer) and scenes.pose_error_px(answer.cam_from_model, scene) < 5
        right, wrong = right + good, wrong + (bool(answer) and not good)
    return right, wrong


@pytest.mark.slow
def test_a_regular_grid_is_not_identifiable_and_the_symmetry_is_named(grid_check):
    assert not grid_check.identifiable
    assert grid_check.campaign.share == 0
    assert set(np.array(grid_check.campaign.causes())[grid_check.campaign.bad()]) == {"symmetric"}
    worst = grid_check.symmetries[0]
    assert worst.met >= 0.9 * len(grid_check.campaign.trials)
    assert worst.from_table
    assert worst.share == 1
    assert worst.rms < 1e-9
    names = grid_check.stage.markers.name
    np.testing.assert_array_equal(worst.onto, np.arange(24)[::-1])  # half a turn of the sheet
    np.testing.assert_allclose(worst.motion.apply([0, 0, 0]), [250, 150, 0], atol=1e-9)
    text = "\n".join(grid_check.lines())
    assert "half a turn about the axis (0, 0, 1) brings 24 of 24 markers onto others" in text
    assert f"{names[0]} onto {names[23]}" in text


@pytest.mark.slow
def test_the_proposal_holds_on_views_that_the_check_has_never_seen(grid_check):
    best = grid_check.proposals[0]
    assert best.before == 0
    assert best.campaign.passed
    layout = grid_check.stage.markers
    for change in best.changes:
        layout = change.apply(layout)
    np.testing.assert_array_equal(layout.xyz, best.stage.markers.xyz)
    moved = np.linalg.norm(layout.xyz[:24] - grid_check.stage.markers.xyz, axis=1) > 0
    assert moved.sum() <= len(best.changes) <= 5
    right, wrong = fresh_views(layout, 1, 60)
    assert right >= 59
    assert wrong == 0
    assert fresh_views(grid_check.stage.markers, 1, 8) == (0, 0)
    assert check_markers(layout, "mm", settings=replace(FRONT, seed=5)).identifiable


def test_near_regular_layouts_need_no_change():
    for markers in (scenes.wing(np.random.default_rng(61)), scenes.wing_and_body(np.random.default_rng(62))):
        check = check_markers(markers, "m", settings=CheckSettings(views=90, seed=3))
        assert check.identifiable, check.reason()
        assert check.proposals == []
        assert "  nothing to change" in check.lines()
        # Painted on one side: from below nothing is in sight, and nothing is asked.
        assert not check.campaign.counted[check.campaign.directions[:, 2] < 0].any()


@pytest.mark.slow
def test_a_flat_airplane_without_normals_is_taken_for_its_mirror_image():
    assert check_markers(airplane(), "mm", settings=FRONT).identifiable
    check = check_markers(airplane(normals=False), "mm", settings=replace(FRONT, advise=False))
    assert not check.identifiable
    worst = check.symmetries[0]
    assert (worst.onto >= 0).sum() == 36
    assert any("half a turn about the axis (1, 0, 0)" in line for line in check.lines())
    assert "no-normal" in [finding.kind for finding in check.findings]
    assert check.proposals == []


def test_all_directions_of_a_region_count_and_too_few_markers_is_the_cause():
    side = CheckSettings(view_from=(0, 12), within_deg=10, views=30, advise=False)
    check = check_markers(grid(moved=[(1, 1, 18, 7), (2, 4, -15, 12)]), "mm", settings=side)
    assert check.campaign.counted.all()
    assert not check.identifiable
    blind = check.campaign.in_sight == 0
    assert blind.any()
    assert {cause for cause, b in zip(check.campaign.causes(), blind, strict=True) if b} == {"few"}
    assert "few-in-sight" in [finding.kind for finding in check.findings]


def test_the_same_seed_gives_the_same_campaign_and_another_one_other_views():
    markers = scenes.wing(np.random.default_rng(63))
    one, same, other = (run_campaign(stage(markers), seed=s) for s in (4, 4, 5))
    assert [t.outcome for t in one.trials] == [t.outcome for t in same.trials]
    np.testing.assert_array_equal([t.pose.translation for t in one.trials], [t.pose.translation for t in same.trials])
    assert not np.array_equal(one.trials[0].pose.translation, other.trials[0].pose.translation)


def test_the_model_fills_the_image_whatever_the_direction_and_roll():
    scene = stage(airplane())
    for direction in spread_directions(12, UP, 180):
        for roll, fill in ((0.3, 0.6), (2.0, 0.9)):
            xy, ok = DEFAULT_CAMERA.project(scene.pose(direction, roll, fill).apply(scene.outline))
            assert ok.all()
            off = np.abs(xy - [1023.5, 767.5]) / [1024, 768]
            assert off.max() == pytest.approx(fill, rel=0.02)
            towards = scene.pose(direction, roll, fill).center - scene.middle
            np.testing.assert_allclose(towards / np.linalg.norm(towards), direction, atol=1e-12)


def test_directions_are_even_and_their_names_round_trip():
    cap = spread_directions(400, direction_of(40, 20), 30)
    angle = np.degrees(np.arccos(cap @ direction_of(40, 20)))
    assert angle.max() <= 30
    # Equal areas: half of them within the angle that halves the cap.
    half = np.degrees(np.arccos((1 + np.cos(np.radians(30))) / 2))
    assert (angle < half).mean() == pytest.approx(0.5, abs=0.01)
    np.testing.assert_allclose(cap.mean(axis=0) / np.linalg.norm(cap.mean(axis=0)), direction_of(40, 20), atol=0.01)
    azimuth, elevation = azimuth_elevation_deg(cap).T
    np.testing.assert_allclose([direction_of(a, e) for a, e in zip(azimuth, elevation, strict=True)], cap, atol=1e-12)


def test_sigma_of_the_pose_is_that_of_the_adjustment():
    """Against `refine_pose` on the same markers, all of them seen."""
    markers = scenes.wing_and_body(np.random.default_rng(2))
    scene = stage(markers, CheckSettings(hidden_percent=0, noise_px=0.15))
    direction = direction_of(30, 55)
    got = pose_sigmas(scene, direction[None])
    pose = scene.pose(direction, 0.0, 0.75)
    xy, seen = scene.seen(pose)
    estimate = refine_pose(
        DEFAULT_CAMERA, pose, markers.xyz[seen], xy[seen], np.tile(np.eye(2) * 0.15**2, (seen.sum(), 1, 1))
    )
    # Its translation is that of the model's origin; the check gives that of the model's middle.
    turn = np.eye(6)
    at = pose.apply(scene.middle)
    turn[3:, :3] = -np.array([[0, -at[2], at[1]], [at[2], 0, -at[0]], [-at[1], at[0], 0]])
    cov = turn @ estimate.cov[:6, :6] @ turn.T
    assert got.along[0] == pytest.approx(np.sqrt(cov[5, 5]), rel=1e-6)
    assert got.across[0] == pytest.approx(np.sqrt(np.linalg.eigvalsh(cov[3:5, 3:5])[-1]), rel=1e-6)
    assert got.rotation_deg[0] == pytest.approx(np.degrees(np.sqrt(np.linalg.eigvalsh(cov[:3, :3])[-1])), rel=1e-6)
    hidden = pose_sigmas(stage(markers, CheckSettings(hidden_percent=75, noise_px=0.15)), direction[None])
    assert hidden.surface_px[0] == pytest.approx(2 * got.surface_px[0], rel=1e-9)


def test_sigma_is_unknown_where_too_few_are_in_sight():
    sigma = pose_sigmas(stage(grid()), np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]))
    assert np.isfinite(sigma.surface_px[0])
    assert np.isnan(sigma.surface_px[1])
    line = MarkerSet.make(list("abcdef"), np.arange(6)[:, None] * [10.0, 5.0, 0.0])
    assert np.isnan(pose_sigmas(stage(line), UP[None]).rotation_deg[0])


def test_new_places_lie_on_the_curved_surface():
    turn = np.radians(np.arange(0, 360, 20.0))
    radial = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    rings = np.concatenate([100 * radial + [0, 0, 40 * k] for k in range(3)])
    markers = MarkerSet.make([f"r{i}" for i in range(54)], rings, normal=np.tile(radial, (3, 1)), radius=2.0)
    for kind in ("move", "add"):
        found = candidates(stage(markers), kind)
        assert len(found) > 20
        for change in found:
            # The chord between neighbours runs 1.5 mm below the surface.
            assert np.hypot(*change.place[:2]) == pytest.approx(100, abs=0.05)
            assert change.normal @ change.place / 100 == pytest.approx(np.linalg.norm(change.place[:2]) / 100, abs=1e-3)
            others = markers.xyz[markers.name != change.name]
            assert np.linalg.norm(others - change.place, axis=1).min() > 8


def test_new_places_lie_on_the_mesh():
    mesh = Mesh.make(np.array([[-9.0, -9, 1], [99, -9, 1], [99, 99, 1], [-9, 99, 1]]), np.array([[0, 1, 2], [0, 2, 3]]))
    place, normal = on_mesh(mesh, np.array([10.0, 20.0, 0.3]), UP)
    np.testing.assert_allclose(place, [10, 20, 1], atol=1e-12)
    np.testing.assert_allclose(normal, UP)
    place, normal = on_mesh(mesh, np.array([150.0, 20.0, 0.0]), -UP)
    np.testing.assert_allclose(place, [99, 20, 1], atol=1e-12)
    np.testing.assert_allclose(normal, -UP)


def test_a_mesh_hides_markers():
    markers = replace(grid(), normal=np.full((24, 3), np.nan))
    wall = Mesh.make(np.array([[-50.0, -50, 20], [120, -50, 20], [120, 300, 20], [-50, 300, 20]]),
                     np.array([[0, 1, 2], [0, 2, 3]]))  # fmt: skip
    pose = stage(markers).pose(UP, 0.0, 0.7)
    hidden = ~stage(markers, mesh=wall).seen(pose)[1]
    np.testing.assert_array_equal(hidden, markers.xyz[:, 0] < 120)


def test_changes_leave_all_other_columns_alone():
    markers = grid()
    moved = Change("P07", np.array([1.0, 2, 3]), UP, markers.xyz[6], ("P08",)).apply(markers)
    assert moved.xyz[6].tolist() == [1, 2, 3]
    np.testing.assert_array_equal(np.delete(moved.xyz, 6, axis=0), np.delete(markers.xyz, 6, axis=0))
    longer = Change("NEW01", np.array([5.0, 6, 7]), UP, None, ("P02", "P03")).apply(markers)
    assert longer.name.tolist() == [*markers.name.tolist(), "NEW01"]
    assert longer.xyz[-1].tolist() == [5, 6, 7]
    assert longer.radius[-1] == 3


@pytest.mark.parametrize(
    ("change", "kind", "names"),
    [
        (lambda xyz: np.vstack([xyz[:-1], xyz[:1]]), "close", {"P01", "P24"}),
        (lambda xyz: xyz * [1, 0, 0], "line", set()),
        (lambda xyz: xyz * [1, 1, 0], "flat", set()),
    ],
)
def test_what_the_table_itself_says(no_views, change, kind, names):
    markers = replace(grid(), xyz=change(grid().xyz))
    check = check_markers(markers, "mm", settings=replace(FRONT, views=24, advise=False))
    found = {finding.kind: finding for finding in check.findings}
    assert kind in found
    assert set(found[kind].markers) >= names if names else not found[kind].markers


def test_markers_that_nobody_sees_and_markers_back_to_back(no_views):
    markers = grid()
    normal, xyz = markers.normal.copy(), markers.xyz.copy()
    normal[3], xyz[4] = -UP, xyz[3] + [0, 0, -4]
    normal[4] = UP
    check = check_markers(
        replace(markers, normal=normal, xyz=xyz), "mm", settings=replace(FRONT, views=24, advise=False)
    )
    kinds = {finding.kind: finding.markers for finding in check.findings}
    assert kinds["unseen"] == ("P04",)
    assert "close" not in kinds  # P04 and P05 are on two sides


def ball(count=24):
    """On a sphere, with normals out of it."""
    way = np.random.default_rng(2).normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return MarkerSet.make([f"b{i}" for i in range(count)], 300 * way, normal=way, radius=3.0)


@pytest.mark.parametrize(
    ("markers", "told"),
    [
        (replace(ball(), normal=-ball().normal), True), (ball(), False), (grid(), False), (airplane(), False),
        (replace(ball(), normal=-ball().normal, role=np.full(24, "wall")), False),
    ],
)  # fmt: skip
def test_normals_that_point_into_the_model_are_told(no_views, markers, told):
    found = check_markers(markers, "mm", settings=replace(FRONT, views=24, advise=False))
    assert ("inward" in [f.kind for f in found.findings]) == told
    assert ("discs" in [f.cause for f in layout_verdict(found).findings]) == told


def test_one_normal_turned_round_among_its_neighbours_is_told_and_no_other_side_of_a_thin_part(no_views):
    markers, settings = ball(60), replace(FRONT, views=24, advise=False)
    normal, xyz = markers.normal.copy(), markers.xyz.copy()
    normal[7] = -normal[7]
    found = check_markers(replace(markers, normal=normal), "mm", settings=settings)
    assert [f.markers for f in found.findings if f.kind == "reversed"] == [("b7",)]
    assert "discs" in [f.cause for f in layout_verdict(found).findings]
    xyz[7] += 10 * normal[7]  # within a wall of 10 mm: its inner side
    for right in (markers, replace(markers, normal=normal, xyz=xyz), grid(), airplane()):
        found = check_markers(right, "mm", settings=settings)
        assert "reversed" not in [f.kind for f in found.findings]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_so_few_markers_get_an_answer_and_all_three_axes(no_views, count):
    few = grid().take(range(count))
    found = check_markers(few, "mm", settings=replace(FRONT, views=24, advise=False))
    assert layout_verdict(found).word == "bad"
    axes, extent = extents(few.xyz)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert extent.tolist() == pytest.approx([50.0 * (count - 1), 0.0, 0.0])


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2, 3, 6])
def test_a_few_markers_are_no_layout(count):
    check = check_markers(grid().take(range(count)), "mm", settings=replace(FRONT, views=24))
    assert not check.identifiable
    assert "few" in [finding.kind for finding in check.findings]
    assert check.record()["identifiable"] is False


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"view_from": (0, 100)}, "view_from"), ({"within_deg": 0}, "within_deg"), ({"views": 3}, "views"),
        ({"hidden_percent": 99}, "hidden_percent"), ({"noise_px": 0}, "noise_px"), ({"fill": (0.9, 0.5)}, "fill"),
        ({"false_percent": -1}, "false_percent"), ({"max_obliquity_deg": 90}, "max_obliquity_deg"),
    ],
)  # fmt: skip
def test_settings_out_of_range_are_named(options, word):
    with pytest.raises(ValueError, match=word):
        CheckSettings(**options)


def test_a_lens_with_distortion_is_no_trouble():
    camera = Camera((640, 480), 500.0, k1=-0.15)
    check = check_markers(scenes.wing_and_body(np.random.default_rng(5)), "m", camera=camera,
                          settings=CheckSettings(view_from=(0, 90), within_deg=20, views=24))  # fmt: skip
    assert check.campaign.outcomes()["right"] == check.campaign.first_round == 24
