"""`windmark track`: tables, picture, page; bad images; refusals."""

import csv
import json
import os
from pathlib import Path

import numpy as np
import pytest

from windmark import io, synth

FRAMES = 6


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("sequence")
    test = synth.wind_tunnel(4, size_px=(800, 640), nodes=8_000, sensor=None)
    io.write_camera(place / "camera.json", test.cameras["cam1"])
    io.write_markers(place / "markers.csv", test.markers)
    io.write_mesh(place / "model.grid", test.mesh)
    for k, (image, _) in enumerate(synth.tunnel_sequence(test, synth.swinging(FRAMES), seed=4)):
        io.write_image(place / f"f{k}.tif", np.zeros_like(image) if k == 3 else image)
    return place


def asked(folder, *more):
    images = [folder / f"f{k}.tif" for k in range(FRAMES)]
    return (
        "track",
        *images,
        "-m",
        folder / "markers.csv",
        "-c",
        folder / "camera.json",
        "--unit",
        "mm",
        "-r",
        2.5,
        *more,
    )


def test_a_sequence_becomes_tables_a_picture_and_a_page(windmark, folder, tmp_path, monkeypatch):
    from windmark.app import track_verb

    out, bent, take = tmp_path / "out", [], track_verb.follow_series

    def follow_series(place, images, markers, *rest, **more):
        bent.append(markers.curvature.any(axis=(1, 2)))
        return take(place, images, markers, *rest, **more)

    monkeypatch.setattr(track_verb, "follow_series", follow_series)
    done = windmark(*asked(folder, "-g", folder / "model.grid", "-o", out, "--json"))
    assert done.code == 0
    assert bent[0].mean() > 0.8  # of wing and body, by the grid
    assert done.json["lost"] == 1
    manifest = io.read_json(out / "manifest.json")
    assert (manifest["verb"], manifest["refused"]) == ("track", False)
    assert (manifest["options"]["radius"], manifest["options"]["unit"]) == ([2.5], "mm")
    inputs = [Path(os.path.normpath(out / entry["file"])) for entry in manifest["inputs"]]
    assert inputs == sorted(p for p in folder.iterdir() if p.suffix in (".csv", ".grid", ".json", ".tif"))
    assert set(manifest["outputs"]) == {p.name for p in out.iterdir()} - {"manifest.json"}
    assert list(done.json["lost_images"]) == ["f3.tif"]
    assert {p.name for p in out.iterdir()} == {
        "poses.csv", "matches.csv", "motion.png", "report.html", "summary.json", "camera.json", "manifest.json",
    }  # fmt: skip
    rows = list(csv.DictReader((out / "poses.csv").read_text().splitlines()))
    assert rows[0]["status"] == "cold"
    assert [row["image"] for row in rows] == [f"f{k}.tif" for k in range(FRAMES)]
    assert rows[3]["dx"] == ""
    assert float(rows[0]["sigma_rx_deg"]) < 0.1
    matches = io.read_matches(out / "matches.csv")
    assert len(matches) == sum(int(row["matched"]) for row in rows)
    assert json.loads((out / "summary.json").read_text())["images"] == FRAMES
    assert io.read_camera(out / "camera.json")[1] is not None
    page = (out / "report.html").read_text()
    assert "f3.tif" in page
    assert "9 input files with SHA-256" in page  # six pictures, markers, camera
    assert "--radius" in page
    assert page.count('class="wm-photo"') in (1, 2)  # the first pose, the largest residuals
    for told in (page, (out / "summary.json").read_text(encoding="utf-8")):
        assert str(folder.parent) not in told
    assert page.count('class="wm-scene"') == 1
    # One camera sees no scale; the first image says so, and nothing after it can.
    assert "scale" in [u["what"] for u in done.json["unchecked"]]
    assert "The images cannot tell:</p><ul><li>" in page


@pytest.mark.slow
def test_numbers_of_frames_come_from_a_table(windmark, folder, tmp_path):
    io.write_table(tmp_path / "n.csv", {"image": [f"f{k}" for k in range(FRAMES)], "frame": [0, 1, 2, 3, 4, 7]})
    done = windmark(*asked(folder, "-o", tmp_path / "out", "--frames", tmp_path / "n.csv"))
    assert done.code == 0
    rows = list(csv.DictReader((tmp_path / "out" / "poses.csv").read_text().splitlines()))
    assert float(rows[-1]["instant"]) == 7
    io.write_table(tmp_path / "short.csv", {"image": ["f0"], "frame": [0]})
    done = windmark(*asked(folder, "-o", tmp_path / "other", "--frames", tmp_path / "short.csv"))
    assert done.code == 2
    assert "f1.tif" in done.err
    assert not (tmp_path / "other").exists()


def test_no_pose_at_all_is_said(windmark, folder, tmp_path):
    done = windmark(
        "track", folder / "f3.tif", "-m", folder / "markers.csv", "-c", folder / "camera.json", "--unit", "mm",
        "-r", 2.5, "-o", tmp_path / "out",
    )  # fmt: skip
    assert done.code == 1
    assert "no image gave a pose" in done.err


@pytest.mark.parametrize(("more", "word"), [(("--unit", "furlong"), "--unit"), (("--change-deg", 0), "--change-deg")])
def test_wrong_usage_is_named(windmark, folder, tmp_path, more, word):
    done = windmark(*asked(folder, "-o", tmp_path / "out", *more))
    assert done.code == 2
    assert word in done.err


@pytest.mark.slow
def test_what_a_film_loses_is_said_of_its_poses(windmark, folder, tmp_path):
    """Only `convert` said that grey levels are not the sensor's, and that pictures are missing."""
    av = pytest.importorskip("av")
    with av.open(str(tmp_path / "a.avi"), "w") as out:
        stream = out.add_stream("mjpeg", rate=50)
        stream.width, stream.height, stream.pix_fmt = 800, 640, "yuvj420p"
        for k in (0, 1):
            image = io.read_image(folder / f"f{k}.tif")
            frame = av.VideoFrame.from_ndarray((image / image.max() * 250).astype(np.uint8), format="gray")
            out.mux(stream.encode(frame.reformat(format="yuvj420p")))
        out.mux(stream.encode())
    place = tmp_path / "out"
    files = ("-m", folder / "markers.csv", "-c", folder / "camera.json")
    done = windmark("track", tmp_path / "a.avi", *files, "--unit", "mm", "-r", 2.5, "-o", place, "--json")
    assert done.code == 0, done.err
    (note,) = done.json["notes"]
    assert "mjpeg loses grey levels" in note
    assert "mjpeg loses grey levels" in done.err
    assert "mjpeg loses grey levels" in (place / "report.html").read_text(encoding="utf-8")
    for verb in (("detect", "-o", tmp_path / "spots.csv"), ("align", "-o", tmp_path / "aligned")):
        done = windmark(verb[0], tmp_path / "a.avi", "-r", 2.5, *verb[1:])
        assert done.code == 0, done.err
        assert done.err.count("mjpeg loses grey levels") == 1
