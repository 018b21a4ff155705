"""Two pictures and a few matches made by hand: their geometry, and then the remaining spots along the lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark import io
from windmark.epipolar import match_along_lines, match_known_pair
from windmark.geometry import Camera, Pose
from windmark.geometry.two_view import (
    Fundamental,
    TwoView,
    epipolar_curve,
    epipolar_distance,
    epipolar_lines,
    epipoles,
    estimate_two_view,
    fundamental_eight_point,
    fundamental_from_essential,
    refine_fundamental,
    sampson_distance,
)  # fmt: skip
from windmark.io.csvtable import Table
from windmark.pipeline.reconstruct.pair import PairLines, Side
from windmark.scene import Detections

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

SNAP_PX = 10.0
"""A click means the nearest spot within so many pixels."""
SIGMA_PX, MODEL_PX = 1.0, 0.1
"""1 sigma per coordinate of matches without a camera, for a lens that nothing describes; and what a camera's model
leaves beyond the spots' own."""
SAFE = 12
FEW = 40
"""Up to so many matches, every way to leave some out is tried."""
GATE = 4.0
"""A click so many sigmas off its line is wrong."""
BAND = 3.5
"""Half width of the band along a line, in sigmas of spots and geometry."""
ROUNDS = 3
READING = 1.3
"""Of two readings of a plane the one that matches so many times more spots is taken."""


@dataclass(frozen=True)
class Clicks:
    """Matches by hand: places (N, 2) in both pictures, and their table for messages."""

    xy_a: Array
    xy_b: Array
    name: tuple[str, ...]
    table: Table | None = None


@dataclass(frozen=True)
class ClickedPair:
    """The geometry of two pictures and their matches; falsy with ``reason`` where the clicks do not determine it.

    Parameters
    ----------
    fundamental : (3, 3) on pixels without lens distortion (`ideal_pixels`), norm 1
    epipole_a, epipole_b : (2,) in these pixels
    pose, pose_cov : b_from_a with a baseline of 1, and its covariance; None without a camera
    estimate : what the clicks alone gave without a camera; None with one
    click_a, click_b : (N, 2) places that count: the spots that were meant
    click_px : (N,) signed distance of each click's match from the final geometry
    wrong : (N,) clicks that contradict the others
    spot_a, spot_b : (K,) all matches as spots, those by hand first where they are spots
    by_hand : (K,)
    distance_px : (K,)
    sigma0 : residuals over sigma
    notes : what the user should know
    """

    fundamental: Array = field(default_factory=lambda: np.full((3, 3), np.nan))
    epipole_a: Array = field(default_factory=lambda: np.full(2, np.nan))
    epipole_b: Array = field(default_factory=lambda: np.full(2, np.nan))
    pose: Pose | None = None
    pose_cov: Array | None = None
    estimate: Fundamental | None = None
    click_a: Array = field(default_factory=lambda: np.zeros((0, 2)))
    click_b: Array = field(default_factory=lambda: np.zeros((0, 2)))
    click_px: Array = field(default_factory=lambda: np.zeros(0))
    wrong: Mask = field(default_factory=lambda: np.zeros(0, bool))
    spot_a: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    spot_b: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    by_hand: Mask = field(default_factory=lambda: np.zeros(0, bool))
    distance_px: Array = field(default_factory=lambda: np.zeros(0))
    sigma0: float = float("nan")
    notes: tuple[str, ...] = ()
    reason: str = ""

    def __bool__(self) -> bool:
        return not self.reason


