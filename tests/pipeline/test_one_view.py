"""One point of view for all images of a job, and nothing that takes no part changes a bit."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from windmark import io
from windmark.geometry import Camera, Pose
from windmark.pipeline.job import run_project
from windmark.pipeline.project import read_project
from windmark.pipeline.views import frame_view
from windmark.resection import map_pixels
from windmark.scene import Block, Mesh, structured_triangles

MODEL = ("wing", "body")


@pytest.fixture(scope="module")
def two_cameras(virtual_test, tmp_path_factory):
    """The wind-off image of the virtual test, and one of a second camera, both with known poses."""
    source, test = virtual_test
    folder = tmp_path_factory.mktemp("two-cameras")
    for name in ("model.grid", "wind-off.tif", "wind-on.tif", "markers.csv", "camera.json"):
        shutil.copy(source / name, folder / name)
    shot = test.shot("wind-off")
    io.write_camera(folder / "one.json", shot.perfect.camera, shot.view.cam_from_model, unit="mm")
    other = Camera((900, 700), 1500.0, k1=-0.05)
    pose = Pose.look_at([-500.0, 100, 1300], [205.0, 290, 0], [0, 1, 0])
    grid = map_pixels(test.mesh, other, pose)
    xyz = grid.xyz()
    picture = np.where(grid.valid, 120 + 60 * np.sin(xyz[..., 0] / 40) * np.cos(xyz[..., 1] / 50), 0).astype(np.float32)
    io.write_image(folder / "other.tif", picture)
    io.write_camera(folder / "two.json", other, pose, unit="mm")
    return folder, test


PROJECT = """
title = "two cameras"
length_unit = "mm"
[[camera]]
name = "one"
file = "one.json"
pose = "known"
[[camera]]
name = "two"
file = "two.json"
pose = "known"
[[image]]
file = "wind-off.tif"
camera = "one"
[[image]]
file = "other.tif"
camera = "two"
[grid]
file = "model.grid"
volumes = {{ {volumes} }}
{views}
"""
TOP = '[[view]]\nname = "top"\ndirection = [0, 0, -1]\nup = [0, 1, 0]\nsize_px = [300, 200]\n'


def zones(test):
    from windmark.pipeline.simulate import zones_of

    return ", ".join(f"{name} = {parts}" for name, parts in zones_of(test.mesh).items() if name != "wall")


def job(two_cameras, views=TOP, **changes):
    folder, test = two_cameras
    text = PROJECT.format(volumes=zones(test), views=views)
    for old, new in changes.items():
        text = text.replace(old, new)
    (folder / "project.toml").write_text(text)
    return read_project(folder / "project.toml")


def test_all_cameras_draw_the_same_pixel_of_the_same_place(two_cameras):
    result = run_project(job(two_cameras))
    first, second = (item.views[0] for item in result.images)
    np.testing.assert_array_equal(first.cam_from_model.translation, second.cam_from_model.translation)
    np.testing.assert_array_equal(first.cam_from_model.rotation, second.cam_from_model.rotation)
    assert first.camera is second.camera
    assert first.units_per_px == second.units_per_px == result.framed[0].units_per_px
    # The pixel that shows a place of the model is told by the one camera alone: no image has a say.
    surface = result.mesh.vertices[result.mesh.used]
    camera, pose = frame_view(surface, direction=(0, 0, -1), up=(0, 1, 0), size_px=(300, 200))
    np.testing.assert_array_equal(pose.translation, first.cam_from_model.translation)
    both = first.valid & second.valid
    assert both.sum() > 1000
    assert (first.valid != second.valid).any()
    xyz = map_pixels(result.mesh, camera, pose).xyz()[both]
    expected = 120 + 60 * np.sin(xyz[:, 0] / 40) * np.cos(xyz[:, 1] / 50)
    assert np.median(np.abs(second.image[both] - expected)) < 0.5


@pytest.mark.parametrize("gone", ["wind-off", "other"])
def test_an_image_that_fails_moves_no_view(two_cameras, gone):
    whole = run_project(job(two_cameras))
    broken = two_cameras[0] / "broken.tif"
    io.write_image(broken, np.zeros((5, 5), np.uint8))
    result = run_project(job(two_cameras, **{f'file = "{gone}.tif"': 'file = "broken.tif"'}))
    assert len(result.failed) == 1
    kept = next(i for i in result.images if not i.problem)
    before = next(i for i in whole.images if i.name == kept.name)
    np.testing.assert_array_equal(kept.views[0].image, before.views[0].image)
    now, then = (r.framed[0].cam_from_model.translation for r in (result, whole))
    np.testing.assert_array_equal(now, then)


def test_a_job_whose_only_image_fails_has_its_views_all_the_same(two_cameras):
    io.write_image(two_cameras[0] / "broken.tif", np.zeros((5, 5), np.uint8))
    project = job(two_cameras)
    project = project.model_copy(
        update={"image": (project.image[0].model_copy(update={"file": two_cameras[0] / "broken.tif"}),)}
    )
    result = run_project(project)
    assert "5 x 5 pixels" in result.images[0].problem
    assert result.framed[0].name == "top"


@pytest.mark.slow
def test_a_view_by_the_numbers_of_a_camera_is_what_that_camera_sees(two_cameras):
    """From the first camera's own point of view (and lens, and size) its own image comes back."""
    folder = two_cameras[0]
    camera, pose = io.read_camera(folder / "one.json")
    numbers = ", ".join(f"{k} = {v!r}" for k, v in vars(pose.to_pov()).items() if k != "fov_deg")
    views = (
        f'[[view]]\nname = "typed"\npov = {{ {numbers} }}\nfov_deg = {camera.fov_deg!r}\nsize_px = [1280, 1024]\n'
        '[[view]]\nname = "file"\ncamera = "one.json"\n'
        '[[view]]\nname = "perfect"\ncamera = "one.json"\nfov_deg = 20\n'
    )
    result = run_project(job(two_cameras, views))
    typed, file, perfect = result.framed
    np.testing.assert_allclose(typed.cam_from_model.rotation, pose.rotation, atol=1e-13)
    np.testing.assert_allclose(typed.cam_from_model.translation, pose.translation, rtol=1e-13)
    assert typed.camera.focal_px == pytest.approx(camera.focal_px)
    assert file.camera.k1 == camera.k1
    assert perfect.camera.fov_deg == pytest.approx(20)
    assert perfect.camera.k1 == 0
    own = result.images[0].views[1]
    raw = io.read_grey(folder / "wind-off.tif").astype(float)
    assert np.abs(own.image - raw)[own.valid].max() < 1e-2


