"""The verb `align_images` (AIAA 2005-5007, section III.A: "2D alignment")."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark import detection, resection
from windmark.errors import UsageError
from windmark.geometry.planar import KINDS, Choice, PlanarFit, PlanarTransform, choose, sound_pairs
from windmark.options.detection import MERIT_MAX, POLARITY
from windmark.scene import Detections
from windmark.scene.levels import missing_at, saturated_as_missing
from windmark.tasks.align2d.apart import moved_together
from windmark.tasks.align2d.matching import SpotMatching, match_spots
from windmark.tasks.align2d.result import ImageAlignment, NotAligned
from windmark.tasks.align2d.still import have_not_moved, standing_still

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def align_images(
    image: ArrayLike,
    reference: ArrayLike,
    *,
    detections: Detections | None = None,
    reference_detections: Detections | None = None,
    pairs: ArrayLike | None = None,
    kind: str = "auto",
    max_shift_px: float | None = None,
    radius_px: float | Sequence[float] | None = None,
    polarity: str = POLARITY.default,
    merit_max: float = MERIT_MAX.default,
    mask: ArrayLike | None = None,
    reference_mask: ArrayLike | None = None,
    keep_still: bool = False,
) -> ImageAlignment | NotAligned:
    """Recompute an image so that its markers lie where the reference's are; no grid and no camera are needed.

    Markers of both pictures are found and matched (`match_spots`), or taken as given. Transformations from the
    reference to the image are fitted to the pairs, weighted by the marks' covariances, and judged on marks that the fit
    has not seen; the simplest that does not predict these worse is taken. Motion and deformation are compensated alike
    as far as the markers tell them: nothing is learnt about the deformation itself, and relief that moves against its
    surroundings in the picture (parallax) stays.

    Parameters
    ----------
    image : (H, W) or (H, W, C), wind-on; markers are looked for in grey levels, so (H, W, C) needs ``detections``
    reference : the same, wind-off; its size is the result's
    detections, reference_detections : their markers; None finds them. Of these the covariances are used
    pairs : (K, 2) which spot of the reference is which of the image; None matches them
    kind : "auto", or "similarity", "affine", "projective", "poly2", "poly3", "spline" (smoothing thin plate)
    max_shift_px : no marker has moved farther in the picture; tells apart what is regular
    radius_px, polarity, merit_max : of `detect`; an unknown radius is estimated in each picture
    mask, reference_mask : (H, W) pixels of the pictures where markers may be
    keep_still : markers that stand still while the others move take part; else they are taken for walls and left out

    Returns
    -------
    An `ImageAlignment`, or a falsy `NotAligned` with its reason: no or too few markers, or on a line, for the kind
    asked for; a matching that could be chance; a layout that looks like itself when shifted or turned; a mirror image.

    Raises
    ------
    ValueError
        Wrong shapes, unknown options.

    Notes
    -----
    Source: AIAA 2005-5007, section III.A; held-out marks as the judge: Bell, NTRS 20020034950. The folds of a
    polynomial far from the markers show nothing (NaN).

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> wind_off = wm.synth.marker_scene(1, size_px=(160, 120), markers=12).image
    >>> wind_on = np.roll(wind_off, (2, 3), axis=(0, 1))  # 3 px to the right, 2 px down
    >>> aligned = wm.align_images(wind_on, wind_off)
    >>> aligned.kind, aligned.shift_px.mean(axis=0).round(1).tolist()
    ('similarity', [3.0, 2.0])
    >>> bool(np.nanmedian(abs(aligned.image - wind_off)) < 1.0)  # grey levels
    True
    """
    check_options(kind, max_shift_px)
    picture, base = np.asarray(image), np.asarray(reference)
    for name, array in (("image", picture), ("reference", base)):
        if array.ndim not in (2, 3) or not array.size:
            raise UsageError(f"align_images: {name} must be (H, W) or (H, W, C), got {array.shape}")
    options: dict[str, Any] = {"kind": kind, "max_shift_px": max_shift_px, "radius_px": radius_px,
                               "polarity": polarity, "merit_max": merit_max, "keep_still": keep_still}  # fmt: skip
    find = {"radius_px": radius_px, "polarity": polarity, "merit_max": merit_max}
    a = reference_detections if reference_detections is not None else _spots(base, "reference", find, reference_mask)
    b = detections if detections is not None else _spots(picture, "image", find, mask)
    for name, spots, given, area in (("reference", a, base, reference_mask), ("image", b, picture, mask)):
        if not len(spots):
            why = detection.why_none(given, mask=area, **find) if given.ndim == 2 else "none were given"
            return NotAligned(f"no marker in the {name}: {why}", "no_spots", 0, float("inf"), a, b, options)
    found = checked_pairs(pairs, len(a), len(b)) if pairs is not None else match_spots(a, b, max_shift_px=max_shift_px)
    if not isinstance(found, SpotMatching | np.ndarray):
        return NotAligned(found.reason, found.cause, found.count, found.log10_nfa, a, b, options)
    nfa, rival = (float("nan"), None) if isinstance(found, np.ndarray) else (found.log10_nfa, found.rival)
    index = found if isinstance(found, np.ndarray) else np.stack([found.reference, found.image], axis=1)
    answer = _fitted(a, b, index, kind, keep_still)
    if isinstance(answer, str):
        return NotAligned(answer, "undetermined", len(index), nfa, a, b, options)
    choice, kept, rejected, still = answer
    assert choice.chosen is not None
    fit = choice.chosen.fit
    assert fit is not None
    if pairs is None:
        rejected, still = _with_left_over(a, b, kept, rejected, still, fit, picture.shape[:2], options)
    height, width = base.shape[:2]
    light = picture
    if picture.ndim == 2:
        light = missing_at(saturated_as_missing(picture)[0], detection.dead_pixels(picture))
    values = resection.warp_image(light, unfolded(fit.transform, a.xy[kept[:, 0]]), (width, height))
    return ImageAlignment(
        values, fit.transform, a, b, kept, rejected, still, fit.residual, fit.held_out, choice.trials, choice.reason,
        nfa, rival, options,
    )  # fmt: skip


def check_options(kind: str, max_shift_px: float | None) -> None:
    """Raise `ValueError` for a kind that there is not, or a largest motion that is none."""
    if kind != "auto" and kind not in KINDS:
        raise UsageError(f"align_images: kind must be auto, {', '.join(KINDS)}, got {kind!r}")
    if max_shift_px is not None and not (np.isfinite(max_shift_px) and max_shift_px > 0):
        raise UsageError(f"align_images: max_shift_px must be > 0, got {max_shift_px}")


def checked_pairs(pairs: ArrayLike, count_a: int, count_b: int) -> Ints:
    """(K, 2) pairs, one to one and within the detections."""
    index = np.asarray(pairs)
    if index.ndim != 2 or index.shape[1] != 2 or index.dtype.kind not in "iu":
        raise UsageError(f"align_images: pairs must be (K, 2) whole numbers, got {index.shape} {index.dtype}")
    for column, count in zip(index.T, (count_a, count_b), strict=True):
        if len(column) and (column.min() < 0 or column.max() >= count):
            raise UsageError(f"align_images: pairs must be numbers of spots, 0 to {count - 1}, got {column.max()}")
        if len(set(column.tolist())) < len(column):
            raise UsageError("align_images: in pairs every spot may appear only once")
    return index.astype(np.int64)


def unfolded(transform: PlanarTransform, markers: Array) -> Any:
    """The transformation as a function, NaN where it turns the picture over or shrinks it to nothing."""
    least = 0.05 * float(np.median(np.linalg.det(transform.jacobian(markers))))

    def place(xy: Array) -> Array:
        out = transform.apply(xy)
        if transform.kind not in ("similarity", "affine"):
            j = transform.jacobian(xy)
            out[j[:, 0, 0] * j[:, 1, 1] - j[:, 0, 1] * j[:, 1, 0] < least] = np.nan
        if transform.kind == "projective":  # beyond the horizon
            u = (xy - transform.centre) / transform.length_px
            out[1 + u @ transform.parameters[6:] <= 0.05] = np.nan
        return out

    return place


def _spots(image: NDArray[Any], name: str, find: dict[str, Any], mask: ArrayLike | None) -> Detections:
    if image.ndim != 2:
        raise UsageError(f"align_images: markers are looked for in (H, W) grey levels, the {name} is {image.shape}; "
                         "expected detections")  # fmt: skip
    return detection.detect(image, mask=mask, **find)


def _fitted(
    a: Detections, b: Detections, index: Ints, kind: str, keep_still: bool
) -> tuple[Choice, Ints, Ints, Ints] | str:  # fmt: skip
    """The choice among the kinds; pairs it is fitted to, wrong ones, those that stand still; or why there is none."""
    still = index[:0]
    if not keep_still:
        wall = standing_still(*_places(a, b, index))
        index, still = index[~wall], index[wall]
    sound = sound_pairs(*_places(a, b, index))
    kept, rejected = index[sound], index[~sound]
    choice = choose(*_places(a, b, kept))
    if kind == "auto":
        if choice.chosen is None:
            return f"no transformation is determined by {len(kept)} pairs of markers: {choice.reason}"
        return choice, kept, rejected, still
    trial = next(t for t in choice.trials if t.kind == kind)
    if trial.fit is None:
        return trial.reason
    held = trial.fit.held_out_px
    asked = Choice(choice.trials, trial, f"{kind}: as asked for, held-out residual {held:.3f} px")
    return asked, kept, rejected, still


def _with_left_over(
    a: Detections, b: Detections, kept: Ints, rejected: Ints, still: Ints, fit: PlanarFit, shape: tuple[int, int],
    options: dict[str, Any],
) -> tuple[Ints, Ints]:  # fmt: skip
    """Rejected and still pairs, with those that the matching has not, as they moved too differently: `moved_together`.

    A part that moved by itself, or walls that did not move beside a model that did.
    """
    taken = np.concatenate([kept, still])
    i, j = (np.setdiff1d(np.arange(len(spots)), taken[:, side]) for side, spots in enumerate((a, b)))
    expected = fit.transform.apply(a.xy[i])
    shown = ((expected > -0.5) & (expected < np.array(shape[::-1]) - 0.5)).all(axis=1)
    i, expected = i[shown], expected[shown]
    found = moved_together(expected, b.xy[j], float(shape[0] * shape[1]), b.xy[kept[:, 1]])
    more = np.stack([i[found[:, 0]], j[found[:, 1]]], axis=1)
    if options["max_shift_px"] is not None:
        more = more[np.hypot(*(b.xy[more[:, 1]] - a.xy[more[:, 0]]).T) <= options["max_shift_px"]]
    again = np.isin(rejected[:, 0], more[:, 0]) | np.isin(rejected[:, 1], more[:, 1])
    wall = np.zeros(len(more), dtype=bool) if options["keep_still"] else have_not_moved(*_places(a, b, more))
    return np.concatenate([rejected[~again], more[~wall]]), np.concatenate([still, more[wall]])


def _places(a: Detections, b: Detections, index: Ints) -> tuple[Array, Array, Array, Array]:
    """Places of pairs in both pictures, and their covariances."""
    i, j = index.T
    return a.xy[i], b.xy[j], a.cov[i], b.cov[j]
