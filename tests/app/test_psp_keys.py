"""Keys of a paint project, each on a simulated point where it matters: with it the truth, without it worse."""

import csv
import itertools
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from windmark import io
from windmark.pipeline.simulate_taps import tap_table
from windmark.synth import psp_test
from windmark.synth.pressure_paint import SternVolmer

# Whole points of a paint test, for each key.
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("all_undrawn")]

COLOURS = {"reference": SternVolmer(np.array([[1.0]])), "temperature": SternVolmer(np.array([[1.0, 0.012]]))}
"""What other colours of the paint answer to: to nothing, to temperature alone."""


@pytest.fixture(scope="module")
def made():
    """A polar of two points, of two pictures of each kind."""
    return psp_test(31, incidences=2, size_px=(640, 400), nodes=8_000, taps=tap_table(), on_frames=2, off_frames=2)


@pytest.fixture(scope="module")
def polar(made, one_camera, tmp_path_factory):
    """One point at 4 degrees, p02, with pictures in all colours; taps are compared with, not fitted to."""
    folder = tmp_path_factory.mktemp("keys") / "test"
    folder.mkdir()
    test = one_camera(folder, replace(made, points=made.points[1:]))
    for k, (name, law) in enumerate(COLOURS.items()):
        other = replace(test, paint=replace(test.paint, law=law), seed=1031 + 1000 * k)
        for kind, camera, j, picture in other.pictures(test.points[0]):
            io.write_image(folder / "images" / "p02" / f"{kind}-{name}-{camera}-{j}.tif", picture)
    project = (folder / "psp.toml").read_text()
    (folder / "psp.toml").write_text(project.replace("radius = 0.4", 'radius = 0.4\nin_situ = "compare"'))
    return folder


@pytest.fixture
def copied(polar, tmp_path):
    return shutil.copytree(polar, tmp_path / "test")


def change(folder, *pairs):
    """The project with other words; each must be there."""
    text = (folder / "psp.toml").read_text()
    for old, new in pairs:
        assert re.search(old, text), old
        text = re.sub(old, new, text)
    (folder / "psp.toml").write_text(text)


NO_LAMPS = (r"\[\[lamp\]\]\n.*\n.*\n", "")
NO_WELLS = (r"thermocouples = .*\nreadings = .*\n", "")


def rows(path):
    with open(path, newline="") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


def colours(folder, *names):
    """The table of points with pictures in other colours."""
    (row,) = rows(folder / "points.csv")
    row |= {f"{kind}_{name}": f"images/p02/{kind}-{name}-{{camera}}-*.tif" for name in names for kind in ("on", "off")}
    with open(folder / "points.csv", "w", newline="") as stream:
        writer = csv.DictWriter(stream, row)
        writer.writeheader()
        writer.writerow(row)


def reduced(windmark, folder, field="cp", true="cp"):
    """RMS error of a field at the nodes that have it, the share within 1.96 sigma, and the record of the point."""
    done = windmark("psp", folder / "psp.toml", "--json", "-o", folder / "out")
    assert done.code == 0, done.err
    found = io.read_nodes_netcdf(folder / "out" / "p02" / "fields.nc")[1]
    off = found[field] - io.read_nodes_netcdf(folder / "truth" / "p02.nc")[1][true]
    on = np.isfinite(off) & np.isfinite(found["cp"])
    assert on.sum() > 1_500
    return np.sqrt(np.mean(off[on] ** 2)), np.mean(np.abs(off[on]) < 1.96 * found[f"sigma_{field}"][on]), done.json


@pytest.fixture
def placed(polar, made_once, windmark):
    """The project with listed places and its results in ``out``: shown taps, one below, off the grid and nowhere."""

    def make(folder):
        shutil.copytree(polar, folder, dirs_exist_ok=True)
        taps = rows(folder / "taps.csv")
        shown = [t for t in taps if float(t["nz"]) > 0]
        below = {**next(t for t in taps if float(t["nz"]) < 0), "name": "below"}
        wanted = [*shown, below, {**shown[0], "name": "off", "z": "500"}, {**shown[0], "name": "lost", "z": "nan"}]
        keys = ("name", *"xyz", "nx", "ny", "nz")
        io.write_table(folder / "wanted.csv", {k: np.array([r[k] if k == "name" else float(r[k]) for r in wanted])
                                               for k in keys}, comment="length unit: mm")  # fmt: skip
        change(folder, (r"\[loads\]", '[[place]]\nfile = "wanted.csv"\nname = "rake"\n\n[loads]'))
        done = windmark("psp", folder / "psp.toml", "--json", "-o", folder / "out")
        assert done.code == 0, done.err
        assert done.json["reduced"] == 1

    return made_once("psp-placed", make)


