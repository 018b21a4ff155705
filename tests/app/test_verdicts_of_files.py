"""Verdicts of `undistort`, `pov`, `study`, `laws`, `convert` and `paint-calibrate`: sound input, and faults."""

import numpy as np
import pytest

from windmark import io
from windmark.geometry import Camera, Pose
from windmark.pipeline.deform.laws import LawsCompared
from windmark.pipeline.verdict.laws import compared_verdict
from windmark.pipeline.verdict.study import study_verdict
from windmark.scene import MarkerSet, Mesh
from windmark.synth.pressure_paint import TYPICAL

LENS = Camera((160, 120), 150.0, k1=-0.15)
AHEAD = Pose.look_at([0.0, 0, 900], [0, 0, 0], [0, 1, 0])


def box(half, at=(0.0, 0, 0)):
    """A closed box, its triangles in the order of a file that nobody has turned."""
    corner = half * np.array([[x, y, z] for z in (-1.0, 1) for y in (-1, 1) for x in (-1, 1)]) + at
    quads = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return Mesh(corner, np.array(triangles), np.array(["body"] * len(triangles)))


def said(done):
    return done.json["verdict"]["word"], done.json["verdict"]["cause"]


# --- undistort ------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("camera", "expected", "words"),
    [
        (LENS, ("good", ""), "the picture has no distortion any more, which was "),
        (Camera((160, 120), 150.0), ("doubtful", "camera"), "this camera has no distortion"),
        (Camera((160, 120), 60.0, k1=-0.3), ("doubtful", "camera"), "% of the picture lie where"),
        (Camera((160, 120), 60.0, lens="fisheye", k1=-0.3), ("good", ""), "no distortion any more"),
    ],
)  # fmt: skip
def test_a_lens_that_is_none_or_not_for_all_of_the_picture(windmark, tmp_path, camera, expected, words):
    io.write_camera(tmp_path / "c.json", camera)
    io.write_image(tmp_path / "a.tif", np.full((120, 160), 90, np.uint8))
    done = windmark("undistort", tmp_path / "a.tif", "-c", tmp_path / "c.json", "-o", tmp_path / "o", "--json")
    assert said(done) == expected
    assert words in done.json["verdict"]["reason"]


def test_a_picture_of_another_size_is_told_as_that(windmark, tmp_path):
    io.write_camera(tmp_path / "c.json", LENS)
    io.write_image(tmp_path / "a.tif", np.full((120, 160), 90, np.uint8))
    io.write_image(tmp_path / "turned.tif", np.full((160, 120), 90, np.uint8))
    done = windmark("undistort", tmp_path / "a.tif", tmp_path / "turned.tif", "-c", tmp_path / "c.json",
                    "-o", tmp_path / "o", "--json")  # fmt: skip
    assert said(done) == ("doubtful", "camera")
    assert done.json["verdict"]["next_step"].startswith("give the camera that was calibrated at this size")


# --- pov ------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("pose", "expected"),
    [
        (AHEAD, ("good", "")),
        (Pose.look_at([0.0, 0, 900], [0, 0, 1800], [0, 1, 0]), ("bad", "moved")),  # looks away
        (Pose.look_at([0.0, 0, 900], [900, 0, 0], [0, 1, 0]), ("bad", "covered")),  # past it
        (Pose.look_at([0.0, 0, 30], [0, 0, 0], [0, 1, 0]), ("bad", "moved")),  # 30 mm for 30 in
    ],
)
def test_views_of_nothing_and_from_inside(windmark, tmp_path, pose, expected):
    io.write_camera(tmp_path / "c.json", LENS, pose, unit="mm")
    io.write_mesh(tmp_path / "box.stl", box(50.0))
    done = windmark("pov", tmp_path / "c.json", "-g", tmp_path / "box.stl", "--unit", "mm", "--json")
    assert done.code == 0, done.err
    assert said(done) == expected


