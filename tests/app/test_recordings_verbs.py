"""Verbs on recordings: a frame by its address, a whole sequence with its time stamps."""

import csv

import h5py
import numpy as np
import pytest
from camera_files import write_cine, write_mraw

from windmark import io, synth
from windmark.app.calibrate_options import expanded
from windmark.pipeline.calibrate.read import picture_names

pytestmark = pytest.mark.usefixtures("all_undrawn")

FRAMES = 5
TIMES = np.array([0, 1, 2, 4, 5]) * 1e-3
"""One frame was dropped."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("recording")
    test = synth.wind_tunnel(4, size_px=(800, 640), nodes=8_000, sensor=None)
    io.write_camera(place / "camera.json", test.cameras["cam1"])
    io.write_markers(place / "markers.csv", test.markers)
    images = [image for image, _ in synth.tunnel_sequence(test, synth.swinging(FRAMES), seed=4)]
    levels = [np.clip(image * (1 if image.max() > 2 else 4000), 0, 4095).astype(np.uint16) for image in images]
    write_cine(place / "run.cine", levels, 16, packing=1024, times=1e9 + TIMES, trigger_s=1e9)
    write_mraw(place / "run.mraw", levels, 12)
    io.write_images(place / "run.tif", levels)
    for k, image in enumerate(levels):
        io.write_image(place / f"f{k}.tif", image)
    with h5py.File(place / "run.h5", "w") as file:
        file["cam1/images"], file["cam2/images"] = np.stack(levels), np.stack(levels)[::-1]
    return place


@pytest.fixture
def tables(folder):
    return "-m", folder / "markers.csv", "-c", folder / "camera.json", "--unit", "mm", "-r", 2.5


@pytest.mark.slow
def test_track_a_recording(windmark, folder, tables, tmp_path):
    """The same poses as from single files; and the dropped frame, known from the time stamps, is a step of two."""
    rows = {}
    for name, given in (("cine", [folder / "run.cine"]), ("files", [folder / f"f{k}.tif" for k in range(FRAMES)])):
        done = windmark("track", *given, *tables, "-o", tmp_path / name)
        assert done.code == 0
        rows[name] = list(csv.DictReader((tmp_path / name / "poses.csv").read_text().splitlines()))
    assert [row["image"] for row in rows["cine"]] == [f"run-{k:06d}" for k in range(FRAMES)]
    np.testing.assert_allclose([float(row["time_s"]) for row in rows["cine"]], TIMES, atol=1e-6)
    np.testing.assert_allclose([float(row["instant"]) for row in rows["cine"]], [0, 1, 2, 4, 5], atol=1e-2)
    assert "time_s" not in rows["files"][0]
    for key in ("rx_deg", "dx", "dz"):
        mine, theirs = ([float(row[key]) for row in rows[name]] for name in ("cine", "files"))
        np.testing.assert_allclose(mine, theirs, rtol=1e-3, atol=0.05)


@pytest.mark.parametrize("name", ["run.cine[2]", "run.mraw[2]", "run.cih[2]", "run.tif[2]", "run.h5:/cam1/images[2]"])
def test_detect_a_frame(windmark, folder, tmp_path, name):
    done = windmark("detect", f"{folder}/{name}", "-r", 2.5, "-o", tmp_path / "frame.csv")
    assert done.code == 0, done.err
    assert windmark("detect", folder / "f2.tif", "-r", 2.5, "-o", tmp_path / "file.csv").code == 0
    (key, found), (_, expected) = (
        *io.read_detections(tmp_path / "frame.csv").items(), *io.read_detections(tmp_path / "file.csv").items()
    )  # fmt: skip
    assert key == ("run-cam1-images-000002" if "h5" in name else "run-000002")
    np.testing.assert_array_equal(found.xy, expected.xy)


def test_detect_all_frames_and_names_that_come_twice(windmark, folder, tmp_path):
    done = windmark("detect", f"{folder}/run.h5:/cam1/images", folder / "f0.tif", "-r", 2.5, "-o", tmp_path / "d.csv")
    assert done.code == 0
    assert list(io.read_detections(tmp_path / "d.csv")) == [
        *(f"run-cam1-images-{k:06d}" for k in range(FRAMES)), "f0.tif"
    ]  # fmt: skip
    done = windmark("detect", folder / "run.cine[1]", folder / "run.tif[1]", "-r", 2.5, "-o", tmp_path / "e.csv")
    assert done.code == 2
    assert "two are called run-000001" in done.err


def test_a_stack_of_pages_is_taken_page_by_page(windmark, folder, tables, tmp_path):
    names = [f"run-{k:06d}" for k in range(FRAMES)]
    done = windmark("detect", folder / "run.tif", "-r", 2.5, "-o", tmp_path / "d.csv")
    assert done.code == 0
    assert list(io.read_detections(tmp_path / "d.csv")) == names
    done = windmark("track", folder / "run.tif", *tables, "-o", tmp_path / "track", "--json")
    assert done.code == 0
    assert done.json["images"] == FRAMES


def test_verbs_on_one_picture_do_not_choose_a_frame(windmark, folder, tables, tmp_path):
    done = windmark("register", folder / "run.tif", *tables, "-o", tmp_path / "r")
    assert done.code == 1
    assert "run.tif: has 5 pages: say" in done.err
    assert "run.tif[0] for the first one" in done.err
    done = windmark("register", folder / "run.cine[9]", *tables, "-o", tmp_path / "r")
    assert "no page 9; expected 0 to 4" in done.err
    done = windmark("register", folder / "none.cine[9]", *tables, "-o", tmp_path / "r")
    assert done.code == 2
    assert "there is no file" in done.err


def test_a_project_names_frames(windmark, folder, tmp_path):
    text = f"""
