"""Squares, crosses and rings among discs: what explains the pixels better is what is there."""

import numpy as np
import pytest

import windmark as wm
from windmark.detection import explain
from windmark.detection.rejected import OTHER

PLACES = np.stack(np.meshgrid(np.arange(30, 330, 50.0), np.arange(30, 230, 50.0)), axis=-1).reshape(-1, 2)
SIZE = (240, 340)


def cover(shape, x, y, half, turn):
    """Share of each pixel that a shape covers: 7 x 7 sub-pixels, seen at 50 degrees."""
    sub = (np.arange(7) - 3) / 7.0
    rows, cols = (np.arange(n)[:, None] + sub for n in SIZE)
    v, u = (rows.ravel() - y)[:, None] / 0.64, (cols.ravel() - x)[None, :]
    a, b = u * np.cos(turn) + v * np.sin(turn), v * np.cos(turn) - u * np.sin(turn)
    inside = {
        "disc": np.hypot(a, b) <= half,
        "square": (abs(a) <= half) & (abs(b) <= half),
        "cross": ((abs(a) <= half) & (abs(b) <= 0.35 * half)) | ((abs(b) <= half) & (abs(a) <= 0.35 * half)),
        "ring": (np.hypot(a, b) <= half) & (np.hypot(a, b) > 0.5 * half),
    }[shape]
    return inside.reshape(SIZE[0], 7, SIZE[1], 7).mean(axis=(1, 3))


def picture(shapes, half=9.0, noise=1.5):
    rng = np.random.default_rng(4)
    share = np.ones(SIZE)
    for (x, y), shape in zip(PLACES, shapes, strict=True):
        jitter, turn = rng.uniform(-0.5, 0.5, 2), rng.uniform(0, np.pi)
        share *= 1.0 - 0.7 * cover(shape, x + jitter[0], y + jitter[1], half, turn)
    return np.round(150.0 * share + rng.normal(0, noise, SIZE)).astype(np.uint8)


@pytest.mark.parametrize("noise", [1.5, 8.0])
def test_discs_are_discs(noise):
    assert len(wm.detect(picture(["disc"] * len(PLACES), noise=noise), radius_px=9.0)) == len(PLACES)


@pytest.mark.parametrize("other", ["square", "cross", "ring"])
def test_another_shape_is_none_beside_discs_and_alone(other):
    shapes = ["disc", other] * (len(PLACES) // 2)
    found, rejected = explain(picture(shapes), radius_px=9.0)
    near = np.hypot(*(found.xy[:, None] - PLACES).transpose(2, 0, 1)).argmin(axis=1)
    assert sorted(near) == list(range(0, len(PLACES), 2))
    assert len(wm.detect(picture([other] * len(PLACES)), radius_px=9.0)) == 0
    if other == "square":
        assert (rejected.reason == OTHER).any()  # most lack enough of the edge already
