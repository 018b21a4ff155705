"""Stripes in a picture: interference, a flickering light under a rolling shutter, rows and columns of a sensor.

Columns whose offsets know nothing of each other are one of the parts of a frame's noise (`noise`). Stripes of a period
are not such: offsets of neighbouring columns have opposite signs, or the same. Taken for the former they leave no room
for the noise that every pixel has for itself: then nothing would be uncertain along the stripes, where sums over
columns cancel, and the centre would be known exactly. Stripes have a spectrum of their own instead: strengths >= 0 of
lines cos(2 pi f x + phase), f = `frequencies`, of unknown phase, which the forms (c^T e)^2 + (s^T e)^2 of the residuals
tell. And what is white is seen where no stripe is: in differences of neighbours along the stripes.

Forms of stripes are large, and as unsure; forms of differences small, and sure: each counts as its scatter from marker
to marker allows. A fit leaves Q e of the noise e, and everything is compared with its expectation in that (`noise`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from windmark.detection.template.forms import PARTS, forms_of

Array = NDArray[np.float64]

LINES = 24  # at least, and of more those that are strongest
MISSED = 0.5  # of the differences: where noise without stripes explains no more it has forgotten what each pixel has
BELIEVED = 0.3  # stripes are, where they leave less than this of the misfit of columns that know nothing of each other
OFFSETS = slice(1, 3)  # of the parts: columns and rows
NUMBERS = 500_000  # of images of differences, whose mean is asked: of large windows not all are needed
INEXACT = 0.02  # of a form: windows are not quite the typical one


def no_stripes(count: int = LINES) -> Array:
    """Strengths (2, K) where there are none."""
    return np.zeros((2, count))


def frequencies(count: int) -> Array:
    """(K,) per pixel, evenly up to the shortest period."""
    return np.asarray(np.arange(1, count + 1) / (2.0 * count))


def of_stripes(influence: Array, strengths: Array) -> Array:
    """(B, 2, 2) covariance that stripes of strengths (2, K) make of the centres of influences (B, 2, S, S)."""
    cov = np.zeros((len(influence), 2, 2))
    for lines, across in zip(strengths, (influence.sum(2), influence.sum(3)), strict=True):
        if lines.any():
            gap = np.arange(influence.shape[-1])[:, None] - np.arange(influence.shape[-1])
            waves = np.cos(2.0 * np.pi * frequencies(len(lines))[:, None, None] * gap)
            correlation = np.tensordot(lines, waves, axes=1)
            cov += across @ correlation @ across.swapaxes(1, 2)
    return cov


def with_stripes(
    residual: Array, used: Array, jacobian: Array, weights: Sequence[Array], each: Array, expected: Array,
    given: Array, family: Sequence[int], asked: NDArray[np.bool_],
) -> tuple[tuple[Array, Array], float, float] | None:  # fmt: skip
    """Strengths (2 PARTS,) and (2, K) of noise with stripes, and tr Q C Q, tr (Q C Q)^2 per pixel.

    None where stripes explain the forms hardly better, and the ``given`` strengths the differences as well.

    Parameters
    ----------
    residual, used : (B, S, S) of the markers, and 1 where a pixel was used
    jacobian : (10, S, S) images that the typical marker's fit, which is the first, takes out of its residuals
    weights : of its pixels (S, S), as the forms have them
    each, expected : (F, B), (F, 2 PARTS) forms of the markers per pixel, and their expectations
    given : (2 PARTS,) strengths without stripes
    family : which of the parts may be
    asked : (2,) whether there are vertical, horizontal stripes
    """
    from scipy.optimize import nnls

    basis = np.linalg.qr(jacobian.reshape(len(jacobian), -1).T)[0].T.reshape(jacobian.shape)
    pixels, count = used.sum((1, 2)), max(LINES, residual.shape[-1])
    lines, kept = _strongest(residual * used, asked, count)
    left = lines * used[0]
    left = left - np.tensordot(np.tensordot(left, basis, axes=((1, 2), (1, 2))), basis, axes=1)
    flat = left.reshape(len(left), -1)
    of_lines = _pairs(np.stack([forms_of(left * w) for w in weights]).reshape(-1, len(left))) / pixels[0]
    among = _pairs(_pairs((flat @ (lines * used[0]).reshape(len(lines), -1).T) ** 2).T) / pixels[0]
    along = (residual * used).reshape(len(residual), -1) @ lines.reshape(len(lines), -1).T
    seen = _pairs(along**2) / pixels[:, None]
    smooth, rough = _differences(residual, used, basis, weights[:2], left)
    forms = np.concatenate([each, seen.T, smooth])
    wide = np.concatenate([
        np.concatenate([expected, of_lines], axis=1),
        np.concatenate([of_lines[: expected.shape[1]].T, among], axis=1),
        rough,
    ])  # fmt: skip
    target, parts = forms.mean(axis=1), [*family, *range(expected.shape[1], wide.shape[1])]
    weight = 1.0 / unsure(forms)
    scaled = wide * weight[:, None]
    unit = np.maximum(np.linalg.norm(scaled, axis=0), 1e-300)
    misfit = [nnls((scaled / unit)[:, some], target * weight) for some in (list(family), parts)]
    best = np.zeros(wide.shape[1])
    if misfit[1][1] < BELIEVED * misfit[0][1]:
        best[parts] = misfit[1][0] / unit[parts]
    elif _misses(given, smooth, rough):
        best[list(family)] = misfit[0][0] / unit[list(family)]
    else:
        return None
    if _misses(best[: len(given)], smooth, rough):  # stripes so strong that what the fit makes of them hides all else
        best[0] = (smooth.mean(axis=1) / np.maximum(rough[:, 0], 1e-300)).min()
    square = best @ np.concatenate([wide[: expected.shape[1]], wide[len(each) : -len(smooth)]]) @ best
    strengths = no_stripes(count)
    strengths[kept] = best[2 * PARTS :]
    return (best[: 2 * PARTS], strengths), float(wide[0] @ best), float(square)


def _misses(strengths: Array, smooth: Array, rough: Array) -> bool:
    """Whether parts other than columns and rows explain less of the differences than they must.

    Columns and rows leave nothing in those along them but for what the fit makes of them.
    """
    own = strengths.reshape(2, -1).copy()
    own[:, OFFSETS] = 0.0
    return bool((rough[:, : strengths.size] @ own.ravel() < MISSED * smooth.mean(axis=1)).any())


def unsure(forms: Array) -> Array:
    """How well the means (F,) of forms (F, B) of markers are known."""
    mean, scatter = forms.mean(axis=1), forms.std(axis=1) / np.sqrt(forms.shape[1])
    return np.asarray(np.maximum(np.hypot(scatter, INEXACT * np.abs(mean)), 1e-300))


def _strongest(residual: Array, asked: NDArray[np.bool_], count: int) -> tuple[Array, NDArray[np.bool_]]:
    """Cosines and sines (2 L, S, S), in turns, of the stripes that are asked for, and which (2, K) of all they are.

    A large window tells more frequencies apart than there are forms: those count that residuals have most of.
    """
    size, kept = residual.shape[-1], no_stripes(count).astype(bool)
    phase = 2.0 * np.pi * frequencies(count)[:, None] * np.arange(size)
    waves = np.stack([np.cos(phase), np.sin(phase)], axis=1)
    images = []
    for k in np.flatnonzero(asked):
        power = np.square(residual.sum(1 + k) @ waves.reshape(-1, size).T).sum(0).reshape(-1, 2).sum(1)
        kept[k, np.argsort(-power, kind="stable")[:LINES]] = True
        upright = np.broadcast_to(waves[kept[k]].reshape(-1, 1, size), (2 * LINES, size, size))
        images.append(upright.swapaxes(1, 2) if k else upright)
    return np.concatenate(images), kept


def _pairs(forms: Array) -> Array:
    """(..., L) sums of a cosine's and its sine's."""
    return np.asarray(forms[..., ::2] + forms[..., 1::2])


def _differences(
    residual: Array, used: Array, basis: Array, weights: Sequence[Array], left: Array
) -> tuple[Array, Array]:
    """Mean squares (3, B) of differences of neighbours down, across, and of both, and what each part makes of them.

    Of neighbours that were used, all of them: there no stripe along the difference leaves anything. Of one colour of a
    mosaic each second pixel was used, and the next but one is the neighbour.
    """
    seen, made, gap = [], [], 1 if (used[0, 1:] * used[0, :-1]).any() else 2
    ends = np.eye(1 + gap)[0] - np.eye(1 + gap)[gap]
    for signs in (ends[:, None], ends[None], ends[:, None] * ends):

        def differ(images: Array, signs: Array = signs) -> Array:
            views = sliding_window_view(images, signs.shape, axis=(1, 2))
            return np.einsum("kabij,ij->kab", views, signs)

        whole = differ(used, np.abs(signs)) == np.abs(signs).sum()
        seen.append((np.square(differ(residual)) * whole).sum((1, 2)) / np.maximum(whole.sum((1, 2)), 1))
        corner = np.argwhere(whole[0])
        corner = corner[:: 1 + len(corner) * used[0].size // NUMBERS]
        rows = np.zeros((len(corner), *used.shape[1:]))
        for i, j in np.ndindex(signs.shape):
            rows[np.arange(len(corner)), corner[:, 0] + i, corner[:, 1] + j] = signs[i, j]
        rows = rows - np.tensordot(np.tensordot(rows, basis, axes=((1, 2), (1, 2))), basis, axes=1)
        lines = _pairs((np.square(differ(left)) * whole[0]).sum((1, 2))) / max(whole[0].sum(), 1)
        made.append(np.concatenate([*(forms_of(rows * w).mean(1) for w in weights), lines]))
    return np.array(seen), np.array(made)
