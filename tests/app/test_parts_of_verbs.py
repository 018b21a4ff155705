"""A picture that cannot be drawn, or read, costs only itself in every verb: it is named, the numbers are there."""

import pytest

from windmark import io, synth
from windmark.app import laws_verb
from windmark.deformation.laws import CATALOG
from windmark.geometry import Camera
from windmark.scene import MarkerSet

FORMULA = r"$\frac{$"
"""A name that matplotlib takes for a broken formula."""


@pytest.fixture(scope="module")
def sheets(tmp_path_factory, sheet_image):
    """Three pictures of one sheet of markers, the second of which is damaged."""
    place = tmp_path_factory.mktemp("sheets")
    io.write_image(place / "a.tif", sheet_image[12:-12, 12:-12])
    (place / "b.tif").write_bytes(b"II*\0nothing")
    io.write_image(place / "c.tif", sheet_image[12:-12, 19:-5])
    io.write_camera(place / "camera.json", Camera(sheet_image[12:-12, 12:-12].shape[::-1], 900.0, 1.0, 150.0, 130.0))
    return place


def all_of(sheets):
    return [sheets / f"{name}.tif" for name in "abc"]


def test_detect_goes_on_without_an_image_that_cannot_be_read(windmark, sheets, tmp_path):
    table = tmp_path / "d.csv"
    done = windmark("detect", *all_of(sheets), "-r", 4, "-o", table, "--json")
    assert done.code == 0, done.err
    assert list(done.json["images"]) == ["a.tif", "c.tif"]
    assert list(done.json["left_out"]) == ["b.tif"]
    assert set(io.read_detections(table)) == {"a.tif", "c.tif"}
    assert "left out: b.tif: " in windmark("detect", *all_of(sheets), "-r", 4, "-o", table).out
    near = windmark("detect", *all_of(sheets), "--near", table, "-o", tmp_path / "near.csv", "--json")
    assert near.code == 0, near.err
    assert (list(near.json["images"]), list(near.json["left_out"])) == (["a.tif", "c.tif"], ["b.tif"])


def test_nothing_that_can_be_read_is_a_bad_file(windmark, sheets, tmp_path):
    for verb, more in (("detect", ("-r", 4)), ("undistort", ("-c", sheets / "camera.json"))):
        done = windmark(verb, sheets / "b.tif", *more, "-o", tmp_path / "out")
        assert done.code == 2
        assert "b.tif: " in done.err
        assert list(tmp_path.iterdir()) == []


def test_detect_without_its_pictures(windmark, sheets, tmp_path, no_pictures):
    wanted = ("--picture", tmp_path / "p.png", "--merit-map", tmp_path / "m.png")
    done = windmark("detect", sheets / "a.tif", "-r", 4, "-o", tmp_path / "d.csv", *wanted, "--json")
    no_pictures(done, 2)
    assert [p.name for p in tmp_path.iterdir()] == ["d.csv"]
    said = windmark("detect", sheets / "a.tif", "-r", 4, "-o", tmp_path / "d.csv", *wanted).out
    assert "not drawn: a.tif: picture of the spots: ValueError: no such colour" in said
    assert "p.png" not in said
    near = ("--near", tmp_path / "d.csv", "--picture", tmp_path / "p.png")
    no_pictures(windmark("detect", sheets / "a.tif", "-o", tmp_path / "n.csv", *near, "--json"), 1)


def test_align_without_its_pictures(windmark, sheets, tmp_path, no_pictures):
    out = tmp_path / "out"
    done = windmark("align", *all_of(sheets), "-r", 4, "--max-shift-px", 20, "-o", out, "--json")
    no_pictures(done, 2, out / "report.html")
    assert [row["aligned"] for row in done.json["images"]] == [False, True]
    assert io.read_json(out / "summary.json")["not_drawn"] == done.json["not_drawn"]


def test_undistort_without_its_pictures_and_one_image(windmark, sheets, tmp_path, no_pictures):
    out = tmp_path / "out"
    done = windmark("undistort", *all_of(sheets), "-c", sheets / "camera.json", "--field", "--picture", "-o", out,
                    "--json")  # fmt: skip
    no_pictures(done, 5)
    assert (out / "report.html").read_text(encoding="utf-8").count("This part is missing: ") == 2
    assert (list(done.json["images"]), list(done.json["left_out"])) == (["a.tif", "c.tif"], ["b.tif"])
    assert sorted(p.name for p in out.iterdir()) == [
        "a.tif", "c.tif", "camera.json", "manifest.json", "report.html", "valid.png",
    ]  # fmt: skip


