"""Residual maps, projection uncertainty, and halves of the pictures against each other."""

from dataclasses import replace
from types import SimpleNamespace

import matplotlib.pyplot
import networks
import numpy as np
import pytest

from windmark.calibration import Fixed, Free, self_calibrate
from windmark.calibration.quality import _interior_ratio, compare, projection_sigma, residual_map, split_half
from windmark.errors import DataError
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet, Observations, View


def calibrated(seed, views=14, **options):
    case = networks.make(seed, points=40, views=views)
    net = case.network
    markers = MarkerSet.make([f"m{i:02d}" for i in range(40)], case.start.points)
    result = self_calibrate(
        Observations(net.view, net.point, net.xy, net.cov), markers, {"cam": Camera((1500, 1000), 1600.0)},
        [View(f"v{v:02d}", "cam") for v in range(views)], datum=Free(), **options,
    )  # fmt: skip
    assert result
    return result


def test_right_models_leave_no_pattern():
    result = calibrated(51)
    seen = residual_map(result, "cam", columns=6)
    assert seen.count.sum() == result.used.sum()
    assert 0.6 < seen.excess < 1.4
    assert seen.radial.shape == (4, 6)


def test_radial_and_tangential_have_their_signs():
    result = calibrated(53)
    camera = result.cameras["cam"]
    arm = result.observations.xy - [camera.cx, camera.cy]
    out = residual_map(replace(result, residuals=0.01 * arm), "cam", columns=6)
    filled = out.count > 0
    assert (out.radial[filled] > 0).all()
    np.testing.assert_allclose(out.tangential[filled], 0, atol=1e-12)
    turned = residual_map(replace(result, residuals=0.01 * np.stack([-arm[:, 1], arm[:, 0]], axis=1)), "cam", columns=6)
    assert (turned.tangential[filled] > 0).all()


@pytest.mark.slow
def test_projection_sigma_is_that_of_sampled_cameras():
    camera = calibrated(54).cameras["cam"]
    x, y, sigma = projection_sigma(camera, columns=10)
    assert sigma.shape == (len(y), len(x))
    rng = np.random.default_rng(0)
    ray = camera.unproject(np.stack(np.meshgrid(x, y), axis=-1))
    xy, _, d_xyz, _ = camera.project_jacobian(ray)
    turn = np.cross(ray[..., None, :], d_xyz).reshape(-1, 3)
    squares = np.zeros(sigma.size)
    for _ in range(400):
        other = camera.with_parameters(rng.multivariate_normal(camera.parameters(), camera.cov))
        moved = (other.project(ray)[0] - xy).reshape(-1)
        left = moved - turn @ np.linalg.lstsq(turn, moved, rcond=None)[0]
        squares += (left.reshape(-1, 2) ** 2).mean(axis=1)
    np.testing.assert_allclose(np.sqrt(squares / 400), sigma.ravel(), rtol=0.2)
    with pytest.raises(ValueError, match="covariance"):
        projection_sigma(replace(camera, cov=None))


def test_halves_agree_within_their_sigma():
    half = split_half(calibrated(55, views=24))
    assert half
    assert 0.8 < half.comparison.ratio < 1.25
    z = [d / s for d, s in half.change["cam"].values()]
    assert np.abs(z).max() < 4
    assert half.comparison.difference.shape == (40, 3)


def test_two_sets_of_pictures_agree_within_both_covariances():
    """The paper's cross-check in both datums: mean squared differences in units of the covariances are near one."""
    for held in (False, True):
        squares = []
        for seed in range(62, 65):
            case = networks.make(seed, points=40, views=24)
            net, frames, start = case.network, case.truth.frames, case.start.points.copy()
            views = [View(f"v{v:02d}", "cam", "0", Pose(frames.rotation[v], frames.translation[v])) for v in range(24)]
            start[:4] = case.truth.points[:4]
            markers = MarkerSet.make([f"m{i:02d}" for i in range(40)], start)
            both = []
            for half in (0, 1):
                mine = net.view % 2 == half
                both.append(self_calibrate(
                    Observations(net.view[mine], net.point[mine], net.xy[mine], net.cov[mine]), markers,
                    {"cam": Camera((1500, 1000), 1600.0)}, views,
                    datum=Fixed([f"m{i:02d}" for i in range(4)]) if held else Free(),
                ))  # fmt: skip
            found = compare(*both)
            assert np.isnan(found.chi2).sum() == (4 if held else 0)
            squares.append(found.ratio**2)
        assert 0.8 < np.mean(squares) < 1.25


def test_a_lens_far_beyond_the_model_is_refused():
    case = networks.make(60, points=24, views=8)
    net = case.network
    bent = net.xy + 8 * np.sin((net.xy - [752, 495])[:, ::-1] / 60)
    markers = MarkerSet.make([f"m{i:02d}" for i in range(24)], case.start.points)
    result = self_calibrate(
        Observations(net.view, net.point, bent, net.cov), markers, {"cam": Camera((1500, 1000), 1600.0)},
        [View(f"v{v:02d}", "cam") for v in range(8)], datum=Free(),
    )  # fmt: skip
    assert not result
    assert result.cause == "misfit"


