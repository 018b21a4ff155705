"""Few spots, most markers hidden: what the quads cannot find is searched in full, and its odds are told honestly."""

from dataclasses import replace
from functools import cache
from itertools import permutations

import numpy as np
import pytest
import registration_scenes as scenes
from slow_twins import RULES, TOLERANCE, facing, nearest_spot

from windmark.geometry import Pose, p3p
from windmark.registration import prepare, register
from windmark.registration._kernels import best as kept
from windmark.registration._kernels import growth
from windmark.registration._kernels import match as match
from windmark.registration.budget import TRIPLET, Budget, work_for
from windmark.registration.judge import one_pair, own
from windmark.registration.judge.source import Source
from windmark.registration.options import default_tolerance
from windmark.registration.search import links
from windmark.registration.search.plane import Plane
from windmark.registration.search.search import Search
from windmark.registration.settle.views import Views
from windmark.registration.task import SPARSE_SPOTS, Limits, Task
from windmark.scene import Detections, MarkerSet

LIMITS = Limits(-9.0, 60.0, 10.0, 0.05, 0.025, 0.05)


def few_of(seed, kind, count, *, false=0, noise_px=0.15):
    """So many spots of a model that is seen by many more markers, and false ones; with the markers' labels."""
    rng = np.random.default_rng(seed)
    markers = {"A": scenes.wing, "B": scenes.wing_and_body}[kind](rng)
    camera, pose = scenes.random_view(rng, markers)
    xy, seen = scenes.visible(markers, camera, pose)
    label = np.concatenate([rng.permutation(np.flatnonzero(seen))[:count], np.full(false, -1)])
    stray = rng.uniform(0, 1, (false, 2)) * camera.size_px
    spots = np.concatenate([xy[label[:count]] + rng.normal(0, noise_px, (count, 2)), stray])
    order = rng.permutation(len(spots))
    return Detections.make(spots[order], sigma_px=noise_px), label[order], markers, camera, pose


def task_of(spots, markers, camera, **known):
    return Task(markers, camera, spots.xy, spots.cov, default_tolerance(spots.xy, camera, markers), **known)


def in_full(task):
    """The source of a search that has done nothing but look in full."""
    one, budget = Plane(task), Budget()
    search = Search(one, 45.0, budget=budget)
    batches = search.batches()
    for _ in range(len(task.xy) - task.least_explained + 1):
        next(batches)
    assert search.links * TRIPLET <= budget.spent <= 3 * TRIPLET * task.sparse_links
    return Source(Views.of([one]), [search], 60.0, budget)


@cache
def solved(seed, kind, count, false):
    """What a search in full finds, the best first, and the spots' labels."""
    spots, label, markers, camera, _ = few_of(seed, kind, count, false=false)
    return in_full(task_of(spots, markers, camera)).solutions(), label


def right(solution, label):
    spot, marker = solution.pairs()
    return bool((label[spot] == marker).all())


def test_the_kernel_finds_what_its_slow_twin_finds():
    """Every way to take three spots for three of nine markers; poses that explain all five spots."""
    rng = np.random.default_rng(3)
    markers = scenes.wing(rng, rows=3, columns=3)
    camera, pose = scenes.random_view(rng, markers)
    xy = camera.project(pose.apply(markers.xyz))[0][[0, 2, 4, 6, 7]] + rng.normal(0, 0.2, (5, 2))
    one = Plane(Task(markers, camera, xy, np.tile(0.04 * np.eye(2), (5, 1, 1)), TOLERANCE))
    model, picture, focal = one.model, one.picture(5), camera.focal_px
    gates = growth.Gates(TOLERANCE, 0.75, 8.0, 0.5 * focal, 0.5 * focal, 5, 0.0)
    corners = links.wide_triplets(picture.p, 1)
    best = kept.room_for_best(60, 9)
    of = links.full_links(model, picture.p, corners, np.full(3, -1, np.int32))
    _, tried, _ = match.search_kernel(
        model, picture, RULES._replace(least=5), gates, of, np.array([focal]), 0, 10**9, np.inf, best, best.match
    )
    assert 9 * 8 * 7 / 2 <= tried < 9 * 8 * 7  # others are seen turning the other way
    expected = slow_sparse(model, picture, focal, corners[0])
    # What has the pairs of a known solution is not grown again.
    assert 1 <= best.serial[-1] <= len(expected)
    first = best.match[best.score.argmax()]
    assert first.tolist() == [0, -1, 1, -1, 2, -1, 3, 4, -1]
    assert any((first == match).all() for match in expected)


