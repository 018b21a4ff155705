"""Centres of imaged discs, as no formula of windmark has them: of the areas of dense polygons on their rims."""

import numpy as np


def centres(camera, pose, place, normal, radius):
    """(N, 2) centres of the images of flat discs in a pinhole camera, and (N,) geometric mean radius of these."""
    t = np.linspace(0.0, 2.0 * np.pi, 721)[:-1]
    one = np.cross(normal, [0.0, 1.0, 0.0])
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    other = np.cross(normal, one)
    rim = place[:, None] + radius * (np.cos(t)[:, None] * one[:, None] + np.sin(t)[:, None] * other[:, None])
    seen = pose.apply(rim.reshape(-1, 3)).reshape(rim.shape)
    xy = camera.focal_px * seen[..., :2] / seen[..., 2:]
    after = np.roll(xy, -1, axis=1)
    area = xy[..., 0] * after[..., 1] - after[..., 0] * xy[..., 1]
    twice = area.sum(axis=1)
    middle = ((xy + after) * area[..., None]).sum(axis=1) / (3.0 * twice)[:, None]
    return middle + camera.project(np.array([[0.0, 0.0, 1.0]]))[0], np.sqrt(np.abs(twice) / (2.0 * np.pi))
