"""Warm markers and temperatures through register, resect, align, track and run; the paper's search on demand."""

import json

import numpy as np
import pytest
import xarray

from windmark import io

pytestmark = pytest.mark.usefixtures("all_undrawn")


@pytest.fixture(scope="module")
def warm(virtual_test, tmp_path_factory):
    """The virtual test as an infrared camera would see it: bright markers, in degrees Celsius times 100."""
    folder, _ = virtual_test
    out = tmp_path_factory.mktemp("warm")
    for name in ("wind-off", "wind-on"):
        image = io.read_image(folder / f"{name}.tif").astype(int)
        io.write_image(out / f"{name}.tif", (5000 - image * (4000 / image.max())).astype(np.uint16))
    for name in ("markers.csv", "camera.json", "model.grid"):
        (out / name).write_bytes((folder / name).read_bytes())
    return out


def files(folder, image, *options):
    table = ["-m", folder / "markers.csv", "-c", folder / "camera.json", "-r", 4, "--unit", "mm"]
    return [folder / image, *table, *options]


@pytest.fixture(scope="module")
def registered(windmark, warm, tmp_path_factory):
    out = tmp_path_factory.mktemp("registered")
    return windmark("register", *files(warm, "wind-off.tif", "-o", out)), out


def test_bright_markers_are_registered_and_said(registered, warm, windmark, virtual_test, tmp_path):
    done, out = registered
    assert done.code == 0
    assert "wind-off: bright markers: " in done.out
    assert "Bright markers: " in (out / "report.html").read_text(encoding="utf-8")
    record = json.loads((out / "summary.json").read_text())["images"][0]
    assert record["polarity"] == "bright"
    assert record["registration"]["rms_px"] < 0.05
    forced = windmark("register", *files(warm, "wind-off.tif", "--polarity", "dark", "-o", tmp_path / "dark"))
    assert forced.code == 1
    plain = windmark("register", *files(virtual_test[0], "wind-off.tif", "-o", tmp_path / "plain"))
    assert "bright markers" not in plain.out


def test_dark_dirt_does_not_hide_warm_markers(windmark, warm, tmp_path):
    """Dark spots that are no markers give no pose: then the warm ones are tried, and the pose decides."""
    image = io.read_image(warm / "wind-off.tif").astype(float)
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    for k in range(6):
        px, py = 60 + 45 * k, 40 + 5 * k
        image -= 300 * (1 - np.tanh(1.5 * (np.hypot(x - px, y - py) - 4)))
    io.write_image(tmp_path / "dirty.tif", np.clip(image, 0, 65535).astype(np.uint16))
    table = ["-m", warm / "markers.csv", "-c", warm / "camera.json", "-r", 4, "--unit", "mm"]
    done = windmark("register", tmp_path / "dirty.tif", *table, "-o", tmp_path / "out")
    assert done.code == 0, done.err
    assert "gave no pose)" in done.out


def test_detect_says_it(windmark, warm, tmp_path):
    done = windmark("detect", warm / "wind-off.tif", "-r", 4, "-o", tmp_path / "d.csv")
    assert "bright markers:" in done.out
    near = windmark("detect", warm / "wind-off.tif", "--near", tmp_path / "d.csv", "-o", tmp_path / "n.csv", "--json")
    assert near.json["images"]["wind-off.tif"]["polarity"] == "bright"
    assert near.json["images"]["wind-off.tif"]["found"] > 20


def test_track(windmark, warm, tmp_path):
    both = [warm / "wind-off.tif", *files(warm, "wind-on.tif", "-o", tmp_path / "t")]
    done = windmark("track", *both)
    assert done.code == 0, done.err
    assert "bright markers: dark spots gave no pose" in done.out
    assert json.loads((tmp_path / "t" / "summary.json").read_text())["polarity"] == "bright"


@pytest.mark.slow
def test_temperatures_are_named_everywhere(windmark, registered, warm, tmp_path):
    camera = registered[1] / "wind-off" / "camera.json"
    call = ["resect", warm / "wind-off.tif", "-c", camera, "-g", warm / "model.grid", "--unit", "mm"]
    scaled = ["--quantity", "temperature", "--quantity-unit", "K", "--scale", 0.01, "--offset", 273.15]
    done = windmark(*call, *scaled, "--pixels", "-o", tmp_path / "k")
    assert done.code == 0, done.err
    assert "temperature (K) on " in done.out
    windmark(*call, "-o", tmp_path / "grey")
    place = tmp_path / "k" / "wind-off"
    grid = io.read_grid_file(place / "nodes.nc")
    assert grid.units["temperature_K"] == "K"
    grey = io.read_grid_file(tmp_path / "grey" / "wind-off" / "nodes.nc").fields["value"]
    np.testing.assert_allclose(grid.fields["temperature_K"], 273.15 + 0.01 * grey, atol=1e-3)
    for name in ("nodes.dat", "nodes.vtp"):
        again = io.read_grid_file(place / name)
        assert again.units["temperature_K"] == "K"
        np.testing.assert_allclose(again.fields["temperature_K"], grid.fields["temperature_K"], rtol=1e-6)
    with xarray.open_dataset(place / "pixels.nc", engine="h5netcdf") as pixels:
        assert pixels["temperature_K"].attrs["units"] == "K"
        kelvin = 273.15 + 0.01 * io.read_image(warm / "wind-off.tif").astype(float)
        told = np.isfinite(pixels["temperature_K"].values)
        assert 0 < (~told).sum() < 50  # hot and dead pixels
        np.testing.assert_allclose(pixels["temperature_K"].values[told], kelvin[told], rtol=1e-6)
    assert "temperature_K [K]" in (place / "nodes.csv").read_text().split("\n", 1)[0]
    assert (place / "nodes.nam").read_text().startswith("temperature_K [K]")
    page = (tmp_path / "k" / "report.html").read_text(encoding="utf-8")
    assert "The values are temperature, K (273.15 + 0.01 x the file" in page
    record = json.loads((tmp_path / "k" / "summary.json").read_text())["images"][0]["quantity"]
    assert record == {"name": "temperature", "unit": "K", "scale": 0.01, "offset": 273.15, "column": "temperature_K"}


