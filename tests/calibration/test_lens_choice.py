"""Wide lenses: calibrated from marks, and the lens model chosen by evidence."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from windmark.calibration import Free, lens_choice, self_calibrate
from windmark.calibration.lens_choice import (
    GROSS,
    _log_evidence,
    as_lens,
    choose_lens,
    field_deg,
    judged,
    lens_words,
)
from windmark.calibration.lens_known import RADIAL, radial_spread
from windmark.errors import UsageError
from windmark.geometry import PARAMETERS, Camera, Pose
from windmark.geometry.similarity import align
from windmark.scene import MarkerSet, Observations, View

SIZE = (1600, 1200)
TRUE = {
    "brown": Camera(SIZE, 1000.0, 1.0, 805.0, 590.0, k1=-0.1, k2=0.03),
    "rational": Camera(SIZE, 800.0, 1.0, 805.0, 590.0, 0.4, 0.05, k3=1e-3, k4=0.75, k5=0.2, k6=0.01, lens="rational"),
    "fisheye": Camera(SIZE, 570.0, 1.0, 805.0, 590.0, k1=-0.02, k2=3e-3, k3=-1e-3, k4=1e-4, lens="fisheye"),
}
VIEWS, NOISE = 9, 0.1


def marks(camera, seed):
    """Markers (N, 3) near the camera all round, and their marks in pictures from near by."""
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.linspace(-500, 500, 12), np.linspace(-500, 500, 10)), -1).reshape(-1, 2)
    xyz = np.column_stack([grid + rng.normal(0, 10, grid.shape), rng.normal(0, 60, len(grid))])
    view, point, xy = [], [], []
    for i in range(VIEWS):
        around, up = rng.uniform(0, 2 * np.pi), rng.uniform(0, 0.8)
        eye = np.array([np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), -np.cos(up)]) * rng.uniform(250, 450)
        target = np.array([*rng.uniform(-100, 100, 2), 0])
        pose = Pose.look_at(eye + np.array([*rng.uniform(-150, 150, 2), 0]), target, [np.cos(i), np.sin(i), 0.1])
        seen, valid = camera.project(pose.apply(xyz))
        there = np.flatnonzero(valid & camera.in_image(seen))
        view.append(np.full(len(there), i))
        point.append(there)
        xy.append(seen[there] + rng.normal(0, NOISE, (len(there), 2)))
    count = sum(map(len, view))
    cov = np.broadcast_to(NOISE**2 * np.eye(2), (count, 2, 2)).copy()
    return xyz, Observations(np.concatenate(view), np.concatenate(point), np.concatenate(xy), cov)


def calibrated(camera, seed):
    xyz, obs = marks(camera, seed)
    rough = xyz + np.random.default_rng(seed + 1).normal(0, 5, xyz.shape)
    table = MarkerSet.make([f"m{k}" for k in range(len(xyz))], rough)
    views = [View(f"v{i}", "c", f"v{i}") for i in range(VIEWS)]

    def run(cameras, **options):
        return self_calibrate(obs, table, cameras, views, datum=Free(), **options)

    return xyz, obs, run


@pytest.mark.slow
@pytest.mark.parametrize("lens", TRUE)
def test_the_right_lens_is_chosen_and_its_sigmas_are_true(lens):
    xyz, obs, run = calibrated(TRUE[lens], 3)
    focal = TRUE[lens].focal_px
    starts = {name: {"c": Camera(SIZE, 1.05 * focal, lens=name)} for name in TRUE}
    tried = choose_lens(lambda cameras: run(cameras, max_sigma0=np.inf), starts, len(obs))
    best = tried[0].outcome
    assert tried[0].lens == lens, lens_words(tried)
    assert best.sigma0 == pytest.approx(1.0, abs=0.06)
    known = xyz[[int(n[1:]) for n in best.markers.name]]
    off = align(best.markers.xyz, known, scale=True).apply(best.markers.xyz) - known
    assert 0.85 < np.sqrt(((off / best.markers.sigma) ** 2).mean()) < 1.15
    assert abs(best.cameras["c"].focal_px - focal) < 4 * best.sigma("c", "focal_px")


def test_a_lens_is_converted_into_another_that_sees_nearly_the_same():
    xy = np.stack(np.meshgrid(np.linspace(0, 1599, 9), np.linspace(0, 1199, 7)), axis=-1).reshape(-1, 2)
    for camera, lens, most in ((TRUE["brown"], "fisheye", 0.3), (TRUE["brown"], "rational", 1e-9)):
        again = as_lens(camera, lens)
        assert again.lens == lens
        seen, valid = again.project(camera.directions(xy))
        assert valid.all()
        assert np.abs(seen - xy).max() < most
    assert as_lens(TRUE["fisheye"], "fisheye") is TRUE["fisheye"]


def test_fields_of_view():
    assert field_deg(Camera((1000, 1000), 500 * np.sqrt(2))) == pytest.approx(90.0, abs=0.2)
    assert field_deg(TRUE["fisheye"]) > 180
    assert field_deg(Camera((1000, 1000), 100.0, lens="fisheye", k1=-0.3)) == 360.0


def test_parameters_that_the_lens_lacks_are_named():
    _, _, run = calibrated(TRUE["fisheye"], 3)
    with pytest.raises(UsageError, match="a fisheye lens has no p1; it has focal_px"):
        run({"c": TRUE["fisheye"]}, free=("focal_px", "k1", "p1"))
    with pytest.raises(UsageError, match="a brown lens has no k5"):
        run({"c": TRUE["brown"]}, free=("focal_px", "k5"))


def test_without_any_calibration_nothing_is_chosen():
    _, _, run = calibrated(TRUE["brown"], 3)
    refused = run({"c": TRUE["brown"]}, max_sigma0=1e-6)
    tried = judged({"brown": refused, "fisheye": refused}, 100)
    assert not any(t.outcome for t in tried)
    assert all(t.log_evidence == -np.inf for t in tried)


def test_a_rational_lens_is_known_though_its_coefficients_are_not():
    """They stand for one another: along that line the image does not move, across it it does."""
    camera = TRUE["rational"]
    index = [PARAMETERS.index(p) for p in RADIAL]
    rays = camera.directions(np.array([805.0, 590.0]) + np.linspace(0.05, 1, 40)[:, None] * [794.0, 609.0])
    slope = camera.project_jacobian(rays)[3][..., index].reshape(-1, 6)
    weakest, strongest = np.linalg.svd(slope)[2][[-1, 0]]
    for direction, known in ((weakest, True), (strongest, False)):
        cov = np.zeros((len(PARAMETERS),) * 2)
        cov[np.ix_(index, index)] = 0.3**2 * np.outer(direction, direction)
        assert (radial_spread(camera, cov) < 0.01) == known


@pytest.mark.slow
def test_where_only_its_coefficients_are_weak_a_rational_lens_is_not_refused():
    xyz, _, run = calibrated(replace(TRUE["rational"], k1=0.62, k2=0.09, k3=2e-3, k4=0.95, k5=0.25, k6=0.012), 3)
    found = run({"c": TRUE["rational"]})
    assert found, found.reason
    z = (align(found.markers.xyz, xyz, scale=True).apply(found.markers.xyz) - xyz) / found.markers.sigma
    assert 0.9 < np.sqrt((z**2).mean()) < 1.1


def tried_on(squares, free):
    """A calibration whose marks have these squared residuals in sigmas, and so many free parameters."""
    n = len(squares)
    cov = np.zeros((14, 14))
    cov[np.arange(free), np.arange(free)] = 1.0
    obs = Observations(np.zeros(n, int), np.arange(n), np.zeros((n, 2)), np.tile(0.25 * np.eye(2), (n, 1, 1)))
    residuals = np.stack([0.5 * np.sqrt(squares), np.zeros(n)], axis=1)
    return SimpleNamespace(
        observations=obs, residuals=residuals, cameras={"c": Camera((100, 80), 90.0, cov=cov)}
    )


def test_evidence_is_the_likelihood_and_half_the_logarithm_of_the_numbers_for_each_parameter():
    squares = np.array([0.5, 1.0, 4.0, 1e6, np.nan])
    for noise in (1.0, 4.0):
        left = np.minimum(squares[:3] / noise, GROSS).sum() + 2 * GROSS  # a gross error, and one without prediction
        for lost in (0, 2):
            got = _log_evidence(tried_on(squares, 5), noise, 5 + lost)
            assert got == pytest.approx(-0.5 * (left + lost * GROSS) - 2.5 * np.log(2 * (5 + lost)))
    without = tried_on(squares[:3], 5)
    without.cameras["c"] = Camera((100, 80), 90.0)
    assert _log_evidence(without, 1.0, 3) == pytest.approx(-0.5 * 5.5)


@pytest.mark.parametrize(("ahead", "first"), [(9.0, "brown"), (11.0, "fisheye")])
def test_another_lens_is_taken_only_where_it_leads_browns_by_ten_nats(monkeypatch, ahead, first):
    """Among the others nothing but the evidence counts."""
    monkeypatch.setattr(lens_choice, "Calibration", SimpleNamespace)
    monkeypatch.setattr(lens_choice, "_log_evidence", lambda result, noise, marks: result.told)
    told = {"rational": ahead - 1.0, "brown": 0.0, "fisheye": ahead}
    tried = judged({lens: SimpleNamespace(sigma0=1.0, told=-70.0 + t) for lens, t in told.items()}, 100)
    assert tried[0].lens == first
    assert [t.lens for t in tried if t.lens != "brown"] == ["fisheye", "rational"]
