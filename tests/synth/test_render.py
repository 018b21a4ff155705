from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet, Mesh
from windmark.synth import Decals, Marks, Paint, Rays, World, marker_truth, render
from windmark.synth.screen import Screen, pixel_boxes


def circle_share(center, radius, shape, n=101):
    """Share of each pixel inside a circle, by n x n sub-pixels."""
    height, width = shape
    x = (np.arange(width * n) + 0.5) / n - 0.5 - center[0]
    y = (np.arange(height * n) + 0.5) / n - 0.5 - center[1]
    inside = x**2 + y[:, None] ** 2 <= radius**2
    return inside.reshape(height, n, width, n).mean(axis=(1, 3))


def centroid(weight):
    y, x = np.indices(weight.shape)
    return np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.31, -0.17), (0.5, 0.49)])
def test_facing_disc_is_the_exact_circle(make_plate, tilted_view, offset):
    """Every pixel's share to 1e-3, area to 1e-4, centroid to 2e-3 px of the circle's own pixel centroid."""
    camera = Camera((41, 37), 1000.0)
    world = make_plate([np.array([offset[0], -offset[1]])])
    r = render(world, camera, tilted_view(0.0))
    dark = (1 - r.image) / 0.8
    share = circle_share(np.array([20 + offset[0], 18 + offset[1]]), 3.0, (37, 41))
    np.testing.assert_allclose(r.markers.xy[0], [20 + offset[0], 18 + offset[1]], atol=1e-9)
    assert np.abs(dark - share).max() < 1.5e-3
    assert dark.sum() == pytest.approx(np.pi * 9, rel=3e-4)
    np.testing.assert_allclose(centroid(dark), centroid(share), atol=5e-4)


@pytest.mark.parametrize("tilt", [30.0, 60.0])
def test_tilted_disc_through_a_lens(make_plate, tilted_view, lens, tilt):
    """Area and centroid of the dark light are those of the truth's ellipse, for discs all over the image."""
    rng = np.random.default_rng(int(tilt))
    gx, gy = np.meshgrid(np.linspace(-60, 60, 5), np.linspace(-50, 50, 4))
    xy = np.column_stack([gx.ravel(), gy.ravel()]) + rng.uniform(-3, 3, (20, 2))
    world = make_plate(xy, radius=4.0)
    r = render(world, lens, tilted_view(tilt))
    t = r.markers
    assert t.visible.all()
    error = []
    for k in range(20):
        x, y = np.rint(t.xy[k]).astype(int)
        window = (slice(y - 8, y + 9), slice(x - 8, x + 9))
        dark = (1 - r.image[window]) / 0.8
        assert dark.sum() == pytest.approx(np.pi * t.axes_px[k].prod(), rel=1e-3)
        error.append(centroid(dark) + np.array([x - 8, y - 8]) - t.ellipse_xy[k])
    # The centroid of pixel means differs from the area's by the sampling of a sharp edge: rms some 0.003 px.
    assert np.sqrt(np.mean(np.square(error))) < 6e-3
    assert np.abs(np.mean(error, axis=0)).max() < 2.5e-3


def test_marker_takes_its_share_of_the_light(make_plate, tilted_view):
    """Paint is multiplicative: with and without markers the images differ by the factor 1 - c inside a disc."""
    rng = np.random.default_rng(0)
    paint = Paint.random(rng, {"wing": 0.8}, [(300, 0, 700, 5e5)], grain=0.02)
    camera = Camera((60, 60), 1000.0)
    world = make_plate([[4.0, 7.0]], radius=6.0, paint=paint)
    with_disc = render(world, camera, tilted_view(20.0)).image
    without = render(replace(world, marker_contrast=0.0), camera, tilted_view(20.0)).image
    ratio = with_disc / without
    assert ratio.min() == pytest.approx(0.2, abs=1e-12)
    assert np.sort(ratio.ravel())[-3000:].min() == pytest.approx(1.0, abs=1e-12)
    assert without.std() > 0.005


