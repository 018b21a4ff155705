"""Dot boards without a coordinate list: indices right, missing, wrong; and a focal length from nothing.

Virtual boards: tilt up to 60 degrees, 10 to 30 px of distortion at the corners, a fifth of the dots missing, half as
many false spots as dots (sizes like dots; where a dot is missing, too), seen whole or in part, roll at will, no marks.
An index is right if it is that of the board after one turn and shift of the whole picture. "false": spots that are no
dots but have an index; most lie where a missing dot would be, the last column says how far off at worst, in spacings.

Real boards: dots that windmark itself detected, indices against tables that do not come from it.
Times are CPU time of `find_board` and `start_focal` alone.
"""

from __future__ import annotations

import time
from collections import Counter
from itertools import islice
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from _real_truth import DATA, SETS, View
from _reference import label_lattice
from windmark import detect
from windmark.calibration import BoardView, find_board, start_focal
from windmark.calibration.board.axes import symmetries
from windmark.geometry import Camera
from windmark.scene import Detections
from windmark.synth import BoardSpots, board_spots

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SEEDS = 700_000
SIZES = ((7, 5), (9, 9), (12, 9), (30, 20), (60, 60))
FILLS = (0.6, 0.9, 1.3)
DICE_MARKS = ((0, 0), (5, 0), (0, -3))  # the source counts rows upwards
DICE_BLOCK = 4  # pixels averaged to one: discs of 12 px are plenty
FOCAL_CASES = (  # name, pictures, largest tilt, share of wrong labels
    ("20 pictures, tilt to 40 deg", 20, 40.0, 0.0),
    ("20 pictures, 20 % wrong labels", 20, 40.0, 0.2),
    ("5 pictures, tilt to 40 deg", 5, 40.0, 0.0),
    ("1 picture, tilt to 50 deg", 1, 50.0, 0.0),
    ("20 pictures, tilt to 5 deg", 20, 5.0, 0.0),
    ("20 pictures, face-on", 20, 0.0, 0.0),
)


def main(quick: bool = False) -> dict:
    return {
        "virtual": virtual(4 if quick else 40),
        "no board": nothing(20 if quick else 100),
        "real": real(2 if quick else 28),
        "focal": focal(2 if quick else 15),
    }


def virtual(views: int) -> dict:
    print(f"{views} pictures of each board")
    print("   board    dots    right  wrong  false  refused   CPU s   worst  false dot off")
    figures = {}
    for size in SIZES:
        dots, right, wrong, off, seconds, refused = 0, 0, 0, [], [], Counter()
        for k in range(views):
            rng = np.random.default_rng(SEEDS + 1000 * size[0] + k)
            made = board_spots(rng, *size, fill=FILLS[k % 3], corner_px=rng.uniform(10, 30))
            view, took = timed(made.detections, size_px=made.camera.size_px)
            seconds.append(took)
            dots += int((made.cell[:, 0] >= 0).sum())
            if not isinstance(view, BoardView):
                refused[view.cause] += 1
                continue
            got = against_truth(made, view)
            right, wrong, off = right + got[0], wrong + got[1], off + got[2]
        name = f"{size[0]} x {size[1]}"
        figures[name] = {
            "dots": dots, "right": right, "wrong": wrong, "false": len(off), "refused": dict(refused),
            "cpu_s": float(np.median(seconds)), "cpu_worst_s": max(seconds),
            "false_off": sorted(round(x, 2) for x in off),
        }  # fmt: skip
        print(f"{name:>8} {dots:7d} {right / dots:8.2%} {wrong:6d} {len(off):6d} {refused.total():8d} "
              f"{np.median(seconds):7.3f} {max(seconds):7.3f} {max(off, default=0):14.2f}")  # fmt: skip
    return figures


def timed(spots: Detections, **options: object) -> tuple[object, float]:
    start = time.process_time()
    view = find_board(spots, **options)
    return view, time.process_time() - start


def against_truth(made: BoardSpots, view: BoardView) -> tuple[int, int, list[float]]:
    """Right and wrong dots, and how far false spots are from the place of their index, in spacings (1: no such dot)."""
    true, index = made.cell[view.spot], np.stack([view.column, view.row], axis=1)
    dot = true[:, 0] >= 0
    best = None
    for turn in symmetries(1.0):
        shifts, count = np.unique(true[dot] - index[dot] @ turn.T, axis=0, return_counts=True)
        if best is None or count.max() > best[0]:
            best = int(count.max()), turn, shifts[np.argmax(count)]
    right, turn, shift = best
    rows, columns = made.places.shape[:2]
    off = []
    for cell, spot in zip((index @ turn.T + shift)[~dot], view.spot[~dot], strict=True):
        inside = 0 <= cell[0] < columns and 0 <= cell[1] < rows
        place = made.places[cell[1], cell[0]] if inside else np.full(2, np.nan)
        spacing = np.nanmedian(np.hypot(*np.diff(made.places, axis=1).reshape(-1, 2).T))
        away = np.hypot(*(made.detections.xy[spot] - place)) / spacing
        off.append(float(away) if np.isfinite(away) else 1.0)
    return right, int(dot.sum()) - right, off


