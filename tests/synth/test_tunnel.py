from __future__ import annotations

import hashlib

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet
from windmark.synth import Sensor, bend, random_poses, wind_tunnel


def digest(test):
    h = hashlib.sha256()
    for s in test.shots:
        for a in (s.image, s.perfect.image, s.perfect.markers.xy, s.perfect.triangle, s.world.mesh.vertices):
            h.update(np.ascontiguousarray(a).tobytes())
    return h.hexdigest()


def test_same_seed_same_bytes():
    one, same, other = (digest(wind_tunnel(seed, size_px=(120, 96), nodes=2000)) for seed in (3, 3, 4))
    assert one == same
    assert one != other


def test_streams_do_not_mix(small_test):
    """Another sensor changes the noise, not the layout; no clutter changes the dirt, not the noise's seed."""
    other = wind_tunnel(3, size_px=(480, 384), nodes=12_000, sensor=None, clutter=None)
    assert other.markers.xyz.tobytes() == small_test.markers.xyz.tobytes()
    assert other.cameras == small_test.cameras
    assert other.shot().image is other.shot().perfect.image
    assert len(other.shot().world.dirt) == 0
    assert len(small_test.shot().world.dirt) > 50


@pytest.mark.slow
def test_default_test_is_as_described():
    test = wind_tunnel(0)
    for frame in ("wind-off", "wind-on"):
        shot = test.shot(frame)
        t = shot.perfect.markers
        assert shot.image.shape == (1024, 1280)
        assert shot.image.dtype == np.uint16
        assert 2000 < shot.image.max() <= 4095
        assert len(t) == 45
        assert 32 <= t.visible.sum() <= 38
        radius = np.sqrt(t.axes_px[t.visible].prod(axis=1))
        assert radius.min() > 3
        assert radius.max() < 5.2
        assert (np.abs(t.ellipse_xy - t.xy)[t.visible] < 0.03).all()
        assert shot.view.frame == frame
    assert (test.shot().image == 4095).mean() < 1e-3
    gap = np.array(test.shot().perfect.image) - test.shot("wind-on").perfect.image
    assert np.abs(gap).max() > 0.3
    with pytest.raises(ValueError, match="no shot"):
        test.shot("wind-up")


def test_motion_is_a_few_millimetres_and_seen(small_test):
    angle = np.degrees(np.linalg.norm(small_test.tunnel_from_model.rotvec))
    assert angle == pytest.approx(0.5, abs=0.02)
    off, on = small_test.shot("wind-off"), small_test.shot("wind-on")
    model = small_test.markers.role == "model"
    shift = np.linalg.norm(on.world.markers.xyz - off.world.markers.xyz, axis=1)
    assert (shift[model] > 0.3).all()
    assert shift[model].max() < 8
    assert (shift[~model] == 0).all()
    got = on.view.cam_from_model @ off.view.cam_from_model.inverse()
    cam = small_test.cam_from_tunnel["cam1"]
    expected = cam @ small_test.tunnel_from_model @ cam.inverse()
    np.testing.assert_allclose(got.rotation, expected.rotation, atol=1e-12)
    np.testing.assert_allclose(got.translation, expected.translation, atol=1e-9)


def test_bent_wing_under_wind():
    test = wind_tunnel(1, size_px=(240, 192), nodes=4000, tip_fraction=0.03, twist_deg=-1.0, motion=Pose.identity(),
                       sensor=None)  # fmt: skip
    wing = test.markers.volume == "wing"
    off, on = test.shot("wind-off").world.markers, test.shot("wind-on").world.markers
    np.testing.assert_allclose(on.xyz[wing], bend(off.xyz[wing], 0.03, -1.0), atol=1e-9)
    np.testing.assert_array_equal(on.xyz[~wing], off.xyz[~wing])
    assert (on.xyz - off.xyz)[wing, 2].max() > 8


@pytest.mark.slow
def test_several_cameras_and_own_stations(half_model):
    test = wind_tunnel(2, size_px=(160, 128), nodes=3000, stations=3)
    assert [s.view.name for s in test.shots] == [f"cam{c}-{f}" for c in (1, 2, 3) for f in ("wind-off", "wind-on")]
    centers = np.array([p.center for p in test.cam_from_tunnel.values()])
    assert np.linalg.norm(centers[0] - centers[1]) > 400
    assert np.linalg.norm(centers[1] - centers[2]) > 800
    for key in test.cameras:
        assert test.shot("wind-on", key).perfect.markers.visible.sum() > 18
    camera = Camera((160, 128), 260.0)
    poses = random_poses(np.random.default_rng(0), 2, [205, 290, 0], 1500.0, max_angle_deg=20)
    mine = wind_tunnel(2, nodes=3000, stations=[(camera, p) for p in poses], sensor=Sensor(bits=8))
    assert mine.shot(camera="cam2").image.dtype == np.uint8
    assert mine.cam_from_tunnel["cam2"] is poses[1]
    with pytest.raises(ValueError, match="count"):
        wind_tunnel(2, stations=0, nodes=3000)


def test_a_layout_of_one_s_own(half_model):
    def lonely(shape, patches, rng):
        from windmark.synth import rows_layout

        return rows_layout(shape, patches, rng, upper=(2, 2), lower=(0, 0), body=0, floor=(0, 0), side=0)

    test = wind_tunnel(0, size_px=(160, 128), nodes=3000, layout=lonely)
    assert test.markers.name.tolist() == ["W01", "W02", "W03", "W04"]


def test_a_layout_without_markers_is_refused():
    with pytest.raises(ValueError, match="layout"):
        wind_tunnel(
            0, size_px=(160, 128), nodes=3000, layout=lambda shape, patches, rng: MarkerSet.make([], np.zeros((0, 3)))
        )
