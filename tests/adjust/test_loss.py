import numpy as np
import pytest
from scipy.integrate import quad

from windmark.adjust import Loss
from windmark.adjust.loss import DEFAULT_SCALE

ROBUST = ["huber", "cauchy", "tukey"]


@pytest.mark.parametrize("name", ROBUST)
@pytest.mark.parametrize("scale", [0.7, 3.0])
def test_weight_is_the_derivative_of_rho(name, scale):
    loss = Loss.make(name, scale)
    s = np.concatenate([np.linspace(1e-3, 0.97, 50), np.linspace(1.03, 4, 50)]) * scale**2
    h = 1e-5 * s
    numeric = (loss.evaluate(s + h)[0] - loss.evaluate(s - h)[0]) / (2 * h)
    np.testing.assert_allclose(loss.evaluate(s)[1], numeric, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("name", ROBUST)
def test_small_residuals_are_plain_squares_and_large_ones_fade(name):
    loss = Loss.make(name)
    rho, weight = loss.evaluate(np.array([0.0, 1e-8, 1e6]))
    assert rho[0] == 0
    assert weight[0] == 1
    assert rho[1] == pytest.approx(1e-8, rel=1e-6)
    assert weight[2] < 2e-3
    assert rho[2] < 1e4


def test_tukey_forgets_an_outlier_entirely():
    rho, weight = Loss.make("tukey", 5.0).evaluate(np.array([26.0, 1e9]))
    assert (weight == 0).all()
    assert rho == pytest.approx([25 / 3, 25 / 3])


@pytest.mark.parametrize("name", ROBUST)
def test_default_scale_keeps_95_percent_efficiency(name):
    assert Loss.make(name).gaussian_moments()[2] == pytest.approx(0.95, abs=1e-6)


@pytest.mark.parametrize("name", ROBUST)
@pytest.mark.parametrize("scale", [0.5, 2.0, 30.0])
def test_moments_against_adaptive_quadrature(name, scale):
    loss = Loss.make(name, scale)

    def mean(power: int, square: bool) -> float:
        def f(r: float) -> float:
            w = float(loss.evaluate(np.array(r * r))[1])
            return (w * w if square else w) * r**power * r * np.exp(-r * r / 2)

        return quad(f, 0, min(scale, 15), epsabs=1e-13)[0] + quad(f, min(scale, 15), 20, epsabs=1e-13)[0]

    mean_w, mean_wr2, efficiency = loss.gaussian_moments()
    assert mean_w == pytest.approx(mean(0, False), rel=1e-9)
    assert mean_wr2 == pytest.approx(mean(2, False), rel=1e-9)
    assert efficiency == pytest.approx(mean(2, False) ** 2 / (2 * mean(2, True)), rel=1e-9)


def test_wrong_losses_are_named():
    with pytest.raises(ValueError, match="loss must be one of none, huber, cauchy, tukey, got 'l1'"):
        Loss.make("l1")
    with pytest.raises(ValueError, match="loss_scale must be finite and > 0"):
        Loss.make("huber", -1.0)
    with pytest.raises(ValueError, match="loss_scale has no meaning"):
        Loss.make("none", 2.0)
    assert set(DEFAULT_SCALE) == {"none", *ROBUST}
