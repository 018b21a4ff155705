"""The verb `windmark detect`: read, detect, write table and pictures, say it in a few lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from windmark import detection, io
from windmark.app import console
from windmark.app.alone import Unreadable, not_drawn, png_alone
from windmark.app.progress import progress
from windmark.app.verdict_words import verdict_lines
from windmark.detection import RadiusEstimate, Rejected
from windmark.errors import UsageError
from windmark.options.detection import CHANNEL
from windmark.pipeline.clock import counting
from windmark.pipeline.verdict.detected import Looked, detect_verdict
from windmark.pipeline.verdict.picture import PictureState, picture_state
from windmark.scene import Detections
from windmark.scene.detections import middle_sigma

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from windmark.app.detect_report import DetectPage, Shown
    from windmark.pipeline.verdict import Verdict

Record = dict[str, Any]
Drawn = list[tuple[Path, bytes]]
"""What is written beside the tables: where, and the bytes."""
Image = NDArray[np.generic]


@dataclass(frozen=True)
class Wishes:
    """What is wanted of `windmark detect`; `options` go to `windmark.detect`."""

    options: Record
    radius_px: tuple[float, ...]
    mask: Path | None = None
    roi: tuple[int, int, int, int] | None = None
    output: Path = Path("detections.csv")
    picture: Path | None = None
    explain: Path | None = None
    merit_map: Path | None = None
    report: Path | None = None
    channel: str = CHANNEL.default
    bayer: str | None = None

    @property
    def files(self) -> list[Path]:
        """What is to be written."""
        return [p for p in (self.output, self.explain, self.picture, self.merit_map, self.report) if p is not None]

    @property
    def shown(self) -> bool:
        """Whether the spots are to be seen in a file."""
        return self.report is not None or self.picture is not None


@dataclass(frozen=True)
class _Found:
    """One image and what was found in it."""

    image: Image
    mask: NDArray[np.bool_] | None
    radii_px: Sequence[float]
    estimate: RadiusEstimate | None
    spots: Detections
    rejected: Rejected | None
    state: PictureState
    why_none: str = ""
    polarity: str = "dark"
    decided: str = ""


def detect(images: list[Path], wishes: Wishes, as_json: bool) -> None:
    """Detect in each image; one table for all."""
    io.try_paths(wishes.files, console.complain)
    found: dict[str, _Found] = {}
    lost = Unreadable()
    page = None if wishes.report is None else new_page()
    with progress() as show:
        files = uniquely_named(images)
        ended = counting(show, "detect", len(files))
        for path in files:
            with lost.unless_readable(path.name):
                one = _detect_one(read_wished(path, wishes), wishes)
                if page is not None:
                    page.add(_shown(path.name, one))
                drawn = wishes.picture is not None or wishes.merit_map is not None
                found[path.name] = one if drawn else replace(one, image=one.image[:0], mask=None)  # recordings are long
            ended(path.name)
        lost.refuse_unless(found)
        show("write")
        good = any(len(one.spots) for one in found.values())
        failed: list[str] = []
        verdict = detect_verdict({name: Looked(one.state, len(one.spots), middle_sigma(one.spots.cov), one.why_none)
                                  for name, one in found.items()}, lost.why, wishes.shown)  # fmt: skip
        written = _write(found, wishes, good, failed, page_part(page, wishes, verdict, failed))
    alone = len(found) == 1 and not good  # the refusal says why
    said = [replace(one, why_none="", estimate=None) for one in found.values()] if alone else [*found.values()]
    lines = [*map(_line, found, said), *lost.lines()]
    record = {"images": {name: _record(one) for name, one in found.items()}, "output": str(wishes.output),
              "left_out": lost.why, "not_drawn": failed, "verdict": verdict.record()}  # fmt: skip
    lines += [*(verdict_lines(verdict) if good else []), *not_drawn(failed)]
    lines += [f"written: {', '.join(map(str, written))}"] if written else []
    if good:
        console.answer(record, as_json, lines)
        return
    if not as_json:
        console.answer(record, False, lines)
    console.refuse(_why_none(found, wishes), as_json, record, verdict.next_step)


def _write(found: dict[str, _Found], wishes: Wishes, good: bool, failed: list[str], page: Drawn) -> list[Path]:
    """Table and pictures, all of them or none; without a marker no table: one of an earlier run stays as it was."""
    drawn = _drawn(found, wishes, failed) + page
    tables = [wishes.output] if good else []
    tables += [wishes.explain] if wishes.explain is not None else []
    with io.atomic_paths([*tables, *(path for path, _ in drawn)]) as places:
        if good:
            io.write_detections(places[wishes.output], {name: one.spots for name, one in found.items()})
        if wishes.explain is not None:
            io.write_table(places[wishes.explain], _rejected_columns(found))
        for path, data in drawn:
            places[path].write_bytes(data)
    return tables + [path for path, _ in drawn]


def new_page() -> DetectPage:
    """The page that is wanted, empty; it is imported only then."""
    from windmark.app.detect_report import DetectPage

    return DetectPage()


def page_part(page: DetectPage | None, wishes: Wishes, verdict: Verdict, failed: list[str]) -> Drawn:
    """The page as a file to be written; what could not be drawn in it is added to ``failed``."""
    if page is None or wishes.report is None:
        return []
    report = page.report(verdict, wishes.report)
    failed += report.failed
    return [(wishes.report, report.html().encode())]


def _shown(name: str, one: _Found) -> Shown:
    from windmark.app.detect_report import NotTaken, Shown

    others = None
    if (r := one.rejected) is not None:
        others = NotTaken("rejected candidate", [str(k) for k in range(len(r))], r.xy, r.radius_px, r.words, r.merit)
    return Shown(name, one.image, one.spots, one.polarity, others, said=one.why_none or one.decided)


def parse_roi(text: str | None) -> tuple[int, int, int, int] | None:
    """``x0,y0,x1,y1``: the first and the last column and row that are used."""
    if text is None:
        return None
    try:
        x0, y0, x1, y1 = (int(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"--roi must be x0,y0,x1,y1 in whole pixels, got {text!r}") from None
    if not (x1 > x0 >= 0 and y1 > y0 >= 0):
        raise UsageError(f"--roi must be x0,y0,x1,y1 with 0 <= x0 < x1 and 0 <= y0 < y1, got {text!r}")
    return x0, y0, x1, y1


def used_pixels(image: Image, mask: Path | None, roi: tuple[int, int, int, int] | None) -> NDArray[np.bool_] | None:
    """The mask picture (not 0: use) and the region of interest together; None where all pixels are used."""
    use = None if mask is None else io.read_mask(mask, image.shape)
    if roi is not None:
        x0, y0, x1, y1 = roi
        if x0 >= image.shape[1] or y0 >= image.shape[0]:
            raise UsageError(f"--roi {roi} lies outside the image of {image.shape[1]} x {image.shape[0]} pixels")
        inside = np.zeros(image.shape, dtype=bool)
        inside[y0 : y1 + 1, x0 : x1 + 1] = True
        use = inside if use is None else use & inside
    return use


def uniquely_named(images: list[Path]) -> list[io.PictureFile]:
    """The pictures, recordings frame by frame; refused where two have one name, as results go by names."""
    items = io.pictures(images)
    names = [item.name for item in items]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise UsageError(f"images: two are called {twice}; the results are named after the images")
    console.recordings(items)
    return items


def read_wished(path: io.PictureFile, wishes: Wishes) -> Image:
    """An image, its colours reduced as asked for."""
    return io.read_grey(path, channel=wishes.channel, bayer=wishes.bayer)


def _detect_one(image: Image, wishes: Wishes) -> _Found:
    mask = used_pixels(image, wishes.mask, wishes.roi)
    options = {**wishes.options, "radius_px": wishes.radius_px or None, "mask": mask}
    look = detection.find_markers(image, rejected=wishes.explain is not None or wishes.report is not None, **options)
    if look.radius is not None and not look.radius:
        why = "; ".join(filter(None, [look.radius.reason, look.words]))
    elif not len(look.detections):
        why = detection.why_none(image, **options)
    else:  # few are asked about, too
        count = len(look.detections)
        why = detection.hint(image, options, count) if look.is_few else ""
    return _Found(
        image, mask, look.radii_px, look.radius, look.detections, look.rejected,
        picture_state(image, look.detections, look.polarity), why, look.polarity, look.words,
    )  # fmt: skip


def _rejected_columns(found: dict[str, _Found]) -> dict[str, Any]:
    """Table of the rejected candidates of all images."""
    parts = [(name, one.rejected) for name, one in found.items() if one.rejected is not None]
    columns: dict[str, list[Any]] = {
        key: [] for key in ("image", "x", "y", "radius", "merit", "depth", "quality", "reason")
    }
    for name, some in parts:
        values = ([name] * len(some), *some.xy.T, some.radius_px, some.merit, some.depth, some.quality, some.words)
        for key, value in zip(columns, values, strict=True):
            columns[key].extend(value)
    return columns


def _drawn(found: dict[str, _Found], wishes: Wishes, failed: list[str]) -> list[tuple[Path, bytes]]:
    """The pictures that are wanted, and where they go; several images get a number each."""
    drawn: list[tuple[Path, bytes | None]] = []
    for k, (name, one) in enumerate(found.items()):
        number = k + 1 if len(found) > 1 else None
        if wishes.picture is not None:
            picture = png_alone(f"{name}: picture of the spots", partial(_spots, name, one), failed)
            drawn.append((numbered(wishes.picture, number), picture))
        if wishes.merit_map is not None and one.radii_px:
            merit = partial(_merit, name, one, wishes.options["merit_max"])
            drawn.append((numbered(wishes.merit_map, number), png_alone(f"{name}: map of the merit", merit, failed)))
    return [(path, data) for path, data in drawn if data is not None]


def _spots(name: str, one: _Found) -> Figure:
    from windmark.app.detect_pictures import explained_picture
    from windmark.app.pictures import spots_picture

    if one.rejected is not None:
        return explained_picture(one.image, one.spots, one.rejected, name)
    return spots_picture(one.image, one.spots, name)


def _merit(name: str, one: _Found, merit_max: float) -> Figure:
    from windmark.app.detect_pictures import merit_picture

    best, words = _best_merit(one, one.polarity)
    return merit_picture(best, merit_max, f"{name}: {words}")


def _best_merit(one: _Found, polarity: str) -> tuple[NDArray[np.float32], str]:
    """The best merit over the radii for each pixel, and what it is."""
    maps = [detection.merit_map(one.image, r, polarity, mask=one.mask) for r in one.radii_px]
    radii = ", ".join(f"{r:g}" for r in one.radii_px)
    words = f"merit for the radius {radii} px" if len(maps) == 1 else f"best merit over the radii {radii} px"
    return np.fmin.reduce(maps), words


def numbered(path: Path, number: int | None) -> Path:
    """The file of one picture among several."""
    return path if number is None else path.with_stem(f"{path.stem}-{number}")


def _record(one: _Found) -> Record:
    record = {
        "spots": len(one.spots), "polarity": one.polarity, "xy": one.spots.xy, "merit": one.spots.merit,
        "radius_px": list(one.radii_px),
    }  # fmt: skip
    if one.decided:
        record["decided"] = one.decided
    if one.estimate is not None:
        record["radius_estimate"] = one.estimate.reason
    if one.rejected is not None:
        record["rejected"] = len(one.rejected)
    if one.why_none:
        record["hint" if len(one.spots) else "why_none"] = one.why_none
    return record


def _line(name: str, one: _Found) -> str:
    parts = [f"{len(one.spots)} spots"] + ([one.decided] if one.decided else [])
    if one.rejected is not None:
        parts.append(f"{len(one.rejected)} candidates rejected")
    if one.estimate is not None:
        parts.append(one.estimate.reason)
    if one.why_none and one.radii_px:
        parts.append(one.why_none)
    return f"{name}: {'; '.join(parts)}"


def _why_none(found: dict[str, _Found], wishes: Wishes) -> str:
    first = next(iter(found.values()))
    polarity = "dark or bright" if wishes.options["polarity"] == detection.AUTO else first.polarity
    size = f" of radius {', '.join(f'{r:g}' for r in first.radii_px)} px" if first.radii_px else ""
    return f"no marker{size} ({polarity}) was found: {first.why_none}"
