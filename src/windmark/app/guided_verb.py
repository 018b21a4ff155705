"""The verb `windmark detect` where the markers' places are known nearly: --near, or --camera with --markers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.app import console
from windmark.app.alone import Unreadable, not_drawn, png_alone
from windmark.app.detect_verb import (
    Drawn,
    Wishes,
    new_page,
    numbered,
    page_part,
    read_wished,
    uniquely_named,
    used_pixels,
)
from windmark.app.progress import progress
from windmark.app.verdict_words import verdict_lines
from windmark.detection import AUTO, Guided
from windmark.detection.either import FEW
from windmark.errors import UsageError
from windmark.options.detection import SEARCH_PX
from windmark.pipeline.clock import counting
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.verdict.detected import Looked, detect_verdict
from windmark.pipeline.verdict.picture import picture_state
from windmark.scene.detections import middle_sigma
from windmark.tasks.predictions import Predictions, from_camera, from_detections, look

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from windmark.app.detect_report import Shown

Record = dict[str, Any]


@dataclass(frozen=True)
class Guide:
    """Where the markers are expected: a table of detections, or a camera with a pose and a table of markers."""

    near: Path | None = None
    camera: Path | None = None
    markers: Path | None = None
    search_px: float = SEARCH_PX.default

    def __bool__(self) -> bool:
        return any(path is not None for path in (self.near, self.camera, self.markers))

    def __post_init__(self) -> None:
        if self.near is not None and (self.camera is not None or self.markers is not None):
            raise UsageError("give either --near or --camera with --markers")
        if (self.camera is None) != (self.markers is None):
            raise UsageError("--camera and --markers belong together: the camera's pose says where the markers are")


@dataclass(frozen=True)
class _Seen:
    """One image, what was expected and what was found."""

    image: NDArray[np.generic]
    expected: Predictions
    got: Guided
    polarity: str
    decided: str = ""


def detect(images: list[Path], wishes: Wishes, guide: Guide, as_json: bool) -> None:
    """Look for the expected markers in each image; one table for all."""
    if len(wishes.radius_px) > 1 or wishes.merit_map is not None:
        raise UsageError("markers near predictions: give one --radius at most, and no --merit-map")
    seen: dict[str, _Seen] = {}
    lost = Unreadable()
    failed: list[str] = []
    options = {"search_px": guide.search_px, "photometry": wishes.options["photometry"]}
    io.try_paths(wishes.files, console.complain)
    page = None if wishes.report is None else new_page()
    with progress() as show:
        files = uniquely_named(images)
        ended = counting(show, "detect", len(files))
        for path in files:
            image = None
            with lost.unless_readable(path.name):
                image = read_wished(path, wishes)
            if image is None:
                ended(path.name)
                continue
            expected = _expected(guide, path.name, wishes.radius_px[0] if wishes.radius_px else None)
            mask = used_pixels(image, wishes.mask, wishes.roi)
            seen[path.name] = _look(image, expected, wishes.options["polarity"], {**options, "mask": mask})
            if page is not None:
                page.add(_shown(path.name, seen[path.name]))
            ended(path.name)
        lost.refuse_unless(seen)
        show("write")
        good = any(one.got.found.any() for one in seen.values())
        verdict = detect_verdict({name: _looked(one) for name, one in seen.items()}, lost.why, wishes.shown)
        written = _write(seen, wishes, good, failed, page_part(page, wishes, verdict, failed))
    lines = [f"{name}: {one.got.found.sum()} of {len(one.expected)} expected markers{one.decided}{_why(one)}"
             for name, one in seen.items()]  # fmt: skip
    console.answer(
        {"images": {name: _record(one) for name, one in seen.items()}, "output": str(wishes.output),
         "left_out": lost.why, "not_drawn": failed, "verdict": verdict.record()},
        as_json,
        [*lines, *lost.lines(), *(verdict_lines(verdict) if good else []), *not_drawn(failed),
         *([f"written: {', '.join(map(str, written))}"] if written else [])],
    )  # fmt: skip
    if not good:
        console.refuse(f"none of the expected markers was found{_why(next(iter(seen.values())))}", as_json,
                       next_step=verdict.next_step)  # fmt: skip


def _looked(one: _Seen) -> Looked:
    """For the verdict: what is missing of the expected markers is its hint."""
    found = one.got.detections
    said = "" if one.got.found.all() else f"{len(one.expected)} were expected{_why(one)}"
    return Looked(picture_state(one.image, found, one.polarity), len(found), middle_sigma(found.cov), said)


def _shown(name: str, one: _Seen) -> Shown:
    from windmark.app.detect_report import NotTaken, Shown

    lost = ~one.got.found
    words = [w for w, gone in zip(one.got.words, lost, strict=True) if gone]
    unknown = np.full(int(lost.sum()), np.nan)
    others = NotTaken("expected marker", _names(one, lost), one.expected.xy[lost], unknown, words, unknown)
    return Shown(name, one.image, one.got.detections, one.polarity, others, _names(one, one.got.found))


def _write(seen: dict[str, _Seen], wishes: Wishes, good: bool, failed: list[str], page: Drawn) -> list[Path]:
    """Table and pictures, all of them or none; without a marker no table: one of an earlier run stays as it was."""
    drawn = _drawn(seen, wishes, failed) + page
    tables = [wishes.output] if good else []
    tables += [wishes.explain] if wishes.explain is not None else []
    with io.atomic_paths([*tables, *(path for path, _ in drawn)]) as places:
        if good:
            io.write_detections(
                places[wishes.output],
                {name: one.got.detections for name, one in seen.items()},
                names={name: _names(one, one.got.found) for name, one in seen.items()},
            )
        if wishes.explain is not None:
            io.write_table(places[wishes.explain], _missing(seen))
        for path, data in drawn:
            places[path].write_bytes(data)
    return tables + [path for path, _ in drawn]


def _look(image: NDArray[np.generic], expected: Predictions, polarity: str, options: dict[str, Any]) -> _Seen:
    """Look for the expected markers; with "auto" for bright ones where there are hardly any dark ones."""
    first = "dark" if polarity == AUTO else polarity
    got = look(image, expected, polarity=first, **options)
    few = min(FEW, len(expected))
    if polarity != AUTO or got.found.sum() >= few:
        return _Seen(image, expected, got, first)
    other = look(image, expected, polarity="bright", **options)
    if other.found.sum() < few:
        return _Seen(image, expected, got, first)
    return _Seen(image, expected, other, "bright", f", bright ones ({got.found.sum()} dark)")


def _expected(guide: Guide, image: str, radius_px: float | None) -> Predictions:
    """Predictions for an image. A table of one other image is the frame before."""
    if guide.near is not None:
        table, names = io.read_detections(guide.near), io.read_detection_names(guide.near)
        key = image if image in table else next(iter(table)) if len(table) == 1 else None
        if key is None:
            raise io.FileError(guide.near, f"holds {len(table)} images; expected {image} among them, or only one")
        return from_detections(table[key], names[key], radius_px)
    assert guide.camera is not None
    assert guide.markers is not None
    lengths = Lengths()
    content = lengths.camera(guide.camera)
    if content.cam_from_model is None:
        raise io.FileError(guide.camera, "has no pose; expected one, to know where the markers are")
    markers = lengths.markers(guide.markers)
    console.notes(lengths)
    return from_camera(content.camera, content.cam_from_model, markers, radius_px)


def _names(one: _Seen, which: NDArray[np.bool_]) -> list[str]:
    return [one.expected.name[k] for k in np.flatnonzero(which)]


def _missing(seen: dict[str, _Seen]) -> dict[str, Any]:
    """Table of the expected markers that were not found, with the reason."""
    columns: dict[str, list[Any]] = {
        key: [] for key in ("image", "name", "x", "y", "depth", "depth_sigma", "correlation", "log10_nfa", "reason")
    }
    for name, one in seen.items():
        got, k = one.got, np.flatnonzero(~one.got.found)
        values = ([name] * len(k), _names(one, ~got.found), *one.expected.xy[k].T, got.depth[k], got.depth_sigma[k],
                  got.correlation[k], got.log10_nfa[k], [got.words[i] for i in k])  # fmt: skip
        for key, value in zip(columns, values, strict=True):
            columns[key].extend(value)
    return columns


def _drawn(seen: dict[str, _Seen], wishes: Wishes, failed: list[str]) -> list[tuple[Path, bytes]]:
    if wishes.picture is None:
        return []
    drawn = []
    for k, (name, one) in enumerate(seen.items()):
        picture = png_alone(f"{name}: picture of the matching", partial(_matching, name, one), failed)
        if picture is not None:
            drawn.append((numbered(wishes.picture, k + 1 if len(seen) > 1 else None), picture))
    return drawn


def _matching(name: str, one: _Seen) -> Figure:
    from windmark.app.pictures import matching_picture

    found, spots = one.got.found, one.got.detections
    return matching_picture(
        one.image, spots, np.arange(len(spots)), _names(one, found), one.expected.xy[found], one.expected.xy[~found],
        _names(one, ~found), name, guided=True,
    )  # fmt: skip


def _why(one: _Seen) -> str:
    """How many were missed for which reason."""
    missed = [words.split(":")[0] for words, found in zip(one.got.words, one.got.found, strict=True) if not found]
    parts = [f"{missed.count(words)} {words}" for words in dict.fromkeys(missed)]
    return f" ({', '.join(parts)})" if parts else ""


def _record(one: _Seen) -> Record:
    got = one.got
    return {
        "expected": len(one.expected), "polarity": one.polarity, "found": int(got.found.sum()),
        "name": list(one.expected.name), "xy": got.xy,
        "log10_nfa": got.log10_nfa, "answer": got.words, "blur_px": got.frame.blur_px,
    }  # fmt: skip