def test_an_edited_point_of_view_of_a_camera_file_is_taken_and_said(two_cameras):
    folder = two_cameras[0]
    content = json.loads((folder / "one.json").read_text())
    content["cam_from_model"]["pov"]["dz"] = 2000.0
    (folder / "edited.json").write_text(json.dumps(content))
    result = run_project(job(two_cameras, '[[view]]\nname = "v"\ncamera = "edited.json"\nsize_px = [64, 51]\n'))
    assert result.framed[0].cam_from_model.translation[2] == 2000.0
    assert "the numbers of pov were edited" in result.framed[0].how


@pytest.mark.parametrize(
    ("view", "words"),
    [
        ("direction = [0, 0, -1]\nup = [0, 0, 2]", "up is parallel to direction"),
        ("direction = [0, 0, 0]\nup = [0, 0, 2]", "up is parallel to direction, or one of them is zero"),
        ("direction = [0, 0, nan]\nup = [0, 1, 0]", "finite"),
        ("direction = [0, 0, -1]", "direction and up belong together"),
        ("up = [0, 0, -1]", "expected one of direction .with up., pov, camera; got none"),
        ('direction = [0, 0, -1]\nup = [0, 1, 0]\ncamera = "one.json"', "got direction, camera"),
        ("pov = { rx_deg = 0, ry_deg = 0, rz_deg = 0, dx = 0, dy = 0, dz = 900 }", "fov_deg is missing"),
        ("pov = { rx_deg = nan, ry_deg = 0, rz_deg = 0, dx = 0, dy = 0, dz = 900 }\nfov_deg = 9", "rx_deg.*finite"),
        ("pov = { rx_deg = 0, ry_deg = 0, rz_deg = 0, dx = 0, dy = 0 }\nfov_deg = 9", "dz.*missing"),
        ("pov = { rx_deg = 0, ry_deg = 0, rz_deg = 0, dx = 0, dy = 0, dz = 9 }\nfov_deg = 0", "greater than 0"),
        ("pov = { rx_deg = 0, ry_deg = 0, rz_deg = 0, dx = 0, dy = 0, dz = 9 }\nfov_deg = 180", "less than 170"),
        ("pov = { rx_deg = 0, ry_deg = 0, rz_deg = 0, dx = 0, dy = 0, dz = -9e4 }\nfov_deg = 9", "behind this point"),
        ('direction = [0, 0, -1]\nup = [0, 1, 0]\nvolumes = ["tail"]', "no volume 'tail'; expected some of body, wing"),
        ('camera = "none.json"', "none.json"),
        ('camera = "camera.json"', "has no pose; expected one, as the point of view of view v"),
        ('camera = "inch.json"', "its pose is in in, length_unit of .*toml is mm"),
    ],
)
def test_points_of_view_that_cannot_be_are_refused(two_cameras, view, words):
    camera, pose = io.read_camera(two_cameras[0] / "one.json")
    io.write_camera(two_cameras[0] / "inch.json", camera, pose, unit="in")
    with pytest.raises(io.FileError, match=words):
        run_project(job(two_cameras, f'[[view]]\nname = "v"\nsize_px = [30, 20]\n{view}\n'))