def test_a_lens_beyond_the_model_makes_halves_disagree():
    case = networks.make(56, points=40, views=24)
    net = case.network
    arm = (net.xy - [752, 495]) / 500
    bent = net.xy + 0.25 * np.sin(4 * arm[:, ::-1] + 2 * arm)
    markers = MarkerSet.make([f"m{i:02d}" for i in range(40)], case.start.points)
    result = self_calibrate(
        Observations(net.view, net.point, bent, net.cov * 4), markers, {"cam": Camera((1500, 1000), 1600.0)},
        [View(f"v{v:02d}", "cam") for v in range(24)], datum=Free(),
    )  # fmt: skip
    assert result
    half = split_half(result)
    assert half
    assert half.comparison.ratio > 1.0
    assert residual_map(result, "cam", columns=6).excess > 1.5


def test_too_few_pictures_cannot_be_halved():
    half = split_half(calibrated(57, views=4))
    assert not half or half.comparison.ratio > 0


def test_a_single_picture_has_no_halves():
    """Of a known target one is enough; nothing warns on the way."""
    rng, camera = np.random.default_rng(3), Camera((1500, 1000), 1600.0)
    xyz = rng.uniform(-1.0, 1.0, (40, 3)) * [200.0, 150.0, 60.0]
    xy = camera.project(Pose.look_at([200.0, 100.0, 900.0], [0, 0, 0], [0, 1, 0]).apply(xyz))[0]
    marks = Observations(
        np.zeros(40, int), np.arange(40), xy + rng.normal(0, 0.05, xy.shape), np.tile(0.0025 * np.eye(2), (40, 1, 1))
    )
    result = self_calibrate(
        marks, MarkerSet.make([f"m{i:02d}" for i in range(40)], xyz), {"cam": camera}, [View("v00", "cam")],
        datum=Fixed(), free=["focal_px"],
    )  # fmt: skip
    assert result
    half = split_half(result)
    assert not half
    assert (half.cause, half.reason) == ("too_few", "a single picture has no halves")


def test_calibrations_without_common_markers_are_refused():
    a, b = calibrated(58), calibrated(59)
    other = replace(b, markers=replace(b.markers, name=np.array([f"n{i}" for i in range(40)])))
    with pytest.raises(ValueError, match="common"):
        compare(a, other)


def test_a_plot_shows_one_cameras_residuals():
    matplotlib.use("Agg")
    result = calibrated(51)
    ax = replace(result, used=np.arange(len(result.used)) > 0).plot()
    np.testing.assert_allclose(ax.lines[0].get_xydata(), result.observations.xy[:1])
    drawn = ax.collections[0]
    np.testing.assert_allclose(drawn.U / drawn.U[0], (result.residuals[1:] / result.residuals[1])[:, 0])
    assert "residuals x" in ax.get_title()
    with pytest.raises(ValueError, match="plot: no camera 'x'"):
        result.plot("x")
    matplotlib.pyplot.close("all")


def test_projection_sigma_is_that_of_cameras_turned_onto_the_true_one():
    """Draws of the parameters; what a turn of the whole camera takes up is taken out by least squares."""
    rng = np.random.default_rng(3)
    camera = Camera((300, 200), 250.0, 1.0, 150.0, 100.0, k1=-0.1)
    cov = np.zeros((15, 15))
    root = rng.normal(size=(5, 5)) * np.array([0.5, 1e-3, 0.8, 0.8, 2e-3])[:, None]
    own = [0, 1, 2, 3, 4]
    cov[np.ix_(own, own)] = root @ root.T
    x, y, sigma = projection_sigma(replace(camera, cov=cov), columns=6)
    assert (len(x), len(y)) == (6, 4)
    pixel = np.stack(np.meshgrid(x, y), axis=-1)
    ray = camera.unproject(pixel)
    columns = [((camera.project(ray + 1e-6 * np.cross(w, ray))[0] - pixel) / 1e-6).ravel() for w in np.eye(3)]
    turn = np.linalg.lstsq(np.stack(columns, axis=1), np.eye(pixel.size), rcond=None)[0]
    off = []
    for _ in range(1500):
        step = np.zeros(15)
        step[own] = root @ rng.normal(size=5)
        moved = (camera.with_parameters(camera.parameters() + step).project(ray)[0] - pixel).ravel()
        off.append(moved - np.stack(columns, axis=1) @ (turn @ moved))
    drawn = np.sqrt((np.array(off) ** 2).mean(axis=0).reshape(4, 6, 2).mean(axis=2))
    np.testing.assert_allclose(sigma, drawn, rtol=0.12)  # 1500 draws: 2 % each, three sigmas of 24
    with pytest.raises(DataError, match="no covariance"):
        projection_sigma(camera)


def test_halves_change_by_their_sigmas_whatever_the_units():
    """A thousand pairs of cameras with correlated parameters: the ratio's square is one on average."""
    rng = np.random.default_rng(4)
    root = np.diag([3.0, 1e-3, 0.01]) @ rng.normal(size=(3, 3))
    at, camera, ratio = [0, 4, 6], Camera((300, 200), 250.0), []
    cov = np.zeros((15, 15))
    cov[np.ix_(at, at)] = root @ root.T
    for _ in range(1000):
        two = []
        for _ in range(2):
            step = np.zeros(15)
            step[at] = root @ rng.normal(size=3)
            two.append(SimpleNamespace(cameras={"c": camera.with_parameters(camera.parameters() + step, cov=cov)}))
        ratio.append(_interior_ratio(*two))
    assert np.mean(np.square(ratio)) == pytest.approx(1.0, abs=0.08)  # of three numbers each: 0.026
    known = SimpleNamespace(cameras={"c": camera})
    assert np.isnan(_interior_ratio(known, known))
