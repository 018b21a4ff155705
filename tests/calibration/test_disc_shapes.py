"""Normals and radii of discs from their ellipses, and what they are for."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.calibration import Free, self_calibrate
from windmark.calibration.disc_shapes import discs_of_ellipses, shape_matrices, with_common_radius
from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.geometry.camera_jacobian import project_jacobian
from windmark.geometry.similarity import align
from windmark.scene import MarkerSet, Observations, View

RADIUS, COUNT, VIEWS = 15.0, 40, 10


def leaning(rng, count=COUNT):
    """Unit normals up to some 40 degrees off the z axis."""
    normal = np.column_stack([rng.normal(0, 0.3, (count, 2)), np.ones(count)])
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def pictures(seed=71, noise=0.02):
    """A network of discs: (case, normals, marks with eccentricity, ellipses, derivatives by the marker)."""
    case, rng = networks.make(seed, points=COUNT, views=VIEWS, noise=noise), np.random.default_rng(seed)
    net, normal = case.network, leaning(rng)
    xy, ellipse, slope = net.xy.copy(), np.zeros((len(net.xy), 3)), np.zeros((len(net.xy), 2, 3))
    for v in range(VIEWS):
        mine, pose = net.view == v, Pose(case.truth.frames.rotation[v], case.truth.frames.translation[v])
        p = net.point[mine]
        x = pose.apply(case.truth.points[p])
        seen = imaged_ellipse(networks.CAMERA, x, pose.rotate(normal[p]), RADIUS)
        xy[mine] += seen.eccentricity_px
        ellipse[mine] = np.column_stack([seen.axes_px, seen.angle])
        slope[mine] = project_jacobian(networks.CAMERA.parameters(), x)[2] @ pose.rotation
    return case, normal, xy, ellipse, slope


def noisy(ellipse, rng, sigma):
    """Noise on the symmetric root of the ellipses' matrices."""
    value, vector = np.linalg.eigh(shape_matrices(ellipse))
    n = rng.normal(0, sigma, (len(ellipse), 3)) * [1, 1, np.sqrt(0.5)]
    root = (vector * np.sqrt(value)[:, None]) @ vector.transpose(0, 2, 1) + n[:, [0, 2, 2, 1]].reshape(-1, 2, 2)
    value, vector = np.linalg.eigh(root)
    return np.column_stack([value[:, ::-1], np.arctan2(vector[:, 1, 1], vector[:, 0, 1])])


def degrees(a, b):
    return np.degrees(np.arccos(np.clip((a * b).sum(axis=1), -1, 1)))


UP = np.tile([0.0, 0.0, 1.0], (COUNT, 1))


def test_matrices_are_those_of_the_ellipses():
    one = shape_matrices(np.array([[5.0, 2.0, np.radians(30)]]))[0]
    np.testing.assert_allclose(np.linalg.eigvalsh(one), [4.0, 25.0])
    axis = np.array([np.cos(np.radians(30)), np.sin(np.radians(30))])
    np.testing.assert_allclose(one @ axis, 25 * axis)


def test_exact_ellipses_give_exact_discs():
    case, normal, _, ellipse, slope = pictures()
    found = discs_of_ellipses(ellipse, case.network.point, slope, UP)
    assert degrees(found.normal, normal).max() < 0.02
    np.testing.assert_allclose(found.radius, RADIUS, rtol=1e-3)


def test_sigma_is_that_of_the_errors_and_dirt_does_no_harm():
    case, normal, _, ellipse, slope = pictures()
    rng, z, worst = np.random.default_rng(1), [], 0.0
    for _ in range(20):
        given = noisy(ellipse, rng, 0.1)
        dirty = rng.random(len(given)) < 0.05
        given[dirty, :2] *= rng.uniform(0.4, 1.6, (int(dirty.sum()), 2))
        found = discs_of_ellipses(given, case.network.point, slope, UP)
        z.append((degrees(found.normal, normal) / np.degrees(found.sigma)) ** 2)
        worst = max(worst, float(degrees(found.normal, normal).max()))
    # Two directions, of which sigma is the worse one: between 1 and 2.
    assert 0.8 < np.mean(z) < 2.2
    assert worst < 5.0


