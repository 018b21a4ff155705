"""Distances from the outline of what is seen: where a surface ends, jumps, or runs into another one at an angle."""

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.resection.outlines import CLIFF, FOLD_DEG, inside_px
from windmark.scene import Mesh

CAMERA = Camera((41, 31), 50.0, 1.0, 20.0, 15.0)
ABOVE = Pose.look_at([0.0, 0.0, 10.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
CELL = np.array([[0, 1, 2], [0, 2, 3]])


def quad(x0, x1, z0, z1):
    """A plate across the picture from x0 to x1, its height going from z0 to z1."""
    return np.array([[x0, -50.0, z0], [x1, -50.0, z1], [x1, 50.0, z1], [x0, 50.0, z0]])


def seen(*quads, pose=ABOVE):
    xyz = np.concatenate(quads)
    return inside_px(Mesh.make(xyz, np.concatenate([CELL + 4 * k for k in range(len(quads))])), CAMERA, pose)


def test_a_surface_that_fills_the_picture_has_no_outline():
    assert np.isinf(seen(quad(-50, 50, 0, 0))).all()
    assert not seen(quad(-50, -40, 0, 0)).any()


def test_it_ends_where_nothing_is():
    got = seen(quad(-50, 0.3, 0, 0))
    x = np.arange(41)
    edge = int(np.flatnonzero(got[0] == 0)[0])
    assert edge == 21  # 0.3 at a depth of 10 is 1.5 pixels beside the middle: its last pixel
    np.testing.assert_array_equal(got, np.tile(np.maximum(edge - x, 0), (31, 1)))


@pytest.mark.parametrize(("part", "cliff"), [(0.8, False), (1.2, True)])
@pytest.mark.parametrize("down", [False, True])
def test_a_jump_in_depth_is_an_outline_of_both_sides(part, cliff, down):
    """By more pixel widths than CLIFF, of the nearer depth."""
    high = 10 * part * CLIFF / (50 + part * CLIFF)  # depth 10 - high; jump high = part * CLIFF * (10 - high) / 50
    rolled = Pose.look_at([0.0, 0.0, 10.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    got = seen(quad(-50, 0.05, 0, 0), quad(0.05, 50, high, high), pose=rolled if down else ABOVE)
    line = got[:, 20] if down else got[15]
    if not cliff:
        assert np.isinf(got).all()
        return
    assert np.isfinite(got).all()
    zero = np.flatnonzero(line == 0)
    assert len(zero) == 2
    assert zero[1] == zero[0] + 1


@pytest.mark.parametrize(("angle", "fold"), [(0.85 * FOLD_DEG, False), (1.15 * FOLD_DEG, True)])
def test_two_pieces_that_run_into_each_other_at_an_angle_have_an_outline_between_them(angle, fold):
    slope = np.tan(np.radians(angle))
    flat, wing = quad(-50, 50, 0, 0), quad(-20, 40, -20 * slope - 0.05 * slope, 40 * slope - 0.05 * slope)
    got = seen(flat, wing)  # they cross at x = 0.05, without a node in common
    assert np.isfinite(got).all() == fold
    if fold:
        row = got[15]
        assert sorted(np.argsort(row, kind="stable")[:2].tolist()) == [20, 21]
        assert (row[[20, 21]] == 0).all()
    # The same as one piece, with nodes at the crossing: a bend is no outline.
    bent = seen(quad(-50, 0.05, 0, 0), quad(0.05, 40, 0, 40 * slope - 0.05 * slope))
    assert np.isinf(bent).all()
