"""The verb `windmark epipolar`: the geometry of two pictures from a few matches by hand; with cameras all matches."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.patheffects import withStroke

from windmark import io
from windmark.app import console
from windmark.app.alone import not_drawn, write_png
from windmark.app.epipolar_pictures import PairWords, pair_picture
from windmark.app.epipolar_report import Pair, epipolar_page
from windmark.app.pictures import MISSING
from windmark.app.progress import progress
from windmark.app.verdict_words import verdict_lines
from windmark.errors import UsageError
from windmark.geometry import Camera
from windmark.pipeline.calibrate import MatchOptions
from windmark.pipeline.calibrate.read import find_spots, picture_names, read_image
from windmark.pipeline.clicks import read_clicks
from windmark.pipeline.verdict.pair import pair_verdict
from windmark.scene import Detections
from windmark.tasks.clicked_pair import ClickedPair, Clicks, clicked_pair, lines_of, relabelled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Record = dict[str, Any]

SPOTS = PairWords("match", "matches", "spot without a match", "")
WHY_NONE = ("the other spots are matched only with --camera: which of the spots on a line is meant, nothing tells "
            "without one")  # fmt: skip


def run(
    images: tuple[Path, Path], table: Path, cameras: tuple[Path, ...], sigma_px: float | None, match: MatchOptions,
    output: Path, as_json: bool,
) -> None:  # fmt: skip
    """Read, find the geometry, write a folder, say it."""
    if len(cameras) > 2:
        raise UsageError(f"--camera: expected one for both pictures or one for each, got {len(cameras)}")
    if sigma_px is not None and not 0 < sigma_px < np.inf:
        raise UsageError(f"--sigma-px must be positive, got {sigma_px:g}")
    names = tuple(picture_names(images))
    clicks = read_clicks(table, names)
    lenses = [console.read_lens(path) for path in cameras]
    both = (lenses[0], lenses[-1]) if lenses else None
    with progress() as show, console.result_folder(output) as out:
        grey, spots = [], []
        for k, (path, name) in enumerate(zip(images, names, strict=True)):
            show(f"detect {name}")
            image, mask = read_image(path, match)
            _check_size(path, image.shape, both[k] if both else None)
            grey.append(image)
            spots.append(find_spots(image, mask, match))
        show("match along the lines" if both else "fundamental matrix")
        pair = (spots[0], spots[1])
        result = clicked_pair(*pair, clicks, both, sigma_px=sigma_px, seed=match.seed)
        verdict = pair_verdict(result, clicks, pair, both)
        record = {**_record(result, clicks, (names[0], names[1]), pair), "verdict": verdict.record()}
        if not result:
            console.refuse("; ".join([result.reason, *result.notes]), as_json, record, verdict.next_step)
            return
        sizes = [(int(g.shape[1]), int(g.shape[0])) for g in grey]
        failed: list[str] = record.setdefault("not_drawn", [])

        lines = lines_of(result, clicks, (names[0], names[1]), pair, sizes, both)

        def draw() -> Figure:
            figure = pair_picture(lines, *grey, words=SPOTS)
            _mark_clicks(figure, result, clicks)
            return figure

        write_png(out.place / "epipolar.png", draw, failed)
        show("draw the report")
        shown = Pair(result, clicks, lines, grey, pair, both)
        page = epipolar_page(shown, verdict, out)
        (out.place / "report.html").write_text(page.html(), encoding="utf-8")
        failed += page.failed
        _write(out.place, result, clicks, (names[0], names[1]), pair, record)
    console.answer({**record, "folder": output}, as_json,
                   [*_lines(result, clicks, pair), *verdict_lines(verdict), *not_drawn(failed),
                    f"results: {output}", f"report: {output / 'report.html'}"])  # fmt: skip


def _mark_clicks(figure: Figure, result: ClickedPair, clicks: Clicks) -> None:
    """Wrong clicks as crosses, unchecked ones by a word."""
    for axes, place in zip(figure.axes, (result.click_a, result.click_b), strict=False):
        for which, word, colour, around in (
            (result.wrong, "wrong click", MISSING, "white"), (result.unchecked, "unchecked", "white", "black"),
        ):  # fmt: skip
            for name, xy in zip(np.array(clicks.name)[which], place[which], strict=True):
                if colour == MISSING:
                    axes.plot(*xy, "x", color=colour, ms=11, mew=2.2)
                axes.annotate(f"{word} {name}", xy, xytext=(8, -12), textcoords="offset points", color=colour,
                              fontsize=8, path_effects=[withStroke(linewidth=1.5, foreground=around)])  # fmt: skip


def _check_size(path: Path, shape: tuple[int, ...], camera: Camera | None) -> None:
    if camera is not None and (shape[1], shape[0]) != tuple(camera.size_px):
        raise io.FileError(path, f"is {shape[1]} x {shape[0]} px, but its camera {camera.size_px[0]} x "
                           f"{camera.size_px[1]}")  # fmt: skip


def _write(
    folder: Path, result: ClickedPair, clicks: Clicks, names: tuple[str, str], spots: tuple[Detections, Detections],
    record: Record,
) -> None:  # fmt: skip
    a, b = spots[0].xy[result.spot_a], spots[1].xy[result.spot_b]
    io.write_table(folder / "matches.csv", {
        "x_a": a[:, 0], "y_a": a[:, 1], "x_b": b[:, 0], "y_b": b[:, 1], "distance_px": result.distance_px,
        "by_hand": result.by_hand.astype(int),
    })  # fmt: skip
    io.write_table(folder / "clicks.csv", {
        "name": np.array(clicks.name), "x_a": result.click_a[:, 0], "y_a": result.click_a[:, 1],
        "x_b": result.click_b[:, 0], "y_b": result.click_b[:, 1], "distance_px": result.click_px,
        "wrong": result.wrong.astype(int), "checked": (~result.wrong & ~result.unchecked).astype(int),
        "shows_px": result.shows_px,
    })  # fmt: skip
    io.write_table(folder / "labels.csv", relabelled(result, clicks, names, spots))
    io.write_json(folder / "geometry.json", record)


def _record(
    result: ClickedPair, clicks: Clicks, names: tuple[str, str], spots: tuple[Detections, Detections]
) -> Record:
    if not result:
        return {"determined": False, "reason": result.reason, "images": list(names), "clicks": len(clicks.name)}
    estimate, pose = result.estimate, result.pose
    rms = float(np.sqrt((result.distance_px**2).mean()))
    return {
        "determined": True, "images": list(names), "spots": [len(s) for s in spots], "clicks": len(clicks.name),
        "wrong_clicks": [n for n, bad in zip(clicks.name, result.wrong, strict=True) if bad],
        "unchecked_clicks": [n for n, bad in zip(clicks.name, result.unchecked, strict=True) if bad],
        "matches": len(result.spot_a), "by_hand": int(result.by_hand.sum()), "rms_px": rms, "sigma0": result.sigma0,
        "fundamental": result.fundamental, "pixels": "without lens distortion" if pose is not None else "as taken",
        "fundamental_cov": None if estimate is None else estimate.cov,
        "epipole_first_px": result.epipole_a, "epipole_second_px": result.epipole_b,
        "epipole_first_cov": None if estimate is None else estimate.cov_a,
        "epipole_second_cov": None if estimate is None else estimate.cov_b,
        "second_from_first": None if pose is None else {"rotation": pose.rotation, "translation": pose.translation},
        "second_from_first_cov": result.pose_cov, "length_unit": "the baseline" if pose is not None else None,
        "notes": list(result.notes),
    }  # fmt: skip


def _lines(result: ClickedPair, clicks: Clicks, spots: tuple[Detections, Detections]) -> list[str]:
    rms = float(np.sqrt((result.distance_px**2).mean()))
    lines = [
        f"{len(result.spot_a)} matches of {len(spots[0])} and {len(spots[1])} spots, {int(result.by_hand.sum())} of "
        f"them by hand; {rms:.3f} px RMS from their epipolar lines, sigma0 {result.sigma0:.2f}",
        f"epipoles: {_place(result.epipole_a)} in the first, {_place(result.epipole_b)} in the second picture"
        + ("" if result.pose is None else " (pixels without lens distortion)"),
    ]
    for name, px, bad in zip(clicks.name, result.click_px, result.wrong, strict=True):
        if bad and np.isfinite(px):
            lines.append(f"wrong click: {name}, {abs(px):.2f} px from its line, contradicts the other matches")
    if result.pose is None:
        lines.append(WHY_NONE)
    return [*lines, *(f"  {note}" for note in result.notes)]


def _place(xy: np.ndarray) -> str:
    return f"({xy[0]:z.0f}, {xy[1]:z.0f})" if np.isfinite(xy).all() else "at infinity"