def nothing(pictures: int) -> dict:
    causes: Counter[str] = Counter()
    for k in range(pictures):
        rng = np.random.default_rng(SEEDS + 500_000 + k)
        spots = rng.uniform(0, 2000, (int(np.exp(rng.uniform(np.log(10), np.log(5000)))), 2))
        got = find_board(Detections.make(spots))
        causes["accepted" if got else got.cause] += 1
    print(f"\n{pictures} pictures of 10 to 5000 false spots only: {dict(causes)}")
    return dict(causes)


def real(pictures: int) -> dict:
    print("\nset             pictures  found  dots of the table  on a cell  right  wrong")
    figures = {}
    for name in ("DICe discs", "CSP dot wall", "PIV-E plate"):
        if not (DATA / SETS[name].folder).is_dir():
            print(f"{name:15} absent")
            continue
        total = Counter()
        for view in islice(SETS[name].views(DATA / SETS[name].folder), pictures):
            total += real_view(name, view)
        figures[name] = dict(total)
        print(f"{name:15} {total['pictures']:8d} {total['found']:6d} {total['dots']:18d} {total['on']:10d} "
              f"{total['right']:6d} {total['wrong']:6d}")  # fmt: skip
    return figures


def real_view(name: str, view: View) -> Counter[str]:
    """Counts of one picture: dots of the table, those on a cell of the lattice, right and wrong indices."""
    if name == "DICe discs":
        places, cells = dice_truth(view)
        spots, holes = dice_spots(view.image)
        got = find_board(spots, marks=DICE_MARKS, mark_spots=holes, size_px=view.image.shape[::-1])
        fixed = bool(got) and got.freedom == ()
    else:
        places, cells = wall_truth(view) if name == "CSP dot wall" else plate_truth(view)
        spots = detect(view.image, radius_px=SETS[name].radius_px, polarity=view.polarity)
        # Both levels of the plate together are staggered.
        layout = "square" if name == "CSP dot wall" else "staggered"
        got, fixed = find_board(spots, layout=layout, size_px=view.image.shape[::-1]), False
    count: Counter[str] = Counter(pictures=1, found=int(bool(got)), dots=len(places))
    if isinstance(got, BoardView):
        gap = np.hypot(*(spots.xy[got.spot][:, None] - places).transpose(2, 0, 1))
        on = gap.min(axis=1) < max(view.gate_px, 3.0)
        index, true = np.stack([got.column, got.row], axis=1)[on], cells[gap.argmin(axis=1)[on]]
        right = int((index == true).all(axis=1).sum()) if fixed else same_up_to_a_move(index, true)
        count.update(on=int(on.sum()), right=right, wrong=int(on.sum()) - right)
    return count


def same_up_to_a_move(index: Ints, true: Ints) -> int:
    """Most indices that one affine map takes to the true ones; maps are drawn from triplets."""
    rng, design, best = np.random.default_rng(0), np.column_stack([index, np.ones(len(index))]), 0
    for _ in range(200):
        three = rng.choice(len(index), 3, replace=False)
        if abs(np.linalg.det(design[three])) > 0.5:
            fit = design @ np.linalg.solve(design[three], true[three])
            best = max(best, int((np.abs(fit - true) < 1e-6).all(axis=1).sum()))
    return best