def test_smooth_pixels_hold_the_light_of_their_point(make_plate, tilted_view, lens):
    paint = Paint.random(np.random.default_rng(1), {"wing": 0.8}, [(300, 0, 700, 5e5)], grain=0.0)
    world = make_plate(np.zeros((0, 2)), paint=paint)
    r = render(world, lens, tilted_view(35.0))
    seen = r.triangle >= 0
    assert seen.mean() > 0.6
    xyz = r.xyz
    assert np.isnan(xyz[~seen]).all()
    np.testing.assert_allclose(xyz[seen][:, 2], 0, atol=1e-9)
    back, _ = lens.project(r.cam_from_tunnel.apply(xyz[seen]))
    y, x = np.nonzero(seen)
    np.testing.assert_allclose(back, np.column_stack([x, y]), atol=1e-8)
    truth = paint.intensity(xyz[seen], np.tile([0, 0, 1.0], (seen.sum(), 1)), "wing")
    inner = np.zeros_like(seen)
    inner[1:-1, 1:-1] = (
        seen[1:-1, 1:-1] & seen[:-2, 1:-1] & seen[2:, 1:-1] & seen[1:-1, :-2] & seen[1:-1, 2:]
        & seen[:-2, :-2] & seen[2:, 2:] & seen[:-2, 2:] & seen[2:, :-2]
    )  # fmt: skip
    np.testing.assert_allclose(r.image[inner], truth[inner[seen]], rtol=2e-4)


@pytest.mark.parametrize("angle", [0.0, 0.2, 0.7, np.pi / 2])
def test_an_outline_gives_each_pixel_its_share(angle):
    """A large triangle's edge across the image: every pixel's mean against the exactly cut square."""
    from windmark.synth._kernels import box_share

    camera = Camera((48, 40), 500.0, cx=23.3, cy=19.8)
    gx, gy = np.cos(angle), np.sin(angle)
    edge = np.array([[gy, -gx], [-gy, gx]]) * 3000
    inner = np.array([-gx, -gy]) * 3000
    corners = np.vstack([edge, inner])  # pixels from the principal point; gx x + gy y <= 0 is inside
    vertices = np.column_stack([corners / 500, np.ones(3)]) * 7
    mesh = Mesh.make(vertices, np.array([[0, 1, 2]]), "wing")
    for m in (mesh, replace(mesh, triangles=mesh.triangles[:, ::-1].copy())):
        if render(World(m, _none(), Paint()), camera, Pose.identity()).image.max() > 0:
            break
    r = render(World(m, _none(), Paint()), camera, Pose.identity())
    y, x = np.indices((40, 48))
    expected = np.vectorize(lambda i, j: box_share(-((i - 23.3) * gx + (j - 19.8) * gy), gx, gy))(x, y)
    error = r.image - expected
    assert np.abs(error).max() < 0.045
    assert error[np.abs(expected - 0.5) < 0.5].std() < 0.012
    assert abs(error.sum()) / ((expected > 0) & (expected < 1)).sum() < 0.004
    assert (np.abs(error[(expected == 0) | (expected == 1)]) == 0).all()


@pytest.mark.parametrize("volume", ["wall", "wing"])
def test_hidden_discs(make_plate, volume):
    """A screen in front of the plate hides the discs behind it: fraction against the exact geometry."""
    xy = np.array([[-40.0, 0], [-3.0, 1], [0.0, 20], [2.0, -20], [40.0, 5]])
    world = make_plate(xy, radius=5.0)
    # A screen in the half space x > 0 (seen along -z), 20 above the plate, of another or the discs' own volume.
    corners = np.array([[0, -80, 20.0], [100, -80, 20], [100, 80, 20], [0, 80, 20]])
    front = Mesh.make(corners, np.array([[0, 1, 2], [0, 2, 3]]), volume)
    plate = world.mesh
    both = Mesh(
        np.vstack([plate.vertices, front.vertices]),
        np.vstack([plate.triangles, front.triangles + len(plate.vertices)]).astype(np.int32),
        np.concatenate([plate.volume, front.volume]),
    )
    camera = Camera((300, 300), 1e6)
    pose = Pose.look_at([0, 0, 1e6], [0, 0, 0], [0, 1, 0])
    r = render(replace(world, mesh=both, paint=Paint({"wing": 0.5, "wall": 0.5})), camera, pose)
    share = np.array([1.0, _left_of(3.0), _left_of(0.0), _left_of(-2.0), 0.0])
    np.testing.assert_allclose(r.markers.fraction, share, atol=0.02)
    assert r.markers.visible.tolist() == [True, False, False, False, False]
    assert r.markers.facing.all()
    x = np.rint(r.markers.xy[:, 0]).astype(int)
    y = np.rint(r.markers.xy[:, 1]).astype(int)
    assert r.image[y[0], x[0]] == pytest.approx(0.1)
    assert r.image[y[4], x[4]] == pytest.approx(0.5)  # the disc behind leaves no trace on the screen


