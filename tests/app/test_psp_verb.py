"""`windmark psp` on a simulated polar: against its truth, and each kind of mistake in its files."""

import csv
import json
import shutil

import numpy as np
import pytest

from windmark import io
from windmark.pipeline.simulate_psp import UNEVEN_K, simulate_psp
from windmark.pipeline.simulate_taps import tap_table
from windmark.synth import psp_test

WHOLE_GRIDS = True  # see `quick_pictures`


@pytest.fixture(scope="module")
def polar(tmp_path_factory):
    folder = tmp_path_factory.mktemp("polar") / "test"
    folder.mkdir()
    simulate_psp(folder, 11, 2, (640, 400))
    return folder


@pytest.fixture
def copied(polar, tmp_path, few_flats):
    folder = shutil.copytree(polar, tmp_path / "test")
    few_flats(folder)
    return folder


@pytest.fixture(scope="module")
def quick(one_camera, tmp_path_factory):
    """The polar by one camera, two pictures of each kind, on a coarser grid: for what is the same in any data."""
    folder = tmp_path_factory.mktemp("quick") / "test"
    folder.mkdir()
    one_camera(folder, psp_test(11, incidences=2, size_px=(640, 400), nodes=5_000, taps=tap_table(), uneven_K=UNEVEN_K,
                                on_frames=2, off_frames=2))  # fmt: skip
    return folder


@pytest.fixture
def quick_copy(quick, tmp_path):
    return shutil.copytree(quick, tmp_path / "test")


def rows(path):
    with open(path, newline="") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


def write(path, table):
    with open(path, "w", newline="") as stream:
        writer = csv.DictWriter(stream, table[0])
        writer.writeheader()
        writer.writerows(table)


def fields(path):
    return io.read_nodes_netcdf(path)[1]


def results(folder):
    """Every file of a result but what names times."""
    return {
        str(p.relative_to(folder)): p.read_bytes()
        for p in sorted(folder.rglob("*")) if p.is_file() and p.suffix in (".csv", ".vtp", ".pvd")
    }  # fmt: skip


@pytest.fixture(scope="module")
def whole(windmark, polar, tmp_path_factory):
    """What the command says of the polar, and its results."""
    out = tmp_path_factory.mktemp("whole") / "out"
    return windmark("psp", polar / "psp.toml", "--output", out, "--json"), out


