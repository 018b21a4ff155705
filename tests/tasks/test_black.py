"""Pixels of the model that are clipped at black have no value; what is black is not clipped."""

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.pipeline.clock import silent
from windmark.pipeline.mapping import map_image
from windmark.pipeline.project import make_project
from windmark.pipeline.results import ImageResult, RunResult
from windmark.pipeline.verdict.run import run_verdict
from windmark.resection import noise_law
from windmark.scene import Mesh, structured_triangles
from windmark.synth.degrade import gaussian_blur
from windmark.tasks.black import beside_black, black_pixels

H, W = 90, 120
Y, X = np.indices((H, W))
ALL = np.ones((H, W), bool)


def taken(light, noise=6.0, seed=0):
    levels = np.random.default_rng(seed).normal(light, noise)
    return np.maximum(np.rint(levels), 0).astype(np.uint16)


def mapped(tmp_path, light):
    """A plate that fills the picture, and what comes of it."""
    for name in ("c.json", "g.grid", "a.tif"):
        (tmp_path / name).write_text("{}", encoding="utf-8")
    work = make_project(tmp_path / "p.toml", {
        "title": "t", "length_unit": "mm", "grid": {"file": "g.grid"},
        "camera": [{"name": "cam", "file": "c.json", "pose": "known"}], "image": [{"file": "a.tif", "camera": "cam"}],
    })  # fmt: skip
    x, y = np.meshgrid(np.linspace(-1, 1, 40), np.linspace(-1, 1, 40))
    mesh = Mesh.make(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), structured_triangles(40, 40))
    item = ImageResult("a", taken(light), Camera((W, H), 150.0), Pose.look_at((0.3, 0, 4), np.zeros(3), (0, 1, 0)))
    done = map_image(item, work, mesh, (), (), silent)
    assert done.problem is None
    return done, run_verdict(RunResult(work, None, mesh, (done,), {}))


def test_nodes_whose_noise_is_cut_off_have_no_value(tmp_path):
    """The part of the plate that is no brighter than half of the noise; none of the others."""
    light = np.maximum(3.0 * (X - 60.0), 0.0)
    done, verdict = mapped(tmp_path, light)
    column = done.nodes.xy[:, 0]
    seen, gone = done.nodes.visible, np.isnan(done.values)
    assert gone[seen & (column < 58)].all()
    assert not gone[seen & (column > 66)].any()
    assert done.dark.startswith(f"{(seen & gone).sum()} of {seen.sum()} nodes that it shows have no value")
    assert (verdict.word, "black" in [f.cause for f in verdict.findings]) == ("doubtful", True)
    bright = seen & ~gone
    error = (done.values - 3.0 * (column - 60))[bright] / done.sigma[bright]
    assert np.abs(error).max() < 6  # their noise is not that of the ones that are cut off


def test_a_black_background_says_nothing(tmp_path):
    done, _ = mapped(tmp_path, np.where((abs(X - 60) < 20) & (abs(Y - 45) < 20), 300.0, 60.0))
    assert (done.dark, done.black) == ("", None)
    assert black_pixels(taken(np.where(X > 30, 200, 0)), X > 32) is None
    assert black_pixels(taken(np.where(X > 30, 200, 0)), X > 5) is not None


@pytest.mark.parametrize("noise", [0.0, 0.4])
@pytest.mark.parametrize("seed", range(5))
def test_dots_and_writing_at_black_are_not_clipped_noise(noise, seed):
    """Nor what rounding makes of a light below one level."""
    rng = np.random.default_rng(seed)
    dots = 200.0 * (np.hypot(X % 11 - 5 + rng.normal(), Y % 9 - 4) > 2.5)
    lines = 200.0 * (rng.random((H, W // 4)) < 0.5).repeat(4, axis=1)
    for light in (gaussian_blur(dots, 0.6), gaussian_blur(lines, 0.6), 0 * dots + 0.3, 0 * dots):
        assert black_pixels(taken(light, noise + 1e-9, seed), ALL) is None


def test_numbers_of_other_kinds():
    image = taken(0 * X + 2.0)
    assert black_pixels(image, ALL).mean() > 0.9
    assert black_pixels(image / 8.0, ALL).mean() > 0.9
    assert black_pixels(image > 3, ALL) is None
    assert black_pixels(image, ~ALL) is None
    assert black_pixels(np.full((H, W), np.nan), ALL) is None


def test_noise_is_not_that_of_a_background_at_black():
    """A dim model in front of one: what is left of it scatters as it does."""
    light = np.where((abs(X - 60) < 40) & (abs(Y - 45) < 35), 5.0, -15.0)
    levels = taken(light)
    whole = levels.astype(float)
    whole[beside_black(levels)] = np.nan
    assert 20 < noise_law(whole).variance(5.0) < 40
