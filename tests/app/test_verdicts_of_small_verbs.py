"""Verdicts of `detect`, `align` in 2D and `markers check`: on sound pictures and on such as crews bring."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from windmark import io

pytestmark = pytest.mark.usefixtures("all_undrawn")


@pytest.fixture
def place(tmp_path, sheet_image):
    io.write_image(tmp_path / "off.tif", sheet_image[12:-12, 12:-12])
    return tmp_path


def blurred(image):
    return gaussian_filter(image.astype(float), 4.0)


def interlaced(image):
    rows = image.copy()
    rows[1::2] = np.roll(image, 1, axis=1)[1::2]
    return rows


def clipped(image):
    return np.minimum(image, 140)


def test_markers_of_a_sound_picture_are_good(place, windmark):
    done = windmark("detect", place / "off.tif", "-r", 4, "-o", place / "d.csv", "--json")
    verdict = done.json["verdict"]
    assert (verdict["word"], verdict["findings"]) == ("good", [])
    assert verdict["reason"].startswith("42 spots in 1 picture, typically known to 0.0")


@pytest.mark.parametrize(("spoil", "cause"), [(blurred, "blurred"), (interlaced, "interlaced"), (clipped, "saturated")])
def test_what_is_wrong_with_a_picture_is_said_with_its_markers(place, sheet_image, windmark, spoil, cause):
    io.write_image(place / "on.tif", spoil(sheet_image).round().astype(np.uint8))
    done = windmark("detect", place / "off.tif", place / "on.tif", "-r", 4, "-o", place / "d.csv", "--json")
    assert done.code == 0, done.err
    verdict = done.json["verdict"]
    assert (verdict["word"], verdict["cause"]) == ("doubtful", cause)
    assert {f["where"] for f in verdict["findings"]} == {"on.tif"}


def test_no_marker_is_bad_and_says_what_to_do(place, windmark):
    io.write_image(place / "blank.tif", np.full((200, 300), 90, np.uint8))
    done = windmark("detect", place / "blank.tif", "-r", 4, "-o", place / "d.csv")
    assert done.code == 1
    assert "next: see whether this is the right picture" in done.err
    both = windmark("detect", place / "blank.tif", place / "off.tif", "-r", 4, "-o", place / "d.csv", "--json")
    assert (both.json["verdict"]["word"], both.json["verdict"]["cause"]) == ("doubtful", "file")
    assert both.json["verdict"]["reason"].startswith("blank.tif: every pixel is at the level 90")


def test_aligned_images_are_good(place, sheet_image, windmark):
    io.write_image(place / "on.tif", sheet_image[5:-19, 10:-14])
    done = windmark("align", place / "off.tif", place / "on.tif", "-r", 4, "--max-shift-px", 20, "-o", place / "out")
    assert "● good: the image is aligned; markers are at most 0.0" in done.out
    assert 'data-verdict="good"' in (place / "out" / "report.html").read_text(encoding="utf-8")


def test_markers_that_the_transformation_does_not_follow_are_doubted(place, windmark):
    rng = np.random.default_rng(4)
    xy = np.stack(np.meshgrid(np.arange(30.0, 300, 45), np.arange(30.0, 250, 45)), axis=-1).reshape(-1, 2)
    names = np.array([f"M{k}" for k in range(len(xy))])
    moved = xy + rng.normal(0, 0.4, xy.shape)
    io.write_table(place / "matches.csv", {
        "image": np.repeat(["off.tif", "on.tif"], len(xy)), "name": np.tile(names, 2),
        "x": np.r_[xy[:, 0], moved[:, 0]], "y": np.r_[xy[:, 1], moved[:, 1]],
    })  # fmt: skip
    off = io.read_image(place / "off.tif")
    io.write_image(place / "on.tif", off ^ rng.integers(0, 2, off.shape, dtype=off.dtype))  # another exposure
    done = windmark("align", place / "off.tif", place / "on.tif", "--matches", place / "matches.csv",
                    "--kind", "affine", "-o", place / "out", "--json")  # fmt: skip
    assert done.code == 0, done.err
    verdict = done.json["verdict"]
    assert (verdict["word"], verdict["cause"]) == ("doubtful", "noise")
    assert verdict["reason"].startswith("markers are 0.")


def test_no_aligned_image_is_bad_with_a_step(place, windmark):
    io.write_image(place / "blank.tif", np.full((200, 300), 90, np.uint8))
    done = windmark("align", place / "off.tif", place / "blank.tif", "-r", 4, "-o", place / "out", "--json")
    assert done.code == 1
    assert done.json["verdict"]["word"] == "bad"
    assert done.json["verdict"]["next_step"] in done.err


@pytest.mark.slow
def test_a_layout_is_good_or_bad_as_it_can_be_identified(place, windmark):
    rng = np.random.default_rng(2)
    even = np.stack(np.meshgrid(np.arange(5) * 40.0, np.arange(4) * 40.0), axis=-1).reshape(-1, 2)
    uneven = rng.uniform(0, 200, (24, 2))
    words = {}
    for name, xy in (("even", even), ("uneven", uneven)):
        z = np.zeros(len(xy)) if name == "even" else rng.uniform(0, 60, len(xy))
        table = {"name": [f"M{k}" for k in range(len(xy))], "x": xy[:, 0], "y": xy[:, 1], "z": z,
                 "nx": np.zeros(len(xy)), "ny": np.zeros(len(xy)), "nz": np.ones(len(xy)),
                 "radius": np.full(len(xy), 2.0)}  # fmt: skip
        io.write_table(place / f"{name}.csv", table)
        done = windmark("markers", "check", place / f"{name}.csv", "--unit", "mm", "--quick", "--view-from", "0,90",
                        "--no-advice", "-o", place / name, "--json")  # fmt: skip
        words[name] = (done.json["verdict"]["word"], done.json["verdict"]["cause"])
        assert f'data-verdict="{words[name][0]}"' in (place / name / "check.html").read_text(encoding="utf-8")
    assert words == {"even": ("bad", "layout"), "uneven": ("good", "")}
