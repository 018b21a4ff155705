"""One frame of tracking as a numba kernel: predict, label, refine, weigh, look for rivals.

Private to the registration room; the acceptance is in `registration.track.accept`. Readable twins of the parts:
tests/registration/test_track_kernels.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import cholesky
from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_point, to_camera
from windmark.registration._kernels.evidence import log10_nfa
from windmark.registration._kernels.fit import (
    COST_END,
    COST_START,
    EXCESS,
    EXPECTED,
    FOCAL,
    ITERATIONS,
    MISFIT,
    Fit,
    Markers,
    Spots,
    State,
)
from windmark.registration._kernels.settle import STEADY, accept_kernel, settle_kernel
from windmark.registration.track._kernels.gates import (
    ROUNDS,
    fit_with_prior,
    gates_overlap,
    label_in_gates,
    sight_from,
    supposed,
)
from windmark.registration.track._kernels.motion import (
    Estimate,
    adapted,
    difference,
    distance2_of,
    invert_factored,
    predict_kernel,
    update_kernel,
)
from windmark.registration.track._kernels.rivals import against, rival_kernel, worth_of
from windmark.registration.track._kernels.spots import Columns, spots_of, to_plane_kernel

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

(
    OUTCOME, COUNT, SEEN, WORTH, LOG10_NFA, LEAD, RIVAL_COUNT, RIVAL_SHARED, DISTANCE2, SPACING, SIGMA, EXCESS_PX,
    MISFIT_PX, RMS_PX, TOLERANCE, SHARE, SUPPOSED, STEPS, FIRST_COST, LAST_COST, NUMBERS,
) = range(21)  # fmt: skip
"""Places in the numbers of a step, and how many there are."""
ANGLE_LEAST, SCALE_LEAST, SIGMAS = math.radians(5.0), 0.05, 4.0
"""What the prediction rules out counts as that of a prior: within so many sigma, and no sharper than this."""
FIXED, MIN_COUNT = 3, 4
"""Pairs that determine a pose, and that fix it and check it."""
UNSURE_RAD, UNSURE_SCALE = 0.15, 0.08
"""A prediction with a larger sigma is not worth a trial."""
TRUSTED = 4
"""Labels from the gates stay for so many rounds at most while the excess settles, see `settle_kernel`."""
UNSURE, LOST, LABELLED, TOO_FEW, NOT_FINITE = range(5)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def step_kernel(
    xyz: Array, normal: Array, sigma: Array, near: Ints, onto: Ints, turn: Array, shift: Array, camera: Array,
    size: Array, centre: Array, scale: float, xy: Array, spot_cov: Array, radius: Array, rotation: Array,
    translation: Array, velocity: Array, cov: Array, change: Array, expected_change: Array, dt: float,
    given_tolerance: float, rough: float, least_density: float, margin: float,
) -> tuple[
    Array, Array, Array, Array, NDArray[np.int64], NDArray[np.int64], Array, Array, Array, Array, Array, Array, Array,
    Array, Array,
]:  # fmt: skip
    """Label one frame from the motion so far.

    Parameters
    ----------
    xyz, normal, sigma, near, onto, turn, shift, centre, scale : the unit model, its near-symmetries, and its `Frame`;
        one by one, since numba takes ten times as long over tuples of arrays
    xy, spot_cov, radius : (M, 2) spots in the image, (M, 2, 2) their covariance, (M,); those that the lens has no
        inverse for are left out
    rotation, translation, velocity, cov, change, dt : see `Estimate` and `predict_kernel`
    expected_change : (2,) that the adapted one stays near to
    given_tolerance, rough : of the search; 0 takes the usual one, wider for a table with so much `roughness`
    margin : rivals that cannot come so near (nats) are not looked at

    Returns
    -------
    The fields of `registration.track.step.Stepped`; a plain tuple, since numba is slow to give back a named one.
    """
    markers = Markers(xyz, normal, sigma)
    p, plane_cov = to_plane_kernel(camera, size, xy, spot_cov)
    index = np.flatnonzero(p[:, 0] == p[:, 0])
    if len(index) < len(xy):
        p, plane_cov, xy, spot_cov = p[index], plane_cov[index], xy[index], spot_cov[index]
    predicted = predict_kernel(Estimate(rotation, translation, velocity, cov), change, dt)
    r0, t0, prior = predicted.rotation, predicted.translation, predicted.cov[:6, :6].copy()
    best, rival, out = _room(markers), _room(markers), np.zeros(NUMBERS)
    out[LEAD], f = math.inf, camera[0]
    distance2 = t0[0] ** 2 + t0[1] ** 2 + t0[2] ** 2
    innovation, measured, known, spread = np.empty(6), np.eye(6), np.empty(6), np.eye(6)
    if not math.isfinite(spot_cov.sum()):
        out[OUTCOME] = NOT_FINITE
    elif len(index) < MIN_COUNT:
        out[OUTCOME], out[COUNT] = TOO_FEW, len(index)
    elif max(prior[0, 0], prior[1, 1], prior[2, 2]) < UNSURE_RAD**2 and prior[5, 5] < UNSURE_SCALE**2 * distance2:
        out[OUTCOME] = LOST
        spots, columns, tolerance = spots_of(camera, size, p, plane_cov, radius, least_density, rough)
        out[TOLERANCE] = tolerance = given_tolerance if given_tolerance > 0.0 else tolerance
        fit = Fit(tolerance, f, 0.0)
        if _label(markers, near, spots, columns, f, tolerance, (r0, t0, prior), best, out):
            best.numbers[FOCAL] = f
            if settle_kernel(markers, spots, fit, best, TRUSTED) == STEADY:
                out[OUTCOME] = LABELLED
    if out[OUTCOME] == LABELLED:
        _weigh(markers, near, spots, xy, spot_cov, best, prior, t0, out)
        difference(best.rotation, best.translation, r0, t0, innovation)
        invert_factored(best.factor, measured)
        out[DISTANCE2] = distance2_of(innovation, prior, measured)
        worth = out[WORTH] - against(out[DISTANCE2])
        out[LEAD] = rival_kernel(
            markers, near, spots, columns, fit, (onto, turn, shift), (r0, t0, prior), best, worth, margin, rival
        )
        if accept_kernel(markers, spots, fit, best):
            invert_factored(best.factor, measured)
            difference(best.rotation, best.translation, r0, t0, innovation)
            out[EXCESS_PX] = math.sqrt(best.numbers[EXCESS])
        for k in range(6):
            known[k] = prior[k, k] + measured[k, k]
        spread = _of_model(measured, best.translation, scale)
        _compare(best, rival, out)
        change = adapted(change, expected_change, innovation, known, distance2, dt)
        predicted = update_kernel(predicted, innovation, measured)
    marker, spot, residual, distance = _pairs(markers, camera, xy, index, best)
    if len(distance):
        out[RMS_PX] = math.sqrt((distance**2).mean())
    return (
        out, best.rotation, _of_frame(best, centre, scale), spread, marker, spot, residual, distance, rival.rotation,
        _of_frame(rival, centre, scale), predicted.rotation, predicted.translation, predicted.velocity, predicted.cov,
        change,
    )  # fmt: skip


@nb.njit(cache=True, nogil=True)
def _room(markers: Markers) -> State:
    n = markers.xyz.shape[0]
    return State(
        np.eye(3), np.zeros(3), np.zeros(7), np.full(n, -1, np.int32), np.zeros((n, 2)), np.zeros((n, 3)),
        np.zeros((7, 7)),
    )  # fmt: skip


@nb.njit(cache=True, nogil=True)
def _compare(best: State, rival: State, out: Array) -> None:
    """Counts of the rival, and how the fit went."""
    for m in range(best.match.shape[0]):
        out[RIVAL_COUNT] += rival.match[m] >= 0
        out[RIVAL_SHARED] += rival.match[m] >= 0 and rival.match[m] == best.match[m]
    out[STEPS], out[FIRST_COST], out[LAST_COST] = (
        best.numbers[ITERATIONS], best.numbers[COST_START], best.numbers[COST_END]
    )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _pairs(
    markers: Markers, camera: Array, xy: Array, index: NDArray[np.int64], best: State
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, Array]:
    """Markers, spots, residuals in the image and their length."""
    count = 0
    for m in range(best.match.shape[0]):
        count += best.match[m] >= 0
    marker, spot = np.empty(count, np.int64), np.empty(count, np.int64)
    residual, distance = np.empty((count, 2)), np.empty(count)
    k = 0
    for m in range(best.match.shape[0]):
        s = best.match[m]
        if s < 0:
            continue
        x, y, z = to_camera(best.rotation, best.translation, markers.xyz[m, 0], markers.xyz[m, 1], markers.xyz[m, 2])
        u, v, _ = project_point(camera, x, y, z)
        marker[k], spot[k] = m, index[s]
        residual[k, 0], residual[k, 1] = u - xy[s, 0], v - xy[s, 1]
        distance[k] = math.hypot(residual[k, 0], residual[k, 1])
        k += 1
    return marker, spot, residual, distance


@nb.njit(cache=True, nogil=True)
def _of_frame(state: State, centre: Array, scale: float) -> Array:
    """Translation of the model's pose; see `Frame.pose`."""
    out = np.empty(3)
    for i in range(3):
        out[i] = scale * state.translation[i]
        for j in range(3):
            out[i] -= state.rotation[i, j] * centre[j]
    return out


