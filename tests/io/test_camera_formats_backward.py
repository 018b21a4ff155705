"""The photogrammetric (backward, mm) lens: refitted both ways, with its misfit said."""

from __future__ import annotations

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.io import FileError, read_camera, read_camera_file, write_camera
from windmark.io.cameras.backward import BackwardCamera, backward_camera, forward_camera

SIZE, PITCH = (3004, 2000), (0.0074, 0.0074)
# 23 mm lens; 10 px of distortion at the border, decentring of 1 px
USUAL = BackwardCamera(SIZE, PITCH, 22.7, 0.081, -0.043, 7e-5, -1.2e-7, 3e-10, 8e-6, -5e-6)


def published(camera, xy):
    """Australis' correction (Fraser 1997), term by term on one pixel: ideal mm, y up."""
    x = (xy[0] + 0.5) * camera.pixel_mm[0] - camera.size_px[0] * camera.pixel_mm[0] / 2 - camera.xp
    y = camera.size_px[1] * camera.pixel_mm[1] / 2 - (xy[1] + 0.5) * camera.pixel_mm[1] - camera.yp
    r2 = x * x + y * y
    radial = camera.k1 * r2 + camera.k2 * r2**2 + camera.k3 * r2**3
    dx = x * radial + camera.p1 * (r2 + 2 * x * x) + 2 * camera.p2 * x * y + camera.b1 * x + camera.b2 * y
    dy = y * radial + camera.p2 * (r2 + 2 * y * y) + 2 * camera.p1 * x * y
    return np.array([x + dx, y + dy])


def test_rays_are_those_of_the_published_formula():
    camera = BackwardCamera(SIZE, (0.0074, 0.0080), 22.7, 0.081, -0.043, 7e-5, -1.2e-7, 3e-10, 8e-6, -5e-6, 1e-3, 2e-3)
    for xy in np.random.default_rng(0).uniform([0, 0], SIZE, (20, 2)):
        ideal = published(camera, xy)
        np.testing.assert_allclose(camera.unproject(xy), [ideal[0] / 22.7, -ideal[1] / 22.7, 1], rtol=1e-13)


@pytest.mark.parametrize(("strength", "bound_px"), [(-5.0, 0.1), (-1.0, 0.01), (1.0, 0.01), (5.0, 0.1)])
def test_refit_of_a_backward_model(strength, bound_px):
    """16 and 80 px in the corners, barrel and cushion."""
    backward = BackwardCamera(SIZE, PITCH, 22.7, 0.081, -0.043, strength * 7e-5, strength * -1.2e-7, 0, 8e-6, -5e-6)
    camera, refit = forward_camera(backward)
    xy = np.random.default_rng(1).uniform([0, 0], SIZE, (500, 2))
    off = np.linalg.norm(camera.project(backward.unproject(xy))[0] - xy, axis=1)
    corner = camera.unproject([0.0, 0.0])[:2] * camera.focal_px + [camera.cx, camera.cy]
    assert np.hypot(*corner) > 14 * abs(strength)
    assert off.max() <= refit.max_px * 1.01
    assert refit.max_px < bound_px
    assert refit.rms_px < refit.max_px


def test_coefficients_are_not_simply_copied():
    """Copying with the sign turned round is wrong by more than the refit by orders of magnitude."""
    camera, refit = forward_camera(USUAL)
    f = USUAL.c
    copied = Camera(
        SIZE, f / PITCH[0], 1.0, camera.cx, camera.cy, -USUAL.k1 * f**2, -USUAL.k2 * f**4, USUAL.p2 * f, -USUAL.p1 * f
    )
    xy = np.random.default_rng(1).uniform([0, 0], SIZE, (500, 2))
    off = np.linalg.norm(copied.project(USUAL.unproject(xy))[0] - xy, axis=1)
    assert off.max() > 20 * refit.max_px


def test_round_trip_through_the_backward_model(tmp_path):
    camera = Camera(SIZE, 3070.0, 0.9996, 1512.3, 985.1, -0.09, 0.07, 2e-4, -3e-4)
    write_camera(tmp_path / "c.txt", camera, pixel_mm=0.0074)
    content = read_camera_file(tmp_path / "c.txt")
    assert content.format == "australis"
    assert content.note.startswith("lens refitted from a backward model: RMS ")
    assert (tmp_path / "c.txt").read_text().startswith("# Backward lens model in mm, y up; refitted: RMS ")
    xy = np.random.default_rng(2).uniform([0, 0], SIZE, (500, 2))
    off = np.linalg.norm(content.camera.project(camera.unproject(xy))[0] - xy, axis=1)
    assert off.max() < 0.01
    assert abs(content.camera.focal_px - 3070) < 0.05


def test_a_lens_without_distortion_is_exact():
    camera = Camera(SIZE, 3070.0, 1.0, 1512.25, 985.5)
    backward, refit = backward_camera(camera, PITCH)
    again, exact = forward_camera(backward)
    assert max(refit.max_px, exact.max_px) < 1e-9
    np.testing.assert_allclose(again.parameters()[:4], camera.parameters()[:4], rtol=1e-12)
    assert (backward.xp, backward.yp) == pytest.approx(((1512.25 - 1501.5) * 0.0074, (999.5 - 985.5) * 0.0074))


