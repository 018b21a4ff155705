"""Names and values in reports are words."""

import pytest

from windmark.app.wording import named, setting


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
        (0.1 + 0.2, "0.3"), (12345678.0, "12345678"), ({"a": (1.0, 2.5)}, "a: 1, 2.5"), (0, "0"),
    ],
)  # fmt: skip
def test_a_value_is_no_python(value, said):
    assert setting(value) == said
