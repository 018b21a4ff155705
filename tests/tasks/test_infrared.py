"""Heat flux of histories with gaps, and infrared numbers to signals: against finite differences and draws."""

import numpy as np
import pytest

from windmark.errors import DataError
from windmark.paint import PlanckBand, Wall, flux_operator
from windmark.pipeline.infrared.project import CameraEntry
from windmark.pipeline.infrared.sensors import ThermalSensor
from windmark.pipeline.psp.bits import Bits
from windmark.synth.heating import RESIN
from windmark.tasks.infrared import BEFORE, BRIDGED, CURVED, GAP, LATE, NO_START, flag_words, history_flux

WALL, START, NOISE = Wall.semi_infinite(0.25, 1.7e6, thickness=1.2e-3), 0.3, 0.01
TIMES = np.arange(45) * 0.05


def flux(since):
    return 1500 * np.minimum(since / 0.15, 1) * (since > 0) * np.exp(-0.2 * since)


RISE = RESIN.rise(flux, np.maximum(TIMES - START, 0))


def histories(count, seed=1):
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.6, 1.6, count)
    return 300 + size[:, None] * RISE + NOISE * rng.standard_normal((count, len(TIMES))), size


def reduced(t, **options):
    options = {"curvature": np.zeros(len(t)), "longest_gap": 3, "tried": t[np.isfinite(t).all(axis=1)], **options}
    return history_flux(t, np.full(t.shape, NOISE**2), {}, flux_operator(TIMES, WALL, START), WALL, **options)


def inside(done, size, frames):
    off = done.flux - size[:, None] * flux(TIMES - START)
    sigma = np.sqrt(done.white + done.modes["time step"] ** 2)
    return (np.abs(off) < 1.96 * sigma)[:, frames]


def test_the_intervals_hold_the_flux_from_its_beginning_on():
    t, size = histories(3000)
    done = reduced(t)
    assert np.isnan(done.flux[:, :7]).all()  # the seventh is at the start, but for rounding
    assert (done.flags[:, :7] == BEFORE).all()
    at_first, later = inside(done, size, slice(7, 12)), inside(done, size, slice(12, None))
    assert at_first.mean(axis=0).min() > 0.9  # the samples hardly resolve it: intervals are wide, not wrong
    assert 0.94 < later.mean() < 0.99
    noise_alone = np.abs(done.flux - size[:, None] * flux(TIMES - START)) < 1.96 * np.sqrt(done.white)
    assert noise_alone[:, 7:12].mean(axis=0).min() < 0.75


def test_a_flux_that_is_there_at_once_is_within_its_interval_in_the_first_frame():
    """The heating begins between two frames. The straight line to the first frame behind says 27 % too much, whatever
    the time between is (4 / pi of a step's flux)."""
    rise = RESIN.rise(lambda since: 1500.0 * (since > 0), np.maximum(TIMES - START - 0.02, 0))
    t = 300 + rise + NOISE * np.random.default_rng(3).standard_normal((40, len(TIMES)))
    done = history_flux(t, np.full(t.shape, NOISE**2), {}, flux_operator(TIMES, WALL, START + 0.02), WALL,
                        curvature=np.zeros(40), longest_gap=3, tried=t)  # fmt: skip
    first = np.flatnonzero(TIMES > START + 0.02)[0]
    off, sigma = (done.flux - 1500)[:, first], done.modes["time step"][:, first]
    assert off.mean() == pytest.approx(0.27 * 1500, rel=0.1)
    assert (np.abs(off) < 1.96 * sigma).all()
    assert (np.abs(off) > sigma).mean() > 0.5


def test_gaps_are_bridged_and_what_that_leaves_is_in_the_sigma():
    t, size = histories(4000)
    gap = np.arange(len(t)) >= 2000
    t[np.ix_(gap, [9, 10])] = np.nan  # where the flux bends
    done = reduced(t)
    assert np.isnan(done.flux[gap][:, [9, 10]]).all()
    assert np.isfinite(done.flux[gap][:, 11:]).all()
    behind = inside(done, size, slice(11, None))[gap]
    assert behind.mean(axis=0).min() > 0.88
    assert (done.flags[gap][:, 11] & BRIDGED).all()
    assert not (done.flags[gap][:, -1] & BRIDGED).any()  # forgotten by then
    assert not (done.flags[~gap] & BRIDGED).any()


def test_what_cannot_be_bridged_has_no_flux_and_its_reason():
    t, _ = histories(200)
    t[10:20, 12:16] = np.nan  # four frames
    t[20:30, :7] = np.nan  # never seen before the start
    t[30:40, :6] = np.nan  # once
    done = reduced(t)
    assert np.isnan(done.flux[10:20, 12:]).all()
    assert (done.flags[10:20, 16:] & GAP).all()
    assert np.isfinite(done.flux[10:20, 7:12]).all()
    assert np.isnan(done.flux[20:30]).all()
    assert (done.flags[20:30] & NO_START).all()
    assert np.isfinite(done.flux[30:40, 7:]).all()
    assert (done.white[30:40, 20:] > done.white[40:50, 20:]).all()  # one frame says less than seven
    alone = reduced(t[10:20], tried=None)  # nothing to measure a bridge on
    assert np.isnan(alone.flux[:, 12:]).all()