def test_pixels_that_are_not_square(tmp_path):
    camera = Camera(SIZE, 3070.0, 0.92, 1512.25, 985.5, k1=-0.05)
    write_camera(tmp_path / "c.txt", camera, pixel_mm=(0.0074, 0.0074 / 0.92))
    assert "B1      0.0\n" in (tmp_path / "c.txt").read_text()
    again = read_camera(tmp_path / "c.txt")[0]
    assert again.aspect == pytest.approx(0.92, abs=1e-6)


def test_shear_goes_both_ways(tmp_path):
    camera = Camera(SIZE, 3070.0, 0.9996, 1512.3, 985.1, -0.09, 0.07, 2e-4, -3e-4, shear=4e-4)
    write_camera(tmp_path / "c.txt", camera, pixel_mm=0.0074)
    again = read_camera(tmp_path / "c.txt")[0]
    assert again.shear == pytest.approx(4e-4, abs=1e-6)
    xy = np.random.default_rng(2).uniform([0, 0], SIZE, (500, 2))
    assert np.linalg.norm(again.project(camera.unproject(xy))[0] - xy, axis=1).max() < 0.01
    # Without a B2 none is made up from what the other lens model cannot show.
    assert forward_camera(USUAL)[0].shear == 0


TEXT = """# by hand
width 3004
height: 2000
pixel_x 0.0074 mm
pixel_y = 0.0074 mm
C 22.7 mm
XP 0.08 mm
YP -0.04 mm
K1 7e-5
"""


def test_a_table_typed_by_hand(tmp_path):
    (tmp_path / "c.txt").write_text(TEXT)
    camera = read_camera(tmp_path / "c.txt")[0]
    assert camera.size_px == SIZE
    assert camera.focal_px == pytest.approx(22.7 / 0.0074, rel=1e-4)
    assert camera.cx == pytest.approx(1501.5 + 0.08 / 0.0074, abs=0.01)
    assert camera.cy == pytest.approx(999.5 + 0.04 / 0.0074, abs=0.01)
    assert camera.k1 == pytest.approx(-7e-5 * 22.7**2, rel=0.02)
    (tmp_path / "c.txt").write_text(TEXT.replace("width 3004\nheight: 2000\n", ""))
    assert read_camera(tmp_path / "c.txt", size_px=SIZE)[0].size_px == SIZE
    with pytest.raises(FileError, match="no image size; expected the keys width and height, or the size from the call"):
        read_camera(tmp_path / "c.txt")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("K1 7e-5", "K1 nan", "key 'k1': not finite"),
        ("K1 7e-5", "K1 x", "line 9: 'x' is no number; expected a finite number for k1"),
        ("K1 7e-5", "K4 1", "line 9: 'K4 1' is no camera parameter"),
        ("K1 7e-5", "K1 1\nk1 2", "key 'k1': there more than once"),
        ("C 22.7 mm", "C 0 mm", "key 'c': 0; expected millimetres > 0"),
        ("C 22.7 mm", "", "key 'c': missing; expected width, height, pixel_x"),
        ("height: 2000\n", "", "key 'height': missing"),
        ("K1 7e-5", "K1 3e-3", "the lens refitted as k1 k2 p1 p2 k3 is off: RMS"),
        ("K1 7e-5", "K1 -4e-2", "no lens with k1 k2 p1 p2 k3 shows all rays of the sensor"),
    ],
)
def test_faults_of_a_table(tmp_path, old, new, message):
    assert old in TEXT
    (tmp_path / "c.txt").write_text(TEXT.replace(old, new))
    with pytest.raises(FileError, match=message):
        read_camera(tmp_path / "c.txt")


def test_what_cannot_be_written_as_a_correction(tmp_path):
    with pytest.raises(ValueError, match="pixel_mm must give the pixels' pitch in mm for australis, got None"):
        write_camera(tmp_path / "c.txt", Camera(SIZE, 3070.0))
    with pytest.raises(ValueError, match=r"the backward model K1 K2 K3 P1 P2 B1 B2 is off: .*sensor tilts do not"):
        write_camera(tmp_path / "c.txt", Camera(SIZE, 3070.0, tilt_x=0.05, tilt_y=0.1), pixel_mm=0.0074)
    with pytest.raises(ValueError, match="the lens is not one to one over the whole sensor"):
        write_camera(tmp_path / "c.txt", Camera(SIZE, 1500.0, k1=-0.6), pixel_mm=0.0074)
    with pytest.raises(ValueError, match="holds no pose"):
        write_camera(tmp_path / "c.txt", Camera(SIZE, 3070.0), Pose.from_rotvec([0, 0, 0], [0, 0, 1]), unit="m")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("line", ["YP 258184869", "YP 1e300", "K1 1e300", "C 1e-300", "P1 -1e155", "XP 1e160"])
def test_absurd_numbers_are_refused(tmp_path, line):
    key = line.split()[0]
    lines = [row for row in TEXT.splitlines() if row.split()[0] != key]
    (tmp_path / "c.txt").write_text("\n".join([*lines, line, "K2 1e-9"]))
    with pytest.raises(FileError, match=r"no lens with k1 k2 p1 p2 k3|is off: RMS|is too large; expected"):
        read_camera(tmp_path / "c.txt")
