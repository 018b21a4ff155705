"""The hypothesis and growth kernels against slow, readable twins."""

import numpy as np
import pytest
import registration_scenes as scenes
from scipy.spatial import cKDTree

from windmark.geometry import p3p
from windmark.registration import _growth_kernels as growth
from windmark.registration import _hypothesis_kernels as hypo
from windmark.registration import _plane
from windmark.registration.layout import unit_model

TOLERANCE = 6.0
RULES = hypo.Rules(TOLERANCE, 0.6, -4.0, 9.0, np.zeros((3, 3)), -2.0, np.ones(24), 2.0)


@pytest.fixture(scope="module")
def case():
    """Kernel inputs of a small scene with a curved lens: model, picture, true unit pose, focal length, scene."""
    rng = np.random.default_rng(5)
    markers = scenes.wing(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(35, 45), k1=-0.1)
    scene = scenes.image_of(rng, markers, camera, pose, hidden=0.2, false=0.3, noise_px=0.2)
    model, frame = unit_model(markers.xyz, markers.normal)
    picture = _plane.picture(camera, scene.detections.xy, 3 * TOLERANCE)
    return model, picture, frame.unit(pose), camera.focal_px, scene


def facing(model, rotation, translation):
    eye = -rotation.T @ translation
    to_eye = eye - model.xyz
    return (model.normal * to_eye).sum(axis=1) / np.linalg.norm(to_eye, axis=1)


def nearest_spot(picture, uv):
    """What the raster says about a point."""
    column, row = np.floor((np.asarray(uv) - [picture.x0, picture.y0]) * picture.per_px).astype(int)
    if not (0 <= row < picture.raster.shape[0] and 0 <= column < picture.raster.shape[1]):
        return hypo.OUT
    return int(picture.raster[row, column])


def slow_neighbourhood(model, picture, rotation, translation, focal, triplet, spots):
    """Twin of `_neighbourhood`: the pairs of a kept hypothesis, None where it is dropped."""
    cosine = facing(model, rotation, translation)
    if (cosine[list(triplet)] < 0).any():
        return None
    camera_xyz = model.xyz @ rotation.T + translation
    uv = focal * camera_xyz[:, :2] / camera_xyz[:, 2:]
    corners = picture.p[list(spots)]
    size = np.sqrt(((corners - corners.mean(axis=0)) ** 2).sum(axis=1).mean())
    score, pairs = 0.0, list(zip(triplet, spots, strict=True))
    for m in model.near[triplet[0]]:
        if m in triplet or cosine[m] < 0 or camera_xyz[m, 2] <= 0:
            continue
        spot = nearest_spot(picture, uv[m])
        if spot == hypo.OUT:
            continue
        reach = TOLERANCE * min(3.0, 1 + 0.5 * np.linalg.norm(uv[m] - corners.mean(axis=0)) / size)
        distance = np.linalg.norm(picture.p[spot] - uv[m]) if spot >= 0 else np.inf
        if distance < reach and spot not in spots:
            pairs.append((int(m), spot))
            core = max(distance, reach / 4)
            score += np.log(0.6 / ((1 + 2 * np.log(4)) * np.pi * core**2 * picture.density[spot]))
            if score > 9.0 or len(pairs) == hypo.PAIRS:
                break
        elif cosine[m] > hypo.GRAZING:
            score += np.log(0.4)
            if score < -4.0:
                return None
    return pairs if score > 9.0 or len(pairs) == hypo.PAIRS else None


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
    from windmark.registration._triplets import marker_triplets, turns_of

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
    from windmark.registration._triplets import marker_triplets

    triplets = marker_triplets(model, 4)
    turns, anchors = np.zeros(len(triplets), np.int8), np.arange(len(picture.p), dtype=np.int32)
    small, large = hypo.room_for(2), hypo.room_for(500)
    counts = [
        hypo.hypotheses_kernel(model, picture, RULES, out, triplets, turns, anchors, 4, np.array([focal]))
        for out in (small, large)
    ]
    assert counts[0] == counts[1]
    np.testing.assert_array_equal(small.rotation, large.rotation[:2])


