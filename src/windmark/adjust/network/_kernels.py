"""Residuals and normal equations of a network as numba kernels, view by view.

Private to the adjust room. The readable twin is `numpy_path`, which also does the work where numba is disabled.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network._arrays import CHANGE, INTERIOR, SHARED, Columns, Equations, Marks, Scene, Units
from windmark.adjust.network._projection_kernels import (
    FAST,
    Numbers,
    interior_rows,
    lens,
    moved,
    pose_row,
    put_rows,
    tilt_rows,
    tilted_sensor,
    turned,
    view_of,
)
from windmark.geometry._jit import nb

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def residuals(marks: Marks, scene: Scene, out: Array) -> bool:
    """Whitened residuals (O, 2), projected - observed; False where a point has no image."""
    xyz, points, white, xy, shift = scene.xyz, marks.points, marks.white, marks.xy, marks.shift
    for i in range(scene.view_camera.shape[0]):
        frame, member, offset, camera, sensor, factor = view_of(scene, i)
        fx = camera[0] * factor
        fy = fx * camera[1]
        for o in range(marks.starts[i], marks.starts[i + 1]):
            p = points[o]
            x, y, z = moved(frame, xyz[p, 0], xyz[p, 1], xyz[p, 2])
            if member:
                x, y, z = moved(offset, x, y, z)
            _, _, _, ud, vd, _, _, _, _, _, _, _, seen = lens(camera, x, y, z)
            sx, sy, _, _, _, _, w = tilted_sensor(sensor, ud, vd)
            if not (seen > 0.0 and w > 0.0):
                return False
            dx = fx * (sx + camera[16] * sy) + camera[2] + shift[o, 0] - xy[o, 0]
            dy = fy * sy + camera[3] + shift[o, 1] - xy[o, 1]
            out[o, 0], out[o, 1] = white[o, 0] * dx, white[o, 1] * dx + white[o, 2] * dy
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def accumulate(
    marks: Marks, scene: Scene, units: Units, columns: Columns, residual: Array, weight: Array, use_weight: bool,
    into: Equations,
) -> bool:  # fmt: skip
    """Add J^T W J and J^T W r of all observations, and leave their whitened residuals; False as in `residuals`."""
    table, je, block = room_for_view(marks)
    cols, runs = np.empty(SHARED, np.int64), np.empty((4, 2), np.int64)
    for i in range(scene.view_camera.shape[0]):
        shared, used = _view_columns(scene, columns, i, cols, runs)
        first, marked = marks.starts[i], marks.starts[i + 1] - marks.starts[i]
        if not _view_rows(marks, scene, units, columns, i, table, je, block):
            return False
        for m in range(marked):
            residual[first + m, 0], residual[first + m, 1] = table[shared, 2 * m], table[shared, 2 * m + 1]
            if use_weight:
                root = math.sqrt(weight[first + m])
                for b in range(shared + 1):
                    table[b, 2 * m], table[b, 2 * m + 1] = table[b, 2 * m] * root, table[b, 2 * m + 1] * root
                for b in range(9):
                    je[m, 0, b], je[m, 1, b] = je[m, 0, b] * root, je[m, 1, b] * root
        _add_shared(table, shared, 2 * marked, cols, into.h_dd, into.g_d)
        _add_blocks(into.h_ed, into.h_ee, into.g_e, block[:marked], table, je, runs[:used], shared)
        _add_points(into, columns.point, marks.points[first : first + marked], block, table, je, cols, shared)
    return True


@nb.njit(cache=True, nogil=True)
def room_for_view(marks: Marks) -> tuple[Array, Array, Ints]:
    """Derivatives of a view: (SHARED + 1, 2 M) by dense parameters, residual last; (M, 2, 9) by block and point.

    And (M,) for the block of each mark.
    """
    most = 0
    for i in range(marks.starts.shape[0] - 1):
        most = max(most, marks.starts[i + 1] - marks.starts[i])
    return np.empty((SHARED + 1, 2 * most)), np.empty((most, 2, 9)), np.empty(most, np.int64)


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST | {"reassoc"})
def _add_shared(table: Array, shared: int, length: int, cols: Ints, h_dd: Array, g_d: Array) -> None:
    """Products of the dense columns that all marks of a view have; the residuals are the row behind them."""
    for a in range(shared):
        for b in range(a, shared + 1):
            total = 0.0
            for m in range(length):
                total += table[a, m] * table[b, m]
            if b < shared:
                h_dd[cols[a], cols[b]] += total
            else:
                g_d[cols[a]] += total


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _add_blocks(
    h_ed: Array, h_ee: Array, g_e: Array, block: Ints, table: Array, je: Array, runs: Ints, shared: int
) -> None:
    """Products of the marks' eliminated blocks with themselves and with the dense columns of the view.

    Three rows of a block together, as many as a point has: so every number of the table is read once for them.
    """
    size = h_ee.shape[1]
    for m in range(block.shape[0]):
        e, r0, r1 = block[m], table[shared, 2 * m], table[shared, 2 * m + 1]
        if e < 0:
            continue
        for a in range(size):
            u, v = je[m, 0, a], je[m, 1, a]
            g_e[e * size + a] += u * r0 + v * r1
            for b in range(size):
                h_ee[e, a, b] += u * je[m, 0, b] + v * je[m, 1, b]
        for a in range(0, size, 3):
            u0, u1, u2, row = je[m, 0, a], je[m, 0, a + 1], je[m, 0, a + 2], e * size + a
            v0, v1, v2, at = je[m, 1, a], je[m, 1, a + 1], je[m, 1, a + 2], 0
            for k in range(runs.shape[0]):
                start, length = runs[k, 0], runs[k, 1]
                for b in range(length):
                    p, q = table[at + b, 2 * m], table[at + b, 2 * m + 1]
                    h_ed[row, start + b] += u0 * p + v0 * q
                    h_ed[row + 1, start + b] += u1 * p + v1 * q
                    h_ed[row + 2, start + b] += u2 * p + v2 * q
                at += length


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _add_points(
    into: Equations, point: Ints, marked: Ints, block: Ints, table: Array, je: Array, cols: Ints, shared: int
) -> None:
    """Products of the marks' dense points; their derivatives are behind those of the block."""
    size = into.h_ee.shape[1]
    for m in range(marked.shape[0]):
        column, r0, r1 = point[marked[m]], table[shared, 2 * m], table[shared, 2 * m + 1]
        for a in range(3 if column >= 0 else 0):
            u, v = je[m, 0, 6 + a], je[m, 1, 6 + a]
            into.g_d[column + a] += u * r0 + v * r1
            for b in range(shared):
                into.h_dd[cols[b], column + a] += u * table[b, 2 * m] + v * table[b, 2 * m + 1]
            for b in range(a, 3):
                into.h_dd[column + a, column + b] += u * je[m, 0, 6 + b] + v * je[m, 1, 6 + b]
            if block[m] >= 0:
                for b in range(size):
                    into.h_ed[block[m] * size + b, column + a] += u * je[m, 0, b] + v * je[m, 1, b]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def jacobian_rows(
    marks: Marks, scene: Scene, units: Units, columns: Columns, jd: Array, je: Array, cols: Ints, block: Ints
) -> None:
    """Whitened derivatives of every observation: (O, 2, K), (O, 2, b), their columns (O, K), and its block (O,)."""
    table, own, blocks = room_for_view(marks)
    shared_cols, runs = np.empty(SHARED, np.int64), np.empty((4, 2), np.int64)
    jd[:], je[:], cols[:] = 0.0, 0.0, -1
    for i in range(scene.view_camera.shape[0]):
        shared, _ = _view_columns(scene, columns, i, shared_cols, runs)
        _view_rows(marks, scene, units, columns, i, table, own, blocks)
        for m in range(marks.starts[i + 1] - marks.starts[i]):
            o = marks.starts[i] + m
            block[o], column = blocks[m], columns.point[marks.points[o]]
            for k in range(2):
                for b in range(shared):
                    jd[o, k, b], cols[o, b] = table[b, 2 * m + k], shared_cols[b]
                for b in range(3):
                    if column >= 0:
                        jd[o, k, shared + b], cols[o, shared + b] = own[m, k, 6 + b], column + b
                for b in range(je.shape[2]):
                    je[o, k, b] = own[m, k, b] if block[o] >= 0 else 0.0


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _view_rows(
    marks: Marks, scene: Scene, units: Units, columns: Columns, i: int, table: Array, je: Array, block: Ints
) -> bool:
    """Whitened derivatives of the marks of view i: by the shared dense parameters, by the block, by a dense point.

    The residuals are in the row behind the dense parameters. False as in `residuals`.
    """
    xy, shift, good = marks.xy, marks.shift, True
    points, white, xyz, held = marks.points, marks.white, scene.xyz, columns.held
    point_column, point_block = columns.point, columns.point_block
    frame, member, offset, camera, sensor, factor = view_of(scene, i)
    frame_pivot, offset_pivot = _pivots(scene, units, i)
    c, f, a = scene.view_camera[i], scene.view_frame[i], scene.view_offset[i]
    by_offset, by_frame = member and columns.offset[a] >= 0, columns.frame[f] >= 0
    frame_block, unit, change = columns.frame_block[f], units.point, columns.change
    fx, dc = camera[0] * factor, np.empty((2, INTERIOR))
    free, scale = np.empty(INTERIOR, np.int64), np.empty(INTERIOR)
    fy = fx * camera[1]
    interior, tilted = 0, False
    for k in range(INTERIOR):
        if columns.camera[c, k] >= 0:
            free[interior], scale[interior] = k, units.camera[c, k]
            interior += 1
            tilted = tilted or k == 9 or k == 10
    for m in range(marks.starts[i + 1] - marks.starts[i]):
        o, count = marks.starts[i] + m, interior
        p, w = points[o], (white[o, 0], white[o, 1], white[o, 2])
        xb = moved(frame, xyz[p, 0], xyz[p, 1], xyz[p, 2])
        xc = moved(offset, xb[0], xb[1], xb[2]) if member else xb
        u, v, iz, ud, vd, jxx, jxy, jyy, jxz, jyz, along, t, seen = lens(camera, xc[0], xc[1], xc[2])
        sx, sy, taa, tab, tba, tbb, qw = tilted_sensor(sensor, ud, vd)
        good = good and seen > 0.0 and qw > 0.0
        t00, t01, t10, t11 = interior_rows(camera, factor, (u, v, along, t, sx, sy, taa, tab, tba, tbb), w, dc)
        if tilted:
            tilt_rows(scene.tilt, c, camera, factor, (sx, sy, ud, vd, qw), w, dc)
        for b in range(interior):
            table[b, 2 * m], table[b, 2 * m + 1] = dc[0, free[b]] * scale[b], dc[1, free[b]] * scale[b]
        t00, t01, t10, t11 = t00 * iz, t01 * iz, t10 * iz, t11 * iz
        d = (t00 * jxx + t01 * jxy, t00 * jxy + t01 * jyy, t00 * jxz + t01 * jyz)
        e = (t10 * jxx + t11 * jxy, t10 * jxy + t11 * jyy, t10 * jxz + t11 * jyz)
        if member:
            if by_offset:
                put_rows(table, count, 2 * m, pose_row(d, xc, offset_pivot), pose_row(e, xc, offset_pivot))
                count += 6
            d, e = turned(offset, d), turned(offset, e)
        block[m] = -1
        if by_frame or frame_block >= 0:
            row, next_row = pose_row(d, xb, frame_pivot), pose_row(e, xb, frame_pivot)
            if by_frame:
                put_rows(table, count, 2 * m, row, next_row)
                count += 6
            else:
                block[m] = frame_block
                for b in range(6):
                    je[m, 0, b], je[m, 1, b] = row[b], next_row[b]
        for k in range(CHANGE):
            if change[i, k] >= 0:
                # By the relative change: the focal length itself times the sensor coordinates.
                to, by = (0, camera[0] / factor) if k == 0 else (k + 1, units.change[i, k])
                table[count, 2 * m], table[count, 2 * m + 1] = dc[0, to] * by, dc[1, to] * by
                count += 1
        dx = fx * (sx + camera[16] * sy) + camera[2] + shift[o, 0] - xy[o, 0]
        dy = fy * sy + camera[3] + shift[o, 1] - xy[o, 1]
        table[count, 2 * m], table[count, 2 * m + 1] = w[0] * dx, w[1] * dx + w[2] * dy
        if point_column[p] >= 0 or point_block[p] >= 0:
            d, e = turned(frame, d), turned(frame, e)
            at = 6 if point_column[p] >= 0 else 0
            if at == 0:
                block[m] = point_block[p]
            for b in range(3):
                step = 0.0 if held[p, b] else unit
                je[m, 0, at + b], je[m, 1, at + b] = d[b] * step, e[b] * step
    return good


