"""Points near the surface: nearest place, the right side of thin parts, values with sigma or a reason."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.geometry import Camera
from windmark.resection import (
    POINT_REASONS,
    Picture,
    map_pixels,
    nearest_on_surface,
    noise_law,
    point_values,
    sample_line,
    sample_points,
    surface_line,
)
from windmark.resection.nearest import nearest_weights
from windmark.resection.sources import prepare
from windmark.scene import Mesh

sys.path.insert(0, str(Path(__file__).parent))
from resection_shapes import box, joined, looking_at, moved, plate, soup, sphere

CAMERA = Camera((320, 240), 420.0)


def wedge(thickness=0.02, n=21):
    """A thin trailing edge: upper and lower side meet at x = 1, ``thickness`` apart at x = 0. Normals outward."""
    top = plate(n, n, (1.0, 1.0))
    x = top.vertices[:, 0] + 0.5
    upper = np.stack([x, top.vertices[:, 1], 0.5 * thickness * (1 - x)], axis=1)
    lower = upper * [1, 1, -1]
    count = len(upper)
    return Mesh.make(np.concatenate([upper, lower]),
                     np.concatenate([top.triangles, top.triangles[:, ::-1] + count]))  # fmt: skip


def slow_nearest(mesh, p, samples=60):
    """Twin: the smallest distance to a dense lattice of points of every triangle."""
    s, t = (v.ravel() for v in np.meshgrid(np.linspace(0, 1, samples), np.linspace(0, 1, samples)))
    s, t = s[s + t <= 1 + 1e-12], t[s + t <= 1 + 1e-12]
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    points = a[:, None] + s[:, None] * (b - a)[:, None] + t[:, None] * (c - a)[:, None]
    return np.linalg.norm(points - p, axis=2).min()


def test_nearest_place_is_that_of_the_slow_twin(rng):
    mesh = soup(rng, 30)
    asked = rng.normal(0, 1.5, (25, 3))
    found = nearest_on_surface(mesh, asked, max_distance=50.0)
    for k in range(25):
        slow = slow_nearest(mesh, asked[k])
        assert found.distance[k] <= slow + 1e-12
        assert found.distance[k] > slow - 0.03
    np.testing.assert_allclose(np.linalg.norm(found.xyz - asked, axis=1), found.distance, atol=1e-12)
    np.testing.assert_allclose(found.on(mesh), found.xyz, atol=1e-12)
    assert (found.barycentric >= -1e-12).all()
    assert (found.barycentric.sum(axis=1) <= 1 + 1e-12).all()


def test_degenerate_triangles_have_a_nearest_point():
    corners = np.array([[[0, 0, 0], [1, 0, 0], [1, 0, 0]], [[0, 0, 0], [1, 0, 0], [2, 0, 0]]], float)
    with np.errstate(all="raise", invalid="ignore", divide="ignore"):
        weights = nearest_weights(corners, np.array([0.25, 1.0, 0.0]))
    assert np.isfinite(weights).all()


def test_points_on_a_sphere_go_straight_onto_it(rng):
    mesh = sphere(48)
    direction = rng.normal(size=(50, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    found = nearest_on_surface(mesh, 1.02 * direction, max_distance=0.05)
    np.testing.assert_allclose(np.linalg.norm(found.xyz, axis=1), 1, atol=0.006)
    assert np.einsum("nk,nk->n", found.normal, direction).min() > 0.98


def test_the_tap_stays_on_its_side_of_a_thin_trailing_edge():
    """0.2 mm of thickness, and a table that is 0.3 off: the nearer side is the wrong one for half of the taps."""
    mesh = wedge(0.02)
    x = np.linspace(0.7, 0.97, 10)
    below = np.stack([x, np.zeros(10), np.full(10, -0.004)], axis=1)  # taps of the upper side, below the lower one
    up = np.tile([0.0, 0.0, 1.0], (10, 1))
    found = nearest_on_surface(mesh, below, normal=up, max_distance=0.02)
    assert (found.triangle < len(mesh.triangles) // 2).all()
    assert (found.normal[:, 2] > 0.9).all()
    assert not found.either_side.any()
    blind = nearest_on_surface(mesh, below, max_distance=0.02)
    assert blind.either_side[x > 0.8].all()  # said, not guessed
    on_it = nearest_on_surface(mesh, mesh.vertices[mesh.triangles[:40]].mean(axis=1))
    assert not on_it.either_side.any()  # a point that lies on the surface is clear


def test_a_volume_holds_its_points():
    mesh = joined(plate(5, 5), moved(plate(5, 5), 0, 0, 0.01))
    named = Mesh.make(mesh.vertices, mesh.triangles, np.repeat(["low", "high"], len(mesh.triangles) // 2))
    asked = np.array([[0.1, 0.1, 0.009], [0.1, 0.1, 0.001]])
    found = nearest_on_surface(named, asked, volume=np.array(["low", "high"]), max_distance=0.1)
    np.testing.assert_allclose(found.xyz[:, 2], [0.0, 0.01], atol=1e-12)


def scene():
    mesh = joined(plate(20, 16), moved(box(4, (0.3, 0.3, 0.3)), 0.6, 0.2, 0.5))
    pose = looking_at((2.0, 0.0, 6.0), up=(0, 1, 0))
    x, y = np.meshgrid(np.arange(320.0), np.arange(240.0))
    return mesh, pose, (500 + 2 * x + y).astype(np.float32)


def test_every_point_has_a_value_or_the_reason():
    mesh, pose, image = scene()
    image[:, :60] = np.nan
    asked = np.array([
        [0.0, -0.8, 0.001],  # fine, a little above
        [0.25, 0.2, 0.0],  # under the box's shadow
        [0.6, 0.2, 0.2],  # the box's lower side
        [0.0, 0.0, 3.0],  # far off
        [np.nan, 0.0, 0.0],
        [1.9, 30.0, 0.0],  # beside the plate
        [-1.9, 0.0, 0.0],  # where the picture has no pixel
    ])  # fmt: skip
    found = sample_points(image, CAMERA, pose, mesh, asked, noise=1.0)
    words = found.words.tolist()
    assert words[0] == ""
    assert words[3] == "far"
    assert words[4] == "no_place"
    assert words[5] == "far"
    assert words[6] in ("no_pixel", "outside")
    assert words[2] in ("facing_away", "hidden")
    np.testing.assert_array_equal(np.isfinite(found.value), found.reason == 0)
    np.testing.assert_array_equal(np.isfinite(found.sigma), found.reason == 0)
    assert abs(found.moved[0] - 0.001) < 1e-9
    xy = CAMERA.project(pose.apply(np.array([0.0, -0.8, 0.0])))[0]
    assert abs(found.value[0] - (500 + 2 * xy[0] + xy[1])) < 0.01


def test_hidden_oblique_and_outside():
    mesh, pose, image = scene()
    behind = sample_points(image, CAMERA, looking_at((6.0, 0.2, 0.6), up=(0, 0, 1)), mesh,
                           [[0.1, 0.2, 0.0], [0.3, 0.2, 0.5]], max_obliquity_deg=60)  # fmt: skip
    assert behind.words.tolist() == ["oblique", "facing_away"]
    hidden = sample_points(image, CAMERA, looking_at((6.0, 0.2, 1.5), up=(0, 0, 1)), mesh, [[0.1, 0.2, 0.0]])
    assert hidden.words.tolist() == ["hidden"]
    narrow = sample_points(image, Camera((320, 240), 3000.0), pose, mesh, [[-1.8, 1.4, 0.0]])
    assert narrow.words.tolist() == ["outside"]


def test_no_points_and_wrong_shapes():
    mesh, pose, image = scene()
    assert len(sample_points(image, CAMERA, pose, mesh, np.zeros((0, 3)))) == 0
    with pytest.raises(ValueError, match=r"xyz must be \(N, 3\)"):
        sample_points(image, CAMERA, pose, mesh, [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="normal must be"):
        sample_points(image, CAMERA, pose, mesh, np.zeros((2, 3)), normal=np.zeros((1, 3)))
    with pytest.raises(ValueError, match="max_distance"):
        sample_points(image, CAMERA, pose, mesh, np.zeros((2, 3)), max_distance=0.0)
    with pytest.raises(ValueError, match="no triangles"):
        nearest_on_surface(Mesh.make(np.zeros((3, 3)), np.zeros((0, 3), np.int32)), np.zeros((1, 3)), max_distance=1.0)


def test_reasons_have_a_word_each():
    assert len(set(POINT_REASONS)) == len(POINT_REASONS)


@pytest.mark.parametrize("interpolation", ["nearest", "linear", "cubic"])
def test_sigma_by_monte_carlo(rng, interpolation):
    """Noise through the interpolation and the pose through the picture's slope, two-sided."""
    mesh, pose, image = scene()
    asked = np.column_stack([rng.uniform(-1.2, 0.0, 60), rng.uniform(-0.9, 0.9, 60), np.zeros(60)])
    cov = np.diag(np.array([4e-4, 4e-4, 1e-3, 2e-3, 2e-3, 5e-3]) ** 2)
    truth = sample_points(image, CAMERA, pose, mesh, asked, noise=0.0).value
    z = []
    for _ in range(40):
        wrong = type(pose).exp(rng.multivariate_normal(np.zeros(6), cov)) @ pose
        noisy = image + 0.5 * rng.normal(size=image.shape)
        found = sample_points(noisy, CAMERA, wrong, mesh, asked, noise=0.5, pose_cov=cov, interpolation=interpolation)
        z.append((found.value - truth) / found.sigma)
    assert 0.85 < np.sqrt(np.nanmean(np.square(z))) < 1.15


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_beside_an_outline_the_sigma_holds_the_other_surface(rng, interpolation):
    """A dark box above a bright plate, four by four rays to the pixel: no value is beyond what it says of itself."""
    mesh, pose, _ = scene()
    fine = Camera((1280, 960), 4 * CAMERA.focal_px, cx=4 * CAMERA.cx + 1.5, cy=4 * CAMERA.cy + 1.5)
    part = np.arange(len(mesh.triangles)) >= len(plate(20, 16).triangles)
    seen = map_pixels(mesh, fine, pose)
    light = np.where(seen.valid, np.where(part[np.maximum(seen.triangle, 0)], 200.0, 1000.0), 0.0)
    image = light.reshape(240, 4, 320, 4).mean(axis=(1, 3)) + rng.normal(size=(240, 320))
    asked = np.column_stack([rng.uniform([-0.2, -0.6], [1.4, 1.0], (2000, 2)), np.zeros(2000)])
    on_box = (np.abs(asked[:, :2] - [0.6, 0.2]) < 0.3).all(axis=1)
    asked[on_box, 2] = 0.8
    found = sample_points(image, CAMERA, pose, mesh, asked, noise=1.0, interpolation=interpolation)
    good = found.reason == 0
    z = np.abs(found.value - np.where(on_box, 200.0, 1000.0))[good] / found.sigma[good]
    assert (z.max() < 6, 0.8 < np.sqrt(np.mean(np.square(z))) < 1.2) == (True, True)
    assert np.mean(found.sigma[good] < 1.1) > 0.8  # most are away from it: their sigma is the noise's
    assert np.sum(found.sigma[good] > 20) > 20


