"""`windmark simulate --infrared` and the main job on it."""

import csv

import numpy as np

from windmark import io


def column(path, name):
    with open(path, newline="") as stream:
        return np.array([float(row[name]) for row in csv.DictReader(stream)])


def test_an_infrared_test_runs_as_written(windmark, tmp_path):
    folder = tmp_path / "hot"
    assert windmark("simulate", folder, "--infrared", "--seed", 7).code == 0
    done = windmark("run", folder / "project.toml", "--json")
    assert done.code == 0, done.err
    truth = io.read_camera(folder / "truth" / "camera.json")[1]
    for image in done.json["images"]:
        assert image["registration"]["matched"] >= 25
        pose = io.read_camera(folder / "results" / image["name"] / "camera.json")[1]
        assert np.degrees(pose.angle_to(truth)) < 0.1
        found = column(folder / "results" / image["name"] / "nodes.csv", "temperature_K [K]")
        true = column(folder / "truth" / f"{image['name']}-nodes.csv", "temperature [K]")
        seen = np.isfinite(found)
        assert seen.sum() > 20_000
        assert np.median(np.abs(found - true)[seen]) < 0.04  # a pixel's noise is 0.03 K


def test_one_kind_of_test_at_a_time(windmark, tmp_path):
    done = windmark("simulate", tmp_path / "x", "--infrared", "--deforming", 3)
    assert done.code == 2
    assert "--infrared" in done.err
    assert not (tmp_path / "x").exists()
