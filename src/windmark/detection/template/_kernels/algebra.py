"""Small dense algebra of the template fit: ten unknowns, some of them held. Private."""

from __future__ import annotations

import math
from typing import Any

from windmark.geometry._jit import nb


@nb.njit(cache=True, nogil=True, error_model="numpy")
def factor(matrix: Any, damping: float, held: Any, work: Any) -> bool:
    """Cholesky factor of matrix + damping diag(matrix) without the held unknowns; False where singular."""
    n = held.size
    for i in range(n):
        for j in range(i + 1):
            s = 0.0 if held[i] or held[j] else matrix[i, j]
            if i == j:
                s = 1.0 if held[i] else s * (1.0 + damping)
            limit = 1e-13 * s
            for k in range(j):
                s -= work[i, k] * work[j, k]
            if i == j:
                if not s > limit:
                    return False
                work[i, i] = math.sqrt(s)
            else:
                work[i, j] = s / work[j, j]
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def substitute(work: Any, rhs: Any, held: Any, step: Any) -> None:
    """Solve with the factor; 0 for the held unknowns."""
    n = rhs.size
    for i in range(n):
        s = 0.0 if held[i] else rhs[i]
        for k in range(i):
            s -= work[i, k] * step[k]
        step[i] = s / work[i, i]
    for i in range(n - 1, -1, -1):
        s = step[i]
        for k in range(i + 1, n):
            s -= work[k, i] * step[k]
        step[i] = s / work[i, i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def solve(matrix: Any, rhs: Any, damping: float, held: Any, work: Any, step: Any) -> bool:
    """Solve (matrix + damping diag(matrix)) step = rhs without the held unknowns, by Cholesky; False where singular."""
    if not factor(matrix, damping, held, work):
        return False
    substitute(work, rhs, held, step)
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def inverse(matrix: Any, held: Any, scale: float, work: Any, unit: Any, column: Any, out: Any) -> None:
    """Scale / matrix without the held unknowns, whose rows and columns become 0."""
    factor(matrix, 0.0, held, work)
    for m in range(10):
        for i in range(10):
            unit[i] = 1.0 if i == m else 0.0
            out[i, m] = 0.0
        if not held[m]:
            substitute(work, unit, held, column)
            for i in range(10):
                out[i, m] = 0.0 if held[i] else scale * column[i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def congruence(matrix: Any, t: Any, row: Any) -> None:
    """Matrix = t^T matrix t in place, where t (5, 5) stands for the unknowns 2 ... 6."""
    for i in range(10):
        for k in range(5):
            row[k] = 0.0
            for m in range(5):
                row[k] += matrix[i, 2 + m] * t[m, k]
        for k in range(5):
            matrix[i, 2 + k] = row[k]
    for i in range(10):
        for k in range(5):
            row[k] = 0.0
            for m in range(5):
                row[k] += t[m, k] * matrix[2 + m, i]
        for k in range(5):
            matrix[2 + k, i] = row[k]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def normal_equations(jac: Any, res: Any, shape: bool, t: Any, matrix: Any, rhs: Any, row: Any) -> None:
    """J^T J and J^T r of the state, from the derivatives by the model parameters and t of `shape_of`."""
    rows, r = jac.reshape((10, res.size)), res.reshape(res.size)
    for a in range(10):
        held = not shape and 2 <= a < 6
        total = 0.0
        for k in range(0 if held else r.size):
            total += rows[a, k] * r[k]
        rhs[a] = total
        for b in range(a, 10):
            total = 0.0
            for k in range(0 if held or (not shape and 2 <= b < 6) else r.size):
                total += rows[a, k] * rows[b, k]
            matrix[a, b] = total
            matrix[b, a] = total
    of_state(matrix, rhs, t, row)


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def add_products(rows: Any, n: int, matrix: Any, rhs: Any) -> None:
    """Add J^T J, of which the upper triangle counts, and J^T r of the first n columns of `rows`: (C, N), J, then r.

    Four sums at a time: one row is read once for all.
    """
    count = rhs.size
    for a in range(count):
        one = rows[a]
        for b in range(a, count + 1, 4):
            s0 = s1 = s2 = s3 = 0.0
            r0, r1 = rows[b], rows[min(b + 1, count)]
            r2, r3 = rows[min(b + 2, count)], rows[min(b + 3, count)]
            for k in range(n):
                s0 += one[k] * r0[k]
                s1 += one[k] * r1[k]
                s2 += one[k] * r2[k]
                s3 += one[k] * r3[k]
            for m in range(b, min(b + 4, count + 1)):
                s = s0 if m == b else (s1 if m == b + 1 else (s2 if m == b + 2 else s3))
                if m < count:
                    matrix[a, m] += s
                else:
                    rhs[a] += s
    for a in range(count):
        for b in range(a):
            matrix[a, b] = matrix[b, a]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def of_state(matrix: Any, rhs: Any, t: Any, row: Any) -> None:
    """From the equations of the model parameters those of the state, with t of `shape_of`."""
    congruence(matrix, t, row)
    for k in range(5):
        row[k] = 0.0
        for m in range(5):
            row[k] += t[m, k] * rhs[2 + m]
    for k in range(5):
        rhs[2 + k] = row[k]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def quadratic(matrix: Any, a: Any, b: Any) -> float:
    """(a - b)^T matrix (a - b)."""
    total = 0.0
    for i in range(10):
        for k in range(10):
            total += (a[i] - b[i]) * matrix[i, k] * (a[k] - b[k])
    return total