def test_a_calibration_file_gives_the_same_bytes_as_its_table(windmark, copied, placed):
    assert windmark("paint-calibrate", copied / "paint-cell.csv", "-o", copied / "paint.json").code == 0
    change(copied, ('cell = "paint-cell.csv"', 'calibration = "paint.json"'))
    assert windmark("psp", copied / "psp.toml", "-o", copied / "out").code == 0
    by_file, by_cell = ({p.name: p.read_bytes() for p in of.rglob("*.vtp")} for of in (copied / "out", placed / "out"))
    assert by_file == by_cell != {}
    change(copied, ('calibration = "paint.json"', 'calibration = "paint.json"\np_ref_Pa = 9e4'))
    done = windmark("psp", copied / "psp.toml")
    assert done.code == 2
    assert "psp.toml: paint: only cell goes with p_ref_Pa" in done.err


def test_two_colours_stand_for_lamps_that_nobody_measured(windmark, copied):
    change(copied, NO_LAMPS)
    without, held, record = reduced(windmark, copied)
    assert held < 0.85
    assert any("no [[lamp]] is given" in remark for remark in record["remarks"])
    colours(copied, "reference")
    error, held, record = reduced(windmark, copied)
    assert error < 0.85 * without
    assert held > 0.92
    assert not any("no [[lamp]]" in remark for remark in record["remarks"])
    assert dict(record["results"][0]["causes"]["Cp"])["reference channel"] > 0


def test_a_temperature_paint_tells_the_walls_temperature(windmark, copied):
    """It is not even over the wall: recovery alone is 1.2 K off. Without lamps it needs the reference, too."""
    change(copied, NO_WELLS)
    recovery, _, _ = reduced(windmark, copied, "temperature", "T")
    assert recovery > 0.8
    t = np.linspace(278, 315, 20)
    ratio = 1 + 0.012 * (t - 293.15)
    io.write_table(copied / "tsp.csv", {"temperature_K": t, "ratio": ratio, "sigma": np.full(20, 0.001)})
    assert windmark("paint-calibrate", copied / "tsp.csv", "--temperature", "-o", copied / "tsp.json").code == 0
    change(copied, ("recovery = 0.896", 'paint = "tsp.json"'))
    done = windmark("psp", copied / "psp.toml", "--json")
    assert done.code == 1
    assert "names no pictures of its temperature paint" in done.json["results"][0]["reason"]
    colours(copied, "temperature")
    error, held, _ = reduced(windmark, copied, "temperature", "T")
    assert error < 0.6 * recovery
    assert held > 0.9
    change(copied, NO_LAMPS)
    colours(copied, "temperature", "reference")
    error, held, record = reduced(windmark, copied, "temperature", "T")
    assert error < 0.7 * recovery
    assert held > 0.9
    assert dict(record["results"][0]["causes"]["Cp"])["temperature paint"] > 0


def test_maps_of_an_infrared_camera_tell_the_walls_temperature(windmark, copied):
    change(copied, NO_WELLS)
    mesh, truth, *_ = io.read_nodes_netcdf(copied / "truth" / "p02.nc")
    noise, units = np.random.default_rng(3).standard_normal(len(mesh.vertices)), {"temperature": "K"}
    (copied / "maps").mkdir()

    def write(name="p02", scale=1.0, field="temperature"):
        values = {field: scale * (truth["T"] + 0.2 + 0.3 * noise), "sigma_temperature": np.full(len(noise), 0.3)}
        io.write_nodes_netcdf(copied / "maps" / f"{name}.nc", mesh, values, units=units, history={})

    change(copied, ("recovery = 0.896", 'recovery = 0.896\nmaps = "maps/{point}.nc"\nmaps_sigma_K = 0.2'))
    without, _, record = reduced(windmark, copied)
    assert any("no file 'maps/p02.nc'" in remark for remark in record["results"][0]["remarks"])
    write()
    error, held, record = reduced(windmark, copied)
    assert error < 0.85 * without
    assert held > 0.9
    assert "temperature map" in dict(record["results"][0]["causes"]["Cp"])
    units["temperature"] = "degC"
    write()
    done = windmark("psp", copied / "psp.toml", "--json")
    assert done.code == 1
    assert "p02.nc: temperature: is in degC; expected K" in done.json["results"][0]["reason"]


def test_a_sensor_that_is_not_linear(windmark, copied):
    """A level of s less dark becomes s (1 - 0.12 s / 16383)."""
    def bent(s):
        return s * (1 - 0.12 * s / 16383)

    dark = np.mean([io.read_grey(p) for p in (copied / "calibration").glob("dark-*.tif")], axis=0)
    for file in [*copied.glob("images/p02/*.tif"), *copied.glob("calibration/flat*.tif")]:
        io.write_image(file, np.rint(dark + bent(io.read_grey(file) - dark)).clip(0).astype(np.uint16))
    without, _, _ = reduced(windmark, copied)
    s = np.linspace(-500, 17000, 200)
    io.write_table(copied / "linearity-cam1.csv", {"level": bent(s), "light": s})
    change(copied, (r"\[radiometry\]", '[radiometry]\nlinearity = "linearity-{camera}.csv"'))
    error, held, _ = reduced(windmark, copied)
    assert error < 0.8 * without
    assert held > 0.88
    io.write_table(copied / "linearity-cam1.csv", {"level": s[::-1], "light": s})
    done = windmark("psp", copied / "psp.toml")
    assert done.code == 2
    assert "linearity-cam1.csv: line 3: level and light must both rise" in done.err


