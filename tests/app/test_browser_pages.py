"""Pages on a telephone and on paper: nothing moves them sideways, names can be read, long tables take few sheets."""

import re
import shutil
import subprocess

import browser
import numpy as np
import pytest

from windmark.app.photo import Overlay
from windmark.app.report import Report

pytestmark = browser.needed
PHONE = 420
IMAGE = "data:image/gif;base64,R0lGODlhAQABAIAAAAAAAP///yH5BAEAAAAALAAAAAABAAEAAAIBRAA7"


def photo(names, step):
    """A picture of 1280 pixels with names so far from each other."""
    over = Overlay((1280, 800))
    xy = np.array([[300.0 + step * k, 400.0] for k in range(names)])
    over.residuals(xy, np.full((names, 2), 0.01), [f"W{k:02d}" for k in range(names)], "residual")
    return over.html(IMAGE, "a picture")


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A report with what is wide and long: tables of many columns and rows, sentences in cells, pictures in a row."""
    report = Report("t")
    report.table([f"a long head {k}" for k in range(12)], [["wind-off", *[1234.5678] * 11]])
    report.table(["picture", "why not"], [["a-name-with-hyphens.tif", "no pose: " + "one word and another " * 6]])
    report.table(["spot", "x, px", "y, px"], [[k, f"{k}.123", f"{k}.456"] for k in range(400)], scroll=True)
    report.raw(photo(12, 60.0))
    report.raw(photo(2, 400.0))
    folder = tmp_path_factory.mktemp("page")
    (folder / "page.html").write_text(report.html(), encoding="utf-8")
    with browser.opened(folder / "profile", PHONE, 900) as tab:
        yield tab.open(folder / "page.html")


def test_a_wide_table_moves_in_its_own_place(page):
    assert page.js("document.documentElement.scrollWidth") <= PHONE
    assert page.js("document.querySelector('table').scrollWidth") > PHONE
    page.size(1400, 900)
    assert page.js("getComputedStyle(document.querySelector('table')).display") == "table"
    page.size(PHONE, 900)


def test_short_cells_stay_in_one_line_and_sentences_do_not(page):
    styles = dict(page.js("[...document.querySelectorAll('td')].map((c) => [c.textContent, getComputedStyle(c)])"
                          ".map(([text, style]) => [text.slice(0, 7), style.whiteSpace])"))  # fmt: skip
    assert (styles["a-name-"], styles["no pose"]) == ("nowrap", "normal")


def test_names_over_a_picture_can_be_read_and_do_not_lie_over_each_other(page):
    """At the picture's own scale they would have 4 pixels there."""
    page.until("[...document.querySelectorAll('.wm-zoom')].every((z) => z.style.getPropertyValue('--least'))", 10)
    page.settle()
    sizes = page.js("[...document.querySelectorAll('.wm-zoom')].map((z) => [...z.querySelectorAll('text')]"
                    ".map((t) => t.getBoundingClientRect()).filter((r) => r.width)"
                    ".map((r) => [r.left, r.right, r.height]))")  # fmt: skip
    assert len(sizes[1]) == 2
    assert 2 <= len(sizes[0]) < 12  # the others wait for the zoom
    for left, right in zip(sizes[0][:-1], sizes[0][1:], strict=True):
        assert left[1] <= right[0] + 1.0
    assert min(row[2] for picture in sizes for row in picture) >= 9.0
    page.size(1400, 900)
    page.until("[...document.querySelector('.wm-zoom').querySelectorAll('text')]"
               ".every((t) => t.getBoundingClientRect().width)", 10)  # fmt: skip
    page.size(PHONE, 900)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="no pdftotext here (apt-get install poppler-utils)")
def test_a_long_table_is_whole_on_few_sheets(page, tmp_path):
    printed = page.pdf(tmp_path / "page.pdf")
    text = subprocess.run(["pdftotext", "-layout", printed, "-"], capture_output=True, text=True, check=True).stdout
    found = {int(k) for k in re.findall(r"\b(\d+)\.456\b", text)}
    assert found == set(range(400))
    assert text.count("\f") <= 5  # 400 rows in one column of the usual print are nine sheets
    assert page.wrong() == []