@nb.njit(cache=True, nogil=True)
def _of_model(cov: Array, t: Array, scale: float) -> Array:
    """Covariance for ``exp(delta) @ pose`` of the model; see `Solution.change`."""
    change = np.eye(6)
    change[3, 1], change[3, 2], change[4, 2] = -scale * t[2], scale * t[1], -scale * t[0]
    change[4, 0], change[5, 0], change[5, 1] = scale * t[2], -scale * t[1], scale * t[0]
    for i in range(3, 6):
        change[i, i] = scale
    out, half = np.zeros((6, 6)), np.zeros((6, 6))
    for i in range(6):
        for j in range(6):
            for k in range(6):
                half[i, j] += change[i, k] * cov[k, j]
    for i in range(6):
        for j in range(6):
            for k in range(6):
                out[i, j] += half[i, k] * change[j, k]
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _label(
    markers: Markers, near: Ints, spots: Spots, columns: Columns, f: float, tolerance: float,
    predicted: tuple[Array, Array, Array], best: State, out: Array,
) -> bool:  # fmt: skip
    """First labels and pose, from the prediction's gates."""
    r, t, cov = best.rotation, best.translation, predicted[2].copy()
    r[:], t[:] = predicted[0], predicted[1]
    information = np.zeros((6, 6))
    factor = predicted[2].copy()
    if not cholesky(factor, 6, 1e-14):
        return False
    invert_factored(factor, information)
    floor2 = (0.25 * tolerance) ** 2
    sight = sight_from(markers, near, r, t, f, cov)
    if gates_overlap(sight, spots.size):
        out[SUPPOSED] = 1.0
        if supposed(markers, sight, spots, columns, f, r, t, cov, floor2) <= 0.0:
            return False
        sight = sight_from(markers, near, r, t, f, cov)
    for round_ in range(ROUNDS):
        if label_in_gates(sight, spots, columns, floor2, best.match) < 4:
            return False
        if round_ == ROUNDS - 1:
            break
        if not fit_with_prior(
            markers, spots, f, best.match, (predicted[0], predicted[1], information), floor2, r, t, cov
        ):
            return False
        sight = sight_from(markers, near, r, t, f, cov)
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _weigh(
    markers: Markers, near: Ints, spots: Spots, xy: Array, spot_cov: Array, best: State, prior: Array, t0: Array,
    out: Array,
) -> None:  # fmt: skip
    """Evidence and what the tests of acceptance need."""
    n, count = best.match.shape[0], 0
    residual, density, spacing = np.empty((n, 2)), np.empty(n), np.empty(n)
    for m in range(n):
        if best.match[m] < 0:
            continue
        residual[count], density[count] = best.residual[m], spots.density[best.match[m]]
        apart, o = 0.0, near[m, 0]
        for i in range(3):
            apart += (markers.xyz[m, i] - markers.xyz[o, i]) ** 2
        z = to_camera(best.rotation, best.translation, markers.xyz[m, 0], markers.xyz[m, 1], markers.xyz[m, 2])[2]
        spacing[count] = math.sqrt(apart) * best.numbers[FOCAL] / z
        count += 1
    sigma = np.empty(xy.shape[0])
    for s in range(xy.shape[0]):
        sigma[s] = math.sqrt(0.5 * (spot_cov[s, 0, 0] + spot_cov[s, 1, 1]))
    angle = max(ANGLE_LEAST, SIGMAS * math.sqrt(max(prior[0, 0], prior[1, 1], prior[2, 2])))
    angle = min(angle, math.pi)
    scale = max(SCALE_LEAST, SIGMAS * math.sqrt(prior[5, 5]) / max(t0[2], 1e-300))
    share = (angle - math.sin(angle)) / math.pi * min(1.0, math.log10(1.0 + scale))
    expected = int(best.numbers[EXPECTED])
    out[COUNT], out[SEEN], out[SHARE] = count, expected, share
    out[WORTH] = worth_of(spots, best)
    out[LOG10_NFA] = log10_nfa(residual[:count], density[:count], expected, n, xy.shape[0], FIXED, math.log(share))
    out[SPACING], out[SIGMA] = np.median(spacing[:count]), np.median(sigma)
    out[EXCESS_PX], out[MISFIT_PX] = math.sqrt(best.numbers[EXCESS]), math.sqrt(best.numbers[MISFIT])
