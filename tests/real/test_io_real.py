"""Files of other people and programs: every image, marker table and camera of the real data sets."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from windmark.io import (
    FileError,
    page_count,
    read_camera,
    read_camera_file,
    read_image,
    read_markers,
    to_grey,
    write_camera,
    write_markers,
)

IMAGES = {
    "nasa-upsp-cam5": (1, (800, 1280), "uint8"),
    "dbat-camcal": (21, (1704, 2272, 3), "uint8"),
    "dice-stereo-dots": (28, (2048, 2448), "uint8"),
    "opencsp-dotwall-5view": (5, (1440, 2160), "uint8"),
    "myptv-ridge-3cam": (3, (1024, 1024), "uint8"),
    "openptv-vblock-4view": (4, (864, 864), "uint8"),
    "piv-challenge-e-calib": (14, (1024, 1024), "uint16"),
    "frame-sway-1cam": (41, (2046, 1300, 3), "uint8"),
}
EXTENSIONS = (".png", ".jpg", ".jpeg", ".tif")


@pytest.mark.parametrize("name", IMAGES)
def test_every_image(shared_data, name):
    count, shape, kind = IMAGES[name]
    paths = sorted(p for p in (shared_data / name).rglob("*") if p.suffix.lower() in EXTENSIONS)
    assert len(paths) == count
    for path in paths[:4]:  # the pictures of a set are alike; four show it in little time
        image = read_image(path)
        assert (image.shape, image.dtype.name) == (shape, kind), path.name
        assert image.max() > image.min()
        assert to_grey(image).shape == shape[:2]
        assert page_count(path) == 1


def test_nasa_markers(shared_data, tmp_path):
    path = shared_data / "nasa-upsp-cam5" / "fml_tc3_volume.tgts"
    markers = read_markers(path)
    assert markers.name.tolist() == [f"st{k:02d}" for k in range(1, 25)]
    assert (markers.radius == 0.063 / 2).all()
    assert (markers.normal == [0, 0, 1]).all()
    everything = read_markers(path, roles=None)
    roles, counts = np.unique(everything.role, return_counts=True)
    assert dict(zip(roles.tolist(), counts.tolist(), strict=True)) == {"model": 24, "tap": 15, "virtual": 14}
    write_markers(tmp_path / "m.csv", everything)
    again = read_markers(tmp_path / "m.csv", roles=None)
    for field in ("name", "xyz", "radius", "normal", "role"):
        np.testing.assert_array_equal(getattr(again, field), getattr(everything, field))


def dot_centres(image: np.ndarray, near: np.ndarray, half: int = 6) -> np.ndarray:
    """Centroids of darkness round given places, twice re-centred."""
    centres = np.array(near, dtype=float)
    for _ in range(3):
        for k, (x, y) in enumerate(centres):
            i, j = round(float(x)), round(float(y))
            part = image[j - half : j + half + 1, i - half : i + half + 1].astype(float)
            weight = np.clip(0.6 * np.median(part) - part, 0, None)
            rows, columns = np.mgrid[j - half : j + half + 1, i - half : i + half + 1]
            centres[k] = (weight * columns).sum() / weight.sum(), (weight * rows).sum() / weight.sum()
    return centres


def test_nasa_camera_meets_the_dots(shared_data):
    folder = shared_data / "nasa-upsp-cam5"
    camera, pose = read_camera(folder / "camera05_35_6.json")
    markers = read_markers(folder / "fml_tc3_volume.tgts")
    image = read_image(folder / "CAM5.png")
    assert camera.size_px == image.shape[::-1]
    assert camera.cx == 640 + 3.847886235332112
    xy, valid = camera.project(pose.apply(markers.xyz))
    inside = valid & camera.in_image(xy)
    assert markers.name[inside].tolist() == [f"st{k:02d}" for k in range(10, 25)]
    # Every projected target falls into a box that was drawn by hand round a dot.
    boxes = np.array(
        [
            [float(box.findtext(key)) for key in ("xmin", "ymin", "xmax", "ymax")]
            for box in ElementTree.parse(folder / "CAM5_boxes.xml").iter("bndbox")
        ]
    )
    p = xy[inside]
    hit = (p[:, None] >= boxes[None, :, :2]) & (p[:, None] <= boxes[None, :, 2:])
    assert hit.all(axis=2).any(axis=1).sum() == 15
    # The data's own truth: 1.13 px with the principal point counted from (w/2, h/2), 1.29 px from ((w-1)/2, (h-1)/2).
    margin = np.array([8, 8, camera.size_px[0] - 9, camera.size_px[1] - 9])
    p = p[(p > margin[:2]).all(axis=1) & (p < margin[2:]).all(axis=1)]
    residual = p - dot_centres(image, p)
    rms = np.sqrt((residual**2).sum(axis=1).mean())
    shifted = np.sqrt(((residual - 0.5) ** 2).sum(axis=1).mean())
    assert rms < 1.25
    assert rms < shifted - 0.05


@pytest.mark.parametrize("name", ["camera01_35_6.json", "camera05_35_6.json"])
@pytest.mark.parametrize("extension", [".json", ".yml"])
def test_nasa_camera_converts(shared_data, tmp_path, name, extension):
    camera, pose = read_camera(shared_data / "nasa-upsp-cam5" / name)
    path = tmp_path / f"c{extension}"
    write_camera(path, camera, pose, unit="in")
    again = read_camera_file(path)
    np.testing.assert_allclose(again.camera.parameters(), camera.parameters(), rtol=1e-15)
    np.testing.assert_allclose(again.cam_from_model.rotation, pose.rotation, atol=1e-13)
    assert again.length_unit == "in"


def test_opencsp_camera(shared_data):
    camera, pose = read_camera(shared_data / "opencsp-dotwall-5view" / "camera.json")
    assert camera.size_px == (2160, 1440)
    assert camera.matrix[1, 1] == pytest.approx(1169.464451788925, rel=1e-15)
    assert (camera.k1, camera.p2, camera.k3) == (-0.0557639149529476, 0.000491808034770433, 0.0)
    assert pose is None


@pytest.mark.parametrize("name", ["nasa-upsp-cam5/test_config.json", "opencsp-dotwall-5view/derived_view_poses.json"])
def test_other_json_is_refused(shared_data, name):
    with pytest.raises(FileError, match="not a camera file: it has"):
        read_camera(shared_data / name)


def test_other_files_are_refused_with_their_name(shared_data):
    """Nothing but FileError, whatever is given to whichever reader."""
    paths = [p for p in shared_data.rglob("*") if p.is_file() and p.stat().st_size < 300_000]
    assert len(paths) > 40
    for path in paths:
        for read in (read_markers, read_camera, read_image):
            refused = _refusal(read, path)
            assert refused is None or refused.path == path


def _refusal(read, path: Path) -> FileError | None:
    try:
        read(path)
    except FileError as error:
        return error
    return None