def read_clicks(path: Path, names: Sequence[str]) -> Clicks:
    """A table ``x_a,y_a,x_b,y_b[,name]``, or ``image,name,x,y`` with the same names in both pictures.

    Raises
    ------
    FileError
        Names the line: no number, unknown picture, a name twice in one picture, no name in both.
    """
    table = io.read_table(path, required=(), known=("x_a", "y_a", "x_b", "y_b", "name", "image", "x", "y"))
    if "x_a" in table:
        four = table.together("x_a", "y_a", "x_b", "y_b")
        assert four is not None
        table.check(np.isfinite(four).all(axis=1), "a place is missing; expected x_a, y_a, x_b, y_b")
        own = table.text("name") if "name" in table else [str(k + 1) for k in range(len(table))]
        return Clicks(four[:, :2], four[:, 2:], tuple(own), table)
    lost = [c for c in ("image", "name", "x", "y") if c not in table]
    if lost:
        raise io.FileError(path, f"has no column {lost[0]}; expected x_a,y_a,x_b,y_b or image,name,x,y", "header")
    xy = np.column_stack([table.numbers("x"), table.numbers("y")])
    places: dict[str, dict[str, int]] = {n: {} for n in names}
    for row, (image, name) in enumerate(zip(table.text("image"), table.text("name"), strict=True)):
        stem = image if image in places else str(Path(image).with_suffix(""))
        if stem not in places:
            table.fail(row, f"the picture {image!r} is none of {', '.join(names)}")
        if name in places[stem]:
            table.fail(row, f"{name} is there before for this picture; expected it once")
        places[stem][name] = row
    a, b = (places[n] for n in names)
    both = [n for n in a if n in b]
    if not both:
        raise io.FileError(path, "no name is in both pictures", "name")
    return Clicks(xy[[a[n] for n in both]], xy[[b[n] for n in both]], tuple(both), table)


def clicked_pair(
    spots_a: Detections, spots_b: Detections, clicks: Clicks, cameras: tuple[Camera, Camera] | None, *,
    sigma_px: float | None = None, seed: int = 0,
) -> ClickedPair:  # fmt: skip
    """Epipolar geometry from a few matches, then all spots along the lines (AIAA 2005-5007, section VI.B-D).

    A click means the nearest spot; two clicks on one spot are refused. With ``cameras`` the essential matrix is found
    from six matches or more, also of points on a plane; without, the fundamental matrix from eight. Clicks that
    contradict the others or, with cameras, what the neighbours' depths say, are named and left out. Without cameras the
    geometry may absorb a wrong click where there are few, which ``notes`` say.

    Raises
    ------
    ValueError
        For two clicks that mean one spot.
    """
    meant_a = _snapped(spots_a, clicks.xy_a, clicks.name, "first")
    meant_b = _snapped(spots_b, clicks.xy_b, clicks.name, "second")
    on_spots = (meant_a >= 0) & (meant_b >= 0)
    notes = [f"click {n}: no spot within {SNAP_PX:g} px; left out" for n, good in
             zip(clicks.name, on_spots, strict=True) if not good]  # fmt: skip
    xy_a, xy_b = (np.where(on_spots[:, None], s.xy[np.maximum(m, 0)] if len(s) else c, c)
                  for s, m, c in ((spots_a, meant_a, clicks.xy_a), (spots_b, meant_b, clicks.xy_b)))  # fmt: skip
    job = _Job(spots_a, spots_b, cameras, sigma_px, seed)
    use = np.flatnonzero(on_spots)
    wrong = np.zeros(len(use), bool)
    first, second = meant_a[use], meant_b[use]
    geometry = job.geometry(first, second)
    if isinstance(geometry, str):
        return ClickedPair(reason=geometry, notes=tuple(notes), click_a=xy_a, click_b=xy_b)
    wrong |= ~geometry.used
    kept = first[~wrong], second[~wrong]
    for _ in range(ROUNDS):
        spot_a, spot_b = job.matched(geometry, *kept)
        clicked = np.isin(spot_a, first[~wrong])
        if len(spot_a) >= max(2 * int((~wrong).sum()), 12):
            bad = _contradicted(job, geometry, spot_a, spot_b, clicked)
            if len(bad):
                wrong |= np.isin(first, spot_a[bad])
                rest = np.setdiff1d(np.arange(len(spot_a)), bad)
                spot_a, spot_b = spot_a[rest], spot_b[rest]
        again = job.geometry(spot_a, spot_b)
        if isinstance(again, str):
            return ClickedPair(reason=again, notes=tuple(notes), click_a=xy_a, click_b=xy_b)
        geometry = again
        wrong |= np.isin(first, spot_a[~again.used])
        before, kept = kept, (spot_a[again.used], spot_b[again.used])
        if len(before[0]) == len(kept[0]) and (np.sort(before[0]) == np.sort(kept[0])).all():
            break
    wrong, spot_a, spot_b = _settled(job, geometry, (first, second), *kept)
    by_hand = np.array([bool(((first == i) & (second == j)).any()) for i, j in zip(spot_a, spot_b, strict=True)], bool)
    order = np.lexsort((spot_a, ~by_hand))
    spot_a, spot_b, by_hand = spot_a[order], spot_b[order], by_hand[order]
    matrix = geometry.matrix
    ends = epipoles(matrix)
    gone = ~on_spots
    gone[use[wrong]] = True
    distance = job.distance(geometry, meant_a[use], meant_b[use])
    click_px = np.full(len(on_spots), np.nan)
    click_px[use] = distance
    with np.errstate(divide="ignore", invalid="ignore"):
        end_a, end_b = (e[:2] / e[2] for e in ends)
    return ClickedPair(
        matrix, end_a, end_b, geometry.pose, geometry.pose_cov, geometry.estimate, xy_a, xy_b, click_px, gone,
        spot_a, spot_b, by_hand, job.distance(geometry, spot_a, spot_b), geometry.sigma0,
        (*notes, *geometry.notes, *_doubts(job, int(on_spots.sum()))),
    )  # fmt: skip