def test_a_view_that_shows_nothing_is_left_out_alone(two_cameras):
    beside = "pov = { rx_deg = 0, ry_deg = 0, rz_deg = 0, dx = 9e4, dy = 0, dz = 900 }\nfov_deg = 9"
    result = run_project(job(two_cameras, f'[[view]]\nname = "v"\nsize_px = [30, 20]\n{beside}\n' + TOP))
    assert [view.name for view in result.framed] == ["top"]
    assert [[view.name for view in item.views] for item in result.images] == [["top"]] * len(result.images)
    assert result.left_out == ("view v: no pixel shows the surface; check its point of view",)
    assert not result.failed


def test_cameras_of_different_units_are_refused(two_cameras):
    camera, pose = io.read_camera(two_cameras[0] / "one.json")
    io.write_camera(two_cameras[0] / "inch.json", camera, pose, unit="in")
    with pytest.raises(io.FileError, match=r"inch\.json.*its pose is in in, length_unit of .*toml is mm"):
        run_project(job(two_cameras, **{'file = "two.json"': 'file = "inch.json"'}))


def test_a_view_can_be_framed_on_one_volume(two_cameras):
    result = run_project(job(two_cameras, TOP + TOP.replace('"top"', '"wing"') + 'volumes = ["wing"]\n'))
    assert "framed on volume wing" in result.framed[1].how
    assert result.framed[1].units_per_px < result.framed[0].units_per_px


# --- what takes no part ----------------------------------------------------------------------


def with_far_field(mesh, first, where):
    """The grid with one more zone, a plate at ``where``, before or after the others."""
    x, y = np.meshgrid(np.linspace(-1, 1, 4), np.linspace(-1, 1, 4))
    plate = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1) * 1000 + where
    triangles = structured_triangles(4, 4)
    block = Block("far", (4, 4, 1), 0)
    shift = len(plate) if first else 0
    blocks = tuple(replace(b, first=b.first + shift) for b in mesh.blocks)
    far = replace(block, first=0 if first else len(mesh.vertices))
    names = np.full(len(triangles), "far")
    if first:
        return Mesh(np.concatenate([plate, mesh.vertices]), np.concatenate([triangles, mesh.triangles + shift]),
                    np.concatenate([names, mesh.volume]), (far, *blocks)), shift  # fmt: skip
    return Mesh(np.concatenate([mesh.vertices, plate]),
                np.concatenate([mesh.triangles, triangles + len(mesh.vertices)]),
                np.concatenate([mesh.volume, names]), (*blocks, far)), shift  # fmt: skip


@pytest.fixture(scope="module")
def whole(virtual_test):
    """The virtual test's own job."""
    return run_project(read_project(virtual_test[0] / "project.toml"))


