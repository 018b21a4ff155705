"""What cameras saw as the settle wants it: their covariances and doubts as columns, spots in order, freedom added."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes
import settle_scenes as settling

from windmark.geometry import Camera
from windmark.registration.settle import views as v
from windmark.registration.settle._kernels import doubt
from windmark.registration.settle.settling import copied, with_freedom

CAMERA = Camera((1280, 960), 1500.0, aspect=1.02, k1=-0.1)


def random_cov(rng, open_):
    """(11, 11) of so many parameters, correlated, each with a sigma of its own size."""
    unit = np.array([3.0, 1e-3, 2.0, 2.0, 1e-2, 1e-2, 1e-4, 1e-4, 1e-2, 1e-3, 1e-3])
    root = np.zeros((11, 11))
    root[:open_] = rng.normal(size=(open_, 11))
    return unit[:, None] * (root @ root.T) * unit


@pytest.mark.parametrize("open_", [0, 1, 4, 11])
def test_columns_of_a_known_camera_are_a_root_of_its_covariance(open_):
    cov = random_cov(np.random.default_rng(open_), open_)
    columns = v.known_camera(Camera((1280, 960), 1500.0, cov=cov), 0.0)
    assert columns.shape == (v.ROWS, open_)
    in_parameters = columns[:11] * np.append(1500.0, np.ones(10))[:, None]
    unit = np.sqrt(np.diag(cov)) + 1e-12
    np.testing.assert_allclose(
        in_parameters @ in_parameters.T / np.outer(unit, unit), cov / np.outer(unit, unit), atol=1e-8
    )
    assert (columns[11] == 0).all()


def test_the_shear_of_a_camera_moves_within_its_covariance():
    """Its own row, its own derivative: known to 1e-3, a shear of 1e-3 is found; of an exact camera it stays."""
    rng = np.random.default_rng(56)
    markers = scenes.wing_and_body(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(50, 55), tilt_max_deg=30)
    true = replace(camera, shear=1e-3)
    scene = scenes.image_of(rng, markers, true, pose, noise_px=0.05)
    cov = np.zeros((15, 15))
    cov[14, 14] = 1e-6
    for given in (replace(camera, cov=cov), true, replace(true, cov=cov)):
        view = scenes.Scene(scene.detections, markers, given, pose, scene.label)
        found = settling.settled(settling.views_of(view), view)
        if given.cov is None:
            assert found.camera().shear == 1e-3
        else:
            at = float(np.sqrt(found.unit_cov[6, 6])) * 1e-3
            assert 1e-6 < at < 3e-4
            assert abs(found.camera().shear - 1e-3) < 4 * at


def test_without_covariance_nothing_is_open_and_a_free_focal_length_comes_first():
    assert v.known_camera(CAMERA, 0.0).shape == (v.ROWS, 0)
    np.testing.assert_array_equal(v.known_camera(CAMERA, 0.3), 0.3 * np.eye(v.ROWS, 1))
    cov = random_cov(np.random.default_rng(1), 4)
    columns = v.known_camera(Camera((1280, 960), 1500.0, cov=cov), 0.3)
    np.testing.assert_array_equal(columns[:, 0], 0.3 * np.eye(v.ROWS)[0])
    assert columns.shape == (v.ROWS, 4)
    assert (columns[0, 1:] == 0).all()  # what the covariance says of the focal length is no longer asked
    rest = columns[1:11, 1:]
    np.testing.assert_allclose(rest @ rest.T, cov[1:, 1:], rtol=1e-6, atol=1e-12)


def test_doubts_of_a_camera_are_what_they_say():
    """1 sigma of each doubt: focal length, aspect, principal point, and where the corner is seen."""
    columns = v.doubted_camera(CAMERA)
    assert columns.shape == (v.ROWS, 5)
    diagonal = np.hypot(1280, 960)
    changed = [
        Camera(CAMERA.size_px, *(CAMERA.packed()[:11] + c[:11] * np.append(1500.0, np.ones(10)))) for c in columns.T
    ]
    assert changed[0].focal_px == pytest.approx(1500.0 * (1 + doubt.DOUBTED_FOCAL))
    assert changed[1].aspect == pytest.approx(1.02 + doubt.DOUBTED_ASPECT)
    assert [changed[2].cx - CAMERA.cx, changed[3].cy - CAMERA.cy] == pytest.approx(
        [doubt.DOUBTED_CENTRE * diagonal] * 2
    )
    plain = Camera((1280, 960), 1500.0)
    lens = Camera((1280, 960), 1500.0, k1=v.doubted_camera(plain)[4, 4])
    corner = np.array([(1280 / 2) / 1500, (960 / 2) / 1500, 1.0])
    off = lens.project(corner)[0] - plain.project(corner)[0]
    assert np.linalg.norm(off) == pytest.approx(doubt.DOUBTED_EDGE * diagonal / 2, rel=1e-6)


def unlike_rig():
    """A rig of two cameras of which one has a covariance and the other a free focal length."""
    rig = scenes.rig_scene(51, "A", 2, hidden=0.2, false=0.5)
    one, two = rig.views
    camera = Camera(one.camera.size_px, one.camera.focal_px, cov=random_cov(np.random.default_rng(2), 5))
    views = (scenes.Scene(one.detections, one.markers, camera, one.cam_from_model, one.label), two)
    rig = scenes.RigScene(views, rig.cam_from_rig, rig.rig_from_model)
    return rig, settling.views_of_rig(rig, each=({}, {"focal_factors": settling.FREE}))


def test_cameras_of_unlike_freedom_are_filled_up_with_nothing():
    _, views = unlike_rig()
    assert views.loose.shape == (2, v.ROWS, 5)
    assert (np.abs(views.loose[0]).max(axis=0) > 0).all()
    assert (np.abs(views.loose[1]).max(axis=0) > 0).tolist() == [True] + [False] * 4
    doubted = views.doubted()
    assert doubted.loose.shape == (2, v.ROWS, 10)
    np.testing.assert_array_equal(doubted.loose[:, :, :5], views.loose)
    np.testing.assert_array_equal(doubted.loose[1, :, 5:], v.doubted_camera(views.planes[1].task.camera))
    some = views.doubted(columns=(2, 3))
    np.testing.assert_array_equal(some.loose[:, :, 5:], doubted.loose[:, :, 7:9])


def test_sights_are_the_spots_of_all_cameras_one_after_the_other():
    rig, views = unlike_rig()
    sights = views.sights
    assert sights.first.tolist() == [0, len(rig.views[0].detections), sum(len(view.detections) for view in rig.views)]
    for c, view in enumerate(rig.views):
        own = slice(sights.first[c], sights.first[c + 1])
        np.testing.assert_array_equal(sights.xy[own], view.detections.xy)
        np.testing.assert_array_equal(sights.x[own], np.sort(view.detections.xy[:, 0]))
        np.testing.assert_array_equal(view.detections.xy[sights.by_x[own], 0], sights.x[own])
        np.testing.assert_array_equal(sights.cov[own], view.detections.cov.reshape(-1, 4)[:, [0, 1, 3]])
        pose = views.layout.frame.pose(sights.rotation[c], sights.translation[c])
        centre = views.layout.frame.centre
        np.testing.assert_allclose(pose.apply(centre), rig.cam_from_rig[c].translation, atol=1e-9)


def test_sigmas_of_the_table_are_those_of_the_unit_model():
    scene = scenes.scene(54, "A")
    sigma = np.full((24, 3), 0.003) * [1.0, 2.0, 3.0]
    sigma[5] = np.nan
    views = settling.views_of(replace(scene, markers=replace(scene.markers, sigma=sigma)))
    expected = np.where(np.isfinite(sigma), sigma, 0.0)
    np.testing.assert_allclose(views.sights.sigma * views.layout.frame.scale, expected)
    assert views.layout.frame.scale != pytest.approx(1.0, abs=0.1)


def test_views_with_more_freedom_are_those_made_anew():
    _, views = unlike_rig()
    modes = 0.02 * views.layout.modes
    bent = views.doubted().bent(modes)
    assert bent.sights.modes is not views.sights.modes
    np.testing.assert_array_equal(bent.sights.modes, modes)
    np.testing.assert_array_equal(bent.sights.loose, bent.loose)
    fresh = v.Views(views.planes, views.cam_from_rig, bent.loose, modes, views.names)
    for name, value in fresh.sights._asdict().items():
        np.testing.assert_array_equal(getattr(bent.sights, name), value, err_msg=name)


def test_given_cameras_come_back_as_they_are():
    _, views = unlike_rig()
    given = views.planes[0].task.camera
    assert views.camera(0, given.packed()) is given
    moved = given.packed()
    moved[2] += 3.0
    assert views.camera(0, moved).cx == given.cx + 3.0
    assert views.camera(0, moved).cov is given.cov


def test_a_state_keeps_what_it_has_under_other_views():
    """Open columns come first, so that nuisances stay what they are; coefficients only of the same modes."""
    rig, views = unlike_rig()
    solution = settling.settled(views, rig)
    rng = np.random.default_rng(4)
    solution.state.nuisance[:] = rng.normal(size=(2, 5))
    state = copied(views.doubted(), solution.state)
    np.testing.assert_array_equal(state.nuisance[:, :5], solution.state.nuisance)
    assert (state.nuisance[:, 5:] == 0).all()
    assert state.factor.shape == (6 + 20,) * 2
    state.match[:] = -1
    assert solution.count > 0
    bent = copied(settling.bent_views(views), solution.state)
    bent.bent[:] = 1.0
    assert (copied(settling.bent_views(views), bent).bent == 1.0).all()
    assert len(copied(views, bent).bent) == 0


def test_a_camera_moves_within_its_covariance_and_no_farther():
    """A principal point off by one sigma is found; one off by ten sigma of what is said is not."""
    rng = np.random.default_rng(52)
    markers = scenes.wing_and_body(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(50, 55), tilt_max_deg=30)
    scene = scenes.image_of(rng, markers, camera, pose, noise_px=0.05)
    cov = np.diag([0.0, 0.0, 100.0, 100.0, *[0.0] * 7])
    for scale in (1.0, 0.01):
        given = Camera(camera.size_px, camera.focal_px, cx=camera.cx + 10.0, cy=camera.cy - 10.0, cov=scale * cov)
        view = scenes.Scene(scene.detections, markers, given, pose, scene.label)
        found = settling.settled(settling.views_of(view), view)
        moved = np.array([found.camera().cx - given.cx, found.camera().cy - given.cy])
        if scale == 1.0:
            at = np.sqrt(np.diag(found.unit_cov)[6:8]) * 10.0
            assert (np.abs(moved - [-10.0, 10.0]) < 4 * at.max()).all()
            assert at.max() < 5.0
        else:
            assert np.abs(moved).max() < 5.0


def test_freedom_that_is_not_needed_moves_nothing_beyond_its_sigma():
    scene = scenes.scene(53, "B", noise_px=0.2)
    views = settling.views_of(scene)
    best = settling.settled(views, scene)
    free = with_freedom(views.doubted(), best)
    off = free.state.nuisance[0] / np.sqrt(np.diag(free.unit_cov)[6:])
    assert (np.abs(off) < 4).all()
    np.testing.assert_array_equal(free.state.match, best.state.match)
    assert free.evidence < best.evidence + 3


def test_spots_that_are_left_out_are_matched_by_none():
    """Also those in the gate of a marker: they lie where they lay, only the list of candidates has them no more."""
    scene = settling.wide_scene(67)
    views, best = settling.best_of(scene)
    spot, _ = best.pairs()
    taken = np.zeros(len(views.planes[0].task.xy), dtype=bool)
    taken[spot[::4]] = True
    rest = with_freedom(views.without([taken]), best)
    assert set(rest.pairs()[0].tolist()) == set(spot.tolist()) - set(spot[::4].tolist())
