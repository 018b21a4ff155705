"""Self-calibration of small synthetic networks: truth found, errors named, failures explained."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.adjust import PaperOptions
from windmark.calibration import Calibration, Distance, Fixed, Free, NotCalibrated, Weighted, self_calibrate, solve
from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.geometry.similarity import align
from windmark.scene import MarkerSet, Observations, View


def run(case, **options):
    observations, markers, cameras, views, rig = networks.nouns(case, **options.pop("given", {}))
    return self_calibrate(observations, markers, cameras, views, **(rig | options))


def test_free_network_finds_cameras_poses_and_markers():
    case = networks.make(31, points=40, views=10)
    result = run(case, datum=Free())
    assert isinstance(result, Calibration)
    assert result.report.converged
    assert 0.85 < result.sigma0 < 1.15
    found, true = result.cameras["cam0"], networks.CAMERA
    for name in networks.NAMES:
        assert abs(getattr(found, name) - getattr(true, name)) < 4 * result.sigma("cam0", name)
    assert result.sigma("cam0", "k3") == 0
    moved = align(result.markers.xyz, case.truth.points).apply(result.markers.xyz) - case.truth.points
    chi2 = np.einsum("ni,nij,nj->n", moved, np.linalg.inv(result.marker_cov), moved)
    assert 2.0 < chi2.mean() < 4.2
    # It came out fitted to the table, scale included.
    fit = align(result.markers.xyz, case.start.points)
    assert fit.scale == pytest.approx(1, abs=1e-9)
    assert np.abs(fit.translation).max() < 1e-6


def test_a_picture_that_is_there_twice_counts_once():
    """Else its noise would count as an error of all others, and the sigmas would be too small."""
    observations, markers, cameras, views, _ = networks.nouns(networks.make(31, points=40, views=6))
    once = self_calibrate(observations, markers, cameras, views, datum=Free())
    mine = observations.view == 2
    twice = Observations(*(
        np.concatenate([whole, again]) for whole, again in (
            (observations.view, np.full(mine.sum(), len(views))), (observations.point, observations.point[mine]),
            (observations.xy, observations.xy[mine]), (observations.cov, observations.cov[mine]),
        )
    ))  # fmt: skip
    both = self_calibrate(twice, markers, cameras, [*views, replace(views[2], name="copy")], datum=Free())
    assert both.dropped["copy"].startswith(f"{views[2].name} once more")
    assert "copy" not in [v.name for v in both.views]
    np.testing.assert_allclose(both.marker_cov, once.marker_cov, rtol=1e-6)


def test_a_shear_is_found_with_its_sigma_and_is_nothing_where_there_is_none():
    """x gets 1.5e-3 of y: 1.5 px at the border, which no other parameter of these pictures shows."""
    for shear in (0.0, 1.5e-3):
        case = networks.make(35, points=40, views=10, camera=replace(networks.CAMERA, shear=shear))
        result = run(case, datum=Free(), free=(*networks.NAMES, "shear"))
        assert result
        assert 0.85 < result.sigma0 < 1.15
        assert 1e-6 < result.sigma("cam0", "shear") < 2e-4
        assert abs(result.cameras["cam0"].shear - shear) < 4 * result.sigma("cam0", "shear")
    assert run(case, datum=Free()).sigma0 > 1.3


def test_a_focus_that_nothing_checks_is_said_with_what_it_would_do():
    """Four pictures of a flat sheet: the largest change of the focal length that 0.3 % in one of them makes."""
    i, j = np.divmod(np.arange(64), 8)
    xyz = np.stack([i * 50.0 - 175, j * 50.0 - 175, np.zeros(64)], axis=1)
    camera, sigma_px = Camera((1600, 1200), 1500.0), 0.06
    eyes = [(-200, -150, 620), (220, -100, 560), (150, 230, 600), (-180, 200, 580)]
    poses = [Pose.look_at(eye, [0, 0, 0], [np.cos(k), np.sin(k), 0]) for k, eye in enumerate(eyes)]
    markers, views = MarkerSet.make([f"m{k}" for k in range(64)], xyz), [View(f"v{k}") for k in range(4)]

    def calibrated(change):
        cameras = [replace(camera, focal_px=1500.0 * (1 + c)) for c in change]
        seen = [c.project(p.apply(xyz))[0] for c, p in zip(cameras, poses, strict=True)]
        cov = np.full((256, 1, 1), sigma_px**2) * np.eye(2)
        obs = Observations(*np.divmod(np.arange(256), 64), np.concatenate(seen), cov)
        return self_calibrate(obs, markers, {"camera": camera}, views, datum=Free())

    result = calibrated(np.zeros(4))
    said = [w for w in result.warnings if "nothing checks" in w]
    moved = [abs(calibrated(0.003 * np.eye(4)[v]).cameras["camera"].focal_px - 1500.0) for v in range(4)]
    sigma = result.sigma("camera", "focal_px")
    assert [result.warnings, result.suspect] == [tuple(said), ()]
    assert len(said) == 1
    assert float(said[0].split("off by ")[1].split(" px")[0]) == pytest.approx(max(moved), rel=0.1)
    assert max(moved) > 3 * sigma


@pytest.mark.parametrize("views", [4, 16])
def test_pictures_that_focus_by_themselves_are_asked_for_their_principal_point(views):
    """That few do not show that it went along is said (0.3 % of the focal length are 4.5 px); many show it."""
    case = networks.make(47, points=40, views=views)
    own = [f"v{v:02d}" for v in range(views)]
    result = run(case, datum=Free(), free_focal=own, prior_sigma={"focus": 0.003})
    assert result
    said = [str(d) for d in result.doubts if d.cause == "focus"]
    assert len(said) == (views == 4)
    assert all("one principal point: 5 px (1 sigma) would mostly go unnoticed" in words for words in said)
    given = {"start": case.truth.points}
    assert run(case, datum=Fixed(), given=given, free_focal=own, prior_sigma={"focus": 0.003})  # no free marker moves
    both = run(case, datum=Free(), free_focal=own, free_principal=own, prior_sigma={"focus": 0.003, "principal": 5.0})
    assert both.doubts == ()


@pytest.mark.parametrize("rig", [False, True])
def test_pose_covariances_hold_the_truth(rig):
    case = networks.make(32, points=40, views=8, rig=rig)
    held = [0, 1, 2, 3]
    start = case.start.points.copy()
    start[held] = case.truth.points[held]
    result = run(case, datum=Fixed([f"m{i:02d}" for i in held]), given={"start": start})
    assert result
    chi2 = []
    for v, view in enumerate(result.views):
        i = int(view.name[1:])
        pose = Pose(case.truth.frames.rotation, case.truth.frames.translation)
        f, c = case.network.view_frame[i], case.network.view_camera[i]
        true = Pose(pose.rotation[f], pose.translation[f])
        if rig:
            true = Pose(case.truth.offsets.rotation[c], case.truth.offsets.translation[c]) @ true
        delta = (view.cam_from_model @ true.inverse()).log()
        chi2.append(delta @ np.linalg.solve(result.pose_cov[v], delta))
    assert 3.0 < np.mean(chi2) < 10.5
    assert (result.markers.sigma[held] == 0).all()
    np.testing.assert_array_equal(result.markers.xyz[held], case.truth.points[held])


def test_known_distance_gives_the_scale():
    case = networks.make(33, points=30)
    wrong = case.start.points * 1.03
    length = float(np.linalg.norm(case.truth.points[4] - case.truth.points[9]))
    result = run(case, datum=Free(), distances=[Distance("m04", "m09", length, 0.01)], given={"start": wrong})
    assert result
    assert align(result.markers.xyz, case.truth.points).scale == pytest.approx(1, abs=2e-3)


def test_weighted_markers_come_out_near_their_table():
    case = networks.make(34, points=30)
    start = case.start.points.copy()
    some = np.arange(6)
    start[some] = case.truth.points[some] + np.random.default_rng(0).normal(0, 0.05, (6, 3))
    result = run(case, datum=Weighted([f"m{i:02d}" for i in some], sigma=0.05), given={"start": start})
    assert result
    away = result.markers.xyz - case.truth.points
    assert np.abs(away).max() < 5 * result.markers.sigma.max()
    assert (result.markers.sigma[some] < 0.06).all()


def test_gross_errors_are_left_out_and_swaps_named():
    case = networks.make(35, points=40, views=10)
    rng, net = np.random.default_rng(1), case.network
    bad = rng.random(len(net.view)) < 0.1
    xy = net.xy + np.where(bad[:, None], rng.choice([-1, 1], net.xy.shape) * rng.uniform(2, 60, net.xy.shape), 0)
    a, b = np.flatnonzero(net.view == 3)[[2, 7]]
    xy[[a, b]] = net.xy[[b, a]]
    bad[[a, b]] = True
    result = run(networks.Case(replace(net, xy=xy), case.truth, case.start), datum=Free())
    assert result
    assert not (result.used & bad).any()
    assert (~result.used & ~bad).mean() < 0.005
    names = {f"m{net.point[a]:02d}", f"m{net.point[b]:02d}"}
    assert any({first, second} == names and view == "v03" for first, second, view in result.swapped)


def test_a_flat_guess_of_a_bumpy_plate_is_enough():
    case = networks.make(36, points=40, views=10)
    flat = case.truth.points * [1, 1, 0] + np.random.default_rng(2).normal(0, 15, (40, 3)) * [1, 1, 0]
    result = run(case, datum=Free(), given={"start": flat, "camera": replace(networks.ROUGH, focal_px=1530 * 0.8)})
    assert result
    assert 0.85 < result.sigma0 < 1.15


def test_eccentricity_of_large_discs_is_undone():
    case = networks.make(37, points=40, views=12, noise=0.02)
    net, rng = case.network, np.random.default_rng(3)
    normal = np.tile([0.0, 0.0, 1.0], (40, 1)) + rng.normal(0, 0.1, (40, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    xy = net.xy.copy()
    for v in range(12):
        mine = net.view == v
        pose = Pose(case.truth.frames.rotation[v], case.truth.frames.translation[v])
        p = net.point[mine]
        seen = imaged_ellipse(
            networks.CAMERA, pose.apply(case.truth.points[p]), pose.rotate(normal[p]), np.full(len(p), 18.0)
        )
        xy[mine] += seen.eccentricity_px
    observations, markers, cameras, views, _ = networks.nouns(
        networks.Case(replace(net, xy=xy), case.truth, case.start)
    )
    markers = replace(markers, radius=np.full(40, 18.0), normal=normal)
    focal = {}
    for how in ("table", "off"):
        result = self_calibrate(observations, markers, cameras, views, datum=Free(), eccentricity=how)
        assert result
        focal[how] = (result.cameras["cam0"].focal_px - 1530) / result.sigma("cam0", "focal_px")
        moved = align(result.markers.xyz, case.truth.points).apply(result.markers.xyz) - case.truth.points
        focal[how, "rms"] = np.sqrt((moved**2).sum(axis=1).mean())
    assert abs(focal["table"]) < 3.5
    assert focal["table", "rms"] < 0.6 * focal["off", "rms"]


def test_poor_views_and_markers_are_named():
    case = networks.make(38, points=30)
    net = case.network
    keep = np.ones(len(net.view), bool)
    keep[np.flatnonzero(net.view == 2)[3:]] = False
    keep[np.flatnonzero((net.point == 7) & (net.view != 0))] = False
    fewer = replace(net, view=net.view[keep], point=net.point[keep], xy=net.xy[keep], cov=net.cov[keep])
    result = run(networks.Case(fewer, case.truth, case.start), datum=Free())
    assert result
    assert "3 marks" in result.dropped["v02"]
    assert "m07" not in result.markers.name
    assert "v02" not in [v.name for v in result.views]


def test_frontal_pictures_do_not_give_a_focal_length():
    case = networks.make(39, points=30)
    flat = case.truth.points * [1, 1, 0]
    frames = Pose(np.tile(np.diag([1.0, -1.0, -1.0]), (8, 1, 1)), np.c_[np.zeros((8, 2)), np.linspace(1200, 1500, 8)])
    truth = replace(case.truth, points=flat, frames=frames)
    net = case.network
    xy, inside = networks.project(truth, net.view_frame, net.view_offset, net.view_camera, net.view, net.point)
    xy = xy + np.random.default_rng(0).normal(0, 0.1, xy.shape)
    network = replace(net, view=net.view[inside], point=net.point[inside], xy=xy[inside], cov=net.cov[inside])
    result = run(networks.Case(network, truth, replace(case.start, points=flat)), datum=Free(), free=("focal_px",))
    assert isinstance(result, NotCalibrated)
    assert result.cause == "degenerate"
    assert "focal_px" in result.weak


def test_a_datum_that_leaves_motions_is_refused():
    case = networks.make(40, points=30)
    result = run(case, datum=Fixed(["m00", "m01"]))
    assert isinstance(result, NotCalibrated)
    assert result.cause == "degenerate"
    assert "datum" in result.reason


def test_nonsense_is_refused_not_returned():
    case = networks.make(41, points=30)
    xy = np.random.default_rng(0).uniform(0, 1000, case.network.xy.shape)
    result = run(networks.Case(replace(case.network, xy=xy), case.truth, case.start), datum=Free())
    assert isinstance(result, NotCalibrated)
    assert result.reason


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"datum": "free"}, "datum"),
        ({"free": ("focus",)}, "focus"),
        ({"datum": Fixed(["nobody"])}, "nobody"),
        ({"eccentricity": "some"}, "eccentricity"),
        ({"free_focal": ["v99"]}, "v99"),
        ({"distances": [Distance("m00", "m99", 1.0, 0.1)]}, "m99"),
    ],
)
def test_wrong_options_are_named(change, word):
    case = networks.make(42)
    with pytest.raises(ValueError, match=word):
        run(case, **({"datum": Free()} | change))


def test_marks_given_twice_are_named():
    case = networks.make(43)
    net = case.network
    twice = replace(
        net, view=np.r_[net.view, net.view[:1]], point=np.r_[net.point, net.point[:1]], xy=np.r_[net.xy, net.xy[:1]],
        cov=np.r_[net.cov, net.cov[:1]],
    )  # fmt: skip
    with pytest.raises(ValueError, match="more than once in view v00"):
        run(networks.Case(twice, case.truth, case.start), datum=Free())


def test_a_view_with_a_focal_length_of_its_own():
    case = networks.make(44, points=40, views=10)
    change = np.where(np.arange(10) == 4, 0.012, 0.0)
    truth, net = replace(case.truth, change=np.outer(change, [1.0, 0.0, 0.0])), case.network
    xy, inside = networks.project(truth, net.view_frame, net.view_offset, net.view_camera, net.view, net.point)
    xy = xy + np.random.default_rng(0).normal(0, 0.02, xy.shape)
    network = replace(net, view=net.view[inside], point=net.point[inside], xy=xy[inside], cov=net.cov[inside])
    result = run(networks.Case(network, truth, case.start), datum=Free(), free_focal=["v04"])
    assert result
    assert result.focal_change[4] == pytest.approx(0.012, abs=1.5e-3)  # 1 sigma is 4e-4
    assert (np.delete(result.focal_change, 4) == 0).all()


def test_a_held_marker_in_the_wrong_place_is_suspected():
    case = networks.make(45, points=40, views=10)
    held = [0, 1, 2, 3, 4]
    start = case.start.points.copy()
    start[held] = case.truth.points[held]
    start[2] += [0, 0, 8.0]
    result = run(case, datum=Fixed([f"m{i:02d}" for i in held]), given={"start": start})
    assert result
    assert result.suspect == ("m02",)


@pytest.mark.slow
def test_the_papers_steps_find_the_same_calibration_or_say_that_they_do_not(monkeypatch):
    case = networks.make(39, points=11, views=4, seen=1.0)
    start = case.start.points.copy()
    start[:8] = case.truth.points[:8]
    given = {"given": {"start": start, "camera": networks.CAMERA}, "datum": Fixed([f"m{i:02d}" for i in range(8)])}
    exact = run(case, free=(), **given)
    found = run(case, free=(), solver="steps", **given)
    assert found.report.reason == "converged_step"
    assert found.report.evaluations > 50 * exact.report.evaluations
    assert found.options["solver"] == "steps"
    assert "max_passes" in found.report.options  # it is they that ended there
    sigma = np.maximum(exact.markers.sigma, 1e-9)
    assert np.abs((found.markers.xyz - exact.markers.xyz) / sigma).max() < 0.1
    np.testing.assert_allclose(found.markers.sigma, exact.markers.sigma, rtol=1e-3)
    # The valley of focal length and distance is longer than so many passes.
    monkeypatch.setattr(solve, "STEPS", PaperOptions(max_passes=10))
    refused = run(case, free=("focal_px",), solver="steps", **given)
    assert (refused.cause, bool(refused)) == ("not_converged", False)
    assert "max_iterations" in refused.reason


@pytest.mark.parametrize("datum", ["free", "fixed"])
def test_redundancy_counts_what_the_datum_leaves_open(datum):
    """Marks less unknowns; a free network has seven unknowns (place, direction, scale) that no mark asks for."""
    case = networks.make(41, points=25, views=6)
    held = [0, 1, 2]
    start = case.start.points.copy()
    start[held] = case.truth.points[held]
    how = Free() if datum == "free" else Fixed([f"m{i:02d}" for i in held])
    result = run(case, datum=how, reject=False, given={"start": start})
    assert result
    points = 3 * len(result.markers) if datum == "free" else 3 * (len(result.markers) - len(held))
    unknowns = len(networks.NAMES) + 6 * len(result.views) + points
    assert result.redundancy == 2 * int(result.used.sum()) - unknowns + (7 if datum == "free" else 0)


@pytest.mark.parametrize(
    ("parameter", "sigma"), [("focal_px", 0.01), ("aspect", 1e-7), ("cx", 0.01), ("k1", 1e-6), ("p1", 1e-8)]
)
def test_a_prior_that_is_surer_than_the_pictures_is_the_sigma_of_its_parameter(parameter, sigma):
    case = networks.make(42, points=30, views=8)
    result = run(case, datum=Free(), prior_sigma={parameter: sigma}, given={"camera": networks.CAMERA})
    assert result
    assert result.sigma("cam0", parameter) == pytest.approx(sigma * max(1.0, result.sigma0), rel=0.005)


def test_marks_without_noise_contradict_nothing():
    """Residuals of 1e-10 px are no evidence for another focus, or a picture that is not of the others."""
    case = networks.make(44, points=40, views=6, noise=1e-9, seen=1.0)
    cov = np.broadcast_to(0.01 * np.eye(2), case.network.cov.shape)
    exact = run(replace(case, network=replace(case.network, cov=cov)), datum=Free())
    assert exact.sigma0 < 1e-5
    assert exact.warnings == ()
    assert exact.dropped == {}
