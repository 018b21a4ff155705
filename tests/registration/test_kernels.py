"""The hypothesis and growth kernels against slow, readable twins."""

from itertools import permutations

import numpy as np
import pytest
import registration_scenes as scenes
from scipy.spatial import cKDTree
from slow_twins import RULES, TOLERANCE, kernel_case, slow_growth, slow_neighbourhood

from windmark.geometry import p3p
from windmark.registration._kernels import growth as growth
from windmark.registration._kernels import hypothesis as hypo
from windmark.registration.search.links import marker_triplets, triplet_links, turns_of


@pytest.fixture(scope="module")
def case():
    return kernel_case()


def test_raster_names_the_nearest_spot_and_the_image(case):
    _, picture, _, _, scene = case
    rows, columns = picture.raster.shape
    x = picture.x0 + (np.arange(columns) + 0.5) / picture.per_px
    y = picture.y0 + (np.arange(rows) + 0.5) / picture.per_px
    centres = np.stack(np.meshgrid(x, y), axis=-1)
    distance, index = cKDTree(picture.p).query(centres)
    near = distance < 3 * TOLERANCE
    assert (picture.raster[near] == index[near]).all()
    camera = scene.camera
    seen, valid = camera.project(np.concatenate([centres, np.full((rows, columns, 1), camera.focal_px)], axis=-1))
    inside = valid & camera.in_image(seen)
    assert not ((picture.raster == hypo.EMPTY) & (near | ~inside)).any()
    # Only cells at the border may be called outside though their centre is inside.
    border = np.minimum(seen, np.array(camera.size_px) - 1 - seen).min(axis=-1)
    assert border[(picture.raster == hypo.OUT) & inside].max() < 8 * 3 / picture.per_px


def hypotheses(case, every):
    """P3P of some marker triplets against neighbouring spots: (pose, triplet, spots, pairs or None by the twin)."""
    model, picture, _, focal, _ = case
    found = []
    for triplet in marker_triplets(model, 4)[::every].tolist():
        for a in range(len(picture.p)):
            for b, c in permutations(picture.near[a, :4].tolist(), 2):
                rays = np.column_stack([picture.p[[a, b, c]], np.full(3, focal)])
                for pose in p3p(rays, model.xyz[triplet]).poses():
                    of = pose.rotation, pose.translation, focal, tuple(triplet), (a, b, c)
                    found.append((pose, of[3], of[4], slow_neighbourhood(model, picture, *of)))
    return found


@pytest.mark.slow
def test_neighbourhood_equals_the_slow_twin(case):
    model, picture, _, focal, _ = case
    marker, spot, kept = np.empty(hypo.PAIRS, np.int32), np.empty(hypo.PAIRS, np.int32), 0
    for pose, triplet, spots, pairs in hypotheses(case, 9):
        count = hypo.neighbourhood(
            model, picture, RULES, pose.rotation, pose.translation, focal, triplet, spots, marker, spot
        )  # fmt: skip
        got = list(zip(marker[:count].tolist(), spot[:count].tolist(), strict=True))
        assert got == (pairs or [])
        kept += count > 0
    assert kept > 3


def test_only_triplets_that_turn_the_way_they_are_seen_are_linked(case):
    model, picture, _, _, _ = case
    triplets = marker_triplets(model, 4)[:20]
    triplets[::3] = triplets[::3, [0, 2, 1]]
    turns = turns_of(model, triplets)
    assert {-1, 1} <= set(turns.tolist())
    of = triplet_links(model, picture, triplets, np.arange(5, dtype=np.int32), 4)
    assert len(of.spots) == 5 * 4 * 3
    assert (of.spots[:, 0] == -1).all()
    for q, (_, b, c, d) in enumerate(of.spots.tolist()):
        u, v = picture.p[c] - picture.p[b], picture.p[d] - picture.p[b]
        area = u[0] * v[1] - u[1] * v[0]
        linked = {tuple(t) for t in of.markers[of.entry[of.first[q] : of.last[q]]][:, [3, 1, 2]].tolist()}
        assert linked == {tuple(t) for t in triplets[area * turns >= 0].tolist()}


def test_prior_rejects_by_angle_and_by_scale(case):
    model, _, (rotation, translation), focal, _ = case

    def passes(angle_deg, scale):
        turned = rotation @ scenes.Pose.from_rotvec([0, np.radians(angle_deg), 0], [0, 0, 0]).rotation
        depth = scale * (model.xyz @ rotation.T + translation)[:, 2] / focal
        rules = RULES._replace(
            prior_rotation=np.ascontiguousarray(turned), prior_cosine=float(np.cos(np.radians(20))), prior_depth=depth,
            prior_scale=1.2,
        )  # fmt: skip
        return hypo.allowed(model.xyz, rules, rotation, translation, focal, 3)

    assert hypo.allowed(model.xyz, RULES, rotation, translation, focal, 3)
    assert all(passes(*near) for near in ((0, 1.0), (15, 1.0), (0, 1.15)))
    assert not any(passes(*far) for far in ((30, 1.0), (0, 1.4), (0, 0.7)))


@pytest.mark.slow
@pytest.mark.parametrize("free_focal", [False, True])
def test_growth_equals_the_slow_twin(case, free_focal):
    model, picture, _, focal, scene = case
    gates = growth.Gates(TOLERANCE, 0.75, 8.0, 0.5 * focal, (2.0 if free_focal else 0.5) * focal)
    right = 0
    for pose, _, _, pairs in hypotheses(case, 3):
        if pairs is None:
            continue
        match = np.full(24, -1, np.int32)
        match[[m for m, _ in pairs]] = [s for _, s in pairs]
        twin = slow_growth(model, picture, gates, pose.rotation, pose.translation, float(focal), pairs)
        score = growth.grow(
            model, picture, gates, match, pose.rotation.copy(), pose.translation.copy(), focal, len(pairs)
        )[0]  # fmt: skip
        if twin is None:
            assert score == -np.inf
            continue
        np.testing.assert_array_equal(match, twin[0])
        assert score == pytest.approx(twin[1], abs=1e-3)
        true = match >= 0
        right += (scene.label[match[true]] == np.flatnonzero(true)).all()
    assert right >= 3
