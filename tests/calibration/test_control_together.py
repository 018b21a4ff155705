"""Known markers whose errors are correlated, as those of one survey are: `Weighted.covariance`."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.adjust.levenberg_marquardt import minimise
from windmark.adjust.network import KnownTogether, NetworkProblem, minimise_network_by_steps
from windmark.calibration import Calibration, NotCalibrated, Weighted, self_calibrate
from windmark.errors import UsageError
from windmark.geometry.rotations import hat
from windmark.scene import MarkerCovariance

KNOWN = [0, 1, 2, 3, 4, 5]
NAMES = [f"m{i:02d}" for i in KNOWN]
OWN = 0.02


def survey(xyz):
    """Covariance of points of one station 2 m away: what each has, and what the station's turn and scale do."""
    arm = xyz - [0.0, 0.0, 2000.0]
    shared = np.concatenate([-hat(arm) * 2e-4, 3e-4 * arm[:, :, None]], axis=2).reshape(-1, 4)
    return OWN**2 * np.eye(len(shared)) + shared @ shared.T


@pytest.fixture(scope="module")
def case():
    return networks.make(73, points=30, views=10)


def drawn(cov, seed):
    return np.random.default_rng(seed).multivariate_normal(np.zeros(len(cov)), cov).reshape(-1, 3)


def run(case, cov, *, seed=0, off=None, error=None, **weighted):
    start = case.start.points.copy()
    start[KNOWN] = case.truth.points[KNOWN] + drawn(survey(case.truth.points[KNOWN]) if error is None else error, seed)
    if off is not None:
        start[KNOWN[0]] += off
    observations, markers, cameras, views, _ = networks.nouns(case, start=start)
    datum = Weighted(covariance=MarkerCovariance(NAMES, cov)) if cov is not None else Weighted(NAMES, **weighted)
    return self_calibrate(observations, replace(markers, length_unit="mm"), cameras, views, datum=datum)


def deviations(case, result):
    """(6, 3) of the known markers from the truth, in units of what the result states."""
    at = [result.markers.name.tolist().index(n) for n in NAMES]
    return (result.markers.xyz[at] - case.truth.points[KNOWN]) / np.sqrt(
        np.diagonal(result.marker_cov[at], axis1=1, axis2=2)
    )


def test_a_diagonal_covariance_is_sigma(case):
    together = run(case, 0.05**2 * np.eye(18))
    alone = run(case, None, sigma=0.05)
    np.testing.assert_allclose(together.markers.xyz, alone.markers.xyz, atol=1e-6)
    np.testing.assert_allclose(together.marker_cov, alone.marker_cov, rtol=1e-5, atol=1e-12)
    assert together.sigma0 == pytest.approx(alone.sigma0, rel=1e-8)
    assert together.redundancy == alone.redundancy


@pytest.mark.slow
def test_what_it_states_holds(case):
    """Over surveys of one network: z of the known markers is 1, and no doubt is raised."""
    cov, z = survey(case.truth.points[KNOWN]), []
    for seed in range(18):
        result = run(case, cov, seed=seed)
        assert isinstance(result, Calibration)
        assert result.doubts == ()
        z.append(deviations(case, result))
    # Shared errors leave four numbers a survey, not eighteen: their mean square is 1 +- sqrt(2 / 72).
    assert np.square(z).mean() == pytest.approx(1.0, abs=4 * np.sqrt(2 / 72))


def test_what_all_share_is_not_averaged_away(case):
    """Errors that all share turn and grow the whole: as independent ones they would count as six that average."""
    cov = survey(case.truth.points[KNOWN])
    alike = run(case, np.diag(np.diag(cov)))
    told = run(case, cov)
    i, j = (told.markers.name.tolist().index(n) for n in ("m00", "m05"))
    away, true = (
        float(np.linalg.norm(xyz[i] - xyz[j])) for xyz in (told.markers.xyz, case.truth.points[[0, 1, 2, 3, 4, 5]])
    )
    assert abs(away - true) < 4 * np.sqrt(2 * OWN**2 + (3e-4 * true) ** 2)
    assert told.markers.sigma.mean() > 1.2 * alike.markers.sigma.mean()


def test_an_error_that_all_may_share_is_no_contradiction_but_one_alone_is(case):
    """0.8 mm in one point is within its own sigma of 0.7 mm, yet its neighbours would have it, too."""
    cov = survey(case.truth.points[KNOWN])
    assert np.sqrt(np.diag(cov)).max() > 0.5
    off = np.array([0.5, -0.5, 0.4])
    named = run(case, cov, off=off)
    assert named.suspect == ("m00",)
    assert named.warnings[0].startswith("control point m00 was left out")
    assert run(case, np.diag(np.diag(cov)), off=off).doubts == ()


