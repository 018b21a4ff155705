"""Rims of markers, over which two pictures lay their pixels differently, are no contradiction; a part that is, is."""

import numpy as np
import pytest

import windmark as wm
from windmark.paint.cameras import cameras_apart
from windmark.scene import structured_triangles

CAMERA, MANY = wm.Camera((160, 120), 220.0), 5
POSES = {"front": (0.0, 0.0, 4.0), "oblique": (3.4, 0.5, 2.4)}


def surface(x, y):
    """Light with discs of a tenth of it, one in each cell of 0.25."""
    light = 1000.0 + 200.0 * np.sin(2 * x) + 100.0 * np.cos(3 * y)
    disc = np.hypot((x + 5) % 0.25 - 0.125, (y + 5) % 0.25 - 0.125) < 0.05
    return np.where(disc, 0.1 * light, light)


def picture(name, seed, change=None):
    """A pixel is the mean over its own part of the plate z = 0."""
    pose = wm.Pose.look_at(POSES[name], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    at = [(np.arange(n * MANY) + 0.5) / MANY - 0.5 for n in CAMERA.size_px]
    rays = CAMERA.unproject(np.stack(np.meshgrid(*at), axis=-1).reshape(-1, 2)) @ pose.rotation
    xy = pose.center[:2] - rays[:, :2] * (pose.center[2] / rays[:, 2])[:, None]
    width, height = CAMERA.size_px
    image = surface(*xy.T).reshape(height, MANY, width, MANY).mean((1, 3))
    image += np.random.default_rng(seed).normal(0.0, 2.0, image.shape)
    return wm.Picture(name, image if change is None else change(image), CAMERA, pose, noise=2.0)


def beyond(change=None):
    """Part of the nodes on which the two contradict each other: with steps, and without."""
    x, y = np.meshgrid(np.linspace(-1, 1, 80), np.linspace(-1, 1, 80))
    plate = wm.Mesh.make(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), structured_triangles(80, 80))
    m = wm.merge_views(plate, [picture("front", 1), picture("oblique", 2, change)], gain="none")
    return [
        cameras_apart(m.names, m.values, m.sigmas**2, m.well, m.gains.systematic, steps)[0].beyond
        for steps in (m.step_variances(), None)
    ]


def test_rims_of_markers_are_no_contradiction():
    with_steps, without = beyond()
    assert without > 0.05
    assert with_steps < 0.002


def dead(image):
    image[np.random.default_rng(3).random(image.shape) < 0.05] = 0.0
    return image


def dirty(image):
    image[40:70, 60:100] *= 0.9
    return image


@pytest.mark.parametrize("change", [dead, dirty])
def test_dead_pixels_of_one_picture_and_dirt_are(change):
    with_steps, _ = beyond(change)
    assert with_steps > 0.02