def slow_sparse(model, picture, focal, corners):
    """(N,) matches of the hypotheses that explain all spots."""
    found = []
    rays = np.concatenate([picture.p[corners] / focal, np.ones((3, 1))], axis=1)
    centre = picture.p[corners].mean(axis=0)
    size = np.sqrt(((picture.p[corners] - centre) ** 2).sum(axis=1).mean())
    for triplet in permutations(range(len(model.xyz)), 3):
        for pose in p3p(rays, model.xyz[list(triplet)]).poses():
            cosine = facing(model, pose.rotation, pose.translation)
            seen = pose.apply(model.xyz)
            uv = focal * seen[:, :2] / seen[:, 2:]
            if (cosine[list(triplet)] < 0).any():
                continue
            match, gap = np.full(len(model.xyz), -1), np.full(len(picture.p), np.inf)
            match[list(triplet)], gap[corners] = corners, 0.0
            for m in np.flatnonzero((seen[:, 2] > 0) & (cosine >= 0) & (match < 0)):
                spot, reach = nearest_spot(picture, uv[m]), 1 + 0.5 * np.linalg.norm(uv[m] - centre) / size
                distance = np.linalg.norm(picture.p[spot] - uv[m]) if spot >= 0 else np.inf
                if distance < min(TOLERANCE * min(3.0, reach), gap[spot]):
                    match[match == spot], match[m], gap[spot] = -1, spot, distance
            if np.isfinite(gap).all():
                found.append(match)
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "count", "false"), [("A", 5, 0), ("A", 7, 1), ("B", 8, 0)])
def test_the_right_labelling_is_found_and_best(kind, count, false):
    """The quads alone find none of these but by luck."""
    found = 0
    for seed in range(6):
        solutions, label = solved(seed, kind, count, false)
        found += bool(solutions) and right(solutions[0], label) and solutions[0].count == count
    assert found >= 5


def test_ties_are_shown():
    """Five spots of a regular row-and-column layout fit many ways, and the judge sees more than one of them."""
    grid = np.stack(np.meshgrid(np.arange(6.0), np.arange(4.0)), axis=-1).reshape(-1, 2)
    markers = MarkerSet.make(
        [f"m{n}" for n in range(24)], np.column_stack([grid, np.zeros(24)]), normal=np.tile([0.0, 0.0, 1.0], (24, 1))
    )
    camera = scenes.Camera((1200, 1000), 1500.0)
    pose = Pose.look_at(np.array([3.5, 0.5, 9.0]), [2.5, 1.5, 0.0], [0.0, 1.0, 0.0])
    xy = camera.project(pose.apply(markers.xyz))[0][[7, 8, 9, 13, 16]]
    spots = Detections.make(xy + np.random.default_rng(0).normal(0, 0.1, xy.shape), sigma_px=0.1)
    solutions = in_full(task_of(spots, markers, camera)).solutions()
    assert solutions[0].lead_over(solutions[1]) < LIMITS.margin
    result = register(spots, markers, camera)
    assert not result


def test_a_label_decides_what_is_tried_first():
    spots, label, markers, camera, _ = few_of(3, "A", 5)
    task = task_of(spots, markers, camera, fixed=((0, int(label[0])),))
    top = Search(Plane(task), 45.0)
    next(top.batches())
    assert any(task.keeps(candidate.match) for candidate in top.top(12))


