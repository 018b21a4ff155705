"""Self-calibration of the DBAT sheet from its published marks, from rough coordinates and no poses."""

import sys
from pathlib import Path

import pytest

DATA = Path(__file__).parents[2] / ".." / "shared" / "data" / "dbat-camcal"


@pytest.fixture
def bench(monkeypatch):
    if not DATA.is_dir():
        pytest.skip("real pictures (dbat-camcal) are not here")
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    import calibration_real

    yield calibration_real
    sys.modules.pop("calibration_real", None)


@pytest.mark.parametrize(("held", "sigma0"), [(True, 0.156), (False, 0.138)])
def test_published_marks(bench, held, sigma0):
    r = bench.row(bench.published(DATA), bench.BROWN, held, reject=False)
    assert r["sigma0_px"] <= sigma0  # published: 0.1615 with four points held
    assert max(r["rms_x_mm"], r["rms_y_mm"]) < 0.1
    assert r["rms_z_mm"] < 0.2
    assert abs(r["focal_px"] - 7.457 / 7.25301 * 2272) < 4 * r["focal_sigma"] + 1.0
    assert 1.0 < r["split"] < 2.5  # a real lens: the formal covariance is optimistic
