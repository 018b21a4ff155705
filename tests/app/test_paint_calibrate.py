"""`windmark paint-calibrate`: the law against its truth, the file that `psp` reads, and tables that are refused."""

import json

import numpy as np
import pytest

from windmark import io
from windmark.errors import WindmarkError
from windmark.pipeline.psp.calibration import read_calibration, read_temperature_calibration
from windmark.pipeline.psp.cell import calibrate_paint, read_cell
from windmark.synth.pressure_paint import TYPICAL

SIGMA = 0.002


def cell(folder, seed=1, *, law=TYPICAL, name="cell.csv", **changed):
    """A table of 12 pressures and 8 temperatures; ``changed``: columns instead (None: left out)."""
    rng = np.random.default_rng(seed)
    p, t = (a.ravel() for a in np.meshgrid(np.linspace(2e4, 1.3e5, 12), np.linspace(278.15, 313.15, 8)))
    ratio = law.ratio(p, t) * (1 + SIGMA * rng.standard_normal(len(p)))
    columns = {"pressure_Pa": p, "temperature_K": t, "ratio": ratio, "sigma": SIGMA * ratio} | changed
    io.write_table(folder / name, {k: v for k, v in columns.items() if v is not None})
    return folder / name


@pytest.mark.slow
def test_the_law_is_the_true_one_within_its_covariance(tmp_path):
    """Of 40 tables the middle of the range lies within 1.96 sigma of the truth as often as it should."""
    z = []
    for seed in range(40):
        law = calibrate_paint(read_cell(cell(tmp_path, 100 + seed)), p_ref_Pa=1e5, t_ref_K=293.15).law
        by_a = law.slopes([6.3e4], [297.0])[2][0]
        # A factor that all ratios share does not count in the tunnel; here the table has the true one.
        z.append((law.ratio(6.3e4, 297.0) - TYPICAL.ratio(6.3e4, 297.0)) / np.sqrt(by_a @ law.cov @ by_a))
    assert np.mean(np.abs(z) < 1.96) >= 0.85
    assert 0.6 < np.std(z) < 1.4


def test_what_it_says_and_the_picture(windmark, tmp_path):
    done = windmark("paint-calibrate", cell(tmp_path), "-o", tmp_path / "paint.json")
    assert done.code == 0, done.err
    assert "96 measurements, 20000 to 130000 Pa" in done.out
    assert "chosen by cross-validation" in done.out
    assert '[paint] calibration = "paint.json"' in done.out
    assert (tmp_path / "paint.png").read_bytes()[:4] == b"\x89PNG"
    record = windmark("paint-calibrate", cell(tmp_path), "-o", tmp_path / "a.json", "--order", "2,2", "--json").json
    assert np.shape(record["coefficients"]) == (3, 3)
    assert np.shape(record["cov"]) == (9, 9)
    assert record["rms"] == pytest.approx(0.7 * SIGMA, rel=0.3)  # ratios are 0.3 to 1.5
    assert record["made_of"] == "cell.csv"


@pytest.mark.slow
def test_any_unit_gives_the_same_law(windmark, tmp_path):
    plain = cell(tmp_path)
    p, t = (io.read_table(plain, required=(), known=None).numbers(c) for c in ("pressure_pa", "temperature_k"))
    other = cell(tmp_path, name="other.csv", pressure_Pa=None, temperature_K=None, pressure_psi=p / 6894.757293,
                 temperature_degF=(t - 255.3722222222222) * 1.8)  # fmt: skip
    for table, name in ((plain, "a"), (other, "b")):
        assert windmark("paint-calibrate", table, "-o", tmp_path / f"{name}.json").code == 0
    a, b = (read_calibration(tmp_path / f"{name}.json").law for name in "ab")
    np.testing.assert_allclose(a.ratio(7e4, 300.0), b.ratio(7e4, 300.0), rtol=1e-8)


def test_errors_of_the_cells_pressures_are_in_the_covariance(windmark, tmp_path):
    sigma = {}
    for name, error in (("sure", 1.0), ("unsure", 900.0)):
        table = cell(tmp_path, name=f"{name}.csv", sigma_pressure_Pa=np.full(96, error))
        assert windmark("paint-calibrate", table, "-o", tmp_path / f"{name}.json", "--order", "2,1").code == 0
        law = read_calibration(tmp_path / f"{name}.json").law
        by_a = law.slopes([6.3e4], [297.0])[2][0]
        sigma[name] = np.sqrt(by_a @ law.cov @ by_a)
    assert sigma["unsure"] > 2 * sigma["sure"]