@pytest.mark.slow
def test_a_simulated_polar_comes_out_as_it_is_true(polar, whole):
    done, out = whole
    assert done.code == 0, done.err
    assert [r["status"] for r in done.json["results"]] == ["reduced", "reduced"]
    for of in done.json["results"]:
        place = out / of["point"]
        found, true = fields(place / "fields.nc"), fields(polar / "truth" / f"{of['point']}.nc")
        off, sigma = found["cp"] - true["cp"], found["sigma_cp"]
        seen = np.isfinite(off)
        assert seen.sum() > 4_000
        assert np.sqrt(np.median(off[seen] ** 2)) < 0.03
        assert 0.90 < np.mean(np.abs(off[seen]) < 1.96 * sigma[seen]) < 0.985
        assert abs(np.median(found["ratio"][seen] / true["ratio"][seen]) - 1) < 0.01
        assert of["in_situ"]["taps"] >= 15
        assert of["taps"]["rms_cp"] < 0.03
        assert of["pictures"] == [6, 6]
        assert 0.1 < of["loads"]["wing"]["CL"][0] < 0.8
        assert 0.3 < of["area_shown"]["wing"] < 0.6  # both cameras look from above
        sections = rows(place / "sections.csv")
        assert {s["section"] for s in sections} == {"eta30", "eta55", "eta80"}
    low, high = (of["loads"]["wing"]["CL"] for of in done.json["results"])
    assert high[0] - low[0] > 5 * np.hypot(low[1], high[1])  # four degrees of incidence
    html = (out / "report.html").read_text()
    assert html.count("<img") >= 8
    assert html.count('class="wm-scene"') == 1
    assert html.count('class="wm-photo"') == 2  # one of each camera
    assert "area shown" in html
    assert html.index('class="wm-scene"') < html.index(">Notes<")  # the result first
    wing = [r for r in rows(out / "loads.csv") if r["volume"] == "wing"]
    assert all(0.3 < float(r["area_shown"]) < 0.6 for r in wing)
    assert not done.json["not_drawn"]
    assert (out / "polar.pvd").read_text().count("DataSet") == 2


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_mistake_in_one_point_gets_a_sentence_and_stops_no_other(windmark, quick_copy):
    (good, high) = rows(quick_copy / "points.csv")
    for name, change in (("bright", lambda a: np.where(np.arange(a.size).reshape(a.shape) % 9 == 0, 16383, a)),
                         ("gloomy", lambda a: np.full_like(a, 100))):  # fmt: skip
        shutil.copytree(quick_copy / "images" / "p01", quick_copy / "images" / name)
        for file in (quick_copy / "images" / name).glob("on-*.tif"):
            io.write_image(file, change(io.read_grey(file)).astype(np.uint16))
    wrong = {
        "no-reference": {"off": "images/p01/none-{camera}-*.tif"},
        "exchanged": {"on": high["on"], "off": high["off"]},
        "mixed-units": {"q_inf_Pa": float(good["q_inf_Pa"]) / 1000},
        "other-unit": {"p_off_Pa": float(good["p_off_Pa"]) / 100},
        "no-temperature": {"T_off_K": ""},
        "bright": {"on": "images/bright/on-{camera}-*.tif"},
        "gloomy": {"on": "images/gloomy/on-{camera}-*.tif"},
        "cold": {"T0_K": ""},
        "same": {"on": good["off"]},
    }
    write(quick_copy / "points.csv", [good, *({**good, "point": name, **other} for name, other in wrong.items())])
    done = windmark("psp", quick_copy / "psp.toml", "--json", "--threads", "2")
    assert done.code == 0, done.err
    said = {r["point"]: (r["status"], r["reason"]) for r in done.json["results"]}
    assert said["p01"] == ("reduced", "")
    for name, words in {
        "no-reference": "the reference is missing", "exchanged": "rows and pictures were exchanged",
        "mixed-units": "units are mixed", "other-unit": "its unit is another one",
        "no-temperature": "T_off is missing", "bright": "is saturated", "gloomy": "dark picture is brighter",
        "cold": "temperature is missing",
        "same": "wind-off picture off-cam1-0.tif of cam1 is wind-on picture off-cam1-0.tif of cam1",
    }.items():  # fmt: skip
        assert said[name][0] == "failed", name
        assert words in said[name][1], said[name]
        assert said[name][1].count("\n") == 0
    table = {r["point"]: r["reason"] for r in rows(quick_copy / "psp" / "points.csv")}
    assert table["exchanged"] == said["exchanged"][1]
    assert "Point exchanged" in (quick_copy / "psp" / "report.html").read_text()


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_taps_outside_the_grid_are_said_and_the_calibration_is_taken_alone(windmark, quick_copy):
    taps = rows(quick_copy / "taps.csv")
    write(quick_copy / "taps.csv", [{**tap, "z": float(tap["z"]) + 500} for tap in taps])
    write(quick_copy / "points.csv", rows(quick_copy / "points.csv")[:1])
    done = windmark("psp", quick_copy / "psp.toml", "--json")
    assert done.code == 0, done.err
    (of,) = done.json["results"]
    assert of["status"] == "reduced"
    assert of["in_situ"] == {}
    assert any("54 of 54 taps lie outside the grid" in remark for remark in of["remarks"]), of["remarks"]
    assert any("that of the calibration alone" in remark for remark in of["remarks"])


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_threads_and_a_run_that_was_stopped_give_the_same_bytes(windmark, quick, tmp_path, monkeypatch):
    from windmark.pipeline.psp import each as job

    whole, other, stopped = (tmp_path / name for name in ("whole", "threads", "stopped"))
    assert windmark("psp", quick / "psp.toml", "-o", whole, "--threads", "1").code == 0
    assert windmark("psp", quick / "psp.toml", "-o", other, "--threads", "2").code == 0
    assert results(whole) == results(other) != {}
    one_point = job.one_point

    def breaks(test, folder, row):
        if row.name == "p02":
            raise KeyboardInterrupt
        return one_point(test, folder, row)

    monkeypatch.setattr(job, "one_point", breaks)
    ended = windmark("psp", quick / "psp.toml", "-o", stopped)
    assert ended.code == 130
    assert "1 points are kept" in ended.err
    monkeypatch.undo()
    again = windmark("psp", quick / "psp.toml", "-o", stopped, "--resume", "--json")
    assert again.code == 0, again.err
    assert again.json["reduced"] == 2
    assert results(whole) == results(stopped)
    assert not [*stopped.glob(".windmark-*")]


