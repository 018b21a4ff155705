"""Jobs without a marker radius: it is found in the image, said, and written down."""

import json

import numpy as np
import pytest

from windmark import io


@pytest.fixture(scope="module")
def job(virtual_test, tmp_path_factory):
    """A project without [detect] radius_px, in a folder of its own."""
    source, _ = virtual_test
    folder = tmp_path_factory.mktemp("job")
    for name in ("wind-off.tif", "camera.json", "markers.csv"):
        (folder / name).write_bytes((source / name).read_bytes())
    (folder / "project.toml").write_text(
        'title = "t"\nlength_unit = "mm"\n[[camera]]\nfile = "camera.json"\n[[image]]\nfile = "wind-off.tif"\n'
        '[markers]\nfile = "markers.csv"\n[detect]\npolarity = "dark"\n'
    )
    return folder


def test_a_project_need_not_give_the_radius(windmark, job):
    done = windmark("run", job / "project.toml", "-o", job / "results")
    assert done.code == 0, done.err
    assert "radius taken" in done.out
    summary = json.loads((job / "results" / "summary.json").read_text())
    assert "radius taken" in summary["images"][0]["radius_estimate"]
    assert summary["images"][0]["registration"]["registered"]
    assert "radius taken" in (job / "results" / "report.html").read_text()


def test_register_need_not_either_and_says_where_none_prevails(windmark, job):
    arguments = ("-m", job / "markers.csv", "-c", job / "camera.json", "--unit", "mm", "-o", job / "registered")
    assert "radius taken" in windmark("register", job / "wind-off.tif", *arguments).out
    shape = io.read_grey(job / "wind-off.tif").shape
    io.write_image(job / "flat.png", np.random.default_rng(3).integers(80, 110, shape).astype(np.uint8))
    done = windmark("register", job / "flat.png", *arguments)
    assert done.code == 1
    said = [line for line in done.out.splitlines() if "no radius prevails" in line]
    assert [line.count("no radius prevails") for line in said] == [1], "in the verdict; stderr has the refusal"
    assert said[0].startswith("■ bad")
    io.write_image(job / "empty.png", np.full(shape, 9, np.uint8))
    done = windmark("register", job / "empty.png", *arguments)
    assert done.code == 1
    assert "■ bad: every pixel is at the level 9: the picture shows nothing" in done.out


def test_colours_in_a_project(windmark, job):
    """A channel that is not there is that image's problem; an unknown one is the project's."""
    text = (job / "project.toml").read_text()
    for line, code, word in (('channel = "red"', 1, "without colours"), ('bayer = "RGB"', 2, "bayer")):
        (job / "colour.toml").write_text(text.replace('"wind-off.tif"\n', f'"wind-off.tif"\n{line}\n'))
        done = windmark("run", job / "colour.toml", "-o", job / "none")
        assert done.code == code
        assert word in done.err