def test_taps_move_with_the_deformed_grid():
    mesh, pose, image = scene()
    bent = Mesh(mesh.vertices + [0, 0, 0.3] * np.abs(mesh.vertices[:, :1]), mesh.triangles, mesh.volume)
    asked = np.array([[-1.0, 0.3, 0.0]])
    points = nearest_on_surface(mesh, asked)
    found = point_values(prepare(Picture("p", image, CAMERA, pose, 1.0), bent, "cubic", "test"), bent, asked, points)
    np.testing.assert_allclose(found.xyz, [[-1.0, 0.3, 0.3]], atol=1e-9)
    np.testing.assert_allclose(found.xy, CAMERA.project(pose.apply(found.xyz))[0])


# --- lines ---------------------------------------------------------------------------------


def test_line_by_number_or_spacing():
    mesh = plate(11, 9)
    line = surface_line(mesh, (-1.5, 0.1, 0), (1.5, 0.1, 0), spacing=0.25)
    np.testing.assert_allclose(np.diff(line.arc), 0.25)
    assert len(surface_line(mesh, (-1.5, 0.1, 0), (1.5, 0.1, 0), n=7).arc) == 7
    assert max(line.gaps) < 1e-9
    for options, message in (({"n": 1}, "at least 2"), ({"n": 3, "spacing": 1.0}, "not both"),
                             ({"spacing": 0.0}, "spacing"), ({"spacing": 1e-9}, "at most")):  # fmt: skip
        with pytest.raises(ValueError, match=message):
            surface_line(mesh, (-1.5, 0.1, 0), (1.5, 0.1, 0), **options)
    with pytest.raises(ValueError, match="must differ"):
        surface_line(mesh, (1, 0.1, 0), (1, 0.1, 0))