@pytest.mark.slow
@pytest.mark.parametrize("first", [True, False])
def test_a_far_field_zone_that_takes_no_part_changes_no_bit(virtual_test, whole, tmp_path, first):
    folder, test = virtual_test
    plain = (folder / "project.toml").read_text()
    mesh, shift = with_far_field(test.mesh, first, np.array([4e5, -3e5, 1e5]))
    io.write_mesh(tmp_path / "far.grid", mesh)
    moved = plain.replace('"model.grid"', '"far.grid"')
    if first:
        for k in range(len(test.mesh.blocks), 0, -1):
            moved = moved.replace(f"zone{k:02d}", f"zone{k + 1:02d}")
    for name in ("camera.json", "markers.csv", "wind-off.tif", "wind-on.tif"):
        shutil.copy(folder / name, tmp_path / name)
    (tmp_path / "project.toml").write_text(moved)
    before, after = whole, run_project(read_project(tmp_path / "project.toml"))
    assert after.mesh.diagonal == before.mesh.diagonal
    own = slice(shift, shift + len(test.mesh.vertices))
    for a, b in zip(before.images, after.images, strict=True):
        assert a.problem is None
        assert a.cam_from_model.rotation.tobytes() == b.cam_from_model.rotation.tobytes()
        assert a.cam_from_model.translation.tobytes() == b.cam_from_model.translation.tobytes()
        assert a.expected.tobytes() == b.expected.tobytes()
        assert a.values.tobytes() == b.values[own].tobytes()
        assert a.nodes.reason.tobytes() == b.nodes.reason[own].tobytes()
        assert a.views[0].image.tobytes() == b.views[0].image.tobytes()
        assert a.views[0].cam_from_model.translation.tobytes() == b.views[0].cam_from_model.translation.tobytes()
        assert a.sections[0].value.tobytes() == b.sections[0].value.tobytes()
        assert a.sections[0].xyz.tobytes() == b.sections[0].xyz.tobytes()
        assert a.aligned.tobytes() == b.aligned.tobytes()


# --- the model only ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def aligned(tmp_path_factory, virtual_test):
    """Results of the alignment of wind-off and wind-on by the background that was asked for."""
    folder, _ = virtual_test
    text = (folder / "project.toml").read_text()
    results = {}
    for background in ("blank", "keep"):
        path = folder / f"{background}.toml"
        path.write_text(text.replace('reference = "wind-off"', f'reference = "wind-off"\nbackground = "{background}"'))
        results[background] = run_project(read_project(path))
        path.unlink()
    return results


@pytest.mark.slow
def test_walls_stay_where_they_are_and_the_model_is_aligned(aligned, virtual_test):
    test = virtual_test[1]
    blank, keep = (aligned[b].images[1] for b in ("blank", "keep"))
    off, on = (test.shot(n).perfect for n in ("wind-off", "wind-on"))
    is_model = np.isin(test.mesh.volume, MODEL)
    shows = [np.where(s.triangle >= 0, is_model[s.triangle], False) for s in (off, on)]
    # On the model both are the same; off it one is blank and the other is the raw image, unless the model is there.
    np.testing.assert_array_equal(blank.aligned[np.isfinite(blank.aligned)], keep.aligned[np.isfinite(blank.aligned)])
    behind = ~shows[0] & ~np.isfinite(blank.aligned)
    assert np.isnan(blank.aligned[~shows[0]]).mean() > 0.99
    kept = np.isfinite(keep.aligned) & behind
    np.testing.assert_array_equal(keep.aligned[kept], keep.image[kept].astype(np.float32))
    assert not (kept & shows[1]).any()
    newly = ~shows[0] & shows[1]  # the wall that the model hides with wind on only
    assert newly.sum() > 100
    assert np.isnan(keep.aligned[newly]).mean() > 0.97
    assert kept.sum() > 0.9 * (~shows[0] & ~shows[1]).sum()


def test_the_reference_with_its_background_is_the_image_itself(aligned):
    keep = aligned["keep"].images[0]
    off = np.isnan(aligned["blank"].images[0].aligned) & np.isfinite(keep.aligned)  # not of a dead pixel on the model
    assert off.mean() > 0.5
    np.testing.assert_array_equal(keep.aligned[off], keep.image[off].astype(np.float32))


def test_keep_needs_one_camera(two_cameras):
    with pytest.raises(io.FileError, match=r"background = .keep. needs images of one camera"):
        job(two_cameras, '[align]\nreference = "wind-off"\nbackground = "keep"\n')