def test_only_few_spots_are_searched_in_full():
    for count, least in ((4, 4), (5, 5), (6, 5), (8, 7), (10, 8), (12, 10)):
        spots, _, markers, camera, _ = few_of(1, "A", min(count, 8), false=max(count - 8, 0))
        task = task_of(spots, markers, camera)
        assert task.least_explained == least
        assert task.sparse_links == (count - least + 1) * 24 * 23 * 22
        assert work_for(task, "hash") > TRIPLET * task.sparse_links
    spots, _, markers, camera, _ = few_of(1, "A", 8, false=SPARSE_SPOTS)
    task = task_of(spots, markers, camera)
    assert task.least_explained == task.sparse_links == 0


@pytest.mark.slow
def test_odds_of_chance_are_what_they_say():
    """Odds above exp(t) come in less than exp(-t) of the pictures of six spots that are nothing."""
    odds, pictures = [], 80
    for seed in range(pictures):
        _, _, markers, camera, pose = few_of(seed, "A", 4)
        rng = np.random.default_rng(1_000 + seed)
        xy, seen = scenes.visible(markers, camera, pose)
        low, high = xy[seen].min(axis=0), xy[seen].max(axis=0)
        spots = Detections.make(rng.uniform(low, high, (6, 2)), sigma_px=0.2)
        solutions = in_full(task_of(spots, markers, camera)).solutions()
        odds += [own.odds_of_few(s, LIMITS) for s in solutions[:1]]
        assert not any(own.is_sure_of_few(s, LIMITS) for s in solutions)
    assert len(odds) > 5
    for t in (2.0, 4.0, 6.0):
        assert (np.array(odds) > t).sum() <= 3 + pictures * np.exp(-t)


@pytest.mark.slow
def test_eight_of_sixty_are_sure_and_half_of_five_of_twenty_four():
    sure = {}
    for kind, count in (("A", 5), ("B", 8)):
        tried = 0
        for seed in range(6):
            solutions, label = solved(seed, kind, count, 0)
            tried += bool(solutions) and own.is_sure_of_few(solutions[0], LIMITS) and right(solutions[0], label)
        sure[kind] = tried
    assert sure["A"] >= 2
    assert sure["B"] >= 5


def test_a_rival_is_worth_what_it_is_with_the_errors_that_the_table_may_have():
    """Five spots: what fits them by ten times the noise is no rival where the table is as good as the spots."""
    leads = []
    for table_error in (1e-4, 0.3):
        limits, of = replace(LIMITS, table_error=table_error), []
        for seed in range(6):
            solutions, label = solved(seed, "A", 5, 0)
            if solutions and right(solutions[0], label):
                of += [own.lead(solutions[0], other, limits) for other in solutions[1:]]
        leads.append(of)
    close, wide = np.array(leads)
    assert len(close) > 5
    assert (close > wide).all()
    assert (close > 2 * LIMITS.margin).all()
    assert (wide < 1.5 * LIMITS.margin).all()


def test_a_prior_holds_what_three_of_four_leave_open():
    """Four markers on a wall: without one the others leave the pose open, but not beyond a close prior."""
    held = {}
    for angle in (1.0, 179.0):
        held[angle] = 0
        for seed in range(8):
            rng = np.random.default_rng(seed)
            xyz = np.column_stack([rng.uniform(-1, 1, (4, 2)), np.zeros(4)])
            markers = MarkerSet.make(list("abcd"), xyz, normal=np.tile([0.0, 0.0, 1.0], (4, 1)))
            camera, pose = scenes.random_view(rng, markers)
            xy = camera.project(pose.apply(xyz))[0]
            spots = Detections.make(xy + rng.normal(0, 0.1, (4, 2)), sigma_px=0.1)
            known = {"prior": pose, "prior_max_angle_rad": np.radians(angle), "prior_max_scale": 1.05}
            solutions = in_full(task_of(spots, markers, camera, **known)).solutions()
            held[angle] += bool(solutions) and bool(one_pair.held_by_one(solutions[0]))
    assert held[1.0] < held[179.0]


def test_many_right_spots_need_no_search_in_full():
    scene = scenes.scene(2, "A")
    assert task_of(scene.detections, scene.markers, scene.camera).sparse_links == 0
    assert register(scene.detections, scene.markers, scene.camera, layout=prepare(scene.markers))