@dataclass(frozen=True)
class _Geometry:
    matrix: Array
    used: Mask
    sigma0: float
    pose: Pose | None = None
    pose_cov: Array | None = None
    estimate: Fundamental | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Job:
    """Two pictures, with cameras or without."""

    a: Detections
    b: Detections
    cameras: tuple[Camera, Camera] | None
    sigma_px: float | None
    seed: int

    def geometry(self, i: Ints, j: Ints) -> _Geometry | str:
        """The geometry of matched spots; or why there is none."""
        if self.cameras is None:
            return self._fundamental(i, j)
        if len(i) < 6:
            return f"{len(i)} matches; with a camera six are needed (five fix the geometry, one checks it)"
        extra = (self.sigma_px or MODEL_PX) ** 2 * np.eye(2)
        view = estimate_two_view(
            self.a.xy[i], self.b.xy[j], *self.cameras, cov_a=self.a.cov[i] + extra, cov_b=self.b.cov[j] + extra,
            seed=self.seed,
        )  # fmt: skip
        if not view:
            return f"the matches give no geometry: {view.reason}"
        if view.b_from_a is None:
            return f"no baseline shows: {view.reason}; the pictures must be taken from different places"
        if int(view.inliers.sum()) - 5 < 1:
            return f"{int(view.inliers.sum())} matches agree: five fix the geometry, and nothing checks it; add matches"
        pose, note = self._reading(view, i[view.inliers], j[view.inliers])
        if pose is None:
            return note
        matrix = fundamental_from_essential(_essential(pose), *self.cameras)
        return _Geometry(matrix / np.linalg.norm(matrix), view.inliers, view.sigma0, pose, view.cov, None,
                         (note,) if note else ())  # fmt: skip

    def _reading(self, view: TwoView, i: Ints, j: Ints) -> tuple[Pose | None, str]:
        """The pose; of several that explain the matches the one along whose lines far more spots match."""
        assert view.b_from_a is not None
        if not view.alternatives:
            return view.b_from_a, ""
        every = (view.b_from_a, *view.alternatives)
        counts = [len(self._known(pose, view.cov, i, j)[0]) for pose in every]
        order = np.argsort(counts)[::-1]
        if counts[order[0]] < READING * counts[order[1]]:
            return None, (
                f"{view.reason or 'two poses explain the matches'}, and the other spots do not decide "
                f"({counts[order[0]]} and {counts[order[1]]} match); add matches off the plane"
            )
        return every[order[0]], f"{view.reason}: the one along whose lines more spots match was taken"

    def _fundamental(self, i: Ints, j: Ints) -> _Geometry | str:
        sigma = self.sigma_px or SIGMA_PX
        a, b = self.a.xy[i], self.b.xy[j]
        if len(i) <= FEW:
            done = refine_fundamental(a, b, sigma_px=sigma)
            return _Geometry(done.matrix, done.used, done.sigma0, estimate=done) if done else done.reason
        use = np.arange(len(i))
        while True:  # many: the worst one leaves until the rest agree
            done = refine_fundamental(a[use], b[use], sigma_px=sigma, most_wrong=0)
            if done or done.suspects or len(use) < 0.8 * len(i) or "homography" in done.reason:
                break
            off = np.abs(sampson_distance(fundamental_eight_point(a[use], b[use]), a[use], b[use]))
            use = np.delete(use, int(off.argmax()))
        if not done:
            return done.reason
        used = np.zeros(len(i), bool)
        used[use] = True
        return _Geometry(done.matrix, used, done.sigma0, estimate=done)

    def distance(self, geometry: _Geometry, i: Ints, j: Ints) -> Array:
        """Signed distance of matches from their lines, px."""
        if self.cameras is None or geometry.pose is None:
            return sampson_distance(geometry.matrix, self.a.xy[i], self.b.xy[j])
        return epipolar_distance(self.a.xy[i], self.b.xy[j], *self.cameras, geometry.pose).sampson_px

    def matched(self, geometry: _Geometry, i: Ints, j: Ints) -> tuple[Ints, Ints]:
        """All matches along the lines, those given among them."""
        if geometry.pose is not None:
            return self._known(geometry.pose, geometry.pose_cov, i, j)
        estimate = geometry.estimate
        assert estimate is not None
        table = np.abs(sampson_distance(geometry.matrix, self.a.xy[:, None], self.b.xy[None]))
        return match_along_lines(self.a.xy, self.b.xy, i, j, table < BAND * self._width(estimate))

    def _width(self, estimate: Fundamental) -> Array:
        """(A, B) 1 sigma of the distance of any two spots from each other's line: of the spots and of F."""
        a, b = (np.column_stack([d.xy, np.ones(len(d))]) for d in (self.a, self.b))
        row = b[None, :, :, None] * a[:, None, None, :]  # derivative of x_b' F x_a by the elements of F
        flat = row.reshape(len(a), len(b), 9)
        of_f = np.einsum("abi,ij,abj->ab", flat, estimate.cov, flat)
        line_b, line_a = a @ estimate.matrix.T, b @ estimate.matrix
        slope = (line_b[:, None, :2] ** 2).sum(axis=2) + (line_a[None, :, :2] ** 2).sum(axis=2)
        return np.asarray(np.sqrt(estimate.sigma_px**2 + of_f / slope))

    def _known(self, pose: Pose, cov: Array | None, i: Ints, j: Ints) -> tuple[Ints, Ints]:
        assert self.cameras is not None
        pair = match_known_pair(self.a, self.b, *self.cameras, pose, pose_cov=cov, model_px=self.sigma_px or MODEL_PX)
        rest = ~(np.isin(pair.spot_a, i) | np.isin(pair.spot_b, j))
        return np.concatenate([i, pair.spot_a[rest]]), np.concatenate([j, pair.spot_b[rest]])


