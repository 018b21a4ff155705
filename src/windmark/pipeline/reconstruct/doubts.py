"""What a finished reconstruction says against itself: markers that are two places of one, primaries off their table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.geometry import Camera
from windmark.scene import Doubt, MarkerSet, Tracks, View

Mask = NDArray[np.bool_]

ALIKE_DEG = 20.0
"""Two pictures whose directions differ by less see the same side of a marker: what one shows the other should."""
NEIGHBOURS = 6
"""Nearest markers of each one that may be another place of it."""
LEAST_EXPECTED = 20
"""Expected spots from which the rate of those that are found is known."""
LEAST_OFTEN = 3
"""Pictures that should show a marker whose own rate is asked."""
CHANCE = 1e-3
"""How often, in a whole reconstruction, chance may look like a doubt."""


@dataclass(frozen=True)
class Sight:
    """Which picture shows which marker, and which should.

    Parameters
    ----------
    seen, inside : (V, N) the marker has a spot in the picture; its place is within the picture
    alike : (V, V) pictures from nearly one direction
    rate : part of the expected spots that is found, of a marker in the middle (one that moved is found half as often);
        NaN where too few are expected
    """

    seen: Mask
    inside: Mask
    alike: Mask
    rate: float

    @classmethod
    def of(cls, markers: MarkerSet, tracks: Tracks, views: Sequence[View], cameras: Mapping[str, Camera]) -> Sight:
        """From a reconstruction; pictures without a pose show nothing."""
        seen = np.zeros((len(views), len(markers)), dtype=np.bool_)
        seen[tracks.view, tracks.track] = True
        inside, way = np.zeros_like(seen), np.zeros((len(views), 3))
        centre = markers.xyz.mean(axis=0)
        for v, view in enumerate(views):
            if view.cam_from_model is not None:
                inside[v] = in_field(markers.xyz, view, cameras)
                way[v] = view.cam_from_model.center - centre
        way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), np.finfo(float).tiny)
        alike = way @ way.T > np.cos(np.radians(ALIKE_DEG))
        others = alike & ~np.eye(len(views), dtype=np.bool_)
        expected = inside & (others.astype(int) @ seen.astype(int) > 0)
        often = expected.sum(axis=0) >= LEAST_OFTEN
        found = (seen & expected).sum(axis=0)[often] / expected.sum(axis=0)[often]
        enough = len(found) and expected.sum() >= LEAST_EXPECTED
        return cls(seen, inside, alike, float(np.median(found)) if enough else np.nan)


def in_field(xyz: NDArray[np.float64], view: View, cameras: Mapping[str, Camera]) -> Mask:
    """(N,) which places a view with a pose has within its picture."""
    assert view.cam_from_model is not None
    camera = cameras[view.camera]
    xy, valid = camera.project(view.cam_from_model.apply(xyz))
    return np.asarray(valid & camera.in_image(np.where(valid[:, None], xy, -9.0)))


def two_places(markers: MarkerSet, sight: Sight) -> list[Doubt]:
    """Neighbouring markers that are never in one picture, though pictures of one side show now one, now the other.

    Two markers that are each found at the rate r are seen one without the other in 2 r (1 - r) / (1 - (1 - r)^2) of the
    pictures that show either; in all n pictures that should show both, by chance, in the n-th power of that. Of many
    such pairs so many are named that few of them are chance (Benjamini and Hochberg, J. R. Stat. Soc. B 57, 1995).
    """
    n = len(markers)
    if n < 2 or not sight.rate > 0:
        return []
    alone = 2 * (1 - sight.rate) / (2 - sight.rate)
    _, near = cKDTree(markers.xyz).query(markers.xyz, min(NEIGHBOURS + 1, n))
    pairs = {(min(i, j), max(i, j)) for i, row in enumerate(near.tolist()) for j in row if i != j}
    odd: list[tuple[float, int, int]] = []
    for i, j in sorted(pairs):
        first, second = sight.seen[:, i], sight.seen[:, j]
        if (first & second).any():
            continue
        of_first = first & sight.inside[:, j] & (sight.alike @ second)
        of_second = second & sight.inside[:, i] & (sight.alike @ first)
        count = int(of_first.sum() + of_second.sum())
        if min(of_first.sum(), of_second.sum()) >= 2:
            odd.append((alone**count * len(pairs), i, j))
    odd.sort()
    named = max((k for k, (chance, _, _) in enumerate(odd, 1) if chance < k * CHANCE), default=0)
    return _moved(markers, [(i, j) for _, i, j in odd[:named]])


def _moved(markers: MarkerSet, pairs: list[tuple[int, int]]) -> list[Doubt]:
    """One doubt of all pairs, each marker with the nearest of those it may be."""
    gap = {pair: float(np.linalg.norm(markers.xyz[pair[0]] - markers.xyz[pair[1]])) for pair in pairs}
    taken: dict[int, float] = {}
    for pair in sorted(pairs, key=gap.__getitem__):
        if not taken.keys() & set(pair):
            taken[pair[0]] = taken[pair[1]] = gap[pair]
    kept = [pair for pair in pairs if taken.get(pair[0]) == taken.get(pair[1]) == gap[pair]]
    if not kept:
        return []
    words = ", ".join(f"{{}} and {{}} ({gap[pair]:.3g} apart)" for pair in kept)
    names = tuple(str(markers.name[k]) for pair in kept for k in pair)
    return [Doubt(names, f"neighbours that are never in one picture, as if a marker had moved meanwhile: {words}")]


def off_their_table(
    primary: MarkerSet, markers: MarkerSet, sight: Sight, views: Sequence[View], cameras: Mapping[str, Camera]
) -> tuple[dict[str, str], list[Doubt]]:
    """{primary: why} of the primaries that were not recognised, and doubts of those that should have been.

    One should have been where pictures that show its nearest neighbour, and have its place in their field, would have
    missed it with too small a chance.
    """
    why: dict[str, str] = {}
    doubts: list[Doubt] = []
    missing = [k for k, n in enumerate(primary.name) if str(n) not in set(markers.name.tolist())]
    if not missing or not len(markers):
        return why, doubts
    gap, near = cKDTree(markers.xyz).query(primary.xyz[missing])
    for k, far, j in zip(missing, gap.tolist(), near.tolist(), strict=True):
        name = str(primary.name[k])
        those = [v for v in np.flatnonzero(sight.seen[:, j]).tolist() if views[v].cam_from_model is not None]
        shows = [v for v in those if in_field(primary.xyz[k : k + 1], views[v], cameras)[0]]
        place = f"the nearest marker, {markers.name[j]}, is {far:.3g} from the place in its table"
        why[name] = f"{place}; {len(shows)} pictures that show that one have the place in their field"
        if sight.rate > 0 and (1 - sight.rate) ** len(shows) * len(missing) < CHANCE:
            words = f"{{}} is not where its table says: {len(shows)} pictures show no spot there; {place}"
            doubts.append(Doubt((name,), words))
    return why, doubts
