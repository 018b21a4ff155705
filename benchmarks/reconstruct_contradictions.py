"""Reconstruction from pictures that contradict each other or show little: is a wrong place said to be one?

    python benchmarks/reconstruct_contradictions.py [TRIALS] [KIND ...] [--seed S]

The scenes of `reconstruct.py` (no labels, no poses, six primaries known to 0.02 mm, noise 0.1 px), changed so that
something is wrong. A view is WRONG where the true markers are imaged more than 3 px (RMS) from where its pose says
and more than six of the pose's stated sigmas; a marker where it is more than six of its stated sigmas off (three
coordinates together: the distance that chance exceeds as often). A result counts as wrong where a view or more than 2 %
of the markers are wrong and nothing is named; "named": wrong things, but `warnings`, `suspect` or `dropped` name
something; "alarm": nothing is wrong, but `warnings` or `suspect` name something in a scene without a fault.

What it leaves out: pictures (spots are given), labels, rigs.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from windmark.geometry import Pose
from windmark.scene import Detections, MarkerSet
from windmark.tasks.reconstruct import NotReconstructed, Reconstruction, reconstruct

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "epipolar"))
import reconstruct_scenes as scenes

Array = NDArray[np.float64]
Rng = np.random.Generator

SEED, TRIALS = 3_050_000, 20
SIGMA = 0.02
BEYOND = 6.0
BEYOND_3D = float(chi2.isf(2 * norm.sf(BEYOND), 3))
BEYOND_6D = float(chi2.isf(2 * norm.sf(BEYOND), 6))
AXES = ((1, 1, 0), (1, -1, 0), (-1, 1, 0), (-1, -1, 0), (0, 0.3, 1), (0.3, 0, -1), (1, 0, 0), (0, 1, 0))
VIEW_PX, MARKERS_PART = 3.0, 0.02


def _model(rng: Rng, views: int = 12, points: int = 80, **options: float) -> scenes.Case:
    kind, path = rng.choice(["plate", "model"]), rng.choice(["walk", "cloud"])
    return scenes.make(int(rng.integers(2**31)), str(kind), str(path), views=views, points=points, **options)


def clean(rng: Rng) -> scenes.Case:
    """Nothing is wrong."""
    return _model(rng)


def dirty(rng: Rng) -> scenes.Case:
    """A third of the spots are missing, and half as many as are left are false."""
    return _model(rng, views=20, missing=0.33, false=0.5)


def thin(rng: Rng) -> scenes.Case:
    """Three to five pictures."""
    return _model(rng, views=int(rng.integers(3, 6)), false=0.3)


def regular(rng: Rng) -> scenes.Case:
    """Rows of equal pitch, every place off by 0.5 mm, and a few markers besides; a third of the spots are false."""
    across, up = np.meshgrid(np.arange(-5, 6) * 60.0, np.arange(-4, 5) * 60.0)
    rows = np.stack([across.ravel(), up.ravel(), 0 * up.ravel()], axis=1) + rng.normal(0, 0.5, (99, 3))
    return _placed(rng, np.concatenate([rows, rng.uniform(-330, 330, (8, 3)) * [1, 0.8, 0.2]]), false=0.3)


def copies(rng: Rng) -> scenes.Case:
    """Two equal groups of markers; half of the pictures show one of them only."""
    group = rng.uniform(-140, 140, (35, 3)) * [1, 1.6, 0.1]
    aside = np.array([180.0, 0.0, 0.0])
    xyz = np.concatenate([group - aside, group + aside + rng.normal(0, 0.1, group.shape)])
    case = _placed(rng, xyz, false=0.2)
    for v in range(0, len(case.detections), 2):
        hidden = case.labels[v] // 35 == rng.integers(2)
        case = _spots(case, v, np.flatnonzero(~hidden | (case.labels[v] < 0)))
    return case


def foreign(rng: Rng) -> scenes.Case:
    """One picture is of another model."""
    case, other = _model(rng), _model(rng)
    return _with(case, int(rng.integers(len(case.detections))), other.detections[0], np.full(len(other.labels[0]), -1))


def near_empty(rng: Rng) -> scenes.Case:
    """Two pictures show eight of the markers, among forty false spots."""
    case = _model(rng)
    for v in rng.choice(len(case.detections), 2, replace=False):
        few = rng.permutation(np.flatnonzero(case.labels[v] >= 0))[:8]
        false = Detections.make(rng.uniform(0, 1, (40, 2)) * case.camera.size_px, sigma_px=0.1)
        xy = np.concatenate([case.detections[v].xy[few], false.xy])
        label = np.concatenate([case.labels[v][few], np.full(40, -1)])
        case = _with(case, int(v), Detections.make(xy, sigma_px=0.1), label)
    return case


def zoomed(rng: Rng) -> scenes.Case:
    """One picture was taken with a focal length 3 to 20 % longer."""
    case = _model(rng)
    v = int(rng.integers(len(case.detections)))
    centre = np.array([case.camera.cx, case.camera.cy])
    xy = centre + (case.detections[v].xy - centre) * rng.uniform(1.03, 1.2)
    inside = np.flatnonzero(case.camera.in_image(xy))
    return _with(case, v, Detections.make(xy[inside], sigma_px=0.1), case.labels[v][inside])


def mirrored(rng: Rng) -> scenes.Case:
    """One picture is its mirror image."""
    case = _model(rng)
    v = int(rng.integers(len(case.detections)))
    xy = case.detections[v].xy * [-1, 1] + [case.camera.size_px[0] - 1, 0]
    return _with(case, v, Detections.make(xy, sigma_px=0.1), case.labels[v])


def flap(rng: Rng) -> scenes.Case:
    """A sixth of the markers, on one side, is 3 mm higher in half of the pictures."""
    return _moved(rng, lambda arm: np.tile([0.0, 0.0, 3.0], (len(arm), 1)))


def hinged(rng: Rng) -> scenes.Case:
    """A sixth of the markers, on one side, turns about its inner edge by 1 to 5 degrees in some of the pictures."""
    angle = np.radians(rng.uniform(1, 5)) * rng.choice([-1, 1])
    return _moved(rng, lambda arm: arm[:, :1] * [np.cos(angle) - 1, 0.0, np.sin(angle)], int(rng.integers(3, 7)))


def _moved(rng: Rng, by: Callable[[Array], Array], count: int | None = None) -> scenes.Case:
    """The side's markers moved, by what ``by`` says of their arms from its edge, in every second picture or so many."""
    seed, kind, path = int(rng.integers(2**31)), str(rng.choice(["plate", "model"])), str(rng.choice(["walk", "cloud"]))
    case = scenes.make(seed, kind, path, views=12, points=80)
    edge = np.quantile(case.xyz[:, 0], 0.84)
    raised = case.xyz[:, 0] > edge
    moved = case.xyz + np.where(raised[:, None], by(case.xyz - [edge, 0.0, 0.0]), 0.0)
    every = range(len(case.detections))
    for v in every[::2] if count is None else rng.choice(len(every), count, replace=False).tolist():
        pose = Pose(case.poses.rotation[v], case.poses.translation[v])
        shift = case.camera.project(pose.apply(moved))[0] - case.camera.project(pose.apply(case.xyz))[0]
        label = case.labels[v]
        xy = case.detections[v].xy + np.where(label[:, None] >= 0, shift[label], 0.0)
        case = _with(case, v, Detections.make(xy, sigma_px=0.1), label)
    return case


