"""The kernels' work in plain NumPy: for machines without numba's compiler, and to check the kernels.

Same answers to rounding, some ten times slower.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network._arrays import CHANGE, INTERIOR, ROOM, Columns, Equations, Marks, Scene, Units
from windmark.geometry.camera_jacobian import project_jacobian
from windmark.geometry.rotations import hat

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def residuals(marks: Marks, scene: Scene, out: Array) -> bool:
    """See `_kernels.residuals`."""
    xy, valid = _projected(marks, scene)[:2]
    d = xy + marks.shift - marks.xy
    out[:, 0] = marks.white[:, 0] * d[:, 0]
    out[:, 1] = marks.white[:, 1] * d[:, 0] + marks.white[:, 2] * d[:, 1]
    return bool(valid.all())


def jacobian_rows(
    marks: Marks, scene: Scene, units: Units, columns: Columns, jd: Array, je: Array, cols: Ints, block: Ints
) -> None:
    """See `_kernels.jacobian_rows`."""
    width = jd.shape[2]
    jd, cols, jd_out, cols_out = np.zeros((len(jd), 2, ROOM)), np.full((len(jd), ROOM), -1), jd, cols
    _rows_in_place(marks, scene, units, columns, jd, je, cols, block)
    used = np.argsort(cols < 0, axis=1, kind="stable")[:, :width]
    cols_out[:] = np.take_along_axis(cols, used, axis=1)
    jd_out[:] = np.take_along_axis(jd, used[:, None], axis=2)


def _rows_in_place(
    marks: Marks, scene: Scene, units: Units, columns: Columns, jd: Array, je: Array, cols: Ints, block: Ints
) -> None:
    """The same with a place of its own for every possible column, in `ROOM`; unused ones are zero and -1."""
    i, p = marks.views, marks.points
    c, f, a = scene.view_camera[i], scene.view_frame[i], scene.view_offset[i]
    _, _, d_xyz, d_cam, xb, xc = _projected(marks, scene)
    rig = a >= 0
    jd[:], je[:], cols[:], block[:] = 0.0, 0.0, -1, -1

    def put(start: int, column: Ints, rows: Array) -> None:
        size = rows.shape[2]
        cols[:, start : start + size] = np.where(column[:, None] < 0, -1, column[:, None] + np.arange(size))
        jd[:, :, start : start + size] = np.where(column[:, None, None] < 0, 0.0, rows)

    camera = columns.camera[c]
    cols[:, :INTERIOR] = camera
    jd[:, :, :INTERIOR] = np.where(camera[:, None] < 0, 0.0, d_cam * units.camera[c][:, None])
    if rig.any():
        rows = _pose_rows(d_xyz, xc, units.offset_pivot[a], units.offset_scale[a])
        put(INTERIOR, np.where(rig, columns.offset[a], -1), rows)
        d_xyz = np.where(rig[:, None, None], d_xyz @ scene.offset_r[a], d_xyz)
    rows = _pose_rows(d_xyz, xb, units.frame_pivot[f], units.frame_scale[f])
    put(INTERIOR + 6, columns.frame[f], rows)
    # By the relative change: the focal length itself times the sensor coordinates.
    by_factor = d_cam[:, :, 0] * (scene.camera[c, 0] / scene.change[i, 0])[:, None]
    for k, by_change in enumerate((by_factor, d_cam[:, :, 2], d_cam[:, :, 3])):
        put(INTERIOR + 12 + k, columns.change[i, k], (by_change * units.change[i, k, None])[:, :, None])
    at_point = (d_xyz @ scene.frame_r[f]) * np.where(columns.held[p], 0.0, units.point)[:, None]
    put(INTERIOR + 12 + CHANGE, columns.point[p], at_point)
    if je.shape[2] == 6:
        block[:] = columns.frame_block[f]
        je[:] = np.where(block[:, None, None] < 0, 0.0, rows)
    else:
        block[:] = columns.point_block[p]
        je[:] = np.where(block[:, None, None] < 0, 0.0, at_point)
    white = np.zeros((len(i), 2, 2))
    white[:, 0, 0], white[:, 1, 0], white[:, 1, 1] = marks.white.T
    jd[:], je[:] = white @ jd, white @ je


def accumulate(
    marks: Marks, scene: Scene, units: Units, columns: Columns, residual: Array, weight: Array, use_weight: bool,
    into: Equations,
) -> bool:  # fmt: skip
    """See `_kernels.accumulate`."""
    if not residuals(marks, scene, residual):
        return False
    h_dd, h_ed, h_ee, g_d, g_e = into
    o, size = len(marks.views), h_ee.shape[1]
    jd, je = np.zeros((o, 2, ROOM)), np.zeros((o, 2, size))
    cols, block = np.zeros((o, ROOM), np.int64), np.zeros(o, np.int64)
    _rows_in_place(marks, scene, units, columns, jd, je, cols, block)
    root = np.sqrt(weight) if use_weight else np.ones(o)
    jd, je, r = jd * root[:, None, None], je * root[:, None, None], residual * root[:, None]
    # One row of scratch more: what has no column or block lands there.
    dense, rows = h_dd.shape[0], h_ee.shape[0]
    to = np.where(cols < 0, dense, cols)
    hdd, gd = np.zeros((dense + 1, dense + 1)), np.zeros(dense + 1)
    np.add.at(hdd, (to[:, :, None], to[:, None, :]), jd.transpose(0, 2, 1) @ jd)
    np.add.at(gd, to, np.einsum("oik,oi->ok", jd, r))
    h_dd += np.triu(hdd[:dense, :dense])
    g_d += gd[:dense]
    own = np.where(block < 0, rows, block)
    hee, ge = np.zeros((rows + 1, size, size)), np.zeros((rows + 1, size))
    np.add.at(hee, own, je.transpose(0, 2, 1) @ je)
    np.add.at(ge, own, np.einsum("oik,oi->ok", je, r))
    h_ee += hee[:rows]
    g_e += ge[:rows].ravel()
    hed = np.zeros((rows + 1, size, dense + 1))
    np.add.at(hed, (own[:, None, None], np.arange(size)[:, None], to[:, None, :]), je.transpose(0, 2, 1) @ jd)
    h_ed += hed[:rows, :, :dense].reshape(rows * size, dense)
    return True


CHUNK = 4_000
"""Observations worked on at a time, for memory."""


def influences(
    jd: Array, je: Array, cols: Ints, block: Ints, dense: Array, cross: Array, blocks: Array, out: Array
) -> None:
    """See `_influence_kernels.influences`."""
    size = je.shape[2]
    for start in range(0, len(jd), CHUNK):
        part = slice(start, start + CHUNK)
        u, w, c, b = jd[part], je[part], np.maximum(cols[part], 0), block[part]
        out[part] = u @ dense[c[:, :, None], c[:, None, :]] @ u.transpose(0, 2, 1)
        own = np.maximum(b, 0)
        if len(blocks):
            between = cross.reshape(len(blocks), size, -1)[own[:, None, None], np.arange(size)[:, None], c[:, None, :]]
            mixed = u @ between.transpose(0, 2, 1) @ w.transpose(0, 2, 1)
            both = w @ blocks[own] @ w.transpose(0, 2, 1) + mixed + mixed.transpose(0, 2, 1)
            out[part] += np.where((b >= 0)[:, None, None], both, 0.0)


def gather(
    jd: Array, je: Array, cols: Ints, block: Ints, b: Array, factor: Array, of: Ints, group: Ints, dense: Array,
    eliminated: Array,
) -> None:  # fmt: skip
    """See `_influence_kernels.gather`."""
    b = (b[..., None] * factor[of][:, None, None]).reshape(len(b), 2, -1)
    size = je.shape[2]
    row = np.where(block[:, None] >= 0, block[:, None] * size + np.arange(size), -1)
    for j, to, out in ((jd, cols, dense), (je, row, eliminated)):
        o, k = np.nonzero((to >= 0) & (group >= 0)[:, None])
        np.add.at(out, (to[o, k], group[o]), np.einsum("mi,min->mn", j[o, :, k], b[o]))


def factor_blocks(h_ee: Array, floor: Array, damping: float, w: Array, y: Array) -> bool:
    """See `_kernels.factor_blocks`."""
    blocks, size = h_ee.shape[:2]
    diagonal = np.arange(size)
    h_ee[:, diagonal, diagonal] += damping * floor
    try:
        h_ee[:] = np.linalg.cholesky(h_ee)
    except np.linalg.LinAlgError:
        return False
    w3, y3 = w.reshape(blocks, size, -1), y.reshape(blocks, size, 1)
    w3[:], y3[:] = np.linalg.solve(h_ee, w3), np.linalg.solve(h_ee, y3)
    return True


def _projected(marks: Marks, scene: Scene) -> tuple[Array, NDArray[np.bool_], Array, Array, Array, Array]:
    """Pixels, validity, derivatives by the camera-frame point and the camera, points in frame and camera."""
    i, p = marks.views, marks.points
    f, a = scene.view_frame[i], scene.view_offset[i]
    xb = np.einsum("oij,oj->oi", scene.frame_r[f], scene.xyz[p]) + scene.frame_t[f]
    xc = xb.copy()
    rig = a >= 0
    if rig.any():
        moved = np.einsum("oij,oj->oi", scene.offset_r[a], xb) + scene.offset_t[a]
        xc = np.where(rig[:, None], moved, xb)
    o = len(i)
    xy, valid = np.zeros((o, 2)), np.zeros(o, bool)
    d_xyz, d_cam = np.zeros((o, 2, 3)), np.zeros((o, 2, INTERIOR))
    # Views differ in their focal length and principal point.
    for view in np.unique(i):
        own = i == view
        packed = scene.camera[scene.view_camera[view]]
        parameters = np.concatenate([packed[:11], packed[12:15], packed[16:]])
        parameters[0] *= scene.change[view, 0]
        parameters[2:4] += scene.change[view, 1:]
        xy[own], valid[own], d_xyz[own], d_cam[own] = project_jacobian(parameters, xc[own], int(packed[15]))
        d_cam[own, :, 0] *= scene.change[view, 0]
    return xy, valid, d_xyz, d_cam, xb, xc


def _pose_rows(d: Array, x: Array, pivot: Array, scale: Array) -> Array:
    """(O, 2, 6) by a turn about the pivot and a shift."""
    return np.concatenate([-(d @ hat(x - pivot)), d * scale[:, None, None]], axis=2)
