"""The mean of registered frames of one point, bad frames left out with the reason."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError, g3
from windmark.paint.refusal import NotFitted

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

APART = 5.0
"""Robust sigmas by which the logarithm of a frame's misfit must be above the other frames'."""
EVEN = 0.02
"""What frames' misfits differ by at any rate, beside the chance of few nodes."""
NO_LIGHT = 0.1
"""A frame of less than this part of the others' light has none: shutter, lamp."""
COVERED = 0.5
"""A frame must show so large a part of the nodes that the median frame shows."""
WITHIN = 3.0
"""Robust sigmas from most nodes' ratio within which a node counts for a frame's light."""
TRIM = 0.02
"""Part of a frame's nodes, those that fit worst, that do not count for it: dust, glints, outlines."""


@dataclass(frozen=True, eq=False)
class AveragedFrames:
    """The mean of F frames on N nodes.

    Parameters
    ----------
    value, variance : (N,) of the mean at the mean light; NaN where no frame that counts shows the node
    used : (F,) frames that count
    reasons : (F,) why a frame does not, "" where it does
    light : (F,) each frame's light relative to the mean of those that count, 1 where it is taken as even
    count : (N,) frames that show the node
    excess : by which the frames scatter more than their variances say, as a factor of sigma; in ``variance`` if above 1
    """

    value: Array
    variance: Array
    used: Mask
    reasons: tuple[str, ...]
    light: Array
    count: NDArray[np.int64]
    excess: float

    def __bool__(self) -> bool:
        return True


def enough(used: int, frames: int) -> bool:
    """Whether so many frames of all that were taken can stand for them: one, and of three or more at least half."""
    return used > 0 and (frames < 3 or 2 * used >= frames)


def average_frames(
    values: ArrayLike, variances: ArrayLike, *, free_light: bool = True, lost: int = 0
) -> AveragedFrames | NotFitted:
    """The mean of frames of one point that were brought onto the same nodes (or pixels).

    Parameters
    ----------
    values, variances : (F, N), NaN where a frame does not show a node
    free_light : the lamp's power may differ between frames: each is brought to the mean one
    lost : further frames that were taken and could not be brought there: they agree with none

    Returns
    -------
    AveragedFrames; or NotFitted where fewer than half of the frames agree (`enough`). A frame is bad where
    it shows less than half of the nodes that others show, it is dark, or it differs from the median of all by more than
    the others do. The mean is the sum of the frames over the sum of their lights, the best one for photon noise.

    Raises
    ------
    ValueError
        For arrays that are not (F, N).

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> scene = np.linspace(100.0, 200.0, 50)
    >>> frames = scene * np.array([[1.0], [1.02], [0.98]])  # the lamp flickers
    >>> mean = wm.average_frames(frames, np.ones((3, 50)))
    >>> mean.light.round(3).tolist(), np.allclose(mean.value, scene)
    ([1.0, 1.02, 0.98], True)
    """
    v, var = np.asarray(values, dtype=float), np.asarray(variances, dtype=float)
    if v.ndim != 2 or v.shape != var.shape or not v.size:
        raise UsageError(f"average_frames: values and variances must be (F, N), got {v.shape} and {var.shape}")
    v = np.where(var >= 0, v, np.nan)
    frames = len(v)
    reasons = [""] * frames
    shown = np.isfinite(v).sum(axis=1)
    for k in np.flatnonzero((shown < COVERED * np.median(shown)) | (shown == 0)).tolist():
        reasons[k] = f"shows {shown[k]} nodes, the others {int(np.median(shown))}"
    light, misfit = _compared(v, var, reasons, free_light)
    for k in np.flatnonzero(light < NO_LIGHT).tolist():
        reasons[k] = reasons[k] or f"its light is {g3(100 * light[k])} % of the other frames'"
    light, misfit = _compared(v, var, reasons, free_light)
    for k in _standing_out(reasons, np.log(np.maximum(misfit, 1e-12)), float(np.median(shown))):
        reasons[k] = f"differs from the others by {g3(misfit[k])} times its sigma"
    used = np.array([not r for r in reasons])
    if not enough(int(used.sum()), frames + lost):
        said = f"average_frames: {int(used.sum())} of {frames + lost} frames agree"
        return NotFitted(said, {"reasons": tuple(reasons)})
    light, misfit = _compared(v, var, reasons, free_light)
    if free_light:
        light = light / light[used].mean()
    on = np.isfinite(v) & used[:, None]
    count = on.sum(axis=0)
    total = np.where(on, light[:, None], 0.0).sum(axis=0)
    total = np.where(count > 0, total, 1.0)
    mean = np.where(on, v, 0.0).sum(axis=0) / total
    excess = float(np.sqrt(np.mean(misfit[used] ** 2))) if used.sum() > 1 else 1.0
    variance = np.where(on, var, 0.0).sum(axis=0) / total**2 * max(excess, 1.0) ** 2
    mean, variance = (np.where(count > 0, a, np.nan) for a in (mean, variance))
    return AveragedFrames(mean, variance, used, tuple(reasons), light, count, excess)


