"""`windmark simulate --infrared` and the main job on two of its frames."""

import csv

import numpy as np
import pytest

from windmark import io
from windmark.pipeline.simulate_infrared import simulate_infrared

FEW = 8
"""Frames, as few as it makes: six before the heating begins, and two."""


def column(path, name):
    with open(path, newline="") as stream:
        return np.array([float(row[name] or "nan") for row in csv.DictReader(stream)])


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_two_frames_of_an_infrared_run_are_pictures_of_temperature(windmark, tmp_path):
    folder = tmp_path / "hot"
    folder.mkdir()
    test = simulate_infrared(folder, 7, FEW, (480, 384))
    done = windmark("run", folder / "project.toml", "--json")
    assert done.code == 0, done.err
    for image, frame in zip(done.json["images"], (0, FEW - 1), strict=True):
        assert image["registration"]["matched"] >= 25
        pose = io.read_camera(folder / "results" / image["name"] / "camera.json")[1]
        placed = test.test.cam_from_tunnel["cam1"] @ test.states[frame].motion
        assert np.degrees(pose.angle_to(placed)) < 0.3  # the late one is bent, too
        found = column(folder / "results" / image["name"] / "nodes.csv", "temperature_K [K]")
        true = np.asarray(io.read_nodes_netcdf(folder / "truth" / f"{frame}.nc")[1]["temperature"])
        seen = np.isfinite(found) & np.isfinite(true)
        assert seen.sum() > 1_700
        # What a black body would have: a surface of emissivity 0.9 in colder surroundings looks some 2 K colder.
        assert -4 < np.median((found - true)[seen]) < -0.5
        assert np.percentile(np.abs(found - true - np.median((found - true)[seen]))[seen], 70) < 0.6


@pytest.mark.slow
def test_same_seed_same_files_and_another_seed_another_run(tmp_path):
    prints = []
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        (tmp_path / name).mkdir()
        simulate_infrared(tmp_path / name, seed, FEW, (120, 96))
        prints.append({p.name: p.read_bytes() for p in (tmp_path / name).rglob("*") if p.suffix in (".tif", ".toml")})
    assert prints[0] == prints[1]
    assert len(prints[0]) == 2 * FEW + 32 + 2
    assert all(prints[0][n] != prints[2][n] for n in prints[0])


def test_one_kind_of_test_at_a_time(windmark, tmp_path):
    done = windmark("simulate", tmp_path / "x", "--infrared", 20, "--deforming", 3)
    assert done.code == 2
    assert "--infrared" in done.err
    assert not (tmp_path / "x").exists()
