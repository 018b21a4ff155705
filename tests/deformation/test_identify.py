"""The verb `identify` on projected points: estimates, covariance, outliers, what is not determined."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from swept_scenes import (
    BEAM,
    CAMERA,
    CAMERAS,
    MARKERS,
    MOTION,
    NOISE,
    PARTS,
    VIEWS,
    VOLUMES,
    WALL,
    Q,
    draws,
    observed,
    seen,
    z_of,
)

from windmark.deformation import (
    Deformation,
    LawError,
    NotIdentified,
    Volume,
    function_law,
    identify,
    with_parameters,
)
from windmark.deformation.laws import Beam, Hinge, Rigid, Smooth
from windmark.deformation.turned import rotated, turns
from windmark.geometry import Pose, imaged_ellipse
from windmark.scene import MarkerSet, Mesh, Observations


def whitened(result, q=Q, motion=MOTION):
    """Errors of laws and motion, whitened by their covariance."""
    delta = (result.tunnel_from_model @ motion.inverse()).log()
    error = np.concatenate([result.q - q, delta])
    keep = np.r_[result.slices["law"], result.slices["motion"]]
    return np.linalg.solve(np.linalg.cholesky(result.cov[np.ix_(keep, keep)]), error)


def test_two_cameras_give_every_parameter_with_its_sigma():
    found = draws(60, seen(), 1)
    first = found[0]
    assert isinstance(first, Deformation)
    assert (np.abs(z_of(first)) < 4).all()
    assert first.parameters.keys() == {"wing.bend_2", "wing.bend_3", "wing.twist_1", "wing.twist_2"}
    assert first.names[4:] == tuple(
        f"motion.{n}"
        for n in ("rotation_x", "rotation_y", "rotation_z", "translation_x", "translation_y", "translation_z")
    )
    z = np.array([whitened(r) for r in found])
    assert 0.9 < z.std() < 1.1  # of 600 numbers
    assert (np.abs(z.std(axis=0) - 1) < 0.35).all()
    assert np.abs(z.mean(axis=0)).max() < 4 / np.sqrt(60)
    sigma0 = np.array([r.sigma0 for r in found])
    assert abs(sigma0.mean() - 1) < 0.02
    assert first.redundancy == 2 * len(first.used) - 10
    assert sum(int((~r.used).sum()) for r in found) <= 1
    assert first.report.converged
    assert 0.9 < first.rms_px / (NOISE * np.sqrt(2)) < 1.1


def test_the_error_is_at_the_cramer_rao_bound():
    """The bound by an independent Jacobian: differences of what the cameras see."""
    truth = seen()
    steps = np.array([1e-3] * 4 + [1e-6] * 3 + [1e-3] * 3)

    def pixels(free):
        return seen(Q + free[:4], Pose.exp(free[4:]) @ MOTION).xy.ravel()

    j = np.stack([(pixels(h) - pixels(-h)) / (2 * h.sum()) for h in np.diag(steps)], axis=1)
    bound = np.linalg.inv(j.T @ j / NOISE**2)
    found = draws(100, truth, 2, reject=False)
    sigma = np.sqrt(np.diag(bound))
    np.testing.assert_allclose(found[0].cov / np.outer(sigma, sigma), bound / np.outer(sigma, sigma), atol=0.02)
    error = np.array([[*(r.q - Q), *(r.tunnel_from_model @ MOTION.inverse()).log()] for r in found])
    rms = np.sqrt((np.linalg.solve(np.linalg.cholesky(bound), error.T) ** 2).mean())
    assert rms == pytest.approx(1.0, abs=0.1)


def test_places_and_grid_have_the_right_covariance():
    truth, found = seen(), draws(60, seen(), 3)
    model = MARKERS.take(~WALL)
    expected = MOTION.apply(VOLUMES.bind(model.xyz, model.volume).place(Q))
    z = []
    for r in found:
        place, cov = r.place(model.xyz, model.volume)
        z.append(
            np.linalg.solve(np.linalg.cholesky(cov[[4, 27, 55]]), (place - expected)[[4, 27, 55], :, None])[..., 0]
        )
    assert 0.85 < np.std(z) < 1.15
    r = found[0]
    moved, cov = r.displacement(model.xyz, model.volume, frame="model")
    every, its_cov = r.markers_displaced(frame="model")
    np.testing.assert_allclose(every[~WALL], moved)
    np.testing.assert_allclose(its_cov[~WALL], cov)
    np.testing.assert_allclose(moved[50:], 0, atol=1e-12)
    np.testing.assert_allclose(cov[50:], 0, atol=1e-12)
    assert np.linalg.norm(moved[45:50], axis=1).min() > 5
    mesh = Mesh(model.xyz[:4], np.array([[0, 1, 2]]), np.array(["wing"]))
    np.testing.assert_allclose(r.mesh(mesh).vertices[:3], r.place(model.xyz[:3], "wing")[0])
    np.testing.assert_allclose(r.mesh(mesh).vertices[3], r.tunnel_from_model.apply(model.xyz[3]))
    with pytest.raises(ValueError, match="frame: expected 'tunnel' or 'model', got 'wind'"):
        r.place(model.xyz, "wing", frame="wind")
    assert len(truth.view) == len(r.used)


def test_twenty_gross_errors_are_all_found():
    truth, rng = seen(), np.random.default_rng(4)
    good = observed(truth, rng)
    assert len(good) >= 110
    for _ in range(4):
        bad = rng.choice(len(good), 20, replace=False)
        xy = good.xy.copy()
        angle = rng.uniform(0, 2 * np.pi, 20)
        xy[bad] += rng.uniform(1, 30, (20, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        found = identify(replace(good, xy=xy), MARKERS, PARTS, CAMERAS, VIEWS)
        assert found
        assert set(np.flatnonzero(~found.used)) == set(bad)
        assert (np.abs(z_of(found)) < 4).all()
        assert found.sigma0 == pytest.approx(1, abs=0.2)
        assert (found.test[bad] > 30).all()
    kept = identify(replace(good, xy=xy), MARKERS, PARTS, CAMERAS, VIEWS, reject=False)
    assert kept.used.all()
    assert kept.sigma0 > 10


def test_nothing_fits():
    rng = np.random.default_rng(5)
    spots = observed(seen(), rng)
    mixed = replace(spots, xy=rng.permutation(spots.xy))
    found = identify(mixed, MARKERS, PARTS, CAMERAS, VIEWS)
    assert not found
    assert found.cause in ("no_fit", "no_convergence", "behind", "undetermined")
    assert found.reason


def test_places_of_markers_that_are_known_with_a_sigma():
    """0.1 mm is 0.2 px, four times the noise: cameras see the same error."""
    set_of = replace(MARKERS, sigma=np.where(WALL[:, None], np.nan, np.full((72, 3), 0.1)))
    rng, z, exact, found, plain = np.random.default_rng(6), [], [], None, None
    worse = []
    for k in range(60):
        xyz = MARKERS.xyz + 0.1 * rng.standard_normal((72, 3))
        spots = observed(seen(xyz=xyz), rng)
        found = identify(spots, set_of, PARTS, CAMERAS, VIEWS, start=found)
        z.append(whitened(found))
        if k < 20:
            plain = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS, reject=False, start=plain)
            exact.append(whitened(plain))
            worse.append(plain.sigma0)
            assert any("sigma0" in words for words in plain.warnings)
        assert found.sigma0 == pytest.approx(1, abs=0.25)
    assert 0.9 < np.std(z) < 1.1
    assert np.std(exact) * np.mean(worse) > 2  # as the spots alone would have it
    assert np.std(exact) < 1.3  # it is said, and the sigmas hold
    given = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS, marker_cov=0.01 * np.tile(np.eye(3), (72, 1, 1)))
    np.testing.assert_allclose(np.diag(given.cov), np.diag(found.cov), rtol=1e-2)


def test_cameras_that_moved_are_held_by_the_wall():
    """Moved by 2 mm and 0.2 degrees: with wall markers the covariance holds, without none is told from the other."""
    rng, z, refused = np.random.default_rng(7), [], []
    for _ in range(40):
        delta = np.concatenate([np.radians(0.2) * unit(rng), 2 * unit(rng)])
        poses = [Pose.exp(s * delta) @ v.cam_from_model for s, v in zip((1, -1), VIEWS, strict=True)]
        spots = observed(seen(poses=poses, wall=True), rng)
        found = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS, free_poses=True)
        assert found
        z.append(whitened(found))
        for name, pose in zip(("v0", "v1"), poses, strict=True):
            error = (found.cam_from_tunnel[name] @ pose.inverse()).log()
            cov = found.cov[found.slices[f"{name}.pose"], found.slices[f"{name}.pose"]]
            assert error @ np.linalg.solve(cov, error) < 35  # six degrees of freedom
        if len(refused) < 10:
            model = observed(seen(poses=poses), rng)
            refused.append(identify(model, MARKERS, PARTS, CAMERAS, VIEWS, reject=False))
    assert 0.9 < np.std(z) < 1.1
    assert [(r.cause, set(r.weak)) for r in refused] == [("moved", {"v0", "v1"})] * 10


def unit(rng):
    v = rng.standard_normal(3)
    return v / np.linalg.norm(v)


def test_a_focal_length_that_changed():
    rng = np.random.default_rng(8)
    spots = observed(seen(wall=True), rng)
    wrong = {"c0": replace(CAMERA, focal_px=CAMERA.focal_px * 1.002), "c1": CAMERA}
    found = identify(spots, MARKERS, PARTS, wrong, VIEWS, free_poses=["v0"], free_focal=["c0"])
    assert found
    sigma = found.sigma["c0.camera.focal_px"]
    assert sigma < 4
    assert abs(found.cameras["c0"].focal_px - CAMERA.focal_px) < 4 * sigma
    assert found.cameras["c1"] == CAMERA
    assert (np.abs(z_of(found)) < 4).all()


def one_camera(truth):
    return truth.view == 0


def test_one_camera():
    """The law and the relief make it enough; along the line of sight it is worse."""
    two = draws(1, seen(), 9)[0]
    rng = np.random.default_rng(10)
    found = []
    for _ in range(50):
        start = found[0] if found else None
        spots = observed(seen(), rng, only=one_camera)
        found.append(identify(spots, MARKERS, PARTS, CAMERAS, VIEWS[:1], start=start))
    assert all(found)
    assert 0.88 < np.std([whitened(r) for r in found]) < 1.12
    assert found[0].sigma["wing.bend_2"] > 1.3 * two.sigma["wing.bend_2"]
    moved = found[0].place(MARKERS.xyz[49:50], "wing")[1][0]
    sight = VIEWS[0].cam_from_model.rotation[2]
    across = VIEWS[0].cam_from_model.rotation[0]
    assert sight @ moved @ sight > 4 * (across @ moved @ across)


def test_what_is_not_determined_is_named():
    rng = np.random.default_rng(11)
    spots = observed(seen(), rng, only=lambda t: t.point >= 50)
    found = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS)
    assert isinstance(found, NotIdentified)
    assert not found
    assert found.cause == "undetermined"
    assert set(found.weak) == set(VOLUMES.names)
    assert "no marker that is seen moves with wing.bend_2" in found.reason

    every = observed(seen(), rng)
    repeated = [Volume("wing", BEAM, "body"), Volume("body", Rigid(unit="mm"))]
    found = identify(every, MARKERS, repeated, CAMERAS, VIEWS)
    assert found.cause == "undetermined"
    assert {"body", "motion"} <= {n.split(".")[0] for n in found.weak}
    assert "a law may repeat the rigid motion" in found.reason
    held = identify(every, MARKERS, repeated, CAMERAS, VIEWS, free_motion=False)
    assert held
    assert held.parameters["body.turn_y"] == pytest.approx(2.0, abs=0.1)

    found = identify(every, MARKERS, PARTS, CAMERAS, VIEWS, free_poses=True)
    assert found.cause == "undetermined"
    assert found.weak == ("motion", "v0", "v1")
    assert "no marker on a wall is found" in found.reason

    few = observed(seen(), rng, only=lambda t: t.point < 2)
    found = identify(few, MARKERS, PARTS, CAMERAS, VIEWS)
    assert found.cause == "too_few"
    assert "4 observations cannot tell 10 unknowns" in found.reason
    assert (
        identify(observed(seen(), rng, only=lambda t: t.point < 0), MARKERS, PARTS, CAMERAS, VIEWS).cause == "too_few"
    )


def test_a_start_behind_the_camera():
    away = Pose.from_rotvec([np.pi, 0, 0], [0, 0, 0]) @ VIEWS[0].cam_from_model
    spots = observed(seen())
    found = identify(spots, MARKERS, PARTS, CAMERAS, [replace(VIEWS[0], cam_from_model=away), VIEWS[1]])
    assert found.cause == "behind"
    first, *_, last = spots.point[spots.view == 0]
    assert f"{MARKERS.name[first]} in {VIEWS[0].name}" in found.reason
    assert f"and {(spots.view == 0).sum() - 5} more" in found.reason
    assert MARKERS.name[last] not in found.reason


def test_priors_stand_in_for_what_is_not_seen():
    flap = Volume("flap", with_parameters(Hinge((300, 300, 0), (300, 400, 0)), {"angle": {"sigma": 3.0}}), "wing")
    found = identify(observed(seen(), np.random.default_rng(12)), MARKERS, [*PARTS, flap], CAMERAS, VIEWS)
    assert found
    assert found.from_prior == ("flap.angle",)
    assert found.sigma["flap.angle"] == pytest.approx(3.0)
    assert found.parameters["flap.angle"] == pytest.approx(0.0, abs=1e-6)
    assert (np.abs(z_of(found, np.append(Q, 0.0))) < 4).all()


def test_a_motion_that_is_known_before():
    """One camera, markers on a line across: the prior of the motion holds what it cannot see."""
    cov = block_diag(np.radians(0.05) ** 2 * np.eye(3), 0.5**2 * np.eye(3))
    rng, z = np.random.default_rng(13), []
    for _ in range(30):
        delta = np.linalg.cholesky(cov) @ rng.standard_normal(6)
        motion = Pose.exp(delta)
        spots = observed(seen(motion=motion), rng, only=one_camera)
        found = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS[:1], motion_cov=cov)
        z.append(whitened(found, motion=motion))
    assert 0.85 < np.std(z) < 1.15


def test_a_parameter_that_ends_at_its_bound():
    held = with_parameters(BEAM, {"bend_2": {"upper": 10.0}})
    parts = [Volume("wing", held, "body"), Volume("body")]
    found = identify(observed(seen(), np.random.default_rng(14)), MARKERS, parts, CAMERAS, VIEWS, reject=False)
    assert found.at_bound == ("wing.bend_2",)
    assert found.parameters["wing.bend_2"] == 10.0
    assert found.redundancy == 2 * len(found.used) - 9
    fixed = [
        Volume("wing", function_law(lambda xyz, b3, t1, t2: BEAM.bind(xyz).place(np.array([10, b3, t1, t2])))),
        PARTS[1],
    ]
    same = identify(observed(seen(), np.random.default_rng(14)), MARKERS, fixed, CAMERAS, VIEWS, reject=False)
    np.testing.assert_allclose(found.q[1:], same.q, rtol=1e-3)
    # The images contradict the bound: that is said, and nothing else is blamed; the sigmas hold what it may do.
    (doubt,) = found.doubts
    assert (doubt.names, doubt.cause) == (("wing.bend_2",), "bound")
    assert "ended at its bound 10" in str(doubt)
    assert abs(float(str(doubt).split("ask for about ")[1].split()[0]) - Q[0]) < 0.5
    off = found.q - Q
    sigma = np.array([found.sigma[n] for n in found.volumes.names])
    assert (np.abs(off) < 3 * sigma).all()
    assert sigma[1] > 2 * np.sqrt(same.cov[0, 0])


def test_a_bound_that_the_images_do_not_contradict_is_no_doubt():
    """At its bound by the noise alone; its sigma is what the images tell."""
    whole = identify(observed(seen(), np.random.default_rng(14)), MARKERS, PARTS, CAMERAS, VIEWS)
    sigma, value = whole.sigma["wing.bend_2"], whole.parameters["wing.bend_2"]
    parts = [Volume("wing", with_parameters(BEAM, {"bend_2": {"upper": value - 0.5 * sigma}}), "body"), PARTS[1]]
    found = identify(observed(seen(), np.random.default_rng(14)), MARKERS, parts, CAMERAS, VIEWS)
    assert found.at_bound == ("wing.bend_2",)
    assert not found.doubts
    assert sigma < found.sigma["wing.bend_2"] < 1.3 * sigma


def test_a_user_s_function_does_as_well():
    function = function_law(
        lambda xyz, tip, twist: BEAM.bind(xyz).place(np.array([tip, 0.0, twist, 0.0])), {"tip": "mm", "twist": "deg"}
    )
    q = np.array([13.0, 0, 1.0, 0])
    spots = observed(seen(q), np.random.default_rng(15))
    parts = [Volume("wing", function, "body"), Volume("body")]
    found = identify(spots, MARKERS, parts, CAMERAS, VIEWS)
    plain = Beam(BEAM.root, BEAM.tip, bend=type(BEAM.bend)((2,)), twist=type(BEAM.twist)((1,)), section=(0, 1, 0))
    same = identify(spots, MARKERS, [Volume("wing", plain, "body"), Volume("body")], CAMERAS, VIEWS)
    np.testing.assert_allclose(found.q, same.q, rtol=1e-6)
    np.testing.assert_allclose(found.cov, same.cov, rtol=1e-5, atol=1e-12)

    def broken(xyz, tip):
        raise LawError("own.py:7: no")

    with pytest.raises(LawError, match=r"own\.py:7"):
        identify(spots, MARKERS, [Volume("wing", function_law(broken))], CAMERAS, VIEWS)


def test_free_displacement_with_smoothness():
    wing = MARKERS.volume == "wing"
    law = Smooth(MARKERS.xyz[wing], (0.5, 0.5, 15.0), 350.0, unit="mm")
    found = identify(
        observed(seen(motion=Pose.identity()), np.random.default_rng(16)), MARKERS, [Volume("wing", law)], CAMERAS,
        VIEWS, free_motion=False,
    )  # fmt: skip
    assert found
    place, cov = found.place(MARKERS.xyz[wing], "wing")
    expected = VOLUMES.bind(MARKERS.xyz[wing], "wing").place(Q)
    z = (place - expected)[:, 2] / np.sqrt(cov[:, 2, 2])
    assert np.sqrt((z**2).mean()) < 2
    assert np.abs(place - expected).max() < 0.3


def test_a_start_near_the_answer_gives_the_same_answer_sooner():
    rng = np.random.default_rng(17)
    before = identify(observed(seen(), rng), MARKERS, PARTS, CAMERAS, VIEWS)
    spots = observed(seen(Q * 1.02), rng)
    cold = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS)
    warm = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS, start=before)
    assert (np.abs(warm.q - cold.q) < 1e-2 * np.sqrt(np.diag(cold.cov)[:4])).all()
    np.testing.assert_allclose(warm.cov, cold.cov, rtol=1e-3, atol=1e-9)
    assert warm.report.evaluations < cold.report.evaluations + 3
    wall = observed(seen(wall=True), rng)
    free = {"free_poses": True, "free_focal": ["c1"]}
    first = identify(wall, MARKERS, PARTS, CAMERAS, VIEWS, **free)
    again = identify(wall, MARKERS, PARTS, CAMERAS, VIEWS, start=first, **free)
    assert again.cameras["c1"].focal_px == pytest.approx(first.cameras["c1"].focal_px, abs=0.1)


def test_a_spot_that_is_known_badly_hardly_counts():
    """Neither in the answer nor in the residuals' size."""
    spots = observed(seen(), np.random.default_rng(19))
    plain = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS)
    xy, cov = spots.xy.copy(), spots.cov.copy()
    xy[7] += [1.5, -2.0]
    cov[7] = 3.0**2 * np.eye(2)
    found = identify(replace(spots, xy=xy, cov=cov), MARKERS, PARTS, CAMERAS, VIEWS)
    assert found.used.all()
    assert np.hypot(*found.residuals_px[7]) > 1
    assert found.rms_px == pytest.approx(plain.rms_px, rel=0.05)
    assert (np.abs(found.q - plain.q) < 0.5 * np.sqrt(np.diag(plain.cov)[:4])).all()


