"""The corrected image: straight, radiometrically better than bilinear, with the camera that it fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes
from scipy import ndimage
from scipy.special import ndtr

from windmark.calibration import corrected_camera, magnified_camera, magnify_distortion, redraw, undistort
from windmark.geometry import Camera
from windmark.geometry.camera import PARAMETERS
from windmark.pipeline.verdict.undistorted import undistort_verdict
from windmark.registration import register
from windmark.scene import Detections

LENS = Camera((320, 240), 300.0, 1.01, 161.3, 117.2, -0.15, 0.05, 2e-3, -1e-3)
CUSHION = Camera((320, 240), 300.0, 1.0, 158.0, 121.0, 0.12, 0.0, 1e-3, 0.0, tilt_x=0.02)
BAR, FROM = 200.0, 20.0


def grid(camera):
    width, height = camera.size_px
    return np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float)


def ideal_places(camera):
    """Where the pixels of a camera lie in the corrected image of the same focal length and principal point."""
    return corrected_camera(camera).project(camera.unproject(grid(camera)))[0]


def edge(xy, angle, offset, sigma=0.8):
    """A straight, slightly blurred edge through the perfect picture."""
    return FROM + BAR * ndtr((xy[..., 0] * np.cos(angle) + xy[..., 1] * np.sin(angle) - offset) / sigma)


def texture(xy):
    """Waves down to 4 pixels."""
    rng = np.random.default_rng(3)
    waves, phase = rng.uniform(-0.25, 0.25, (40, 2)) * 2 * np.pi, rng.uniform(0, 2 * np.pi, 40)
    return 128 + 8 * np.cos(xy @ waves.T + phase).sum(axis=-1)


def edge_places(image, rows):
    """Column where the grey level of each row crosses half height: area of what is brighter."""
    return np.array([len(row) - 0.5 - ((row - FROM) / BAR).sum() for row in image[rows]])


@pytest.mark.parametrize("camera", [LENS, CUSHION], ids=["barrel", "cushion, tilted"])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_straight_edges_become_straight_to_a_tenth_of_a_pixel(camera, kind):
    angle, offset = 0.12, 75.0
    scale = 250 if kind == np.uint16 else 1
    exact = edge(ideal_places(camera), angle, offset) * scale
    taken = (exact if kind == np.float32 else np.rint(exact)).astype(kind)
    corrected = undistort(taken, camera)
    assert corrected.image.dtype == kind
    rows = np.arange(20, 220)
    window = slice(30, 120)  # left of the border, where all is seen
    assert corrected.valid[20:220, window].all()

    def off(image):
        along = edge_places(image[:, window].astype(float) / scale, rows)
        wanted = (offset - rows * np.sin(angle)) / np.cos(angle) - 30
        return along - wanted

    assert np.abs(off(corrected.image)).max() < 0.1
    assert np.ptp(off(taken)) > 1.5  # it was bent


@pytest.mark.parametrize("camera", [LENS, CUSHION], ids=["barrel", "cushion, tilted"])
def test_values_are_nearer_to_the_truth_than_bilinear_ones(camera):
    taken = texture(ideal_places(camera)).astype(np.float32)
    plain = corrected_camera(camera)
    truth = texture(grid(plain))
    corrected = undistort(taken, camera)
    source = camera.project(plain.unproject(grid(plain)))[0]
    inner = corrected.valid & camera.in_image(source + 4) & camera.in_image(source - 4)
    rows_columns = np.moveaxis(np.nan_to_num(source[..., ::-1]), -1, 0)
    bilinear = ndimage.map_coordinates(taken, rows_columns, order=1)
    catmull = cubic_convolution(taken, source)
    error, linear, cubic = (
        np.sqrt(np.mean((image - truth)[inner] ** 2)) for image in (corrected.image, bilinear, catmull)
    )
    assert error < linear / 6
    assert error < cubic / 2


def cubic_convolution(image, xy):
    """Keys' kernel (1981), the usual "bicubic", written out."""
    i, f = np.floor(xy).astype(int), xy - np.floor(xy)
    weights = [-0.5 * f * (1 - f) ** 2, 1 + f**2 * (1.5 * f - 2.5)]
    g = 1 - f
    weights += [1 + g**2 * (1.5 * g - 2.5), -0.5 * g * f**2]
    out = np.zeros(xy.shape[:2])
    for a in range(4):
        for b in range(4):
            row = np.clip(i[..., 1] + b - 1, 0, image.shape[0] - 1)
            column = np.clip(i[..., 0] + a - 1, 0, image.shape[1] - 1)
            out += weights[a][..., 0] * weights[b][..., 1] * image[row, column]
    return out