def primary_off(rng: Rng) -> scenes.Case:
    """The table has one of six primaries 1 to 5 mm from its place."""
    return _model(rng)


KINDS: dict[str, Callable[[Rng], scenes.Case]] = {
    f.__name__.replace("_", "-"): f
    for f in (clean, dirty, thin, regular, copies, foreign, near_empty, zoomed, mirrored, flap, hinged, primary_off)
}
FAULTLESS = {"clean", "dirty", "thin", "regular", "copies", "near-empty"}


def _placed(rng: Rng, xyz: Array, *, false: float, views: int = 14) -> scenes.Case:
    """Markers of a layout of one's own, seen from anywhere in front."""
    reach = float(np.abs(xyz[:, :2]).max())
    stations = scenes.cloud(rng, views, reach)
    normal = np.tile([0.0, 0.0, 1.0], (len(xyz), 1))
    seen = [scenes._seen(rng, scenes.CAMERA, p, xyz, normal, "plate", 0.1, false, 0.1) for p in stations]
    spots, labels = zip(*seen, strict=True)
    poses = Pose(np.stack([p.rotation for p in stations]), np.stack([p.translation for p in stations]))
    return scenes.Case("layout", scenes.CAMERA, poses, xyz, spots, labels, np.zeros(0, int))


def _with(case: scenes.Case, view: int, spots: Detections, label: NDArray[np.int64]) -> scenes.Case:
    detections, labels = list(case.detections), list(case.labels)
    detections[view], labels[view] = spots, label
    return replace(case, detections=tuple(detections), labels=tuple(labels))


