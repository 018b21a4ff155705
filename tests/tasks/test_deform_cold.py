"""The first frame of a deformation test, and lost ones: cameras that stand still are searched as one."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes

from windmark.deformation import Volume, Volumes, law
from windmark.geometry import Pose
from windmark.pipeline.deform import DeformationTest, Station
from windmark.registration import NotRegistered
from windmark.scene import MarkerSet
from windmark.tasks.deform import cold
from windmark.tasks.deform.cold import anywhere, reasons
from windmark.tasks.deform.spots import Labelled
from windmark.tasks.deform.why import set_otherwise
from windmark.tasks.together import Together

NAMES = ("cam1", "cam2", "cam3")


@pytest.fixture
def pool():
    with ThreadPoolExecutor(2) as pool:
        yield pool


def made_of(rig, **of_stations):
    """The rig as a test; options of single stations by name."""
    stations = tuple(
        replace(Station(name, view.camera, pose), **of_stations.get(name, {}))
        for name, view, pose in zip(NAMES, rig.views, rig.cam_from_rig, strict=False)
    )
    return DeformationTest(stations, rig.views[0].markers, Volumes.of([]))


def spots_of(rig):
    return dict(zip(NAMES, [view.detections for view in rig.views], strict=False))


def wrong(labelled, view):
    """Spots with a marker that is not theirs."""
    place = {tuple(xy): label for xy, label in zip(view.detections.xy, view.label, strict=True)}
    return sum(place[tuple(xy)] != m for xy, m in zip(labelled.xy, labelled.marker, strict=True))


def far(pose, part):
    """A camera's pose with its place off by part of the distance."""
    return Pose(pose.rotation, pose.translation + part * np.linalg.norm(pose.translation) * np.array([1.0, 0.0, 0.0]))


def test_what_no_camera_can_find_alone_all_find_together(pool):
    rig = scenes.rig_scene(508, "A", 3, hidden=0.7, false=1.0)
    test, spots = made_of(rig), spots_of(rig)
    found = anywhere(spots, test, NAMES, pool)
    assert not found.left_out
    for name, view in zip(NAMES, rig.views, strict=False):
        assert len(found.labelled[name].marker) >= (view.label >= 0).sum() - 1
        assert wrong(found.labelled[name], view) == 0
    alone = anywhere(spots, test, (), pool).labelled  # pictures of different times are no rig
    assert [len(s.marker) for s in alone.values()] == [0, 0, 0]


def test_a_camera_that_moved_though_it_should_stand_is_left_out_and_named(pool):
    rig = scenes.rig_scene(520, "A", 3)
    test = made_of(rig, cam2={"cam_from_tunnel": far(rig.cam_from_rig[1], 0.05)})
    found = anywhere(spots_of(rig), test, NAMES, pool)
    assert list(found.left_out) == ["cam2"]
    assert found.left_out["cam2"].startswith("left out, it contradicts cam1, cam3: ")
    assert [len(found.labelled[n].marker) > 10 for n in NAMES] == [True, False, True]


def test_of_two_that_contradict_each_other_both_are_left_out(pool):
    rig = scenes.rig_scene(522, "A", 2)
    found = anywhere(spots_of(rig), made_of(rig, cam2={"cam_from_tunnel": far(rig.cam_from_rig[1], 0.05)}), NAMES, pool)
    assert set(found.left_out) == {"cam1", "cam2"}
    assert not any(len(s.marker) for s in found.labelled.values())
    assert reasons(found.labelled).startswith("cam1, cam2: model: ")


def test_a_camera_that_moves_is_searched_where_the_others_put_the_model(pool):
    """Its own place is not known, so it is no part of the rig and contradicts nobody."""
    rig = scenes.rig_scene(520, "A", 3)
    test = made_of(rig, cam2={"cam_from_tunnel": far(rig.cam_from_rig[1], 0.05), "moves": True})
    found = anywhere(spots_of(rig), test, NAMES, pool)
    assert not found.left_out
    for name, view in zip(NAMES, rig.views, strict=True):
        assert len(found.labelled[name].marker) > 10
        assert wrong(found.labelled[name], view) == 0