def test_the_survey_s_own_free_network_is_singular_and_is_the_frame(case):
    """Inner constraints of the survey: the markers' mean place and direction are what the table says, exactly."""
    xyz = case.truth.points[KNOWN]
    arm = xyz - xyz.mean(axis=0)
    motions = np.concatenate([-hat(arm).reshape(-1, 3), np.tile(np.eye(3), (6, 1))], axis=1)
    cov = 0.05**2 * (np.eye(18) - motions @ np.linalg.pinv(motions))
    assert np.linalg.matrix_rank(cov, tol=1e-9) == 12
    result = run(case, cov, error=cov)
    assert isinstance(result, Calibration)
    at = [result.markers.name.tolist().index(n) for n in NAMES]
    given = result.options["datum"].covariance
    off = result.markers.xyz[at] - (xyz + drawn(cov, 0))
    assert np.abs(motions.T @ off.ravel() / np.sqrt((motions**2).sum(axis=0))).max() < 1e-3 * given.sigma.max()
    assert np.abs(off).max() > 0.1 * given.sigma.max()  # their shape is the pictures' as well


def test_derivatives_of_the_prior_are_right():
    """The gradient and the information of the joint prior beside differences of its cost, points eliminated or not."""
    rng = np.random.default_rng(3)
    case = networks.make(5, points=12, views=4)
    root = np.tril(rng.normal(size=(9, 9))) + 3 * np.eye(9)
    known = KnownTogether(np.array([1, 4, 7]), case.truth.points[[1, 4, 7]] + rng.normal(0, 1, (3, 3)), root)
    for eliminate in ("points", "frames"):
        problem = NetworkProblem(replace(case.network, together=known, eliminate=eliminate), case.truth)
        bare = NetworkProblem(replace(case.network, eliminate=eliminate), case.truth)
        assert problem.prior_cost(case.truth) == pytest.approx(
            0.5 * float((known.residual(case.truth.points) ** 2).sum()), rel=1e-12
        )
        assert bare.prior_cost(case.truth) == 0.0
        system = problem.linearise(case.truth)
        g = np.concatenate([system.g_d, system.g_e])
        for k in rng.choice(problem.size, 20, replace=False):
            step = np.zeros(problem.size)
            step[k] = 1e-6
            up, down = (problem.cost(problem.retract(case.truth, s * step)) for s in (1, -1))
            assert (up - down) / 2e-6 == pytest.approx(g[k], rel=1e-4, abs=1e-3 * np.abs(g).max())


def test_the_paper_s_steps_have_the_same_minimum():
    """Points alone are free: each by itself, but for those that are known together."""
    case, rng = networks.make(11, points=8, views=3, seen=1.0, free=()), np.random.default_rng(2)
    root = (np.eye(9) + 0.2 * rng.normal(size=(9, 9))) / 0.05
    known = KnownTogether(np.array([1, 4, 7]), case.truth.points[[1, 4, 7]] + rng.normal(0, 0.2, (3, 3)), root)
    network = replace(case.network, together=known, free_frame=np.zeros(3, bool))
    start = replace(case.truth, points=case.start.points)
    walked, report = minimise_network_by_steps(NetworkProblem(network, start), start)
    solved = minimise(NetworkProblem(network, start), start)[0]
    assert report.converged
    np.testing.assert_allclose(walked.points, solved.points, atol=1e-3)
    alone, _ = minimise_network_by_steps(NetworkProblem(replace(network, together=None), start), start)
    assert np.abs(walked.points - alone.points).max() > 0.05


@pytest.mark.parametrize(
    ("cov", "words"),
    [
        (np.eye(17), "must be \\(18, 18\\) for 6 names"),
        (np.diag([*np.ones(17), 0.0]), "variances > 0. .*not for m05"),
        (np.diag([*np.ones(17), np.nan]), "finite. .*not for m05"),
        (np.eye(18) + np.triu(np.ones((18, 18)), 17), "symmetric, not for m00 and m05"),
        (np.eye(18) - 0.5, "positive semidefinite"),
    ],
)
def test_what_is_no_covariance_is_refused(cov, words):
    with pytest.raises(UsageError, match=words):
        MarkerCovariance(NAMES, cov)


def test_names_that_the_table_lacks_are_refused(case):
    observations, markers, cameras, views, _ = networks.nouns(case)
    datum = Weighted(covariance=MarkerCovariance(["m00", "m01", "zz"], np.eye(9)))
    with pytest.raises(UsageError, match="datum's covariance names the unknown marker 'zz'"):
        self_calibrate(observations, markers, cameras, views, datum=datum)


def test_control_that_contradicts_itself_together_is_refused_or_named(case):
    """Two of three surveyed points: with three points any one may be wrong."""
    cov = MarkerCovariance(NAMES[:3], survey(case.truth.points[KNOWN[:3]]))
    start = case.start.points.copy()
    start[KNOWN[:3]] = case.truth.points[KNOWN[:3]]
    start[0] += [2.0, 0.0, 2.0]
    observations, markers, cameras, views, _ = networks.nouns(case, start=start)
    result = self_calibrate(observations, markers, cameras, views, datum=Weighted(covariance=cov))
    assert isinstance(result, NotCalibrated)
    assert (result.cause, result.weak) == ("control", ("m00", "m01", "m02"))
