"""What frames say together that none of them says by itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from windmark.deformation import Deformation, Volume, Volumes, law, weak_directions
from windmark.deformation.lasting import _false
from windmark.geometry import Camera, Pose
from windmark.pipeline.journal_values import dumped, loaded
from windmark.scene import MarkerSet, Observations
from windmark.tasks.deform.series import Series
from windmark.tasks.deform.states import state_of
from windmark.tasks.deform.task import DeformationTest, FrameImages, Shot, Station

NOISE = 0.02
CAMERA = Camera((1280, 1024), 2090.0)
TARGET = np.array([200.0, 250.0, 0.0])


def markers():
    """40 on a wing, 12 on a body, 10 on a wall behind."""
    rng = np.random.default_rng(0)
    wing = np.c_[rng.uniform(0, 150, 40) + 120, np.linspace(80, 580, 40), rng.uniform(-4, 4, 40)]
    body = np.c_[rng.uniform(0, 450, 12), rng.uniform(-60, 40, 12), rng.uniform(20, 50, 12)]
    wall = np.c_[rng.uniform(0, 450, 10), rng.uniform(0, 550, 10), rng.uniform(-152, -148, 10)]
    volume, role = ["wing"] * 40 + ["body"] * 12 + [""] * 10, ["model"] * 52 + ["wall"] * 10
    return MarkerSet.make([f"m{k}" for k in range(62)], np.vstack([wing, body, wall]), volume=volume, role=role)


MARKERS = markers()
WALL = MARKERS.role == "wall"


@law(tip="mm")
def bend(xyz, tip):
    """Up by the square of the way from the root to the tip."""
    return xyz + np.outer((np.maximum(xyz[:, 1] - 60, 0) / 540) ** 2, [0, 0, tip])


VOLUMES = Volumes.of([Volume("wing", bend, parent="body"), Volume("body")])


def made(only=slice(None), moves=False, **given):
    poses = [Pose.look_at(TARGET + 1045 * np.array([np.sin(a), 0.1 * a, np.cos(a)]), TARGET, [0, 1, 0])
             for a in np.radians([-30, 30])]  # fmt: skip
    known = np.diag([3e-3**2] * 3 + [4.0] * 3) if moves else None
    stations = tuple(Station(f"cam{k + 1}", CAMERA, pose, moves, known) for k, pose in enumerate(poses))
    markers = MARKERS.take(np.arange(len(MARKERS))[only])
    sure = np.tile(1e-6 * np.eye(3), (len(markers), 1, 1))
    return DeformationTest(stations, markers, VOLUMES, **{"marker_cov": sure, **given})


def places(size=0.0, shift=(0, 0, 0), turn=0.0, bent=None):
    """Markers in the tunnel, the tip bent by ``size``, and by ``bent`` (N, 3) of no law."""
    xyz = VOLUMES.bind(MARKERS.xyz, np.where(WALL, "", MARKERS.volume)).place(np.array([size]))
    xyz = xyz if bent is None else xyz + bent
    moved = Pose(Rotation.from_rotvec([0, np.radians(turn), 0]).as_matrix(), np.asarray(shift, float)).apply(xyz)
    return np.where(WALL[:, None], MARKERS.xyz, moved)


def followed(states, test, seed, *, late=0, series=None, shots=(), first=0, key=0, walls=True, true=None, seconds=False,
             second=None, only=slice(None), refused=False):  # fmt: skip
    """Frames of states (places), the second camera ``late`` frames behind; the series and the states of the frames."""
    rng, before, out = np.random.default_rng(seed), None, []
    series = Series.of(test) if series is None else series
    poses = {s.name: s.cam_from_tunnel for s in test.stations}
    for k in range(len(states)):
        stand = [s.cam_from_tunnel for s in (test if true is None else true).stations]
        now = states[k], states[max(k - late, 0)] if second is None else second[k]
        xy = [CAMERA.project(pose.apply(state[only]))[0] for state, pose in zip(now, stand, strict=True)]
        row = np.arange(len(test.markers))
        xy = np.concatenate(xy) + NOISE * rng.standard_normal((2 * len(row), 2))
        cov = np.tile(NOISE**2 * np.eye(2), (len(xy), 1, 1))
        view, point = np.repeat([0, 1], len(row)), np.tile(row, 2)
        seen = walls | ~WALL[only][point]
        spots = Observations(view[seen], point[seen], xy[seen], cov[seen])
        kept = []
        answer = state_of(spots, poses, test, before, test.marker_cov, keep=kept.append)
        if refused and not isinstance(answer, Deformation):
            series = series.plus(kept[-1], FrameImages(str(k), float(k), {}), odd=True)
            continue
        assert isinstance(answer, Deformation), answer.reason
        if k >= first:
            between = {"cam2": shots} if shots else {}
            odd = any(d.cause in ("moved", "picture") for d in answer.doubts)
            time = float(key + k)
            frame = FrameImages(str(key + k), time, {}, shots=between, time_s=time if seconds else np.nan)
            series = series.plus(kept[-1], frame, odd=odd)
        before = answer
        out.append(series.judged(answer))
    return series, out


def plunge(step):
    """Still at first, then down at a steady rate."""
    return [places(shift=(0, 0, step * max(k - 2, 0)), turn=0.1 * step * max(k - 2, 0)) for k in range(9)]


def test_a_camera_one_frame_late_is_named_where_no_frame_tells_it_and_the_sigmas_have_it():
    test, states = made(), plunge(0.1)
    series, found = followed(states, test, 1, late=1)
    (doubt,) = series.doubts
    assert (doubt.cause, doubt.names) == ("late", ("cam2",))
    assert "pictures of cam2 show the model" in str(doubt)  # of the frame before
    assert "frames earlier than those of cam1" in str(doubt)
    assert series.late.value == pytest.approx(1.0, abs=3 * series.late.sigma)
    last = found[-1]
    assert doubt in last.doubts
    at = np.flatnonzero(~WALL)
    moved, cov = (column[at] for column in last.markers_displaced())
    off = moved - (states[-1] - MARKERS.xyz)[at]
    assert np.all(np.abs(off) < 4 * np.sqrt(np.diagonal(cov, axis1=1, axis2=2)))
    alone = followed(states[-2:], test, 1, series=Series.of(test))[1][-1]  # what it would be without
    assert last.cov[1, 1] > alone.cov[1, 1]


def test_the_camera_that_shows_an_earlier_moment_is_the_one_that_is_said_to_and_times_are_in_seconds():
    """The words had it the other way round, and called seconds frames."""
    series, _ = followed(plunge(0.1), made(), 1, late=1, seconds=True)
    (doubt,) = series.doubts
    assert doubt.names == ("cam2",)
    assert " s earlier than those of cam1" in str(doubt)


def test_where_it_moves_faster_it_is_late_and_not_said_to_have_moved():
    series, found = followed(plunge(0.25), made(), 2, late=1)
    assert [d.cause for d in series.doubts] == ["late"]
    assert {d.cause for state in found[4:] for d in state.doubts} <= {"late", "noise"}


def test_a_camera_is_late_for_as_long_as_it_is():
    """Markers whose places are not known better than the spots are wrong alike in all frames: they count less there."""
    test = made(marker_cov=np.tile(0.01**2 * np.eye(3), (len(MARKERS), 1, 1)))
    states = [places(shift=(0, 0, 0.3 * k), turn=0.03 * k) for k in range(30)]
    series, _ = followed(states, test, 4, late=1)
    assert [d.cause for d in series.doubts] == ["late"]


@pytest.mark.parametrize("period", [2, 6])
def test_how_late_a_camera_is_is_no_better_known_than_the_motion_between_two_frames(period):
    states = [places(0.4 * s, (0.1 * s, 0, 0.2 * s), 0.01 * s) for s in np.cos(2 * np.pi / period * np.arange(10))]
    series, _ = followed(states, made(), 1, late=1)
    late = series.late
    assert late is not None
    assert abs(late.value - 1.0) < 2 * late.sigma
    assert late.sigma > 0.1


@pytest.mark.parametrize("seed", range(3))
def test_cameras_in_step_are_not_late(seed):
    series, found = followed(plunge(0.2), made(), seed)
    assert not series.doubts
    assert not any(state.doubts for state in found)


def test_a_camera_that_stands_a_little_off_is_not_late():
    test, away = made(), Pose.exp(np.array([1e-5, 2e-5, 0, 0, 0, 0]))
    first, second = test.stations
    off = replace(second, cam_from_tunnel=away @ second.cam_from_tunnel)
    series, _ = followed(plunge(0.1), replace(test, stations=(first, off)), 3)
    assert not series.doubts


def test_a_camera_that_was_pushed_once_is_not_late():
    test, states = made(), plunge(0.1)
    series = Series.of(test)
    for k in range(4, 9):  # pushed before the fifth frame, and by the last one that is followed
        first, second = test.stations
        pushed = replace(second, cam_from_tunnel=Pose.exp(np.array([2e-4, 0, 0, 0, 0, 0])) @ second.cam_from_tunnel)
        series, _ = followed(states[:5], test, k)
        series, _ = followed(states[5:6], replace(test, stations=(first, pushed)), k, series=series, key=5)
        assert not any(d.cause == "late" for d in series.doubts)


def nudged(test, turn):
    """The same test where the second camera is turned a little."""
    first, second = test.stations
    off = Pose.exp(np.array([turn, 0.3 * turn, 0, 0, 0, 0])) @ second.cam_from_tunnel
    return replace(test, stations=(first, replace(second, cam_from_tunnel=off)))


def test_a_camera_pushed_after_wind_off_is_named_by_all_frames_together_and_no_frame_says_another_reason():
    test, states = made(wind_off=("0", "1")), [places()] * 2 + [places(0.3 * k, (0, 0, 0.3 * k)) for k in range(1, 8)]
    series, _ = followed(states[:2], test, 6)
    series, found = followed(states[2:], test, 7, series=series, key=2, true=nudged(test, 4e-5))
    (doubt,) = series.doubts
    assert (doubt.cause, doubt.names) == ("moved", ("cam2",))
    assert "by all frames together" in str(doubt)
    assert {d.cause for state in found[3:] for d in state.doubts} == {"moved"}
    off = sigmas_off(found[-1], states[-1])[~WALL]
    assert np.abs(off).max() < 4


@pytest.mark.parametrize("walls", [True, False])
@pytest.mark.parametrize("seed", range(2))
def test_cameras_that_stand_where_they_should_are_not_said_to_have_been_pushed(walls, seed):
    states = [places()] * 2 + [places(0.3 * k, (0, 0, 0.3 * k)) for k in range(1, 8)]
    series, found = followed(states, made(wind_off=("0", "1")), seed, walls=walls)
    assert not series.doubts
    assert not any(state.doubts for state in found)


def test_spots_between_two_pictures_tell_no_lateness():
    series, _ = followed(plunge(0.1), made(), 1, late=1, shots=(Shot(0.0, None), Shot(1.0, None)))
    assert not series.doubts


def swinging(times, size=1.0):
    """A wing that swings with a period of 12."""
    angle = 2 * np.pi / 12 * np.asarray(times)
    return [places(3.0 * size * s, (0.5 * size * s, 0.2 * size * c, size * s), 0.1 * size * s)
            for s, c in zip(np.sin(angle), np.cos(angle), strict=True)]  # fmt: skip


def test_a_camera_whose_clock_runs_fast_is_named_with_its_rate_and_the_sigmas_have_what_it_is_by_now():
    times = np.arange(20)
    series, found = followed(swinging(times), made(), 1, seconds=True, second=swinging(0.997 * times))
    (doubt,) = series.doubts
    assert (doubt.cause, doubt.names) == ("late", ("cam2",))
    rate, sigma = series.late.rate
    assert rate == pytest.approx(0.003, abs=3 * sigma)
    assert sigma < 0.0005
    assert str(doubt).startswith("cam2 runs 0.")
    assert "% fast beside cam1, by all frames together: its pictures show the model 0.0" in str(doubt)
    assert " s earlier by now" in str(doubt)
    assert np.abs(sigmas_off(found[-1], swinging(times)[-1])[~WALL]).max() < 4


@pytest.mark.parametrize("off", [0.0, 0.05])
def test_a_clock_that_runs_as_the_others_do_is_not_said_to_run_fast(off):
    """It may be wrong by the same all the time."""
    times = np.arange(20)
    series, _ = followed(swinging(times), made(), 1, seconds=True, second=swinging(times - off))
    assert bool(series.doubts) == bool(off)
    assert not off or (series.late.rate is None and abs(series.late.value - off) < 3 * series.late.sigma)


def test_a_picture_that_was_dropped_is_a_step_and_no_clock_that_runs_fast():
    """It was said to run fast by 6.6 ± 0.1 %."""
    times = np.arange(20)
    series, _ = followed(swinging(times, 0.3), made(), 1, second=swinging(times + (times >= 10), 0.3), refused=True)
    (doubt,) = series.doubts
    assert series.late.rate is None
    assert abs(series.late.value - 1) < 3 * series.late.sigma
    assert str(doubt).startswith("pictures of cam1 show the model 0.")
    assert "frames earlier than those of cam2 from frame 10 on, by all frames together" in str(doubt)


@pytest.mark.parametrize("seed", range(3))
def test_a_camera_that_turns_slowly_before_a_model_that_moves_steadily_is_no_clock(seed):
    """Either goes with the time; it was said to run fast by 8.7 ± 1 %."""
    states, (_, cam2) = [places(0.03 * k, (0.01 * k, 0, 0.1 * k), 0.005 * k) for k in range(16)], made().stations
    pose = cam2.cam_from_tunnel
    turned = [
        (pose.inverse() @ Pose(Rotation.from_rotvec([4e-6 * k, 0, 0]).as_matrix(), np.zeros(3)) @ pose).apply(s)
        for k, s in enumerate(states)
    ]
    series, _ = followed(states, made(), seed, second=turned, refused=True)
    assert series.late is None or series.late.rate is None
    assert "runs" not in "".join(map(str, series.doubts))


def from_walls(size, seed, count, **options):
    """A plunging wing before cameras that move, which four markers on walls hold; one of them is displaced."""
    keep = np.flatnonzero(WALL)[[0, 3, 5, 8]]
    only = np.flatnonzero(~WALL | np.isin(np.arange(len(WALL)), keep))
    off = np.where(np.arange(len(WALL)) == keep[0], size, 0.0)[:, None] * [0.6, 0.5, 0.6]
    states = [places(0.3 * k, (0, 0, 0.2 * k), 0.02 * k) + off for k in range(count)]
    test = made(only=only, moves=True)
    return test, followed(states, test, seed, only=only, **options), states


def test_a_marker_on_a_wall_that_is_displaced_by_less_than_a_frame_tells_is_named_by_all_frames_together():
    """It shifted all of them alike: nothing was said."""
    _, (series, found), states = from_walls(0.12, 1, 8)
    (doubt,) = series.doubts
    assert (doubt.cause, doubt.names) == ("marker", (str(MARKERS.name[WALL][0]),))
    assert "by all frames together: it is 0.1" in str(doubt)
    assert "4 markers on walls are all that holds them" in str(doubt)
    assert not found[0].doubts
    last = found[-1]
    assert doubt in last.doubts
    by = [c[: len(last.placed.xyz) - 4] for c in last.markers_displaced()]
    off = by[0] - (states[-1] - MARKERS.xyz)[~WALL]
    assert np.abs(off / np.sqrt(np.diagonal(by[1], axis1=1, axis2=2))).max() < 3


@pytest.mark.parametrize("seed", range(4))
def test_markers_on_walls_that_are_where_they_should_be_are_not_displaced(seed):
    _, (series, found), _ = from_walls(0.0, seed, 8)
    assert not series.doubts
    assert not any(state.doubts for state in found)


ALONG = np.maximum(MARKERS.xyz[:, 1] - 60, 0)[:, None] / 540 * (MARKERS.volume == "wing")[:, None]
ROOT, COURSE = ALONG * [0, 0, 0.2], ALONG**2 * (1 - ALONG) * [0, 0, 0.3]


def windy(count, bent):
    """Two frames without wind, then such of one state with it."""
    return [places()] * 2 + [places(3.0, (0.5, 0.2, 1.0), 0.1, bent)] * count


@pytest.mark.parametrize("bent", [ROOT, COURSE], ids=["root", "course"])
def test_what_a_law_lacks_in_all_frames_is_named_where_no_frame_tells_it_and_the_sigmas_have_it(bent):
    test, states = made(wind_off=("0", "1")), windy(6, bent)
    series, found = followed(states, test, 1)
    (doubt,) = series.doubts
    assert (doubt.cause, doubt.names) == ("bent", ("wing",))
    assert "is left over of wing in 6 frames together: it looks like" in str(doubt)
    assert not any(d.cause == "bent" for d in found[2].doubts)
    last, at = found[-1], np.flatnonzero(~WALL)
    assert doubt in last.doubts
    by_itself, at_last = (sigmas_off(state, states[-1])[at] for state in (found[2], last))
    assert np.abs(by_itself).max() > 5
    assert np.abs(at_last[:, 2]).max() < 3
    assert np.abs(at_last).max() < 5


def sigmas_off(state, place):
    """(N, 3) how far all markers are from where they are, in their sigmas."""
    moved, cov = state.markers_displaced()
    return (moved - (place - MARKERS.xyz)) / np.sqrt(np.diagonal(cov, axis1=1, axis2=2))


@pytest.mark.parametrize("seed", range(3))
def test_a_law_that_can_do_what_the_model_does_is_not_too_simple(seed):
    series, found = followed(windy(6, None), made(wind_off=("0", "1")), seed)
    assert not series.doubts
    assert not any(state.doubts for state in found)


RISING, SWINGING = np.arange(1, 9) * 0.75, 3.0 * np.sin(0.6 * np.arange(1, 9))


def loaded_by(sizes, per_mm):
    """Two frames without wind, then such with the tip bent by ``sizes`` and by ``per_mm`` (N, 3) of that besides."""
    shift = np.array([0.05, 0.0, 0.15])
    return [places()] * 2 + [places(q, q * shift, 0.02 * q, q * per_mm) for q in sizes]


@pytest.mark.parametrize("sizes", [RISING, SWINGING], ids=["rising", "swinging"])
def test_a_root_that_gives_way_in_proportion_to_the_load_is_named_and_the_sigmas_have_it(sizes):
    states = loaded_by(sizes, ROOT / 4)
    series, found = followed(states, made(wind_off=("0", "1")), 1)
    (doubt,) = series.doubts
    assert (doubt.cause, doubt.names) == ("bent", ("wing",))
    assert "what is left over of wing grows with wing.tip, by 8 frames together" in str(doubt)
    turn = float(str(doubt).partition("gives way by about ")[2].partition(" ±")[0])
    assert turn == pytest.approx(np.degrees(0.2 / 540 / 4), rel=0.35)  # of wing.tip as it was found, which is too large
    assert str(doubt).endswith("deg per mm of wing.tip")
    assert np.abs(sigmas_off(found[-1], states[-1])[~WALL]).max() < 4
    assert not any(d.cause == "bent" for d in found[2].doubts)
    assert np.abs(sigmas_off(replace(found[-1], cov=found[-1].cov_of_set_up, misfit=None), states[-1])).max() > 4


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("sizes", [RISING, SWINGING], ids=["rising", "swinging"])
def test_a_root_that_holds_under_load_is_not_said_to_give_way(sizes, seed):
    series, found = followed(loaded_by(sizes, np.zeros(3)), made(wind_off=("0", "1")), seed)
    assert not series.doubts
    assert not any(state.doubts for state in found)


def test_what_a_law_lacks_in_all_frames_widens_the_sigmas_by_as_much_as_they_are_off_and_hides_no_weakness():
    """A frame that tells it by itself, far less well than all of them together, does no more."""
    states = windy(8, 4 * ROOT)
    series, found = followed(states, made(wind_off=("0", "1")), 1)
    assert [d.cause for d in series.doubts] == ["bent"]
    last = found[-1]
    off = abs(last.parameters["wing.tip"] - 3.0)
    assert off / 3 < last.sigma["wing.tip"] < 2 * off
    assert [d.cause for d in last.doubts].count("bent") == 1
    said, usual = (weak_directions(state, MARKERS.xyz[~WALL].mean(axis=0)) for state in (last, found[1]))
    assert len(said) == len(usual)
    assert not any("hardly told from a rigid motion" in words for words in said)
    assert np.allclose(np.diag(last.cov_of_set_up), np.diag(found[1].cov), rtol=0.5)


def test_frames_without_wind_make_the_others_fit_no_better():
    series, _ = followed(windy(2, None), made(wind_off=("0", "1")), 1)
    evidence = series.evidence
    assert evidence.instants == 4
    assert evidence.lacking_redundancy == evidence.redundancy // 2
    assert 0 < evidence.lacking_chi2 < evidence.chi2


def test_few_frames_are_asked_more_than_many():
    asked = [_false(n) for n in (2, 3, 4, 100)]
    assert asked[0] < 0.01 * asked[2]
    assert asked[1] < asked[2] == pytest.approx(asked[3])


def test_what_is_there_without_wind_as_well_is_no_law():
    """What wind-off frames show was put into the markers' places: it is what they are not known better."""
    test = made(wind_off=tuple("01234567"))
    series, found = followed(windy(6, ROOT), test, 1)
    assert not any("together" in str(d) for state in found for d in state.doubts)
    unsure = made(marker_cov=np.tile(0.04 * np.eye(3), (len(MARKERS), 1, 1)))
    rng = np.random.default_rng(5)
    off = 0.2 * rng.standard_normal(MARKERS.xyz.shape)
    series, _ = followed([s + off for s in windy(6, None)], unsure, 5)
    assert not series.doubts


