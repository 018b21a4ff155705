"""A rendered sequence followed from image to image: poses, labels, bad images, dropped frames."""

import numpy as np
import pytest

from windmark import io, synth
from windmark.geometry import Camera, Pose
from windmark.pipeline.track_files import FollowOptions, follow
from windmark.pipeline.track_results import PoseRow, match_columns, pose_columns, pov_with_sigma, sequence_summary
from windmark.registration import Unchecked
from windmark.scene import MarkerSet

FRAMES = 8
OPTIONS = FollowOptions(radius_px=(2.5,))


@pytest.fixture(scope="module")
def scene():
    """The test, its images and true poses."""
    test = synth.wind_tunnel(3, size_px=(800, 640), nodes=8_000, sensor=None)
    made = list(synth.tunnel_sequence(test, synth.swinging(FRAMES), seed=3))
    return test, [image for image, _ in made], [pose for _, pose in made]


def named(images):
    return [(f"f{k}", image) for k, image in enumerate(images)]


def error_px(test, pose, truth):
    camera, xyz = test.cameras["cam1"], test.markers.with_role("model").xyz
    return np.linalg.norm(camera.project(pose.apply(xyz))[0] - camera.project(truth.apply(xyz))[0], axis=1).max()


def run(test, images, **more):
    markers = test.markers.with_role("model")
    return list(follow(images, markers, test.cameras["cam1"], options=OPTIONS, **more))


def test_first_frame_cold_then_guided(scene):
    test, images, poses = scene
    frames = run(test, named(images))
    assert [f.status for f in frames] == ["cold"] + ["tracked"] * (FRAMES - 1)
    assert frames[-1].guided
    for frame, pose in zip(frames, poses, strict=True):
        assert error_px(test, frame.registered.cam_from_model, pose) < 0.2
        assert len(frame.registered.matching) > 0.7 * frame.registered.n_expected


def test_bad_images_are_flagged_and_stop_nothing(scene, tmp_path):
    test, images, poses = scene
    files = []
    for k, image in enumerate(images):
        files.append(tmp_path / f"f{k}.tif")
        io.write_image(files[-1], np.zeros_like(image) if k == 2 else image[:100] if k == 4 else image)
    files[3].write_bytes(files[3].read_bytes()[:200])
    frames = run(test, files)
    assert [f.status == "lost" for f in frames] == [k in (2, 3, 4) for k in range(FRAMES)]
    assert "f3.tif" in frames[3].reason
    assert "800 x 640" in frames[4].reason
    for k in (5, 6, 7):
        assert error_px(test, frames[k].registered.cam_from_model, poses[k]) < 0.2


def test_a_jump_between_images_is_found_again(scene):
    test, images, poses = scene
    order = [0, 1, 2, 7, 7, 7]
    frames = run(test, named([images[k] for k in order]))
    assert all(f.registered for f in frames)
    for frame, k in zip(frames, order, strict=True):
        assert error_px(test, frame.registered.cam_from_model, poses[k]) < 0.2


def test_dropped_frames_have_their_instants(scene):
    test, images, _ = scene
    kept = [0, 1, 2, 3, 5, 6, 7]
    frames = run(test, named([images[k] for k in kept]), instants=kept)
    assert [f.status for f in frames[1:]] == ["tracked"] * 6
    assert [f.instant for f in frames] == kept


def test_instants_must_increase_and_suffice(scene):
    test, images, _ = scene
    with pytest.raises(ValueError, match="increase strictly"):
        run(test, named(images[:3]), instants=[0, 1, 1])
    with pytest.raises(ValueError, match="for every image"):
        run(test, named(images[:3]), instants=[0, 1])


def test_images_are_taken_one_by_one(scene):
    test, images, _ = scene
    taken = []

    def stream():
        for k, image in enumerate(images):
            taken.append(k)
            yield f"f{k}", image

    frames = follow(stream(), test.markers.with_role("model"), test.cameras["cam1"], options=OPTIONS)
    next(frames)
    next(frames)
    assert taken == [0, 1]


def test_tables_hold_every_image(scene):
    test, images, poses = scene
    markers = test.markers.with_role("model")
    rows = [PoseRow.of(f) for f in run(test, named([images[0], np.zeros_like(images[0]), images[1]]))]
    poses_table, matches = pose_columns(rows), match_columns(rows, markers)
    assert poses_table["status"][1] == "lost"
    assert np.isnan(poses_table["dx"][1])
    truth = poses[0].to_pov()
    for name in ("rx_deg", "ry_deg", "dz"):
        assert abs(poses_table[name][0] - getattr(truth, name)) < 6 * poses_table[f"sigma_{name}"][0] + 1e-3
    assert len(matches["name"]) == rows[0].matched + rows[2].matched
    assert set(matches["image"]) == {"f0", "f2"}
    assert [u["what"] for u in sequence_summary(rows, test.cameras["cam1"], "mm")["unchecked"]] == \
        [u.what for u in rows[0].unchecked]  # fmt: skip


