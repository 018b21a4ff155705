"""What holds for any camera: projecting and unprojecting are inverse wherever they are defined, and say where not."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from windmark.geometry import Camera, Pose, triangulate
from windmark.geometry.lens import max_radius2

LAWS = settings(max_examples=80, deadline=None)


@st.composite
def cameras(draw, strength=1.0, tilt=0.3):
    def number(low, high):
        return draw(st.one_of(st.floats(low, high), st.just(0.0)))

    width, height = draw(st.integers(100, 5000)), draw(st.integers(100, 5000))
    return Camera(
        (width, height),
        draw(st.floats(0.3, 10)) * width,
        draw(st.floats(0.9, 1.1)),
        (0.5 + number(-0.1, 0.1)) * width,
        (0.5 + number(-0.1, 0.1)) * height,
        k1=strength * number(-0.5, 0.5),
        k2=strength * number(-0.3, 0.3),
        p1=strength * number(-5e-3, 5e-3),
        p2=strength * number(-5e-3, 5e-3),
        k3=strength * number(-0.1, 0.1),
        tilt_x=number(-tilt, tilt),
        tilt_y=number(-tilt, tilt),
    )


def pixels(camera, seed, n=60):
    w, h = camera.size_px
    return np.random.default_rng(seed).uniform([-0.5, -0.5], [w - 0.5, h - 0.5], (n, 2))


@LAWS
@given(cameras(), st.integers(0, 10**6), st.floats(1e-3, 1e3))
def test_every_pixel_with_a_ray_is_hit_by_it_at_any_depth(camera, seed, depth):
    xy = pixels(camera, seed)
    rays = camera.unproject(xy)
    seen = np.isfinite(rays).all(axis=-1)
    back, valid = camera.project(depth * rays[seen])
    # A ray on the very fold may land on either side of it by rounding; its pixel then has no other.
    assert valid.sum() >= 0.95 * seen.sum()
    np.testing.assert_allclose(back[valid], xy[seen][valid], atol=1e-6)


@LAWS
@given(cameras(), st.integers(0, 10**6))
def test_every_valid_point_comes_back_as_its_ray(camera, seed):
    rng = np.random.default_rng(seed)
    limit = np.sqrt(min(max_radius2(camera.k1, camera.k2, camera.k3), 1.0))
    radius, angle = 0.95 * limit * np.sqrt(rng.uniform(size=80)), rng.uniform(0, 7, 80)
    xyz = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.ones(80)]) * rng.uniform(0.1, 10, (80, 1))
    xy, valid = camera.project(xyz)
    _, _, slope, _ = camera.project_jacobian(xyz[valid])
    # Where the lens is nearly flat (close to a fold of the decentring) pixels say little about rays.
    smallest = np.linalg.svd(slope, compute_uv=False)[:, 1] * xyz[valid, 2] / camera.focal_px
    clear = smallest > 1e-3
    rays = camera.unproject(xy[valid][clear])
    np.testing.assert_allclose(rays, xyz[valid][clear] / xyz[valid][clear, 2:], atol=1e-9)


@LAWS
@given(cameras(strength=2.0), st.integers(0, 10**6))
def test_two_rays_never_share_a_pixel(camera, seed):
    """Beyond the fold a point is invalid, not folded: what is valid stays one to one."""
    rng = np.random.default_rng(seed)
    xyz = np.column_stack([rng.uniform(-3, 3, (200, 2)), np.ones(200)])
    xy, valid = camera.project(xyz)
    assert np.isnan(xy[~valid]).all()
    rays = camera.unproject(xy[valid])
    known = np.isfinite(rays).all(axis=-1)
    again = camera.project(rays[known])[0]
    np.testing.assert_allclose(again, xy[valid][known], rtol=1e-9, atol=1e-5)
    if not (camera.p1 or camera.p2):  # a purely radial lens is monotone up to its fold: the ray itself comes back
        np.testing.assert_allclose(rays[known], xyz[valid][known], atol=1e-4)
        assert known.all()


@LAWS
@given(cameras(), st.integers(0, 10**6), st.floats(0.1, 10))
def test_a_larger_image_of_the_same_camera_scales_its_pixels(camera, seed, factor):
    w, h = camera.size_px
    size = (max(int(w * factor), 1), max(int(h * factor), 1))
    values = camera.parameters()
    values[[0, 2, 3]] *= factor
    other = Camera(size, values[0], *values[1:4]).with_parameters(values)
    xyz = np.column_stack([np.random.default_rng(seed).uniform(-0.3, 0.3, (20, 2)), np.ones(20)])
    a, valid = camera.project(xyz)
    b, valid_b = other.project(xyz)
    np.testing.assert_array_equal(valid, valid_b)
    np.testing.assert_allclose(b[valid], factor * a[valid], rtol=1e-12, atol=1e-9)


@LAWS
@given(cameras(strength=0.3, tilt=0.1), st.integers(0, 10**6), st.floats(0.05, 2))
def test_triangulation_undoes_projection(camera, seed, baseline):
    rng = np.random.default_rng(seed)
    poses = [Pose.look_at([baseline * k, 0.1 * k, 0], [0, 0, 10], [0, -1, 0]) for k in (-1, 0, 1)]
    xyz = np.array([0, 0, 10]) + rng.uniform(-0.5, 0.5, (10, 3))
    views = [camera.project(p.apply(xyz)) for p in poses]
    found = triangulate(camera, poses, np.stack([xy for xy, _ in views]))
    everywhere = np.all([valid for _, valid in views], axis=0) & found.valid
    np.testing.assert_allclose(found.xyz[everywhere], xyz[everywhere], atol=1e-8)
