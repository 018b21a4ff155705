"""Squares, crosses, rings and domes among discs: outline and inside say what is there."""

import numpy as np
import pytest

import windmark as wm
from windmark.detection import explain, rivals
from windmark.detection._kernels.rivals import EXTRA
from windmark.detection.company import RIVAL_NATS
from windmark.detection.rejected import OTHER
from windmark.detection.rivals import (
    ALL_LACKING,
    GROUPS,
    OF_DISCS,
    _evidence,
    _measured,
    _neighbours,
    _with_any,
    rival_evidence,
)
from windmark.detection.template.refine import make_scene, refine_template

PLACES = np.stack(np.meshgrid(np.arange(30, 330, 50.0), np.arange(30, 230, 50.0)), axis=-1).reshape(-1, 2)
SIZE = (240, 340)


def cover(shape, x, y, half, turn, window):
    """Share of each pixel of a window that a shape covers: 7 x 7 sub-pixels, seen at 50 degrees."""
    sub = (np.arange(7) - 3) / 7.0
    rows, cols = (np.arange(w.start, w.stop)[:, None] + sub for w in window)
    v, u = (rows.ravel() - y)[:, None] / 0.64, (cols.ravel() - x)[None, :]
    a, b = u * np.cos(turn) + v * np.sin(turn), v * np.cos(turn) - u * np.sin(turn)
    inside = {
        "disc": np.hypot(a, b) <= half,
        "square": (abs(a) <= half) & (abs(b) <= half),
        "cross": ((abs(a) <= half) & (abs(b) <= 0.35 * half)) | ((abs(b) <= half) & (abs(a) <= 0.35 * half)),
        "ring": (np.hypot(a, b) <= half) & (np.hypot(a, b) > 0.5 * half),
    }[shape]
    return inside.reshape(len(rows), 7, len(cols), 7).mean(axis=(1, 3))


def picture(shapes, half=9.0, noise=1.5):
    rng = np.random.default_rng(4)
    share = np.ones(SIZE)
    for (x, y), shape in zip(PLACES, shapes, strict=True):
        jitter, turn = rng.uniform(-0.5, 0.5, 2), rng.uniform(0, np.pi)
        reach = int(1.5 * half) + 2
        near = slice(max(int(y) - reach, 0), int(y) + reach), slice(max(int(x) - reach, 0), int(x) + reach)
        near = tuple(slice(s.start, min(s.stop, n)) for s, n in zip(near, SIZE, strict=True))
        share[near] *= 1.0 - 0.7 * cover(shape, x + jitter[0], y + jitter[1], half, turn, near)
    return np.round(150.0 * share + rng.normal(0, noise, SIZE)).astype(np.uint8)


@pytest.mark.parametrize("noise", [1.5, 8.0])
def test_discs_are_discs(noise):
    assert len(wm.detect(picture(["disc"] * len(PLACES), noise=noise), radius_px=9.0)) == len(PLACES)


