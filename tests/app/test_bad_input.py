"""Bad input: a clear message, exit code 2 (wrong usage or file) or 1 (the data say no), and nothing half-written."""

import errno
import json
import os
import shutil

import numpy as np
import pytest

from windmark import io
from windmark.app.cli import app
from windmark.app.command_line import command_line
from windmark.geometry import Pose


@pytest.fixture
def job(virtual_test, tmp_path):
    """A private copy of the virtual test without its truth, one image; (folder, rewrite(file, old, new))."""
    source, _ = virtual_test
    for name in ("camera.json", "markers.csv", "model.grid", "wind-off.tif"):
        shutil.copy(source / name, tmp_path / name)
    (tmp_path / "project.toml").write_text(
        'title = "t"\nlength_unit = "mm"\n[[camera]]\nfile = "camera.json"\n[[image]]\nfile = "wind-off.tif"\n'
        '[markers]\nfile = "markers.csv"\n[grid]\nfile = "model.grid"\n[detect]\nradius_px = 4\n'
    )
    return tmp_path


def assert_nothing_written(folder):
    """No result, no temporary file: what is there is what was there before."""
    names = {p.name for p in folder.iterdir()}
    assert names <= {"camera.json", "markers.csv", "model.grid", "wind-off.tif", "project.toml"}, names


def run(windmark, job):
    return windmark("run", job / "project.toml")


@pytest.mark.parametrize("name", ["camera.json", "markers.csv", "model.grid", "wind-off.tif"])
def test_missing_file(windmark, job, name):
    (job / name).unlink()
    done = run(windmark, job)
    assert done.code == 2
    assert name in done.err
    assert_nothing_written(job)


def test_truncated_plot3d(windmark, job):
    grid = job / "model.grid"
    grid.write_bytes(grid.read_bytes()[: grid.stat().st_size // 2])
    done = run(windmark, job)
    assert done.code == 2
    assert "model.grid" in done.err
    assert "byte" in done.err
    assert_nothing_written(job)


def test_an_image_that_is_none(windmark, job):
    (job / "wind-off.tif").write_text("this is not an image")
    done = run(windmark, job)
    assert done.code == 1
    assert "wind-off" in done.err
    assert "image" in done.err


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [("W02,", "W01,", ["markers.csv", "W01"]), ("W01,", "W01,nan,0,0\nW99,", ["markers.csv", "nan"])],
)
def test_marker_table_with_double_names_or_nan(windmark, job, old, new, words):
    table = job / "markers.csv"
    text = table.read_text()
    assert old in text
    if "nan" in new:
        lines = text.splitlines()
        first = lines[1].split(",")
        first[1] = "nan"
        text = "\n".join([lines[0], ",".join(first), *lines[2:]])
    else:
        text = text.replace(old, new, 1)
    table.write_text(text)
    done = run(windmark, job)
    assert done.code == 2
    assert all(word.lower() in done.err.lower() for word in words)
    assert_nothing_written(job)


def image_with_discs(centres, size=(1024, 1280)):
    rows, columns = np.mgrid[: size[0], : size[1]]
    image = np.full(size, 2000.0) + np.random.default_rng(0).normal(0, 5, size)
    for x, y in centres:
        distance = np.hypot(columns - x, rows - y)
        image -= 1500 * np.clip(4.5 - distance, 0, 1)
    return image.astype(np.uint16)


def test_fewer_than_four_spots_is_refused(windmark, job):
    io.write_image(job / "wind-off.tif", image_with_discs([(300, 300), (700, 320), (500, 700)]))
    done = run(windmark, job)
    assert done.code == 1
    assert "not registered" in done.err
    assert "3" in done.err


def test_all_spots_on_a_line_is_refused(windmark, job):
    io.write_image(job / "wind-off.tif", image_with_discs([(200 + 90 * k, 300 + 40 * k) for k in range(9)]))
    done = run(windmark, job)
    assert done.code == 1
    assert "not registered" in done.err
    assert "line" in done.err


def test_an_empty_picture_is_refused(windmark, job):
    io.write_image(job / "wind-off.tif", np.full((1024, 1280), 900, dtype=np.uint16))
    done = run(windmark, job)
    assert done.code == 1
    assert "not registered" in done.err


def test_unknown_key(windmark, job):
    project = job / "project.toml"
    project.write_text(project.read_text().replace("radius_px", "radius_pixel"))
    done = run(windmark, job)
    assert done.code == 2
    assert "detect.radius_p" in done.err
    assert_nothing_written(job)


def test_camera_of_another_size(windmark, job):
    io.write_image(job / "wind-off.tif", np.zeros((512, 640), dtype=np.uint16))
    done = run(windmark, job)
    assert done.code == 1
    assert "640 x 512" in done.err
    assert "1280 x 1024" in done.err


def test_one_bad_image_does_not_stop_the_others(windmark, job):
    (job / "bad.tif").write_text("no image")
    project = job / "project.toml"
    project.write_text(project.read_text() + '[[image]]\nfile = "bad.tif"\n')
    done = windmark("run", project, "--json")
    assert done.code == 0
    assert done.json["failed"] == ["bad"]
    assert done.json["images"][0]["registration"]["registered"]


def test_disk_full_leaves_nothing(windmark, job, monkeypatch):
    """The disk fills up while the last files are moved into place."""
    real, calls = os.replace, []

    def full(source, target, *rest, **options):
        calls.append(target)
        if len(calls) > 5:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(target))
        return real(source, target, *rest, **options)

    monkeypatch.setattr(os, "replace", full)
    done = run(windmark, job)
    assert len(calls) > 5
    assert done.code == 2
    assert "disk is full" in done.err
    assert_nothing_written(job)