def test_a_series_that_is_gone_on_with_holds_what_is_left():
    test, states = made(wind_off=("0", "1")), [*windy(5, COURSE), places(1.0, bent=COURSE)]
    whole, _ = followed(states, test, 1)
    part = loaded(dumped(followed(states[:4], test, 1)[0].without(), {}), {})
    again, _ = followed(states, test, 1, series=part, first=4)
    assert [str(d) for d in again.doubts] == [str(d) for d in whole.doubts] != []


def test_without_a_sigma_of_the_table_nothing_is_said_of_a_series():
    assert Series.of(made(marker_cov=None)) is None
    assert Series.of(replace(made(marker_cov=None), markers=replace(MARKERS, sigma=np.full((62, 3), 0.1)))) is not None


def test_a_series_that_is_gone_on_with_says_the_same():
    test, states = made(), plunge(0.1)
    whole, _ = followed(states, test, 1, late=1)
    part, _ = followed(states[:6], test, 1, late=1)
    part = loaded(dumped(part, {}), {})
    assert np.array_equal(followed(states[:6], test, 1, late=1)[0].evidence.power, part.evidence.power)
    again, _ = followed(states, test, 1, late=1, series=part, first=6)
    assert np.array_equal(again.evidence.score, whole.evidence.score)
    assert again.doubts == whole.doubts
