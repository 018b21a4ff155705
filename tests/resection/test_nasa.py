"""The 14-zone grid of NASA's open test data: 309,062 nodes against the answer of plain geometry."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.resection import map_pixels, orient_outward, section, see_nodes
from windmark.resection.reasons import HIDDEN
from windmark.scene import Mesh, structured_triangles

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "nasa-upsp-cam5"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="real data (nasa-upsp-cam5) not beside the checkout")

BODIES = (([-18.5, -5.0, -7.25], [18.5, 5.0, -7.0]), ([-6.5, -1.0, -7.0], [-5.5, 1.0, -5.0]))  # plate and block


@pytest.fixture(scope="module")
def grid():
    """The grid, straight from its records: the reader of `windmark.io` is not what is tested here."""
    raw, records, at = (DATA / "fml_tc3_volume.grid").read_bytes(), [], 0
    while at < len(raw):
        size = int.from_bytes(raw[at : at + 4], "little")
        records.append(raw[at + 4 : at + 4 + size])
        at += size + 8
    vertices, triangles = np.zeros((0, 3)), []
    for shape, zone in zip(np.frombuffer(records[1], "<i4").reshape(-1, 3).tolist(), records[2:], strict=True):
        ni, nj = (n for n in shape if n > 1)
        triangles.append(structured_triangles(ni, nj, first=len(vertices)))
        vertices = np.concatenate([vertices, np.frombuffer(zone, "<f4", 3 * ni * nj).reshape(3, -1).T])
    return Mesh.make(vertices, np.concatenate(triangles))


def view_of(number):
    record = json.loads((DATA / f"camera0{number}_35_6.json").read_text())
    k, d = np.array(record["uPSP_cameraMatrix"]), record["distCoeffs"][0]
    camera = Camera((1280, 800), k[0, 0], k[1, 1] / k[0, 0], k[0, 2] + 640, k[1, 2] + 400, *d)
    return camera, Pose(np.array(record["rmat"]), np.array(record["tvec"]))


def passes_through(points, eye, low, high):
    """Length of the line from points to the eye inside a box, as a part of it; <= 0 if it stays outside."""
    step = eye - points
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - points) / step, (high - points) / step
    return np.minimum(np.maximum(a, b).min(axis=1), 1) - np.maximum(np.minimum(a, b).max(axis=1), 0)


@pytest.mark.parametrize("number", [1, 5])
@pytest.mark.parametrize("two_sided", [False, True])
def test_visible_nodes(grid, number, two_sided):
    camera, pose = view_of(number)
    view = see_nodes(grid, camera, pose, two_sided=two_sided)
    eye, nodes = pose.center, grid.vertices
    in_picture = camera.in_image(camera.project(pose.apply(nodes))[0])
    # Surely free: the line stays out of the bodies but for rounding. Surely hidden: it enters them by more
    # than the tolerance (1e-5 of the diagonal, 4e-4 in). Between the two lie nodes on edges and ridges.
    least, most = (
        np.max([passes_through(nodes, eye, np.array(low) + d, np.array(high) - d) for low, high in BODIES], axis=0)
        for d in (2e-3, 1e-6)
    )
    normals = grid.vertex_normals()
    facing = np.ones(len(nodes), bool) if two_sided else np.einsum("vk,vk->v", normals, eye - nodes) > 0
    clear = ~facing | ~in_picture | (least > 0) | (most <= 0)
    assert clear.mean() > 0.995
    np.testing.assert_array_equal(view.visible[clear], (in_picture & facing & (most <= 0))[clear])
    assert view.visible.sum() > 70_000
    if number == 1:
        assert ((view.reason == HIDDEN) & clear).sum() > 250  # behind the block


@pytest.mark.slow
def test_mixed_orientation_is_mended(grid):
    half = grid.triangles.copy()
    for zone in (slice(0, 4000), slice(300_000, 500_000)):
        half[zone] = half[zone][:, ::-1]
    mended = orient_outward(Mesh.make(grid.vertices, half))
    assert (np.einsum("tk,tk->t", mended.triangle_normals(), grid.triangle_normals()) > 0).all()


def test_pixels_and_a_cut(grid):
    camera, pose = view_of(5)
    pixel_map = map_pixels(grid, camera, pose)
    xyz = pixel_map.xyz()[pixel_map.valid]
    np.testing.assert_allclose(xyz[:, 2], -7, atol=1e-5)  # camera 5 sees the plate's top and nothing else
    xy, _ = camera.project(pose.apply(xyz))
    rows, columns = np.nonzero(pixel_map.valid)
    assert np.abs(xy - np.stack([columns, rows], axis=1)).max() < 1e-6
    cut = section(grid, [0, 0.013, -7], [0, 1, 0])
    assert cut.closed.tolist() == [True]  # once round plate and block, over twelve zones
    assert cut.arc[-1] == pytest.approx(2 * (37 + 0.25 + 2), abs=1e-5)
