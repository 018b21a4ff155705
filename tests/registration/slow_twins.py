"""Slow, readable twins of the hypothesis and growth kernels, and small kernel inputs."""

import numpy as np
import registration_scenes as scenes

from windmark.registration._kernels import growth as growth
from windmark.registration._kernels import hypothesis as hypo
from windmark.registration.search.plane import Plane
from windmark.registration.task import Task

TOLERANCE = 6.0
RULES = hypo.Rules(TOLERANCE, 0.6, -4.0, 9.0, np.zeros((3, 3)), -2.0, np.ones(24), 2.0)


def kernel_case():
    """Kernel inputs of a small scene with a curved lens: model, picture, true unit pose, focal length, scene."""
    rng = np.random.default_rng(5)
    markers = scenes.wing(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(35, 45), k1=-0.1)
    scene = scenes.image_of(rng, markers, camera, pose, hidden=0.2, false=0.3, noise_px=0.2)
    plane = Plane(Task(markers, camera, scene.detections.xy, scene.detections.cov, TOLERANCE))
    return plane.model, plane.picture(len(scene.detections)), plane.frame.unit(pose), camera.focal_px, scene


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
    """Twin of `neighbourhood`: the pairs of a kept hypothesis, None where it is dropped."""
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


def slow_growth(model, picture, gates, rotation, translation, focal, pairs):
    """Twin of `grow`: (match, score) or None."""
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
