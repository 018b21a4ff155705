"""The hypothesis and growth kernels against slow, readable twins."""

import numpy as np
import pytest
import registration_scenes as scenes
from scipy.spatial import cKDTree
from slow_twins import RULES, TOLERANCE, kernel_case, slow_growth, slow_neighbourhood

from windmark.geometry import p3p
from windmark.registration._kernels import growth as growth
from windmark.registration._kernels import hypothesis as hypo


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


def test_hypotheses_equal_the_slow_twin(case):
    model, picture, _, focal, _ = case
    rng = np.random.default_rng(1)
    triplets = np.array([[i, *rng.choice(model.near[i, :4], 2, replace=False)] for i in range(0, 24, 3)], np.int32)
    out = hypo.room_for(500)
    anchors = np.arange(len(picture.p), dtype=np.int32)
    found, links = hypo.hypotheses_kernel(
        model, picture, RULES, out, triplets, np.zeros(len(triplets), np.int8), anchors, 4, np.array([focal])
    )
    expected, tried = [], 0
    for triplet in triplets.tolist():
        for a in anchors.tolist():
            for b in picture.near[a, :4].tolist():
                for c in picture.near[a, :4].tolist():
                    if b == c:
                        continue
                    tried += 1
                    rays = np.column_stack([picture.p[[a, b, c]], np.full(3, focal)])
                    for pose in p3p(rays, model.xyz[triplet]).poses():
                        pairs = slow_neighbourhood(
                            model, picture, pose.rotation, pose.translation, focal, triplet, (a, b, c)
                        )
                        if pairs is not None:
                            expected.append((pose, pairs))
    assert links == tried
    assert found == len(expected) > 3
    for n, (pose, pairs) in enumerate(expected):
        got = list(zip(out.marker[n, : out.pairs[n]].tolist(), out.spot[n, : out.pairs[n]].tolist(), strict=True))
        assert got == pairs
        np.testing.assert_allclose(out.rotation[n], pose.rotation, atol=1e-9)
        np.testing.assert_allclose(out.translation[n], pose.translation, atol=1e-8)


def test_turn_sign_only_removes_links_seen_from_behind(case):
    model, picture, _, focal, _ = case
    from windmark.registration.search.triplets import marker_triplets, turns_of

    triplets = marker_triplets(model, 4)[:20]
    turns = turns_of(model, triplets)
    assert (turns != 0).mean() > 0.9
    anchors = np.arange(len(picture.p), dtype=np.int32)
    kept = []
    for signs in (turns, np.zeros_like(turns)):
        out = hypo.room_for(500)
        found, _ = hypo.hypotheses_kernel(model, picture, RULES, out, triplets, signs, anchors, 4, np.array([focal]))
        kept.append({(tuple(out.marker[n, :3].tolist()), tuple(out.spot[n, :3].tolist())) for n in range(found)})
    assert kept[0] == kept[1]


def test_prior_rejects_by_angle_and_by_scale(case):
    model, picture, (rotation, translation), focal, scene = case
    marker = np.flatnonzero([(scene.label == m).any() for m in range(24)])
    triplets = np.array([[m, *[k for k in model.near[m] if k in marker][:2]] for m in marker], np.int32)
    turns, anchors = np.zeros(len(triplets), np.int8), np.arange(len(picture.p), dtype=np.int32)

    def count(angle_deg, scale):
        turned = np.ascontiguousarray(
            rotation @ scenes.Pose.from_rotvec([0, np.radians(angle_deg), 0], [0, 0, 0]).rotation
        )
        depth = scale * (model.xyz @ rotation.T + translation)[:, 2] / focal
        rules = RULES._replace(
            prior_rotation=turned, prior_cosine=float(np.cos(np.radians(20))), prior_depth=depth, prior_scale=1.2
        )
        out = hypo.room_for(500)
        return hypo.hypotheses_kernel(model, picture, rules, out, triplets, turns, anchors, 6, np.array([focal]))[0]

    assert count(0, 1.0) > 5
    assert count(15, 1.0) > 5
    assert count(0, 1.15) > 5
    assert count(30, 1.0) < 0.2 * count(0, 1.0)
    assert count(0, 1.4) < 0.2 * count(0, 1.0)
    assert count(0, 0.7) < 0.2 * count(0, 1.0)


def test_full_room_counts_on(case):
    model, picture, _, focal, _ = case
    from windmark.registration.search.triplets import marker_triplets

    triplets = marker_triplets(model, 4)
    turns, anchors = np.zeros(len(triplets), np.int8), np.arange(len(picture.p), dtype=np.int32)
    small, large = hypo.room_for(2), hypo.room_for(500)
    counts = [
        hypo.hypotheses_kernel(model, picture, RULES, out, triplets, turns, anchors, 4, np.array([focal]))
        for out in (small, large)
    ]
    assert counts[0] == counts[1]
    np.testing.assert_array_equal(small.rotation, large.rotation[:2])


@pytest.mark.parametrize("free_focal", [False, True])
def test_growth_equals_the_slow_twin(case, free_focal):
    model, picture, _, focal, scene = case
    from windmark.registration.search.triplets import marker_triplets

    gates = growth.Gates(TOLERANCE, 0.75, 8.0, 0.5 * focal, (2.0 if free_focal else 0.5) * focal)
    out = hypo.room_for(500)
    triplets = marker_triplets(model, 4)[::3]
    anchors = np.arange(len(picture.p), dtype=np.int32)
    found, _ = hypo.hypotheses_kernel(
        model, picture, RULES, out, triplets, np.zeros(len(triplets), np.int8), anchors, 4, np.array([focal])
    )
    grown = growth.room_for(found, 24)
    growth.growth_kernel(model, picture, gates, out, found, grown)
    right = 0
    for n in range(found):
        pairs = zip(out.marker[n, : out.pairs[n]], out.spot[n, : out.pairs[n]], strict=True)
        twin = slow_growth(model, picture, gates, out.rotation[n], out.translation[n], float(focal), pairs)
        if grown.score[n] == -np.inf:
            assert twin is None
            continue
        match, score = twin
        np.testing.assert_array_equal(grown.match[n], match)
        assert grown.score[n] == pytest.approx(score, abs=1e-3)
        true = grown.match[n] >= 0
        right += (scene.label[grown.match[n][true]] == np.flatnonzero(true)).all()
    assert right >= 3
