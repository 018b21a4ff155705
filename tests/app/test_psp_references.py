"""References that are no point's own: wind-off pictures by incidence, and the mean of a run with the gain form."""

import csv
import json
import shutil

import numpy as np
import pytest

from windmark import io
from windmark.pipeline.simulate_psp import UNEVEN_K
from windmark.pipeline.simulate_taps import tap_table
from windmark.synth import psp_test

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("all_undrawn")]  # whole points of a paint test


@pytest.fixture(scope="module")
def polar(one_camera, tmp_path_factory):
    """Points at 0, 2 and 4 degrees."""
    folder = tmp_path_factory.mktemp("references") / "test"
    folder.mkdir()
    one_camera(folder, psp_test(37, incidences=3, size_px=(640, 400), taps=tap_table(), uneven_K=UNEVEN_K))
    return folder


@pytest.fixture
def copied(polar, tmp_path):
    return shutil.copytree(polar, tmp_path / "test")


def rows(path):
    with open(path, newline="") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


def write(path, table):
    with open(path, "w", newline="") as stream:
        writer = csv.DictWriter(stream, table[0])
        writer.writeheader()
        writer.writerows(table)


def change(folder, *pairs):
    text = (folder / "psp.toml").read_text()
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    (folder / "psp.toml").write_text(text)


def fields(path):
    return io.read_nodes_netcdf(path)[1]


def test_wind_off_pictures_of_other_incidences_stand_for_a_points_own(windmark, copied):
    """The middle one of three by the other two, as good as by its own; what lies outside is refused alone."""
    first, middle, last = rows(copied / "points.csv")
    own = {**middle, "point": "own"}
    none = dict.fromkeys(("off", "p_off_Pa", "T_off_K"), "")
    write(copied / "points.csv", [{**middle, **none}, own, {**last, **none, "alpha_deg": 7}])
    write(copied / "references.csv", [
        {"alpha_deg": of["alpha_deg"], "p_off_Pa": of["p_off_Pa"], "T_off_K": of["T_off_K"], "off": of["off"]}
        for of in (last, first)
    ])  # fmt: skip
    for file in ("tap-pressures.csv", "thermocouple-readings.csv"):
        readings = [r for r in rows(copied / file) if r["point"] == "p02"]
        write(copied / file, [{**r, "point": name} for name in ("p02", "own") for r in readings])
    change(copied, ('[[camera]]\nname = "cam1"', '[reference]\ntable = "references.csv"\n\n[[camera]]\nname = "cam1"'))
    done = windmark("psp", copied / "psp.toml", "--json")
    assert done.code == 0, done.err
    of = {r["point"]: r for r in done.json["results"]}
    assert "incidence 7 lies outside the references' 0 to 4" in of["p03"]["reason"]
    assert of["p02"]["pictures"] == [3, 6]
    true = fields(copied / "truth" / "p02.nc")["cp"]
    errors = {}
    for name in ("own", "p02"):
        found = fields(copied / "psp" / name / "fields.nc")
        off = found["cp"] - true
        on = np.isfinite(off) & (found["filled"] == 0)
        assert on.sum() > 1_300
        errors[name] = np.sqrt(np.mean(off[on] ** 2))
        assert np.mean(np.abs(off[on]) < 1.96 * found["sigma_cp"][on]) > 0.9
    assert errors["p02"] < 1.3 * errors["own"]


GAIN = {"format": "windmark paint calibration 1", "kind": "gain", "coefficients": [20e3, 0, 0, 1.0, 0, 0],
        "p_range": [1e4, 1.5e5], "t_range": [250, 330]}  # fmt: skip