def test_what_ellipses_cannot_tell_stays_open():
    case, _, _, ellipse, slope = pictures()
    point = case.network.point
    few = np.flatnonzero(point == 3)[2:]
    ellipse[few] = np.nan
    squares = point == 5
    ellipse[squares, :2] *= np.random.default_rng(2).uniform(0.3, 1.7, (int(squares.sum()), 2))
    found = discs_of_ellipses(ellipse, point, slope, UP)
    lost = np.isin(np.arange(COUNT), [3, 5])
    assert np.isinf(found.sigma[lost]).all()
    assert np.isnan(found.normal[lost]).all()
    assert np.isfinite(found.normal[~lost]).all()


def test_a_disc_and_its_mirror_image_are_not_told_apart_from_one_side():
    case, normal, _, ellipse, slope = pictures()
    point, one = case.network.point, case.network.view == 0
    again = np.tile(np.flatnonzero(one), 4)
    given = noisy(ellipse[again], np.random.default_rng(3), 0.05)
    found = discs_of_ellipses(given, point[again], slope[again], UP)
    side = case.truth.frames.rotation[0].T @ [0, 0, -1.0]
    leans = degrees(normal, np.tile(side, (COUNT, 1))) > 12
    seen = np.isin(np.arange(COUNT), point[one])
    assert (leans & seen).sum() > 10
    assert np.isinf(found.sigma[leans & seen]).mean() > 0.9
    np.testing.assert_allclose(found.radius[leans & seen], RADIUS, rtol=0.05)


@pytest.mark.parametrize("radius", [RADIUS, np.nan])
def test_ellipses_make_up_for_wrong_normals_and_missing_radii(radius):
    case, normal, xy, ellipse, _ = pictures(72, noise=0.01)
    rng, net = np.random.default_rng(4), case.network
    across = np.cross(normal, rng.normal(0, 1, normal.shape))
    wrong = normal + np.tan(np.radians(8)) * across / np.linalg.norm(across, axis=1, keepdims=True)
    wrong /= np.linalg.norm(wrong, axis=1, keepdims=True)
    table = MarkerSet.make(
        [f"m{k:02d}" for k in range(COUNT)], case.start.points, radius=np.full(COUNT, radius), normal=wrong
    )
    observations = Observations(net.view, net.point, xy, net.cov)
    views = [View(f"v{v:02d}", "cam") for v in range(VIEWS)]
    camera, off = {"cam": Camera((1500, 1000), 1600.0)}, {}
    for how, given, shapes in (
        ("table", replace(table, radius=np.full(COUNT, RADIUS)), None),
        ("auto", table, noisy(ellipse, rng, 0.1)),
    ):
        result = self_calibrate(
            observations, given, camera, views, datum=Free(), eccentricity=how, ellipses=shapes, reject=False,
            max_sigma0=50.0,
        )  # fmt: skip
        assert result
        fit = align(result.markers.xyz, case.truth.points)
        off[how] = np.sqrt(((fit.apply(result.markers.xyz) - case.truth.points) ** 2).sum(axis=1).mean())
    assert off["auto"] < 0.5 * off["table"]
    assert degrees(result.markers.normal @ fit.rotation.T, normal).max() < 2.0
    np.testing.assert_allclose(result.markers.radius * fit.scale, RADIUS, rtol=0.02)


@pytest.mark.parametrize(
    ("factor", "words"),
    [(1 / 25.4, "25.4 times too small for the imaged markers: radii in inch beside places in mm?"),
     (10.0, "times too large for the imaged markers: radii in mm beside places in cm?")],
)  # fmt: skip
def test_radii_in_another_unit_than_the_places_are_refused(factor, words):
    case, normal, xy, ellipse, _ = pictures(72, noise=0.01)
    rng, net = np.random.default_rng(4), case.network
    table = MarkerSet.make(
        [f"m{k:02d}" for k in range(COUNT)], case.start.points, radius=np.full(COUNT, factor * RADIUS), normal=normal,
        length_unit="mm" if factor < 1 else "cm",
    )  # fmt: skip
    said = self_calibrate(
        Observations(net.view, net.point, xy, net.cov), table, {"cam": Camera((1500, 1000), 1600.0)},
        [View(f"v{v:02d}", "cam") for v in range(VIEWS)], datum=Free(), ellipses=noisy(ellipse, rng, 0.1), reject=False,
        max_sigma0=50.0,
    )  # fmt: skip
    assert not said
    assert said.cause == "discs"
    assert words.split("times", 1)[1] in said.reason


