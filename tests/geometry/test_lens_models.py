"""The three lens models against their definitions, one point at a time, and where each of them ends."""

from math import atan2, cos, hypot, inf, pi, sin, tan

import numpy as np
import pytest

from windmark.geometry import Camera
from windmark.geometry.lens import FISHEYE, RATIONAL, Lens, distort, distort_jacobian, radial, range2
from windmark.geometry.lens_inverse import fisheye_angles, undistort

RATIONALS = [
    Lens(0.3, -0.1, 1e-3, -5e-4, 0.02, 0.5, -0.05, 0.01, RATIONAL),
    Lens(k4=0.4, k5=0.1, k6=0.02, kind=RATIONAL),
]
FISHEYES = [
    Lens(-0.03, 0.012, 0.0, 0.0, -0.004, 6e-4, kind=FISHEYE),
    Lens(kind=FISHEYE),
    Lens(0.1, 0.05, k3=0.02, k4=0.01, kind=FISHEYE),
]
BROWNS = [Lens(-0.25, 0.08, 1e-3, -7e-4, -0.01), Lens()]


def image(x, y, z, lens):
    """Distorted point by the formulas of OpenCV's documentation."""
    k1, k2, p1, p2, k3, k4, k5, k6, kind = lens
    if kind == FISHEYE:
        angle, across = atan2(hypot(x, y), z), hypot(x, y)
        size = angle * (1 + k1 * angle**2 + k2 * angle**4 + k3 * angle**6 + k4 * angle**8)
        return (x / across * size, y / across * size) if across else (0.0, 0.0)
    a, b = x / z, y / z
    r2 = a * a + b * b
    factor = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    if kind == RATIONAL:
        factor /= 1 + k4 * r2 + k5 * r2**2 + k6 * r2**3
    return (
        a * factor + 2 * p1 * a * b + p2 * (r2 + 2 * a * a),
        b * factor + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b,
    )


def camera_of(lens):
    k1, k2, p1, p2, k3, k4, k5, k6, kind = lens
    return Camera((400, 300), 1.0, 1.0, 0.0, 0.0, k1, k2, p1, p2, k3, k4=k4, k5=k5, k6=k6,
                  lens=("brown", "rational", "fisheye")[kind])  # fmt: skip


def directions(count=60, widest=1.0):
    rng = np.random.default_rng(7)
    angle, turn, far = rng.uniform(0, widest, count), rng.uniform(0, 2 * pi, count), rng.uniform(0.1, 9, count)
    xyz = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], axis=1)
    return far[:, None] * np.concatenate([xyz, [[0.0, 0.0, 1.0]]])[: len(far)]


@pytest.mark.parametrize("lens", [*BROWNS, *RATIONALS, *FISHEYES])
def test_images_are_those_of_the_formulas(lens):
    xyz = directions(widest=2.5 if lens.kind == FISHEYE else 0.8)
    camera = camera_of(lens)
    xy, valid = camera.project(xyz)
    assert valid.mean() > 0.7
    expected = np.array([image(*p, lens) for p in xyz.tolist()])
    np.testing.assert_allclose(xy[valid], expected[valid], rtol=1e-12, atol=1e-14)
    # And back: `directions` of the images are those of the points, behind the camera, too.
    unit = xyz / np.linalg.norm(xyz, axis=1, keepdims=True)
    np.testing.assert_allclose(camera.directions(xy[valid]), unit[valid], atol=1e-9)
    ahead = valid & (xyz[:, 2] > 1e-3)
    np.testing.assert_allclose(camera.unproject(xy[ahead]), xyz[ahead] / xyz[ahead, 2:], rtol=1e-8, atol=1e-9)
    if lens.kind == FISHEYE:
        behind = valid & (xyz[:, 2] < -1e-3)
        assert behind.any()
        assert np.isnan(camera.unproject(xy[behind])).all()


@pytest.mark.parametrize("lens", [*BROWNS, *RATIONALS, *FISHEYES])
def test_radial_factor_and_slope_are_those_of_the_curve(lens):
    r = np.array([1e-9, 1e-4, 0.05, 0.3, 0.7])
    factor, slope2 = radial(r**2, lens)
    radius = np.array([image(a, 0.0, 1.0, lens._replace(p1=0.0, p2=0.0))[0] for a in r.tolist()])
    np.testing.assert_allclose(factor * r, radius, rtol=1e-12)
    h = 1e-5
    for a, slope in zip(r[2:].tolist(), slope2[2:], strict=True):
        up, down = (radial(np.array([(a + d) ** 2]), lens)[0][0] for d in (h, -h))
        assert slope * a == pytest.approx((up - down) / (2 * h), rel=1e-6, abs=1e-9)
    # On the axis the slope is the limit of those beside it.
    on, beside = radial(np.array([0.0]), lens)[1][0], radial(np.array([1e-6]), lens)[1][0]
    assert on == pytest.approx(beside, rel=1e-4, abs=1e-5)
    p = np.random.default_rng(3).uniform(-0.5, 0.5, (20, 2))
    columns = [(distort(p + d, lens)[0] - distort(p - d, lens)[0]) / (2 * h) for d in h * np.eye(2)]
    np.testing.assert_allclose(distort_jacobian(p, lens), np.stack(columns, -1), atol=1e-8)


