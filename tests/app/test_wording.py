"""Names and values in reports are words."""

import pytest

from windmark.app.wording import duration, named, power_of_ten, setting
from windmark.calibration import Weighted


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("rms_x_px", "RMS along x, px"), ("noise_percent", "noise, %"), ("max_tilt_deg", "max tilt, °"),
        ("crlb_found_px", "Cramér–Rao bound of those found, px"), ("seed", "seed"),
    ],
)  # fmt: skip
def test_a_name_is_words_with_its_unit(name, said):
    assert named(name) == said


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (None, "–"), ((), "–"), (True, "yes"), (False, "no"), ((3.0,), "3"), (("bowl", "template"), "bowl, template"),
        (0.1 + 0.2, "0.3"), (1234567.0, "1234567"), ({"a": (1.0, 2.5)}, "a: 1, 2.5"), (0, "0"),
        ({}, "–"), ([f"c{k}" for k in range(20)], "20: c0, c1 ... c19"),
        (Weighted(["a", "b"], 0.0024121778), "weighted (markers: a, b, sigma: 0.002412178)"),
    ],
)  # fmt: skip
def test_a_value_is_no_python(value, said):
    assert setting(value) == said


def test_powers_of_ten_and_times_are_written_by_hand():
    assert [power_of_ten(v) for v in (-134.4, 0.0, 12.0)] == ["10⁻¹³⁴", "10⁰", "10¹²"]
    assert [duration(v) for v in (2.1e-05, 1.6333, None)] == ["0.00", "1.63", "–"]
