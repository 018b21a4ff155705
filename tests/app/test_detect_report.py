"""The page of `windmark detect`: pictures of every kind, names that are no HTML, both ways to look for markers."""

import browser
import numpy as np
import pytest

from windmark import io
from windmark.app.detect_report import LISTED, DetectPage, NotTaken, Shown
from windmark.pipeline.verdict import Verdict
from windmark.scene import Detections
from windmark.synth import marker_sheet

WELL = Verdict.of([], 1, "spots", "go on", what="pictures")
NASTY = 'wing <b>&"x".tif'


@pytest.fixture(scope="module")
def sheet(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sheet")
    image, _ = marker_sheet(np.random.default_rng(1), radius_px=3.5, grid=(4, 3), pitch_px=40, max_tilt_deg=0.0,
                            blur_passes=1, noise=0.01)  # fmt: skip
    io.write_image(folder / "sheet.tif", image.astype(np.float32))
    return folder / "sheet.tif"


def spots(count, sigma_px=0.01):
    places = np.column_stack([10 + 7 * np.arange(count) % 180, 5 + np.arange(count) // 2])
    return Detections.make(places.reshape(-1, 2), sigma_px=sigma_px, radius_px=3.0)


def page_of(tmp_path, *shown):
    page = DetectPage()
    for one in shown:
        page.add(one)
    return page.report(WELL, tmp_path / "page.html")


@pytest.mark.parametrize("count", [0, 1, 200])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float64])
def test_pictures_of_every_kind(tmp_path, count, dtype):
    image = np.arange(200 * 120).reshape(120, 200).astype(dtype)
    if dtype is np.float64:
        image[:40] = np.nan
    page = page_of(tmp_path, Shown(NASTY, image, spots(count), "dark"))
    html = page.html()
    assert page.failed == []
    assert html.count("<circle class=") == count
    assert "<b>&" not in html
    assert str(tmp_path) not in html


def test_spots_without_radius_and_sigma_have_dashes(tmp_path):
    bare = spots(2)
    bare = Detections.make(bare.xy)
    page = page_of(tmp_path, Shown("a", np.zeros((50, 60)), bare, "dark"))
    assert page.failed == []
    assert "nan" not in page.html().split("<script")[0].lower()


def test_a_picture_of_nothing_but_nan(tmp_path):
    page = page_of(tmp_path, Shown("a", np.full((50, 60), np.nan), spots(0), "dark"))
    assert page.failed == []


def test_of_many_rejected_the_best_are_listed(tmp_path):
    n = LISTED + 5
    xy = np.column_stack([np.arange(n) % 60, np.arange(n) % 50]).astype(float)
    names = [f"a very long name of a marker on the left wing <{k}>" for k in range(n)]
    lost = NotTaken("expected marker", names, xy, np.full(n, np.nan), ["faint: x", "hidden"] * (n // 2) + ["hidden"],
                    np.full(n, np.nan))  # fmt: skip
    page = page_of(tmp_path, Shown("a", np.zeros((50, 60)), spots(1), "dark", lost, ["tip & root"]))
    html = page.html()
    assert page.failed == []
    assert f"The best {LISTED} of {n}" in html
    assert "tip &amp; root" in html
    assert html.count("data-layer=") == 3  # spots and two reasons


def test_the_verb_writes_it_with_the_rejected_and_the_inputs(windmark, sheet, tmp_path):
    done = windmark("detect", sheet, "-r", 3, "-o", tmp_path / "spots.csv", "--report", tmp_path / "spots.html")
    assert done.code == 0
    assert "spots.html" in done.out
    html = (tmp_path / "spots.html").read_text(encoding="utf-8")
    assert 'data-verdict="good"' in html
    assert "SHA-256" in html
    assert str(sheet.parent) not in html
    near = windmark("detect", sheet, "--near", tmp_path / "spots.csv", "-o", tmp_path / "near.csv", "--report",
                    tmp_path / "near.html", "--json")  # fmt: skip
    assert near.code == 0
    assert near.json["verdict"]["word"] == "good"
    assert "data-verdict" in (tmp_path / "near.html").read_text(encoding="utf-8")


def test_without_a_marker_there_is_the_page_and_no_table(windmark, tmp_path):
    io.write_image(tmp_path / "grey.tif", np.full((80, 90), 100, np.uint16))
    done = windmark("detect", tmp_path / "grey.tif", "-r", 3, "-o", tmp_path / "spots.csv", "--report",
                    tmp_path / "page.html")  # fmt: skip
    assert done.code == 1
    assert not (tmp_path / "spots.csv").exists()
    assert 'data-verdict="bad"' in (tmp_path / "page.html").read_text(encoding="utf-8")


@pytest.mark.slow
@browser.needed
def test_layers_are_switched_and_packed_pictures_open(tmp_path):
    lost = NotTaken("rejected candidate", ["0"], np.array([[5.0, 5.0]]), np.array([3.0]), ["faint: x"], np.array([1.0]))
    shown = [Shown(name, np.eye(60), spots(3), "dark", lost) for name in ("one", NASTY)]
    page = page_of(tmp_path, *shown)
    (tmp_path / "page.html").write_text(page.html(), encoding="utf-8")
    with browser.opened(tmp_path / "profile") as tab:
        tab.open(tmp_path / "page.html")
        seen = "getComputedStyle(document.querySelector('g[data-of=reason-0]')).display"
        assert tab.js(seen) != "none"
        tab.click("input[data-layer=reason-0]")
        assert tab.js(seen) == "none"
        tab.js("document.querySelector('#picture-2').open = true")
        tab.until("document.querySelectorAll('.wm-zoom').length === 2")
        assert tab.wrong() == []
