"""The pose of a model that may be bent: that of its root, wherever that is, with a sigma that covers.

A picture of a bent model says nothing of its pose unless something of it stands still. What the user calls a wall does.
Otherwise any part of the model may be its root, and each has a pose of its own: the rigid motion that goes on from
there as the deformation does. The pose that is given is the mean of these; its covariance has how far they are apart,
what the deformation may be that the picture cannot tell from a motion, and the noise.

The deformation is a Gaussian process (`search.field`). How large it is, how far it reaches, how stiff the model is
along its wide sides, and how much the spots are worse than they say are not known either: all are weighed by their
marginal likelihood with a flat prior of the pose (Rasmussen and Williams 2006, sections 2.7 and 5.4.1). A bent model is
first brought to where the likeliest of them has it, since all of this is to first order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.order import median
from windmark.registration import rules
from windmark.registration.search.field import STIFF, SUPPLE, Field
from windmark.registration.settle._kernels.doubt import doubt_kernel
from windmark.registration.settle._kernels.settle import fit_kernel
from windmark.registration.settle._kernels.state import EXCESS
from windmark.registration.settle.settling import copied
from windmark.registration.settle.solution import Solution

Array = NDArray[np.float64]

AMPLITUDES = np.geomspace(1e-4, 0.05, 16)
"""1 sigma of the displacements along the thinnest axis, as parts of the model's size."""
ROUNDS = 2
"""So often the likeliest deformation is asked for again where the last one was: then it rests."""
STIFFNESSES = (STIFF, SUPPLE, 1.0)
"""Least amplitudes along wide axes, as parts of that along the thinnest one."""
NOISES = np.linspace(0.0, 1.0, 6)[:, None]
"""Variances of the residuals that are tried: from those of the spots (0) to those with all of the excess, by their
logarithm."""


@dataclass(frozen=True, eq=False)
class Root:
    """The root's pose, and what else is unknown but the deformation.

    Parameters
    ----------
    evidence : logarithm of the marginal likelihood of what it was found by
    shift : (P,) the mean, from the pose and the nuisances of the solution
    cov : (P, P) covariance about it
    """

    evidence: float
    shift: Array
    cov: Array


@dataclass(frozen=True, eq=False)
class Bent:
    """What one field says, of S stiffnesses; the roots are looked at once, for all of them together.

    Parameters
    ----------
    evidence : (S,)
    amplitude : (S, K) of the coefficients' prior that is likeliest with each
    noise : (S,) mean variance of the residuals that each finds
    mean, second : (S, K) and (S, K, K) moments of the coefficients
    start, inverse : (P,) and (P, P) pose and nuisances without a deformation, and their covariance
    by : (P, K) how the mean pose of all roots and the nuisances go with the coefficients
    motions : (R, 6, K) `Field.motions` of the roots
    turn : (6, 6) from a motion in the model to one in the rig
    """

    evidence: Array
    amplitude: Array
    noise: Array
    mean: Array
    second: Array
    start: Array
    inverse: Array
    by: Array
    motions: Array
    turn: Array

    def moments(self, weight: Array) -> tuple[Array, Array]:
        """First two moments (P,), (P, P) of pose and nuisances, of all stiffnesses and roots; ``weight`` is (S,)."""
        middle, second = self.by @ (weight @ self.mean), np.tensordot(weight, self.second, 1)
        spread = self.by @ second @ self.by.T
        # How far the roots' poses are apart: as they are in the model, then turned.
        mean = self.motions.sum(axis=0) / len(self.motions)
        along = (self.motions.reshape(-1, len(second)) @ second).reshape(self.motions.shape)
        apart = np.tensordot(along, self.motions, ((0, 2), (0, 2))) / len(self.motions) - mean @ second @ mean.T
        spread[:6, :6] += self.turn @ apart @ self.turn.T
        both = np.outer(self.start, middle)
        whole = weight.sum() * np.outer(self.start, self.start) + float(weight @ self.noise) * self.inverse
        return weight.sum() * self.start + middle, whole + both + both.T + spread