def test_ctrl_c_while_writing_leaves_nothing(windmark, job, monkeypatch):
    from windmark.pipeline import outputs

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(outputs, "_write_nodes", interrupted)
    done = run(windmark, job)
    assert done.code == 130
    assert "interrupted" in done.err
    assert_nothing_written(job)


def test_json_errors_are_json(windmark, job):
    (job / "markers.csv").unlink()
    done = windmark("run", job / "project.toml", "--json")
    assert done.code == 2
    assert "markers.csv" in done.json["error"]


def test_wrong_usage_of_the_command_line(windmark, job):
    assert windmark("detect").code == 2  # no image
    done = windmark("detect", job / "wind-off.tif", "-r", -1, "-o", job / "d.csv")
    assert done.code == 2
    assert "radius" in done.err
    done = windmark("detect", job / "wind-off.tif", "-r", 4, "--polarity", "grey", "-o", job / "d.csv")
    assert done.code == 2
    assert "polarity" in done.err
    assert_nothing_written(job)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["detect", "a.tif", "-r", "four"], "'--radius' / '-r': expected a number, not 'four'"),
        (["simulate", "test", "--psp", "2.5", "--json"], "'--psp': expected a whole number, not '2.5'"),
    ],
)
def test_a_word_in_place_of_a_number_is_said(words, said, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["windmark", *words])
    assert command_line(app, "--json" in words) == 2
    seen = capsys.readouterr()
    assert said in seen.err
    assert not seen.out or said in json.loads(seen.out)["error"]


def test_help_names_every_verb_and_an_example(windmark):
    help_text = windmark("--help").out
    for verb in ("demo", "simulate", "detect", "register", "resect", "align", "run"):
        assert verb in help_text
        assert f"Example: windmark {verb}" in windmark(verb, "--help").out


def test_prior_without_a_pose_and_a_wrong_prior(windmark, job):
    """The camera file has no pose; a prior from the other side excludes the right solution."""
    project = job / "project.toml"
    text = project.read_text()
    project.write_text(text + '[register]\nprior = "camera.json"\n')
    done = run(windmark, job)
    assert done.code == 2
    assert "no pose" in done.err
    camera, _ = io.read_camera(job / "camera.json")
    behind = Pose.look_at((100.0, 300.0, -1500.0), (100.0, 300.0, 0.0), (0.0, 1.0, 0.0))
    io.write_camera(job / "prior.json", camera, behind, unit="mm")
    project.write_text(text + '[register]\nprior = "prior.json"\n')
    done = run(windmark, job)
    assert done.code == 1
    assert "not registered" in done.err


