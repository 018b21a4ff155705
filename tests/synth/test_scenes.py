from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from windmark.synth import Marks, disc_image, marker_scene
from windmark.synth.marks import distance, draw
from windmark.synth.scene_parts import Light, draw_line
from windmark.synth.scenes import KINDS, _Discs, _seen

SIZE = (500, 420)


def residuals(scene, k, half):
    """Residual over noise in a window round marker k against `disc_image` of the truth; which pixels are surface."""
    x0, y0 = np.rint(scene.xy[k]).astype(int) - half
    patch = scene.image[y0 : y0 + 2 * half + 1, x0 : x0 + 2 * half + 1].astype(float)
    infrared = scene.kind == "infrared"
    depth = -scene.depth[k] if infrared else scene.depth[k]
    model = disc_image(
        patch.shape, scene.xy[k] - (x0, y0), scene.axes_px[k], scene.angle[k], level=abs(depth) / scene.contrast[k],
        depth=depth, slope=tuple(scene.slope[k]), blur_px=scene.blur_px[k],
    )  # fmt: skip
    return (patch - model) / scene.noise[k], np.abs(model - np.median(model)) < 0.2 * abs(depth)


@pytest.mark.parametrize("bits", [8, 12])
def test_painted_markers_are_where_and_what_the_truth_says(bits):
    surface, inside = [], []
    for seed in range(3):
        scene = marker_scene(seed, size_px=SIZE, markers=25, bits=bits, texture=0.0)
        flat = np.hypot(*scene.slope.T) < 0.005
        away = ((scene.xy > 16) & (scene.xy < np.array(SIZE) - 17)).all(axis=1)
        for k in np.flatnonzero(flat & away):
            r, plain = residuals(scene, k, 10)
            surface.append(np.mean(r[plain] ** 2))
            inside.append(np.mean(r[~plain] ** 2))
    assert len(surface) > 30
    assert np.median(surface) == pytest.approx(1, abs=0.03)  # some lie where the light bends
    assert 0.4 < np.median(inside) < 1.0  # less light, less shot noise


def test_infrared_markers_are_where_and_what_the_truth_says():
    values = []
    for seed in range(4):
        scene = marker_scene(seed, "infrared", size_px=(400, 300), markers=20)
        away = ((scene.xy > 13) & (scene.xy < np.array((400, 300)) - 14)).all(axis=1)
        values += [np.mean(residuals(scene, k, 9)[0] ** 2) for k in np.flatnonzero(away & ~scene.contaminated)]
    assert np.median(values) == pytest.approx(1, abs=0.06)
    assert np.quantile(values, 0.8) < 1.3


def test_contaminated_markers_differ_from_clean_ones():
    clean, dirty = [], []
    for seed in range(2):
        scene = marker_scene(seed, "cluttered", size_px=(900, 900), bits=12, texture=0.0)
        away = ((scene.xy > 16) & (scene.xy < 900 - 17)).all(axis=1) & (np.hypot(*scene.slope.T) < 0.005)
        for k in np.flatnonzero(away):
            r, _ = residuals(scene, k, int(scene.axes_px[k, 0]) + 2)
            (dirty if scene.contaminated[k] else clean).append(np.mean(r**2))
    assert len(dirty) >= 0.05 * (len(clean) + len(dirty))
    assert np.median(clean) < 1.1
    assert np.mean(dirty) > 2.5 * np.mean(clean)


@pytest.mark.parametrize("kind", KINDS)
def test_same_seed_same_bytes(kind):
    a, b = (marker_scene(7, kind, size_px=SIZE) for _ in range(2))
    assert a.image.tobytes() == b.image.tobytes()
    assert a.xy.tobytes() == b.xy.tobytes()
    assert a.contaminated.tobytes() == b.contaminated.tobytes()
    assert marker_scene(8, kind, size_px=SIZE).image.tobytes() != a.image.tobytes()