def test_a_camera_in_a_closed_test_section_is_not_inside_the_model(windmark, tmp_path):
    model, walls = box(50.0), box(1500.0)
    both = Mesh(np.r_[model.vertices, walls.vertices], np.r_[model.triangles, walls.triangles + 8],
                np.r_[model.volume, np.full(12, "walls")])  # fmt: skip
    io.write_mesh(tmp_path / "tunnel.vtp", both)
    io.write_camera(tmp_path / "c.json", LENS, AHEAD, unit="mm")
    done = windmark("pov", tmp_path / "c.json", "-g", tmp_path / "tunnel.vtp", "--unit", "mm")
    assert "● good: the model is in the picture" in done.out


# --- study, laws ----------------------------------------------------------------------------------
def row(method="template", missed=0, two_rms=0.05, over=1.05, r0=3.0):
    return {"r0_px": r0, "method": method, "markers": 100, "missed": missed, "two_rms_px": two_rms,
            "rms_over_crlb": over}  # fmt: skip


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([row(), row("bowl", two_rms=0.3, over=4.0)], ("good", "")),  # the best method counts
        ([row(missed=60), row("bowl", missed=70)], ("doubtful", "missing")),
        ([row(two_rms=0.3)], ("doubtful", "noise")),
        ([row(over=3.0)], ("doubtful", "noise")),
        ([row(two_rms=0.01, over=3.0)], ("good", "")),  # nothing is better, and it is a hundredth of a pixel
        ([row("bowl", two_rms=0.01, over=3.0)], ("doubtful", "noise")),  # without the better one beside it
        ([row("bowl", two_rms=0.01, over=3.0), row(two_rms=0.02, over=4.0)], ("good", "")),
        ([row(missed=100)], ("bad", "few")),
        ([row(), row(missed=100, r0=1.0)], ("doubtful", "few")),
    ],
)
def test_a_study_is_judged_by_its_best_method(rows, expected):
    verdict = study_verdict(rows)
    assert (verdict.word, verdict.cause) == expected


@pytest.mark.parametrize(
    ("rows", "advised"),
    [([row("bowl", over=3.0)], True), ([row("bowl", over=3.0), row(two_rms=0.06, over=4.0)], False),
     ([row(over=3.0)], False)],
)  # fmt: skip
def test_a_method_is_advised_where_it_was_not_tried(rows, advised):
    assert ("--method template" in study_verdict(rows).next_step) == advised


def test_what_is_left_without_noise_is_said():
    assert "11 x 11 sub-pixels" in study_verdict([row(two_rms=0.01, over=5.0)]).reason
    assert "sub-pixels" not in study_verdict([row()]).reason


def test_a_law_with_remarks_is_doubted(windmark, tmp_path):
    law = "from windmark.deformation import law\n\n\n@law(tip='mm', none='mm')\ndef wing(xyz, tip, none):\n"
    law += '    """Shift."""\n    return xyz + [0, 0, tip]\n'
    (tmp_path / "own.py").write_text(law)
    assert said(windmark("laws", tmp_path / "own.py", "--json")) == ("doubtful", "weak")
    (tmp_path / "own.py").write_text(law.replace("tip]", "tip + none]"))
    assert said(windmark("laws", tmp_path / "own.py", "--json")) == ("good", "")


@pytest.mark.parametrize(
    ("winner", "scale", "lost", "expected"),
    [("beam", 1.2, (), ("good", "")), ("", 1.2, (), ("bad", "weak")), ("beam", 9.0, (), ("doubtful", "bent")),
     ("beam", 1.2, ("7: no spots",), ("doubtful", "lost"))],
)  # fmt: skip
def test_laws_that_were_compared(winner, scale, lost, expected):
    verdict = compared_verdict(LawsCompared((), ("1", "2"), lost, winner, "beam: e^9 times likelier", scale))
    assert (verdict.word, verdict.cause) == expected