# --- the folder of the results ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("output", "words"),
    [
        ("camera.json/out", "a part of its path is a file"),
        ("camera.json", "this is a file; expected a folder"),
        ("n" * 300, "the name is too long"),
        ("taken", "report.html: this is a folder, and the result needs a file of this name"),
    ],
)
def test_a_bad_output_is_found_before_the_work(windmark, job, output, words, monkeypatch):
    from windmark.app import verbs

    monkeypatch.setattr(verbs, "run_project", lambda *_, **__: pytest.fail("the work has begun"))
    (job / "taken" / "report.html").mkdir(parents=True)
    done = windmark("run", job / "project.toml", "-o", job / output)
    assert done.code == 2
    assert words in done.err
    (job / "taken" / "report.html").rmdir()
    (job / "taken").rmdir()
    assert_nothing_written(job)


def test_a_second_run_into_one_folder_is_refused_at_once(windmark, job):
    with io.result_folder(job / "results"):
        done = run(windmark, job)
    assert done.code == 2
    assert f"another run writes into this folder (process {os.getpid()} on " in done.err
    assert [p.name for p in (job / "results").iterdir()] == ["manifest.json"]  # the first one's
    (job / "results" / "manifest.json").unlink()
    (job / "results").rmdir()
    assert_nothing_written(job)


def test_a_refused_run_leaves_no_older_numbers_beside_its_report(windmark, job):
    with io.result_folder(job / "results") as out:
        (out.place / "wind-off").mkdir()
        (out.place / "wind-off" / "nodes.csv").write_text("a good result\n")
    (job / "results" / "notes.txt").write_text("mine\n")
    io.write_image(job / "wind-off.tif", np.full((1024, 1280), 900, dtype=np.uint16))
    done = run(windmark, job)
    assert done.code == 1
    results, kept = job / "results", job / "results.kept-1"
    assert not list(results.rglob("nodes.csv"))
    assert io.read_json(results / "manifest.json")["refused"]
    assert (results / "report.html").is_file()
    assert (results / "notes.txt").read_text() == "mine\n"
    assert (kept / "wind-off" / "nodes.csv").read_text() == "a good result\n"
    assert f"kept in {kept}" in done.err


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (("-m", "markers.csv", "-c", "camera.json", "--unit", "milimeter"), "--unit: expected 'in', 'ft', 'mm'"),
        (("-m", "markers.csv", "-c", "markers.csv", "--unit", "mm"), "markers.csv: is a table, by its name; exp"),
        (("-m", "markers.csv", "-c", "model.grid", "--unit", "mm"), "model.grid: is a surface grid, by its name; exp"),
    ],
)
def test_what_a_newcomer_mixes_up_is_named(windmark, job, monkeypatch, asked, words):
    monkeypatch.chdir(job)
    done = windmark("register", "wind-off.tif", *asked)
    assert done.code == 2
    assert words in done.err
    assert "length_unit" not in done.err


def test_a_picture_that_is_not_there_is_named_and_no_key(windmark, job, monkeypatch):
    monkeypatch.chdir(job)
    done = windmark("register", "wind-of.tif", "-m", "markers.csv", "-c", "camera.json", "--unit", "mm")
    assert (done.code, "image[0]" in done.err) == (2, False)
    assert "there is no file wind-of.tif" in done.err


def test_resect_without_a_pose_says_what_finds_it(windmark, job, monkeypatch):
    monkeypatch.chdir(job)
    done = windmark("resect", "wind-off.tif", "-c", "camera.json", "-g", "model.grid", "--unit", "mm", "-o", "out")
    assert done.code == 1
    assert "windmark register finds it" in done.err
