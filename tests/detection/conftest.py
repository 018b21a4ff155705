"""A small oracle for pictures of discs and the slow, readable twin of SPOT's least squares."""

import numpy as np
import pytest


def draw(shape, discs, *, background=100.0, depth=60.0, blur=0):
    """Discs on an even surface: 11 x 11 sub-pixels as in the paper, then `blur` passes of a 3 x 3 mean.

    discs: rows x, y, radius or x, y, major, minor, angle.
    """
    sub = (np.arange(11) - 5) / 11.0
    image = np.full(shape, float(background))
    for disc in discs:
        x, y, a, b, angle = disc if len(disc) == 5 else (*disc, disc[2], 0.0)
        reach = int(np.ceil(max(a, b))) + 2
        rows = np.arange(max(0, int(y) - reach), min(shape[0], int(y) + reach + 1))
        cols = np.arange(max(0, int(x) - reach), min(shape[1], int(x) + reach + 1))
        v = (rows[:, None] + sub).ravel()[:, None] - y
        u = (cols[:, None] + sub).ravel()[None, :] - x
        s, t = u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)
        inside = (s / a) ** 2 + (t / b) ** 2 <= 1.0
        cover = inside.reshape(len(rows), 11, len(cols), 11).mean(axis=(1, 3))
        image[np.ix_(rows, cols)] -= depth * cover
    for _ in range(blur):
        padded = np.pad(image, 1, mode="edge")
        image = sum(padded[i : i + shape[0], j : j + shape[1]] for i in range(3) for j in range(3)) / 9.0
    return image


def soft(radius, distance, edge=1.0):
    """Disc with a linear edge."""
    return np.clip((radius - distance) / edge + 0.5, 0.0, 1.0)


def fit_hole(image, x, y, r0):
    """Merit and depth at (x, y) by `numpy.linalg.lstsq`: window weights, columns 1, x, y, top-hat."""
    rows, cols = np.mgrid[: image.shape[0], : image.shape[1]].astype(float)
    distance = np.hypot(cols - x, rows - y)
    weight = soft(2.0 * r0, distance) * np.isfinite(image)
    use = weight > 0
    root, t = np.sqrt(weight[use]), soft(r0, distance[use])
    design = np.column_stack([np.ones(use.sum()), cols[use] - x, rows[use] - y, t]) * root[:, None]
    target = image[use] * root
    solution = np.linalg.lstsq(design, target, rcond=None)[0]
    error = np.sum((target - design @ solution) ** 2)
    depth = -solution[3]
    return np.sqrt(error / (depth**2 * np.sum(weight[use] * t**2))), depth


@pytest.fixture(name="draw", scope="session")
def draw_fixture():
    return draw


@pytest.fixture(name="fit_hole", scope="session")
def fit_hole_fixture():
    return fit_hole


@pytest.fixture(name="soft", scope="session")
def soft_fixture():
    return soft


@pytest.fixture(scope="session")
def scene():
    """40 discs of radius 2.6 ... 3.4 on an uneven, slightly noisy surface: image (uint8 range) and centres."""
    rng = np.random.default_rng(5)
    rows, cols = np.mgrid[25:240:31, 25:160:32]
    centres = np.column_stack([cols.ravel(), rows.ravel()]) + rng.uniform(-4, 4, (rows.size, 2))
    radii = rng.uniform(2.6, 3.4, len(centres))
    image = draw((260, 180), np.column_stack([centres, radii]), blur=1)
    y, x = np.mgrid[:260, :180]
    return image + 0.15 * x - 0.1 * y + rng.normal(0, 1.5, image.shape), centres
