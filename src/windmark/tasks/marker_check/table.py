"""What the table of markers itself says, without any view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2, g3
from windmark.scene import MarkerSet
from windmark.tasks.marker_check.campaign import FEWEST_LEFT, Campaign
from windmark.tasks.marker_check.rivals import name_list
from windmark.tasks.marker_check.settings import azimuth_elevation_deg
from windmark.tasks.marker_check.stage import Stage

Array = NDArray[np.float64]

FEWEST = 8
TOO_CLOSE_RADII = 3.0
TOO_CLOSE_PX = 8.0
"""Centres nearer than this in a typical image: their discs, or the windows they are fitted in, touch."""
INWARD, CLEARLY = 0.9, 0.3
"""Part of the normals that point to the middle of the markers, of those that point clearly to or from it (by the cosine
of their angle), from which all are turned round: from a model's surface they point away, but for hollow parts."""
NEIGHBOURS, AGAINST, TYPICAL = 5, -0.3, 3.0
"""Nearest markers against all of whose normals a reversed one points (cosine); and how much worse than the table's
others, at the median, it may lie on their surface."""
FLAT, ON_LINE = 0.01, 1e-3
"""Thickness and width of a set of markers over its length."""


@dataclass(frozen=True)
class Finding:
    """Something about the table that the user should know.

    Parameters
    ----------
    kind : one word for machines
    text : in words
    markers : the names it is about; empty for the whole table
    """

    kind: str
    text: str
    markers: tuple[str, ...] = ()


def table_findings(stage: Stage, campaign: Campaign, never_seen: NDArray[np.bool_], scale_px: float) -> list[Finding]:
    """Plain checks, the gravest first.

    Parameters
    ----------
    stage, campaign : the check
    never_seen : (N,) markers in sight from no direction
    scale_px : pixels per length unit in a typical view
    """
    parts = (
        _too_few(stage), _inward(stage.markers), _reversed(stage.markers), _shape(stage.markers.xyz),
        _too_close(stage, scale_px), _never(stage, never_seen), _unknown(stage), _few_in_sight(stage, campaign),
    )  # fmt: skip
    return [finding for part in parts for finding in part]


def _too_few(stage: Stage) -> list[Finding]:
    n = len(stage.markers)
    if n >= FEWEST:
        return []
    return [Finding("few", f"{n} markers: too few to be told from chance; give at least {FEWEST}, better 20")]


def _inward(markers: MarkerSet) -> list[Finding]:
    """Normals that point into the model; those of walls, which surround the cameras, point to their middle."""
    known = np.isfinite(markers.normal).all(axis=1) & (markers.role != "wall")
    xyz, normal = markers.xyz[known], markers.normal[known]
    if len(xyz) < FEWEST:
        return []
    away = xyz - xyz.mean(axis=0)
    length = np.linalg.norm(away, axis=1)
    cosine = np.einsum("nk,nk->n", away, normal)[length > 0] / length[length > 0]
    clear = cosine[np.abs(cosine) > CLEARLY]
    if 2 * len(clear) < len(xyz) or (clear < 0).mean() < INWARD:
        return []
    count = int((clear < 0).sum())
    return [Finding("inward", f"{count} of {len(clear)} normals that point clearly to or from the middle of the markers"
                              " point to it: the normals of the table point into the model, or the markers are on"
                              " walls that surround the cameras")]  # fmt: skip


def _reversed(markers: MarkerSet) -> list[Finding]:
    """Single normals that are turned round among those of their neighbours, on whose surface the marker lies.

    Of two places on a smooth surface the way from one to the other is square to the sum of their normals, but for the
    third order of the way. Turned round, one normal makes it the difference. A marker on the other side of a thin part
    has such a normal, too, but it lies below that surface.
    """
    from scipy.spatial import cKDTree

    known = np.flatnonzero(np.isfinite(markers.normal).all(axis=1))
    if len(known) < max(FEWEST, NEIGHBOURS + 1):
        return []
    xyz, normal = markers.xyz[known], markers.normal[known]
    near = cKDTree(xyz).query(xyz, NEIGHBOURS + 1)[1][:, 1:]
    way = xyz[near] - xyz[:, None]
    way = way / np.maximum(np.linalg.norm(way, axis=2, keepdims=True), 1e-300)
    cosine = np.einsum("nk,njk->nj", normal, normal[near])
    sign = np.where(cosine < 0, -1.0, 1.0)[..., None]
    off = np.abs(np.einsum("njk,njk->nj", normal[near] + sign * normal[:, None], way))
    typical = float(np.median(off[cosine > 0])) if (cosine > 0).any() else 0.0
    wrong = (cosine < AGAINST).all(axis=1) & (np.median(off, axis=1) <= TYPICAL * max(typical, 1e-6))
    names = tuple(str(n) for n in markers.name[known[wrong]])
    if not names:
        return []
    point = "points" if len(names) == 1 else "point"
    return [Finding("reversed", f"the normal of {name_list(np.array(names))} {point} against those of all neighbours, "
                                "on whose surface it lies: turned round in the table?", names)]  # fmt: skip