title = "Two frames"
length_unit = "mm"
[[camera]]
file = "{(folder / "camera.json").as_posix()}"
[[image]]
file = "{(folder / "run.cine").as_posix()}[0]"
[[image]]
file = "{(folder / "run.h5").as_posix()}:/cam1/images[3]"
name = "later"
[[image]]
file = "{(folder / "run.tif").as_posix()}"
page = 4
[markers]
file = "{(folder / "markers.csv").as_posix()}"
[detect]
radius_px = 2.5
[output]
folder = "out"
"""
    (tmp_path / "project.toml").write_text(text)
    done = windmark("run", tmp_path / "project.toml", "--json")
    assert done.code == 0, done.err
    assert [image["name"] for image in done.json["images"]] == ["run-000000", "later", "run"]
    assert (tmp_path / "out" / "run-000000").is_dir()


def test_undistort_a_recording(windmark, folder, tmp_path):
    done = windmark("undistort", folder / "run.cine", folder / "run.mraw[1]", "-c", folder / "camera.json", "--json",
                    "-o", tmp_path / "out")  # fmt: skip
    assert done.code == 0, done.err
    assert io.page_count(tmp_path / "out" / "run.tif") == FRAMES
    one = io.read_image(tmp_path / "out" / "run-000001.tif")
    np.testing.assert_array_equal(one, io.read_image(tmp_path / "out" / "run.tif[1]"))


def test_pictures_of_a_calibration_may_be_recordings(folder):
    inputs = expanded([folder / "run.cine", folder / "f0.tif", folder / "run.tif[2]"])
    assert picture_names(inputs[:-1]) == [*(f"run-{k:06d}" for k in range(FRAMES)), "f0"]
    assert expanded([folder / "markers.csv"]) == (folder / "markers.csv",)
    with pytest.raises(ValueError, match="two pictures have the name"):
        picture_names(inputs)


def test_convert_recordings(windmark, folder, tmp_path):
    done = windmark("convert", folder / "run.cine", tmp_path / "run.h5", "--frames", "1:4", "--json")
    assert done.code == 0, done.err
    assert done.json["frames"] == 3
    assert done.json["read_back"] == {"frames": 3, "same": 3}
    np.testing.assert_allclose(io.frames(tmp_path / "run.h5").time_s, TIMES[1:4], atol=1e-6)
    for sources in ([folder / "f0.tif", folder / "f1.tif"], [f"{folder}/run.h5:/cam2/images"], [folder / "f*.tif"]):
        done = windmark("convert", *sources, tmp_path / "all.tif")
        assert done.code == 0, done.err
        assert "every pixel is the same" in done.out
    done = windmark("convert", folder / "run.h5", tmp_path / "none.tif")
    assert done.code == 2
    assert "2 arrays that may be pictures" in done.err
    assert windmark("convert", folder / "camera.json", tmp_path / "c.yml", "--frames", "1").code == 2