def test_numbers_follow_the_area_and_bits_are_as_asked():
    scene = marker_scene(0, "cluttered", size_px=(1024, 1024), bits=10)
    assert len(scene) == round(150 / 4)
    assert scene.image.dtype == np.uint16
    assert 600 < scene.image.max() < 1024
    assert marker_scene(0, size_px=SIZE, bits=8).image.dtype == np.uint8
    assert scene.contaminated.sum() >= 2
    d = np.hypot(*(scene.xy[:, None] - scene.xy).T)
    assert d[~np.eye(len(scene), dtype=bool)].min() > 4 * 5 + 6
    assert not scene.contaminated.all()
    for kind, polarity in (("clean", "dark"), ("infrared", "bright")):
        assert marker_scene(0, kind, size_px=SIZE).polarity == polarity


def test_markers_cut_by_the_border_are_marked():
    scene = marker_scene(5, "clean", size_px=(130, 130), markers=9, radius_px=(5, 5), max_tilt_deg=0)
    inside = ((scene.xy - 5 >= -0.5) & (scene.xy + 5 <= 129.5)).all(axis=1)
    np.testing.assert_array_equal(scene.border, ~inside)
    assert scene.border.any()
    assert inside.any()


def test_rendering_is_the_integral_of_the_product():
    """Light with a curve, a marker and a line across it, against 41 x 41 counted sub-pixels and a fine filter."""
    discs = _Discs(
        np.array([[20.3, 18.8]]), np.array([[4.2, 2.6]]), np.array([0.7]), np.zeros(1), np.zeros(1), np.array([0.8])
    )
    line = Marks.make([20.0, 20.0], angle=0.4, half=(12.0, 0.0), outer=0.8, contrast=0.5)
    light = Light(0.0, np.zeros(2), np.zeros((0, 4)), np.array([[22.0, 20.0, 1.0, 0.0, 9.0, 0.4]]))
    column, row, patch = _seen(discs, 0, light.level, line)
    m, n = 41, len(patch)
    x = column + (np.arange(m * n) + 0.5) / m - 0.5
    y = row + (np.arange(m * n)[:, None] + 0.5) / m - 0.5
    u = np.cos(0.7) * (x - 20.3) + np.sin(0.7) * (y - 18.8)
    v = np.cos(0.7) * (y - 18.8) - np.sin(0.7) * (x - 20.3)
    on_line = distance(line, np.stack(np.broadcast_arrays(x, y), axis=-1))[..., 0] <= 0.8
    fine = light.level(x, y) * ((u / 4.2) ** 2 + (v / 2.6) ** 2 <= 1) * (1 - 0.5 * on_line)
    expected = gaussian_filter(fine, 0.8 * m, truncate=6).reshape(n, m, n, m).mean(axis=(1, 3))
    assert np.abs(patch - expected).max() < 2e-3
    for p in (patch, expected):
        assert p[0].max() < 1e-4  # the window holds the whole marker


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.5, 2.2])
def test_long_lines_are_drawn_as_short_ones(angle):
    image = np.full((90, 110), 2.0)
    line = Marks.make([60.3, 40.8], angle=angle, half=(45.0, 0.0), outer=0.7, contrast=0.4)
    np.testing.assert_allclose(draw_line(image, line), draw(image, line), atol=1e-12)


def test_slope_is_the_gradient_of_the_light():
    light = Light.random(np.random.default_rng(3), (600, 500))
    x, y = np.random.default_rng(4).uniform(0, 500, (2, 200))
    h = 1e-4
    gx = (light.level(x + h, y) - light.level(x - h, y)) / (2 * h * light.level(x, y))
    gy = (light.level(x, y + h) - light.level(x, y - h)) / (2 * h * light.level(x, y))
    np.testing.assert_allclose(light.slope(x, y), np.stack([gx, gy], axis=1), atol=1e-7)
    steepest = np.hypot(*light.slope(*light.edges[:, :2].T).T)
    assert ((steepest > 0.01) & (steepest < 0.05)).all()


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"kind": "foggy"}, "kind"), ({"markers": 60, "size_px": (60, 60)}, "markers"),
        ({"radius_px": (3, 2)}, "radius_px"), ({"max_tilt_deg": 90}, "max_tilt_deg"), ({"blur_px": (0, 1)}, "blur_px"),
    ],
)  # fmt: skip
def test_bad_options_are_named(options, name):
    with pytest.raises(ValueError, match=name):
        marker_scene(0, **options)