def test_the_spline_is_scipys():
    """Independent twin: scipy's own evaluation at the camera's places, borders included."""
    taken = np.random.default_rng(0).random((240, 320)).astype(np.float32)
    corrected = undistort(taken, LENS)
    plain = corrected.camera
    source, valid = LENS.project(plain.unproject(grid(plain)))
    valid &= LENS.in_image(source)
    np.testing.assert_array_equal(corrected.valid, valid)
    places = source[valid][:, ::-1].T
    wanted = ndimage.map_coordinates(taken.astype(float), places, order=3, mode="mirror")
    np.testing.assert_allclose(corrected.image[valid], wanted, atol=2e-6)
    assert np.isnan(corrected.image[~valid]).all()


def test_without_a_lens_the_image_comes_back():
    camera = Camera((320, 240), 300.0)
    for kind in (np.uint8, np.uint16, np.float32, bool):
        taken = np.random.default_rng(1).integers(0, 2 if kind is bool else 256, (240, 320, 3)).astype(kind)
        same = undistort(taken, camera)
        assert same.valid.all()
        assert same.image.dtype == taken.dtype
        np.testing.assert_allclose(same.image.astype(float), taken.astype(float), atol=1e-3)


@pytest.mark.parametrize("camera", [LENS, CUSHION], ids=["barrel", "cushion, tilted"])
def test_what_is_kept(camera):
    """The new camera fits its image; "all" holds every pixel, "filled" has no empty one."""
    taken = texture(ideal_places(camera)).astype(np.float32)
    for keep in ("size", "all", "filled"):
        corrected = undistort(taken, camera, keep=keep)
        plain = corrected.camera
        assert corrected.image.shape == plain.size_px[::-1]
        assert (plain.focal_px, plain.aspect) == (camera.focal_px, camera.aspect)
        assert plain.lens == "brown"
        assert not plain.parameters()[4:].any()
        shift = np.array([camera.cx - plain.cx, camera.cy - plain.cy])
        error = corrected.image - texture(grid(plain) + shift)
        assert np.median(np.abs(error[corrected.valid])) < 0.5
        if keep == "all":
            assert plain.in_image(plain.project(camera.unproject(grid(camera)))[0]).all()
        if keep == "filled":
            assert corrected.valid.all()


def test_missing_pixels():
    taken = np.full((240, 320), 7.0, np.float32)
    taken[100:103, 200] = np.nan
    corrected = undistort(taken, LENS)
    whole = undistort(np.full((240, 320), 7.0, np.float32), LENS)
    lost = whole.valid & ~corrected.valid
    assert 15 <= lost.sum() <= 40  # three pixels, and those whose sixteen neighbours hold one of them
    np.testing.assert_allclose(corrected.image[corrected.valid], 7, atol=1e-5)
    assert not undistort(np.full((240, 320), np.nan), LENS).valid.any()


def test_magnified_displacement():
    """Each ray lies at its perfect place plus N times the displacement; 0 is the corrected image."""
    rays = LENS.unproject(grid(LENS)[::10, ::10])
    perfect, real = corrected_camera(LENS).project(rays)[0], LENS.project(rays)[0]
    for factor in (-1.0, 0.0, 1.0, 3.0):
        magnified, valid = magnified_camera(LENS, factor).project(rays)
        wanted = perfect + factor * (real - perfect)
        assert valid.mean() > 0.8
        np.testing.assert_allclose(magnified[valid], wanted[valid], atol=1e-9)


def test_magnified_image_bends_the_edge_three_times_as_much():
    taken = edge(ideal_places(LENS), 0.0, 60.0).astype(np.float32)
    rows = np.arange(60, 180)

    def bend(image):
        along = edge_places(image[:, 45:110], rows)
        return np.ptp(along)

    thrice = magnify_distortion(taken, LENS, 3.0)
    assert thrice.valid[60:180, 45:110].all()
    assert bend(thrice.image) == pytest.approx(3 * bend(taken), rel=0.15)
    same = magnify_distortion(taken, LENS, 1.0)
    np.testing.assert_allclose(same.image[same.valid], taken[same.valid], atol=1e-3)


def test_redraw_for_a_smaller_camera():
    taken = texture(ideal_places(LENS)).astype(np.float32)
    target = Camera((100, 80), 300.0, 1.01, 50.0, 40.0)
    part = redraw(taken, LENS, target)
    assert part.valid.all()
    error = part.image - texture(grid(target) + np.array([161.3 - 50, 117.2 - 40]))
    assert np.sqrt(np.mean(error**2)) < 1


def variances(**sigma):
    return np.diag([sigma.get(name, 0.0) ** 2 for name in PARAMETERS])


