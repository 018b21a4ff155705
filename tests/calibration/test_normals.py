"""Normals where the table has none, and what they are for: large discs."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.calibration import Free, self_calibrate
from windmark.calibration.normals import all_normals, local_surface
from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.geometry.similarity import align
from windmark.scene import MarkerSet, Observations, View

UP = np.array([0.0, 0.0, 1.0])


def bump(rng, count):
    """Markers on a smooth bump, and their normals."""
    xyz = rng.uniform(-300, 300, (count, 3)) * [1, 0.8, 0]
    height = 120 * np.exp(-(xyz[:, 0] ** 2 + xyz[:, 1] ** 2) / (2 * 200**2))
    normal = np.stack([height * xyz[:, 0] / 200**2, height * xyz[:, 1] / 200**2, np.ones(count)], axis=1)
    xyz[:, 2] = height
    return xyz, normal / np.linalg.norm(normal, axis=1, keepdims=True)


def degrees(a, b):
    return np.degrees(np.arccos(np.clip((a * b).sum(axis=1), -1, 1)))


def unknown(count):
    return np.full((count, 3), np.nan)


def test_normals_of_a_curved_surface():
    xyz, normal = bump(np.random.default_rng(1), 120)
    off = degrees(all_normals(xyz, unknown(120), np.tile(UP, (120, 1))), normal)
    assert np.median(off) < 1.5
    assert np.sqrt((off**2).mean()) < 3.5


def test_markers_off_the_surface_borrow_its_normal():
    rng = np.random.default_rng(2)
    xyz = rng.uniform(-300, 300, (80, 3)) * [1, 1, 0] + rng.normal(0, 1, (80, 3))
    xyz[:8, 2] += rng.uniform(60, 120, 8)
    _, sigma = local_surface(xyz, xyz)
    assert np.isinf(sigma[:8]).sum() >= 6
    off = degrees(all_normals(xyz, unknown(80), np.tile(UP, (80, 1))), np.tile(UP, (80, 1)))
    assert np.sqrt((off[8:] ** 2).mean()) < 2.5
    assert np.median(off[:8]) < 6


def test_a_cloud_has_no_surface_but_a_side():
    rng = np.random.default_rng(3)
    xyz = rng.uniform(-1, 1, (60, 3))
    _, sigma = local_surface(xyz, xyz)
    assert np.isinf(sigma).mean() > 0.9
    assert np.median(degrees(all_normals(xyz, unknown(60), np.tile(UP, (60, 1))), np.tile(UP, (60, 1)))) < 25


def test_a_body_seen_from_all_around_has_its_normals_outwards():
    rng = np.random.default_rng(4)
    out = rng.normal(0, 1, (200, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    off = degrees(all_normals(100 * out, unknown(200), out), out)
    assert off.max() < 30
    assert np.median(off) < 3


def test_known_normals_stay_and_lost_markers_have_none():
    xyz = bump(np.random.default_rng(5), 30)[0]
    given = np.where(np.arange(30)[:, None] < 10, UP, np.nan)
    xyz[29] = np.nan
    found = all_normals(xyz, given, np.tile(UP, (30, 1)))
    np.testing.assert_array_equal(found[:10], given[:10])
    assert np.isnan(found[29]).all()
    assert np.isfinite(found[:29]).all()
    few = all_normals(xyz[:4], unknown(4), np.tile(UP, (4, 1)))
    np.testing.assert_allclose(few, np.tile(UP, (4, 1)))


@pytest.mark.slow
@pytest.mark.parametrize("turn", [0.0, 0.1])
def test_large_discs_without_normals_in_the_table(turn):
    """The markers' own surface undoes most of what large discs do; a rough table that is turned changes nothing."""
    case, rng = networks.make(61, points=80, views=14, noise=0.002), np.random.default_rng(6)
    xyz, normal = bump(rng, 80)
    truth, net = replace(case.truth, points=xyz), case.network
    xy, inside = networks.project(truth, net.view_frame, net.view_offset, net.view_camera, net.view, net.point)
    view, point = net.view[inside], net.point[inside]
    xy = xy[inside] + rng.normal(0, 0.002, (int(inside.sum()), 2))
    for v in range(14):
        mine = view == v
        pose, p = Pose(truth.frames.rotation[v], truth.frames.translation[v]), point[mine]
        xy[mine] += imaged_ellipse(networks.CAMERA, pose.apply(xyz[p]), pose.rotate(normal[p]), 15.0).eccentricity_px
    table = Pose.exp(np.array([turn, 0, 0, 0, 0, 0]))
    markers = MarkerSet.make(
        [f"m{k:02d}" for k in range(80)], table.apply(xyz + rng.normal(0, 2, xyz.shape)), radius=np.full(80, 15.0)
    )
    off = {}
    for how in ("off", "auto", "table"):
        given = replace(markers, normal=table.rotate(normal)) if how == "table" else markers
        result = self_calibrate(
            Observations(view, point, xy, net.cov[inside]), given, {"cam": Camera((1500, 1000), 1600.0)},
            [View(f"v{v:02d}", "cam") for v in range(14)], datum=Free(), eccentricity=how, reject=False,
            max_sigma0=100.0,
        )  # fmt: skip
        assert result
        moved = align(result.markers.xyz, xyz).apply(result.markers.xyz) - xyz
        off[how] = np.sqrt((moved**2).sum(axis=1).mean())
    assert off["auto"] < 0.4 * off["off"]
    assert off["table"] < 0.15 * off["off"]