def root_of(best: Solution, bends: float = 0.0) -> Root:
    """The root's pose by all fields together; those of a rigid solution are weighed beside none. Of walls alone it is
    that of a rigid model.

    ``bends`` is the evidence (nats) of other pictures that the model bends.
    """
    layout = best.views.layout
    fields = [field for field in (layout.fine_fields if best.is_bent else layout.fields) if len(field.modes)]
    if not fields:  # markers on walls alone
        return _by_none(best)
    found = [_by_field(best, field) for field in fields]
    worth = np.concatenate([bent.evidence for bent in found])
    worth = worth - math.log(len(worth))
    if not best.is_bent:
        none = _by_none(best)
        worth = np.append(worth, none.evidence + rules.BENT_LEAD - bends)
    weight, evidence = _weights(worth)
    each = len(STIFFNESSES)
    moments = [bent.moments(weight[k * each : (k + 1) * each]) for k, bent in enumerate(found)]
    shift = np.sum([first for first, _ in moments], axis=0)
    second = np.sum([second for _, second in moments], axis=0)
    if not best.is_bent:
        second = second + weight[-1] * none.cov
    return Root(evidence, shift, second - np.outer(shift, shift))


def likeliest(best: Solution) -> Solution:
    """A bent solution with the deformation that is the likeliest by its own evidence, its labels as they are.

    Labels are found with a deformation of a fixed prior. Where the picture leaves open what is pose and what is
    bending, that one may be some degrees away from what the residuals speak for, too far for the normal equations.
    """
    for _ in range(ROUNDS):
        found = [(bent, field) for field in best.views.layout.fine_fields for bent in [_by_field(best, field)]]
        bent, field = max(found, key=lambda one: one[0].evidence.max())
        views = best.views.bent(bent.amplitude[bent.evidence.argmax(), :, None, None] * field.modes)
        state = copied(views, best.state)
        state.bent[:] = 0.0
        if not fit_kernel(views.sights, state):
            break
        best = Solution(views, state)
    return best


def _by_none(best: Solution) -> Root:
    """Of a rigid model."""
    matched = best.state.match >= 0
    noise = _noises(best, matched)[:, 0]
    count = 2 * int(matched.sum()) - 6
    weight, evidence = _weights(-0.5 * (_square_of(best, matched) / noise + count * np.log(noise)))
    return Root(evidence - math.log(weight.size), np.zeros(len(best.unit_cov)), float(weight @ noise) * best.unit_cov)


def _by_field(best: Solution, field: Field) -> Bent:
    """By one field, of every stiffness."""
    state, size, matched = best.state, best.views.layout.size, np.asarray(best.state.match >= 0)
    views = best.views.bent(np.concatenate([field.modes, best.displacement[None]]))
    bare = copied(views, state)
    bare.bent[:] = 0.0
    normal, side = doubt_kernel(views.sights._replace(xyz=views.sights.xyz + best.displacement), bare)
    # The solution's nuisances and deformation, which is the last column, are in the data again.
    bends = len(side) - len(bare.bent)
    have = np.zeros(len(side))
    have[6:bends], have[-1] = state.nuisance.ravel(), 1.0
    square = _square_of(best, matched) + 2 * side @ have + have @ normal @ have
    side = side + normal @ have
    # The pose, which has no prior, and the nuisances are eliminated.
    inverse = np.linalg.inv(normal[:bends, :bends] + np.diag((np.arange(bends) >= 6).astype(float)))
    across = normal[:bends, bends:-1]
    taken, start = inverse @ across, inverse @ side[:bends]
    gram, pull = normal[bends:-1, bends:-1] - across.T @ taken, side[bends:-1] - across.T @ start
    noise, rest, count = _noises(best, matched), square - side[:bends] @ start, 2 * int(matched.sum()) - 6
    found = [_by_amplitude(gram, pull, size * field.amplitude(stiff), noise, rest, count) for stiff in STIFFNESSES]
    evidence, likely, noises, mean, second = (np.array(part) for part in zip(*found, strict=True))
    motions = field.motions[may_be_root(field, np.asarray(matched.any(axis=0)))]
    by, turn = -taken, np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = state.rotation
    by[:6] += turn @ motions.sum(axis=0) / len(motions)
    return Bent(evidence, likely, noises, mean, second, start - have[:bends], inverse, by, motions, turn)