@pytest.mark.parametrize("other", ["square", "cross", "ring"])
def test_another_shape_is_none_beside_discs_and_alone(other):
    shapes = ["disc", other] * (len(PLACES) // 2)
    found, rejected = explain(picture(shapes), radius_px=9.0)
    near = np.hypot(*(found.xy[:, None] - PLACES).transpose(2, 0, 1)).argmin(axis=1)
    assert sorted(near) == list(range(0, len(PLACES), 2))
    assert len(wm.detect(picture([other] * len(PLACES)), radius_px=9.0)) == 0
    if other == "square":
        assert (rejected.reason == OTHER).any()  # most lack enough of the edge already


def waved(wave=0, share=0.0, slope=0.0, radius=6.0, noise=0.0):
    """A disc of depth 100 whose outline has waves along x, and whose depth falls off along x: 11 x 11 sub-pixels."""
    sub = (np.arange(11) - 5) / 11.0
    fine = ((np.arange(41) - 20)[:, None] + sub).ravel()
    u, v = np.meshgrid(fine - 0.2, fine + 0.3)
    rim = radius * (1.0 + share * np.cos(wave * np.arctan2(v, u)))
    depth = 100.0 * (np.hypot(u, v) <= rim) * (1.0 + slope * u / radius)
    image = 150.0 - depth.reshape(41, 11, 41, 11).mean(axis=(1, 3))
    smooth = np.exp(-0.5 * (np.arange(-4, 5) / 0.7) ** 2)
    smooth /= smooth.sum()
    for axis in (0, 1):
        image = np.apply_along_axis(np.convolve, axis, np.pad(image, 4, mode="edge"), smooth, mode="valid")
        image = image[4:-4] if axis == 1 and image.shape[0] > 41 else image
    return image[:41, :41] + np.random.default_rng(0).normal(0.0, noise, (41, 41))


def fitted(image, radius=6.0):
    fits = refine_template(image, [[20.0, 20.0]], radius, robust=False)
    return make_scene(image, "dark", "multiplicative", None, None), fits


@pytest.mark.parametrize("wave", [3, 4, 5])
def test_waves_of_the_outline_are_measured(wave):
    scene, fits = fitted(waved(wave, 0.05))
    value = _measured(scene, fits, np.array([0]), np.array([0.25]), _neighbours(fits), 12)[0][0, 1]
    first, last = GROUPS[wave - 3]
    assert np.hypot(*value[first:last]) == pytest.approx(0.05, abs=0.008)
    others = [np.hypot(*value[a:b]) for k, (a, b) in enumerate(GROUPS[:3]) if k != wave - 3]
    assert max(others) < 0.01


@pytest.mark.parametrize(("slope", "fitted_within", "within"), [(0.3, 0.02, 0.01), (0.6, 0.03, 0.01), (0.9, 0.2, 0.05)])
def test_a_slope_of_the_inside_is_measured(slope, fitted_within, within):
    """The template that was fitted has moved to the dark side; beside the deviations it moves back."""
    scene, fits = fitted(waved(slope=slope))
    value = _measured(scene, fits, np.array([0]), np.array([0.25]), _neighbours(fits), 12)[0][0]
    as_fitted, moved = np.hypot(*value[:, 6:8].T)
    assert as_fitted == pytest.approx(slope, abs=fitted_within)
    assert moved == pytest.approx(slope, abs=within)


def test_a_square_in_noise_is_none_beside_discs():
    """The fit had taken its corners up as blur and left others out: one of twelve passed."""
    shapes = ["disc", "square"] * (len(PLACES) // 2)
    assert len(wm.detect(picture(shapes, half=7.0, noise=4.0), radius_px=7.0)) == len(PLACES) // 2


def test_a_worn_disc_stays_one():
    """Waves of every kind, of a tail or a nick, are another thing's than the one wave of a square."""
    def nats(*waves, moved):
        value = np.zeros((1, EXTRA))
        value[0, [0, 2, 4]] = waves
        weight = np.eye(EXTRA)[None] / 0.01**2
        return _evidence(value, weight, np.ones(1), np.ones(1), np.full(1, 4.0), moved)[0]

    assert nats(0.08, 0.1, 0.07, moved=False) > RIVAL_NATS > nats(0.08, 0.1, 0.07, moved=True)
    assert nats(0.0, 0.16, 0.0, moved=True) > RIVAL_NATS
    assert nats(0.5, 0.3, 0.5, moved=True) < RIVAL_NATS  # a line that crosses it


def test_evidence_grows_with_the_wave_and_goes_in_noise():
    """A square's wave, 0.15, is beyond doubt in clear pixels; in noise as strong as the disc nothing is said."""
    clear = [rival_evidence(*fitted(waved(4, share)), np.ones(1))[0] for share in (0.0, OF_DISCS[1], 0.15)]
    assert clear[:2] == [ALL_LACKING, ALL_LACKING]  # too little is left for anything to be in it
    assert clear[2] > 8.0
    noisy = waved(4, 0.15, noise=60.0)
    assert not rival_evidence(*fitted(noisy), np.full(1, 60.0**2))[0] > 4.0


def test_what_lacks_all_kinds_is_a_disc():
    """Kind by kind one other thing in 2^6 would lack all; what is beyond doubt, or says nothing, stays what it is."""
    none = 6 * np.log(0.5)
    said = _with_any(np.array([none - 1.0, none, -2.0, 0.0, 20.0, 1000.0, np.nan]))
    assert said[:2] == pytest.approx(np.log(0.1 / 64 / (1 - 0.9 / 64)))
    assert none < said[2] < -2.0
    assert said[3] == pytest.approx(0.0, abs=1e-12)
    assert said[4:6] == pytest.approx([20.0, 1000.0], abs=0.02)
    assert np.isnan(said[6])


@pytest.mark.parametrize("half", [3.5, 5.0])
def test_small_squares_are_none(half):
    assert len(wm.detect(picture(["square"] * len(PLACES), half=half), radius_px=1.13 * half)) == 0
    assert len(wm.detect(picture(["disc"] * len(PLACES), half=half), radius_px=half)) == len(PLACES)


@pytest.mark.parametrize("n", [1, 2])
def test_densities_are_normal(n):
    rng = np.random.default_rng(n)
    a, spread = rng.normal(size=(9, n)), rng.uniform(0.3, 2, 9)
    root = rng.normal(size=(9, n, n))
    own = root @ root.transpose(0, 2, 1)
    for k, got in enumerate(rivals._log_normal(a, own, spread)):
        cov = own[k] + spread[k] ** 2 * np.eye(n)
        exact = -0.5 * (a[k] @ np.linalg.solve(cov, a[k]) + np.log(np.linalg.det(cov)))
        assert got == pytest.approx(exact, rel=1e-9)


def test_a_kind_of_deviation_is_had_or_not():
    """However much speaks against a kind, that a thing has not got it stays possible; and the other way round."""
    against = np.array([-50.0, 0.0, 2.0, 50.0])
    p = rivals.ONE_KIND
    np.testing.assert_allclose(rivals._of_one_kind(against), np.log(1 - p + p * np.exp(against)), rtol=1e-9)
