"""The Laplacian over several lengths: exact for quadrics, noise as said, the widest scale that is not contradicted."""

import numpy as np
import pytest

from windmark.paint import lateral_scales, widest_agreed
from windmark.scene import Mesh, structured_triangles


def plate(n=40, h=1.0, bend=0.0):
    x, y = np.meshgrid(np.arange(n) * h, np.arange(n) * h)
    x, y = x.ravel(), y.ravel()
    return Mesh.make(np.stack([x, y, -0.5 * bend * x**2], axis=1), structured_triangles(n, n)), x, y


def test_each_scale_is_exact_for_a_quadric_and_its_noise_is_as_said():
    mesh, x, y = plate()
    scales = lateral_scales(mesh, np.ones(len(x), bool), 8.0)
    assert [round(s.radius, 1) for s in scales] == [2.3, 3.3, 4.6, 6.5]
    rng, noises = np.random.default_rng(1), []
    for s in scales:
        lap = s.laplacian(0.3 * x**2 - 0.1 * y**2 + x * y + 5 * x - 7 * y)
        noise = s.noise(np.full(len(x), 0.04))
        assert np.isfinite(noise).all()
        # A cell's mean of a square is that of its middle and of its width, which differs little between cells.
        assert np.median(lap) == pytest.approx(0.4, abs=0.01)
        assert np.abs(lap - 0.4).max() < 0.1
        seen = np.array([s.laplacian(0.2 * rng.standard_normal(len(x))) for _ in range(20)])
        assert np.sqrt(np.mean((seen / noise) ** 2)) == pytest.approx(1, abs=0.05)
        noises.append(np.median(noise))
    assert (np.array(noises[:-1]) / noises[1:] > 2.0).all()  # h / L^3: 2.8 a step


def test_both_sides_of_a_thin_wing_and_unknown_nodes_do_not_mix():
    mesh, x, _ = plate(20)
    both = Mesh.make(
        np.concatenate([mesh.vertices, mesh.vertices - [0, 0, 0.5]]),
        np.concatenate([mesh.triangles, mesh.triangles[:, ::-1] + len(x)]),
    )
    scales = lateral_scales(both, np.ones(2 * len(x), bool), 5.0)
    for s in scales:
        assert np.abs(s.laplacian(np.repeat([0.0, 100.0], len(x)))).max() < 1e-9
    lost = np.where(np.arange(2 * len(x)) == 210, np.nan, 0.0)
    assert 5 < np.isnan(scales[0].laplacian(lost)).sum() < 40
    known = np.isfinite(lost)
    assert np.isfinite(lateral_scales(both, known, 5.0)[0].laplacian(lost)).all()


def test_the_widest_scale_that_no_narrower_one_contradicts():
    values = [np.array([1.0, 1.0, 1.0, np.nan]), np.array([1.2, 5.0, np.nan, 2.0]), np.array([1.1, 1.0, 1.1, np.nan])]
    noises = [np.full(4, 0.2), np.full(4, 0.1), np.full(4, 0.05)]
    best, noise = widest_agreed(values, noises, 2.0)
    assert best.tolist() == [1.1, 1.0, 1.1, 2.0]
    assert noise.tolist() == [0.05, 0.2, 0.05, 0.1]