def test_outline_before_the_same_volume(make_plate):
    """A plate's edge before another part of its own volume: the pixels on the edge hold both lights."""
    world = make_plate(np.zeros((0, 2)), paint=Paint(lamps=np.array([[0.0, 0, 4000, 1.6e7]])))
    corners = np.array([[0.3, -80, 100.0], [100, -80, 100], [100, 80, 100], [0.3, 80, 100]])
    plate = world.mesh
    both = replace(
        plate,
        vertices=np.vstack([plate.vertices, corners]),
        triangles=np.vstack([plate.triangles, np.array([[0, 1, 2], [0, 2, 3]]) + len(plate.vertices)]).astype(np.int32),
        volume=np.concatenate([plate.volume, ["wing", "wing"]]),
    )
    image = render(
        replace(world, mesh=both), Camera((31, 21), 1e6), Pose.look_at([0, 0, 1e6 + 100], [0, 0, 100], [0, 1, 0])
    ).image
    left, edge, right = image[10, 14], image[10, 15], image[10, 16]
    assert 1.04 < right / left < 1.06  # too small a step to be noticed by the light alone
    # The edge lies at x = 15 + 0.3: 0.2 of that pixel is in front.
    assert edge == pytest.approx(0.8 * left + 0.2 * right, rel=0.001)


@pytest.mark.parametrize("k1", [-0.35, 0.25])
def test_large_triangles_bend_under_the_lens(k1):
    """Two triangles that nearly fill a strongly distorted image are seen exactly where their plane says."""
    camera = Camera((161, 121), 130.0, k1=k1)
    corners = np.array([[-50.0, -38, 100], [-50, 38, 100], [50, 38, 100], [50, -38, 100]])
    mesh = Mesh.make(corners, np.array([[0, 1, 2], [0, 2, 3]]), "wing")
    r = render(World(mesh, _none(), Paint()), camera, Pose.identity())
    x, y = np.moveaxis(r.uv * 100, -1, 0)
    np.testing.assert_array_equal(r.triangle >= 0, (np.abs(x) <= 50) & (np.abs(y) <= 38))
    assert 0.2 < (r.triangle >= 0).mean() < 0.99


def _left_of(edge, radius=5.0):
    """Share of a disc left of a line at a distance ``edge`` from its centre."""
    t = np.clip(edge / radius, -1, 1)
    return 1 - (np.arccos(t) - t * np.sqrt(1 - t * t)) / np.pi


@pytest.mark.slow
def test_visible_against_brute_force(small_test):
    """Each marker's centre ray is tried on every triangle: centre hidden means not visible, and back."""
    shot = small_test.shot("wind-on")
    mesh, markers, t = shot.world.mesh, shot.world.markers, shot.perfect.markers
    eye = shot.perfect.cam_from_tunnel.center
    a = mesh.vertices[mesh.triangles[:, 0]]
    e1, e2 = mesh.vertices[mesh.triangles[:, 1]] - a, mesh.vertices[mesh.triangles[:, 2]] - a
    clear = np.zeros(len(markers), dtype=bool)
    for k, p in enumerate(markers.xyz):
        d = p - eye
        q = np.cross(d, e2)
        det = np.einsum("tk,tk->t", e1, q)
        s = eye - a
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.einsum("tk,tk->t", s, q) / det
            w = np.cross(s, e1)
            v, at = w @ d / det, np.einsum("tk,tk->t", e2, w) / det
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (at > 1e-9)
        clear[k] = not (at[hit] < 1 - 1e-3).any()
    inside = t.in_image & clear
    assert t.visible.sum() > 25
    assert (t.fraction[~clear] < 0.6).all()
    assert (inside | ~t.visible).all()
    # Every marker with a clear centre that faces the camera and lies well inside is visible.
    well = inside & t.facing & (np.degrees(t.tilt) < 80)
    well &= ((t.xy > 5) & (t.xy < np.array([474, 378]))).all(axis=1)
    assert (t.visible[well]).all()


