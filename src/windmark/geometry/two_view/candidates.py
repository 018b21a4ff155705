"""The best rotation, plane and relative poses of a set of pairs: what `choose` chooses from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from windmark.errors import WindmarkError
from windmark.geometry.pose import Pose
from windmark.geometry.rotations import project_to_so3
from windmark.geometry.two_view.decompose import decompose_homography
from windmark.geometry.two_view.homography_refine import homography_errors, refine_rotation
from windmark.geometry.two_view.pairs import Pairs
from windmark.geometry.two_view.refine import STEPS
from windmark.geometry.two_view.search import (
    Candidate,
    best_few,
    essential_candidates,
    homography_candidates,
    optimised_homography,
    optimised_pose,
)

Array = NDArray[np.float64]

OUTSIDE = 0.0027  # probability that a right pair is outside the gate (3 sigma)
GATE_LINE = float(chdtri(1, OUTSIDE))  # sigma^2, distance to an epipolar line
GATE_POINT = float(chdtri(2, OUTSIDE))  # sigma^2, distance to a point
_WIDE = 9.0
_PLANE_TRIALS = 48


@dataclass(frozen=True)
class Candidates:
    """Local optima of each model; None or empty where the pairs are too few or nothing agrees."""

    rotation: Candidate[Array] | None
    plane: Candidate[Array] | None
    space: list[Candidate[Pose]]


def find_candidates(pairs: Pairs, rng: np.random.Generator, trials: int) -> Candidates:
    """Random search for poses, and for planes among the pairs that agree with one of them.

    A plane that all right pairs lie on agrees with a pose, too: few trials find it. Its poses are starts in turn.
    """
    space = essential_candidates(pairs, GATE_LINE, rng, trials) if len(pairs) >= 6 else []
    near = np.any([s.squares < GATE_LINE for s in space], axis=0) if space else np.ones(len(pairs), dtype=bool)
    planes = homography_candidates(pairs[near], GATE_POINT, rng, min(trials, _PLANE_TRIALS)) if near.sum() >= 4 else []
    settled = [optimised_homography(p.model, pairs, GATE_POINT, (_WIDE, 1.0, 1.0), STEPS) for p in planes]
    plane = next((p for p in settled if p is not None), None)
    if plane is None:
        return Candidates(None, None, space)
    if space:
        starts = [optimised_pose(p, pairs, GATE_LINE) for p in _poses_of_plane(plane, pairs)]
        space = best_few([*space, *(c for c in starts if c is not None)])
    return Candidates(_rotation(plane, pairs), plane, space)


def _poses_of_plane(plane: Candidate[Array], pairs: Pairs) -> list[Pose]:
    near = pairs[plane.squares < GATE_POINT]
    try:
        return [p.b_from_a for p in decompose_homography(plane.model, near.a, near.b)]
    except np.linalg.LinAlgError:
        return []
    except WindmarkError:
        return []


def _rotation(plane: Candidate[Array], pairs: Pairs) -> Candidate[Array] | None:
    """The rotation near a homography, refined on the pairs near it, then on those still nearer."""
    if np.linalg.det(plane.model) <= 0:
        return None
    near = plane.squares < _WIDE * GATE_POINT
    rotation = project_to_so3(plane.model)
    for width in (_WIDE, 1.0, 1.0):
        if near.sum() < 3:
            return None
        rotation = refine_rotation(rotation, pairs[near])[0]
        near = homography_errors(rotation, pairs) < width * GATE_POINT
    squares = homography_errors(rotation, pairs)
    return Candidate(rotation, squares, float(np.minimum(squares, GATE_POINT).sum()))
