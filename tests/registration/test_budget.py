"""Work and time of a search."""

import numpy as np
import registration_scenes as scenes

from windmark.registration.budget import PER_SECOND, Budget, work_for
from windmark.registration.task import Task


def task(focals=1):
    scene = scenes.scene(1)
    spots = scene.detections
    factors = tuple(np.linspace(0.8, 1.2, focals))
    return Task(scene.markers, scene.camera, spots.xy, spots.cov, 5.0, focal_factors=factors)


def test_work_alone_is_counted():
    budget = Budget(100.0)
    budget.spend(60)
    assert not budget.over
    budget.spend(60)
    assert budget.spent == 120
    assert budget.over
    assert not budget.out_of_time
    assert "quiet machine" in budget.why
    assert not budget.exhausted
    budget.spend(90)
    assert budget.exhausted


def test_time_alone_strikes():
    budget = Budget(seconds=1e-9)
    assert budget.out_of_time
    assert budget.over
    assert "max_time_s = 1e-09 s" in budget.why


def test_work_grows_with_the_case_and_with_the_time():
    one, five = work_for(task(), "hash"), work_for(task(5), "hash")
    assert one < five < 5 * one
    assert work_for(task(), "ransac") > 100 * one
    assert Budget.of(one, 10.0).max_work == 10 * PER_SECOND
    assert Budget.of(one, 1e-3).max_work == one
