"""Labels without a prediction: spots nearest to the last places, and a sheet that jumps by more than is looked for."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from windmark.deformation import Volumes
from windmark.geometry import Camera, Pose
from windmark.pipeline.deform import DeformationTest, FrameImages, Station, follow_deformation
from windmark.scene import Detections, MarkerSet
from windmark.scene.repeated import ONCE_MORE
from windmark.synth import disc_image
from windmark.tasks.deform import finding
from windmark.tasks.deform import follow as follow_module
from windmark.tasks.deform import sights as sights_module
from windmark.tasks.deform.cold import Found
from windmark.tasks.deform.settling import Settler
from windmark.tasks.deform.spots import Labelled, around
from windmark.tasks.deform.task import LookOptions, Shot
from windmark.tasks.odd import nearest_spots, together

CAMERA, AWAY = Camera((400, 300), 800.0), Pose(np.eye(3), np.array([0.0, 0.0, 800.0]))
PLACES = np.array([
    [-120, -80, 0], [-60, -95, 0], [10, -70, 0], [90, -100, 0], [140, -40, 0], [60, -20, 0], [-20, 0, 0],
    [-100, 10, 0], [-130, 80, 0], [-40, 70, 0], [40, 90, 0], [120, 60, 0],
], float)  # fmt: skip


def markers():
    names = [f"m{k}" for k in range(len(PLACES))]
    return MarkerSet.make(names, PLACES, radius=5.0, normal=np.tile([0.0, 0.0, -1.0], (len(PLACES), 1)))


def spots(xy):
    n = len(xy)
    return Detections(
        np.asarray(xy, float), np.tile(0.01 * np.eye(2), (n, 1, 1)), np.zeros(n), np.full(n, 5.0), np.full((n, 2), 5.0),
        np.zeros(n), np.ones(n), np.zeros(n, np.int64),
    )  # fmt: skip


def image(shift):
    xy = CAMERA.project(AWAY.apply(PLACES + np.array([*shift, 0.0])))[0]
    share = np.prod([disc_image((300, 400), place, 5.0, level=1.0, depth=0.8, blur_px=0.6) for place in xy], axis=0)
    return np.rint(share * 200).astype(np.uint8)


def test_every_marker_takes_the_spot_that_is_clearly_nearest():
    table = markers()
    xy = CAMERA.project(AWAY.apply(PLACES))[0]
    order = np.random.default_rng(3).permutation(len(xy))
    seen = around(spots(xy[order] + np.array([9.0, -7.0])), CAMERA, AWAY, table)
    assert seen.marker.tolist() == list(range(len(xy)))
    assert seen.xy == pytest.approx(xy + np.array([9.0, -7.0]))


def test_two_spots_about_as_near_are_no_label_and_one_spot_is_one_markers():
    table = markers()
    xy = CAMERA.project(AWAY.apply(PLACES))[0]
    beside = np.vstack([xy, xy[3] + [12.0, 0.0]])
    beside[3] += [-8.0, 0.0]
    assert 3 not in around(spots(beside), CAMERA, AWAY, table).marker
    fewer = np.delete(xy, 5, axis=0)  # what was nearest to marker 5 belongs to another one
    assert around(spots(fewer), CAMERA, AWAY, table).marker.tolist() == [k for k in range(len(xy)) if k != 5]


def test_without_spots_there_is_a_reason():
    assert around("no radius prevails", CAMERA, AWAY, markers()).reason == "no radius prevails"
    assert "too few" in around(spots(np.zeros((1, 2))), CAMERA, AWAY, markers()).reason
    assert "clearly nearest" in around(spots([[0, 0], [1, 0]]), CAMERA, AWAY, markers()).reason


def test_a_jump_that_the_search_of_the_whole_image_refuses_is_followed_by_the_nearest_spots(monkeypatch):
    test = DeformationTest((Station("cam", CAMERA, AWAY),), markers(), Volumes.of([]), look=LookOptions((5.0,)))
    images = [image((0, 0)), image((1, 0)), image((18, -6))]
    frames = [FrameImages(str(k), float(k), {"cam": i}) for k, i in enumerate(images)]
    followed = follow_deformation(frames, test)
    assert [next(followed).status for _ in range(2)] == ["cold", "tracked"]
    monkeypatch.setattr(finding, "anywhere", lambda *_: Found({"cam": Labelled.none("refused")}))
    jumped = next(followed)
    assert jumped.status == "tracked"
    assert "nearest to the last good frame's: " in jumped.reason
    assert "refused" in jumped.reason
    assert jumped.state.tunnel_from_model.translation[:2] == pytest.approx([18, -6], abs=0.02)
    assert sorted(jumped.observations.point.tolist()) == list(range(len(PLACES)))


def test_a_picture_that_shows_what_the_one_before_showed_is_said_and_no_other():
    """A recording that dropped a picture gives the one before it once more; a model that stands still has new noise."""
    test = DeformationTest((Station("cam", CAMERA, AWAY),), markers(), Volumes.of([]), look=LookOptions((5.0,)))
    rng = np.random.default_rng(5)
    still, again, moved = (image(s) + rng.integers(0, 4, (300, 400), np.uint8) for s in ((0, 0), (0, 0), (1, 0)))
    frames = [FrameImages(str(k), float(k), {"cam": i}) for k, i in enumerate([still, again, moved, moved.copy()])]
    reasons = [(f.reason, f.cameras["cam"].reason) for f in follow_deformation(frames, test)]
    assert [ONCE_MORE in in_frame and ONCE_MORE in of_camera for in_frame, of_camera in reasons] == [
        False, False, False, True,
    ]  # fmt: skip
    assert reasons[0] == reasons[1] == reasons[2] == ("", "")


def test_a_copied_picture_is_said_where_its_spots_were_looked_for_from_elsewhere(monkeypatch):
    """Fitted from another prediction a spot differs by a part of its noise; of two copied cameras one was named."""
    monkeypatch.setattr(sights_module, "is_repeated", lambda *_: False)
    test = DeformationTest((Station("cam", CAMERA, AWAY),), markers(), Volumes.of([]), look=LookOptions((5.0,)))
    images = [image((0, 0)), image((1, 0)), image((1, 0)), image((2, 0))]
    frames = [FrameImages(str(k), float(k), {"cam": i}) for k, i in enumerate(images)]
    followed = list(follow_deformation([*frames, FrameImages("4", 4.0, {"cam": images[0].copy()})], test))
    assert [ONCE_MORE in f.reason for f in followed] == [False, False, True, False, False]
    zeroth, first, second, third, fourth = (f.cameras["cam"].picture for f in followed)
    assert (fourth, second) == (zeroth, first)  # for the verdict, which knows all frames
    assert len({zeroth, first, third, 0}) == 4


def test_a_camera_between_whose_pictures_is_interpolated_is_no_copy_of_itself():
    """At instants close to each other a still model is where it was, but for a part of the noise of both pictures."""
    stations = tuple(Station(name, CAMERA, AWAY) for name in ("own", "slow"))
    test = DeformationTest(stations, markers(), Volumes.of([]), look=LookOptions((5.0,)))
    rng = np.random.default_rng(6)

    def still():
        return image((0, 0)) + rng.integers(0, 4, (300, 400), np.uint8)

    first, second = Shot(0.0, still()), Shot(1.0, still())
    frames = [FrameImages("0", 0.0, {"own": still(), "slow": first.image})]
    frames += [
        FrameImages(str(k), t, {"own": still(), "slow": first.image}, {"slow": (first, second)})
        for k, t in enumerate((0.2, 0.21, 0.22), 1)
    ]
    followed = list(follow_deformation(frames, test))
    assert [f.cameras["slow"].reason for f in followed][1:] == ["", "", ""]
    assert [f.cameras["slow"].picture for f in followed][1:] == [0, 0, 0]


def test_a_disc_that_the_border_cuts_takes_no_part_until_it_is_whole_again():
    """Marker 8 is the first to leave the image on the left; what is seen of it would be a place by guess."""
    test = DeformationTest((Station("cam", CAMERA, AWAY),), markers(), Volumes.of([]), look=LookOptions((5.0,)))
    shifts = [-60.0, -62.0, -66.0, -67.0, -61.0]  # its disc ends 4.5, 2.5, -1.5, -2.5 and 3.5 px from the border
    frames = [FrameImages(str(k), float(k), {"cam": image((s, 0))}) for k, s in enumerate(shifts)]
    followed = list(follow_deformation(frames, test))
    assert [8 in f.observations.point for f in followed] == [True, True, False, False, True]
    assert all(set(f.observations.point) >= set(range(12)) - {8} for f in followed)
    for frame, shift in zip(followed, shifts, strict=True):
        assert frame.state.tunnel_from_model.translation[0] == pytest.approx(shift, abs=0.02)


def test_a_marker_that_is_beside_its_place_in_the_table_is_said_in_every_frame():
    """Its spot is there, out of reach of where it is looked for; a marker that is gone has none to be beside."""
    table = markers()
    wrong = replace(table, xyz=table.xyz + np.eye(12)[:, 5:6] * [6.0, -5.0, 0.0])
    for known, odd in ((wrong, {"m5": pytest.approx((7.81, 7.81), abs=0.05)}), (table, {})):
        test = DeformationTest((Station("cam", CAMERA, AWAY),), known, Volumes.of([]), look=LookOptions((5.0,)))
        frames = [FrameImages(str(k), float(k), {"cam": image((k, 0))}) for k in range(3)]
        followed = list(follow_deformation(frames, test))
        assert [f.status for f in followed] == ["cold", "tracked", "tracked"]
        assert all(dict(f.cameras["cam"].odd) == odd for f in followed)
        assert all(f.cameras["cam"].blur_px == pytest.approx(0.6, abs=0.1) for f in followed)


def test_a_spot_so_near_to_a_place_is_chance_where_spots_are_dense():
    place = np.array([[100.0, 100.0]])
    alone, chance = nearest_spots(place, np.array([[103.0, 104.0]]), (400, 300))
    assert alone == pytest.approx([5.0])
    assert chance == pytest.approx([np.pi * 25 / 120_000])
    many = np.random.default_rng(1).uniform(0, [400, 300], (5000, 2))
    assert nearest_spots(place, np.vstack([many, [[103.0, 104.0]]]), (400, 300))[1][0] > 0.01
    assert nearest_spots(place, np.zeros((0, 2)), (400, 300)) == (np.inf, 1.0)


def test_chances_of_several_pictures_together():
    """Of pictures that show nothing the combined chance is uniform again: 1 % of them are below 1 %."""
    assert together([0.03]) == pytest.approx(0.03)
    drawn = np.random.default_rng(4).uniform(size=(20_000, 6))
    combined = np.array([together(row) for row in drawn])
    assert np.mean(combined < 0.01) == pytest.approx(0.01, abs=0.003)
    assert np.mean(combined < 0.5) == pytest.approx(0.5, abs=0.02)
    assert together([1e-3] * 12) < 1e-10


@pytest.mark.parametrize(("far", "odd"), [(220.0, {}), (6.0, {5: (6.0, 6.0)})])
def test_a_spot_at_a_markers_own_place_in_one_camera_makes_no_other_one_of_the_next_camera_its(monkeypatch, far, odd):
    """One camera sees the marker where it is: what is beside it in the other one has to be unlikely by itself."""
    near = {"left": (0.1, 0.1, 1e-9), "right": (far, far, np.pi * far**2 / (400 * 300))}
    found = lambda _spots, _own, _at, station, *_: [(5, *near[station.name])]  # noqa: E731
    monkeypatch.setattr(sights_module, "_without_spot", found)
    stations = tuple(Station(name, CAMERA, AWAY) for name in near)
    test = DeformationTest(stations, markers(), Volumes.of([]), look=LookOptions((5.0,)))
    every = spots(CAMERA.project(AWAY.apply(PLACES))[0])
    labelled = {name: around(every, CAMERA, AWAY, markers()) for name in near}
    monkeypatch.setattr(sights_module, "displaced", lambda table, _state: table)
    usual = sights_module.Usual()
    usual.learn_odd(dict.fromkeys(near, every), test, labelled, None, {})
    assert usual.odd["right"] == odd
    assert usual.odd["left"] == {}


class _Interrupted(Exception):
    pass


@pytest.mark.parametrize("where", ["_remember", "_together", "_sights", "identify"])
def test_a_frame_that_is_broken_off_leaves_what_was_handed_on_as_it_was(monkeypatch, where):
    """Resumed, that frame was called a copy of the one before: its own print was among what had been handed on."""
    stations = tuple(Station(name, CAMERA, AWAY) for name in ("own", "slow"))
    test = DeformationTest(stations, markers(), Volumes.of([]), look=LookOptions((5.0,)))
    rng = np.random.default_rng(9)
    seen = {(n, k): image((k, 0)) + rng.integers(0, 4, (300, 400), np.uint8) for n in ("own", "slow") for k in range(5)}
    frames = []
    for k in range(4):
        early = k - k % 2
        shots = tuple(Shot(float(t), seen["slow", t]) for t in (early, early + 2))
        images = {"own": seen["own", k], "slow": seen["slow", early]}
        frames.append(FrameImages(str(k), float(k), images, {"slow": shots} if k % 2 else {}))
    kept = {}
    followed = follow_deformation(frames, test, handed_on=kept)
    for _ in range(3):
        next(followed)
    before = pickle.dumps(kept)

    def broken(*_, **__):
        raise _Interrupted

    monkeypatch.setattr(Settler if where == "identify" else follow_module._Follower, where, broken)
    with pytest.raises(_Interrupted):
        next(followed)
    assert pickle.dumps(kept) == before


def test_a_camera_of_half_the_rate_shows_its_pictures_once_and_one_that_stands_still_is_said():
    """The picture of an instant is also the later one of the two that the instant before it was between."""
    stations = tuple(Station(name, CAMERA, AWAY) for name in ("own", "slow"))
    test = DeformationTest(stations, markers(), Volumes.of([]), look=LookOptions((5.0,)))
    rng = np.random.default_rng(8)
    seen = [image((0, 0)) + rng.integers(0, 4, (300, 400), np.uint8) for _ in range(5)]

    def reasons(slow):
        frames = []
        for k in range(5):
            if k % 2 == 0:
                frames.append(FrameImages(str(k), float(k), {"own": seen[k], "slow": slow[k]}))
            else:
                shots = Shot(k - 1.0, slow[k - 1]), Shot(k + 1.0, slow[k + 1])
                frames.append(FrameImages(str(k), float(k), {"own": seen[k], "slow": slow[k + 1]}, {"slow": shots}))
        return [ONCE_MORE in f.cameras["slow"].reason for f in follow_deformation(frames, test)]

    slow = {k: image((0, 0)) + rng.integers(0, 4, (300, 400), np.uint8) for k in (0, 2, 4)}
    assert reasons(slow) == [False] * 5
    assert reasons({**slow, 4: slow[2].copy()}) == [False, False, False, False, True]
