from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from windmark.geometry import Pose
from windmark.synth import Decals, Marks, TransonicFlow, World, bend, random_poses, rows_layout
from windmark.synth.motion import gradient
from windmark.synth.paint import Paint


@pytest.fixture(scope="module")
def world(half_model):
    markers = rows_layout(half_model, half_model.patches(6000), np.random.default_rng(0))
    paint = Paint.random(np.random.default_rng(1), {"wall": 0.4}, [(0, 500, 1500, 2e6)])
    dirt = Decals.on_surface(
        Marks.make([[0, 0], [3, 1]], outer=1, contrast=0.5, half=(2, 0)), [200, 300, 25], [0, 0, 1], "wing"
    )
    return World(half_model.mesh(6000), markers, paint, dirt=dirt)


def test_rigid_motion_moves_the_model_and_not_the_wall(world):
    pose = Pose.from_rotvec([0.01, -0.02, 0.015], [1, 2, 3])
    moved = world.moved(pose)
    of = {v: np.unique(world.mesh.triangles[world.mesh.volume == v]) for v in ("wing", "body", "wall")}
    for v in ("wing", "body"):
        np.testing.assert_allclose(moved.mesh.vertices[of[v]], pose.apply(world.mesh.vertices[of[v]]), atol=1e-12)
    np.testing.assert_array_equal(moved.mesh.vertices[of["wall"]], world.mesh.vertices[of["wall"]])
    model = world.markers.role == "model"
    np.testing.assert_allclose(moved.markers.xyz[model], pose.apply(world.markers.xyz[model]), atol=1e-12)
    np.testing.assert_allclose(moved.markers.normal[model], pose.rotate(world.markers.normal[model]), atol=1e-12)
    bent = replace(world.markers, curvature=np.tile(np.diag([0.02, -0.01, 0.03]), (len(model), 1, 1)))
    turned = replace(world, markers=bent).moved(pose).markers.curvature
    np.testing.assert_allclose(turned[model], pose.rotate_form(bent.curvature[model]), atol=1e-12)
    np.testing.assert_array_equal(turned[~model], bent.curvature[~model])
    np.testing.assert_array_equal(moved.markers.xyz[~model], world.markers.xyz[~model])
    np.testing.assert_allclose(moved.dirt.center, pose.apply(world.dirt.center), atol=1e-12)
    np.testing.assert_array_equal(moved.rest_vertices, world.mesh.vertices)
    twice = moved.moved(pose)
    np.testing.assert_allclose(twice.tunnel_from_model.translation, (pose @ pose).translation)
    np.testing.assert_array_equal(twice.rest_vertices, world.mesh.vertices)
    wall = world.moved(pose, ["wall"])
    np.testing.assert_array_equal(wall.tunnel_from_model.rotation, np.eye(3))
    np.testing.assert_array_equal(wall.markers.xyz[model], world.markers.xyz[model])
    with pytest.raises(ValueError, match="volumes"):
        world.moved(pose, ["tail"])


def test_deformed_normals_are_those_of_the_deformed_surface(half_model, world):
    """Markers' normals after bending against the normal of the bent smooth surface itself."""

    def law(xyz):
        return bend(xyz, 0.04, -2.0)

    patch = half_model.patches(6000)["wing_upper"]
    bent = replace(patch, point=lambda s, t: law(patch.point(s, t)))
    s, t = np.array([0.3, 0.5, 0.7]), np.array([0.4, 0.6, 0.95])
    _, normal = patch.place(s, t)
    markers = replace(world.markers.take([0, 1, 2]), xyz=patch.point(s, t), normal=normal)
    after = replace(world, markers=markers).deformed(law)
    np.testing.assert_allclose(after.markers.xyz, bent.point(s, t), atol=1e-9)
    np.testing.assert_allclose(after.markers.normal, bent.normal(s, t), atol=1e-6)
    np.testing.assert_allclose((after.dirt.normal * after.dirt.direction).sum(axis=1), 0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(after.dirt.direction, axis=1), 1)
    body = np.unique(world.mesh.triangles[world.mesh.volume == "body"])
    np.testing.assert_array_equal(after.mesh.vertices[body], world.mesh.vertices[body])
    np.testing.assert_array_equal(after.tunnel_from_model.rotation, np.eye(3))