def test_a_line_across_a_gap_says_how_far_it_is_from_its_end():
    mesh = joined(moved(plate(9, 9, (1.0, 1.0)), -1, 0, 0), moved(plate(9, 9, (1.0, 1.0)), 1, 0, 0))
    line = surface_line(mesh, (-1.4, 0.05, 0), (1.4, 0.05, 0))
    assert line.gaps[0] + line.gaps[1] > 0.5
    image = np.ones((240, 320), np.float32)
    pose = looking_at((0, 0, 6), up=(0, 1, 0))
    assert sample_line(image, CAMERA, pose, mesh, (-1.4, 0.05, 0), (1.4, 0.05, 0)).gaps == line.gaps


# --- noise ---------------------------------------------------------------------------------


def test_noise_law_of_a_camera(rng):
    """Shot noise over a shaded, textured picture with dark markers: variance 0.2 (v - 64) + 2."""
    x, y = np.meshgrid(np.arange(600.0), np.arange(400.0))
    light = 300 + 3 * x + 60 * np.sin(y / 25)
    light[((x % 80 - 40) ** 2 + (y % 80 - 40) ** 2) < 25] *= 0.2
    image = np.rint(light + 64 + rng.normal(size=light.shape) * np.sqrt(0.2 * light + 2)).astype(np.uint16)
    law = noise_law(image)
    for level in (500.0, 1000.0, 1800.0):
        assert abs(law.variance(level + 64) / (0.2 * level + 2) - 1) < 0.08