def fold(lens, most):
    """First squared radius (angle) at which the image stops growing, by looking along it."""
    r = np.linspace(0, most, 400_001)[1:]
    k1, k2, _, _, k3, k4, k5, k6, kind = lens
    s = r * r
    size = r * (1 + s * (k1 + s * (k2 + s * (k3 + (s * k4 if kind == FISHEYE else 0.0)))))
    if kind == RATIONAL:
        below = 1 + s * (k4 + s * (k5 + s * k6))
        ends = np.flatnonzero(below <= 0)
        size = size / below
        if len(ends):
            size = size[: ends[0]]
    falls = np.flatnonzero(np.diff(size) <= 0)
    return r[falls[0]] ** 2 if len(falls) else (r[len(size) - 1] ** 2 if len(size) < len(r) else inf)


@pytest.mark.parametrize(
    "lens",
    [Lens(-0.2, kind=RATIONAL), Lens(k4=0.5, kind=RATIONAL), Lens(k4=-0.3, kind=RATIONAL),
     Lens(0.1, 0.05, 0, 0, -0.02, 0.05, 0.01, kind=RATIONAL), Lens(k5=0.2, kind=RATIONAL), Lens(k6=0.3, kind=RATIONAL),
     Lens(-0.1, k4=-0.2, k6=0.01, kind=RATIONAL), Lens(-0.2, kind=FISHEYE), Lens(0.0, -0.05, kind=FISHEYE),
     Lens(k3=-0.02, kind=FISHEYE), Lens(k4=-0.004, kind=FISHEYE), Lens(0.05, -0.03, 0, 0, 0.004, -6e-4, kind=FISHEYE)],
)  # fmt: skip
def test_the_range_ends_where_two_directions_share_an_image(lens):
    end = range2(lens)
    expected = fold(lens, pi if lens.kind == FISHEYE else 6.0)
    if expected == inf:
        assert end >= (pi * pi if lens.kind == FISHEYE else 36)
        return
    assert end == pytest.approx(expected, rel=1e-4)
    camera, r = camera_of(lens), float(np.sqrt(end))
    for part, seen in ((0.999, True), (1.001, False)):
        a = part * r
        point = [sin(a), 0.0, cos(a)] if lens.kind == FISHEYE else [a, 0.0, 1.0]
        xy, valid = camera.project([point])
        assert valid.tolist() == [seen]
        assert np.isfinite(xy).all() == seen
        assert camera.project_jacobian([point])[1].tolist() == [seen]
        if lens.kind != FISHEYE or a < pi / 2:  # in front it is a plane's point, too
            plane = tan(a) if lens.kind == FISHEYE else a
            assert distort(np.array([[0.0, plane]]), lens)[1].tolist() == [seen]


def test_a_fisheye_lens_sees_up_to_straight_behind():
    assert range2(Lens(kind=FISHEYE)) == pi * pi
    camera = camera_of(Lens(kind=FISHEYE))
    for angle, seen in ((3.1, True), (pi, False)):
        assert camera.project([[np.sin(angle), 0.0, np.cos(angle)]])[1].tolist() == [seen or angle < pi]
    assert camera.project([[0.0, 0.0, -2.0]])[1].tolist() == [False]
    xy, valid = camera.project([[0.0, 0.0, 3.0], [1e-9, 0.0, 1.0], [1.0, 0, 0], [1e200, 0, 1e200]])
    assert valid.all()
    np.testing.assert_allclose(xy, [[0, 0], [1e-9, 0], [pi / 2, 0], [pi / 4, 0]], rtol=1e-12, atol=1e-20)


def test_inverse_angles_are_those_of_the_images():
    for lens in FISHEYES:
        end = min(np.sqrt(range2(lens)), pi)
        angle = np.linspace(0.0, 0.999 * end, 40)
        s = angle**2
        size = angle * (1 + s * (lens.k1 + s * (lens.k2 + s * (lens.k3 + s * lens.k4))))
        q = np.stack([0.6 * size, -0.8 * size], axis=1)
        np.testing.assert_allclose(fisheye_angles(q, lens), angle, atol=1e-9)
        assert np.isnan(fisheye_angles(q[-1:] * 3, lens)).all()
        ahead = angle < 1.5
        ideal = undistort(q[ahead], lens)
        np.testing.assert_allclose(ideal, [[0.6 * tan(a), -0.8 * tan(a)] for a in angle[ahead]], rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize(
    "lens", [Lens(k4=-0.3, kind=RATIONAL), Lens(-0.1, k4=-0.2, kind=RATIONAL), *RATIONALS, *BROWNS]
)
def test_the_inverse_holds_up_to_the_end_of_the_model(lens):
    """A rational lens may end at a pole, where its image is infinitely far out."""
    r = min(np.sqrt(range2(lens)), 3.0) * np.array([1e-3, 0.1, 0.5, 0.9, 0.98])
    p = np.stack([0.8 * r, 0.6 * r], axis=1)
    q, valid = distort(p, lens)
    np.testing.assert_allclose(undistort(q[valid], lens), p[valid], rtol=1e-9)
    assert valid[:4].all()


def test_which_lenses_are_a_pinhole():
    assert Lens().none
    assert not Lens(kind=FISHEYE).none  # its image is the angle, no plane's
    assert Lens(kind=RATIONAL).none
    assert not any(Lens(**{k: 0.1}, kind=RATIONAL).none for k in ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"))
