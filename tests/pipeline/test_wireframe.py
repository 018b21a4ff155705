"""Visible pieces of grid lines."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.pipeline.wireframe import grid_lines


def slow(xy, seen):
    """One line, node by node."""
    pieces, now = [], []
    for place, there in zip([*xy, None], [*seen, False], strict=True):
        if there:
            now.append(place)
            continue
        if len(now) > 1:
            pieces.append(np.array(now))
        now = []
    return pieces


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9, 1.0])
def test_pieces_are_those_that_are_seen_node_by_node(share):
    rng = np.random.default_rng(7)
    shapes, first, blocks = [(5, 4, 1), (1, 3, 6), (2, 2, 1)], 2, []
    for shape in shapes:
        blocks.append(SimpleNamespace(shape_ijk=shape, first=first))
        first += int(np.prod(shape))
    nodes = SimpleNamespace(xy=rng.normal(size=(first, 2)), visible=rng.random(first) < share)
    found = grid_lines(SimpleNamespace(blocks=blocks), nodes)
    wanted = []
    for block in blocks:
        ni, nj = (n for n in block.shape_ijk if n > 1)
        of = slice(block.first, block.first + ni * nj)
        xy, seen = nodes.xy[of].reshape(nj, ni, 2), nodes.visible[of].reshape(nj, ni)
        wanted += [line for j in range(nj) for line in slow(xy[j], seen[j])]
        wanted += [line for i in range(ni) for line in slow(xy[:, i], seen[:, i])]
    assert len(found) == len(wanted)
    assert all(np.array_equal(a, b) for a, b in zip(found, wanted, strict=True))
    assert (len(found) > 0) == (share > 0)


def test_of_many_lines_the_borders_stay():
    nodes = SimpleNamespace(xy=np.arange(200.0).reshape(100, 2), visible=np.ones(100, bool))
    found = grid_lines(SimpleNamespace(blocks=[SimpleNamespace(shape_ijk=(10, 10, 1), first=0)]), nodes, per_block=3)
    assert len(found) == 6
    assert np.array_equal(found[0], nodes.xy[:10])
    assert np.array_equal(found[2], nodes.xy[90:])