def test_small_changes_about_the_mean_of_a_run(windmark, copied):
    """Three pictures of one point as a run; in one of them all light is 2 % less. Its steady pressure is known."""
    (_, middle, _) = rows(copied / "points.csv")
    for file in copied.glob("images/p02/on-*-1.tif"):
        dark = np.mean(
            [io.read_grey(p) for p in copied.glob(f"calibration/dark-{file.name.split('-')[1]}-*.tif")], axis=0
        )
        light = io.read_grey(file) - dark
        io.write_image(file, np.rint(dark + 0.98 * light).clip(0).astype(np.uint16))
    keep = ("alpha_deg", "mach", "p_inf_Pa", "q_inf_Pa", "T0_K")
    run = [{"point": f"t{k}", **{n: middle[n] for n in keep}, "on": f"images/p02/on-{{camera}}-{k}.tif", "run": "r1"}
           for k in range(3)]  # fmt: skip
    (copied / "images" / "p02" / "on-cam1-9.tif").write_bytes(b"no picture")
    broken = {**run[0], "point": "broken", "on": "images/p02/on-{camera}-9.tif"}
    write(copied / "points.csv", run[:2])
    (copied / "gain.json").write_text(json.dumps(GAIN))
    change(copied, ('cell = "paint-cell.csv"', 'calibration = "gain.json"\nsteady = "truth/p02-steady.nc"'),
           ("[[camera]]\nname = \"cam1\"", '[reference]\nmean_of_run = true\n\n[[camera]]\nname = "cam1"'))  # fmt: skip
    mesh, truth, *_ = io.read_nodes_netcdf(copied / "truth" / "p02.nc")

    def steady(unit="Pa"):
        field = {"pressure": truth["p"], "sigma_pressure": np.full(len(truth["p"]), 40.0)}
        io.write_nodes_netcdf(copied / "truth" / "p02-steady.nc", mesh, field, units={"pressure": unit}, history={})

    steady()
    untold = windmark("psp", copied / "psp.toml", "--json", "-o", copied / "untold").json
    assert any("no sigma has the lamps' flicker" in f["reason"] for f in untold["verdict"]["findings"])
    change(copied, ("[radiometry]", "[radiometry]\nlamp_flicker = 0.002"))
    write(copied / "points.csv", [*run, broken])
    done = windmark("psp", copied / "psp.toml", "--json")
    assert done.code == 0, done.err
    assert not any("flicker" in f["reason"] for f in done.json["verdict"]["findings"])
    of = {r["point"]: r for r in done.json["results"]}
    assert [of[name]["status"] for name in ("t0", "t1", "t2", "broken")] == ["reduced"] * 3 + ["failed"]
    assert done.json["paint"] == {"gain": GAIN["coefficients"]}
    assert any("point broken" in r and "only 0 of 1" in r for r in of["t0"]["remarks"])
    found = {name: fields(copied / "psp" / name / "fields.nc") for name in ("t0", "t1", "t2")}
    on = np.all([np.isfinite(f["pressure"]) & (f["filled"] == 0) for f in found.values()], axis=0) & np.isfinite(
        truth["p"]
    )
    assert on.sum() > 1_300
    gain = 20e3 + truth["p"][on]
    mean = (1 + 0.98 + 1) / 3
    for name, light in (("t0", 1.0), ("t1", 0.98), ("t2", 1.0)):
        sigma = found[name]["sigma_pressure"][on]
        off = found[name]["pressure"][on] - truth["p"][on] - gain * (mean / light - 1)
        lamps = gain * np.median(off / gain)  # the same for all nodes: judged once, the rest by node
        assert np.abs(np.median(lamps / sigma)) < 2.6, name
        assert np.mean(np.abs(off - lamps) < 1.96 * sigma) > 0.95, name
        assert np.mean(np.abs(off) < 1.96 * sigma) > 0.85, name
    step = (found["t1"]["pressure"] - found["t0"]["pressure"])[on] / gain
    assert np.median(step) == pytest.approx(mean / 0.98 - mean, abs=0.006)  # lamps flicker by 0.2 %
    steady("psf")
    done = windmark("psp", copied / "psp.toml", "--json", "-o", copied / "again")
    assert done.code == 1
    assert "pressure: is in psf; expected Pa" in done.json["results"][0]["reason"]


@pytest.mark.parametrize(("pairs", "words"), [
    ([('cell = "paint-cell.csv"', 'calibration = "gain.json"')], "belong together"),
    ([('cell = "paint-cell.csv"', 'cell = "paint-cell.csv"\nsteady = "x.nc"')], "need one of the tunnel's gain form"),
    ([("[points]", "[reference]\nmean_of_run = true\n\n[points]")], "need one of the tunnel's gain form"),
    ([("[points]", "[reference]\n\n[points]")], "expected either table, wind-off pictures by"),
    ([("[points]", '[reference]\ntable = "no.csv"\n\n[points]')], "reference.table"),
    ([("[points]", "[conditions]\np_inf = 3.0\n\n[points]")], "p_inf is not known"),
    ([('cell = "paint-cell.csv"', 'cell = "paint-cell.csv"\nsteady_sigma_Pa = 5.0')], "steady is missing"),
])  # fmt: skip
def test_keys_that_contradict_each_other_are_refused_before_any_point(windmark, copied, pairs, words):
    (copied / "gain.json").write_text(json.dumps(GAIN))
    change(copied, *pairs)
    done = windmark("psp", copied / "psp.toml")
    assert done.code == 2
    assert words in done.err.replace("\n", " ")


def test_conditions_of_all_points_need_no_columns(windmark, copied):
    table = rows(copied / "points.csv")[:1]
    said = {key: float(table[0][key]) for key in ("mach", "p_inf_Pa", "q_inf_Pa", "p_off_Pa")}
    write(copied / "points.csv", [{k: v for k, v in table[0].items() if k not in said} | {"T0_K": 303.0}])
    lines = "\n".join(f"{k} = {v}" for k, v in {**said, "T0_K": 310.0}.items())
    change(copied, ('[[camera]]\nname = "cam1"', f'[conditions]\n{lines}\n\n[[camera]]\nname = "cam1"'))
    done = windmark("psp", copied / "psp.toml", "--json")
    assert done.code == 0, done.err
    (of,) = done.json["results"]
    assert of["status"] == "reduced"
    assert "T0 is 303 K by its row, which counts, and 310 K by the project" in of["remarks"]
    assert sum("by the project" in r for r in of["remarks"]) == 1
