"""Slow, readable twins of the settle's kernels: dense matrices, difference quotients, and the noun `Camera`."""

from __future__ import annotations

import numpy as np

from windmark.geometry.rotations import exp_so3
from windmark.registration._kernels.hypothesis import GRAZING
from windmark.registration.settle._kernels.label import (
    AHEAD,
    BORDER,
    CLEAR,
    GATE,
    HELD_AHEAD,
    LEAST_LEFT,
)
from windmark.registration.settle._kernels.state import EXCESS, PLACE, WIDE


def square(packed):
    """(..., 2, 2) of xx, xy, yy (..., 3)."""
    packed = np.asarray(packed)
    return packed[..., [0, 1, 1, 2]].reshape(*packed.shape[:-1], 2, 2)


def camera_of(views, c, nuisance):
    """Camera c moved by its nuisances (P,)."""
    given, loose = views.sights.camera[c], views.loose[c]
    change = loose @ nuisance
    packed = given + np.concatenate([change[:PLACE], change[WIDE:], [0.0]])
    packed[0] = given[0] * np.exp(loose[0] @ nuisance)
    return views.camera(c, packed)


def project(views, state, delta=None, shifted=None):
    """(C, N, 2) where the cameras see all markers after a change (P',) of the unknowns; ``shifted`` (N, 3) markers."""
    sights, (cameras, n), p = views.sights, state.match.shape, state.nuisance.shape[1]
    delta = np.zeros(len(state.factor)) if delta is None else delta
    rotation, translation = exp_so3(delta[:3]) @ state.rotation, state.translation + delta[3:6]
    nuisance = state.nuisance + delta[6 : 6 + cameras * p].reshape(cameras, p)
    bent = state.bent + delta[6 + cameras * p :]
    xyz = sights.xyz + np.tensordot(bent, sights.modes, 1) + (0 if shifted is None else shifted)
    in_rig = xyz @ rotation.T + translation
    seen = np.empty((cameras, n, 2))
    for c in range(cameras):
        camera, moved = camera_of(views, c, nuisance[c]), views.loose[c, PLACE:WIDE] @ nuisance[c]
        as_given = in_rig @ sights.rotation[c].T + sights.translation[c]
        seen[c], valid = camera.project(as_given @ exp_so3(moved[:3]).T + moved[3:])
        seen[c][~valid] = np.nan
    return seen + state.offset


def by_unknowns(views, state, step=1e-5):
    """(C, N, 2, P') derivatives of the projections."""
    units = step * np.eye(len(state.factor))
    columns = [(project(views, state, d) - project(views, state, -d)) / (2 * step) for d in units]
    return np.stack(columns, axis=-1)


def by_markers(views, state, step=1e-5):
    """(C, N, 2, 3) derivatives of the projections by the place of each marker."""
    units = step * np.eye(3)
    columns = [(project(views, state, shifted=d) - project(views, state, shifted=-d)) / (2 * step) for d in units]
    return np.stack(columns, axis=-1)


def table_of(views, state):
    """(C, N, 2, 2) covariance of the projections by the markers' sigma."""
    by = by_markers(views, state)
    return np.einsum("cnik,nk,cnjk->cnij", by, views.sights.sigma**2, by)


def cov_of(state):
    """(P', P') covariance of the unknowns."""
    return np.linalg.inv(state.factor @ state.factor.T)


def spots(views, state):
    """(C, N, 2) spots of the matched markers, NaN for the others."""
    xy = np.full((*state.match.shape, 2), np.nan)
    for c, plane in enumerate(views.planes):
        held = state.match[c] >= 0
        xy[c, held] = plane.task.xy[state.match[c, held]]
    return xy


def normal_equations(views, state):
    """J'WJ with the priors, and W's blocks are the residuals' own covariance."""
    by, held = by_unknowns(views, state), state.match >= 0
    weight = np.linalg.inv(square(state.spread[held]))
    normal = np.einsum("kia,kij,kjb->ab", by[held], weight, by[held])
    return normal + np.diag(np.arange(len(normal)) >= 6)


def label(views, state, *, shut=False):
    """(pairs of each camera {marker: spot}, (C, N) must): closest first, one to one, each within its gate."""
    cov = np.linalg.inv(state.factor @ state.factor.T)
    by, seen, table = by_unknowns(views, state), project(views, state), table_of(views, state)
    chosen, must = [], np.zeros(state.match.shape, dtype=bool)
    is_bent = len(state.bent) > 0
    for c, plane in enumerate(views.planes):
        task, normal = plane.task, views.sights.normal
        eye = -state.rotations[c].T @ state.translations[c]
        to_eye = eye - views.sights.xyz
        cosine = (to_eye * normal).sum(axis=1) / np.linalg.norm(to_eye, axis=1)
        cosine[(normal == 0).all(axis=1)] = 1.0
        size, density = np.array(task.camera.size_px), views.densities[c][-1]
        excess, pairs = state.numbers[c, EXCESS] * np.eye(2), []
        bound = {m: int(s) for m, s in enumerate(state.bound[c]) if s >= 0}
        for m in np.flatnonzero((cosine > 0) & ~state.hidden[c] & np.isfinite(seen[c, :, 0])):
            place = by[c, m] @ cov @ by[c, m].T
            margin = np.minimum(seen[c, m] + 0.5, size - 0.5 - seen[c, m]).min() - BORDER - plane.radius
            if is_bent:
                narrow = np.pi * np.trace(place) * len(task.xy) / size.prod() < 1 / CLEAR
            else:
                narrow = np.trace(place) * GATE < 4 * task.tolerance_px**2
            must[c, m] = cosine[m] > GRAZING and margin > 0 and narrow
            for s in range(len(task.xy)) if m not in bound else ():
                held = state.match[c, m] == s
                d2, root = leave_one_out(seen[c, m] - task.xy[s], task.cov[s] + table[c, m] + excess, place, held)
                odds = 1 / (2 * np.pi * root * density[s])
                if d2 < min(GATE, 2 * np.log(odds / (CLEAR if is_bent and not held else 1.0))) and (held or not shut):
                    pairs.append((d2, m, s, held))
        chosen.append(one_to_one(pairs, bound, is_bent))
    return chosen, must


def leave_one_out(offset, noise, place, held):
    """Squared distance of a spot from where the others have its marker, and the root of its determinant."""
    if not held:
        cov = noise + place
        return offset @ np.linalg.solve(cov, offset), np.sqrt(np.linalg.det(cov))
    value, vector = np.linalg.eigh(noise - place)
    left = (vector * np.maximum(value, LEAST_LEFT * np.trace(noise))) @ vector.T
    return offset @ np.linalg.solve(left, offset), np.linalg.det(noise) / np.sqrt(np.linalg.det(left))


def one_to_one(pairs, bound, is_bent):
    """{marker: spot} of pairs (distance, marker, spot, held): closest first, of a bent model clear of all others."""
    chosen = dict(bound)
    for d2, m, s, held in sorted(pairs):
        others = [d for d, n, t, _ in pairs if (n == m) != (t == s)]
        if is_bent and min(others, default=np.inf) - d2 < (HELD_AHEAD if held else AHEAD):
            continue
        if m not in chosen and s not in chosen.values():
            chosen[m] = s
    return chosen