def test_walls_hold_a_camera_that_moves(pool):
    """Model and walls are matched, the walls give its pose."""
    rig = scenes.rig_scene(530, "C", 2)
    markers = rig.views[0].markers
    walls = np.arange(len(markers)) >= 60
    table = replace(markers, role=np.where(walls, "wall", "model"))
    rig = replace(rig, views=tuple(replace(v, markers=table) for v in rig.views))
    still = replace(rig, cam_from_rig=tuple(v.cam_from_model for v in rig.views), rig_from_model=Pose.identity())
    true = still.cam_from_rig[1]
    turned = Pose.from_rotvec([0.0, 0.02, 0.0], np.zeros(3)) @ true
    test = made_of(still, cam2={"cam_from_tunnel": turned, "moves": True})
    found = anywhere(spots_of(still), test, NAMES, pool).labelled["cam2"]
    assert walls[found.marker].any()
    assert not walls[found.marker].all()
    assert wrong(found, still.views[1]) == 0
    assert found.pose.angle_to(true) < 0.002


def test_cameras_without_spots_are_said_and_stop_no_other(pool):
    rig = scenes.rig_scene(523, "A", 2)
    found = anywhere({"cam1": "no radius prevails", "cam2": rig.views[1].detections}, made_of(rig), NAMES, pool)
    assert found.labelled["cam1"].reason == "no radius prevails"
    assert len(found.labelled["cam2"].marker) > 10
    assert list(found.labelled) == ["cam1", "cam2"]
    nothing = anywhere({"cam1": "dark", "cam2": "dark"}, made_of(rig), NAMES, pool)
    assert reasons(nothing.labelled) == "cam1, cam2: dark"
    assert reasons({"a": Labelled.none("dark"), "b": Labelled.none("blurred")}) == "a: dark; b: blurred"


def test_spots_of_hidden_markers_are_no_labels(pool):
    rig = scenes.rig_scene(520, "A", 3)
    first = rig.views[0].label[rig.views[0].label >= 0][0]
    seen = np.ones(len(rig.views[0].markers), bool)
    seen[first] = False
    test = replace(made_of(rig), visible=lambda pose, camera: seen)
    for spots in anywhere(spots_of(rig), test, NAMES, pool).labelled.values():
        assert len(spots.marker) > 10
        assert first not in spots.marker


def test_where_time_is_too_short_for_all_each_is_searched_alone(pool, monkeypatch):

    rig = scenes.rig_scene(520, "A", 2)
    refusal = Together(NotRegistered("stopped", "time"), ("cam1", "cam2"))
    monkeypatch.setattr(cold, "register_together", lambda *_, **__: refusal)
    found = anywhere(spots_of(rig), made_of(rig), NAMES, pool)
    assert not found.left_out
    assert all(len(s.marker) > 10 for s in found.labelled.values())


AXIS = np.array([0.4, 0.0, 0.0])


def turned_about(xyz, angle):
    """Points turned about a line along y."""
    turn = Pose.from_rotvec(np.radians(angle) * np.array([0.0, 1.0, 0.0]), np.zeros(3)).rotation
    return (xyz - AXIS) @ turn.T + AXIS


def flapped(rig, angle, start):
    """A test whose table has the trailing edge turned back by an angle: a flap that is set, with a law's start."""
    markers = rig.views[0].markers
    flap = np.arange(len(markers)) % 4 == 3
    xyz, normal = markers.xyz.copy(), markers.normal.copy()
    xyz[flap], normal[flap] = turned_about(xyz[flap], -angle), turned_about(normal[flap] + AXIS, -angle) - AXIS
    table = replace(markers, xyz=xyz, normal=normal, volume=np.where(flap, "flap", "wing"))
    laws = Volumes.of([Volume("wing"), Volume("flap", law(angle={"unit": "deg", "start": start})(turned_about))])
    return replace(made_of(rig), markers=table, volumes=laws), np.flatnonzero(flap)


def test_a_part_is_looked_for_where_its_law_starts(pool):
    """It is set against its table: nothing else moves with its parameter, so without its spots there is no answer."""
    rig = scenes.rig_scene(520, "A", 2)
    test, flap = flapped(rig, 25.0, 25.0)
    placed, true = cold.at_start(test), rig.views[0].markers
    assert placed.xyz == pytest.approx(true.xyz, abs=1e-9)
    assert placed.normal == pytest.approx(true.normal / np.linalg.norm(true.normal, axis=1)[:, None], abs=1e-9)
    of_start = anywhere(spots_of(rig), test, NAMES, pool).labelled
    of_table = anywhere(spots_of(rig), flapped(rig, 25.0, 0.0)[0], NAMES, pool).labelled
    for name, view in zip(NAMES, rig.views, strict=False):
        there = np.intersect1d(view.label, flap)
        assert len(np.intersect1d(of_start[name].marker, there)) >= len(there) - 1 > 2
        assert not np.intersect1d(of_table[name].marker, there).size
        assert wrong(of_start[name], view) == 0


