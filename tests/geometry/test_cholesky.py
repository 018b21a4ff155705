"""The kernels' small solver against NumPy."""

import numpy as np
import pytest

from windmark.geometry._cholesky_kernels import cholesky, inverse_factor, solve_factored, solved


@pytest.mark.parametrize("size", [1, 6, 7])
def test_as_numpy(size):
    rng = np.random.default_rng(size)
    rows = rng.normal(size=(12, size))
    matrix, right = rows.T @ rows, rng.normal(size=size)
    factor, x = matrix.copy(), right.copy()
    assert cholesky(factor, size, 1e-12)
    np.testing.assert_allclose(np.tril(factor), np.linalg.cholesky(matrix), rtol=1e-10, atol=1e-12)
    solve_factored(factor, x, size)
    np.testing.assert_allclose(x, np.linalg.solve(matrix, right), rtol=1e-9)
    np.testing.assert_allclose(inverse_factor(factor, size), np.linalg.inv(np.tril(factor)), rtol=1e-9, atol=1e-12)
    again = right.copy()
    assert solved(matrix.copy(), again, size, 1e-12)
    np.testing.assert_array_equal(again, x)


def test_a_column_that_adds_nothing_is_told():
    rows = np.random.default_rng(0).normal(size=(9, 3))
    rows = np.column_stack([rows, rows[:, 0] + 2 * rows[:, 2]])
    assert not cholesky(rows.T @ rows, 4, 1e-9)
    assert not solved(rows.T @ rows, np.ones(4), 4, 1e-9)
