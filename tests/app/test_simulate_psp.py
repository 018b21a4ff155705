"""`windmark simulate --psp`: its tables and pictures belong together."""

import csv
import hashlib

import numpy as np
import pytest

from windmark import io
from windmark.pipeline.simulate_psp import simulate_psp


def rows(path):
    with open(path, newline="") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("psp") / "a"
    folder.mkdir()
    simulate_psp(folder, 3, 1, (320, 200))
    return folder


@pytest.mark.slow
def test_every_pattern_finds_its_pictures(written):
    points = rows(written / "points.csv")
    assert [p["point"] for p in points] == ["p01"]
    for kind in ("on", "off"):
        for camera in ("cam1", "cam2"):
            found = sorted(written.glob(points[0][kind].format(camera=camera)))
            assert len(found) == 3
            assert io.read_grey(found[0]).shape == (200, 320)
    assert len([*written.glob("calibration/dark-cam1-*.tif")]) == 4
    assert len([*written.glob("calibration/flat-cam2-*.tif")]) == 16


def test_tables_agree_with_each_other_and_the_truth(written):
    taps = [row["name"] for row in rows(written / "taps.csv")]
    readings = rows(written / "tap-pressures.csv")
    assert [r["name"] for r in readings] == taps
    truth = io.read_json(written / "truth" / "paint.json")
    cell = rows(written / "paint-cell.csv")
    x = np.array([float(r["pressure_Pa"]) for r in cell]) / truth["p_ref_Pa"]
    warmer = np.array([float(r["temperature_K"]) for r in cell]) - truth["T_ref_K"]
    law = sum(np.polynomial.polynomial.polyval(warmer, a) * x**k for k, a in enumerate(truth["coefficients"]))
    off = np.array([float(r["ratio"]) for r in cell]) / law - 1
    assert 0.0015 < off.std() < 0.0025
    loads = rows(written / "truth" / "loads.csv")
    assert {row["volume"] for row in loads} == {"wing", "body"}
    sections = rows(written / "truth" / "sections.csv")
    upper = [float(r["cp"]) for r in sections if r["side"] == "1.0"]
    point = rows(written / "points.csv")[0]
    high = max(float(r["pressure_Pa"]) for r in readings)
    assert (high - float(point["p_inf_Pa"])) / float(point["q_inf_Pa"]) < 0.9 + max(upper)


@pytest.mark.slow
def test_same_seed_same_bytes(written, tmp_path):
    simulate_psp(tmp_path, 3, 1, (320, 200))
    prints = [
        {
            str(p.relative_to(root)): hashlib.sha256(p.read_bytes()).hexdigest()
            for p in root.rglob("*") if p.is_file()
        }
        for root in (written, tmp_path)
    ]  # fmt: skip
    assert prints[0] == prints[1]
    assert len(prints[0]) > 30


def test_one_kind_of_test_and_at_least_one_point(windmark, tmp_path):
    done = windmark("simulate", tmp_path / "x", "--psp", 2, "--infrared", 9)
    assert done.code == 2
    assert "--psp" in done.err
    none = windmark("simulate", tmp_path / "y", "--psp", 0)
    assert none.code == 2
    assert "--psp" in none.err