def _compared(v: Array, var: Array, reasons: list[str], free_light: bool) -> tuple[Array, Array]:
    """Light (F,) of each frame and its misfit (F,) in sigmas, against the median of the frames without a reason."""
    good = np.array([not r for r in reasons])
    light, misfit = np.ones(len(v)), np.ones(len(v))
    if good.sum() < 2:
        return light, misfit
    if free_light:
        light = _lights(v, good)
    seen = np.isfinite(v[good]).any(axis=0)
    middle = np.full(v.shape[1], np.nan)
    middle[seen] = np.nanmedian((v[good] / light[good, None])[:, seen], axis=0)
    inside = _inside(int(good.sum()))
    for k, frame in enumerate(v):
        with np.errstate(invalid="ignore", divide="ignore"):
            square = (frame / light[k] - middle) ** 2 / (var[k] / light[k] ** 2)
        square = np.sort(square[np.isfinite(square)])
        square = square[: max(int((1 - TRIM) * len(square)), 1)]
        misfit[k] = np.sqrt(square.mean() / inside) if len(square) else 1.0
    return light, misfit


def _inside(n: int) -> float:
    """Mean square, without the largest 2 %, of a normal deviate less the median of n of them, itself among these.

    The median follows each of them: var(median), and twice its covariance 1 / n with one of them. Of few it *is* one of
    them with the chance 1 / n, and then that is no normal deviate.
    """
    if n in _FEW:
        return _FEW[n]
    return (1 + 0.5 * np.pi / (n + (0.5 if n % 2 else 1.2)) - 2 / n) * _TRIMMED


_TRIMMED = 0.87346
"""Mean of the squares of normal deviates without the largest 2 %: P(chi2_3 <= 5.412) / 0.98."""
_FEW = {2: 0.4362, 3: 0.6285, 4: 0.6611, 5: 0.7422, 6: 0.7442, 7: 0.7848, 8: 0.7827, 9: 0.8059, 10: 0.8040, 11: 0.8201}
"""By eight million draws each."""


def _lights(v: Array, good: Mask) -> Array:
    """(F,) light of each frame, the median of the good ones being 1.

    Each is compared with one and the same frame: what that frame shows wrongly is the same factor for all. The median
    of the frames would not do: at one node of F it *is* the frame itself, and the middle of such ratios stays 1 until
    the light differs by more than noise does (of 0.2 % under a noise of 0.5 %, three frames showed 0.09 %).
    """
    anchor = v[int(np.flatnonzero(good)[np.argmax(np.isfinite(v[good]).sum(axis=1))])]
    light = np.array([_ratio(frame, anchor) for frame in v])
    return light / float(np.median(light[good]))


def _ratio(frame: Array, anchor: Array) -> float:
    """The light of a frame over another one's: of the sums over nodes that agree with most of the others."""
    both = np.isfinite(frame) & np.isfinite(anchor) & (anchor > 0)
    if not both.any():
        return 1.0
    ratio = frame[both] / anchor[both]
    middle = float(np.median(ratio))
    off = np.abs(ratio - middle)
    agree = off <= WITHIN * 1.4826 * float(np.median(off))
    return max(float(frame[both][agree].sum() / anchor[both][agree].sum()), 1e-6)


def _standing_out(reasons: list[str], score: Array, nodes: float) -> list[int]:
    """Frames without a reason whose score, the logarithm of a misfit over so many nodes, is above all others'."""
    good = np.array([not r for r in reasons])
    if good.sum() < 3:
        return []
    middle = float(np.median(score[good]))
    by_chance = EVEN + 1 / np.sqrt(2 * max(nodes, 1.0))
    spread = max(1.4826 * float(np.median(np.abs(score[good] - middle))), by_chance)
    return list(np.flatnonzero(good & (score - middle > APART * spread)).tolist())