def test_pov_without_its_picture(windmark, virtual_test, tmp_path, no_pictures):
    done = windmark("pov", "--direction", "0,0,-1", "--up", "0,1,0", "-g", virtual_test[0] / "model.grid",
                    "--unit", "mm", "--size", "300x200", "-o", tmp_path / "top.json", "--picture", tmp_path / "p.png",
                    "--json")  # fmt: skip
    no_pictures(done, 1)
    assert [p.name for p in tmp_path.iterdir()] == ["top.json"]


def test_laws_without_a_picture(windmark, tmp_path, monkeypatch, no_pictures):
    monkeypatch.setattr(laws_verb, "CATALOG", {"beam": CATALOG["beam"]})
    done = windmark("laws", "--pictures", tmp_path / "laws", "--json")
    no_pictures(done, 1)
    assert done.json["pictures"] == []


def test_study_without_its_pictures(windmark, tmp_path, no_pictures):
    done = windmark("study", "--radius", 3, "--steps", 2, "--markers", 16, "--method", "bowl", "--output",
                    tmp_path / "out", "--json")  # fmt: skip
    no_pictures(done, 2, tmp_path / "out" / "study.html")
    assert (tmp_path / "out" / "study.csv").exists()


@pytest.fixture(scope="module")
def swinging(tmp_path_factory):
    """Three images of a swinging model, one of them damaged; a marker's name is a broken formula."""
    place = tmp_path_factory.mktemp("swinging")
    test = synth.wind_tunnel(4, size_px=(800, 640), nodes=8_000, sensor=None)
    io.write_camera(place / "camera.json", test.cameras["cam1"])
    markers = test.markers
    names = markers.name.astype(object)
    names[0] = FORMULA
    io.write_markers(place / "markers.csv", MarkerSet.make(
        names.tolist(), markers.xyz, normal=markers.normal, radius=markers.radius, role=markers.role,
        volume=markers.volume,
    ))  # fmt: skip
    for k, (image, _) in enumerate(synth.tunnel_sequence(test, synth.swinging(3), seed=4)):
        io.write_image(place / f"f{k}.tif", image)
    (place / "f1.tif").write_bytes(b"II*\0half")
    return place


def follow(windmark, place, out, *more):
    return windmark("track", *(place / f"f{k}.tif" for k in range(3)), "-m", place / "markers.csv", "-c",
                    place / "camera.json", "--unit", "mm", "-o", out, *more)  # fmt: skip


@pytest.mark.slow
def test_track_without_its_picture(windmark, swinging, tmp_path, no_pictures):
    out = tmp_path / "out"
    done = follow(windmark, swinging, out, "--json")
    no_pictures(done, 2, out / "report.html")
    assert list(done.json["lost_images"]) == ["f1.tif"]
    assert FORMULA in (out / "matches.csv").read_text()
    assert not (out / "motion.png").exists()
    assert io.read_json(out / "summary.json")["not_drawn"] == done.json["not_drawn"]
    assert "not drawn: picture of the motion: ValueError" in follow(windmark, swinging, out).out


def test_an_empty_series_is_named(windmark, swinging, tmp_path):
    (tmp_path / "none").mkdir()
    done = windmark("track", tmp_path / "none", "-m", swinging / "markers.csv", "-c", swinging / "camera.json",
                    "--unit", "mm", "-o", tmp_path / "out")  # fmt: skip
    assert (done.code, "a folder without pictures" in done.err) == (2, True)
    assert not (tmp_path / "out").exists()


def test_a_full_disk_is_no_image_that_cannot_be_read(windmark, sheets, tmp_path, monkeypatch):
    """The second picture that is written finds the disk full: the run ends with that, and leaves nothing."""
    from windmark.app import undistort_verb

    real, count = io.write_image, {"n": 0}

    def full(path, image):
        count["n"] += 1
        if count["n"] == 2:
            raise io.FileError(path, "cannot be written: the disk is full")
        real(path, image)

    monkeypatch.setattr(undistort_verb.io, "write_image", full)
    images = (sheets / "a.tif", sheets / "c.tif")
    done = windmark("undistort", *images, "-c", sheets / "camera.json", "-o", tmp_path / "out")
    assert (done.code, "the disk is full" in done.err) == (2, True)
    assert list(tmp_path.iterdir()) == []