def test_validity_is_flagged():
    t, _ = histories(50)
    done = reduced(t, curvature=np.where(np.arange(50) < 25, 900.0, np.nan))
    since = TIMES - START
    late = since * WALL.layers[0].diffusivity / 1.2e-3**2 > 0.2
    assert ((done.flags & LATE) > 0).all(axis=0).tolist() == late.tolist()
    assert (done.flags[:25, -1] & CURVED).all()
    assert not (done.flags[:25, 7] & CURVED).any()
    assert (done.flags[25:] & CURVED).all()
    assert flag_words(LATE | CURVED).count(";") == 1


def test_causes_that_last_go_through_and_new_ones_are_split():
    t, _ = histories(300)
    drawn = np.random.default_rng(4)
    registration = np.abs(drawn.normal(0.05, 0.01, t.shape))
    operator = flux_operator(TIMES, WALL, START)
    done = history_flux(t, np.full(t.shape, NOISE**2), {"emissivity": 0.01 * (t - 290)}, operator, WALL,
                        curvature=np.zeros(len(t)), longest_gap=3, once={"registration:1": registration},
                        tried=t)  # fmt: skip
    other = history_flux(t + 0.01 * (t - 290), np.full(t.shape, NOISE**2), {}, operator, WALL,
                         curvature=np.zeros(len(t)), longest_gap=3, tried=t)  # fmt: skip
    np.testing.assert_allclose(done.modes["emissivity"][:, 7:], (other.flux - done.flux)[:, 7:], rtol=1e-6)
    total = done.white + done.modes["registration:1 now"] ** 2 + done.modes["registration:1 before"] ** 2
    exact = (np.full(t.shape, NOISE**2) + registration**2) @ np.nan_to_num(operator.weights**2).T
    np.testing.assert_allclose(total[:, 7:], exact[:, 7:], rtol=1e-9)


def sensor(**options):
    entry = CameraEntry(name="c", file="c.json", images="*.tif", quantity="radiance", band_um=(8, 12), netd_K=0.03,
                        **options)  # fmt: skip
    return entry, PlanckBand(8.0, 12.0)


def test_pixels_are_made_equal_by_two_black_bodies():
    entry, band = sensor()
    rng = np.random.default_rng(5)
    gain, offset = 1 + 0.05 * rng.standard_normal((40, 50)), 0.3 * rng.standard_normal((40, 50))
    noise, frames = 0.02, 8

    def seen(kelvin, count=1):
        light = gain * band.radiance(kelvin) + offset
        return light + noise * rng.standard_normal((count, 40, 50)).mean(axis=0)

    cold, hot = seen(290.0, frames), seen(320.0, frames)
    made = ThermalSensor(band, entry, cold, hot, frames, noise**2, None)
    value, variance, full = made.signal(seen(300.0))
    level = float(np.median(value))
    assert abs(level - band.radiance(300.0)) < 0.15  # pixels agree with the median one
    z = (value - np.mean(value)) / np.sqrt(variance)
    assert np.std(z) == pytest.approx(1, abs=0.06)
    assert not full.any()
    assert np.std(seen(300.0)) > 10 * np.std(value)


def test_clipped_pictures_are_found_without_a_number():
    entry, band = sensor()
    made = ThermalSensor(band, entry, None, None, 1, 1e-4, None)
    picture = np.clip(np.random.default_rng(6).normal(12_000, 30, (60, 60)), 0, 65535).astype(np.uint16)
    assert not made.signal(picture)[2].any()
    clipped = np.minimum(picture, 12_030)
    full = made.signal(clipped)[2]
    assert full.sum() == (picture >= 12_030).sum()
    assert np.isnan(made.signal(clipped)[0][full]).all()
    by_number = ThermalSensor(band, sensor(saturation=12_010)[0], None, None, 1, 1e-4, None)
    assert by_number.signal(picture)[2].sum() == (picture >= 12_010).sum()


def test_frames_that_are_stored_in_other_bits_than_the_even_pictures_are_refused():
    """Pixels made equal by pictures of four times the numbers would get four times the pattern."""
    entry, band = sensor()
    rng = np.random.default_rng(7)
    even, frame = (rng.normal(level, 30, (60, 60)).astype(np.uint16) for level in (3000, 3100))

    def made(times):
        own = even * np.uint16(times)
        return ThermalSensor(band, entry, own.astype(float), None, 1, 1e-4, None, Bits.of(own), float(np.median(own)))

    for times, other in ((1, 4), (4, 1)):
        made(times).signal(frame * np.uint16(times))
        with pytest.raises(DataError, match=r"are multiples of 4, those of .* are not"):
            made(times).signal(frame * np.uint16(other))
    rounded = (frame // 4 * 4).astype(np.uint16)  # of fewer bits, and as large
    assert made(1).signal(rounded)[0].shape == (60, 60)