def _spots(case: scenes.Case, view: int, kept: NDArray[np.int64]) -> scenes.Case:
    spots = Detections.make(case.detections[view].xy[kept], sigma_px=0.1)
    return _with(case, view, spots, case.labels[view][kept])


def _primaries(case: scenes.Case, rng: Rng, kind: str) -> MarkerSet:
    """Six markers far apart that are in four pictures or more where there are such."""
    seen = np.flatnonzero(case.views_of >= min(4, len(case.detections)))
    case = replace(case, primary=np.array([*dict.fromkeys(
        int(seen[np.argmax(case.xyz[seen] @ np.array(a, float))]) for a in AXES)]))  # fmt: skip
    xyz = case.xyz[case.primary] + rng.normal(0, SIGMA, (len(case.primary), 3))
    if kind == "primary-off":
        way = rng.normal(size=3)
        xyz[rng.integers(len(xyz))] += rng.uniform(1, 5) * way / np.linalg.norm(way)
    return MarkerSet.make([f"P{k}" for k in case.primary], xyz, sigma=np.full(xyz.shape, SIGMA))


def wrong_views(case: scenes.Case, result: Reconstruction) -> list[str]:
    """Views whose pose images the true markers elsewhere."""
    out = []
    cov = {v.name: c for v, c in zip(result.calibration.views, result.calibration.pose_cov, strict=True)}
    for v, view in enumerate(result.views):
        if view.cam_from_model is None:
            continue
        true = Pose(case.poses.rotation[v], case.poses.translation[v])
        seen = case.labels[v][case.labels[v] >= 0]
        xyz = case.xyz[seen] if len(seen) else case.xyz
        camera = next(iter(result.cameras.values()))
        off = camera.project(view.cam_from_model.apply(xyz))[0] - case.camera.project(true.apply(xyz))[0]
        delta = (true @ view.cam_from_model.inverse()).log()
        far = float(delta @ np.linalg.solve(cov[view.name], delta)) > BEYOND_6D
        if len(seen) < 4 or (far and not np.sqrt(np.nanmean((off**2).sum(axis=1))) <= VIEW_PX):
            out.append(view.name)
    return out


def wrong_markers(case: scenes.Case, result: Reconstruction) -> float:
    """Part of the markers that is more than six stated sigmas from every true marker's place."""
    gap = result.markers.xyz[:, None] - case.xyz[None]
    squared = np.einsum("nmi,nij,nmj->nm", gap, np.linalg.inv(result.marker_cov), gap).min(axis=1)
    return float((squared > BEYOND_3D).mean())


def trial(kind: str, seed: int) -> tuple[str, str]:
    """One scene: its outcome, and what is to be known of it."""
    rng = np.random.default_rng([seed, *kind.encode()])
    case = KINDS[kind](rng)
    result = reconstruct(case.detections, case.camera, _primaries(case, rng, kind))
    if isinstance(result, NotReconstructed):
        return f"refused: {result.cause}", result.reason
    views, part = wrong_views(case, result), wrong_markers(case, result)
    said = [*result.warnings, *result.suspect, *result.dropped]
    posed = sum(v.cam_from_model is not None for v in result.views)
    words = f"{len(views)} of {posed} views, {100 * part:.1f} % of {len(result.markers)} markers wrong; {said[:3]}"
    if views or part > MARKERS_PART:
        return ("named" if said else "WRONG"), words
    alarm = kind in FAULTLESS and (result.warnings or result.suspect)
    return ("alarm" if alarm else "right"), f"{posed} of {len(result.views)} views; {said[:3]}"


def main() -> dict[str, Counter[str]]:
    """Measure, print one table, return its rows."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("trials", nargs="?", type=int, default=TRIALS)
    ask.add_argument("kinds", nargs="*", default=[], metavar="KIND", help=", ".join(KINDS))
    ask.add_argument("--seed", type=int, default=SEED)
    ask.add_argument("--say", action="store_true", help="print every trial")
    given = ask.parse_args()
    rows: dict[str, Counter[str]] = {}
    for kind in given.kinds or KINDS:
        rows[kind] = Counter()
        for seed in range(given.seed, given.seed + given.trials):
            outcome, words = trial(kind, seed)
            rows[kind][outcome] += 1
            if given.say or outcome in ("WRONG", "alarm"):
                print(f"    {kind}/{seed}: {outcome}: {words}", flush=True)
        print(f"{kind:12s} " + ", ".join(f"{n} {what}" for what, n in sorted(rows[kind].items())), flush=True)
    return rows


if __name__ == "__main__":
    main()
