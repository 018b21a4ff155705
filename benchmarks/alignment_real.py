"""2D alignment of real pictures: held-out markers, and how much of it parallax explains.

PIV-E plate     two-level plate moved towards the camera in steps of 1 mm; camera 1 faces it, camera 3 looks 20 degrees
                off. The levels are 3 mm apart, so they shift against each other. That is estimated from the pictures:
                a kind with one more displacement for the discs of one level, which level being what the published list
                of one level's discs says; what it lowers the held-out residual by is parallax of the two levels
frame sway      a swaying building model of four rows of seven discs, each row a bar that moves by its own amount:
                held-out residual when each row has a shift, a scale and its gradient of its own
DICe discs      a flat printed board in poses that differ by up to some hundred pixels: no parallax, but a lens and
                perspective. It is regular, so the constellation alone is refused; the discs are named by their
                place on the board (`calibration.find_board`)

Every figure is the root mean square length of held-out residuals, pixels; the last column is what the detector states
for a pair of spots (1 sigma, both coordinates of both).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

import windmark as wm
from boards import DICE_MARKS, dice_spots
from windmark import io
from windmark.calibration import BoardView, find_board
from windmark.scene import Detections

Array = NDArray[np.float64]

DATA = Path(__file__).parents[1].parent / "shared" / "data"


@dataclass(frozen=True)
class Row:
    """One picture: what became of it, and its held-out residual with what is not smooth taken into account."""

    name: str
    answer: wm.ImageAlignment | wm.NotAligned
    without_parallax_px: float


def piv(folder: Path, camera: str, steps: tuple[int, ...] = (1, 2, 3, 5, 6, 7)) -> Iterator[Row]:
    """The plate at z = 0 (picture 4) against the other positions."""
    pictures = sorted((folder / "piv-challenge-e-calib" / camera).glob("*.tif"))
    reference = io.read_grey(pictures[3])
    base = wm.detect(reference, polarity="bright")
    listed = _listed(folder / "piv-challenge-e-calib" / camera)
    level = np.array([np.hypot(*(listed - xy).T).min() < 6 for xy in base.xy])
    for step in steps:
        image = io.read_grey(pictures[step - 1])
        answer = wm.align_images(image, reference, reference_detections=base, polarity="bright")
        yield Row(pictures[step - 1].stem, answer, _two_levels(answer, level) if answer else float("nan"))


def sway(folder: Path, every: int = 8) -> Iterator[Row]:
    """The building at rest against moved ones."""
    pictures = sorted((folder / "frame-sway-1cam" / "images").glob("*.jpg"))
    reference = io.read_grey(pictures[0])
    base = wm.detect(reference, radius_px=(8, 10))
    for path in pictures[1::every]:
        image = io.read_grey(path)
        answer = wm.align_images(image, reference, reference_detections=base, radius_px=(8, 10))
        yield Row(path.stem, answer, _rows(answer) if answer else float("nan"))


def dice(folder: Path, most: int = 6) -> Iterator[Row]:
    """The first left picture of the board against the next ones; discs named by their place on the board."""
    pictures = sorted((folder / "dice-stereo-dots" / "images").glob("*_0.jp*g"))[: most + 1]
    named = [_board(io.read_grey(p)) for p in pictures]
    blank = np.zeros((2048, 2448), np.float32)
    spots, cells = named[0]
    for path, (found, there) in zip(pictures[1:], named[1:], strict=True):
        pairs = np.array([(cells[c], there[c]) for c in cells if c in there])
        answer = wm.align_images(blank, blank, detections=found, reference_detections=spots, pairs=pairs)
        yield Row(path.stem, answer, float("nan"))


def _board(image: NDArray[np.generic]) -> tuple[Detections, dict[tuple[int, int], int]]:
    """Spots, and which is the disc of each column and row; the three discs with a hole give the origin."""
    spots, holes = dice_spots(image)
    view = find_board(spots, marks=DICE_MARKS, mark_spots=holes, size_px=image.shape[::-1])
    if not isinstance(view, BoardView):
        raise SystemExit(f"alignment_real: {view.reason}")
    cells = zip(view.column.tolist(), view.row.tolist(), strict=True)
    return spots, dict(zip(cells, view.spot.tolist(), strict=True))


def _listed(folder: Path) -> Array:
    """Pixels of the discs of one level at z = 0, 0-based; the lists hold to about a pixel."""
    root = ElementTree.parse(sorted(folder.glob("*.xml"))[3]).getroot()
    rows = [(element.text or "").split() for element in root.iter("PointCoord")]  # x, y, z (cm), column, row, from 1
    return np.array([[float(v) - 1 for v in row[3:5]] for row in rows])


def _two_levels(answer: wm.ImageAlignment, level: NDArray[np.bool_]) -> float:
    """Held-out residual of an affine map with one more displacement for the discs of one level, in closed form."""
    x, y = answer.reference_xy, answer.image_xy
    on = level[answer.pairs[:, 0]]
    a = np.column_stack([np.ones(len(x)), x - x.mean(axis=0), on.astype(float)])
    if np.linalg.matrix_rank(a) < 4 or min(on.sum(), (~on).sum()) < 3:
        return float("nan")
    q, _ = np.linalg.qr(a)
    hat = q @ q.T
    held = (y - hat @ y) / (1 - np.diag(hat))[:, None]
    return float(np.sqrt((held**2).sum(axis=1).mean()))


def _rows(answer: wm.ImageAlignment) -> float:
    """Held-out residual when each of the four rows has a shift, a scale and its gradient along the row of its own."""
    order = np.argsort(answer.reference_xy[:, 1])
    heights = answer.reference_xy[order, 1]
    breaks = np.sort(np.argsort(np.diff(heights))[-3:]) + 1
    square = []
    for part in np.split(order, breaks):
        if len(part) > 4:
            x, y = answer.reference_xy[part], answer.image_xy[part]
            along = (x[:, 0] - x[:, 0].mean()) / np.ptp(x[:, 0])
            q, _ = np.linalg.qr(np.column_stack([np.ones(len(x)), along, along**2]))
            hat = q @ q.T
            move = y - x
            square.append((((move - hat @ move) / (1 - np.diag(hat))[:, None]) ** 2).sum(axis=1))
    return float(np.sqrt(np.concatenate(square).mean()))


def main(quick: bool = False) -> dict[str, object]:
    """Align, print the table, return its rows."""
    if not DATA.is_dir():
        print(f"{DATA} is absent: real-data benchmarks need ../shared/data")
        return {}
    sets = {
        "PIV-E camera 1": piv(DATA, "camera1", (1, 7) if quick else (1, 2, 3, 5, 6, 7)),
        "PIV-E camera 3": piv(DATA, "camera3", (1, 7) if quick else (1, 2, 3, 5, 6, 7)),
        "frame sway": sway(DATA, 20 if quick else 8),
        "DICe discs": dice(DATA, 2 if quick else 6),
    }
    out: dict[str, object] = {}
    heads = (("pairs", 6), ("motion", 8), ("kind", 12), ("affine", 9), ("held out", 10), ("parallax gone", 15),
             ("spots sigma", 13))  # fmt: skip
    print(f"{'set':<16}{'picture':<18}" + "".join(f"{word:>{width}}" for word, width in heads))
    for name, rows in sets.items():
        mine = []
        for row in rows:
            a = row.answer
            if not a:
                print(f"{name:<16}{row.name:<18}{a.cause}: {a.reason[:60]}")
                mine.append({"picture": row.name, "refused": a.cause})
                continue
            affine = next(t.fit for t in a.trials if t.kind == "affine")
            motion = float(np.hypot(*a.shift_px.T).max())
            both = a.image_spots.cov[a.pairs[:, 1]] + a.reference_spots.cov[a.pairs[:, 0]]
            sigma = float(np.sqrt(np.trace(both, axis1=1, axis2=2).mean()))  # 2-D, of a pair
            print(f"{name:<16}{row.name:<18}{len(a.pairs):>6}{motion:>8.1f}{a.kind:>12}"
                  f"{affine.held_out_px if affine else float('nan'):>9.3f}{a.held_out_px:>10.3f}"
                  f"{row.without_parallax_px:>15.3f}{sigma:>13.3f}", flush=True)  # fmt: skip
            mine.append({"picture": row.name, "pairs": len(a.pairs), "kind": a.kind, "held_out_px": a.held_out_px,
                         "without_parallax_px": row.without_parallax_px, "spots_sigma_px": sigma})  # fmt: skip
        out[name] = mine
    return out


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