def test_discs_eccentricity_is_taken_off():
    normal = np.where(WALL[:, None], [0, 0, 1.0], [0.0, 0.2, 1.0])
    set_of = MarkerSet.make(
        MARKERS.name, MARKERS.xyz, radius=8.0, normal=normal, volume=MARKERS.volume, role=MARKERS.role
    )
    spots = observed(seen())
    volume = np.where(WALL, "", MARKERS.volume)
    place = MOTION.apply(VOLUMES.bind(MARKERS.xyz, volume).place(Q))
    # Two lines in the surface go where the laws take them: a disc's normal stays upright on it.
    lines = [np.broadcast_to([1.0, 0.0, 0.0], normal.shape), np.cross(normal, [1.0, 0.0, 0.0])]
    moved = [VOLUMES.bind(MARKERS.xyz + 0.01 * line, volume).place(Q) - MOTION.inverse().apply(place) for line in lines]
    bent = np.cross(*moved)
    xy = spots.xy.copy()
    for k, v in enumerate(VIEWS):
        own = spots.view == k
        p = spots.point[own]
        turned = MOTION.rotate(bent[p] / np.linalg.norm(bent[p], axis=1, keepdims=True))
        pose = v.cam_from_model
        xy[own] = imaged_ellipse(CAMERA, pose.apply(place[p]), pose.rotate(turned), set_of.radius[p]).xy
    found = identify(replace(spots, xy=xy), set_of, PARTS, CAMERAS, VIEWS)
    assert np.abs(xy - spots.xy).max() > 0.02
    assert found.rms_px < 1e-3
    np.testing.assert_allclose(found.q, Q, atol=2e-3)
    start = replace(found, q=1.001 * found.q)
    off = _off_at(start, spots, set_of)
    given = identify(replace(spots, xy=xy), set_of, PARTS, CAMERAS, VIEWS, start=start, eccentricity=off)
    plain = identify(replace(spots, xy=xy), set_of, PARTS, CAMERAS, VIEWS, start=start)
    np.testing.assert_allclose(given.q, plain.q, rtol=1e-9)
    wrong = identify(replace(spots, xy=xy), set_of, PARTS, CAMERAS, VIEWS, start=start, eccentricity=0 * off)
    assert wrong.rms_px > 10 * given.rms_px


