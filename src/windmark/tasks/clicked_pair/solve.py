"""Two pictures and a few matches made by hand: their geometry, and what it says of the clicks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera
from windmark.geometry.two_view import epipoles
from windmark.scene import Detections
from windmark.tasks.clicked_pair.clicks import SNAP_PX, Clicks, snapped
from windmark.tasks.clicked_pair.geometry import Geometry, Job
from windmark.tasks.clicked_pair.interior import PoseFit, share, unknown_words
from windmark.tasks.clicked_pair.result import ClickedPair

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

GATE = 4.0
"""A click so many sigmas off its line is wrong; and an error that would be so many sigmas off shows."""
LEVERAGE = 2.0
"""A click that the others predict with a sigma so many times its own is checked by them: what may stay unseen then
moves the geometry by less than root(LEVERAGE^2 - 1) times what it shows."""
DOUBT = 3.0
"""A click so many sigmas off what the others say is not checked by them either."""
ROUNDS = 3
ALIKE = 0.8
"""Part of the matches that the error which they show must leave."""


def clicked_pair(
    spots_a: Detections, spots_b: Detections, clicks: Clicks, cameras: tuple[Camera, Camera] | None, *,
    sigma_px: float | None = None, seed: int = 0,
) -> ClickedPair:  # fmt: skip
    """Epipolar geometry from a few matches; with cameras then all spots along the lines (AIAA 2005-5007, VI.A-D).

    A click means the nearest spot; two clicks on one spot are refused. With ``cameras`` the essential matrix is found
    from seven matches or more, also of points on a plane; without, the fundamental matrix from eight, and no further
    matches: nothing but depths tells which of the spots on a line is meant, and they need a camera. Clicks that
    contradict the others or, with cameras, what the neighbours' depths say, are named and left out. Clicks that the
    others do not check are named and stay.

    Raises
    ------
    ValueError
        For two clicks that mean one spot.
    """
    meant_a = snapped(spots_a, clicks.xy_a, clicks.name, "first")
    meant_b = snapped(spots_b, clicks.xy_b, clicks.name, "second")
    on_spots = (meant_a >= 0) & (meant_b >= 0)
    notes = [f"click {n}: no spot within {SNAP_PX:g} px; left out" for n, good in
             zip(clicks.name, on_spots, strict=True) if not good]  # fmt: skip
    xy_a, xy_b = (np.where(on_spots[:, None], s.xy[np.maximum(m, 0)] if len(s) else c, c)
                  for s, m, c in ((spots_a, meant_a, clicks.xy_a), (spots_b, meant_b, clicks.xy_b)))  # fmt: skip
    job = Job(spots_a, spots_b, cameras, sigma_px, seed)
    use = np.flatnonzero(on_spots)
    first, second = meant_a[use], meant_b[use]
    found: Found | str
    if cameras is None:
        found = _alone(job, first, second)
    else:
        job, found = _as_learned(job, first, second)
    if isinstance(found, str):
        return ClickedPair(reason=found, notes=tuple(notes), click_a=xy_a, click_b=xy_b)
    geometry, wrong, spot_a, spot_b = found
    gone = ~on_spots
    gone[use[wrong]] = True
    click = _clicks_of(meant_a, meant_b, gone, spot_a, spot_b)
    order = np.lexsort((spot_a, click < 0))
    spot_a, spot_b, click = spot_a[order], spot_b[order], click[order]
    shows_px, unchecked, said = _checked(job, geometry, spot_a, spot_b, click, clicks.name)
    click_px = np.full(len(on_spots), np.nan)
    click_px[use] = job.distance(geometry, first, second)
    pose_cov = geometry.pose_cov
    if cameras is not None and geometry.pose is not None and pose_cov is not None:
        fit = PoseFit(spots_a.xy[spot_a], spots_b.xy[spot_b], cameras, geometry.pose)
        pose_cov = pose_cov + share(fit)
        said = (*said, *filter(None, [unknown_words(fit)]))
    with np.errstate(divide="ignore", invalid="ignore"):
        end_a, end_b = (e[:2] / e[2] for e in epipoles(geometry.matrix))
    return ClickedPair(
        geometry.matrix, end_a, end_b, geometry.pose, pose_cov, geometry.estimate, xy_a, xy_b, click_px, gone,
        unchecked, shows_px, spot_a, spot_b, click, job.distance(geometry, spot_a, spot_b), geometry.sigma0,
        (*notes, *geometry.notes, *said),
    )  # fmt: skip


Found = tuple[Geometry, Mask, Ints, Ints]
"""The geometry, which clicks are wrong, and the spots of all matches."""


def _alone(job: Job, first: Ints, second: Ints) -> Found | str:
    """Without a camera: the matches are the clicks that agree."""
    geometry = job.geometry(first, second)
    if isinstance(geometry, str):
        return geometry
    return geometry, ~geometry.used, first[geometry.used], second[geometry.used]


def _as_learned(job: Job, first: Ints, second: Ints) -> tuple[Job, Found | str]:
    """`_along_lines`, once more with the error that its matches show where that is less than was taken beforehand."""
    found = _along_lines(job, first, second)
    if isinstance(found, str):
        return job, found
    finer = job.learned(found[0], *found[2:])
    if not finer.model_px < job.model_px:
        return job, found
    again = _along_lines(finer, first, second)
    # An error that is not the same everywhere: by what most matches show, many others would be wrong.
    if isinstance(again, str) or len(again[2]) < ALIKE * len(found[2]):
        return job, found
    return finer, again


def _along_lines(job: Job, first: Ints, second: Ints) -> Found | str:
    """With cameras: geometry and matches in turn, until the matches stay."""
    geometry = job.geometry(first, second, by_hand=True)
    if isinstance(geometry, str):
        return geometry
    wrong, kept = ~geometry.used, (first[:0], second[:0])
    for _ in range(ROUNDS):
        right = np.flatnonzero(~wrong)
        spot_a, spot_b, contradicted = job.matched(geometry, (first[right], second[right]), kept)
        wrong[right[contradicted]] = True
        again = job.geometry(spot_a, spot_b)
        if isinstance(again, str):
            return again
        geometry = again
        wrong |= np.isin(first, spot_a[~again.used])
        before, kept = kept, (spot_a[again.used], spot_b[again.used])
        if len(before[0]) == len(kept[0]) and (np.sort(before[0]) == np.sort(kept[0])).all():
            break
    found = geometry, *_settled(job, geometry, (first, second), *kept)
    if 2 * (gone := int(found[1].sum())) > len(first):
        return (f"{gone} of {len(first)} clicks contradict the others or what the spots beside them "
                "say; which of them are right is not to be told, look at each")  # fmt: skip
    return found


def _clicks_of(meant_a: Ints, meant_b: Ints, gone: Mask, spot_a: Ints, spot_b: Ints) -> Ints:
    """The click (K,) of each match, -1 where it is none's."""
    of = {(int(meant_a[k]), int(meant_b[k])): int(k) for k in np.flatnonzero(~gone)}
    return np.array([of.get(pair, -1) for pair in zip(spot_a.tolist(), spot_b.tolist(), strict=True)], np.int64)