def test_a_temperature_paint(windmark, tmp_path):
    rng = np.random.default_rng(4)
    t = np.linspace(280, 320, 21)
    ratio = np.exp(0.012 * (t - 293.15) - 4e-5 * (t - 293.15) ** 2)
    io.write_table(tmp_path / "tsp.csv", {"temperature_K": t, "ratio": ratio * (1 + 0.001 * rng.standard_normal(21)),
                                          "sigma": 0.001 * ratio})  # fmt: skip
    done = windmark("paint-calibrate", tmp_path / "tsp.csv", "--temperature", "-o", tmp_path / "tsp.json")
    assert done.code == 0, done.err
    assert "% per K" in done.out
    law = read_temperature_calibration(tmp_path / "tsp.json")
    np.testing.assert_allclose(law.log_ratio(305.0), 0.012 * 11.85 - 4e-5 * 11.85**2, atol=2e-3)
    with pytest.raises(WindmarkError, match=r"tsp\.json: kind: is the calibration of a temperature paint"):
        read_calibration(tmp_path / "tsp.json")


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"pressure_Pa": None}, "no column pressure_...; expected pressure_UNIT with one of the units Pa, hPa"),
        ({"pressure_Pa": None, "pressure_torr": np.ones(96)}, "pressure_torr: its unit is not known"),
        ({"ratio": None}, "no column 'ratio'"),
        ({"ratio": 1 / TYPICAL.ratio(*(a.ravel() for a in np.meshgrid(
            np.linspace(2e4, 1.3e5, 12), np.linspace(278.15, 313.15, 8))))}, "not I / I_ref"),
        ({"pressure_Pa": np.full(96, 5e4)}, "needs 2 different pressures, the table has 1"),
        ({"pressure_Pa": np.r_[np.full(95, 5e4), 0.0]}, "line 97: the pressure must be a number above zero"),
        ({"temperature_K": np.linspace(5, 40, 96)}, "line 2: the temperature must be above 50 K"),
        ({"sigma": np.r_[0.0, np.full(95, 0.01)]}, "line 2: sigma, that of the ratio, must be above zero"),
        ({"sigma": np.array(["x"] * 96)}, "line 2: sigma is 'x'; expected a finite number"),
        ({"sigma_pressure_Pa": np.full(96, -1.0)}, "line 2: sigma_pressure must be at least 0"),
    ],
)  # fmt: skip
def test_bad_tables_are_refused_and_no_file_written(windmark, tmp_path, changed, words):
    done = windmark("paint-calibrate", cell(tmp_path, **changed), "-o", tmp_path / "paint.json")
    assert done.code == 2
    assert "cell.csv" in done.err
    assert words in done.err
    assert not [*tmp_path.glob("paint.*")]


def test_bad_options(windmark, tmp_path):
    table = cell(tmp_path)
    for more, words in ((("--order", "5,1"), "within 1 to 4 and 0 to 3"), (("--order", "two"), "such as 2,1"),
                        (("-o", tmp_path / "paint.png"), "expected the name of a JSON file"),
                        (("--p-ref", "-5"), "'--p-ref': expected > 0, not -5")):  # fmt: skip
        done = windmark("paint-calibrate", table, *more)
        assert done.code == 2
        assert words in done.err


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "x"}, "format: expected 'windmark paint calibration 1'"),
        ({"kind": "colour"}, "kind: expected one of pressure, temperature, gain, got 'colour'"),
        ({"p_ref_Pa": -1}, "p_ref_Pa"),
        ({"p_ref_kPa": 100}, "p_ref_kPa: unknown key"),
        ({"coefficients": [[1.0], [-0.5]], "cov": None}, "ranges and cov: SternVolmer: I_ref/I does not rise"),
        ({"cov": [[1.0]]}, "cov must be 6 x 6"),
        ({"cov": (-np.eye(6)).tolist()}, "negative eigenvalue"),
        ({"p_range_Pa": [2e5, 1e5]}, "p_range and t_range must rise"),
    ],
)  # fmt: skip
def test_bad_files_of_a_calibration_name_the_key(windmark, tmp_path, change, words):
    file = tmp_path / "paint.json"
    assert windmark("paint-calibrate", cell(tmp_path), "-o", file, "--order", "2,1").code == 0
    file.write_text(json.dumps(json.loads(file.read_text()) | change))
    with pytest.raises(WindmarkError) as error:
        read_calibration(file)
    assert "paint.json" in str(error.value)
    assert words in str(error.value)