def _off_at(state, spots, set_of):
    """(O, 2) eccentricity of the discs in a state."""
    place = state.tunnel_from_model.apply(state.placed.place(state.q))
    place[WALL] = set_of.xyz[WALL]
    bent = rotated(turns(state.placed, state.q, set_of.normal), set_of.normal)
    turned = np.where(WALL[:, None], set_of.normal, state.tunnel_from_model.rotate(bent))
    out = np.empty((len(spots), 2))
    for k, v in enumerate(VIEWS):
        own, pose = spots.view == k, v.cam_from_model
        p = spots.point[own]
        out[own] = imaged_ellipse(
            CAMERA, pose.apply(place[p]), pose.rotate(turned[p]), set_of.radius[p]
        ).eccentricity_px
    return out


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"cameras": {"c0": CAMERA}}, "views: camera 'c1' of v1 is not one of c0"),
        ({"views": []}, "views: expected at least one"),
        ({"views": [VIEWS[0], VIEWS[0]]}, "distinct names"),
        ({"views": [VIEWS[0], replace(VIEWS[1], cam_from_model=None)]}, "views: v1 has no pose"),
        ({"views": VIEWS[:1]}, "observations: view must be 0 to 0, got 0 to 1"),
        ({"free_poses": ["v7"]}, "free_poses: 'v7' is not one of v0, v1"),
        ({"free_focal": ["v0"]}, "free_focal: 'v0' is not one of c0, c1"),
        ({"motion_cov": np.eye(3)}, r"motion_cov: expected \(6, 6\), got \(3, 3\)"),
        ({"motion_cov": -np.eye(6)}, "motion.*positive definite"),
        ({"pose_cov": {"v0": np.eye(2)}, "free_poses": ["v0"]}, r"pose_cov of v0: expected \(6, 6\), got \(2, 2\)"),
        ({"pose_cov": {"v9": np.eye(6)}}, "pose_cov: 'v9' is not one of v0, v1"),
        ({"eccentricity": np.zeros((3, 2))}, r"eccentricity: expected \(\d+, 2\), finite, got \(3, 2\)"),
        ({"marker_cov": np.eye(3)}, r"marker_cov: expected \(72, 3, 3\), finite, got \(3, 3\)"),
    ],
)
def test_wrong_input_is_named(change, words):
    given = {"cameras": CAMERAS, "views": VIEWS, **change}
    with pytest.raises(ValueError, match=words):
        identify(observed(seen()), MARKERS, PARTS, given.pop("cameras"), given.pop("views"), **given)