def test_law_acts_in_the_model_s_frame(world):
    pose = Pose.from_rotvec([0.1, -0.05, 0.02], [5, 6, 7])

    def law(xyz):
        return bend(xyz, 0.05, 1.0)

    one = world.deformed(law).moved(pose)
    other = world.moved(pose).deformed(law)
    np.testing.assert_allclose(one.mesh.vertices, other.mesh.vertices, atol=1e-9)
    np.testing.assert_allclose(one.markers.normal, other.markers.normal, atol=1e-6)


def test_bend_is_a_cantilever():
    xyz = np.array([[65 + np.tan(np.radians(28)) * y, y, 0.0] for y in (0.0, 72, 336, 600)])
    out = bend(xyz, 0.1, 0.0)
    np.testing.assert_allclose(out[:, 2], [0, 0, 0.1 * 528 * 0.25 * 2.5 / 2, 52.8], atol=1e-12)
    np.testing.assert_array_equal(out[:, :2], xyz[:, :2])
    twisted = bend(xyz + np.array([10, 0, 0]), 0.0, 3.0)
    rise = xyz[3, 2] - twisted[3, 2]
    assert rise == pytest.approx(10 * np.sin(np.radians(3)))  # behind the axis goes down: nose up
    np.testing.assert_allclose(twisted[:2], xyz[:2] + np.array([10, 0, 0]))
    assert np.linalg.norm(twisted[3] - xyz[3]) == pytest.approx(10)


def test_gradient_of_a_known_law():
    points = np.random.default_rng(0).uniform(-1, 1, (5, 3))
    got = gradient(lambda p: np.stack([p[..., 0] ** 2, p[..., 0] * p[..., 1], p[..., 2]], axis=-1), points)
    for g, (x, y, _) in zip(got, points, strict=True):
        np.testing.assert_allclose(g, [[2 * x, 0, 0], [y, x, 0], [0, 0, 1]], atol=1e-9)


def test_node_intensity_is_the_paint_s(world):
    blown = replace(world, flow=TransonicFlow()).moved(Pose.from_rotvec([0, 0.01, 0], [1, 0, 2]))
    out = blown.node_intensity()
    assert np.isfinite(out).all()
    assert out.min() >= 0
    v = int(np.unique(blown.mesh.triangles[blown.mesh.volume == "wing"])[500])
    expected = blown.paint.intensity(
        blown.mesh.vertices[[v]], blown.mesh.vertex_normals()[[v]], "wing",
        rest_xyz=world.mesh.vertices[[v]], rest_normal=world.mesh.vertex_normals()[[v]], flow=blown.flow,
    )  # fmt: skip
    assert out[v] == pytest.approx(expected[0], rel=1e-12)


def test_random_poses_stay_in_their_cone():
    target = np.array([100.0, 200, 0])
    poses = random_poses(np.random.default_rng(0), 200, target, 800.0, max_angle_deg=40, distance_spread=0.2)
    for p in poses:
        d = p.center - target
        assert 0.8 * 800 - 1e-9 <= np.linalg.norm(d) <= 1.2 * 800 + 1e-9
        assert d[2] / np.linalg.norm(d) >= np.cos(np.radians(40)) - 1e-12
        x, y, z = p.apply(target)
        assert abs(x) + abs(y) < 1e-9
        assert z > 0
    right = np.array([p.rotation[0] for p in poses])
    assert (right[:, 0] < 0).mean() > 0.3  # any roll
    level = random_poses(np.random.default_rng(0), 20, target, 800.0, max_roll_deg=0)
    assert all(p.rotation[1] @ [0, 1, 0] < -0.7 for p in level)  # up is up: y of the camera points down
    again = random_poses(np.random.default_rng(0), 20, target, 800.0, max_roll_deg=0)
    assert all((a.rotation == b.rotation).all() for a, b in zip(level, again, strict=True))
    with pytest.raises(ValueError, match="max_angle_deg"):
        random_poses(np.random.default_rng(0), 1, target, -1)
    with pytest.raises(ValueError, match="up"):
        random_poses(np.random.default_rng(0), 1, target, 1, up=(0, 0, 1))


def test_decals_need_radius_and_normal(world):
    with pytest.raises(ValueError, match="radius and normal"):
        Decals.of_markers(replace(world.markers, radius=np.full(len(world.markers), np.nan)), 0.5)
    assert len(Decals.join([])) == 0