def _shape(xyz: Array) -> list[Finding]:
    if len(xyz) < 3:
        return []
    size = np.linalg.svd(xyz - xyz.mean(axis=0), compute_uv=False)
    if size[1] < ON_LINE * size[0]:
        return [Finding("line", "all markers lie on one line: no pose can be found")]
    if size[2] < FLAT * size[0]:
        return [Finding("flat", f"all markers lie in a plane (thickness {g2(100 * size[2] / size[0])} % of the length):"
                                " frontal views do not determine the focal length, so it must be given, and from far"
                                " away a mirrored pose fits too")]  # fmt: skip
    return []


def _too_close(stage: Stage, scale_px: float) -> list[Finding]:
    from scipy.spatial import cKDTree

    if len(stage.markers) < 2:
        return []
    names, radius = stage.markers.name, np.nan_to_num(stage.markers.radius)
    limit = max(TOO_CLOSE_RADII * float(radius.max()), TOO_CLOSE_PX / scale_px)
    found = []
    for i, j in sorted(cKDTree(stage.markers.xyz).query_pairs(limit)):
        apart = float(np.linalg.norm(stage.markers.xyz[i] - stage.markers.xyz[j]))
        if (stage.markers.normal[i] * stage.markers.normal[j]).sum() < 0:
            continue  # on two sides of a wing, never side by side in an image
        if apart * scale_px >= TOO_CLOSE_PX and apart >= TOO_CLOSE_RADII * max(radius[i], radius[j]):
            continue
        what = "the same marker twice" if apart == 0 else "too close to be told apart"
        text = f"{names[i]} and {names[j]} are {g3(apart)} apart ({g2(apart * scale_px)} px in a typical image): {what}"
        found.append(Finding("close", text, (str(names[i]), str(names[j]))))
    return found


def _never(stage: Stage, never_seen: NDArray[np.bool_]) -> list[Finding]:
    names = stage.markers.name[never_seen]
    if not len(names):
        return []
    where = "anywhere" if stage.settings.everywhere else "the given region"
    return [Finding("unseen", f"in sight from no direction of {where}: {name_list(names)}", tuple(names.tolist()))]


def _unknown(stage: Stage) -> list[Finding]:
    found = []
    markers = stage.markers
    for kind, unknown, use in (
        ("normal", ~np.isfinite(markers.normal).all(axis=1),
         "they count as seen from everywhere, and a picture of one side can be taken for the other"),
        ("radius", ~np.isfinite(markers.radius), "the shift of a disc's image by perspective cannot be corrected"),
    ):  # fmt: skip
        names = markers.name[unknown]
        if len(names):
            who = "no marker has" if len(names) == len(markers) else f"{name_list(names)} {_have(len(names))} no"
            who = f"{who} a {kind}" if len(names) == len(markers) else f"{who} {kind}"
            found.append(Finding(f"no-{kind}", f"{who}: {use}", tuple(names.tolist())))
    return found


def _have(count: int) -> str:
    return "has" if count == 1 else "have"


def _few_in_sight(stage: Stage, campaign: Campaign) -> list[Finding]:
    left = campaign.in_sight * (1 - stage.settings.hidden_percent / 100)
    few = left < FEWEST_LEFT
    if stage.settings.everywhere or not few.any():
        return []
    worst = int(np.argmin(campaign.in_sight))
    azimuth, elevation = azimuth_elevation_deg(campaign.directions[worst])
    text = (
        f"from {100 * few.mean():.0f} % of the region fewer than {FEWEST_LEFT:.0f} markers are left when"
        f" {stage.settings.hidden_percent:g} % are hidden; the fewest, {campaign.in_sight[worst]}, are in sight from"
        f" azimuth {azimuth:.0f}, elevation {elevation:.0f} deg"
    )
    return [Finding("few-in-sight", text)]
