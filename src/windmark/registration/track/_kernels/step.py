"""One frame of tracking as a numba kernel: predict, label, settle, weigh, look for rivals.

Private to the registration room; the acceptance is in `registration.track.step`. Readable twins of the parts:
tests/registration/test_track_kernels.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import cholesky
from windmark.geometry._jit import nb
from windmark.geometry._kernels import to_camera
from windmark.registration.settle._kernels.settle import STEADY, accept_kernel, settle_kernel
from windmark.registration.settle._kernels.state import (
    ALONE,
    COST_END,
    COST_START,
    EXCESS,
    EXPECTED,
    MISFIT,
    PAIRS,
    PIECES,
    TAKEN,
    Sights,
    State,
    blank_kernel,
)
from windmark.registration.settle._kernels.state import HELD_PX as STATE_HELD
from windmark.registration.settle._kernels.state import LOG10_NFA as READ_NFA
from windmark.registration.settle._kernels.state import REST_PX as STATE_REST
from windmark.registration.settle._kernels.state import STEPS as FIT_STEPS
from windmark.registration.track._kernels.checks import bending_gain
from windmark.registration.track._kernels.gates import ROUNDS, fit_with_prior, gates_overlap, label_in_gates, sight_from
from windmark.registration.track._kernels.motion import (
    Estimate,
    adapted,
    difference,
    distance2_of,
    invert_factored,
    predict_kernel,
    update_kernel,
)
from windmark.registration.track._kernels.rivals import rival_kernel
from windmark.registration.track._kernels.spots import sights_of
from windmark.registration.track._kernels.suppose import supposed

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

(
    OUTCOME, COUNT, SEEN, WORTH, LOG10_NFA, LEAD, RIVAL_COUNT, RIVAL_SHARED, DISTANCE2, SPACING, SIGMA, REDUNDANCY,
    EXCESS_PX, MISFIT_PX, RMS_PX, TOLERANCE, SHARE, SUPPOSED, OPEN_PX, HELD_PX, BENDING, STEPS, FIRST_COST, LAST_COST,
    NUMBERS,
) = range(25)  # fmt: skip
"""Places in the numbers of a step, and how many there are."""
ANGLE_LEAST, SCALE_LEAST, SIGMAS = math.radians(5.0), 0.05, 4.0
"""What the prediction rules out counts as that of a prior: within so many sigma, and no sharper than this."""
MIN_COUNT = 4
"""Pairs that fix a pose and check it."""
UNSURE_RAD, UNSURE_SCALE = 0.15, 0.08
"""A prediction with a larger sigma is not worth a trial."""
TRUSTED = 4
"""Labels from the gates stay for so many rounds at most while the excess settles, see `settle_kernel`."""
UNSURE, LOST, LABELLED, NOT_FINITE = range(4)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def step_kernel(
    xyz: Array, normal: Array, sigma: Array, modes: Array, near: Ints, onto: Ints, turn: Array, shift: Array,
    camera: Array, loose: Array, size: Array, xy: Array, spot_cov: Array, radius: Array,
    rotation: Array, translation: Array, velocity: Array, cov: Array, change: Array, expected_change: Array, dt: float,
    given_tolerance: float, rough: float, least_density: float, margin: float, offset: Array,
) -> tuple[
    Array, Array, Array, Array, NDArray[np.int64], NDArray[np.int64], Array, Array, Array, Array, Array, Array, Array,
    Array, Array,
]:  # fmt: skip
    """Label one frame from the motion so far.

    Parameters
    ----------
    xyz, normal, sigma, modes, near, onto, turn, shift : the unit model, how it may be bent, and its
        near-symmetries; one by one, since numba takes ten times as long over tuples of arrays
    camera, loose, size : packed, how it may vary (see `Sights`), and the image's
    xy, spot_cov, radius : (M, 2) spots in the image, at least `MIN_COUNT`, (M, 2, 2) their covariance, (M,)
    rotation, translation, velocity, cov, change, dt : see `Estimate` and `predict_kernel`
    expected_change : (2,) that the adapted one stays near to
    given_tolerance, rough : of the search; 0 takes the usual one, wider for a table with so much `roughness`
    margin : rivals that cannot come so near (nats) are not looked at
    offset : (N, 2) what the accepted pose's projections are moved by, see `State`

    Returns
    -------
    The fields of `registration.track.step.Stepped`; a plain tuple, since numba is slow to give back a named one.
    """
    out = np.zeros(NUMBERS)
    out[LEAD] = math.inf
    if not math.isfinite(spot_cov.sum()):
        out[OUTCOME] = NOT_FINITE
    sights = sights_of(
        xyz, normal, near, sigma, camera, loose, size, xy, spot_cov, radius, given_tolerance, rough, least_density
    )  # fmt: skip
    predicted = predict_kernel(Estimate(rotation, translation, velocity, cov), change, dt)
    r0, t0, prior = predicted.rotation, predicted.translation, predicted.cov[:6, :6].copy()
    best, rival = blank_kernel(sights), blank_kernel(sights)
    distance2, measured = t0[0] ** 2 + t0[1] ** 2 + t0[2] ** 2, np.eye(6)
    sure = max(prior[0, 0], prior[1, 1], prior[2, 2]) < UNSURE_RAD**2 and prior[5, 5] < UNSURE_SCALE**2 * distance2
    if out[OUTCOME] == UNSURE and sure:
        out[OUTCOME], out[TOLERANCE] = LOST, sights.tolerance[0]
        labelled = _label(sights, (r0, t0, prior), best, out)
        if labelled and settle_kernel(sights, best, TRUSTED) == STEADY:
            out[OUTCOME] = LABELLED
    if out[OUTCOME] == LABELLED:
        innovation, known = np.empty(6), np.empty(6)
        _weigh(sights, best, prior, t0, out)
        difference(best.rotation, best.translation, r0, t0, innovation)
        invert_factored(best.factor, measured)
        out[DISTANCE2] = distance2_of(innovation, prior, measured)
        out[LEAD] = rival_kernel(sights, (onto, turn, shift), (r0, t0, prior), best, margin, rival)
        _compare(best, rival, out)
        best.offset[0] = offset
        if accept_kernel(sights, best):
            invert_factored(best.factor, measured)
            difference(best.rotation, best.translation, r0, t0, innovation)
            out[EXCESS_PX] = math.sqrt(best.numbers[0, EXCESS])
            if out[EXCESS_PX] > 0.0 and modes.shape[0] > 0:
                out[BENDING] = bending_gain(sights, modes, best)
        for k in range(6):
            known[k] = prior[k, k] + measured[k, k]
        out[STEPS], out[FIRST_COST], out[LAST_COST] = (
            best.report[FIT_STEPS], best.report[COST_START], best.report[COST_END]
        )  # fmt: skip
        change = adapted(change, expected_change, innovation, known, distance2, dt)
        predicted = update_kernel(predicted, innovation, measured)
    marker = np.flatnonzero(best.match[0] >= 0)
    spot, residual = best.match[0][marker].astype(np.int64), best.residual[0][marker]
    distance = np.sqrt(residual[:, 0] ** 2 + residual[:, 1] ** 2)
    if len(distance):
        out[RMS_PX] = math.sqrt((distance**2).mean())
    return (
        out, best.rotation, best.translation, measured, marker, spot, residual, distance, rival.rotation,
        rival.translation, predicted.rotation, predicted.translation, predicted.velocity, predicted.cov, change,
    )  # fmt: skip


@nb.njit(cache=True, nogil=True)
def _compare(best: State, rival: State, out: Array) -> None:
    """Counts of the rival."""
    for m in range(best.match.shape[1]):
        out[RIVAL_COUNT] += rival.match[0, m] >= 0
        out[RIVAL_SHARED] += rival.match[0, m] >= 0 and rival.match[0, m] == best.match[0, m]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _label(sights: Sights, predicted: tuple[Array, Array, Array], best: State, out: Array) -> bool:
    """First labels and pose, from the prediction's gates."""
    cov, factor, information = predicted[2].copy(), predicted[2].copy(), np.empty((6, 6))
    best.rotation[:], best.translation[:] = predicted[0], predicted[1]
    if not cholesky(factor, 6, 1e-14):
        return False
    invert_factored(factor, information)
    floor2 = (0.25 * sights.tolerance[0]) ** 2
    sight = sight_from(sights, best, cov)
    if gates_overlap(sights, sight):
        out[SUPPOSED] = 1.0
        if supposed(sights, sight, best, cov, floor2) <= 0.0:
            return False
        sight = sight_from(sights, best, cov)
    for round_ in range(ROUNDS):
        if label_in_gates(sights, sight, floor2, best.match[0]) < MIN_COUNT:
            return False
        if round_ < ROUNDS - 1:
            if not fit_with_prior(sights, best, (predicted[0], predicted[1], information), floor2, cov):
                return False
            sight = sight_from(sights, best, cov)
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _weigh(sights: Sights, best: State, prior: Array, t0: Array, out: Array) -> None:
    """What the tests of acceptance need of a settled solution."""
    n, count = best.match.shape[1], 0
    spacing = np.empty(n)
    for k in range(n):
        if best.match[0, k] < 0:
            continue
        apart, o = 0.0, sights.near[k, 0]
        for i in range(3):
            apart += (sights.xyz[k, i] - sights.xyz[o, i]) ** 2
        z = to_camera(best.rotation, best.translation, sights.xyz[k, 0], sights.xyz[k, 1], sights.xyz[k, 2])[2]
        spacing[count] = math.sqrt(apart) * best.camera[0, 0] / z
        count += 1
    angle = min(max(ANGLE_LEAST, SIGMAS * math.sqrt(max(prior[0, 0], prior[1, 1], prior[2, 2]))), math.pi)
    scale = max(SCALE_LEAST, SIGMAS * math.sqrt(prior[5, 5]) / max(t0[2], 1e-300))
    share = (angle - math.sin(angle)) / math.pi * min(1.0, math.log10(1.0 + scale))
    readings = best.readings[0]
    out[COUNT], out[SEEN], out[SHARE] = count, best.numbers[0, EXPECTED], share
    out[WORTH] = readings[PAIRS] + max(readings[ALONE], readings[PIECES])
    out[LOG10_NFA] = readings[READ_NFA] + math.log10(share)
    out[SPACING], out[SIGMA] = (
        np.median(spacing[:count]),
        np.median(np.sqrt(0.5 * (sights.cov[:, 0] + sights.cov[:, 2]))),
    )
    out[REDUNDANCY] = 2 * count - best.numbers[0, TAKEN]
    out[EXCESS_PX], out[MISFIT_PX] = math.sqrt(best.numbers[0, EXCESS]), math.sqrt(best.numbers[0, MISFIT])
    out[OPEN_PX], out[HELD_PX] = best.open[0, STATE_REST], best.open[0, STATE_HELD]