@pytest.mark.slow
def test_subpixels_only_where_needed_change_little(small_test):
    """The adaptive image against one with many samples in every pixel, on a part with everything in it."""
    from windmark.synth.render import _Painter, _Shader

    shot = small_test.shot("wind-on")
    p, world = shot.perfect, shot.world
    rays = Rays.of(p.camera)
    screen = Screen.of(world.mesh, p.camera, p.cam_from_tunnel, rays.bend)
    decals = Decals.join([world.dirt, Decals.of_markers(world.markers, world.marker_contrast)])
    where = np.zeros(p.image.shape, dtype=bool)
    where[20:120, 250:380] = True
    painter = _Painter(screen, rays, decals, p.camera, p.cam_from_tunnel)
    full = _Shader(world, screen, rays, 0.0)(painter.sample(where, 16), where)[where]
    error = p.image[where] - full
    assert np.sqrt(np.mean(error**2)) < 2e-3
    assert abs(error.mean()) < 1e-4
    assert np.quantile(np.abs(error), 0.99) < 0.01


def test_back_faces_and_emptiness(make_plate):
    world = make_plate([[0.0, 0.0]])
    behind = Pose.look_at([0, 0, -1000.0], [0, 0, 0], [0, 1, 0])
    r = render(world, Camera((500, 400), 1000.0), behind, background=0.3)
    assert set(np.unique(r.image[100:300, 100:400].round(12))) <= {0.0, 0.3} | set(r.image[r.image % 0.3 > 0].round(12))
    assert r.image[200, 250] == 0.0  # the back of the plate is black
    assert r.image[0, 0] == 0.3
    assert not r.markers.facing[0]
    assert not r.markers.visible[0]
    away = render(world, Camera((50, 40), 1000.0), Pose.look_at([0, 0, 1000.0], [0, 0, 2000.0], [0, 1, 0]))
    assert (away.image == 0).all()
    assert (away.triangle == -1).all()
    assert not away.markers.visible.any()
    assert np.isnan(away.markers.xy).all()


def test_a_mesh_that_reaches_behind_the_camera(make_plate):
    """Triangles with corners behind the camera, and corners beyond the lens, are still seen where they are."""
    floor = np.array([[-900.0, 20, -900], [900, 20, -900], [900, 20, 900], [-900, 20, 900]])
    camera = Camera((80, 60), 60.0, k1=-0.25)
    for order in ([[0, 1, 2], [0, 2, 3]], [[0, 2, 1], [0, 3, 2]]):
        mesh = Mesh.make(floor, np.array(order), "wing")
        r = render(World(mesh, _none(), Paint()), camera, Pose.identity())
        below = np.isfinite(r.xyz[..., 1])
        assert 0.3 < below.mean() < 0.6
        np.testing.assert_allclose(r.xyz[below][:, 1], 20, atol=1e-9)


def test_dirt_of_every_shape_keeps_its_area(make_plate, tilted_view):
    """A speck, strokes, a ring and a rectangle laid on the plate take exactly their area of light."""
    marks = Marks.make(
        [[-30, 20], [30, 20], [-30, -20], [30, -20], [0, 0]],
        half=[[0, 0], [8, 0], [0, 0], [7, 3], [9, 0]],
        outer=[0.4, 0.35, 4.0, 0.01, 0.02],
        inner=[-1, -1, 3.0, -1, -1],
        angle=[0, 0.4, 0, 1.1, 0.6],
        contrast=0.5,
    )
    areas = [np.pi * 0.16, 16 * 0.7 + np.pi * 0.35**2, np.pi * 7, 14 * 6 + 40 * 0.01, 18 * 0.04]
    plate = make_plate(np.zeros((0, 2)))
    world = replace(plate, dirt=Decals.on_surface(marks, [0, 0, 0], [0, 0, 1.0], "wing"))
    camera = Camera((120, 100), 1300.0)
    image = render(world, camera, tilted_view(0.0)).image
    for k, (x, y) in enumerate(marks.center):
        i, j = 59.5 + 1.3 * x, 49.5 - 1.3 * y
        part = image[int(j) - 13 : int(j) + 15, int(i) - 13 : int(i) + 15]
        assert ((1 - part) / 0.5).sum() == pytest.approx(areas[k] * 1.3**2, rel=0.012), k


def test_no_noise_and_same_bytes(make_plate, tilted_view, lens):
    world = make_plate([[10.0, 5.0]])
    images = [render(world, lens, tilted_view(25.0)).image for _ in range(2)]
    assert images[0].tobytes() == images[1].tobytes()
    shared = render(world, lens, tilted_view(25.0), rays=Rays.of(lens)).image
    assert shared.tobytes() == images[0].tobytes()
    flat = images[0][20:60, 60:140]  # no disc and no border there: unit light, unit image
    assert (flat == 1.0).all()


