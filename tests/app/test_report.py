"""The report's parts: nothing of the data is taken for HTML, nothing comes from elsewhere."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from windmark.app import pictures, run_report
from windmark.app.photo import Overlay
from windmark.app.report import Report, cell, fixed, measured, measured_rows
from windmark.app.svg import Chart, ticks
from windmark.errors import earned_decimals
from windmark.pipeline.private_paths import told, without_folders


def test_text_is_escaped_everywhere():
    report = Report("<b>title</b>", "a & b")
    report.heading("<i>")
    report.text("1 < 2")
    report.table(["<th>"], [["<td>"]])
    page = report.html()
    for raw in ("<b>title", "<i>", "<td><td>", "<th><th>"):
        assert raw not in page
    assert "1 &lt; 2" in page


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "–"), (float("nan"), "–"), (True, "yes"), (3, "3"), (0.123456, "0.1235"), (123456.7, "123457"), ("x", "x")],
)
def test_cells(value, text):
    assert cell(value) == text


def test_rows_of_numbers_have_the_digits_that_their_sigmas_earn():
    rows = measured_rows([[1.00042, 0.0309356, -2.0], [0.5, 1.0, float("nan")]],
                         [[2.1e-05, 0.0025, 0.0], [0.02, 300.0, 1.0]])  # fmt: skip
    assert rows == [("1.000420", "0.0309", "-2.0000", "0.000021", "0.0025", "–"),
                    ("0.500", "1", "–", "0.020", "300", "–")]  # fmt: skip
    assert measured(0.23733, 0.000997) == ("0.2373", "0.0010")


@pytest.mark.parametrize(
    ("column", "texts"),
    [
        ([0.0679, 0.06857, None], ["0.06790", "0.06857", "–"]),  # of one size: one number of decimals
        ([0.0679, 12.5], ["0.0679", "12.5"]),
        ([0.0679, 0.06857, 3], ["0.0679", "0.06857", "3"]),  # a column of several things
        ([float("nan"), 1.5, 2.25], ["–", "1.50", "2.25"]),
        ([0.0, 0.0], ["0", "0"]),
    ],
)
def test_numbers_of_a_column_end_at_one_decimal_where_they_are_of_one_size(column, texts):
    report = Report("t")
    report.table(["a"], [[v] for v in column])
    assert re.findall(r"<td>([^<]*)</td>", report.parts[0]) == texts


def test_sentences_in_cells_may_be_broken_and_names_may_not():
    report = Report("t")
    report.table(["file", "why"], [["wind-off.tif", "a sentence that is longer than what stands in one line"]])
    assert re.findall(r'<td class="([a-z ]*)"', report.parts[0]) == ["text", "text long"]


def test_a_list_is_escaped():
    report = Report("t")
    report.listed("such as", ["a < b", "/home/ann/c.csv"], "soft")
    assert report.parts == ['<div class="soft"><p>such as</p><ul><li>a &lt; b</li><li>c.csv</li></ul></div>']


def test_a_number_that_is_none_is_a_dash():
    assert (fixed(1.23456, 2), fixed(float("nan"), 2), fixed(-0.001, 1)) == ("1.23", "–", "0.0")


def test_names_in_a_chart_lie_over_no_dot_and_no_other_name():
    chart = Chart((-1.0, 1.0), (-1.0, 1.0), ("x", "y"), size=(430, 420))
    rng = np.random.default_rng(0)
    at = rng.normal(scale=0.2, size=(60, 2))
    chart.dots(at[:, 0], at[:, 1], ["note"] * 60, [f"W{k:02d}" for k in range(60)])
    said = "".join(chart.parts)
    dots = np.array(re.findall(r'cx="([\d.]+)" cy="([\d.]+)"', said), dtype=float)
    names = np.array(re.findall(r'<text x="([\d.]+)" y="([\d.]+)"', said), dtype=float)
    assert len(dots) == 60
    assert 10 < len(names) < 60
    boxes = np.column_stack([names[:, 0], names[:, 1] - 9, names[:, 0] + 20, names[:, 1] + 1])
    inside = (dots[:, None] > boxes[:, :2]).all(axis=2) & (dots[:, None] < boxes[:, 2:]).all(axis=2)
    assert not inside.any()
    low, high = np.maximum(boxes[:, None, :2], boxes[None, :, :2]), np.minimum(boxes[:, None, 2:], boxes[None, :, 2:])
    assert (low < high).all(axis=2).sum() == len(names)  # each with itself


def test_heads_stand_over_their_cells():
    report = Report("t")
    rows = [["a", 1.5, "lost", None, "1.2 ± 0.1"], ["b", None, "no spots", "late", "12 %"], ["c", 2.0, 3, "–", "4/5"]]
    report.table(["picture", "rms", "why", "note", "figure"], rows)
    (html,) = report.parts
    lines = [re.findall(r'<t[hd]( class="text")?>', line) for line in html.split("<tr>")[1:]]
    assert len(lines) == 4
    assert all([bool(of) for of in line] == [True, False, True, True, False] for line in lines)
    columns = re.sub("<[^>]*>", " ", html).split()
    assert columns[:5] == ["picture", "rms", "why", "note", "figure"]


def test_pictures_are_png_whatever_the_image():
    for image in (np.zeros((5, 7), np.uint8), np.full((5, 7), np.nan), np.arange(35.0).reshape(5, 7)):
        figure, _ = pictures.image_axes(image)
        assert pictures.png(figure, dpi=30).startswith(b"\x89PNG")


@pytest.mark.parametrize(("value", "round_"), [(1.0, 1), (1.99, 1), (2.0, 2), (7.0, 5), (0.034, 0.02), (1234.0, 1000)])
def test_scale_bars_have_round_lengths(value, round_):
    assert pictures.round_length(value) == pytest.approx(round_)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("in mm, as /home/ann/tests/a.csv says.", "in mm, as a.csv says."),
        (r"C:\Users\Ann\a.csv: was read", "a.csv: was read"),
        ("“/a/b/c.tif” and /a/b/d.tif, 3 m/s, W/m2/sr, 1/2", "“c.tif” and d.tif, 3 m/s, W/m2/sr, 1/2"),
        ("views/NAME.json, POINT/fields.nc", "views/NAME.json, POINT/fields.nc"),
        ("/secret place/test/pictures/a.tif", "pictures/a.tif"),
    ],
)
def test_private_folders_are_not_told(text, said):
    assert told(text, Path("/secret place/test")) == said


@pytest.mark.parametrize(("count", "packed"), [(1, False), (9, False), (15, True)])
def test_the_worst_picture_has_the_most_room(monkeypatch, count, packed):
    rooms = {}
    monkeypatch.setattr(run_report, "image_part", lambda _, item, __, room, ___: rooms.update({item.name: room}))
    answers = [SimpleNamespace(rms_px=float(k), matching=[0]) for k in range(count)]
    items = [SimpleNamespace(name=f"p{k}", problem=None, image=None, registered=a) for k, a in enumerate(answers)]
    report = Report("t", "")
    order = run_report.worst_first(items)
    run_report._images(report, order, SimpleNamespace(images=items), packed)
    assert sorted(rooms) == sorted(i.name for i in items)
    assert {name for name, room in rooms.items() if room.photo > 100_000} == {items[-1].name}
    assert ("are packed tighter" in report.html()) == (count > 1)


@pytest.mark.parametrize("about", [1, 3, 6])
def test_axes_have_two_ticks_at_least(about):
    for low, high in ((-0.0185, 0.0185), (0.11, 0.19), (-3e5, 7e5), (1.01, 1.02)):
        marks = ticks(low, high, about)
        assert len(marks) >= 2
        assert low <= marks[0] < marks[-1] <= high


def test_numbers_have_the_digits_that_their_sigma_earns():
    assert earned_decimals([0.0027, 0.0021, 0.0005]) == 5
    assert earned_decimals([0.053, 0.12]) == 3
    assert earned_decimals([340.0]) == 0
    assert earned_decimals([float("nan"), 0.0]) == 4


def test_a_measured_number_has_the_digits_that_its_sigma_earns():
    assert measured(245876.8803, 10102.9, sign="+") == ("+245877", "10103")
    assert measured(0.26403, 0.0035) == ("0.2640", "0.0035")
    assert measured(float("nan"), 0.1) == ("–", "–")


def test_records_of_results_have_no_private_folder():
    test = Path("/secret place/test")
    record = {"file": test / "pictures/a.tif", "mask": Path("/elsewhere/mask.png"), "sides": (3, Path("b.csv")),
              "notes": [f"{test}/m.csv: in mm, as /home/ann/c.json says"], "count": 4, "none": None}  # fmt: skip
    assert without_folders(record, test) == {
        "file": "pictures/a.tif", "mask": "mask.png", "sides": [3, "b.csv"],
        "notes": ["m.csv: in mm, as c.json says"], "count": 4, "none": None,
    }  # fmt: skip


def test_no_number_is_minus_zero():
    assert cell(-0.0) == "0"
    assert measured(-0.0004, 0.01)[0] == "0.000"
    assert measured(-0.0004, 0.01, "+")[0] == "+0.000"


def test_names_that_would_lie_over_each_other_wait_for_the_zoom():
    over = Overlay((950, 600))
    over.names_at(np.array([[100.0, 100.0], [103.0, 101.0], [300.0, 100.0]]), ["left <1>", "over it", "away"])
    html = over.html("data:,", "names")
    assert html.count("crowded") == 1
    assert '">over it<' in html.partition("crowded")[2]
    assert "left &lt;1&gt;" in html


def test_a_name_at_the_upper_border_stands_below_its_spot():
    over = Overlay((950, 600))
    over.names_at(np.array([[100.0, 3.0], [300.0, 100.0]]), ["high", "middle"])
    high, middle = (float(y) for y in re.findall(r'<text[^>]* y="([-\d.]+)"', over.html("data:,", "names")))
    assert high > 3.0 + 10.0
    assert middle < 100.0


def test_options_are_said_in_words():
    report = Report("test")
    report.closing([], {"max_angle_deg": 3.0, "free": ("k1",)}, {})
    html = report.html()
    assert "<td>max angle, °</td>" in html.replace(' class="text"', "")
    assert "max_angle_deg" not in html
