"""The incidence that pictures show, each of them, beside the one that a table says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Deformation
from windmark.deformation.sighting import MOTION
from windmark.errors import DataError
from windmark.paint import enough
from windmark.pipeline.psp.entries import TableEntry
from windmark.pipeline.psp.pictures import Found
from windmark.pipeline.psp.stream import DIFFERS_DEG
from windmark.tasks.psp import BadPicture

Array = NDArray[np.float64]

NAMED = 6
"""Pictures of another incidence that are named."""


def incidences(entry: TableEntry, states: tuple[Deformation, ...]) -> Array:
    """(S,) degrees, of each state."""
    pitch = [np.degrees(np.arcsin(s.tunnel_from_model.rotation[0, 2])) for s in states]
    return np.array([entry.alpha_at_rest_deg + float(p) for p in pitch])


def at_incidence(
    entry: TableEntry, alpha_deg: float, found: Found, table: str = "table of points"
) -> tuple[Found, float]:
    """The pictures that show the incidence of a table, and the one that they show; the others become bad pictures.

    Raises
    ------
    DataError
        Where fewer than half of them do. Where the laws do not explain what the markers show that is said too: a bent
        wing that may not bend looks turned.
    """
    seen = incidences(entry, found.states)
    other = np.abs(seen - alpha_deg) > entry.max_alpha_error_deg
    if not other.any():
        return found, float(seen[0])
    k = int(np.flatnonzero(other)[0])
    if not enough(int((~other).sum()), len(other)):
        also = next(iter(found.troubles.values()), "")
        some = "" if other.all() else f"{int(other.sum())} of {len(other)} of "
        raise DataError(
            f"{some}its pictures show an incidence of {seen[k]:.2f} degrees, the {table} says {alpha_deg:g}: rows "
            "and pictures were exchanged, points.alpha_at_rest_deg is not that of markers and grid, or "
            "the cameras' poses are of another test"
            + (f"; and the markers say: {also}" if also else "")
        )
    lost = [(p, float(seen[at])) for p, at in zip(found.pictures, found.instants, strict=True) if other[at]]
    why = f"the {table} says {alpha_deg:g}: it is of another point"
    bad = [BadPicture(p.name, p.camera, f"it shows an incidence of {a:.2f} degrees, {why}") for p, a in lost]
    words = (f"{len(bad)} of {len(found.pictures)} pictures show another incidence ({seen[k]:.2f} degrees) than the "
             f"{table} says ({alpha_deg:g}) and do not count: {listed([p.name for p in bad])}")  # fmt: skip
    return _only(found, ~other, bad, words), float(seen[~other][0])


def _only(found: Found, good: NDArray[np.bool_], bad: list[BadPicture], words: str) -> Found:
    """What is left of the pictures with some of their states; names stay those of all."""
    kept = np.flatnonzero(good).tolist()
    pictures = [(p, kept.index(at)) for p, at in zip(found.pictures, found.instants, strict=True) if good[at]]
    return replace(
        found, pictures=tuple(p for p, _ in pictures), instants=tuple(at for _, at in pictures),
        states=tuple(found.states[k] for k in kept), rms_px=tuple(found.rms_px[k] for k in kept),
        followed=tuple(found.followed[k] for k in kept), bad=(*found.bad, *bad), several=(*found.several, words),
    )  # fmt: skip


def apart_deg(entry: TableEntry, alpha_deg: float, states: tuple[Deformation, ...]) -> float:
    """By how much the states' mean incidence differs from a table's (degrees); 0 where that is rounding, or within
    twice what the markers leave open of a state, which is not less for a mean: they share their table's errors.
    """
    apart = float(incidences(entry, states).mean()) - alpha_deg
    unsure = float(np.median([pitch_sigma_deg(s) for s in states]))
    return apart if abs(apart) > max(DIFFERS_DEG, 2 * unsure) else 0.0


def pitch_sigma_deg(state: Deformation) -> float:
    """Of the incidence that a state's rigid motion shows, in degrees; 0 where it is held."""
    if MOTION not in state.slices:
        return 0.0
    rotation = state.tunnel_from_model.rotation
    # The motion is perturbed as exp(delta) @ pose: how sin(pitch) = rotation[0, 2] changes with the turn.
    by_turn = np.array([0.0, rotation[2, 2], -rotation[1, 2]]) / np.sqrt(1 - rotation[0, 2] ** 2)
    cov = state.cov[state.slices[MOTION], state.slices[MOTION]][:3, :3]
    return float(np.degrees(np.sqrt(by_turn @ cov @ by_turn)))


def of_one_state(entry: TableEntry, found: Found, kind: str) -> Found:
    """The pictures of a kind whose incidence no table says, with what is to be said where they show several."""
    seen = incidences(entry, found.states)
    low, high = int(seen.argmin()), int(seen.argmax())
    if not seen[high] - seen[low] > 2 * entry.max_alpha_error_deg:
        return found
    names = [next(p.name for p, at in zip(found.pictures, found.instants, strict=True) if at == k) for k in (low, high)]
    words = (f"{kind} pictures are of several states: the incidence is {seen[low]:.2f} degrees in {names[0]} and "
             f"{seen[high]:.2f} in {names[1]}")  # fmt: skip
    return replace(found, several=(*found.several, words))


def listed(names: list[str]) -> str:
    """Names of pictures, the first of many."""
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"{', '.join(names[:NAMED])}{more}"
