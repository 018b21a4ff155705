"""Pictures that are averaged: those of one state differ by noise, those of two by far more."""

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.scene import Mesh, structured_triangles
from windmark.tasks.psp import ModelPicture, ratio_of
from windmark.tasks.psp.scatter import scatter_of

NAMES = tuple("abcdef")


def drawn(change, *, sigma=3.0, seed=1, frames=6, nodes=4000):
    rng = np.random.default_rng(seed)
    scene = np.linspace(600.0, 1500.0, nodes)
    values = scene * (1 + np.asarray(change)) + sigma * rng.standard_normal((frames, nodes))
    return values, np.full(values.shape, sigma**2)


@pytest.mark.parametrize("frames", [2, 3, 6])
def test_noise_alone_is_the_noise(frames):
    found = scatter_of(*drawn(0.0, frames=frames), NAMES[:frames])
    assert found.times == pytest.approx(1, abs=0.05)
    assert found.part < 1.5e-3


def test_pictures_of_two_states_are_told_by_size_and_name_in_any_order():
    wave = 0.03 * np.sin(np.linspace(0, 9, 4000))
    change = np.array([0, 1, 0, 1, 1, 0])[:, None] * wave
    found = scatter_of(*drawn(change), NAMES)
    assert found.groups == (("a", "c", "f"), ("b", "d", "e"))
    assert found.times > 3
    assert found.part == pytest.approx(0.03 * 0.707 * 0.55, rel=0.25)


def test_a_shock_that_moves_over_a_few_nodes_is_one_state():
    change = np.random.default_rng(3).normal(0, 0.1, (6, 1)) * (np.arange(4000) > 3700)
    found = scatter_of(*drawn(change), NAMES)
    assert found.times < 1.2


def test_one_picture_and_pictures_without_a_common_node_say_nothing():
    values, noise = drawn(0.0, frames=2)
    assert scatter_of(values[:1], noise[:1], NAMES[:1]) is None
    values[0, :2000] = values[1, 2000:] = np.nan
    assert scatter_of(values, noise, NAMES[:2]) is None


def test_a_ratio_has_the_scatter_of_each_camera_and_kind_and_lamps_are_none():
    rng = np.random.default_rng(0)
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-20, 20, 15), np.linspace(-20, 20, 15)))
    mesh = Mesh.make(np.column_stack([x, y, 0 * x]), structured_triangles(15, 15), "wing")
    camera, above = Camera((160, 120), 200.0), Pose.look_at(np.array([0.0, 0.0, 100.0]), np.zeros(3), [0.0, 1.0, 0.0])

    def taken(kind, changes):
        light = np.full((120, 160), 600.0)
        out = []
        for k, (lamp, change) in enumerate(changes):
            seen = lamp * light * (1 + change * np.sin(np.arange(160) / 9)) + 2 * rng.standard_normal(light.shape)
            still = np.zeros((len(mesh.vertices), 3, 1))
            out.append(ModelPicture(f"{kind}{k}", "a", seen, np.full(seen.shape, 4.0), camera, above, mesh, still))
        return out

    lamps = [(1.0, 0), (1.05, 0), (0.96, 0), (1.02, 0)]
    same = ratio_of(taken("on", lamps), taken("off", lamps)).scatter
    assert len(same) == 2
    assert all(s.part < 2e-3 for s in same)
    mixed = ratio_of(taken("on", [(1.0, 0), (1.05, 0.04), (0.96, 0), (1.02, 0.04)]), taken("off", lamps)).scatter
    assert mixed[0].groups == (("on0", "on2"), ("on1", "on3"))
    assert mixed[0].part > 0.01
    assert mixed[1].part < 2e-3
