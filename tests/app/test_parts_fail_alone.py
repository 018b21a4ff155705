"""One bad picture, section or name costs only itself, and is named in the report, the summary and the answer."""

import shutil

import numpy as np
import pytest
from matplotlib.figure import Figure

from windmark.app import run_images
from windmark.app.pictures import png
from windmark.app.report import Report

FORMULA = r"$\frac{$"
"""A name that matplotlib takes for a broken formula."""


@pytest.mark.slow
def test_a_bad_picture_and_a_bad_section_cost_only_themselves(windmark, virtual_test, tmp_path, monkeypatch):
    for name in ("camera.json", "markers.csv", "model.grid", "wind-off.tif"):
        shutil.copy(virtual_test[0] / name, tmp_path / name)
    table = tmp_path / "markers.csv"
    table.write_text(table.read_text().replace("W02,", f"{FORMULA},", 1))
    cut = "[[section]]\nname = '{}'\npoint = [0, {}, 0]\nnormal = [0, 1, 0]\nspacing = 5\n"
    (tmp_path / "project.toml").write_text(
        'title = "t"\nlength_unit = "mm"\n[[camera]]\nfile = "camera.json"\n[[image]]\nfile = "wind-off.tif"\n'
        '[markers]\nfile = "markers.csv"\n[grid]\nfile = "model.grid"\n[detect]\nradius_px = 4\n'
        + cut.format("far", 1e6) + cut.format("$x_{$", 200)
    )  # fmt: skip

    def broken(*_, **__):
        raise ValueError("no such colour")

    monkeypatch.setattr(run_images, "grid_lines", broken)
    done = windmark("run", tmp_path / "project.toml", "--json")
    assert done.code == 0
    (image,) = done.json["images"]
    assert image["problem"] is None
    assert FORMULA in image["registration"]["labels"]
    assert image["nodes_with_value"] > 0
    far = "wind-off: section far: the plane does not meet the grid; check its point and normal"
    assert done.json["left_out"] == [far]
    verdict = done.json["verdict"]
    assert (verdict["word"], verdict["cause"]) == ("doubtful", "lost")
    assert "section far" in verdict["reason"]
    (drawn,) = done.json["not_drawn"]
    assert drawn.startswith(
        "wind-off: picture of the grid lines: ValueError: no such colour (test_parts_fail_alone.py:"
    )
    results = tmp_path / "results"
    assert (results / "wind-off" / "section-$x_{$.csv").is_file()
    page = (results / "report.html").read_text()
    assert f"left out: {far}" in page
    assert "This part is missing: wind-off: picture of the grid lines" in page
    assert page.count('"data:image/') >= 4


def test_names_are_no_formulas_and_axes_still_are(tmp_path):
    figure = Figure()
    left, right = figure.subplots(1, 2)
    left.set(title=FORMULA, xlabel=FORMULA)
    left.set_xticks([1, 2], [FORMULA, "b"])
    left.plot([1, 2], [1, 2], label=FORMULA)
    left.legend()
    left.annotate(FORMULA, (1, 1))
    right.set_yscale("log")
    right.set_ylim(1e-9, 1e9)
    assert png(figure)[1:4] == b"PNG"
    powers = [label for label in right.get_yticklabels() if "10^" in label.get_text()]
    assert powers
    assert all(label.get_parse_math() for label in powers)


@pytest.mark.parametrize("error", [ValueError, ZeroDivisionError, MemoryError])
def test_a_part_that_fails_leaves_nothing_half_behind(error):
    report = Report("t")
    report.text("before")
    with report.part("picture"):
        report.text("half")
        raise error("why")
    with report.part("other"):
        report.text("after")
    page = report.html()
    assert ">half<" not in page
    assert ">before<" in page
    assert ">after<" in page
    assert len(report.failed) == 1
    assert report.failed[0].startswith(f"picture: {error.__name__}: why (")


def test_ctrl_c_is_no_bad_picture():
    report = Report("t")
    with pytest.raises(KeyboardInterrupt), report.part("picture"):
        raise KeyboardInterrupt
    assert not report.failed
    assert np.size(report.parts) == 0