def _checked(
    job: Job, geometry: Geometry, spot_a: Ints, spot_b: Ints, click: Ints, names: Sequence[str]
) -> tuple[Array, Mask, tuple[str, ...]]:
    """Of every click (N,): the smallest error that would show, whether it is unchecked; and what to say of it."""
    shows, unchecked = np.full(len(names), np.nan), np.zeros(len(names), bool)
    by_hand = np.flatnonzero(click >= 0)
    said = job.by_others(geometry, spot_a, spot_b, by_hand)
    who = click[by_hand]
    shows[who] = GATE * said.sigma_px
    hangs = (shows[who] > SNAP_PX) | (said.sigma_px > LEVERAGE * said.own_px)
    with np.errstate(invalid="ignore"):
        off = ~hangs & (np.abs(said.distance_px) > DOUBT * said.sigma_px)
    unchecked[who] = hangs | off
    notes = []
    if hangs.any():
        more = "match more markers" + ("" if hangs.all() else " near them")
        if job.cameras is None:
            more += ", or give the camera"
            if np.isfinite(said.sigma_px[hangs]).all():
                more += ", or a smaller --sigma-px if the lens distorts so little"
        every = "all clicks" if hangs.all() else f"clicks {_listed(names, who[hangs])}"
        notes.append(f"unchecked, {every}: the geometry hangs on them, and a wrong one would not show; {more}")
    notes += [f"unchecked, click {names[k]}: {abs(d):.1f} px from where the others expect it, {abs(d) / s:.1f} sigma; "
              "look at it" for k, d, s in zip(who[off].tolist(), said.distance_px[off], said.sigma_px[off],
                                              strict=True)]  # fmt: skip
    return shows, unchecked, tuple(notes)


def _listed(names: Sequence[str], rows: Ints) -> str:
    return ", ".join(names[k] for k in np.sort(rows).tolist())


def _settled(
    job: Job, geometry: Geometry, clicks: tuple[Ints, Ints], spot_a: Ints, spot_b: Ints
) -> tuple[Mask, Ints, Ints]:
    """Which clicks the final geometry or the final matches contradict, and all matches with the other clicks."""
    match, back = (dict(zip(*(s.tolist() for s in p), strict=True)) for p in ((spot_a, spot_b), (spot_b, spot_a)))
    off = np.abs(job.distance(geometry, *clicks))
    usual = float(np.sqrt((job.distance(geometry, spot_a, spot_b) ** 2).mean()))
    limit = GATE * max(usual, job.sigma_px or job.model_px)
    wrong = np.zeros(len(off), bool)
    for k, (i, j) in enumerate(zip(*(c.tolist() for c in clicks), strict=True)):
        if match.get(i) == j:
            continue
        wrong[k] = i in match or j in back or bool(off[k] > limit)
        if not wrong[k]:
            match[i], back[j] = j, i
    pairs = np.array(list(match.items()), dtype=np.int64).reshape(-1, 2)
    return wrong, pairs[:, 0], pairs[:, 1]