@pytest.mark.parametrize("keep", ["size", "all"])
@pytest.mark.parametrize("camera", [
    replace(LENS, cov=variances(focal_px=2, cx=1, cy=0.7, k1=2e-3, k2=1e-3, p1=1e-4)),
    replace(CUSHION, cov=variances(focal_px=1, aspect=1e-4, cx=0.5, cy=0.5, k1=3e-3, tilt_x=1e-3, tilt_y=1e-3)),
    Camera((320, 240), 210.0, k1=-0.02, lens="fisheye", cov=variances(focal_px=1, cx=0.5, cy=0.5, k1=2e-3, k4=1e-4)),
], ids=["barrel", "cushion, tilted", "fisheye"])  # fmt: skip
def test_what_is_not_known_of_the_lens_is_in_the_camera_of_the_corrected_image(camera, keep):
    """Places of directions that lenses drawn from the covariance image, corrected by the given one, scatter so."""
    target, rng = corrected_camera(camera, keep=keep), np.random.default_rng(5)
    rays = target.unproject(np.array([[30.0, 40.0], [161.0, 117.0], [290.0, 60.0], [100.0, 215.0]]))
    root, drawn = np.sqrt(np.diag(camera.cov)), []
    for _ in range(1500):
        real = camera.with_parameters(camera.parameters() + root * rng.normal(size=len(root)))
        drawn.append(target.project(camera.unproject(real.project(rays)[0]))[0])
    scatter = np.var(np.array(drawn), axis=0)
    jacobian = target.project_jacobian(rays)[3]
    said = np.einsum("kij,jl,kil->ki", jacobian, target.cov, jacobian)
    np.testing.assert_allclose(said, scatter, rtol=5 * np.sqrt(2 / 1500), atol=1e-4)
    assert corrected_camera(replace(camera, cov=None), keep=keep).cov is None


def test_places_where_the_lens_turns_back_have_no_say_in_the_middle():
    """Displacements of the corrected picture have no bound there: a focal length known to 1 px was said to 29 px."""
    lens = Camera((640, 480), 500.0, k1=-0.55, cov=variances(focal_px=1, cx=1, cy=1, k1=1e-3))
    target, rng = corrected_camera(lens), np.random.default_rng(6)
    rays = target.unproject(np.array([[319.5, 239.5], [380.0, 280.0], [450.0, 300.0]]))
    drawn = []
    for _ in range(1000):
        real = lens.with_parameters(lens.parameters() + np.sqrt(np.diag(lens.cov)) * rng.normal(size=15))
        drawn.append(target.project(lens.unproject(real.project(rays)[0]))[0])
    jacobian = target.project_jacobian(rays)[3]
    said = np.sqrt(np.einsum("kij,jl,kil->ki", jacobian, target.cov, jacobian))
    np.testing.assert_allclose(said, np.std(np.array(drawn), axis=0), rtol=0.2)


def test_a_pose_in_a_corrected_picture_is_as_certain_as_in_the_one_that_was_taken():
    """The principal point known to 2 px: the sigma of the pose was that of the spots alone."""
    cov = variances(focal_px=8, cx=2, cy=2, k1=4e-3)
    plain = scenes.scene(11, "B", noise_px=0.05, hidden=0.0, false=0.0)
    lens = replace(plain.camera, k1=-0.1, k2=0.02, cov=cov)
    on = plain.label >= 0
    raw = lens.project(plain.cam_from_model.apply(plain.markers.xyz[plain.label[on]]))[0]
    raw += np.random.default_rng(1).normal(0, 0.05, raw.shape)
    target = corrected_camera(lens)
    found = []
    for xy, camera in ((raw, lens), (target.project(lens.unproject(raw))[0], target)):
        found.append(register(Detections.make(xy, sigma_px=0.05), plain.markers, camera))
        assert found[-1], found[-1].reason
    taken, corrected = (np.sqrt(np.diag(f.cov)[:6]) for f in found)
    np.testing.assert_allclose(corrected, taken, rtol=0.1)


def test_a_flat_picture_ends_before_ninety_degrees():
    for focal_px, words in ((110.0, "at 90 degrees and more"), (128.5, "more than 100 times the original's")):
        wide = Camera((320, 240), focal_px, lens="fisheye")
        with pytest.raises(ValueError, match=words):
            corrected_camera(wide, keep="all")
        assert corrected_camera(wide).size_px == (320, 240)
    said = undistort_verdict(wide, corrected_camera(wide), 1, {}).reason
    assert "48 % of what was taken lies beyond the corrected picture" in said


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: undistort(np.zeros((240, 321)), LENS), "image must be 320 x 240 as its camera says"),
        (lambda: undistort(np.zeros(5), LENS), r"image must be \(H, W\)"),
        (lambda: undistort(np.zeros((240, 320), np.int32), LENS), "8 or 16 bits or floating point, got int32"),
        (lambda: undistort(np.zeros((240, 320), complex), LENS), "of real numbers"),
        (lambda: undistort(np.zeros((240, 320)), LENS, keep="some"), "keep must be one of size, all, filled"),
        (lambda: corrected_camera(Camera((320, 240), 150.0, k1=-0.6), keep="all"), "no inverse on the image's border"),
        (lambda: magnified_camera(LENS, float("nan")), "factor must be a finite number, got nan"),
    ],
)
def test_faults(call, message):
    with pytest.raises(ValueError, match=message):
        call()
