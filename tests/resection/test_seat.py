"""How points lie on the surface that should bear them, and which motion of it brings them there."""

import numpy as np
import pytest

from windmark import synth
from windmark.geometry import Pose
from windmark.resection.facets import bulge
from windmark.resection.seat import OFF, Seat, seat
from windmark.scene import Mesh, structured_triangles


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


def test_two_columns_exchanged_are_named_too_though_they_leave_a_mirrored_frame(tunnel):
    mesh, xyz = tunnel
    found = seat(changed(mesh, lambda p: p[:, [2, 1, 0]]), xyz)
    assert found.axes is not None
    assert found.axes.tolist() == [[0, 0, 1], [0, 1, 0], [1, 0, 0]]
    assert found.mirror is None


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


def test_points_above_a_surface_of_another_state_are_named(tunnel):
    """A wing that is bent at its tip in the grid, not in the table; what is beside a part's end says nothing."""
    mesh, xyz = tunnel
    tip, reach = xyz[:, 1] > 0.75 * xyz[:, 1].max(), xyz[:, 1].max()

    def bent(p):
        return p + np.array([0, 0, 0.2 * mesh.size]) * np.maximum(p[:, 1:2] / reach - 0.7, 0) ** 2

    assert len(seat(mesh, xyz).off) == 0
    found = seat(changed(mesh, bent), xyz)
    assert found.most < OFF * mesh.size
    assert 2 <= len(found.off) <= tip.sum()
    assert tip[found.off].all()
    np.testing.assert_allclose(found.by, found.distance[found.off])
    inner = mesh.vertices[mesh.triangles, 1].max(axis=1) < 0.9 * xyz[tip, 1].min()
    part = Mesh(mesh.vertices, mesh.triangles[inner], mesh.volume[inner])
    assert len(seat(part, xyz).off) == 0


def test_points_on_what_stands_on_the_surface_are_not_off_it():
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9)))
    above = np.array([[0.5, 0.4, 0.01], [0.3, 0.6, 0.012], [0.6, 0.6, 0.0]])
    plate = Mesh.make(np.stack([x, y, np.zeros_like(x)], axis=1), structured_triangles(9, 9))
    fin, pod = np.array([[1.0, 0, 0]] * 3), np.array([[0.0, 0, 1]] * 3)
    assert len(seat(plate, above, fin).off) == 0
    assert seat(plate, above, pod).off.tolist() == seat(plate, above).off.tolist() == [0, 1]
    # Below it by far, and facing as it does: inside of the model. Facing away: the other side of a plate.
    below = above - [0, 0, 0.1]
    assert seat(plate, below, pod).off.tolist() == [0, 1, 2]
    assert len(seat(plate, below, -pod).off) == len(seat(plate, below).off) == 0


def ellipsoid(around, scale=1.0):
    """Of half axes 300, 90 and 60, so many nodes round it, all on it; and places on it, with normals."""
    half = np.array([300.0, 90.0, 60.0])
    lon, lat = np.meshgrid(np.linspace(0, 2 * np.pi, around), np.linspace(0, np.pi, 2 * around))
    unit = np.stack([np.cos(lat), np.sin(lat) * np.cos(lon), np.sin(lat) * np.sin(lon)], axis=-1).reshape(-1, 3)
    mesh = Mesh.make(scale * half * unit, structured_triangles(around, 2 * around))
    on = np.random.default_rng(5).normal(size=(70, 3))
    on /= np.linalg.norm(on, axis=1, keepdims=True)
    normal = on / half
    return mesh, half * on, normal / np.linalg.norm(normal, axis=1, keepdims=True)


@pytest.mark.parametrize("around", [19, 25, 31, 45])
def test_markers_on_a_curved_surface_are_not_beside_its_coarse_facets(around):
    mesh, xyz, normal = ellipsoid(around)
    found = seat(mesh, xyz, normal)
    assert (found.moved, found.axes, len(found.off)) == (None, None, 0)


def test_a_coarse_grid_of_another_size_is_still_named():
    mesh, xyz, normal = ellipsoid(31, 0.98)
    found = seat(mesh, xyz, normal)
    assert found.moved is not None
    assert found.moved.scale == pytest.approx(1.02, abs=0.006)


def test_the_facets_of_a_circle_lie_below_it_by_its_sagitta():
    turn, y = np.meshgrid(np.radians(np.arange(0, 361, 15.0)), [0.0, 1.0])
    tube = Mesh.make(np.stack([np.cos(turn), y, np.sin(turn)], axis=-1).reshape(-1, 3), structured_triangles(25, 2))
    edge = np.full((len(tube.triangles), 2), [0.5, 0.0])  # the middle between the first and the second corner
    above = bulge(tube, np.arange(len(tube.triangles)), edge)
    chord = np.abs(tube.vertices[tube.triangles[:, 0]] - tube.vertices[tube.triangles[:, 1]])[:, 0] > 1e-9
    middle = tube.vertices[tube.triangles].mean(axis=1) * [1, 0, 1]
    outward = np.sign(np.einsum("tk,tk->t", tube.triangle_normals(), middle))
    np.testing.assert_allclose((outward * above)[chord], 1 - np.cos(np.radians(7.5)), rtol=0.01)
    box = Mesh.make(np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float),
                    np.array([[0, 2, 3], [0, 3, 1], [0, 1, 5], [0, 5, 4]]))  # fmt: skip
    assert (bulge(box, np.arange(4), np.full((4, 2), 1 / 3)) == 0).all()