def _by_amplitude(
    gram: Array, pull: Array, amplitude: Array, noise: Array, rest: float, count: int
) -> tuple[float, Array, float, Array, Array]:
    """Evidence, likeliest prior, mean noise, and the moments of the coefficients (K,), from the reduced normal
    equations of a field.

    ``rest`` and ``count`` are as in `_weighed`.
    """
    value, vector = np.linalg.eigh(gram * np.outer(amplitude, amplitude))
    along = vector.T @ (amplitude * pull)
    weight, evidence, mean, second = _weighed(np.maximum(value, 0.0), along, noise, rest, count)
    by, of_noise = amplitude[:, None] * vector, weight.sum(axis=1)
    likely = AMPLITUDES[weight.sum(axis=0).argmax()] * amplitude
    return evidence, likely, float(of_noise @ noise[:, 0]), by @ mean, by @ second @ by.T


def may_be_root(field: Field, matched: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Matched markers that may be the root: walls if there are any."""
    walls = matched & (field.modes == 0.0).all(axis=(0, 2))
    return np.flatnonzero(walls if walls.any() else matched)


def _weighed(
    value: Array, along: Array, noise: Array, rest: float, count: int
) -> tuple[Array, float, Array, Array]:  # fmt: skip
    """Weights (S, A) of noises and amplitudes, evidence, and the first two moments of the coefficients over both.

    ``value`` and ``along`` (K,) are the eigenvalues of the reduced normal equations and their right side, ``rest`` the
    sum of squares without a deformation, ``count`` the coordinates that are left.
    """
    prior = AMPLITUDES[:, None] ** 2
    spread = prior / (noise[:, :, None] + prior * value)  # posterior variances are this times the noise
    mean = spread * along
    cost = np.log1p(prior * value / noise[:, :, None]).sum(axis=2) + count * np.log(noise)
    weight, evidence = _weights(-0.5 * (cost + (rest - mean @ along) / noise))
    flat = mean.reshape(-1, len(value))
    second = (flat.T * weight.ravel()) @ flat
    second += np.diag((weight * noise).ravel() @ spread.reshape(flat.shape))
    return weight, evidence - math.log(weight.size), weight.ravel() @ flat, second


def _weights(log: Array) -> tuple[Array, float]:
    """Weights by their logarithms, and the logarithm of their sum."""
    most = float(log.max())
    weight = np.exp(log - most)
    total = float(weight.sum())
    return weight / total, most + math.log(total)


def _square_of(best: Solution, matched: NDArray[np.bool_]) -> float:
    """Sum of the squared residuals by their covariance."""
    r, (xx, xy, yy) = best.state.residual[matched], best.state.spread[matched].T
    return float(((yy * r[:, 0] ** 2 - 2 * xy * r[:, 0] * r[:, 1] + xx * r[:, 1] ** 2) / (xx * yy - xy * xy)).sum())


def _noises(best: Solution, matched: NDArray[np.bool_]) -> Array:
    """(S, 1) the residuals' variances that are tried, as parts of those that the solution has."""
    excess = np.broadcast_to(best.state.numbers[:, EXCESS, None], matched.shape)[matched]
    variance = 0.5 * (best.state.spread[matched][:, 0] + best.state.spread[matched][:, 2])
    least = median(1.0 - excess / variance)
    return np.asarray(max(least, 1e-6) ** (1.0 - NOISES))