def dice_spots(image: NDArray) -> tuple[Detections, Detections]:
    """Discs, and the light holes of the three ring discs, of the picture at a quarter of its size; full pixels."""
    height, width = (n // DICE_BLOCK * DICE_BLOCK for n in image.shape)
    small = image[:height, :width].reshape(height // DICE_BLOCK, DICE_BLOCK, width // DICE_BLOCK, DICE_BLOCK)
    small = small.mean(axis=(1, 3))
    found = [detect(small, radius_px=12.0), detect(small, radius_px=4.2, polarity="bright")]
    dots, holes = (
        Detections.make(d.xy * DICE_BLOCK + (DICE_BLOCK - 1) / 2, radius_px=d.radius_px * DICE_BLOCK) for d in found
    )
    return dots, holes


def dice_truth(view: View) -> tuple[Array, Ints]:
    """Places and indices of the whole discs; thresholded regions on one lattice, the three ring discs as marks."""
    places = np.concatenate([view.true, view.other[:3]])
    label = label_lattice(places)
    found = []
    for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        rings = label[-3:][list(order)]
        steps = rings[1:] - rings[0]
        turn = np.linalg.solve(steps, np.array(DICE_MARKS[1:])) if np.linalg.det(steps) else np.zeros((2, 2))
        if np.allclose(turn @ turn.T, np.eye(2)) and np.linalg.det(turn) > 0:
            found.append(np.rint((label - rings[0]) @ turn).astype(np.int64))
    if len(found) != 1:
        raise ValueError(f"{view.name}: the ring discs fit {len(found)} ways, expected one")
    return places, found[0]


def wall_truth(view: View) -> tuple[Array, Ints]:
    table = np.loadtxt(DATA / SETS["CSP dot wall"].folder / "dots_expected.csv", delimiter=",", skiprows=1)
    return view.true, table[:, :2].astype(np.int64)


def plate_truth(view: View) -> tuple[Array, Ints]:
    """The listed discs (one level of the plate), 15 mm apart: two half spacings."""
    path = DATA / SETS["PIV-E plate"].folder / f"camera{view.name[7]}" / f"img_{int(view.name[-1]) - 1}.xml"
    rows = np.array([e.text.split() for e in ElementTree.parse(path).iter("PointCoord")], dtype=float)
    return rows[:, 3:5] - 1, np.rint(rows[:, :2] / 0.75).astype(np.int64)


def focal(cases: int) -> dict:
    print(f"\nfocal length of {cases} cameras each (0.8 to 5 widths, 12 px of distortion, principal point off by 1 %)")
    print(f"{'case':32} {'known':>6} {'refused':>8} {'median error':>13} {'worst':>7} {'rms/sigma':>10} {'CPU s':>7}")
    figures = {}
    for name, pictures, tilt, wrong in FOCAL_CASES:
        error, normal, seconds, refused = [], [], [], 0
        for k in range(cases):
            rng = np.random.default_rng(SEEDS + 900_000 + k)
            camera, views = focal_views(rng, pictures, tilt, wrong)
            start = time.process_time()
            got = start_focal(views, camera.size_px)
            seconds.append(time.process_time() - start)
            refused += not got
            if got:
                error.append(abs(got.focal_px / camera.focal_px - 1))
                normal.append((got.focal_px - camera.focal_px) / got.sigma_px)
        figures[name] = {
            "known": len(error), "refused": refused, "errors": [round(e, 5) for e in sorted(error)],
            "rms_by_sigma": float(np.sqrt(np.mean(np.square(normal)))) if error else None,
            "cpu_s": float(np.median(seconds)),
        }  # fmt: skip
        said = (
            f"{np.median(error):13.3%} {max(error):7.2%} {np.sqrt(np.mean(np.square(normal))):10.2f}"
            if error
            else f"{'-':>13} {'-':>7} {'-':>10}"
        )
        print(f"{name:32} {len(error):6d} {refused:8d} {said} {np.median(seconds):7.2f}")
    return figures


def focal_views(rng: np.random.Generator, pictures: int, tilt: float, wrong: float) -> tuple[Camera, list]:
    """Pictures of a 12 x 9 board by one camera, a tenth of the dots missing, labels of a share exchanged."""
    size = (2000, 1500)
    focal_px = float(size[0] * np.exp(rng.uniform(np.log(0.8), np.log(5))))
    corner = np.hypot(*size) / 2 / focal_px
    centre = rng.normal(0, 0.01, 2) * size
    camera = Camera(
        size, focal_px, cx=999.5 + centre[0], cy=749.5 + centre[1],
        k1=float(rng.choice([-1, 1])) * 12 / focal_px / corner**3,
    )  # fmt: skip
    views = []
    for _ in range(pictures):
        made = board_spots(
            rng, 12, 9, size_px=size, focal_px=focal_px, max_tilt_deg=tilt, missing=0.1, clutter=0.0, fill=0.8
        )
        xyz = np.column_stack([made.cell - [5.5, 4.0], np.zeros(len(made.cell))])
        xy, valid = camera.project(made.cam_from_board.apply(xyz))
        valid &= camera.in_image(xy)
        xyz, xy = xyz[valid], xy[valid] + rng.normal(0, 0.1, (int(valid.sum()), 2))
        out = np.flatnonzero(rng.random(len(xy)) < wrong)
        xy[out] = xy[rng.permutation(out)]
        views.append((xyz, xy))
    return camera, views


if __name__ == "__main__":
    main()
