"""Slow, readable versions of the constellation kernels."""

import numpy as np


def met(xa, na, xb, nb, p, q, m, tolerance, noise, least, within):
    """`neighbours_met`, a line at a time."""
    arms = xa[na[p]] - xa[p]
    area = np.linalg.det(m)
    count, total = 0, 0.0
    for arm in arms:
        reach = tolerance * np.linalg.norm(arm) * np.sqrt(area) + noise
        gap = np.linalg.norm(xb[nb[q]] - (xb[q] + m @ arm), axis=1).min()
        if gap < reach:
            count += 1
            total += (gap / reach) ** 2
    if count < least:
        return -1, np.inf
    back = (xb[nb[q]] - xb[q]) @ np.linalg.inv(m).T
    inside = int((np.linalg.norm(back, axis=1) < within * np.linalg.norm(arms[-1])).sum())
    return count - max(inside - len(arms), 0), total


def seed_maps(xa, na, xb, nb, first, arms, tolerance, noise, scale, stretch, least, sharpest, within):
    """`seed_maps`: every frame of a on every frame of b."""
    best = np.full((len(first), len(xb)), -1)
    offset = np.full((len(first), len(xb)), np.inf)
    maps = np.zeros((len(first), len(xb), 4))
    tried = 0
    for s, p in enumerate(first):
        for i in range(arms[0]):
            for j in range(i + 1, arms[0]):
                frame_a = np.stack([xa[na[p, i]] - xa[p], xa[na[p, j]] - xa[p]], axis=1)
                if abs(np.linalg.det(frame_a)) < sharpest * np.prod(np.linalg.norm(frame_a, axis=0)):
                    continue
                for q in range(len(xb)):
                    for k in range(arms[1]):
                        for n in range(arms[1]):
                            frame_b = np.stack([xb[nb[q, k]] - xb[q], xb[nb[q, n]] - xb[q]], axis=1)
                            m = frame_b @ np.linalg.inv(frame_a)
                            area = np.linalg.det(m)
                            if not 1 / scale**2 <= area <= scale**2:
                                continue
                            if (m**2).sum() > (stretch + 1 / stretch) * area:
                                continue
                            tried += 1
                            count, total = met(xa, na, xb, nb, p, q, m, tolerance, noise, least, within)
                            if count > best[s, q] or (count == best[s, q] and total < offset[s, q]):
                                best[s, q], offset[s, q], maps[s, q] = count, total, m.ravel()
    return best, offset, maps, tried


def predict(xa, na, xb, match, a, most):
    """`predict` by an ordinary weighted least-squares fit; None where there are too few neighbours."""
    used = [n for n in na[a] if match[n] >= 0][:most]
    if len(used) < 3:
        return None
    arm = xa[used] - xa[a]
    far = np.linalg.norm(arm, axis=1)
    design = np.column_stack([np.ones(len(used)), arm]) / far[:, None]
    fit = np.linalg.lstsq(design, xb[match[used]] / far[:, None], rcond=None)[0]
    return np.r_[fit[0], far.mean()]