# --- convert --------------------------------------------------------------------------------------
def test_what_a_conversion_loses_is_doubted_where_it_counts(windmark, tmp_path):
    io.write_mesh(tmp_path / "a.vtp", box(50.0))
    sound = windmark("convert", tmp_path / "a.vtp", tmp_path / "a.stl", "--unit", "mm", "--json")
    assert sound.json["lost"]  # the volume's name: a shape is what an STL is asked for
    assert said(sound) == ("good", "")
    marks = MarkerSet.make(["A", "B"], [[0.0, 0, 0], [90, 0, 0]], role=["model", "wall"])
    io.write_markers(tmp_path / "m.csv", marks, length_unit="mm")
    done = windmark("convert", tmp_path / "m.csv", tmp_path / "m.tgts", "--json")
    assert said(done) == ("doubtful", "format")
    assert "the role wall of 1 markers" in done.json["verdict"]["reason"]
    io.write_image(tmp_path / "p.tif", np.random.default_rng(0).integers(0, 255, (30, 40)).astype(np.uint8))
    assert said(windmark("convert", tmp_path / "p.tif", tmp_path / "p.jpg", "--json")) == ("doubtful", "format")
    assert said(windmark("convert", tmp_path / "p.tif", tmp_path / "p.png", "--json")) == ("good", "")


def test_a_size_that_no_model_has_is_another_unit(windmark, tmp_path):
    io.write_mesh(tmp_path / "a.vtp", box(0.6))  # metres
    done = windmark("convert", tmp_path / "a.vtp", tmp_path / "b.vtp", "--unit", "mm", "--json")
    assert said(done) == ("doubtful", "units")
    done = windmark("convert", tmp_path / "a.vtp", tmp_path / "b.vtp", "--unit", "m", "--to-unit", "mm", "--json")
    assert said(done) == ("good", "")
    io.write_camera(tmp_path / "c.json", LENS, AHEAD, unit="m")
    assert said(windmark("convert", tmp_path / "c.json", tmp_path / "c.yml", "--json")) == ("doubtful", "units")


# --- paint-calibrate ------------------------------------------------------------------------------
def cell(folder, noise=0.002, sigma=0.002, pressures=12, temperatures=8):
    p, t = (a.ravel() for a in np.meshgrid(np.linspace(2e4, 1.3e5, pressures),
                                           np.linspace(278.15, 313.15, temperatures)))  # fmt: skip
    ratio = TYPICAL.ratio(p, t) * (1 + noise * np.random.default_rng(1).standard_normal(len(p)))
    io.write_table(folder / "cell.csv", {"pressure_Pa": p, "temperature_K": t, "ratio": ratio, "sigma": sigma * ratio})
    return folder / "cell.csv"


@pytest.mark.parametrize(
    ("changed", "options", "expected"),
    [
        ({}, (), ("good", "")),
        ({"noise": 0.01}, (), ("doubtful", "noise")),
        ({"temperatures": 1}, (), ("doubtful", "weak")),
        ({}, ("--p-ref", "200000"), ("doubtful", "weak")),
        ({"pressures": 3, "temperatures": 4}, ("--order", "2,2"), ("doubtful", "few")),
    ],
)
@pytest.mark.usefixtures("undrawn")
def test_a_calibration_of_paint(windmark, tmp_path, changed, options, expected):
    done = windmark("paint-calibrate", cell(tmp_path, **changed), "-o", tmp_path / "paint.json", *options, "--json")
    assert done.code == 0, done.err
    assert said(done) == expected


@pytest.mark.parametrize(("noise", "expected"), [(0.001, ("good", "")), (0.005, ("doubtful", "noise"))])
@pytest.mark.usefixtures("undrawn")
def test_a_calibration_of_temperature(windmark, tmp_path, noise, expected):
    t = np.linspace(280, 320, 21)
    ratio = np.exp(0.012 * (t - 293.15)) * (1 + noise * np.random.default_rng(4).standard_normal(21))
    io.write_table(tmp_path / "tsp.csv", {"temperature_K": t, "ratio": ratio, "sigma": 0.001 * ratio})
    done = windmark("paint-calibrate", tmp_path / "tsp.csv", "--temperature", "-o", tmp_path / "t.json", "--json")
    assert said(done) == expected
