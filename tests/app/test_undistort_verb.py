"""`windmark undistort`: corrected images as files."""

import numpy as np
import pytest

from windmark.app import lens_pictures
from windmark.calibration import magnify_distortion, undistort
from windmark.calibration.quality import ResidualMap
from windmark.geometry import Camera, Pose
from windmark.io import page_count, read_camera_file, read_image, write_camera, write_image, write_images

LENS = Camera((160, 120), 150.0, 1.0, 80.0, 58.0, k1=-0.15, p1=1e-3)
IMAGE = np.random.default_rng(0).integers(0, 4096, (120, 160)).astype(np.uint16)


@pytest.fixture
def files(tmp_path):
    write_camera(tmp_path / "c.json", LENS, Pose.from_rotvec([0, 0, 1], [1, 2, 3]), unit="mm")
    write_image(tmp_path / "a.tif", IMAGE)
    write_image(tmp_path / "b.jpg", (IMAGE >> 4).astype(np.uint8))
    write_images(tmp_path / "stack.tif", [IMAGE, IMAGE[::-1]])
    return tmp_path


@pytest.mark.slow
def test_images_camera_and_mask(windmark, files):
    out = files / "out"
    done = windmark(
        "undistort", files / "a.tif", files / "b.jpg", files / "stack.tif", "-c", files / "c.json", "--magnify", 3,
        "--field", "--picture", "-o", out,
    )  # fmt: skip
    assert done.code == 0
    names = {"a.tif", "a-x3.tif", "b.png", "b-x3.png", "stack.tif", "stack-x3.tif", "valid.png", "camera.json"}
    drawn = {"distortion.png", "a-picture.png", "b-picture.png", "stack-picture.png"}
    assert {p.name for p in out.iterdir()} == names | drawn | {"manifest.json", "report.html"}
    assert all(min(read_image(out / name).shape[:2]) > 200 for name in drawn)
    corrected = undistort(IMAGE, LENS)
    np.testing.assert_array_equal(read_image(out / "a.tif"), corrected.image)
    np.testing.assert_array_equal(read_image(out / "a-x3.tif"), magnify_distortion(IMAGE, LENS, 3).image)
    np.testing.assert_array_equal(read_image(out / "valid.png") > 0, corrected.valid)
    assert page_count(out / "stack.tif") == 2
    np.testing.assert_array_equal(read_image(out / "stack.tif", page=1), undistort(IMAGE[::-1], LENS).image)
    again = read_camera_file(out / "camera.json")
    np.testing.assert_array_equal(again.camera.parameters(), corrected.camera.parameters())
    np.testing.assert_array_equal(again.cam_from_model.translation, [1, 2, 3])
    assert f"{100 * corrected.valid.mean():.1f} % of them filled" in done.out
    assert f"b.jpg: {out / 'b.png'}, {out / 'b-x3.png'}" in done.out


def test_the_page_shows_each_picture_before_and_after(windmark, files):
    patchy = IMAGE.astype(np.float32)
    patchy[:30] = np.nan
    write_image(files / "<x>&.tif", patchy)
    out = files / "out"
    done = windmark("undistort", files / "a.tif", files / "<x>&.tif", "-c", files / "c.json", "-o", out, "--json")
    assert done.json["not_drawn"] == []
    assert done.json["verdict"]["word"] == "good"
    html = (out / "report.html").read_text(encoding="utf-8")
    assert 'data-verdict="good"' in html
    assert html.count('<figure class="wm-photo">') == 3  # as taken, undone, magnified; the other picture is packed
    assert "<x>" not in html
    assert "SHA-256" in html
    assert str(files) not in html


@pytest.mark.parametrize("lens", [Camera((160, 120), 150.0), Camera((160, 120), 90.0, k1=-0.02, lens="fisheye")])
def test_lenses_that_have_nothing_to_magnify(windmark, files, lens):
    write_camera(files / "other.json", lens)
    done = windmark("undistort", files / "a.tif", "-c", files / "other.json", "-o", files / "out", "--json")
    assert done.json["not_drawn"] == []
    html = (files / "out" / "report.html").read_text(encoding="utf-8")
    assert html.count('<figure class="wm-photo">') == 2


def test_keep_and_json(windmark, files):
    done = windmark("undistort", files / "a.tif", "-c", files / "c.json", "--keep", "all", "-o", files / "o", "--json")
    assert done.json["size_px"] == list(undistort(IMAGE, LENS, keep="all").camera.size_px)
    assert read_image(files / "o" / "a.tif").shape == tuple(done.json["size_px"][::-1])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a.tif", "--keep", "some"], "--keep must be one of size, all, filled, got 'some'"),
        (["a.tif", "a.tif"], "images: a is there twice"),
        (["c.json"], "c.json"),
        (["small.png"], "small.png: undistort: image must be 160 x 120 as its camera says"),
        (["a.tif", "--magnify", "nan"], "'--magnify': expected > 0 and <= 1000, not nan"),
    ],
)
def test_refusals_write_nothing(windmark, files, arguments, message):
    write_image(files / "small.png", np.zeros((12, 16), np.uint8))
    arguments = [files / a if "." in a else a for a in arguments]
    done = windmark("undistort", *arguments, "-c", files / "c.json", "-o", files / "out")
    assert done.code == 2
    assert message in done.err
    assert not (files / "out").exists()


def test_a_pose_without_a_unit_is_left_out(windmark, files):
    path = files / "c.cameramodel"
    write_camera(path, LENS, Pose.from_rotvec([0, 0, 1], [1, 2, 3]), unit="mm")
    path.write_text(path.read_text().replace("; lengths in mm", ""))  # as other programs write it
    done = windmark("undistort", files / "a.tif", "-c", path, "-o", files / "out")
    assert "does not say the length unit of its pose: the pose is left out" in done.out
    assert read_camera_file(files / "out" / "camera.json").cam_from_model is None


@pytest.mark.parametrize("camera", [LENS, Camera((160, 120), 150.0), Camera((160, 120), 60.0, k1=-0.6)])
def test_distortion_is_drawn_for_any_lens(camera):
    """A usual one, none at all, one that has no inverse in the corners."""
    figure = lens_pictures.distortion_picture(camera)
    assert "arrows ×" in figure.axes[0].get_title()
    figure.canvas.draw()


def test_cells_beyond_three_sigma_are_counted():
    mean = np.array([[0.05, 0.01], [np.nan, -0.04]])
    edges, sigma = np.array([-0.5, 9.5, 19.5]), np.array([[0.01, 0.01], [np.nan, 0.01]])
    seen = ResidualMap(edges, edges, mean, 0 * mean, sigma, np.array([[9, 9], [0, 9]]))
    radial, tangential = lens_pictures.residual_map_picture(seen).axes[:2]
    assert radial.get_title() == "radial (outwards): 2 of 3 cells beyond 3 sigma"
    assert tangential.get_title() == "tangential (clockwise): 0 of 3 cells beyond 3 sigma"