def test_what_is_said_of_values_is_checked(windmark, registered, warm, tmp_path):
    camera = registered[1] / "wind-off" / "camera.json"
    call = ["resect", warm / "wind-off.tif", "-c", camera, "-g", warm / "model.grid", "--unit", "mm"]
    for options, message in (
        (["--quantity", "temperature"], "unit of a temperature must be one of K, degC, degF"),
        (["--quantity-unit", "K"], "unit 'K' without quantity"),
        (["--quantity", "heat"], "quantity"),
        (["--scale", "0"], "scale must not be 0"),
    ):
        done = windmark(*call, *options, "-o", tmp_path / "out")
        assert done.code == 2
        assert message in done.err
    assert not (tmp_path / "out").exists()


def test_a_file_that_says_its_quantity(windmark, registered, warm, tmp_path):
    image = io.read_image(warm / "wind-off.tif")
    kelvin = (image * 0.01 + 273.15).astype(np.float32)
    io.write_image(tmp_path / "a.tif", kelvin, description="the values are temperature in K")
    call = ["resect", "", "-c", registered[1] / "wind-off" / "camera.json", "-g", warm / "model.grid", "--unit", "mm"]
    call[1] = tmp_path / "a.tif"
    assert "temperature (K) on " in windmark(*call, "-o", tmp_path / "a", "--nodes", "netcdf").out
    wrong = windmark(*call, "--quantity", "temperature", "--quantity-unit", "degC", "-o", tmp_path / "b")
    assert wrong.code == 1
    assert "the file says that its values are temperature in K; expected temperature degC" in wrong.err
    io.write_image(tmp_path / "a.tif", image, description="the values are temperature in K")  # whole numbers are levels
    assert "temperature" not in windmark(*call, "-o", tmp_path / "c", "--nodes", "netcdf").out


@pytest.mark.slow
def test_sections_views_and_alignment_in_kelvin(windmark, warm, tmp_path):
    """The project file's keys; the picture of the difference has the unit, too."""
    values = 'quantity = "temperature"\nunit = "degC"\nscale = 0.01\n'
    text = f"""
title = "warm"
length_unit = "mm"
[[camera]]
file = "{(warm / "camera.json").as_posix()}"
[[image]]
file = "{(warm / "wind-off.tif").as_posix()}"
{values}
[[image]]
file = "{(warm / "wind-on.tif").as_posix()}"
{values}
[markers]
file = "{(warm / "markers.csv").as_posix()}"
roles = ["model"]
[grid]
file = "{(warm / "model.grid").as_posix()}"
[detect]
radius_px = 4
[[view]]
name = "top"
direction = [0, 0, -1]
up = [0, 1, 0]
size_px = [300, 200]
[[section]]
name = "cut"
point = [150, 150, 0]
normal = [0, 1, 0]
[align]
reference = "wind-off"
[output]
folder = "out"
nodes = []
"""
    (tmp_path / "project.toml").write_text(text)
    done = windmark("run", tmp_path / "project.toml", "--method", "hash")
    assert done.code == 0, done.err
    place = tmp_path / "out" / "wind-on"
    assert "line,arc,x,y,z,temperature_degC" in (place / "section-cut.csv").read_text().split("\n")
    for name in ("view-top.tif", "aligned.tif"):
        assert io.told_quantity(place / name) == ("temperature", "degC")
        assert 0 < np.nanmedian(io.read_image(place / name)) < 60
    (tmp_path / "project.toml").write_text(text.replace(values, "", 1))
    done = windmark("run", tmp_path / "project.toml")
    assert done.code == 2
    assert "align: all images must have the same quantity and unit" in done.err


@pytest.mark.slow
@pytest.mark.parametrize("verb", ["register", "run"])
def test_the_papers_search(windmark, virtual_test, tmp_path, verb):
    folder, _ = virtual_test
    if verb == "register":
        call = ["register", *files(folder, "wind-off.tif", "-o", tmp_path / "out")]
    else:
        text = (folder / "project.toml").read_text().replace('file = "', f'file = "{folder.as_posix()}/')
        (tmp_path / "p.toml").write_text(text)
        call = ["run", tmp_path / "p.toml", "-o", tmp_path / "out"]
    table = windmark(*call, "--json").json["images"][0]["registration"]
    done = windmark(*call, "--method", "ransac", "--json")
    assert done.code == 0, done.err
    assert done.json["options"]["register"]["method"] == "ransac"
    found = done.json["images"][0]["registration"]
    assert sorted(found["labels"]) == sorted(table["labels"])
    np.testing.assert_allclose(found["camera_station"], table["camera_station"], rtol=1e-5)
    wrong = windmark(*call, "--method", "guess")
    assert wrong.code == 2
    assert "register.method" in wrong.err