def spoil(folder, name):
    """Pictures of a point, one of three of each kind and camera bad in its own way."""
    shutil.copytree(folder / "images" / "p01", folder / "images" / name)
    place = folder / "images" / name
    (place / "on-cam1-0.tif").write_bytes((place / "on-cam1-0.tif").read_bytes()[:2000])
    for file, change in (("on-cam2-1", lambda a: np.minimum(8 * a.astype(int), 16383)), ("off-cam1-2", lambda a: 0 * a),
                         ("off-cam2-0", lambda a: a[:-10])):  # fmt: skip
        io.write_image(place / f"{file}.tif", change(io.read_grey(place / f"{file}.tif")).astype(np.uint16))
    return {"on": f"images/{name}/on-{{camera}}-*.tif", "off": f"images/{name}/off-{{camera}}-*.tif"}


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_bad_picture_is_left_out_beside_good_ones_and_said(windmark, copied, no_second_camera):
    (good, _) = rows(copied / "points.csv")
    spoilt = {**good, "point": "spoilt", **spoil(copied, "spoilt")}
    few = {**good, "point": "few", **spoil(copied, "few")}
    (copied / "images" / "few" / "on-cam1-2.tif").write_bytes(b"")
    write(copied / "points.csv", [spoilt, good, few])  # the first points' wind-off pictures say the gain
    with open(copied / "tap-pressures.csv", newline="") as stream:
        taps = [r for r in csv.DictReader(stream) if r["point"] == "p01"]
    write(copied / "tap-pressures.csv", [{**r, "point": name} for name in ("p01", "spoilt") for r in taps])
    done = windmark("psp", copied / "psp.toml", "--json")
    assert done.code == 0, done.err
    of = {r["point"]: r for r in done.json["results"]}
    assert (of["few"]["status"], of["spoilt"]["status"]) == ("failed", "reduced")
    assert (
        "only 1 of 3 wind-on pictures of cam1 can be used; the first that cannot is on-cam1-0.tif"
        in of["few"]["reason"]
    )
    assert of["p01"]["pictures"] == [6, 6]
    assert of["spoilt"]["pictures"] == [4, 4]
    html = (copied / "psp" / "report.html").read_text()
    for name, why in (("wind-on picture on-cam1-0.tif of cam1", "on-cam1-0.tif"),
                      ("wind-on picture on-cam2-1.tif of cam2", "is saturated"),
                      ("wind-off picture off-cam1-2.tif of cam1", "dark picture is brighter"),
                      ("wind-off picture off-cam2-0.tif of cam2", "pixels")):  # fmt: skip
        remarks = [r for r in of["spoilt"]["remarks"] if r.startswith(f"{name} does not count: ")]
        assert len(remarks) == 1, of["spoilt"]["remarks"]
        assert why in remarks[0]
        assert f"spoilt: {name} does not count" in html
    a, b = (fields(copied / "psp" / name / "fields.nc") for name in ("p01", "spoilt"))
    both = np.isfinite(a["cp"] + b["cp"])
    assert both.sum() > 4_000
    apart, sigma = (a["cp"] - b["cp"])[both], b["sigma_cp"][both]
    # What the lamps and the fit to the taps leave open is the same for all nodes: it is judged once, the rest by node.
    common = np.polyval(np.polyfit(a["cp"][both], apart, 1), a["cp"][both])
    assert np.abs(np.median(common / sigma)) < 2.6
    assert np.mean(np.abs(apart - common) < 1.96 * sigma) > 0.95
    assert np.mean(np.abs(apart) < 1.96 * sigma) > 0.95
    assert np.median(b["sigma_cp"][both] / a["sigma_cp"][both]) > 1.0
    write(copied / "points.csv", [spoilt])
    no_second_camera(copied)  # half the time, and the same is said of the first
    said = windmark("psp", copied / "psp.toml", "-o", copied / "again")
    assert "note: wind-off picture off-cam1-2.tif of cam1 does not count: the dark picture is brighter" in said.out


@pytest.mark.slow
def test_what_all_points_need_is_refused_before_any_is_reduced(windmark, copied):
    project = (copied / "psp.toml").read_text()
    cell = rows(copied / "paint-cell.csv")
    for old, new, words in (
        ('dark = "calibration/dark-{camera}-*.tif"', 'dark = "calibration/drak-{camera}-*.tif"', "no file matches"),
        ('cell = "paint-cell.csv"', 'cell = "paint-cell.cvs"', "paint-cell.cvs"),
        ("recovery = 0.896", "recovery = 8.96", "temperature.recovery"),
    ):
        (copied / "psp.toml").write_text(project.replace(old, new))
        done = windmark("psp", copied / "psp.toml")
        assert done.code == 2
        assert words in done.err
        assert not (copied / "psp").exists()
    (copied / "psp.toml").write_text(project)
    write(copied / "paint-cell.csv", [row for row in cell if row["pressure_Pa"] == cell[0]["pressure_Pa"]])
    done = windmark("psp", copied / "psp.toml", "--json")
    assert done.code == 2
    assert "paint.cell" in json.loads(done.out)["error"]


@pytest.mark.slow
def test_dark_and_flat_pictures_in_one_file_are_inputs_of_the_run(copied):
    import tifffile

    from windmark.pipeline.psp import load_psp, made_with, read_psp_project
    from windmark.pipeline.same_run import changed

    for kind in ("dark", "flat"):
        for camera in ("cam1", "cam2"):
            files = sorted((copied / "calibration").glob(f"{kind}-{camera}-*.tif"))
            whole = np.stack([io.read_grey(f) for f in files])
            tifffile.imwrite(copied / "calibration" / f"{kind}-{camera}.tif", whole, photometric="minisblack")
    text = (copied / "psp.toml").read_text()
    (copied / "psp.toml").write_text(text.replace("{camera}-*.tif\"", "{camera}.tif\""))
    before = made_with(load_psp(read_psp_project(copied / "psp.toml")))
    assert {f"calibration/{k}-{c}.tif" for k in ("dark", "flat") for c in ("cam1", "cam2")} <= set(before["files"])
    with open(copied / "calibration" / "dark-cam1.tif", "ab") as stream:
        stream.write(b"0")
    now = made_with(load_psp(read_psp_project(copied / "psp.toml")))
    assert changed(before, now) == "calibration/dark-cam1.tif has changed since"
