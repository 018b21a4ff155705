from __future__ import annotations

import numpy as np
import pytest

from windmark.synth import Clutter, Sensor, degrade


@pytest.fixture(scope="module")
def picture():
    return np.random.default_rng(0).uniform(0.1, 0.9, (61, 83))


@pytest.mark.parametrize(
    "blur",
    [
        lambda a: degrade.gaussian_blur(a, 0.6),
        lambda a: degrade.gaussian_blur(a, 3.0),
        lambda a: degrade.average_blur(a, 3),
    ],
)
def test_blur_keeps_the_mean(picture, blur):
    assert blur(picture).mean() == pytest.approx(picture.mean(), rel=1e-13)
    assert blur(picture).std() < 0.8 * picture.std()


def spread(image):
    y, x = np.indices(image.shape)
    w = image / image.sum()
    mx, my = (w * x).sum(), (w * y).sum()
    return mx, my, (w * (x - mx) ** 2).sum(), (w * (y - my) ** 2).sum()


@pytest.mark.parametrize("sigma", [0.3, 0.4, 0.6, 1.0, 2.5])
def test_gaussian_has_the_variance_asked_for(sigma):
    point = np.zeros((41, 43))
    point[20, 21] = 1
    np.testing.assert_allclose(spread(degrade.gaussian_blur(point, sigma)), [21, 20, sigma**2, sigma**2], rtol=1e-9)
    kernel = degrade.gaussian_kernel(sigma)
    assert (kernel > 0).all()
    np.testing.assert_array_equal(kernel, kernel[::-1])


def test_average_is_the_paper_s():
    point = np.zeros((21, 21))
    point[10, 10] = 9
    once = degrade.average_blur(point, 1)
    np.testing.assert_allclose(once[9:12, 9:12], 1, rtol=1e-14)
    assert once.sum() == pytest.approx(9)
    assert np.count_nonzero(once > 1e-12) == 9
    np.testing.assert_allclose(
        degrade.average_blur(point, 3), degrade.average_blur(degrade.average_blur(once, 1), 1), atol=1e-14
    )
    np.testing.assert_allclose(spread(degrade.average_blur(point, 3))[2:], [2, 2], rtol=1e-12)


def test_motion_blur_is_a_line_of_that_length():
    point = np.zeros((31, 41))
    point[15, 20] = 1
    mx, my, xx, yy = spread(degrade.motion_blur(point, (6.0, 0.0)))
    np.testing.assert_allclose([mx, my, yy], [20, 15, 0], atol=1e-9)
    # The line's variance, and that of linear interpolation, mean of f (1 - f).
    assert xx == pytest.approx(36 / 12 + 1 / 6, rel=0.02)
    np.testing.assert_array_equal(degrade.motion_blur(point, (0.0, 0.0)), point)


def test_noise_is_shot_plus_read():
    rng = np.random.default_rng(1)
    level = np.full((400, 500), 0.5)
    noisy = degrade.noise(level, rng, full_well_e=20_000, read_noise_e=50)
    assert noisy.mean() == pytest.approx(0.5, abs=5 * 0.0055 / np.sqrt(level.size))
    assert noisy.std() == pytest.approx(np.sqrt(10_000 + 2500) / 20_000, rel=0.01)
    dark = degrade.noise(np.zeros((300, 300)), rng, full_well_e=20_000, read_noise_e=8)
    assert dark.std() == pytest.approx(8 / 20_000, rel=0.02)
    assert (degrade.noise(np.zeros((5, 5)), rng, read_noise_e=0) == 0).all()
    steps = np.concatenate([np.full((1, 50_000), v) for v in (0.1, 0.4, 0.9)])
    variance = degrade.noise(steps, rng, full_well_e=1000, read_noise_e=0).var(axis=1)
    np.testing.assert_allclose(variance, np.array([0.1, 0.4, 0.9]) / 1000, rtol=0.03)  # photon transfer


@pytest.mark.parametrize(("bits", "kind"), [(8, np.uint8), (10, np.uint16), (12, np.uint16), (16, np.uint16)])
def test_quantise(bits, kind):
    top = 2**bits - 1
    out = degrade.quantise(np.array([[-1.0, 0, 0.5, 1, 2]]), bits)
    assert out.dtype == kind
    np.testing.assert_array_equal(out[0], [0, 0, np.rint(top / 2), top, top])
    ramp = np.linspace(0, 1, 5000)[None]
    assert np.abs(degrade.quantise(ramp, bits) / top - ramp).max() <= 0.5 / top + 1e-12
    assert degrade.quantise(np.zeros((1, 1)), bits, black=10)[0, 0] == 10
    assert degrade.quantise(np.ones((1, 1)), bits, black=10)[0, 0] == top