def _essential(pose: Pose) -> Array:
    from windmark.geometry.two_view import essential_from_poses

    return essential_from_poses(pose)


def _doubts(job: _Job, clicks: int) -> tuple[str, ...]:
    """What the number of clicks leaves unchecked."""
    if job.cameras is not None:
        return ()
    along = "without a camera the neighbours alone say which spot on a line is meant: look at the picture"
    if clicks >= SAFE:
        return (along,)
    unseen = (f"{clicks} matches without a camera are {clicks - 7} more than the geometry has unknowns: a wrong one "
              f"may go unseen; {SAFE} or more, or a camera, are safe")  # fmt: skip
    return along, unseen


def _contradicted(job: _Job, geometry: _Geometry, spot_a: Ints, spot_b: Ints, clicked: Mask) -> Ints:
    """Clicks among the matches whose spots, asked without any click, match other ones.

    With a camera the neighbours' depths are evidence by themselves; without one there is nothing to ask.
    """
    if geometry.pose is None:
        return np.zeros(0, np.int64)
    none = np.zeros(0, np.int64)
    match = dict(zip(*(s.tolist() for s in job.matched(geometry, none, none)), strict=True))
    back = {j: i for i, j in match.items()}
    return np.array([k for k in np.flatnonzero(clicked).tolist() if match.get(int(spot_a[k]), spot_b[k]) != spot_b[k]
                     or back.get(int(spot_b[k]), spot_a[k]) != spot_a[k]], dtype=np.int64)  # fmt: skip


