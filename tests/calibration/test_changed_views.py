"""Pictures that are not as the others of their camera: sheared by a rolling shutter or a program, focused anew."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.calibration import Fixed, Free, Weighted, self_calibrate
from windmark.calibration.view_changes import explained, most_explained, told
from windmark.scene import MarkerSet, Observations, View


def calibrated(change, seed=31, views=10):
    """Calibration of a network whose marks were moved: ``change`` (view, place about the centre) -> shift, px."""
    observations, markers, cameras, named, _ = networks.nouns(networks.make(seed, points=40, views=views))
    camera = next(iter(cameras.values()))
    about = observations.xy - [camera.cx, camera.cy]
    moved = np.stack([change(v, at) for v, at in zip(observations.view, about, strict=True)])
    return self_calibrate(replace(observations, xy=observations.xy + moved), markers, cameras, named, datum=Free())


def by_a_table(change, datum, views=10, camera=None):
    """Calibration of a flat plate whose known places are right where ``change`` leaves them so."""
    case = networks.make(3, points=1, views=views)
    grid = np.stack(np.meshgrid(np.arange(9.0) - 4, np.arange(7.0) - 3), axis=-1).reshape(-1, 2) * 50
    table = np.column_stack([grid, np.zeros(len(grid))])
    rng, true, marks = np.random.default_rng(5), table @ change, []
    for v, (turn, shift) in enumerate(zip(case.truth.frames.rotation, case.truth.frames.translation, strict=True)):
        marks.append((camera(v) if camera else networks.CAMERA).project(true @ turn.T + shift)[0])
    view, point = np.divmod(np.arange(views * len(table)), len(table))
    xy = np.concatenate(marks) + rng.normal(0, 0.05, (len(view), 2))
    observations = Observations(view, point, xy, np.tile(0.0025 * np.eye(2), (len(view), 1, 1)))
    markers = MarkerSet.make([f"m{k:02d}" for k in range(len(table))], table, length_unit="mm")
    return self_calibrate(
        observations, markers, {"camera": networks.ROUGH}, [View(f"v{v:02d}") for v in range(views)], datum=datum
    )


@pytest.mark.parametrize("datum", [Fixed(), Weighted(sigma=0.05)])
@pytest.mark.parametrize("size", [5e-4, 1e-2])
def test_a_table_of_the_wrong_shape_is_no_shear_of_the_pictures(datum, size):
    """The same marks agree with each other without it."""
    result = by_a_table(np.diag([1 + size, 1, 1]), datum)
    assert causes(result)
    assert set(causes(result)) <= {"table", "control"}
    assert not by_a_table(np.diag([1 + size, 1, 1]), Free()).doubts


def test_sheared_pictures_of_a_right_table_are_still_that():
    other = replace(networks.CAMERA, shear=2e-3)
    result = by_a_table(np.eye(3), Weighted(sigma=0.05), camera=lambda v: other if v == 4 else networks.CAMERA)
    assert [(d.cause, d.names[0]) for d in result.doubts] == [("sheared", "v04")]
    assert by_a_table(np.eye(3), Weighted(sigma=0.05)).doubts == ()


def causes(result):
    return [doubt.cause for doubt in result.doubts]


@pytest.mark.parametrize("seed", [31, 32])
def test_sheared_pictures_are_said_to_be_that_and_not_to_have_another_focus(seed):
    """Each by its own amounts: they were blamed on focus and principal points, and freeing these made it worse."""
    rng = np.random.default_rng(seed)
    own = rng.normal(0, 2e-3, (10, 2))
    result = calibrated(lambda v, at: own[v] * at[1], seed)
    assert causes(result)[0] == "sheared"
    assert not {"focal", "principal"} & set(causes(result))
    first = own[int(result.doubts[0].names[0][1:])]
    assert np.abs(first).max() > np.median(np.abs(own))
    assert str(result.doubts[0]).startswith("shear not that of the other pictures: v0")


def test_one_sheared_picture_is_named_with_how_much():
    result = calibrated(lambda v, at: np.array([2e-3, 0.0]) * at[1] * (v == 4))
    (doubt,) = result.doubts
    assert (doubt.cause, doubt.names[0]) == ("sheared", "v04")
    said = float(str(doubt).split("(+")[1].split(" ")[0])
    assert said == pytest.approx(0.2, abs=0.03)


def test_a_picture_focused_anew_or_cut_is_not_sheared():
    focused = calibrated(lambda v, at: 1e-2 * at * (v == 4))
    assert [(d.cause, d.names) for d in focused.doubts] == [("focal", ("v04",))]
    cut = calibrated(lambda v, at: np.array([10.0, -5.0]) * (v == 4))
    assert [(d.cause, d.names) for d in cut.doubts] == [("principal", ("v04",))]


def test_pictures_without_a_flaw_are_not_doubted():
    assert calibrated(lambda v, at: np.zeros(2)).doubts == ()


@pytest.mark.parametrize("idle", [0, 1, 3])
def test_bounds_of_what_unknowns_explain_need_no_eigenvectors(idle):
    """How many are told is exact, and what they explain never more than its bound; `idle` ones are not told."""
    rng = np.random.default_rng(7)
    for n in (1, 5, 40):
        axes = np.linalg.qr(rng.normal(size=(n, n)))[0]
        value = np.r_[np.zeros(min(idle, n - 1)), rng.uniform(2e-4, 1.0, n - min(idle, n - 1))]
        power = (axes * value) @ axes.T
        score = power @ rng.normal(size=n)
        _, test, count = explained(power, score)
        assert told(power) == count
        assert test <= most_explained(power, score) <= 1.04 * test
    nearly = np.diag([1e-7, 0.5])  # not told, but its score is
    assert most_explained(nearly, np.array([0.02, 1.0])) < 1.05 * explained(nearly, np.array([0.02, 1.0]))[1] + 4
    assert told(np.array([[0.0, 1.0], [1.0, 0.0]])) == 1  # two that are one pivot
    assert most_explained(np.array([[0.0, 1.0], [1.0, 0.0]]), np.ones(2)) == np.inf
