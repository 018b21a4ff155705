"""The incidence and the sideslip that pictures show, each of them, beside those that a table says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Deformation
from windmark.deformation.sighting import MOTION
from windmark.errors import DataError
from windmark.paint import LoadReference, enough
from windmark.pipeline.psp.entries import TableEntry
from windmark.pipeline.psp.pictures import Found
from windmark.pipeline.psp.stream import DIFFERS_DEG
from windmark.tasks.psp import BadPicture

Array = NDArray[np.float64]

NAMED = 6
"""Pictures of another incidence that are named."""
ANGLES = (("an incidence", "alpha_at_rest_deg"), ("a sideslip", "beta_at_rest_deg"))
"""What is compared, and the key that says it of the model at rest."""
SIDESLIP = "its pictures show a sideslip"
"""Begins what is said of one that no table says."""


def seen_angles(entry: TableEntry, states: tuple[Deformation, ...]) -> Array:
    """(S, 2) incidence and sideslip of each state in degrees, as `LoadReference` has them: those of the wind in the
    model's axes, as markers and grid have these at rest.
    """
    rest = LoadReference(1.0, 1.0, 1.0, alpha_deg=entry.alpha_at_rest_deg, beta_deg=entry.beta_at_rest_deg)
    wind = np.array([s.tunnel_from_model.rotation.T @ rest.wind_axes()[0] for s in states])
    return np.degrees(np.column_stack(
        [np.arctan2(wind[:, 2], wind[:, 0]), -np.arcsin(np.clip(wind[:, 1], -1, 1))]
    ))  # fmt: skip


def at_incidence(
    entry: TableEntry, alpha_deg: float, found: Found, table: str = "table of points", *, beta_deg: float = np.nan
) -> tuple[Found, tuple[float, float]]:
    """The pictures that show the incidence and the sideslip of a table, and the ones that they show; the others become
    bad pictures. ``beta_deg`` NaN: the table says none, and none is compared, see `unsaid_sideslip`.

    Raises
    ------
    DataError
        Where fewer than half of them do. Where the laws do not explain what the markers show that is said too: a bent
        wing that may not bend looks turned.
    """
    seen, says = seen_angles(entry, found.states), np.array([alpha_deg, beta_deg])
    off = np.abs(seen - says) > entry.max_alpha_error_deg
    other = off.any(axis=1)
    if not other.any():
        return found, (float(seen[0, 0]), float(seen[0, 1]))
    k, which = int(np.flatnonzero(other)[0]), off.argmax(axis=1)
    what, key = ANGLES[which[k]]
    shown = seen[np.arange(len(seen)), which]
    if not enough(int((~other).sum()), len(other)):
        also = next(iter(found.troubles.values()), "")
        some = "" if other.all() else f"{int(other.sum())} of {len(other)} of "
        sign = "its sign is the other one (wind from starboard is positive), " if _turned(entry, seen[k], says) else ""
        raise DataError(
            f"{some}its pictures show {what} of {shown[k]:z.2f} degrees, the {table} says {says[which[k]]:g}: "
            f"{sign}rows and pictures were exchanged, points.{key} is not that of markers and grid, or "
            "the cameras' poses are of another test"
            + (f"; and the markers say: {also}" if also else "")
        )
    lost = [(p, at) for p, at in zip(found.pictures, found.instants, strict=True) if other[at]]
    bad = [BadPicture(p.name, p.camera, f"it shows {ANGLES[which[at]][0]} of {shown[at]:z.2f} degrees, the {table} "
                      f"says {says[which[at]]:g}: it is of another point") for p, at in lost]  # fmt: skip
    words = (f"{len(bad)} of {len(found.pictures)} pictures show another {what.split()[1]} ({shown[k]:z.2f} degrees) "
             f"than the {table} says ({says[which[k]]:g}) and do not count: "
             f"{listed([p.name for p in bad])}")  # fmt: skip
    first = seen[~other][0]
    return _only(found, ~other, bad, words), (float(first[0]), float(first[1]))


def _turned(entry: TableEntry, seen: Array, says: Array) -> bool:
    """Whether a table's sideslip is what pictures show but for its sign."""
    near = np.abs(seen - says * [1, -1]) <= entry.max_alpha_error_deg
    return bool(near.all() and abs(seen[1] - says[1]) > entry.max_alpha_error_deg)


def unsaid_sideslip(entry: TableEntry, beta_deg: float, seen_deg: float) -> list[str]:
    """What is to be said of a point whose pictures show a sideslip, and whose row says none: loads take it as 0."""
    if np.isfinite(beta_deg) or abs(seen_deg) <= entry.max_alpha_error_deg:
        return []
    return [f"{SIDESLIP} of {seen_deg:z.2f} degrees, of which the table of points says nothing: loads along and across "
            "the wind take it as 0"]  # fmt: skip


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
    apart = float(seen_angles(entry, states)[:, 0].mean()) - alpha_deg
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
    """The pictures of a kind whose angles no table says, with what is to be said where they show several."""
    every = seen_angles(entry, found.states)
    for (what, _), seen in zip(ANGLES, every.T, strict=True):
        low, high = int(seen.argmin()), int(seen.argmax())
        if seen[high] - seen[low] > 2 * entry.max_alpha_error_deg:
            names = [_first_at(found, k) for k in (low, high)]
            words = (f"{kind} pictures are of several states: the {what.split()[1]} is {seen[low]:z.2f} degrees in "
                     f"{names[0]} and {seen[high]:z.2f} in {names[1]}")  # fmt: skip
            return replace(found, several=(*found.several, words))
    return found


def _first_at(found: Found, state: int) -> str:
    return next(p.name for p, at in zip(found.pictures, found.instants, strict=True) if at == state)


def listed(names: list[str]) -> str:
    """Names of pictures, the first of many."""
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"{', '.join(names[:NAMED])}{more}"