def test_noise_law_of_odd_pictures(rng):
    assert noise_law(np.full((50, 60), 7, np.uint8)).variance(7) >= 1 / 12
    assert noise_law(np.full((50, 60), np.nan)).variance(1.0) == 0
    assert noise_law(np.zeros((2, 2))).variance(1.0) == 0
    flat = noise_law(rng.normal(100, 3, (300, 300)))
    assert abs(flat.variance(100) / 9 - 1) < 0.1
    holed = rng.normal(100, 3, (300, 300))
    holed[::7, ::5] = np.nan
    assert abs(noise_law(holed).variance(100) / 9 - 1) < 0.15
    with pytest.raises(ValueError, match=r"\(H, W\)"):
        noise_law(np.zeros((3, 3, 3)))


def test_corners_and_weights_are_the_place_itself():
    mesh = Mesh.make(np.array([[0.0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    found = nearest_on_surface(mesh, [[3.0, 1.0, 0.0], [1.0, 2.0, 0.0], [50.0, 50.0, 50.0]])
    nodes, weights = found.corners(mesh)
    np.testing.assert_allclose(np.einsum("nk,nkj->nj", weights, mesh.vertices[nodes])[:2], found.xyz[:2], atol=1e-12)
    np.testing.assert_allclose(weights.sum(axis=1), [1, 1, 0], atol=1e-12)
    np.testing.assert_array_equal(nodes[:2], mesh.triangles[found.triangle[:2]])