def test_a_marker_seen_twice_in_one_view():
    spots = observed(seen())
    point = spots.point.copy()
    point[1] = point[0]
    with pytest.raises(ValueError, match=f"view v0 has marker m{point[0]} more than once"):
        identify(replace(spots, point=point), MARKERS, PARTS, CAMERAS, VIEWS)


def test_spots_without_a_covariance():
    spots = observed(seen())
    cov = spots.cov.copy()
    cov[3] = [[1.0, 2.0], [2.0, 1.0]]
    with pytest.raises(ValueError, match=r"cov must be positive definite, got .* of observation 3"):
        identify(replace(spots, cov=cov), MARKERS, PARTS, CAMERAS, VIEWS)


def test_spots_of_unequal_and_correlated_noise():
    """Whitened by their own covariance, with and without uncertain markers."""
    rng = np.random.default_rng(18)
    truth = seen()
    half = np.tril(rng.uniform(0.02, 0.2, (len(truth.xy), 2, 2)))
    spots = Observations(
        truth.view, truth.point, truth.xy + (half @ rng.standard_normal((len(half), 2, 1)))[..., 0],
        half @ np.swapaxes(half, 1, 2),
    )  # fmt: skip
    found = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS)
    assert found.sigma0 == pytest.approx(1, abs=0.2)
    assert (np.abs(z_of(found)) < 4).all()
    nearly = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS, marker_cov=1e-12 * np.tile(np.eye(3), (72, 1, 1)))
    np.testing.assert_allclose(nearly.cov, found.cov, rtol=1e-3, atol=1e-9)


