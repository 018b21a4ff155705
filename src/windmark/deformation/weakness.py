"""What a set-up sees least, in words: with one camera the motion along its line of sight, and what looks like it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.deformation.result import Deformation
from windmark.deformation.sighting import LAW, MOTION
from windmark.errors import g2
from windmark.geometry.rotations import hat

Array = NDArray[np.float64]

RATIO = 3.0
"""A direction is weak when its sigma is so many times that of the best one across it."""
CORRELATED = 0.98
"""Two parameters of different kind with a larger correlation are hardly told apart."""


def weak_directions(state: Deformation, centre: ArrayLike, *, unit: str = "", least: float = 0.0) -> tuple[str, ...]:
    """What is known least of an identified state by its set-up; what laws lack or a camera is late may hide more.

    Parameters
    ----------
    state : the state
    centre : (3,) point of the model whose shift is judged, in its frame; usually the markers' centre
    unit : length unit, for the words
    least : what 1 sigma of a direction moves the model's farthest marker by; smaller ones are not named

    Returns
    -------
    tuple of str
        Sentences; empty where all directions are about equally well known and nothing is mistaken for something else.
    """
    if MOTION not in state.slices:
        return ()
    place = state.tunnel_from_model.apply(np.asarray(centre, dtype=float))
    own = state.cov_of_set_up[state.slices[MOTION], state.slices[MOTION]]
    shift = np.concatenate([-hat(place), np.eye(3)], axis=1)
    reach = float(np.linalg.norm(state.placed.xyz - np.asarray(centre, dtype=float), axis=1).max(initial=0.0))
    out = []
    for name, cov, scale, of in (
        ("shift", shift @ own @ shift.T, 1.0, unit), ("turn", own[:3, :3], np.degrees(1.0), "deg")
    ):  # fmt: skip
        value, axis = np.linalg.eigh(cov)
        sigma = scale * np.sqrt(np.maximum(value, 0.0))
        moves = np.sqrt(max(float(value[2]), 0.0)) * (1.0 if name == "shift" else reach)
        if sigma[2] > RATIO * sigma[0] and moves >= least:
            along = axis[:, 2] * np.sign(axis[np.argmax(np.abs(axis[:, 2])), 2])
            preposition = "along" if name == "shift" else "about"
            direction = ", ".join(f"{v:.2f}" for v in along + 0.0)
            out.append(
                f"the model's {name} {preposition} ({direction}) is known to {g2(sigma[2])} {of}".rstrip()
                + f" only, {sigma[2] / sigma[0]:.0f} times less well than across it"
            )
    return (*out, *_mistaken(state, least))


def _mistaken(state: Deformation, least: float) -> list[str]:
    """Law parameters that hardly differ from a direction of the rigid motion."""
    if LAW not in state.slices:
        return []
    law, motion = state.slices[LAW], state.slices[MOTION]
    cov = state.cov_of_set_up
    half = np.linalg.cholesky(cov[motion, motion])
    # The largest correlation with any direction of the motion: multiple correlation.
    part = np.linalg.solve(half, cov[motion, law])
    multiple = np.sqrt((part**2).sum(axis=0) / np.diag(cov[law, law]))
    moves = np.sqrt(np.diag(cov[law, law])) * state.placed.rates
    return [
        f"{name} is hardly told from a rigid motion (correlation {r:.3f})"
        for name, r, by in zip(state.volumes.names, multiple, moves, strict=True)
        if r > CORRELATED and by >= least
    ]
