"""Readable twins of the kernels of `epipolar`."""

import numpy as np
from scipy.stats import multivariate_normal, norm

from windmark.epipolar._kernels.choose import ACCEPTED, BEATEN, DOUBLE, REFUSED, TIED
from windmark.epipolar._kernels.grow import AMBIGUOUS, CROWDED, LOOSE, NONE, OUTSIDE, RIVAL
from windmark.epipolar._kernels.merge import JOINED, OUTVOTED, SHARED_VIEW
from windmark.geometry.rotations import hat


def spot_cov(spots, s):
    xx, xy, yy = spots.cov[s]
    return np.array([[xx, xy], [xy, yy]])


def image(stand, v, x):
    """Ideal image, depth, derivative by the point (2, 3) and by the pose (2, 6)."""
    p = stand.rotation[v] @ x + stand.translation[v]
    outer = np.array([[1, 0, -p[0] / p[2]], [0, 1, -p[1] / p[2]]]) / p[2]
    return p[:2] / p[2], p[2], outer @ stand.rotation[v], outer @ np.hstack([-hat(p), np.eye(3)])


def noise_of(stand, spots, s, x, with_spot=True):
    v = spots.views[s]
    j = image(stand, v, x)[3]
    return j @ stand.pose_cov[v] @ j.T + (spot_cov(spots, s) if with_spot else 0)


def ray_point(stand, spots, s, depth):
    """The point on a spot's ray at a depth."""
    v = spots.views[s]
    return stand.rotation[v].T @ (depth * np.append(spots.xy[s], 1.0) - stand.translation[v])


def pairs(stand, spots, free, gate, depth):
    """(first spot, second spot) -> log(p / q), from the essential matrix."""
    out = {}
    for s in np.flatnonzero(free):
        for t in np.flatnonzero(free):
            a, b = spots.views[s], spots.views[t]
            if a >= b:
                continue
            r = stand.rotation[b] @ stand.rotation[a].T
            o = stand.translation[b] - r @ stand.translation[a]
            e = hat(o) @ r
            x, y = np.append(spots.xy[s], 1), np.append(spots.xy[t], 1)
            line, other = e @ x, e.T @ y
            noise_s = noise_of(stand, spots, s, ray_point(stand, spots, s, depth[a]))
            noise_t = noise_of(stand, spots, t, ray_point(stand, spots, t, depth[b]))
            variance = line[:2] @ noise_t @ line[:2] + other[:2] @ noise_s @ other[:2]
            if (y @ line) ** 2 > gate**2 * variance:
                continue
            d = r @ x  # the point in b is d + o / depth in a, up to a factor
            foot, target = o[:2] - y[:2] * o[2], y[:2] * d[2] - d[:2]
            inverse = foot @ target / (foot @ foot)
            both = np.trace(noise_s) + np.trace(noise_t)
            slack = 3 * np.sqrt(both / (foot @ foot))
            if not 1 / stand.far[a] - slack <= inverse <= 1 / stand.near[a] + slack or d[2] + inverse * o[2] <= 0:
                continue
            w = np.linspace(1 / stand.far[a], 1 / stand.near[a], 200_001)
            p = d[:, None] + w * o[:, None]
            p = p[:2, p[2] > 1e-3] / p[2, p[2] > 1e-3]
            inside = (np.clip(p.T, stand.low[b], stand.high[b]) == p.T).all(axis=1)
            if not inside.any():
                continue
            seen = p[:, inside]
            length = np.linalg.norm(seen[:, -1] - seen[:, 0]) + np.sqrt(both)  # to the steps of w
            sigma = np.sqrt(variance) / np.linalg.norm(line[:2])
            density = norm.logpdf((y @ line) / np.linalg.norm(line[:2]), 0, sigma) - np.log(length)
            out[int(s), int(t)] = density - np.log(spots.density[t])
    return out


def step(stand, spots, row, x, loose):
    h, g = np.zeros((3, 3)), np.zeros(3)
    for v in np.flatnonzero(row >= 0):
        uv, z, j, _ = image(stand, v, x)
        if z <= 0:
            return None
        weight = np.linalg.inv(noise_of(stand, spots, row[v], x))
        h += j.T @ weight @ j + (np.eye(3) / (loose * z) ** 2 if loose else 0)
        g += j.T @ weight @ (spots.xy[row[v]] - uv)
    c = np.linalg.inv(h)
    return x + c @ g, c


