"""How points lie on the surface that should bear them, and which motion of it brings them there."""

import numpy as np
import pytest

from windmark import synth
from windmark.geometry import Pose
from windmark.resection.seat import OFF, Seat, seat
from windmark.scene import Mesh


@pytest.fixture(scope="module")
def tunnel():
    test = synth.wind_tunnel(11, nodes=4000, clutter=None)
    return test.mesh, test.markers.xyz[test.markers.role != "wall"]


def changed(mesh, apply):
    return Mesh(apply(mesh.vertices), mesh.triangles, mesh.volume)


def test_markers_on_their_grid_need_nothing(tunnel):
    found = seat(*tunnel)
    assert (found.moved, found.axes, found.lead) == (None, None, 0.0)
    assert found.most < 1e-6 * found.size


@pytest.mark.parametrize(
    ("turn_deg", "shift", "scale"),
    [((0, 0, 0), (0, 0, 0.002), 1.0), ((0, 0, 1), (0, 0, 0), 1.0), ((0.3, 0, 0), (0.001, 0.002, 0), 1.0),
     ((0, 0, 0), (0, 0, 0), 1.01)],
)  # fmt: skip
def test_a_grid_that_was_moved_is_brought_back(tunnel, turn_deg, shift, scale):
    mesh, xyz = tunnel
    turn = Pose.exp(np.r_[np.radians(turn_deg), 0, 0, 0]).rotation
    middle = xyz.mean(axis=0)

    def away(p):
        return scale * ((p - middle) @ turn.T + middle) + np.array(shift) * mesh.size

    found = seat(changed(mesh, away), xyz)
    assert found.moved is not None
    assert found.lead > 50
    assert found.moved.scale == pytest.approx(1 / scale, abs=1e-4)
    # What it brings the moved grid's markers back to are the markers: but for what slides along the surface.
    back = found.moved.apply(away(xyz))
    assert seat(mesh, back).most < 1e-5 * mesh.size
    truth = float(np.sqrt(((away(xyz) - xyz) ** 2).sum(axis=1).mean()))
    assert 0.3 * truth < found.shift < 1.3 * truth


def test_exchanged_axes_are_named(tunnel):
    mesh, xyz = tunnel
    found = seat(changed(mesh, lambda p: p[:, [0, 2, 1]] * [1, 1, -1]), xyz)
    assert found.most > OFF * found.size
    assert found.axes is not None
    assert found.axes.tolist() == [[1, 0, 0], [0, 0, -1], [0, 1, 0]]


def test_scatter_is_no_motion(tunnel):
    mesh, xyz = tunnel
    rng = np.random.default_rng(3)
    for sigma in (1e-4, 1e-3):
        found = seat(mesh, xyz + rng.normal(0, sigma * mesh.size, xyz.shape))
        assert found.moved is None
        assert 0.05 * sigma < found.most / mesh.size < sigma


def test_a_part_that_the_grid_has_not_moves_nothing(tunnel):
    mesh, xyz = tunnel
    beside = xyz.copy()
    beside[: 2 * len(xyz) // 3] += 0.3 * mesh.size
    found = seat(mesh, beside)
    assert (found.moved, found.axes) == (None, None)
    assert found.most < 1e-6 * found.size


def test_few_points_tell_no_motion(tunnel):
    mesh, xyz = tunnel
    found = seat(changed(mesh, lambda p: p + np.array([0, 0, 0.002 * mesh.size])), xyz[:7])
    assert isinstance(found, Seat)
    assert found.moved is None
    assert found.most > 1e-4 * found.size


def test_wrong_shapes_are_refused(tunnel):
    for wrong in (np.zeros((0, 3)), np.zeros((3, 2))):
        with pytest.raises(ValueError, match="seat: xyz must be"):
            seat(tunnel[0], wrong)
