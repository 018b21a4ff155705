"""Why a camera shows no markers, or few: the picture itself, where the markers are, or what was at their places."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark import detection
from windmark.deformation.misfit import carried
from windmark.geometry import Camera, Pose
from windmark.scene import Detections, MarkerSet
from windmark.tasks.deform.spots import LEAST_PX, Labelled
from windmark.tasks.deform.task import DeformationTest, Image, Sight, Station

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FEW = 0.6
"""Less than this part of the expected markers, or expected less than this part of those before, is few."""
SATURATED = 0.2
"""Part of the pixels at the highest level from which a picture counts as saturated."""
DARKER, PALER, SOFTER = 0.35, 0.5, 0.5
"""Levels, contrast and edges below this part of the last good picture's are told."""
HALF = 0.5
"""Of a part's markers: so many spots without a marker may be its own."""
BLOCK = 16
"""Size of the blocks whose means tell the large-scale contrast of a picture, in pixels."""
STEP = 3
"""Distance of the pixels whose differences tell its edges."""


@dataclass(frozen=True)
class Levels:
    """What a picture is like.

    Parameters
    ----------
    middle, span : median, and range from the 0.5th to the 99.5th percentile, in grey levels
    clipped : part of the pixels at the highest level there is
    coarse : standard deviation of the means of blocks: light and paint, which blur leaves
    fine : root mean square difference of near pixels at the markers' places less that of the noise: edges
    sharp : the same of the whole picture
    """

    middle: float
    span: float
    clipped: float
    coarse: float
    fine: float
    sharp: float


