"""Is it a disc, or another thing of its size? How outline and inside deviate from an even ellipse says so.

The fitted template is a blurred ellipse of one contrast. What a square, a cross, a letter, a chip of paint, a ring or
a lit rivet has besides are waves of the outline (a square seen at any angle one of four with 0.15 of the radius, see
`_kernels.rivals`), a contrast that falls off across the disc, or a hole; and something of it is left that none of these
explains. Printed discs have some of each, of known size; other things have more of one or several. Each kind of
deviation has a law among discs and one among other things; at what the pixels show the ratio of their densities is the
evidence, in nats. Another thing has a kind of deviation as often as not, so that a kind it lacks says little for a
disc, and one it has nearly all. Where the pixels do not show the shape, both laws say the same: a disc it stays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.detection.pairs import close_pairs
from windmark.detection.shape import CONTAMINATED
from windmark.detection.template.crlb import window_radius
from windmark.detection.template.disc_model import shape_matrix
from windmark.detection.template.fit import BATCH_PIXELS, cut_patches
from windmark.detection.template.request import Scene
from windmark.detection.template.result import TemplateFits
from windmark.detection.template.rim import model_parameters

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

GROUPS = ((0, 2), (2, 4), (4, 6), (6, 8), (8, 9))  # of the deviations: three waves, the inside's slope, the hole
SLOPE, HOLE = 3, 4
OF_DISCS = 0.027, 0.022, 0.03, 0.12, 0.3  # standard deviation of each among printed discs: `detection_real`
OF_OTHERS = 0.12, 0.12, 0.12, 0.5, 0.8  # among squares, letters, chips, rivets and rings: `detection_hunt`
OF_PIXELS = 1.3, 1.3, 1.3, 20.0, 30.0  # px^5, over the fifth power of the radius: pixels and lenses add it to either
OF_PIXELS_MOVED = 1.3, 6.0, 1.3, 20.0, 30.0  # px^5: the moved template's blur follows the pixels less
WORN = 0.05  # share of the discs whose outline is worn or has a tail, and of those that a line or dirt reaches into
WORN_OUTLINE, CROSSED_OUTLINE = (0.07, 0.07, 0.07), (0.3, 0.3, 0.3)  # waves of such outlines
SHADED = 0.05  # share of the discs that are lit or covered in part: their slope is that of other things
LEFT_BY_DISCS, LEFT_BY_OTHERS = 0.03, 0.1  # of the depth, beyond the noise: half-normal, and exponential
DISTURBED, LEFT_BY_DISTURBED = 0.25, 0.1  # share of the discs that dirt or a line reaches into, and what that leaves
SHARE_OF_NOISE = 0.5  # what is left is not known better, as the tiles' noise is not
ONE_KIND = 0.5  # share of the other things that have a kind of deviation
LACKING = 0.1  # as many of them have none of the kinds as if each came by chance
ALL_LACKING = -6.0  # nats of what is so clear a disc that there is no room for any; log(LACKING / 2^6) is -6.5
LARGE_NATS = 30.0  # from which what a share of e^-4 says is no news
MODEL_ERROR = 0.03  # of the depth: pixels of printed discs differ so much from any blurred ellipse (JPEG, blur, print)
LEAST_WAVE = 0.06  # of the radius, of an outline that is another thing's
PIXEL = 0.29  # px, standard deviation of a pixel's box
LEAST_PX = 1.2  # mean half axis; what blur leaves of the shape of smaller discs is no small change of the template
REACH_PX, REACH_BLURS = 2.0, 3.0  # of the patches beyond the larger half axis
BESIDE_PX, BESIDE_BLURS = 0.5, 2.0  # a neighbour's pixels reach so far beyond its ellipse


def rival_evidence(scene: Scene, fits: TemplateFits, variance: Array) -> Array:
    """Nats (K,) by which the pixels speak for another thing than a disc; NaN where there is no fit or too few pixels.

    Parameters
    ----------
    scene : the image as the fits saw it
    fits : (K,) fitted markers, none twice; the pixels of others are left out
    variance : (K,) of one pixel's noise. What template and deviations together leave counts as noise where it is more
    """
    out = np.full(len(fits), np.nan)
    half = np.ceil(fits.axes_px[:, 0] + REACH_BLURS * fits.blur_px + REACH_PX)
    good = np.isfinite(fits.cov).all(axis=(1, 2)) & (fits.blur_px > 0.0) & (half < 0.5 * max(scene.image.shape))
    good &= fits.radius_px >= LEAST_PX
    near = _neighbours(fits)
    out[good], good = ALL_LACKING, good & _room(fits)
    for size in np.unique(half[good]):
        mine = np.flatnonzero(good & (half == size))
        count = -(-mine.size * (2 * int(size) + 1) ** 2 // BATCH_PIXELS)
        for index in np.array_split(mine, count):
            least = variance[index] + np.square(MODEL_ERROR * fits.depth[index])
            value, weight, left = _measured(scene, fits, index, least, near, int(size))
            nats = [
                _evidence(value[:, at], weight[:, at], left[:, at], least, fits.radius_px[index], moved=at == 1)
                + _of_left(left[:, at], variance[index], fits.depth[index])
                for at in range(2)
            ]
            out[index] = _with_any(np.fmax(*nats))
    return out


def _room(fits: TemplateFits) -> NDArray[np.bool_]:
    """Fits (K,) that leave so much of their windows that a deviation that could decide may be in it.

    A wave of the outline of share a leaves a^2 depth^2 radius^3 sqrt(pi) / (2 blur), a Gaussian edge squared along the
    rim; half of it is asked for. Fits that are contaminated have left pixels out and say nothing of what is in them.
    """
    pixels = np.pi * window_radius(fits.radius_px, fits.blur_px) ** 2
    edge = np.hypot(fits.blur_px, PIXEL)
    wave = np.square(LEAST_WAVE * fits.depth) * fits.radius_px**3 * 0.5 * np.sqrt(np.pi) / edge
    return np.asarray(((fits.flags & CONTAMINATED) > 0) | (pixels * np.square(fits.noise) > 0.5 * wave))


def _measured(
    scene: Scene, fits: TemplateFits, index: Ints, noise2: Array, near: Ints, half: int
) -> tuple[Array, Array, Array]:
    """Deviations (B, 2, E) of some of the fits, their inverse covariances in noise of variance 1, and what is left, of
    the template as it was fitted and as it is best beside the deviations; `noise2` (B,) variance of one pixel.
    """
    from windmark.detection._kernels.rivals import EXTRA, deviations, hide

    pixel = np.rint(fits.xy[index]).astype(np.int64)
    patches, weights = cut_patches(scene, pixel, half)
    row = np.full(len(fits), -1)
    row[index] = np.arange(index.size)
    i, j = near[row[near[:, 0]] >= 0].T
    reach = BESIDE_PX + BESIDE_BLURS * fits.blur_px[j, None]
    shape = shape_matrix(fits.axes_px[j] + reach, fits.angle[j])
    hide(weights, row[i], np.column_stack([fits.xy[j] - pixel[row[i]], shape[:, 0], shape[:, 1, 1]]))
    count = index.size
    value, weight, left = np.empty((count, 2, EXTRA)), np.empty((count, 2, EXTRA, EXTRA)), np.empty((count, 2))
    params = model_parameters(scene, fits.take(index), pixel)
    deviations(patches, weights, params, noise2, float(scene.multiplicative), value, weight, left)
    return value, weight, left


def _with_any(nats: Array) -> Array:
    """Evidence for a thing that has any of the kinds; of all others only a share `LACKING` has none.

    Kind by kind as many have it as not, so that one in 2^6 would have none: a disc like any other.
    """
    none = 0.5 ** (len(GROUPS) + 1)
    with np.errstate(invalid="ignore"):
        some = np.maximum(np.exp(np.minimum(nats, LARGE_NATS)) - none, 0.0) + LACKING * none
    return np.asarray(np.where(nats < LARGE_NATS, np.log(some / (1.0 - none + LACKING * none)), nats))


def _evidence(value: Array, weight: Array, left: Array, variance: Array, radius: Array, moved: bool) -> Array:
    """Sum over the kinds of deviations of what each says, see `_of_one_kind`; NaN where they are not determined.

    Beside the template as it was fitted all discs of a frame deviate little; beside the moved one it is seen how much
    a worn outline or a shadow deviates, and a few of the discs have such.
    """
    out = np.full(len(value), np.nan)
    known = np.flatnonzero(np.isfinite(value).all(axis=1) & np.isfinite(left))
    cov: Array = np.asarray(np.linalg.inv(weight[known]) * np.fmax(left, variance)[known, None, None], np.float64)
    pixels = np.array(OF_PIXELS_MOVED if moved else OF_PIXELS)[:, None] / radius[known] ** 5

    def law(spreads: tuple[float, ...]) -> Array:
        return np.array([
            _log_normal(value[known][:, slice(*GROUPS[k])], cov[:, slice(*GROUPS[k]), slice(*GROUPS[k])],
                        np.hypot(spread, pixels[k]))
            for k, spread in enumerate(spreads)
        ])  # fmt: skip

    disc = law(OF_DISCS)
    against = law(OF_OTHERS) - disc
    # A peak in the middle is glare.
    against[HOLE] = np.where(value[known][:, GROUPS[HOLE][0]] > 0.0, against[HOLE], np.minimum(against[HOLE], 0.0))
    out[known] = _of_one_kind(against).sum(axis=0)
    if moved:
        usual, *odd = np.log(1.0 - 2.0 * WORN), *(
            np.log(WORN) + (law(outline) - disc[:SLOPE]).sum(axis=0) for outline in (WORN_OUTLINE, CROSSED_OUTLINE)
        )  # fmt: skip
        out[known] -= np.logaddexp(usual, np.logaddexp(*odd))
        out[known] -= np.logaddexp(np.log(1.0 - SHADED), np.log(SHADED) + against[SLOPE])
    return out


def _log_normal(a: Array, own: Array, spread: Array) -> Array:
    """Logarithm (K,) of a normal density, but for its constant, at a (K, N) known with covariances `own` (K, N, N).

    N is 1 or 2.
    """
    more = np.square(spread)
    xx = own[:, 0, 0] + more
    if a.shape[1] == 1:
        return np.asarray(-0.5 * (np.square(a[:, 0]) / xx + np.log(xx)))
    x, y, xy, yy = a[:, 0], a[:, 1], own[:, 0, 1], own[:, 1, 1] + more
    det = xx * yy - np.square(xy)
    square = (yy * np.square(x) - 2.0 * xy * x * y + xx * np.square(y)) / det
    return np.asarray(-0.5 * (square + np.log(det)))


def _of_left(left: Array, variance: Array, depth: Array) -> Array:
    """What the pixels say that template and deviations together do not explain, beyond noise of a variance (K,)."""
    unsure = SHARE_OF_NOISE * np.sqrt(variance) / depth
    share = np.sqrt(np.maximum(left - variance, 0.0)) / depth
    disc, other = np.hypot(LEFT_BY_DISCS, unsure), np.hypot(LEFT_BY_OTHERS, unsure)
    usual = np.sqrt(2.0 / np.pi) / disc * np.exp(-0.5 * np.square(share / disc))
    disturbed = np.exp(-share / LEFT_BY_DISTURBED) / LEFT_BY_DISTURBED
    law = (1.0 - DISTURBED) * usual + DISTURBED * disturbed
    return _of_one_kind(-share / other - np.log(other) - np.log(law))


def _of_one_kind(against: Array) -> Array:
    """Evidence of a kind of deviation for a thing that has it or, as often, has not; `against` (K,) if it has."""
    return np.asarray(np.logaddexp(np.log(1.0 - ONE_KIND), np.log(ONE_KIND) + against))


def _neighbours(fits: TemplateFits) -> Ints:
    """Pairs (L, 2) of fits, both ways, of which the second may reach into the first one's patch."""
    place = np.nan_to_num(fits.xy, nan=-1e9)
    reach = np.nan_to_num(2.0 * fits.axes_px[:, 0] + 5.0 * fits.blur_px + REACH_PX)
    pairs = close_pairs(place, float(reach.max(initial=0.0)))
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    distance, size = np.hypot(*(place[pairs[:, 0]] - place[pairs[:, 1]]).T), fits.axes_px[:, 0]
    inner = 0.5 * np.minimum(size[pairs[:, 0]], size[pairs[:, 1]])  # one marker found twice hides nothing
    return np.asarray(pairs[(distance > inner) & (distance < reach[pairs[:, 0]])])
