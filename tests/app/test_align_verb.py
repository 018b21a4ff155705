"""`windmark align` without a camera: one or hundreds of images, flagged not stopped, whole or not at all."""

import json

import numpy as np
import pytest

from windmark import io
from windmark.geometry.planar import planar_from_record


@pytest.fixture(scope="module")
def folder(tmp_path_factory, sheet_image):
    """Pictures of one sheet of markers, shifted by whole pixels; one blank; one that is no picture."""
    place = tmp_path_factory.mktemp("pictures")
    io.write_image(place / "off.tif", sheet_image[12:-12, 12:-12])
    io.write_image(place / "on1.tif", sheet_image[5:-19, 10:-14])
    io.write_image(place / "on2.tif", sheet_image[12:-12, 19:-5])
    io.write_image(place / "blank.tif", np.full_like(sheet_image, 90))
    (place / "broken.tif").write_bytes(b"II*\0nothing")
    return place


def test_images_are_aligned_and_bad_ones_flagged(folder, tmp_path, windmark):
    out = tmp_path / "aligned"
    images = [folder / f"{n}.tif" for n in ("off", "on1", "blank", "broken", "on2")]
    done = windmark("align", *images, "-r", 4, "--max-shift-px", 20, "-o", out, "--json")
    assert done.code == 0, done.err
    rows = {row["image"]: row for row in done.json["images"]}
    assert list(rows) == ["on1.tif", "blank.tif", "broken.tif", "on2.tif"]
    assert rows["on1.tif"]["aligned"]
    assert rows["on1.tif"]["held_out_rms_px"] < 0.02
    assert rows["on1.tif"]["median_shift_px"] == pytest.approx(np.hypot(2, 7), abs=0.01)
    assert "no marker in the image" in rows["blank.tif"]["problem"]
    assert "damaged" in rows["broken.tif"]["problem"]
    assert not (out / "blank").exists()
    reference, aligned = io.read_image(folder / "off.tif"), io.read_image(out / "on1" / "aligned.tif")
    assert aligned.dtype == np.float32
    assert aligned.shape == reference.shape
    there = np.isfinite(aligned)
    assert there.mean() > 0.9
    assert np.abs(aligned - reference)[there].mean() < 1.0
    record = json.loads((out / "on1" / "transformation.json").read_text())
    assert np.allclose(planar_from_record(record).apply([[100.0, 100.0]]), [[102.0, 107.0]], atol=0.05)
    table = io.read_table(out / "on1" / "residuals.csv", required=("x", "dx", "held_out_dx", "status"), known=None)
    assert len(table) == rows["on1.tif"]["pairs"]
    assert io.read_image(out / "on1" / "sigma.tif").shape == reference.shape
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "about the deformation itself nothing is learnt" in page
    assert page.count('src="data:image/') == 4
    assert "blank.tif: not aligned" in page


@pytest.mark.slow
def test_the_first_image_is_the_reference_unless_told(folder, tmp_path, windmark):
    images = [folder / "off.tif", folder / "on2.tif"]
    common = ["-r", 4, "--max-shift-px", 20, "--json"]
    first = windmark("align", *images, *common, "-o", tmp_path / "a")
    second = windmark("align", *images, *common, "--reference", "on2", "-o", tmp_path / "b")
    assert first.json["reference"] == "off.tif"
    assert second.json["reference"] == "on2.tif"
    assert [row["image"] for row in second.json["images"]] == ["off.tif"]


def test_a_regular_sheet_is_refused_without_a_largest_motion(folder, tmp_path, windmark):
    out = tmp_path / "aligned"
    y, x = np.mgrid[:240, :320]
    for name, shift in (("off", 0), ("on", 7)):
        disc = np.hypot((x - shift) % 40 - 20, y % 40 - 20)  # the same everywhere, to the last bit
        io.write_image(tmp_path / f"{name}.tif", (150 - 90 / (1 + np.exp(2 * (disc - 4)))).astype(np.uint8))
    done = windmark("align", tmp_path / "off.tif", tmp_path / "on.tif", "-r", 4, "-o", out)
    assert done.code == 1
    assert "looks like itself when it is shifted" in done.err
    assert not list(out.rglob("aligned.tif"))


@pytest.mark.slow
def test_markers_by_name_from_matches_and_from_detections(folder, tmp_path, windmark):
    rng = np.random.default_rng(1)
    xy = rng.uniform(20, 250, (12, 2))
    names = [f"M{k}" for k in range(12)]
    lines = ["image,name,x,y"]
    for image, shift in (("off.tif", (0, 0)), ("on1.tif", (2, 7))):
        lines += [f"{image},{n},{x + shift[0]:.3f},{y + shift[1]:.3f}" for n, (x, y) in zip(names, xy, strict=True)]
    (tmp_path / "matches.csv").write_text("\n".join(lines))
    rows = [line.replace("image,name,x,y", "image,name,x,y,radius") if k == 0 else line + ",4"
            for k, line in enumerate(lines)]  # fmt: skip
    (tmp_path / "detections.csv").write_text("\n".join([*rows, "on1.tif,,5,5,4"]))
    for table in ("matches.csv", "detections.csv"):
        done = windmark("align", folder / "off.tif", folder / "on1.tif", folder / "on2.tif", "--matches",
                        tmp_path / table, "-o", tmp_path / "out", "--json")  # fmt: skip
        assert done.code == 0, done.err
        row, other = done.json["images"]
        assert row["pairs"] == 12
        assert row["held_out_rms_px"] < 0.01
        assert "is not in the column image" in other["problem"]
    images = folder / "on2.tif", folder / "on1.tif"
    done = windmark("align", *images, "--matches", tmp_path / table, "-o", tmp_path / "n")
    assert done.code == 2
    assert "expected the reference there" in done.err
    assert not (tmp_path / "n").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--camera", "c.json"], "3D alignment needs --markers, --grid, --unit beside --camera"),
        (["-m", "m.csv", "-g", "w.grid", "--unit", "mm"], "3D alignment needs --camera beside"),
        (["--prior", "c.json"], "--prior belongs to 3D alignment"),
        (["-m", "m.csv", "-g", "w.grid", "--unit", "mm", "-c", "c.json", "--kind", "affine"], "--kind belongs to 2D"),
        (["--kind", "rigid"], "kind must be auto"),
        (["--max-shift-px", "-3"], "'--max-shift-px': expected > 0, not -3"),
        (["--reference", "other"], "is no image's name"),
    ],
)
def test_wrong_usage_is_one_sentence(folder, tmp_path, windmark, options, message):
    done = windmark("align", folder / "off.tif", folder / "on1.tif", *options, "-o", tmp_path / "out")
    assert done.code == 2
    assert message in done.err
    assert not (tmp_path / "out").exists()


def test_one_image_or_two_of_one_name_are_refused(folder, tmp_path, windmark):
    done = windmark("align", folder / "off.tif", "-o", tmp_path / "out")
    assert (done.code, "at least one more image" in done.err) == (2, True)
    twice = tmp_path / "on1.png"
    io.write_image(twice, io.read_image(folder / "on1.tif"))
    done = windmark("align", folder / "off.tif", folder / "on1.tif", twice, "-o", tmp_path / "out")
    assert (done.code, "two images are called on1" in done.err) == (2, True)


def test_a_reference_without_markers_is_said(folder, tmp_path, windmark):
    done = windmark("align", folder / "blank.tif", folder / "on1.tif", "-o", tmp_path / "out")
    assert done.code == 1
    assert "no marker in the reference blank.tif" in done.err