class Covered:
    """Air that what lies in a box of the wing (span stations y0 to y1, x0 to x1) does not feel: it is no paint."""

    def __init__(self, air, still, box):
        self._air, self._still, self._box = air, still, box

    def state(self, xyz, normal, volume):
        p, t = self._air.state(xyz, normal, volume)
        p0, t0 = self._still.state(xyz, normal, volume)
        x0, x1, y0, y1 = self._box
        inside = (xyz[:, 0] > x0) & (xyz[:, 0] < x1) & (xyz[:, 1] > y0) & (xyz[:, 1] < y1) & (normal[:, 2] > 0)
        return np.where(inside, p0, p), np.where(inside, t0, t)


def test_a_drawn_polygon_takes_out_what_is_no_paint(windmark, made, copied):
    test, point = made, made.points[1]
    mesh = test.mesh
    eta = np.abs(mesh.vertices[:, 1] - 0.65 * test.test.shape.span) < 6
    on = np.flatnonzero(eta & (mesh.vertex_normals()[:, 2] > 0.9) & np.isin(np.arange(len(eta)), np.unique(
        mesh.triangles[mesh.volume == "wing"])))  # fmt: skip
    centre = np.median(mesh.vertices[on], axis=0)
    box = (centre[0] - 12, centre[0] + 12, centre[1] - 8, centre[1] + 8)
    odd = replace(point, wind=Covered(point.wind, point.still, box))
    pictures = replace(test, points=(odd,), cameras={"cam1": test.cameras["cam1"]}).pictures(odd)
    for _, camera, k, picture in itertools.takewhile(lambda of: of[0] == "on", pictures):
        io.write_image(copied / "images" / "p02" / f"on-{camera}-{k}.tif", picture)
    without, _, _ = reduced(windmark, copied)
    x0, x1, y0, y1 = (v + m for v, m in zip(box, (-3, 3, -3, 3), strict=True))
    io.write_table(copied / "polygons.csv", {
        "name": ["tape"] * 4, "x": [x0, x1, x1, x0], "y": [y0, y0, y1, y1], "z": np.full(4, centre[2]),
    }, comment="length unit: mm")  # fmt: skip
    change(copied, (r"\[loads\]", '[patches]\npolygons = "polygons.csv"\n\n[loads]'))
    error, held, _ = reduced(windmark, copied)
    assert error < 0.7 * without
    assert held > 0.87  # nodes share errors: by a point's own covariance its 95 % hold 87 to 98 % of its nodes
    io.write_table(copied / "polygons.csv", {"name": ["a", "a"], "x": [0.0, 1], "y": [0.0, 1], "z": [0.0, 1]})
    done = windmark("psp", copied / "psp.toml")
    assert done.code == 2
    assert "polygons.csv: name: polygon 'a' has 2 corners" in done.err


def test_results_at_listed_places(windmark, copied, placed):
    """Taps as places have the Cp that the table of taps has; off the grid and where no camera looks there is none."""
    found, paint = ({r["name"]: r for r in rows(placed / "out" / "p02" / f"{name}.csv")}
                    for name in ("points-rake", "taps"))  # fmt: skip
    assert list(found) == [r["name"] for r in rows(placed / "wanted.csv")]
    both = [n for n in paint if n in found and paint[n]["cp_paint"]]
    assert len(both) > 10
    for name in both:
        assert float(found[name]["cp"]) == pytest.approx(float(paint[name]["cp_paint"]), rel=1e-9)
        assert float(found[name]["sigma_cp"]) == pytest.approx(float(paint[name]["sigma_paint"]), rel=1e-9)
        stream_ = (float(found[name]["pressure_Pa"]), float(found[name]["sigma_pressure_Pa"]))
        assert 1e4 < stream_[0] < 2e5
        assert 0 < stream_[1] < 5e3
        assert 250 < float(found[name]["temperature_K"]) < 350
    assert (found["off"]["remark"], found["off"]["cp"]) == ("outside the grid", "")
    assert (found["lost"]["remark"], found["lost"]["cp"]) == ("its place is not given", "")
    assert (found["below"]["remark"], found["below"]["cp"]) == ("not seen", "")
    assert "wanted.csv" in (placed / "out" / "manifest.json").read_text()  # so a run that goes on notices a change
    twice = '[[place]]\nfile = "taps.csv"\nname = "rake"\n\n'
    change(copied, (r"\[loads\]", f"{twice}{twice}[loads]"))
    again = windmark("psp", copied / "psp.toml")
    assert again.code == 2
    assert "place names must be unique, more than once: rake" in again.err