def test_what_a_followed_image_cannot_tell_is_said_beside_what_the_first_one_cannot():
    none = (np.zeros(0, np.int64), np.zeros((0, 4)))
    scale, radii, mirror = (Unchecked(what, what) for what in ("scale", "radii", "mirror"))
    rows = [
        PoseRow(k, f"f{k}", k, status, "", True, 0.1, 9, 9, 0.1, np.zeros(6), np.ones(6), Pose.identity(), none,
                unchecked=said)
        for k, (status, said) in enumerate([
            ("cold", (mirror,)), ("tracked", ()), ("reacquired", (scale,)), ("tracked", (radii,)), ("tracked", ())
        ])
    ]  # fmt: skip
    told = sequence_summary(rows, Camera((640, 480), 800.0), "mm")["unchecked"]
    assert [u["what"] for u in told] == ["scale", "radii"]


def test_sigma_of_the_point_of_view_is_that_of_scattered_poses():
    rng = np.random.default_rng(0)
    pose = synth.swinging(1, angle_deg=20)[0]
    root = rng.normal(size=(6, 6)) * np.array([1e-3] * 3 + [0.1] * 3)[:, None]
    cov = root @ root.T
    _, sigma = pov_with_sigma(pose, cov)
    some = [type(pose).exp(d) @ pose for d in rng.multivariate_normal(np.zeros(6), cov, 4000)]
    pov = np.array([[p.rx_deg, p.ry_deg, p.rz_deg, p.dx, p.dy, p.dz] for p in (s.to_pov() for s in some)])
    np.testing.assert_allclose(pov.std(axis=0), sigma, rtol=0.06)


def plate(offset_mm, angle, rng):
    """A plate of regular rows with a corner and an edge marker missing, seen from the front, and its true pose."""
    x, y = np.meshgrid(np.arange(7) * 40.0 - 120, np.arange(5) * 40.0 - 80)
    xyz = np.delete(np.c_[x.ravel(), y.ravel(), 0 * x.ravel()], [0, 18], axis=0)
    camera = Camera((480, 360), 600.0)
    pose = Pose.from_rotvec([np.pi, 0, 0], [*offset_mm, 700.0]) @ Pose.from_rotvec([0, 0, angle], [0, 0, 0])
    places, _ = camera.project(pose.apply(xyz))
    v, u = np.mgrid[:360, :480]
    image = 180.0 + rng.normal(0, 1.5, u.shape)
    for cx, cy in places:
        image -= 90 * np.clip(5.5 - np.hypot(u - cx, v - cy), 0, 1)
    markers = MarkerSet.make([f"m{k}" for k in range(len(xyz))], xyz, normal=np.tile([0, 0, 1.0], (len(xyz), 1)),
                             radius=5.8, sigma=0.05)  # fmt: skip
    return image, markers, camera, pose


@pytest.mark.slow
@pytest.mark.parametrize(("jump", "turn"), [((40.0, 0.0), 0.0), ((0.0, 0.0), np.pi)], ids=["a pitch", "half a turn"])
def test_regular_rows_that_jump_by_their_own_pattern_are_not_followed_by_the_wrong_names(jump, turn):
    """Looked for where they were, most are there again: those that lie elsewhere now must be looked for, too."""
    rng, made = np.random.default_rng(5), []
    for k in range(8):
        after = k >= 5
        made.append(plate((0.3 * k + jump[0] * after, jump[1] * after), 0.002 * k + turn * after, rng))
    frames = list(follow(named([m[0] for m in made]), made[0][1], made[0][2], options=FollowOptions(radius_px=(5.0,))))
    assert [f.status for f in frames] == ["cold", *["tracked"] * 4, "reacquired", *["tracked"] * 2]
    assert frames[4].guided
    for frame, (_, markers, camera, pose) in zip(frames, made, strict=True):
        off = camera.project(frame.registered.cam_from_model.apply(markers.xyz))[0] - camera.project(
            pose.apply(markers.xyz))[0]  # fmt: skip
        assert np.abs(off).max() < 0.3
