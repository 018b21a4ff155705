"""Pictures to light: noise laws from the pictures, masks, averaging, ratios; each sigma by draws."""

import numpy as np
import pytest

from windmark.errors import DataError, UsageError
from windmark.paint import (
    Linearity,
    NodeField,
    SensorModel,
    average_frames,
    correct_picture,
    enough,
    form_ratio,
    mean_dark,
    mean_flat,
    mean_reference,
    photon_transfer,
    reference_at,
)
from windmark.paint.radiometry import DARKER, DEAD, NOT_FINITE, NOT_LINEARISED, SATURATED

GAIN, READ, BLACK = 0.25, 4.0, 100.0


def scene(shape=(120, 160)):
    """Light in grey levels, 200 to 3200."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return 200 + 3000 * (x / shape[1]) * (0.5 + 0.5 * y / shape[0])


def shot(rng, light=None, black=BLACK, flat=1.0):
    light = scene() if light is None else light
    return np.round(GAIN * rng.poisson(light * flat / GAIN) + black + np.sqrt(READ) * rng.normal(size=light.shape))


@pytest.mark.parametrize("flicker", [0.0, 0.05])
@pytest.mark.parametrize("frames", [2, 8])
def test_gain_and_read_noise_with_and_without_flicker(flicker, frames):
    z = []
    for seed in range(25):
        rng = np.random.default_rng(seed)
        stack = np.stack([shot(rng, scene() * (1 + flicker * rng.normal())) for _ in range(frames)])
        got = photon_transfer(stack, dark=BLACK)
        assert got, got.reason
        z.append(((got.gain - GAIN) / got.sigma[0], (got.read_variance - READ - 1 / 12) / got.sigma[1]))
        assert got.gain == pytest.approx(GAIN, rel=0.15 if frames == 2 else 0.07)
    assert (np.abs(np.mean(z, axis=0)) < 0.75).all()
    assert (np.std(z, axis=0) < 1.4).all()
    assert (np.std(z, axis=0) > 0.5).all()


def test_dust_that_moves_and_hot_pixels_are_no_noise():
    rng = np.random.default_rng(0)
    stack = np.stack([shot(rng) for _ in range(4)])
    for k in range(4):
        stack[k, 10 + 20 * k : 20 + 20 * k, 40:60] += 500
    got = photon_transfer(stack, dark=BLACK)
    assert got.gain == pytest.approx(GAIN, rel=0.1)


def test_photon_transfer_refuses_with_the_reason():
    rng = np.random.default_rng(1)
    even = np.stack([shot(rng, np.full((100, 100), 1000.0)) for _ in range(2)])
    assert "do not spread" in photon_transfer(even, dark=BLACK).reason
    assert "one level everywhere" in photon_transfer(np.full((2, 50, 50), 7.0)).reason
    assert "0 pixels count" in photon_transfer(np.full((2, 50, 50), 4095), saturation=4095).reason
    clipped = np.stack([np.minimum(shot(rng), 1200) for _ in range(4)])
    got = photon_transfer(clipped, dark=BLACK, saturation=1200)
    assert got.gain == pytest.approx(GAIN, rel=0.15)
    with pytest.raises(UsageError, match="at least 2"):
        photon_transfer(even[:1])


def test_light_and_its_variance_are_those_of_draws():
    """Dark and flat pictures of few frames, a sensor that is not linear: everything counts in the variance."""
    rng = np.random.default_rng(2)
    y, x = np.mgrid[:120, :160]
    flat = 1 - 0.3 * ((x - 80) ** 2 + (y - 60) ** 2) / 100**2
    flat /= flat.mean()
    bend = Linearity.polynomial([0.0, 1.0, 2e-5], 4200)
    z = []
    for _ in range(12):
        dark, dark_var, _ = mean_dark([shot(rng, np.zeros_like(scene())) for _ in range(3)])
        plain = SensorModel(dark, 4000, GAIN, READ + 1 / 12, dark_var)
        f, f_var, bad = mean_flat([shot(rng, np.full(scene().shape, 2000.0), flat=flat) for _ in range(4)], plain)
        assert not bad.any()
        sensor = SensorModel(dark, 4000, GAIN, READ + 1 / 12, dark_var, f, f_var, bend)
        got = correct_picture(shot(rng, flat=flat), sensor)
        # What the sensor would show of the light without noise.
        s = scene() * flat
        z.append((got.value - (s + 2e-5 * s**2) / flat) / np.sqrt(got.variance))
    assert np.std(z) == pytest.approx(1.0, abs=0.06)
    assert abs(np.mean(z)) < 0.05


def test_flags():
    rng = np.random.default_rng(3)
    picture = shot(rng)
    picture[0, 0], picture[1, 1], picture[2, 2] = 4095, np.nan, 20
    dead = np.zeros(picture.shape, bool)
    dead[3, 3] = True
    sensor = SensorModel(BLACK, 4095, GAIN, READ, dead=dead, linearity=Linearity([-50, 3000], [-50, 3000]))
    got = correct_picture(picture, sensor)
    assert got.flags[0, 0] == SATURATED | NOT_LINEARISED
    assert got.flags[1, 1] == NOT_FINITE
    assert got.flags[2, 2] & DARKER
    assert got.flags[3, 3] == DEAD
    assert got.usable[50, 20]
    assert got.share(DEAD) == pytest.approx(1 / picture.size)


def test_hot_pixels_of_the_dark_picture():
    rng = np.random.default_rng(4)
    frames = np.array([shot(rng, np.zeros((80, 80))) for _ in range(5)])
    frames[:, 5, 5] += 300
    frames[:, 6, 6] += 200 * rng.normal(size=5)
    _, variance, bad = mean_dark(frames)
    assert bad[5, 5]
    assert bad[6, 6]
    assert bad.sum() < 6
    assert np.median(variance) == pytest.approx((READ + 1 / 12) / 5, rel=0.1)


@pytest.mark.parametrize(
    ("picture", "dark", "words"),
    [
        (np.full((9, 9), 200.0), np.full((9, 9), 900.0), "dark picture is brighter than the picture on 100 %"),
        (np.full((9, 9), 4095.0), np.full((9, 9), 100.0), "100 % of the picture is saturated"),
        (np.full((9, 9), 101.0), np.full((9, 9), 100.0), "no light above the dark"),
        (np.full((9, 9), np.nan), np.full((9, 9), 100.0), "no pixel that is a number"),
        (np.full((9, 9), 900.0), np.full((9, 8), 100.0), "dark: 8 x 9 pixels; expected 9 x 9 pixels"),
    ],
)
def test_pictures_that_cannot_be_reduced(picture, dark, words):
    with pytest.raises(DataError, match=words):
        correct_picture(picture, SensorModel(dark, 4095, GAIN, READ))


def test_a_linearity_must_rise():
    with pytest.raises(UsageError, match="rise all the way"):
        Linearity([0, 1, 2], [0, 2, 1])


def frames_of(rng, count=12, n=4000):
    true = 500 + 2000 * rng.uniform(size=n)
    var = GAIN * true + READ
    return true, true + np.sqrt(var) * rng.normal(size=(count, n)), np.tile(var, (count, 1))


@pytest.mark.parametrize("count", [2, 3, 4, 12])
def test_mean_of_frames_has_its_variance_also_with_flicker(count):
    rng = np.random.default_rng(5)
    z = []
    for _ in range(10):
        true, v, var = frames_of(rng, count)
        light = 1 + 0.05 * rng.normal(size=count)
        got = average_frames(v * light[:, None], var * light[:, None] ** 2)
        assert got.used.all(), got.reasons
        scale = light.mean()
        z.append((got.value / scale - true) / np.sqrt(got.variance) * scale)
        assert got.excess == pytest.approx(1.0, abs=0.06)
    assert np.std(z) == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6, 7, 11, 12, 20])
def test_frames_of_stated_noise_scatter_as_stated_however_few(count):
    rng, excess = np.random.default_rng(21), []
    for _ in range(8):
        _, v, var = frames_of(rng, count)
        excess.append(average_frames(v, var).excess)
    assert np.mean(excess) == pytest.approx(1.0, abs=0.012)


@pytest.mark.parametrize("count", [2, 3, 5])
@pytest.mark.parametrize("noise", [0.002, 0.005, 0.02])
def test_a_flicker_below_the_noise_is_seen_with_few_frames(count, noise):
    """The median of three frames is one of them at a third of the nodes: compared with it, lights looked even."""
    rng, square = np.random.default_rng(8), []
    for _ in range(60):
        true, x = 1 + 0.002 * rng.normal(size=count), 1000 * rng.uniform(1.0, 1.3, 2000)
        v = true[:, None] * x * (1 + noise * rng.normal(size=(count, 2000)))
        light = average_frames(v, np.broadcast_to((noise * x) ** 2, v.shape)).light
        square.append(np.var(light / light.mean(), ddof=1))
    assert np.sqrt(np.mean(square)) == pytest.approx(0.002, rel=0.25)


def test_dust_and_a_frame_of_something_else_do_not_move_the_lights_of_the_others():
    rng = np.random.default_rng(3)
    x = 1000 * rng.uniform(1.0, 1.3, 2000)
    true = np.array([1.0, 1.05, 0.9, 1.0, 0.97])
    v = true[:, None] * x * (1 + 0.005 * rng.normal(size=(5, 2000)))
    v[0, :500] *= 0.7  # the frame that the others are compared with, dusty
    v[3] = 1000 * rng.uniform(1.0, 1.3, 2000)
    got = average_frames(v, np.broadcast_to((0.005 * x) ** 2, v.shape))
    assert got.used.tolist() == [False, True, True, False, True]
    sound = got.light[[1, 2, 4]] / true[[1, 2, 4]]
    np.testing.assert_allclose(sound / sound.mean(), 1, atol=1e-3)


def test_bad_frames_are_left_out_with_their_reason():
    rng = np.random.default_rng(6)
    true, v, var = frames_of(rng)
    v[2] *= 0.04  # the lamp failed
    v[5] = np.roll(v[5], 7)  # the registration failed
    v[8, 300:] = np.nan  # the model left the picture
    got = average_frames(v, var)
    assert np.flatnonzero(~got.used).tolist() == [2, 5, 8]
    assert "its light is 4" in got.reasons[2]
    assert "differs from the others" in got.reasons[5]
    assert "shows 300 nodes, the others 4000" in got.reasons[8]
    assert np.std((got.value - true) / np.sqrt(got.variance)) == pytest.approx(1.0, abs=0.06)


def test_frames_that_were_lost_before_count_among_those_that_do_not_agree():
    _, v, var = frames_of(np.random.default_rng(6))
    v, var = v[:2], var[:2]
    assert [bool(average_frames(v, var, lost=lost)) for lost in (0, 1, 2, 3)] == [True, True, True, False]
    assert "2 of 5 frames agree" in average_frames(v, var, lost=3).reason
    assert [[enough(k, n) for k in range(n + 1)] for n in (1, 2, 3)] == [
        [False, True], [False, True, True], [False, False, True, True]
    ]  # fmt: skip


def test_scatter_beyond_the_stated_variances_is_in_the_mean():
    rng = np.random.default_rng(7)
    true, v, var = frames_of(rng)
    got = average_frames(v + 60 * rng.normal(size=v.shape), var)
    assert got.excess > 2
    assert np.std((got.value - true) / np.sqrt(got.variance)) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("count", "named"), [(2, False), (3, True)])
def test_three_frames_tell_which_of_them_differs_and_two_do_not(count, named):
    rng = np.random.default_rng(9)
    v = 1000 + 200 * rng.random(400) + rng.normal(0, 1, (count, 400))
    v[-1] += rng.normal(0, 30, 400)
    got = average_frames(v, np.ones(v.shape))
    assert np.flatnonzero(~got.used).tolist() == ([2] if named else [])


def test_frames_that_all_differ_are_refused():
    v = np.ones((4, 50))
    v[1:] = np.nan
    v[1:, :10] = 1.0
    assert average_frames(v, np.ones(v.shape))
    assert not average_frames(np.full((3, 5), np.nan), np.ones((3, 5)))


def test_ratio_is_at_the_photon_limit_and_two_colours_take_the_lamp_out():
    rng = np.random.default_rng(8)
    n = 20000
    off, on = np.full(n, 2000.0), np.full(n, 1500.0)
    lamp = 1 + 0.1 * np.sin(np.arange(n))
    fields = [NodeField.make(rng.poisson(m * lights), np.sqrt(m * lights)) for m, lights in
              ((off, 1.0), (on, lamp), (off, 1.0), (off, lamp))]  # fmt: skip
    plain = form_ratio(fields[0], fields[1])
    both = form_ratio(fields[0], fields[1], channel=(fields[2], fields[3]))
    assert np.std(plain.value) > 0.05
    assert np.std((both.value - 4 / 3) / both.sigma) == pytest.approx(1.0, abs=0.03)
    assert plain.sigma[0] == pytest.approx(plain.value[0] * np.hypot(1 / np.sqrt(fields[0].value[0]), np.sqrt(
        fields[1].white[0]) / fields[1].value[0]), rel=0.02)  # fmt: skip


def test_ratio_without_light_is_none():
    got = form_ratio(NodeField.make([100.0, 100.0, np.nan, -5.0], 1.0), NodeField.make([0.0, 50.0, 50.0, 50.0], 1.0))
    np.testing.assert_array_equal(got.known, [False, True, False, False])
    np.testing.assert_array_equal(np.isfinite(got.sigma), got.known)


def test_references_between_incidences_and_of_the_run():
    def lights(level, **gap):
        return NodeField.make([level, level if not gap else np.nan], 2.0)

    at = reference_at([4.0, 0.0, 2.0], [lights(140.0), lights(100.0), lights(120.0)], 1.0)
    assert at.value.tolist() == [110.0, 110.0]
    assert at.sigma[0] == pytest.approx(np.sqrt(2))
    # Shown by one of two: not known in between, known at the one.
    half = [lights(100.0), lights(110.0, gap=True)]
    assert reference_at([0.0, 1.0], half, 0.5).known.tolist() == [True, False]
    assert reference_at([0.0, 1.0], half, 0.0).known.all()
    with pytest.raises(DataError, match="incidence 9 lies outside"):
        reference_at([0.0, 2.0], [lights(1.0), lights(2.0)], 9.0)
    with pytest.raises(UsageError):
        reference_at([0.0, 0.0], [lights(1.0), lights(2.0)], 0.0)
    mean = mean_reference([lights(100.0), lights(110.0, gap=True), lights(120.0)])
    assert mean.value.tolist() == [110.0, 110.0]
    assert mean.sigma.tolist() == pytest.approx([2 / np.sqrt(3), np.sqrt(2)])


@pytest.mark.slow
def test_what_dark_and_flat_err_by_is_not_less_in_a_mean():
    """Eighty pictures with one dark and one flat picture: what is left is those two's own errors."""
    rng = np.random.default_rng(8)
    flat = 1 + 0.05 * rng.standard_normal(scene().shape)
    z = []
    for _ in range(8):
        dark, dark_var, _ = mean_dark([shot(rng, np.zeros_like(scene())) for _ in range(2)])
        plain = SensorModel(dark, 4000, GAIN, READ + 1 / 12, dark_var)
        f, f_var, _ = mean_flat([shot(rng, np.full(scene().shape, 2000.0), flat=flat) for _ in range(2)], plain)
        sensor = SensorModel(dark, 4000, GAIN, READ + 1 / 12, dark_var, f, f_var)
        got = [correct_picture(shot(rng, flat=flat), sensor) for _ in range(80)]
        assert (got[0].lasting < got[0].variance).all()
        var = np.mean([g.lasting for g in got], axis=0) + np.mean([g.variance - g.lasting for g in got], axis=0) / 80
        z.append((np.mean([g.value for g in got], axis=0) - scene()) / np.sqrt(var))
    assert np.std(z) == pytest.approx(1.0, abs=0.05)


def test_an_infinite_light_has_no_ratio():
    got = form_ratio(NodeField.make([1.0, np.inf, 2.0], 0.1), NodeField.make([np.inf, 1.0, 1.0], 0.1))
    assert np.isnan(got.value).tolist() == [True, True, False]
