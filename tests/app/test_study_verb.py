"""`windmark study` as a user runs it."""

import csv

import numpy as np
import pytest
from PIL import Image

from windmark.app import study_pictures
from windmark.pipeline.study import StudySettings, examples, run_study

SMALL = ("study", "--radius", 3, "--steps", 2, "--markers", 16, "--method", "bowl")


@pytest.mark.slow
def test_table_pictures_page_and_json_say_the_same(windmark, tmp_path):
    done = windmark(*SMALL, "--output", tmp_path / "out", "--json")
    assert done.code == 0
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "study.csv", "markers.png", "error.png", "study.html", "summary.json", "manifest.json",
    }  # fmt: skip
    with open(tmp_path / "out" / "study.csv") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["radius_px"]) for row in rows] == [2.5, 3.5]
    for name, values in done.json["rows"].items():
        assert [row[name] for row in rows] == [str(v) for v in values], name
    for row in rows:
        assert 0.01 < float(row["two_rms_px"]) < 0.1
        assert 0.01 < 2 * float(row["crlb_px"]) < 0.1
    page = (tmp_path / "out" / "study.html").read_text()
    assert page.count('src="data:image/') == 2
    assert "http" not in page
    assert rows[0]["method"] in page
    for name in ("markers.png", "error.png"):
        with Image.open(tmp_path / "out" / name) as picture:
            assert min(picture.size) > 600
            assert np.ptp(np.asarray(picture.convert("L"))) > 200


def test_a_person_gets_one_line_per_curve(windmark, tmp_path):
    done = windmark(*SMALL, "--radius", 2, "--output", tmp_path / "out")
    assert done.code == 0
    lines = done.out.splitlines()
    assert len(lines) == 5
    assert lines[0].startswith("r0 = 3 px, bowl: 2 RMS 0.0")
    assert lines[1].startswith("r0 = 2 px, bowl: 2 RMS 0.")
    assert lines[2].startswith("● good: centres are known to 0.0")
    assert lines[4].endswith("study.html")


def test_settings_reach_the_study(windmark, tmp_path):
    record = windmark(
        *SMALL, "--span-px", 0.2, "--max-tilt-deg", 10, "--blur-passes", 2, "--noise-percent", 1, "--depth", 90,
        "--seed", 5, "--output", tmp_path / "out", "--json",
    ).json  # fmt: skip
    assert record["settings"] == {
        "radii_px": [3.0], "span_px": 0.2, "steps": 2, "markers": 16, "max_tilt_deg": 10.0, "blur_passes": 2,
        "noise_percent": 1.0, "depth": 90.0, "methods": ["bowl"], "seed": 5,
    }  # fmt: skip
    assert record["rows"]["radius_px"] == [2.8, 3.2]


@pytest.mark.parametrize(
    ("option", "value", "word"),
    [("--method", "guess", "methods"), ("--radius", 0.2, "radii_px"), ("--max-tilt-deg", 95, "max-tilt-deg")],
)
def test_wrong_options_are_refused_and_nothing_is_written(windmark, tmp_path, option, value, word):
    done = windmark(*SMALL, option, value, "--output", tmp_path / "out")
    assert done.code == 2
    assert word in done.err
    assert list(tmp_path.iterdir()) == []


def test_nothing_found_is_a_refusal_with_the_table_still_written(windmark, tmp_path):
    done = windmark(*SMALL, "--noise-percent", 300, "--output", tmp_path / "out")
    assert done.code == 1
    assert "no marker was found" in done.err
    assert "none of 32 markers found" in done.out
    assert (tmp_path / "out" / "study.csv").exists()


def test_figure_4_has_a_curve_for_every_radius_and_method():
    settings = StudySettings(radii_px=(2.0, 3.0), steps=3, markers=9)
    study = run_study(settings)
    upper, lower = study_pictures.curves_picture(study).axes
    curves = [line.get_xydata() for line in upper.lines]
    for r0 in settings.radii_px:
        for method in settings.methods:
            rows = study.curve(r0, method)
            wanted = np.stack([study.radius_px[rows], study.two_rms_px[rows]], axis=1)
            assert any(np.array_equal(curve, wanted) for curve in curves)
    assert len(lower.lines) == 2 * len(settings.methods)
    radius, crlb = study_pictures.bound_curve(study)
    assert radius.tolist() == [1.5, 2.0, 2.5, 3.0, 3.5]  # 2.5 is in both ranges
    assert (np.diff(crlb) < 0).all()
    assert upper.get_ylim()[1] > max(0.1, study.two_rms_px.max())


def test_figure_3_marks_every_true_and_found_centre():
    settings = StudySettings(radii_px=(3.0,), steps=1, markers=9, methods=("bowl",))
    sharp, noisy = examples(settings)
    axes = study_pictures.sheets_picture(sharp, noisy, settings).axes
    true, found = axes[3].lines
    np.testing.assert_array_equal(true.get_xydata(), noisy.truth.xy)
    np.testing.assert_array_equal(found.get_xydata(), noisy.spots["bowl"].xy)


def test_help_has_an_example(windmark):
    done = windmark("study", "--help")
    assert done.code == 0
    assert "Example: windmark study" in done.out


@pytest.mark.slow
def test_markers_within_a_pixel_have_no_bound_and_the_page_says_the_verdict(windmark, tmp_path):
    """Without blur and noise such a study ended in a singular matrix."""
    done = windmark("study", "-r", 2, "-r", 1, "--noise-percent", 0, "--blur-passes", 0, "--steps", 3, "--markers", 100,
                    "-o", tmp_path / "out", "--json")  # fmt: skip
    assert done.code == 0, done.err
    assert done.json["not_drawn"] == []
    assert any(value is None for value in done.json["rows"]["crlb_px"])
    assert done.json["verdict"]["word"] in ("good", "doubtful")
    html = (tmp_path / "out" / "study.html").read_text(encoding="utf-8")
    assert f'data-verdict="{done.json["verdict"]["word"]}"' in html
    assert "there is no bound" in html