def test_normals_are_turned_by_a_law_that_is_written_for_a_plane():
    """What is beside the plane it does not turn: a line along the normal stayed as it was."""
    xyz, up = [[0.0, 10, 0], [5, 30, 0], [9, 20, 0]], [[0.0, 0, 1]] * 3
    table = MarkerSet.make(["a", "b", "c"], xyz, normal=up, volume="flap")

    def planar(x, angle):
        a = np.radians(angle)
        return np.c_[x[:, 0], x[:, 1] * np.cos(a), x[:, 2] + x[:, 1] * np.sin(a)]

    laws = Volumes.of([Volume("flap", law(angle={"unit": "deg", "start": 60.0})(planar))])
    test = replace(made_of(scenes.rig_scene(520, "A", 1)), markers=table, volumes=laws)
    assert cold.at_start(test).normal == pytest.approx(np.tile([0, -np.sin(np.pi / 3), 0.5], (3, 1)), abs=1e-6)


def test_markers_at_rest_are_the_tests_own():
    test, _ = flapped(scenes.rig_scene(520, "A", 2), 0.0, 0.0)
    assert cold.at_start(test) is test.markers


def test_spots_where_no_marker_is_expected_may_be_a_parts_that_is_set_otherwise(pool):
    rig = scenes.rig_scene(520, "A", 2)
    spots, (test, _) = spots_of(rig), flapped(rig, 25.0, 0.0)
    labelled = anywhere(spots, test, NAMES, pool).labelled
    said = set_otherwise("not determined: flap.angle; no marker that is seen moves with it", test, labelled, spots)
    assert said.startswith("not determined: flap.angle; no marker that is seen moves with it; but spots are seen where")
    assert "if they are those of flap, it is set otherwise" in said
    assert "give flap.angle a start and a sigma" in said
    for why, seen, every in (
        ("12 observations cannot tell 13 unknowns", labelled, spots),  # it is not this part that is wanted
        ("not determined: flap.angle", labelled, {n: s.take(s.xy[:, 0] < 0) for n, s in spots.items()}),  # no spots
        ("not determined: flap.angle", anywhere(spots, flapped(rig, 0.0, 0.0)[0], NAMES, pool).labelled, spots),
    ):
        assert set_otherwise(why, test, seen, every) == why


def few_walls(moved_px=0.0):
    """Two cameras before a model of 60 markers and five on walls, which are no pattern among so many spots."""
    rig = scenes.rig_scene(530, "C", 2)
    markers = rig.views[0].markers
    keep = np.r_[np.arange(60), [66, 73, 88, 91, 104]]
    table = replace(markers.take(keep), role=np.where(keep >= 60, "wall", "model"))
    place = np.full(len(markers), -1)
    place[keep] = np.arange(len(keep))
    views = []
    for view in rig.views:
        there = (view.label >= 0) & (place[view.label] >= 0)
        own, label = view.detections.take(there), place[view.label[there]]
        views.append(replace(view, detections=own, label=label, markers=table))
    rig = replace(rig, views=tuple(views), cam_from_rig=tuple(v.cam_from_model for v in rig.views),
                  rig_from_model=Pose.identity())  # fmt: skip
    turned = Pose.from_rotvec([0.0, moved_px / views[1].camera.focal_px, 0.0], np.zeros(3)) @ rig.cam_from_rig[1]
    return rig, turned, keep >= 60


@pytest.mark.parametrize(("moved_px", "cov", "found"), [(0.0, None, True), (5.0, None, True), (60.0, None, False),
                                                        (5.0, 1e-4 * np.eye(6), False)])  # fmt: skip
def test_few_walls_are_looked_for_where_the_file_has_a_camera_that_moves(pool, moved_px, cov, found):
    """Farther off than they can be told from others there are none; and where its pose is known it is held by that."""
    rig, turned, walls = few_walls(moved_px)
    test = made_of(rig, cam2={"cam_from_tunnel": turned, "moves": True, "pose_cov": cov})
    labelled = anywhere(spots_of(rig), test, NAMES, pool).labelled["cam2"]
    there = np.intersect1d(rig.views[1].label, np.flatnonzero(walls))
    assert len(labelled.marker) > 10
    assert wrong(labelled, rig.views[1]) == 0
    assert (len(np.intersect1d(labelled.marker, there)) >= 3) == found
