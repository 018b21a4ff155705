"""What scenes show of residuals, of instants of a deforming model, of a followed one and of a checked layout."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from windmark.app import standing_scene as parts
from windmark.app.check_scene import check_scene
from windmark.app.residual_shifts import SeenBy, residual_shifts
from windmark.app.scene_document import documents
from windmark.app.track_scene import track_scene
from windmark.geometry import Camera, Pose
from windmark.pipeline.deform.followed import Standing
from windmark.pipeline.track_results import PoseRow
from windmark.scene import MarkerSet
from windmark.tasks.marker_check import Change
from windmark.tasks.marker_check.table import Finding

CAMERA = Camera((1200, 800), 1500.0, aspect=1.1)
POSES = {"cam1": Pose.look_at([10, -20, 400], [40, 20, 0], [0, 1, 0]),
         "cam2": Pose.look_at([300, 30, 350], [40, 20, 0], [0, 1, 0])}  # fmt: skip


def sheet():
    x, y = np.meshgrid([0.0, 40, 80], [0.0, 25, 50])
    return MarkerSet.make([f"M{k}" for k in range(9)], np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]))


def seen_by(name, xyz, moved, marker, frame=None):
    """What a camera has of markers that stand at ``moved`` and are expected at ``xyz``, small apart."""
    pose = POSES[name] if frame is None else POSES[name] @ frame.inverse()
    residual = CAMERA.project(pose.apply(xyz[marker]))[0] - CAMERA.project(pose.apply(moved[marker]))[0]
    return SeenBy(name, CAMERA, pose, marker, residual)


def test_two_pictures_tell_how_a_marker_is_off_in_space_and_one_across_it():
    xyz, rng = sheet().xyz, np.random.default_rng(3)
    off = rng.normal(0, 0.02, (9, 3))
    both, first = np.arange(9), np.array([0, 2, 5])
    told = residual_shifts("both", [seen_by(n, xyz, xyz + off, both) for n in POSES], xyz, "mm")
    assert told.vectors == pytest.approx(off, abs=1e-4)
    assert told.notes[4].count("found − expected") == 2
    one = residual_shifts("one", [seen_by("cam1", xyz, xyz + off, first)], xyz, "mm")
    assert np.isnan(one.vectors[1]).all()
    assert one.notes[1] == ""
    sight = xyz[first] - POSES["cam1"].center
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    across = off[first] - (off[first] * sight).sum(axis=1, keepdims=True) * sight
    assert one.vectors[first] == pytest.approx(across, abs=1e-4)
    assert residual_shifts("none", [seen_by("cam1", xyz, xyz, first[:0])], xyz, "mm") is None


def test_an_instant_is_the_same_seen_from_the_tunnel_and_from_the_model():
    markers = replace(sheet(), role=np.array(["model"] * 8 + ["wall"]))
    motion, off = Pose.exp([0.05, -0.02, 0.1, 3.0, 1.0, -2.0]), np.tile([0.01, -0.02, 0.03], (9, 1))
    xyz = motion.apply(markers.xyz)
    residuals = {}
    for name in POSES:
        one = seen_by(name, xyz, xyz + off, np.array([8, 0, 3, 7]))
        residuals[name] = one.marker, one.residual
    standing = Standing(motion, xyz, {n: (CAMERA, p) for n, p in POSES.items()}, residuals)
    for of_model in (False, True):
        told = parts.shifts("p", standing, markers, "mm", of_model=of_model)
        back = motion.inverse().rotation if of_model else np.eye(3)
        assert len(told.vectors) == 8  # the wall's marker is none of the model's
        assert told.vectors[3] == pytest.approx(back @ off[3], abs=1e-4)
        drawn = parts.places([standing], of_model=of_model)[0]
        for station in parts.stations(standing, of_model=of_model):
            assert station.cam_from_model.apply(drawn) == pytest.approx(POSES[station.name].apply(xyz), abs=1e-9)


def row(k, pose):
    marker = np.array([0, 4, 8])
    return PoseRow(k, f"f{k}.tif", float(k), "tracked" if pose else "lost", "", True, 0.1, 3 if pose else 0, 9, 0.05,
                   np.zeros(6), np.zeros(6), pose, (marker, np.tile([10.0, 20, 0.03, -0.04], (3, 1))) if pose
                   else (marker[:0], np.zeros((0, 4))))  # fmt: skip


def test_a_followed_model_has_a_camera_in_each_image_and_a_gap_where_it_was_lost():
    rows = [row(0, POSES["cam1"]), row(1, None), row(2, POSES["cam2"]), row(3, POSES["cam1"])]
    scene = track_scene(rows, sheet(), CAMERA, "mm")
    assert [len(of) for of in scene.frames.stations] == [1, 0, 1, 1]
    assert scene.frames.shifts[1] is None
    assert "found − expected −0.03, +0.04 px" in scene.frames.shifts[2].notes[4]
    assert scene.cuts[0].piece.tolist() == [0, 1, 1]
    assert documents(scene, "s")
    assert track_scene(rows[1:2], sheet(), CAMERA, "mm") is None


def test_findings_of_a_layout_are_coloured_and_said():
    markers = replace(sheet(), sigma=np.full((9, 3), 0.02), normal=np.tile([0.0, 0, 1], (9, 1)))
    onto = np.full(9, -1)
    onto[[0, 1]] = 1, 4
    check = SimpleNamespace(
        stage=SimpleNamespace(markers=markers, mesh=None), unit="mm",
        findings=[Finding("close", "M1 and M2 are too close", ("M1", "M2")), Finding("flat", "flat")],
        symmetries=[SimpleNamespace(onto=onto)],
        proposals=[SimpleNamespace(changes=[Change("M5", np.array([1.0, 2, 3]), np.zeros(3), markers.xyz[5], ())])],
    )  # fmt: skip
    scene = check_scene(check)
    groups = {words: of for _, words, of in scene.markers.groups}
    assert groups == {"too close to another one": (1, 2), "brought onto another one by the nearest symmetry": (0,),
                      "proposed: moved to here": (9,)}  # fmt: skip
    assert "brought onto M4 by the nearest symmetry" in scene.markers.notes[1]
    assert len(scene.cuts[0].xyz) == 4
    assert len(scene.markers.cov) == 10
    assert documents(scene, "s")
