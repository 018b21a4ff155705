"""``--lens`` and ``--free`` of `windmark calibrate`: which lens model, and which of its parameters."""

from __future__ import annotations

import pytest

from windmark.app.calibrate_options import parse_lens
from windmark.calibration.self_calibrate import FREE, FREE_OF
from windmark.errors import UsageError


@pytest.mark.parametrize(
    ("lens", "free", "expected"),
    [
        (None, None, (None, None)),
        ("brown", None, ("brown", FREE)),
        ("+k3", None, ("brown", (*FREE, "k3"))),
        ("fisheye", None, ("fisheye", None)),
        ("rational+tilts", None, ("rational", (*FREE_OF["rational"], "tilt_x", "tilt_y"))),
        (None, "focal_px,k1", (None, ("focal_px", "k1"))),
        ("fisheye+shear", None, ("fisheye", (*FREE_OF["fisheye"], "shear"))),
        ("brown+shear", None, ("brown", (*FREE, "shear"))),
        ("fisheye", "focal_px,k4", ("fisheye", ("focal_px", "k4"))),
    ],
)
def test_what_is_typed(lens, free, expected):
    assert parse_lens(lens, free) == expected


@pytest.mark.parametrize(
    ("lens", "free", "message"),
    [
        ("fisheye+k3", None, r"expected fisheye, fisheye\+tilts or fisheye\+shear"),
        ("mei", None, "expected pinhole, radial, brown, rational, fisheye"),
        ("brown", "k1", "both say which parameters are free"),
        ("fisheye+tilts", "k1", r"expected fisheye, fisheye\+tilts or fisheye\+shear"),
        ("fisheye", "k9", "'k9' is none of"),
    ],
)
def test_what_is_refused(lens, free, message):
    with pytest.raises(UsageError, match=message):
        parse_lens(lens, free)