def test_ellipses_of_the_wrong_shape_are_named():
    case, _, xy, ellipse, _ = pictures()
    net = case.network
    markers = MarkerSet.make([f"m{k:02d}" for k in range(COUNT)], case.start.points)
    views = [View(f"v{v:02d}", "cam") for v in range(VIEWS)]
    with pytest.raises(ValueError, match="ellipses"):
        self_calibrate(
            Observations(net.view, net.point, xy, net.cov), markers, {"cam": networks.CAMERA}, views, datum=Free(),
            ellipses=ellipse[:, :2],
        )  # fmt: skip


def test_discs_without_a_radius_of_their_own_get_the_one_that_all_others_have():
    """Left without, they alone would be off by r^2 / d along their normal."""
    case, normal, xy, ellipse, _ = pictures(72, noise=0.01)
    rng, net = np.random.default_rng(6), case.network
    lost = np.isin(np.arange(COUNT), [4, 11, 19, 27, 33])
    given = noisy(ellipse, rng, 0.1)
    given[lost[net.point]] = np.nan
    table = MarkerSet.make([f"m{k:02d}" for k in range(COUNT)], case.start.points, normal=normal)
    result = self_calibrate(
        Observations(net.view, net.point, xy, net.cov), table, {"cam": Camera((1500, 1000), 1600.0)},
        [View(f"v{v:02d}", "cam") for v in range(VIEWS)], datum=Free(), ellipses=given, reject=False,
    )  # fmt: skip
    assert result
    fit = align(result.markers.xyz[~lost], case.truth.points[~lost])
    off = ((fit.apply(result.markers.xyz) - case.truth.points) * normal).sum(axis=1)
    bound = np.sqrt((fit.scale**2 * np.einsum("ni,nij,nj->n", normal, result.marker_cov, normal)).mean())
    assert np.sqrt((off[~lost] ** 2).mean()) < 2 * bound
    assert np.sqrt((off[lost] ** 2).mean()) < 2.5 * bound
    assert np.isnan(result.markers.radius[lost]).all()  # lent, not told


def test_radii_that_differ_are_lent_to_nobody():
    radius = np.array([10.0, 15.0, 20.0, 12.0, 17.0, np.nan])
    np.testing.assert_array_equal(with_common_radius(radius), radius)
    radius = np.array([10.0, 10.1, 9.9, 10.05, np.nan, 25.0, 10.0])
    np.testing.assert_allclose(with_common_radius(radius)[4], 10.0, atol=0.1)
    assert with_common_radius(radius)[5] == 25.0


@pytest.mark.parametrize("how", ["table", "auto"])
def test_the_surface_s_curvature_is_taken_off(how):
    """Discs on tubes of four times their radius; the table is in another frame than the cameras' start."""
    case, normal, _, _, _ = pictures(73, noise=0.0)
    rng, net = np.random.default_rng(5), case.network
    round_it = np.cross(normal, rng.normal(size=normal.shape))
    round_it /= np.linalg.norm(round_it, axis=1, keepdims=True)
    form = round_it[:, :, None] * round_it[:, None, :] / (4 * RADIUS)
    xy = net.xy + rng.normal(0, 0.01, net.xy.shape)
    for v in range(VIEWS):
        mine, pose = net.view == v, Pose(case.truth.frames.rotation[v], case.truth.frames.translation[v])
        p = net.point[mine]
        xy[mine] += imaged_ellipse(
            networks.CAMERA, pose.apply(case.truth.points[p]), pose.rotate(normal[p]), RADIUS, pose.rotate_form(form[p])
        ).eccentricity_px
    turn = Pose.from_rotvec([0.5, -0.8, 1.1], np.zeros(3))
    names = [f"m{k:02d}" for k in range(COUNT)]
    flat = MarkerSet.make(names, turn.apply(case.start.points), radius=RADIUS, normal=turn.rotate(normal))
    bent = replace(flat, curvature=turn.rotate_form(form))
    observations, off = Observations(net.view, net.point, xy, np.tile(1e-4 * np.eye(2), (len(xy), 1, 1))), {}
    camera, views = {"cam": Camera((1500, 1000), 1600.0)}, [View(f"v{v:02d}", "cam") for v in range(VIEWS)]
    for name, table in (("flat", flat), ("bent", bent)):
        result = self_calibrate(
            observations, table, camera, views,
            datum=Free(), eccentricity=how, reject=False, max_sigma0=50.0,
        )  # fmt: skip
        assert result
        fit = align(result.markers.xyz, case.truth.points)
        off[name] = np.sqrt(((fit.apply(result.markers.xyz) - case.truth.points) ** 2).sum(axis=1).mean())
    assert off["bent"] < 0.1 * off["flat"], off