def slow_growth(model, picture, gates, rotation, translation, focal, pairs):
    """Twin of `growth_kernel` for one hypothesis: (match, score) or None."""
    rotation, translation = rotation.copy(), translation.copy()
    match = np.full(len(model.xyz), -1)
    for m, s in pairs:
        match[m] = s
    variance = gates.sigma**2
    free = gates.focal_high > gates.focal_low

    def project(r, t, f, xyz):
        p = xyz @ r.T + t
        return f * p[:, :2] / p[:, 2:]

    def jacobian(r, t, f, xyz, size):
        columns, h = [], 1e-6
        for i in range(6):
            d = np.zeros(6)
            d[i] = h
            sides = [
                project(scenes.Pose.from_rotvec(q[:3], [0, 0, 0]).rotation @ r, t + q[3:], f, xyz) for q in (d, -d)
            ]
            columns.append((sides[0] - sides[1]) / (2 * h))
        if size == 7:
            columns.append(project(r, t, f, xyz))
        return np.stack(columns, axis=-1)

    for round_ in range(growth.STEPS):
        size = 7 if free and (match >= 0).sum() >= 6 else 6
        for _ in range(2):
            used = np.flatnonzero(match >= 0)
            j = jacobian(rotation, translation, focal, model.xyz[used], size).reshape(-1, size)
            residual = (picture.p[match[used]] - project(rotation, translation, focal, model.xyz[used])).ravel()
            normal = j.T @ j
            if size == 7:
                normal[6, 6] += 10 * variance
            step = np.linalg.solve(normal, j.T @ residual)
            if np.linalg.norm(step[:3]) > 1:
                return None
            rotation = scenes.Pose.from_rotvec(step[:3], [0, 0, 0]).rotation @ rotation
            translation = translation + step[3:6]
            if size == 7:
                focal *= np.exp(np.clip(step[6], -0.3, 0.3))
        if size == 7 and not gates.focal_low < focal < gates.focal_high:
            return None
        before = match.copy()
        gate = np.clip(3.5 * np.sqrt(variance), 0.25 * gates.tolerance, gates.tolerance)
        cosine = facing(model, rotation, translation)
        uv = project(rotation, translation, focal, model.xyz)
        spread = jacobian(rotation, translation, focal, model.xyz, size)
        owner, expected = {}, 0
        for m in range(len(match)):
            spot = nearest_spot(picture, uv[m])
            if cosine[m] < 0 or spot == hypo.OUT:
                continue
            distance = np.linalg.norm(picture.p[spot] - uv[m]) if spot >= 0 else np.inf
            limit2 = gate**2
            if distance > gate:
                limit2 += 9 * variance * np.trace(spread[m] @ np.linalg.inv(normal) @ spread[m].T)
            expected += cosine[m] > hypo.GRAZING and limit2 < 4 * gates.tolerance**2
            inside = distance**2 < min(limit2, 9 * gates.tolerance**2)
            if inside and (spot not in owner or distance < owner[spot][1]):
                owner[spot] = (m, distance)
        match[:] = -1
        for spot, (m, _) in owner.items():
            match[m] = spot
        count, squares = len(owner), sum(d * d for _, d in owner.values())
        expected = max(expected, count)
        if count < 5 or count < 0.2 * expected:
            return None
        variance = (4 * gates.sigma**2 + squares) / (4 + max(2 * count - size, 0))
        p_seen = np.clip((count + 1) / (expected + 2), 0.25, 0.95)
        gain = np.log(p_seen / (2 * np.pi * variance * picture.density[list(owner)])).sum()
        score = gain - 0.5 * squares / variance + (expected - count) * np.log(1 - p_seen)
        if (match == before).all() or (round_ > 0 and score < gates.min_score):
            break
    return (match, score) if score >= gates.min_score else None


@pytest.mark.parametrize("free_focal", [False, True])
def test_growth_equals_the_slow_twin(case, free_focal):
    model, picture, _, focal, scene = case
    from windmark.registration._triplets import marker_triplets

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
