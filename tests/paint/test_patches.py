"""Patches: what is covered, how they are filled, and that the sigma of the fill covers."""

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.errors import UsageError
from windmark.paint import NodeField, disc_nodes, fill_patches, polygon_nodes

sys.path.insert(0, str(Path(__file__).parent))
from paint_shapes import plate, sphere


def wavy(xyz, wave, phase):
    return 1 + 0.3 * np.sin(xyz @ wave + phase)


@pytest.mark.parametrize("length", [0.6, 1.5, 6.0])
def test_sigma_of_the_fill_covers_whatever_the_field(length):
    mesh = plate(121, 91)
    z = []
    for seed in range(7):
        rng = np.random.default_rng(seed)
        wave = 2 * np.pi / length * np.array([np.cos(seed), np.sin(seed), 0])
        true = wavy(mesh.vertices, wave, seed)
        number = disc_nodes(mesh, rng.uniform(-1, 1, (12, 3)) * [1.7, 1.2, 0], 0.12)
        field = NodeField.make(np.where(number >= 0, 0.2, true + 0.003 * rng.normal(size=len(true))), 0.003)
        got = fill_patches(mesh, field, number)
        assert got.tested > 10
        on = got.filled
        z.append((got.field.value - true)[on] / got.field.sigma[on])
        assert (got.field.sigma[on] >= got.misfit[on]).all()
    z = np.concatenate(z)
    assert 0.9 < np.mean(np.abs(z) < 1.96) < 0.99


def test_a_smooth_field_is_filled_far_better_than_by_the_mean_round_it():
    mesh = plate(121, 91)
    true = wavy(mesh.vertices, np.array([2.0, 1.0, 0]), 0.3)
    number = disc_nodes(mesh, [[0.3, 0.2, 0]], 0.2)
    got = fill_patches(mesh, NodeField.make(np.where(number >= 0, np.nan, true)), number)
    off = np.abs(got.field.value - true)[number >= 0]
    assert off.max() < 0.02 * np.ptp(true[number >= 0])


def test_discs_know_their_side():
    mesh = sphere(80)
    both = disc_nodes(mesh, [[0, 0, 1.0]], 2.1)
    one = disc_nodes(mesh, [[0, 0, 1.0]], 2.1, [[0, 0, 1.0]])
    assert (both == 0).all()
    assert (mesh.vertices[one == 0, 2] > -0.05).all()
    nearest = disc_nodes(plate(), [[-0.5, 0, 0], [0.5, 0, 0]], 1.0)
    assert set(nearest[np.abs(plate().vertices[:, 1]) < 0.1]) == {-1, 0, 1}
    with pytest.raises(UsageError, match="radii above zero"):
        disc_nodes(mesh, [[0, 0, 1.0]], 0.0)


def test_a_polygon_covers_its_side_only():
    mesh = sphere(120)
    square = np.array([[-0.3, -0.3, 0.95], [0.3, -0.3, 0.95], [0.3, 0.3, 0.95], [-0.3, 0.3, 0.95]])
    inside = polygon_nodes(mesh, square)
    expected = (np.abs(mesh.vertices[:, :2]) < 0.3).all(axis=1) & (mesh.vertices[:, 2] > 0)
    assert (inside == expected)[np.abs(np.abs(mesh.vertices[:, :2]).max(axis=1) - 0.3) > 1e-6].all()
    with pytest.raises(UsageError, match="on one line"):
        polygon_nodes(mesh, [[0, 0, 0], [1, 0, 0], [2, 0, 0]])


def test_patches_of_single_nodes_are_measured_on_single_nodes():
    mesh = plate(61, 45)
    true = wavy(mesh.vertices, np.array([2.0, 1.0, 0]), 0.3)
    number = np.where(np.arange(len(true)) % 97 == 0, np.arange(len(true)), -1)
    got = fill_patches(mesh, NodeField.make(np.where(number >= 0, 9.0, true), 0.0), number)
    assert got.tested > 10
    assert got.misfit.max() < 0.01


def test_nothing_to_fill_and_no_room_for_tests():
    mesh = plate()
    field = NodeField.make(mesh.vertices[:, 0], 0.1)
    none = fill_patches(mesh, field, np.full(len(field), -1))
    assert none.field is field
    assert not none.filled.any()
    most = np.linalg.norm(mesh.vertices, axis=1) < 1.4
    got = fill_patches(mesh, field, most)
    assert got.tested == 0
    assert (got.misfit[most] > 0.5).all()
