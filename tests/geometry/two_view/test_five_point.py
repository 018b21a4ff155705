"""Five pairs: the truth is always among the solutions."""

import numpy as np
import pytest

from windmark.geometry import Pose
from windmark.geometry.two_view import essential_five_point, essential_from_poses


def problems(kind, n=300, seed=0):
    """Rays (n, 5, 3) in both cameras and true essential matrices."""
    rng = np.random.default_rng(seed)
    pose = Pose.from_rotvec(rng.normal(size=(n, 3)) * 0.4, rng.normal(size=(n, 3)) * 0.5)
    xyz = np.concatenate([rng.uniform(-1, 1, (n, 5, 2)), rng.uniform(3, 6, (n, 5, 1))], axis=-1)
    if kind == "plane":
        xyz[..., 2] = 4 + np.einsum("nij,nj->ni", xyz[..., :2], rng.normal(size=(n, 2)) * 0.5)
    return xyz / xyz[..., 2:], pose.apply(xyz), essential_from_poses(pose)


def off(found, truth):
    """Distance (n, 10) to the truth, whatever the sign."""
    apart = [np.linalg.norm(found - sign * truth[:, None], axis=(-2, -1)) for sign in (1, -1)]
    return np.minimum(*apart)


@pytest.mark.parametrize("kind", ["space", "plane"])
def test_the_truth_is_among_the_solutions(kind):
    a, b, truth = problems(kind)
    found = essential_five_point(a, b)
    assert found.shape == (300, 10, 3, 3)
    nearest = np.nanmin(off(found, truth), axis=1)
    assert np.median(nearest) < 1e-12
    assert nearest.max() < 1e-6


def test_every_solution_is_an_essential_matrix_of_the_pairs():
    a, b, _ = problems("space")
    found = essential_five_point(a, b)
    have = np.isfinite(found[..., 0, 0])
    assert np.unique(have.sum(axis=1)).size > 2  # two, four, six ... solutions
    np.testing.assert_allclose(np.linalg.svd(found[have], compute_uv=False), [[1, 1, 0]] * have.sum(), atol=1e-8)
    e = np.einsum("npi,nsij,npj->nsp", b, found, a)
    assert np.abs(e[have]).max() < 1e-12


def test_shapes_and_inputs():
    a, b, _ = problems("space", 6)
    one = essential_five_point(a[0], b[0])
    np.testing.assert_allclose(one, essential_five_point(a, b)[0], atol=1e-12)
    np.testing.assert_allclose(essential_five_point(a[0, :, :2], 3 * b[0]), one, atol=1e-9)
    assert essential_five_point(a.reshape(2, 3, 5, 3), b.reshape(2, 3, 5, 3)).shape == (2, 3, 10, 3, 3)
    a[1, 2, 0] = np.nan
    found = essential_five_point(a, b)
    assert np.isnan(found[1]).all()
    assert np.isfinite(found[2]).any()
    with pytest.raises(ValueError, match="rays_b"):
        essential_five_point(a, b[:, :4])
