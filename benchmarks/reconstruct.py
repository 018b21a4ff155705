"""Unknown markers over many pictures: how many are found, how well, and in what time, beside COLMAP.

The paper's case (AIAA 2005-5007, section VI): 25 pictures, 100 markers of which six are known to 0.02 mm, 10 % of the
spots missing, 10 % false, noise 0.1 px, no labels and no poses; a nearly flat plate, and a wing with body before walls
that hide each other; pictures 5 to 12 degrees apart along a path, or from anywhere in any order. Then 50 pictures, 150
markers. Judged: every marker in three or more pictures found, links to other markers, tracks of false spots, RMS of the
coordinates over the Cramér-Rao bound of the true links, share of the markers in their 95 % ellipsoids. CPU times after
compilation; COLMAP's incremental mapping gets the *true* matches and has to verify them and to find poses and points.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network import Network, NetworkProblem, NetworkState
from windmark.adjust.network.covariance import network_covariance
from windmark.adjust.network.datum import in_datum
from windmark.scene import MarkerSet
from windmark.tasks.reconstruct import NotReconstructed, Reconstruction, reconstruct

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "epipolar"))
import reconstruct_scenes as scenes

Array = NDArray[np.float64]

FIRST_SEED = 1_060_000
SIGMA = 0.02
CELLS = (("plate", "walk"), ("plate", "cloud"), ("model", "walk"), ("model", "cloud"))
LIMIT_95 = 7.815
"""95 % of chi-square with three degrees of freedom are below."""
COLMAP_SHARE = 5
"""One of so many cases is given to COLMAP, too."""


def primaries(case: scenes.Case, seed: int) -> MarkerSet:
    """Six markers, known to `SIGMA`."""
    xyz = case.xyz[case.primary] + np.random.default_rng(seed).normal(0, SIGMA, (len(case.primary), 3))
    return MarkerSet.make([f"P{k}" for k in case.primary], xyz, sigma=np.full(xyz.shape, SIGMA))


def bound(case: scenes.Case) -> tuple[Array, Array]:
    """(N,) markers of the case with two views, and (N, 3, 3) their covariances from all true links."""
    kept = np.flatnonzero(case.views_of >= 2)
    row = np.full(len(case.xyz), -1)
    row[kept] = np.arange(len(kept))
    links = [(v, s, m) for v, label in enumerate(case.labels) for s, m in enumerate(label) if m >= 0 and row[m] >= 0]
    view, point = np.array([k[0] for k in links]), row[[k[2] for k in links]]
    xy = np.stack([case.detections[v].xy[s] for v, s, _ in links])
    cov = np.stack([case.detections[v].cov[s] for v, s, _ in links])
    sigma = np.full((len(kept), 3), np.inf)
    sigma[row[case.primary]] = SIGMA
    views = len(case.detections)
    network = Network(
        view, point, xy, cov, np.zeros(views, int), np.arange(views), np.full(views, -1), ((),), np.ones(views, bool),
        np.zeros((len(kept), 3), bool), point_value=case.xyz[kept], point_sigma=sigma,
    )  # fmt: skip
    state = NetworkState((case.camera,), case.poses, case.xyz[kept])
    problem = NetworkProblem(network, state)
    system = problem.linearise(state)
    assert system is not None
    return kept, in_datum(network_covariance(system, problem.layout)).points()


def judged(case: scenes.Case, result: Reconstruction) -> dict[str, float]:
    """One case against the truth."""
    tracks = result.tracks
    label = np.array([case.labels[v][s] for v, s in zip(tracks.view, tracks.detection, strict=True)])
    who = np.full(len(result.markers), -1)
    wrong = 0
    for k in range(len(who)):
        mine = label[tracks.track == k]
        names, votes = np.unique(mine, return_counts=True)
        who[k] = names[votes.argmax()]
        wrong += int((mine != who[k]).sum())
    wanted = np.flatnonzero(case.views_of >= 3)
    kept, cov = bound(case)
    right = np.flatnonzero(np.isin(who, kept))
    error = result.markers.xyz[right] - case.xyz[who[right]]
    index = np.searchsorted(kept, who[right])
    inside = np.einsum("ni,nij,nj->n", error, np.linalg.inv(result.marker_cov[right]), error) < LIMIT_95
    return {
        "views": sum(v.cam_from_model is not None for v in result.views),
        "wanted": len(wanted),
        "missing": len(np.setdiff1d(wanted, who)),
        "links": len(label),
        "wrong_links": wrong,
        "false_tracks": int((who < 0).sum() + len(who) - len(np.unique(who))),
        "squared": float((error**2).sum()),
        "bound": float(np.trace(cov[index], axis1=1, axis2=2).sum()),
        "inside": int(inside.sum()),
        "markers": len(right),
    }


def main(quick: bool = False, count: int = 20) -> dict[str, dict[str, float]]:
    """Measure, print one table, return its rows."""
    count = 1 if quick else count
    figures: dict[str, dict[str, float]] = {}
    print(f"{'':28s} cases  found  pictures  missing  wrong links  false tracks  rms/CRLB  in 95 %    time  COLMAP")
    for model, path in CELLS:
        made = [(s, scenes.make(s, model, path)) for s in range(FIRST_SEED, FIRST_SEED + count)]
        figures[f"{model}, {path}"] = _row(f"25 x 100 {model}, {path}", made)
    if not quick:
        big = [(s, scenes.make(s, "model", "walk", views=50, points=150)) for s in range(FIRST_SEED, FIRST_SEED + 5)]
        figures["50 x 150"] = _row("50 x 150 model, walk", big)
    return figures


def _row(name: str, made: list[tuple[int, scenes.Case]]) -> dict[str, float]:
    seen, seconds, colmap = [], [], []
    for seed, case in made:
        start = time.process_time()
        result = reconstruct(case.detections, case.camera, primaries(case, seed))
        seconds.append(time.process_time() - start)
        if isinstance(result, NotReconstructed):
            print(f"    seed {seed}: {result.cause}: {result.reason}", flush=True)
        else:
            seen.append({**judged(case, result), "of": len(case.detections)})
        if (seed - FIRST_SEED) % COLMAP_SHARE == 0:
            colmap.append(_colmap(case))
    total = {key: float(sum(s[key] for s in seen)) for key in seen[0]}
    row = {
        "cases": len(made), "found": len(seen), "missing": total["missing"], "wanted": total["wanted"],
        "wrong_links": total["wrong_links"], "links": total["links"], "false_tracks": total["false_tracks"],
        "rms_over_bound": float(np.sqrt(total["squared"] / total["bound"])),
        "inside_percent": 100 * total["inside"] / total["markers"], "median_s": float(np.median(seconds)),
        "colmap_s": float(np.median([c[0] for c in colmap])), "colmap_views": float(np.mean([c[1] for c in colmap])),
    }  # fmt: skip
    print(f"{name:28s} {row['cases']:5.0f} {row['found']:6.0f}  {total['views']:4.0f}/{total['of']:4.0f}"
          f"  {row['missing']:3.0f}/{row['wanted']:4.0f}  {row['wrong_links']:3.0f}/{row['links']:7.0f}"
          f"  {row['false_tracks']:12.0f}  {row['rms_over_bound']:8.3f}  {row['inside_percent']:5.1f}%"
          f"  {row['median_s']:5.2f}s  {row['colmap_s']:5.2f}s ({row['colmap_views']:.0f} pictures)",
          flush=True)  # fmt: skip
    return row


def _colmap(case: scenes.Case) -> tuple[float, int]:
    """CPU seconds of COLMAP's verification and incremental mapping with the true matches, and its pictures."""
    import pycolmap

    with tempfile.TemporaryDirectory() as folder, _quiet():
        pycolmap.logging.minloglevel = 3
        path = Path(folder) / "database.db"
        pairs = _colmap_database(case, path)
        (Path(folder) / "pairs.txt").write_text("\n".join(f"{a} {b}" for a, b in pairs))
        start = time.process_time()
        pycolmap.verify_matches(path, Path(folder) / "pairs.txt")
        options = pycolmap.IncrementalPipelineOptions(
            ba_refine_focal_length=False, ba_refine_principal_point=False, ba_refine_extra_params=False, num_threads=1,
            min_model_size=3,
        )  # fmt: skip
        found = pycolmap.incremental_mapping(path, folder, Path(folder) / "out", options)
        seconds = time.process_time() - start
        return seconds, max((m.num_reg_images() for m in found.values()), default=0)