def test_rays_are_the_inverse_lens(lens):
    x, y = np.meshgrid(np.arange(200.0), np.arange(160.0))
    exact = lens.unproject(np.stack([x, y], axis=-1))[..., :2]
    rays = Rays.of(lens)
    np.testing.assert_allclose(rays.uv[..., :2] * 900, exact * 900, atol=1e-8)
    half = lens.unproject(np.stack([x + 0.4, y - 0.3], axis=-1))[..., :2]
    near = rays.uv[..., :2] + 0.4 * rays.uv[..., [2, 4]] - 0.3 * rays.uv[..., [3, 5]]
    np.testing.assert_allclose(near * 900, half * 900, atol=3e-4)
    folding = Camera((120, 100), 60.0, k1=-0.3)
    uv = Rays.of(folding).uv
    expected = folding.unproject(np.stack(np.meshgrid(np.arange(120.0), np.arange(100.0)), axis=-1))[..., :2]
    np.testing.assert_array_equal(np.isnan(uv[..., 0]), np.isnan(expected[..., 0]))
    assert np.isnan(uv[..., 0]).any()
    np.testing.assert_allclose(uv[..., :2], expected, atol=1e-12)


def test_boxes_hold_every_hit(small_test):
    shot = small_test.shot()
    p = shot.perfect
    boxes = Screen.of(shot.world.mesh, p.camera, p.cam_from_tunnel, 1e-4).boxes
    y, x = np.nonzero(p.triangle >= 0)
    b = boxes[p.triangle[y, x]]
    assert ((b[:, 0] <= x) & (x <= b[:, 1]) & (b[:, 2] <= y) & (y <= b[:, 3])).all()
    none = pixel_boxes(np.array([[np.inf, 3.0]]), np.array([[-np.inf, 5.0]]), (10, 10))[0]
    assert none[1] < none[0]
    np.testing.assert_array_equal(
        pixel_boxes(np.array([[-np.inf] * 2]), np.array([[np.inf] * 2]), (9, 7)), [[0, 8, 0, 6]]
    )


def test_bad_input(make_plate, tilted_view, lens):
    world = make_plate([[0.0, 0.0]])
    with pytest.raises(ValueError, match="subpixels"):
        render(world, lens, tilted_view(0.0), subpixels=0)
    nameless = replace(world.markers, radius=np.array([np.nan]))
    with pytest.raises(ValueError, match="radius and normal"):
        render(replace(world, markers=nameless), lens, tilted_view(0.0))
    # The truth of such a marker is still its centre.
    t = marker_truth(nameless, lens, tilted_view(0.0), world.mesh)
    assert t.visible[0]
    assert np.isnan(t.ellipse_xy).all()


def _none():
    return MarkerSet.make([], np.zeros((0, 3)), radius=np.zeros(0), normal=np.zeros((0, 3)))


@pytest.mark.parametrize("tilt", [30.0, 60.0])
def test_a_disc_on_a_tube_is_laid_round_it(make_plate, tilted_view, lens, tilt):
    """Its area and centroid are those of the truth, 0.05 to 0.2 px beside a flat one's, whatever the mesh under it."""
    world = make_plate([[-40, 0], [0, 0], [30, 25], [10.3, -31.6], [-22.4, 17.7]], radius=4.0)
    world = replace(world, markers=replace(world.markers, curvature=np.tile(np.diag([1 / 40, 0, 0]), (5, 1, 1))))
    t = (r := render(world, lens, tilted_view(tilt))).markers
    flat = marker_truth(replace(world.markers, curvature=np.zeros((5, 3, 3))), lens, tilted_view(tilt))
    error = []
    for k in range(5):
        x, y = np.rint(t.xy[k]).astype(int)
        dark = (1 - r.image[y - 8 : y + 9, x - 8 : x + 9]) / 0.8
        assert dark.sum() == pytest.approx(np.pi * t.axes_px[k].prod(), rel=4e-3)
        error.append(centroid(dark) + np.array([x - 8, y - 8]) - t.ellipse_xy[k])
        assert np.linalg.norm(flat.ellipse_xy[k] - t.ellipse_xy[k]) > 0.05
    assert np.sqrt(np.mean(np.square(error))) < 6e-3