def levels_of(image: Image, mask: Mask | None, xy: Array, radius_px: float) -> Levels:
    """What a picture is like, with markers (M, 2) expected at ``xy``."""
    use = np.isfinite(image) if image.dtype.kind == "f" else np.ones(image.shape, bool)
    if mask is not None:
        use &= mask
    some = image[use][:: max(int(use.sum()) // 100_000, 1)].astype(float)
    if not len(some):
        return Levels(np.nan, 0.0, 0.0, 0.0, 0.0, 0.0)
    low, middle, high = np.percentile(some, [0.5, 50, 99.5])
    full = image.dtype.kind == "u" and (int(some.max()) + 1).bit_count() == 1  # 255, 1023, 4095, ...
    clipped = float((some >= some.max()).mean()) if full else 0.0
    height, width = (n - n % BLOCK for n in image.shape)
    grey = np.where(use, image, middle).astype(np.float32)[:height, :width]
    blocks = grey.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK).mean(axis=(1, 3))
    coarse = float(blocks.std()) if blocks.size > 3 else 0.0
    across = np.diff(grey, axis=1)
    noise2 = 2 * (1.4826 * float(np.median(np.abs(across))) / np.sqrt(2)) ** 2 if across.size else 0.0
    whole = float(((grey[::STEP, STEP:] - grey[::STEP, :-STEP]) ** 2).mean()) if grey.shape[1] > STEP else 0.0
    sharp = float(np.sqrt(max(whole - noise2, 0.0)))
    return Levels(float(middle), float(high - low), clipped, coarse, _fine(grey, xy, radius_px, noise2), sharp)


def _fine(grey: NDArray[np.float32], xy: Array, radius_px: float, noise2: float) -> float:
    half = int(np.ceil(np.nan_to_num(radius_px, nan=4.0))) + 2
    squares = []
    for x, y in np.rint(xy[np.isfinite(xy).all(axis=1)]).astype(int):
        part = grey[max(y - half, 0) : y + half + 1, max(x - half, 0) : x + half + 1]
        if min(part.shape) > STEP:
            squares.append(float(((part[:, STEP:] - part[:, :-STEP]) ** 2).mean()))
            squares.append(float(((part[STEP:] - part[:-STEP]) ** 2).mean()))
    return float(np.sqrt(max(float(np.mean(squares)) - noise2, 0.0))) if squares else 0.0


def few(found: int, expected: int, before: int) -> bool:
    """Whether a camera shows few markers for what it should, or should show few for what it did."""
    return found == 0 or found < FEW * expected or expected < FEW * before


def why_few(
    image: Image, test: DeformationTest, station: Station, spots: Labelled, good: Levels | None, before: int,
    placed: MarkerSet | None, camera: Camera, pose: Pose, hidden: Mask | None,
) -> str:  # fmt: skip
    """Why a camera shows no markers, or few, in words; the first cause that the picture shows.

    Parameters
    ----------
    image : of the station
    spots : that were found in it
    good : what the last good picture was like; None without one
    before : markers expected in it
    placed : all markers where they should be, in the tunnel; None where that is unknown
    camera, pose : as they should be, cam_from_tunnel
    hidden : (N,) markers that the grid hides; None if unknown
    """
    xy, where = np.zeros((0, 2)), ""
    if placed is not None:
        xy, where = _in_sight(placed, camera, pose, hidden, before)
    now = levels_of(image, station.mask, xy, spots.radius_px)
    parts = [part for part in (_levels_words(now, good), where) if part]
    if not parts and good is not None:
        parts = [part for part in (_edges_words(now, good),) if part]
    if not len(spots.marker) and not parts:
        parts = [part for part in (_none_words(image, test, station),) if part]
    at_places = "; ".join(f"{n} {words}" for words, n in spots.not_found.items())
    if at_places and not where:
        parts.append(f"at the expected places: {at_places}")
    if not parts:
        parts = [spots.reason or "its markers are not where they were expected"]
    return "; ".join(parts)


def _in_sight(placed: MarkerSet, camera: Camera, pose: Pose, hidden: Mask | None, before: int) -> tuple[Array, str]:
    """Where markers should be seen, and how many of them are out of the picture, turned away or hidden."""
    center, normal = pose.apply(placed.xyz), pose.rotate(placed.normal)
    xy = camera.project(center)[0]
    facing = ~((normal * center).sum(axis=1) >= 0)  # without a normal: facing
    inside = camera.in_image(xy)
    covered = np.zeros(len(placed), bool) if hidden is None else hidden
    seen = facing & inside & ~covered
    if seen.sum() >= FEW * max(before, 1):
        return xy[seen], ""
    counts = (
        (int((facing & ~inside).sum()), "out of the picture"),
        (int((inside & facing & covered).sum()), "hidden by the grid"),
        (int((inside & ~facing).sum()), "turned away"),
    )  # fmt: skip
    words = ", ".join(f"{n} {what}" for n, what in counts if n)
    return xy[seen], f"{int(seen.sum())} of {len(placed)} markers should be in sight ({words})" if words else ""


def _levels_words(now: Levels, good: Levels | None) -> str:
    if not np.isfinite(now.middle):
        return "no pixel can be used: all are masked out or not finite"
    if now.span == 0:
        return f"an empty picture: all pixels are {now.middle:g}"
    if now.clipped > SATURATED and (good is None or now.clipped > good.clipped + SATURATED):
        return f"saturated: {100 * now.clipped:.0f} % of the pixels are at the highest level"
    if good is not None and now.span < DARKER * good.span and now.middle <= good.middle:
        return (f"dark: its grey levels span {now.span:.0f} (median {now.middle:.0f}), those of the last good picture "
                f"{good.span:.0f} ({good.middle:.0f})")  # fmt: skip
    if good is not None and now.span < DARKER * good.span:
        return f"pale: its grey levels span {now.span:.0f}, those of the last good picture {good.span:.0f}"
    return ""


def _edges_words(now: Levels, good: Levels) -> str:
    """Motion blur, lost contrast, or markers that are not there: edges against those of the last good picture."""
    if not (good.fine > 0 and good.coarse > 0 and good.sharp > 0):
        return ""
    fine, coarse, sharp = now.fine / good.fine, now.coarse / good.coarse, now.sharp / good.sharp
    if fine < SOFTER * min(coarse, 1.0) and fine < SOFTER * sharp:
        return ("the picture is sharp, but its markers are not where they should be: camera or model jumped, or "
                f"something covers them ({100 * fine:.0f} % of the last good picture's edges there, "
                f"{100 * sharp:.0f} % in the whole picture)")  # fmt: skip
    if fine < SOFTER * min(coarse, 1.0):
        return f"blurred (motion or focus): {100 * fine:.0f} % of the last good picture's edges at the markers' places"
    if fine < PALER:
        return f"the contrast dropped to {100 * fine:.0f} % of the last good picture's"
    return ""


def _none_words(image: Image, test: DeformationTest, station: Station) -> str:
    """What the detector says of the whole picture; "" where it does find spots."""
    look = test.look
    options: dict[str, Any] = {"radius_px": look.radius_px, "polarity": look.polarity, "merit_max": look.merit_max}
    return detection.why_none(image, photometry=look.photometry, mask=station.mask, **options)


def set_otherwise(
    why: str, test: DeformationTest, seen: Mapping[str, Labelled], spots: Mapping[str, Detections | str]
) -> str:
    """A refusal, and what it is likely to come from where it names a law none of whose markers has a spot.

    Spots that no expected marker has may be theirs: the part is then set otherwise than where it was looked for.

    Parameters
    ----------
    why : the refusal
    seen, spots : camera -> spots with a marker, and all of them
    """
    labelled = np.unique(np.concatenate([s.marker for s in seen.values()])) if seen else np.zeros(0, np.int64)
    for part in test.volumes.parts:
        names = [f"{part.name}.{p.name}" for p in part.law.parameters] if part.law is not None else []
        own = np.isin(test.markers.volume, carried(test.volumes, part.name)) & (test.markers.role != "wall")
        told = [name for name in names if name in why]
        if not told or not own.any() or own[labelled].any():
            continue
        free = {n: count for n, s in spots.items() if (count := _without_marker(test, n, s, seen.get(n)))}
        if max(free.values(), default=0) < HALF * own.sum():
            continue
        there = " and ".join(f"{count} in {name}" for name, count in free.items())
        return (f"{why}; but spots are seen where no marker is expected ({there}): if they are those of {part.name}, "
                f"it is set otherwise than it was looked for; give {', '.join(told)} a start and a sigma in its "
                "[[volume]] parameters")  # fmt: skip
    return why


def _without_marker(test: DeformationTest, name: str, every: Detections | str, seen: Labelled | None) -> int:
    """Spots of an image that are no labelled marker's and at no place of a marker on a wall."""
    if isinstance(every, str) or not len(every):
        return 0
    station, wall = test.station(name), test.markers.role == "wall"
    pose = station.cam_from_tunnel if seen is None or seen.pose is None else seen.pose
    xy, imaged = station.camera.project(pose.apply(test.markers.xyz[wall]))
    taken = np.concatenate([xy[imaged], np.zeros((0, 2)) if seen is None else seen.xy])
    return int((cKDTree(taken).query(every.xy)[0] > LEAST_PX).sum()) if len(taken) else len(every)


def words_of(cameras: Mapping[str, Sight]) -> str:
    """Reasons of all cameras of an instant as one text; "" where all saw what they should."""
    return "; ".join(f"{name}: {s.found} of {s.expected}: {s.reason}" for name, s in cameras.items() if s.reason)
