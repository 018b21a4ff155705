"""Offset and slope of the fit to taps are held against what the paint's own calibration allows."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.paint import NodeField, in_situ
from windmark.pipeline.psp import PointRecord
from windmark.pipeline.psp.record import _fit
from windmark.pipeline.verdict import DOUBTFUL, GOOD
from windmark.pipeline.verdict.paint import psp_verdict
from windmark.tasks.psp.plausible import UNCHECKED, fitted_level

RIGHT = np.linspace(5e4, 8e4, 20)


def fit_of(taps, free="both", seed=1):
    """Taps of sigma 50 Pa; a paint whose level is known to 250 Pa and whose slope is known to 1 %."""
    rng = np.random.default_rng(seed)
    paint = RIGHT + rng.normal(0, 100, 20) + 250 * rng.normal() + 0.01 * rng.normal() * (RIGHT - 6.5e4)
    x = NodeField.make(paint, 100.0, unit="Pa").with_mode("calibration:1", np.full(20, 250.0))
    x = x.with_mode("calibration:2", 0.01 * (RIGHT - 6.5e4))
    fit = in_situ([f"t{k}" for k in range(20)], taps + rng.normal(0, 50, 20), x, pressure_sigma=50.0, free=free)
    assert fit
    return fit


def verdict(fit, remarks=()):
    return psp_verdict([PointRecord("p1", 0.0, {}, "reduced", seen=0.9, median_sigma_cp=0.01, flicker=0.0,
                                    fit=_fit(fit), remarks=tuple(remarks))])  # fmt: skip


@pytest.mark.parametrize("seed", range(6))
def test_taps_that_agree_with_the_paints_calibration_are_good(seed):
    fit = fit_of(RIGHT, seed=seed)
    for value, sigma in fit.moved:
        assert abs(value) < 4 * sigma
    assert fit.moved[0][1] == pytest.approx(255, rel=0.1)
    assert fit.moved[1][1] == pytest.approx(0.0105, rel=0.1)
    assert verdict(fit).word == GOOD


def test_readings_that_are_all_off_alike_are_doubted_with_the_reason():
    off = verdict(fit_of(RIGHT + 3000))
    assert (off.word, off.cause) == (DOUBTFUL, "taps")
    assert "Pa more than the paint's own calibration says" in off.reason
    assert "barometer" in off.next_step
    span = verdict(fit_of(6.5e4 + 0.8 * (RIGHT - 6.5e4)))
    assert span.word == DOUBTFUL
    assert "% less than the paint's own calibration says" in span.reason
    assert "span of the scanner" in span.next_step
    kept = fit_of(RIGHT + 3000, free="offset")
    assert np.isnan(kept.moved[1]).all()
    assert verdict(kept).word == DOUBTFUL


def test_a_paint_whose_sigmas_lack_something_contradicts_nothing_and_that_is_unchecked():
    assert fitted_level(SimpleNamespace(cov=np.eye(2)), 0.001) == []
    (exact,) = fitted_level(SimpleNamespace(cov=None), 0.001)
    (dark,) = fitted_level(SimpleNamespace(cov=np.eye(2)), float("nan"))
    assert exact.startswith(UNCHECKED)
    assert "taken as exact" in exact
    assert "flicker" in dark
    assert verdict(fit_of(RIGHT + 3000), [exact]).word == GOOD