def grow(stand, spots, free, pair, gate, patience):
    """Row, point, covariance and log(p / q) of one pair; the gain is -inf where there is no point."""
    views = len(stand.near)
    row = np.full(views, NONE)
    row[spots.views[pair]] = pair
    nothing = np.full(3, np.nan), np.full((3, 3), np.nan), -np.inf
    d, e = (stand.rotation[spots.views[s]].T @ np.append(spots.xy[s], 1) for s in pair)
    first, second = stand.center[spots.views[pair]]
    (s, t), *_ = np.linalg.lstsq(np.stack([d, -e], axis=1), second - first)
    x = 0.5 * (first + s * d + second + t * e)
    for _ in range(2):
        new = step(stand, spots, row, x, LOOSE)
        if new is None:
            return row, *nothing
        x, c = new
    each, missing = {}, 0
    for sweep in range(2):
        for v in stand.order[spots.views[pair[0]]]:
            if row[v] >= 0 or missing > patience:
                continue
            row[v], x, c, gain = look(stand, spots, free, v, x, c, gate, sweep)
            if sweep == 0:
                missing += int(row[v] == NONE) - int(row[v] >= 0)
            if row[v] >= 0:
                each[v] = gain
    if missing > patience:
        return row, *nothing
    while True:
        if (row >= 0).sum() < 2:
            return row, *nothing
        for _ in range(2):
            new = step(stand, spots, row, x, 0.0)
            if new is None:
                return row, *nothing
            x, c = new
        off = {}
        for v in np.flatnonzero(row >= 0):
            uv, z, _, _ = image(stand, v, x)
            if z <= 0:
                return row, *nothing
            r = spots.xy[row[v]] - uv
            off[v] = r @ np.linalg.solve(noise_of(stand, spots, row[v], x), r)
        worst = max(off, key=off.get)
        if off[worst] <= gate**2:
            break
        row[worst] = NONE
    lost = any(row[spots.views[s]] != s for s in pair)
    return row, x, c, -np.inf if lost else sum(g for v, g in each.items() if row[v] >= 0)


def look(stand, spots, free, v, x, c, gate, sweep):
    uv, z, j, by_pose = image(stand, v, x)
    if z <= 0 or (uv < stand.low[v]).any() or (uv > stand.high[v]).any():
        return OUTSIDE, x, c, 0.0
    p = j @ c @ j.T + by_pose @ stand.pose_cov[v] @ by_pose.T
    if sweep == 0 and np.pi * gate**2 * np.sqrt(np.linalg.det(p)) * spots.crowd[v] > CROWDED:
        return AMBIGUOUS, x, c, 0.0
    near = []
    for s in np.flatnonzero(free & (spots.views == v)):
        r = spots.xy[s] - uv
        near.append((r @ np.linalg.solve(p + spot_cov(spots, s), r), s))
    near.sort()
    if not near or near[0][0] >= gate**2:
        return NONE, x, c, 0.0
    best, chosen = near[0]
    second = near[1][0] if len(near) > 1 else np.inf
    if (sweep == 0 and second < gate**2 + RIVAL) or second - best < RIVAL:
        return AMBIGUOUS, x, c, 0.0
    whole = p + spot_cov(spots, chosen)
    k = c @ j.T @ np.linalg.inv(whole)
    gain = multivariate_normal.logpdf(spots.xy[chosen], uv, whole) - np.log(spots.density[chosen])
    return chosen, x + k @ (spots.xy[chosen] - uv), c - k @ j @ c, gain


def choose(rows, score, least, lead, spots):
    """Owner of every spot and verdict on every hypothesis."""
    owner, verdict = np.full(spots, -1), np.full(len(rows), REFUSED)
    sets = [frozenset(row[row >= 0].tolist()) for row in rows]
    for h in np.argsort(-score):
        if score[h] <= least - lead:
            break
        taken = {int(owner[s]) for s in sets[h]} - {-1}
        if not taken:
            if score[h] > least:
                verdict[h] = ACCEPTED
                owner[list(sets[h])] = h
        elif len(taken) == 1 and len(sets[h] & sets[min(taken)]) >= 2:
            verdict[h] = DOUBLE
        else:
            verdict[h] = BEATEN
            for t in taken:
                if len(sets[h] & sets[t]) < 2 and score[h] > score[t] - lead:
                    verdict[t] = TIED
    for s in range(spots):
        if owner[s] >= 0 and verdict[owner[s]] == TIED:
            owner[s] = -1
    return owner, verdict


def merge(first, second, order, weight, view):
    """Sets of spots, and what became of every link."""
    sets = {s: {s} for s in range(len(view))}
    home = {s: s for s in range(len(view))}
    links = {}
    for s, t, w in zip(first.tolist(), second.tolist(), weight.tolist(), strict=True):
        links.setdefault(s, {})[view[t]] = (t, w)
        links.setdefault(t, {})[view[s]] = (s, w)
    fate = {}
    for link in order:
        a, b = home[first[link]], home[second[link]]
        if a == b:
            continue
        if {view[s] for s in sets[a]} & {view[t] for t in sets[b]}:
            fate[link] = SHARED_VIEW
            continue
        votes = 0.0
        for s in sets[a]:
            for t in sets[b]:
                there, weight_there = links.get(s, {}).get(view[t], (-1, 0.0))
                _, weight_back = links.get(t, {}).get(view[s], (-1, 0.0))
                votes += weight_there if there == t else -0.5 * (weight_there + weight_back)
        if votes <= 0:
            fate[link] = OUTVOTED
            continue
        sets[a] |= sets.pop(b)
        home |= dict.fromkeys(sets[a], a)
    joined = np.array([home[s] == home[t] for s, t in zip(first, second, strict=True)])
    return {frozenset(s) for s in sets.values()}, np.array(
        [JOINED if joined[n] else fate.get(n, OUTVOTED) for n in range(len(first))]
    )