def test_defects_are_where_the_seed_puts_them():
    a = np.full((50, 60), 0.4)
    bad = degrade.defects(a, np.random.default_rng(3), hot=20, dead=9)
    assert (bad == 0).sum() == 9
    assert (bad >= 0.7).sum() == 20
    assert (bad == 0.4).sum() == a.size - 29
    np.testing.assert_array_equal(bad, degrade.defects(a, np.random.default_rng(3), hot=20, dead=9))
    assert (a == 0.4).all()


def test_vignette():
    a = degrade.vignette(np.ones((81, 101)), 0.4)
    assert a[40, 50] == 1
    assert a[0, 0] == pytest.approx(0.6, abs=0.02)
    moved = degrade.vignette(np.ones((81, 101)), 0.4, center=(10, 20))
    assert np.unravel_index(moved.argmax(), moved.shape) == (20, 10)


def test_clutter_is_seeded_and_keeps_clear():
    a = np.full((300, 400), 0.5)
    clear = np.array([[100.0, 100.0], [250, 180], [50, 250]])
    what = Clutter(specks=200, bright_specks=50, scratches=20, rings=15, words=4, tapes=2, blocks=1)
    first = degrade.clutter(a, np.random.default_rng(7), what, keep_clear=clear, clearance_px=12)
    again = degrade.clutter(a, np.random.default_rng(7), what, keep_clear=clear, clearance_px=12)
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != degrade.clutter(a, np.random.default_rng(8), what).tobytes()
    assert (first < 0.5).mean() > 0.02
    assert (first > 0.5).any()
    y, x = np.indices(a.shape)
    for cx, cy in clear:
        near = np.hypot(x - cx, y - cy) < 11
        assert (first[near] == 0.5).all()
    nothing = Clutter(0, 0, 0, 0, 0, 0, 0)
    np.testing.assert_array_equal(degrade.clutter(a, np.random.default_rng(7), nothing), a)


@pytest.mark.parametrize("kind", ["specks", "bright_specks", "scratches", "rings", "words", "tapes", "blocks"])
def test_each_kind_draws_something(kind):
    none = dict.fromkeys(("specks", "bright_specks", "scratches", "rings", "words", "tapes", "blocks"), 0)
    a = np.full((200, 200), 0.5)
    out = degrade.clutter(a, np.random.default_rng(1), Clutter(**{**none, kind: 5}))
    changed = out != 0.5
    assert 5 < changed.sum() < 0.9 * a.size
    assert ((out > 0.5)[changed] == (kind == "bright_specks")).all()


def test_sensor_chain():
    rng = np.random.default_rng(0)
    plain = Sensor(exposure=0.5, blur_px=0, vignetting=0, full_well_e=np.inf, hot=0, dead=0, bits=12, black=0)
    np.testing.assert_array_equal(plain.expose(np.ones((4, 5)), rng), np.full((4, 5), 2048, np.uint16))
    full = Sensor()
    a = full.expose(np.full((60, 60), 0.9), np.random.default_rng(1), np.random.default_rng(2))
    b = full.expose(np.full((60, 60), 0.9), np.random.default_rng(3), np.random.default_rng(2))
    assert a.dtype == np.uint16
    assert a.tobytes() != b.tobytes()
    np.testing.assert_array_equal(a == 64, b == 64)  # the dead pixels stay
    flat = Sensor(vignetting=0, hot=0, dead=0).expose(np.full((200, 200), 0.9), np.random.default_rng(1)) - 64.0
    assert flat.mean() / flat.std() == pytest.approx(np.sqrt(0.495 * 20_000), rel=0.03)


def test_bad_input(picture):
    with pytest.raises(ValueError, match="sigma_px"):
        degrade.gaussian_blur(picture, -1)
    with pytest.raises(ValueError, match="passes"):
        degrade.average_blur(picture, -1)
    with pytest.raises(ValueError, match="full_well_e"):
        degrade.noise(picture, np.random.default_rng(0), full_well_e=0)
    with pytest.raises(ValueError, match="bits"):
        degrade.quantise(picture, 17)
    with pytest.raises(ValueError, match="hot and dead"):
        degrade.defects(picture, np.random.default_rng(0), hot=10**6)
    with pytest.raises(ValueError, match="strength"):
        degrade.vignette(picture, 2.0)
    with pytest.raises(ValueError, match=r"\(H, W\)"):
        degrade.vignette(picture[0], 0.1)