def _settled(
    job: _Job, geometry: _Geometry, clicks: tuple[Ints, Ints], spot_a: Ints, spot_b: Ints
) -> tuple[Mask, Ints, Ints]:
    """Which clicks the final geometry or the final matches contradict, and all matches with the other clicks."""
    match, back = (dict(zip(*(s.tolist() for s in p), strict=True)) for p in ((spot_a, spot_b), (spot_b, spot_a)))
    off = np.abs(job.distance(geometry, *clicks))
    usual = float(np.sqrt((job.distance(geometry, spot_a, spot_b) ** 2).mean()))
    limit = GATE * max(usual, job.sigma_px or (MODEL_PX if job.cameras else SIGMA_PX))
    wrong = np.zeros(len(off), bool)
    for k, (i, j) in enumerate(zip(*(c.tolist() for c in clicks), strict=True)):
        if match.get(i) == j:
            continue
        wrong[k] = i in match or j in back or bool(off[k] > limit)
        if not wrong[k]:
            match[i], back[j] = j, i
    pairs = np.array(list(match.items()), dtype=np.int64).reshape(-1, 2)
    return wrong, pairs[:, 0], pairs[:, 1]


def _snapped(spots: Detections, xy: Array, names: Sequence[str], which: str) -> Ints:
    """The spot (N,) that each click means, -1 for none."""
    if not len(spots):
        return np.full(len(xy), -1)
    far, spot = cKDTree(spots.xy).query(xy)
    spot = np.where(far <= SNAP_PX, spot, -1)
    found, count = np.unique(spot[spot >= 0], return_counts=True)
    if (count > 1).any():
        twice = [names[k] for k in np.flatnonzero(spot == found[count > 1][0]).tolist()]
        raise ValueError(f"clicks {' and '.join(twice)} mean the same spot of the {which} picture; expected one click "
                         "for each")  # fmt: skip
    return np.asarray(spot, np.int64)


def lines_of(
    result: ClickedPair, names: tuple[str, str], spots: tuple[Detections, Detections], sizes: Sequence[tuple[int, int]],
    cameras: tuple[Camera, Camera] | None,
) -> PairLines:  # fmt: skip
    """Both pictures with the lines of all matches, for the picture of a pair (Fig. 12)."""
    label = tuple(f"m{k + 1:02d}" for k in range(len(result.spot_a)))
    here = (spots[0].xy[result.spot_a], spots[1].xy[result.spot_b])
    sides = []
    for s in (0, 1):
        other = here[1 - s]
        if cameras is not None and result.pose is not None:
            step = result.pose if s == 1 else result.pose.inverse()
            curves = tuple(epipolar_curve(p, cameras[1 - s], cameras[s], step) for p in other)
        else:
            matrix = result.fundamental if s == 1 else result.fundamental.T
            curves = tuple(_segment(line, sizes[s]) for line in epipolar_lines(matrix, other))
        rest = np.setdiff1d(np.arange(len(spots[s])), (result.spot_a, result.spot_b)[s])
        sides.append(Side(names[s], here[s], curves, result.distance_px, spots[s].xy[rest], ()))
    return PairLines(label, sides[0], sides[1])


def _segment(line: Array, size_px: tuple[int, int]) -> Array:
    """The part (2, 2) of a straight line within a picture; (0, 2) where it does not pass through."""
    w, h = size_px[0] - 0.5, size_px[1] - 0.5
    a, b, c = line
    ends = [(x, -(a * x + c) / b) for x in (-0.5, w) if b] + [(-(b * y + c) / a, y) for y in (-0.5, h) if a]
    inside = [p for p in ends if -0.5 - 1e-9 <= p[0] <= w + 1e-9 and -0.5 - 1e-9 <= p[1] <= h + 1e-9]
    if len(inside) < 2:
        return np.empty((0, 2))
    points = np.array(inside)
    far = np.linalg.norm(points - points[0], axis=1).argmax()
    return points[[0, far]]


def relabelled(result: ClickedPair, names: tuple[str, str], spots: tuple[Detections, Detections]) -> dict[str, Array]:
    """All matches as a table ``image,name,x,y``, which `reconstruct` takes as labels."""
    label = [f"m{k + 1:03d}" for k in range(len(result.spot_a))]
    xy = np.concatenate([spots[0].xy[result.spot_a], spots[1].xy[result.spot_b]])
    return {"image": np.repeat(names, len(label)), "name": np.array(label * 2), "x": xy[:, 0], "y": xy[:, 1]}