@nb.njit(cache=True, nogil=True)
def _pivots(scene: Scene, units: Units, i: int) -> tuple[Numbers, Numbers]:
    """Pivot and scale of the frame and of the rig member of a view."""
    f, a = scene.view_frame[i], scene.view_offset[i]
    frame = (units.frame_pivot[f, 0], units.frame_pivot[f, 1], units.frame_pivot[f, 2], units.frame_scale[f])
    if a < 0:
        return frame, frame
    at = units.offset_pivot
    return frame, (at[a, 0], at[a, 1], at[a, 2], units.offset_scale[a])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _view_columns(scene: Scene, columns: Columns, i: int, cols: Ints, runs: Ints) -> tuple[int, int]:
    """Dense columns, ascending, that all marks of a view have; their number, and that of their runs (first, length)."""
    c, f, a, count, used = scene.view_camera[i], scene.view_frame[i], scene.view_offset[i], 0, 0
    for k in range(INTERIOR):
        if columns.camera[c, k] >= 0:
            cols[count] = columns.camera[c, k]
            count += 1
    if count > 0:
        runs[0, 0], runs[0, 1], used = cols[0], count, 1
    offset = columns.offset[a] if a >= 0 else -1
    change, changes = -1, 0
    for k in range(CHANGE - 1, -1, -1):
        if columns.change[i, k] >= 0:
            change, changes = columns.change[i, k], changes + 1
    for start, size in ((offset, 6), (columns.frame[f], 6), (change, changes)):
        if start >= 0:
            for k in range(size):
                cols[count + k] = start + k
            runs[used, 0], runs[used, 1] = start, size
            count, used = count + size, used + 1
    return count, used
