"""What is put together before a state is looked for: knowledge that counts, what is used again, what cannot be told."""

from dataclasses import replace

import numpy as np
import pytest
from swept_scenes import CAMERA, CAMERAS, MARKERS, PARTS, VIEWS, observed, seen

from windmark.adjust import Loss, Prior
from windmark.deformation.attached import _neighbours
from windmark.deformation.identify import MOTION, _advice, _unfit
from windmark.deformation.laws import Hinge
from windmark.deformation.setup import prepare, start_values
from windmark.deformation.volumes import Volume, Volumes
from windmark.errors import UsageError

VOLUMES = Volumes.of(PARTS)
SPOTS = observed(seen())


def task_of(
    spots=SPOTS, volumes=VOLUMES, cameras=CAMERAS, views=VIEWS, motion=True, motion_cov=None, poses=False,
    pose_cov=None, focal=False, before=None,
):  # fmt: skip
    return prepare(
        spots, MARKERS, volumes, cameras, views, motion, motion_cov, poses, pose_cov, focal, None, before
    )  # fmt: skip


def first(count):
    return replace(SPOTS, **{n: getattr(SPOTS, n)[:count] for n in ("view", "point", "xy", "cov")})


def test_markers_are_bound_once_and_anew_where_volumes_are_others():
    one = task_of().placed
    assert task_of(before=one).placed is one
    assert task_of(before=one, volumes=Volumes.of(PARTS)).placed is not one


@pytest.mark.parametrize("known", [True, False])
def test_a_calibrated_focal_length_that_is_free_is_held_by_its_sigma(known):
    cov = np.zeros((15, 15))
    cov[0, 0] = 3.0**2
    task = task_of(cameras={**CAMERAS, "c1": replace(CAMERA, cov=cov if known else None)}, focal=["c1"])
    values = start_values(task, None)
    problem = task.problem(values, task.eccentricity(values), np.ones(len(SPOTS), bool), Loss())
    assert [t.sigma for t in problem.terms if isinstance(t, Prior)] == ([{"focal_px": 3.0}] if known else [])


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_a_motion_is_known_by_a_covariance_that_is_positive_definite(bad):
    cov = np.diag([1.0, 1.0, 1.0, 1.0, 1.0, bad])
    task = task_of(motion_cov=cov)
    values = start_values(task, None)
    with pytest.raises(UsageError, match="covariance of motion: must be finite"):
        task.problem(values, task.eccentricity(values), np.ones(len(SPOTS), bool), Loss())


@pytest.mark.parametrize(("focal", "least"), [(False, 2), (["c0"], 3)])
def test_what_is_known_of_motion_and_poses_counts_with_two_numbers_of_each_spot(focal, least):
    """Four of the laws and three times six are free, of which three times six are known."""
    cov = {v.name: np.eye(6) for v in VIEWS}
    for count in (least - 1, least):
        task = task_of(first(count), motion_cov=np.eye(6), poses=True, pose_cov=cov, focal=focal)
        assert (_unfit(task) is None) == (count == least)


@pytest.mark.parametrize(
    ("weak", "motion", "views", "words"),
    [
        ((VOLUMES.names[0],), True, 2, "a law may repeat the rigid motion"),
        ((VOLUMES.names[0],), False, 2, "the markers seen are too few"),
        ((f"{MOTION}.rotation_x",), True, 1, "one camera sees too little of the motion"),
        ((f"{MOTION}.rotation_x",), True, 2, "the markers seen are too few"),
    ],
)
def test_what_would_help_depends_on_what_is_free_and_on_the_cameras(weak, motion, views, words):
    spots = first(int((SPOTS.view < views).sum()))
    assert _advice(task_of(spots, views=VIEWS[:views], motion=motion), weak).startswith(words)


@pytest.mark.parametrize("count", [1, 4])
def test_a_single_marker_has_no_neighbourhood(count):
    """Of a flap told to be on the body that lies in the wing: several markers say how far neighbours are apart."""
    hinge = Hinge((330.0, 350.0, 0.0), (420.0, 560.0, 0.0))
    volumes = Volumes.of((*PARTS, Volume("flap", hinge, parent="body")))
    wing = np.column_stack([np.linspace(0, 300, 16), np.linspace(0, 600, 16), np.zeros(16)])
    names = np.array(["wing"] * 16 + ["flap"] * count)
    flap = wing[-count:] + np.array([20.0, 0, -5.0])
    found = _neighbours(volumes.bind(np.concatenate([wing, flap]), names))
    assert found == ((("flap", "wing"),) if count > 1 else ())