def test_a_camera_that_no_view_has_is_not_free():
    cameras = {**CAMERAS, "spare": CAMERA}
    found = identify(observed(seen(wall=True)), MARKERS, PARTS, cameras, VIEWS, free_poses=True, free_focal=True)
    assert found
    assert {n for n in found.names if n.endswith("focal_px")} == {"c0.camera.focal_px", "c1.camera.focal_px"}


def test_a_parameter_whose_sigma_the_images_contradict():
    """All else followed it, and the cameras were blamed."""
    held = with_parameters(BEAM, {"bend_2": {"sigma": 0.02}})
    parts, spots = [Volume("wing", held, "body"), Volume("body")], observed(seen(), np.random.default_rng(14))
    found = identify(spots, MARKERS, parts, CAMERAS, VIEWS, reject=False)
    (doubt,) = found.doubts
    assert (doubt.names, doubt.cause) == (("wing.bend_2",), "prior")
    assert abs(float(str(doubt).split("ask for about ")[1].split()[0]) - Q[0]) < 0.5
    sigma = np.sqrt(np.diag(found.cov)[found.slices["law"]])
    assert (np.abs(found.q - Q) < 3 * sigma).all()
    # A wrong one that the images outweigh does no harm; nothing else is blamed for it.
    wide = [Volume("wing", with_parameters(BEAM, {"bend_2": {"sigma": 2.0}}), "body"), Volume("body")]
    free = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS, reject=False)
    light = identify(spots, MARKERS, wide, CAMERAS, VIEWS, reject=False)
    assert light.doubts == free.doubts == ()
    assert (np.abs(light.q - free.q) < np.sqrt(np.diag(free.cov)[free.slices["law"]])).all()
    assert light.sigma["wing.bend_2"] > free.sigma["wing.bend_2"]