def _colmap_database(case: scenes.Case, path: Path) -> list[tuple[str, str]]:
    """Cameras, images, spots and true matches; the names of the pairs."""
    import pycolmap

    c, names = case.camera, [f"{v:03d}.png" for v in range(len(case.detections))]
    with pycolmap.Database.open(path) as database:
        camera = pycolmap.Camera(
            model="OPENCV", width=c.size_px[0], height=c.size_px[1],
            params=[c.focal_px, c.focal_px * c.aspect, c.cx + 0.5, c.cy + 0.5, c.k1, c.k2, c.p1, c.p2],
        )  # fmt: skip
        camera.has_prior_focal_length = True
        key = database.write_camera(camera)
        images = [database.write_image(pycolmap.Image(name=n, camera_id=key)) for n in names]
        for image, spots in zip(images, case.detections, strict=True):
            database.write_keypoints(image, (spots.xy + 0.5).astype(np.float32))
        pairs = []
        for a in range(len(names)):
            for b in range(a + 1, len(names)):
                common, in_a, in_b = np.intersect1d(case.labels[a], case.labels[b], return_indices=True)
                good = common >= 0
                if good.sum() >= 15:
                    matches = np.stack([in_a[good], in_b[good]], axis=1).astype(np.uint32)
                    database.write_matches(images[a], images[b], matches)
                    pairs.append((names[a], names[b]))
    return pairs


@contextmanager
def _quiet() -> Iterator[None]:
    """COLMAP's log goes nowhere."""
    import os

    keep, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(keep, 2)
        os.close(keep)
        os.close(nowhere)


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    main("--quick" in sys.argv, *numbers)
