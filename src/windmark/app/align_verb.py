"""The verb `windmark align` without camera and grid: 2D alignment; tables, pictures and page in one folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from windmark import io
from windmark.app import console
from windmark.app.alone import not_drawn
from windmark.app.progress import progress
from windmark.app.provenance import Provenance
from windmark.app.verdict_words import put_verdict, verdict_lines
from windmark.compiling import job_time
from windmark.errors import UsageError
from windmark.pipeline.align2d import AlignedFile, AlignSettings, Reference, align_files, read_named, read_reference
from windmark.pipeline.align2d.outputs import ratios, record_of, write_one
from windmark.pipeline.same_picture import shown_by
from windmark.pipeline.settings import unusable_name
from windmark.pipeline.verdict import Verdict
from windmark.pipeline.verdict.aligned import align_verdict
from windmark.pipeline.verdict.picture import PictureState, picture_state
from windmark.scene import Detections
from windmark.tasks.align2d.align import check_options

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from windmark.app.align_report import Drawing
    from windmark.app.report import Report

Record = dict[str, Any]

DRAWN = 6
"""Images that the report shows: the worst ones."""


@dataclass(frozen=True)
class Wishes:
    """Files of `windmark align` in 2D; ``options`` go to `AlignSettings`."""

    images: list[Path]
    reference: str | None
    matches: Path | None
    output: Path
    options: Record


def align(wishes: Wishes, as_json: bool) -> None:
    """Align every image to the reference; everything is written into the output folder, whole or not at all."""
    pictures = io.pictures(wishes.images)
    base, others = split_reference(pictures, wishes.reference)
    console.recordings(pictures)
    check_options(wishes.options["kind"], wishes.options["max_shift_px"])
    named = None if wishes.matches is None else read_named(wishes.matches)
    settings = AlignSettings(**wishes.options, named=named)
    start = job_time()
    with progress() as show, console.result_folder(wishes.output) as out:
        show(f"find the markers of {base.name}")
        reference = read_reference(base, settings)
        rows: list[Record] = []
        states = {base.name: _state(reference.image, reference.spots, reference)}
        contents = {base.name: shown_by(reference.image)}
        shown = Shown(reference)
        for item in align_files(others, reference, settings, progress=show):
            write_one(item, reference, out.place / item.name)
            rows.append(record_of(item, reference))
            if item.image is not None:
                spots = None if item.alignment is None else item.alignment.image_spots
                states[item.path.name] = _state(item.image, spots, reference)
                contents[item.path.name] = shown_by(item.image)
            shown.add(item)
        record = {
            "reference": base.name, "images": rows, "radius": reference.radius_note,
            "options": {**wishes.options, "reference": base.name, "matches": wishes.matches},
            "seconds": job_time() - start, "folder": wishes.output,
        }  # fmt: skip
        show("draw the report")
        verdict = align_verdict(rows, states, contents)
        record["verdict"] = verdict.record()
        page = _report(out, record, shown, verdict)
        console.write_summary(out, record)
        out.refused = not any(row["aligned"] for row in rows)
    lines = [reference.radius_note] if reference.radius_note else []
    lines += [line(row) for row in rows]
    good = [row for row in rows if row["aligned"]]
    if good or not as_json:
        lines += [*(verdict_lines(verdict) if good else []), *not_drawn(page.failed)]
        console.answer(record, as_json, [*lines, f"report: {wishes.output / 'report.html'}"])
    if not good:
        console.refuse(f"no image could be aligned; {rows[0]['image']}: {rows[0]['problem']}", as_json, record,
                       verdict.next_step)  # fmt: skip


def split_reference(
    images: Sequence[io.PictureFile], reference: str | None
) -> tuple[io.PictureFile, list[io.PictureFile]]:
    """The reference, by stem or file name (the first image if not said), and the others.

    Raises
    ------
    ValueError
        For a name that is no image's, two images of one name, or no image besides the reference.
    """
    stems = [path.stem for path in images]
    double = sorted({s for s in stems if stems.count(s) > 1})
    if double:
        raise UsageError(f"two images are called {double[0]}; expected a name of its own for each one's results")
    if (why := unusable_name(stems)) is not None:
        raise UsageError(f"the images' results go into folders of their names, and {why}")
    chosen = [p for p in images if reference in (None, p.stem, p.name)]
    if not chosen:
        raise UsageError(f"--reference: {reference!r} is no image's name; expected one of {', '.join(stems[:8])}")
    others = [p for p in images if p != chosen[0]]
    if not others:
        raise UsageError("align needs the reference and at least one more image")
    return chosen[0], others


class Shown:
    """The images that are drawn, the worst of those seen so far; the others are let go."""

    def __init__(self, reference: Reference) -> None:
        self.reference = reference
        self.items: list[AlignedFile] = []

    def add(self, item: AlignedFile) -> None:
        """One more image."""
        if item.alignment is not None:
            self.items.append(item)
            self.items.sort(key=lambda i: -(i.alignment.held_out_px if i.alignment is not None else 0.0))
            del self.items[DRAWN:]

    def pictures(self) -> dict[str, list[Drawing]]:
        """What is drawn, by file name."""
        out: dict[str, list[Drawing]] = {}
        for item in sorted(self.items, key=lambda i: i.name):
            caption = "Ratio of reference and image, as taken and aligned; dashed: hull of the markers."
            out[item.path.name] = [
                ("picture of the residuals", partial(self._residuals, item), "Residuals of held-out markers."),
                ("picture of the ratio", partial(self._ratio, item), caption),
            ]
        return out

    def _residuals(self, item: AlignedFile) -> str:
        from windmark.app.align_pictures import residual_photo

        assert item.alignment is not None
        return residual_photo(self.reference.image, item.alignment, item.name)

    def _ratio(self, item: AlignedFile) -> Figure | None:
        from windmark.app.align_pictures import ratio_picture

        assert item.alignment is not None
        pair = ratios(item, self.reference)
        return None if pair is None else ratio_picture(*pair, item.alignment, item.name)


def line(row: Record) -> str:
    """One image in one line."""
    if not row["aligned"]:
        return f"{row['image']}: {row['problem']}"
    rejected = f", {row['rejected_pairs']} rejected" if row["rejected_pairs"] else ""
    rejected += f", {row['standing_still']} stand still" if row["standing_still"] else ""
    return (
        f"{row['image']}: {row['pairs']} pairs{rejected}, {row['kind']}, held-out RMS {row['held_out_rms_px']:.3f} px, "
        f"motion up to {row['largest_shift_px']:.1f} px, {100 * row['outside_the_markers']:.0f} % of the picture is "
        "outside the markers"
    )


def _state(image: NDArray[Any], spots: Detections | None, reference: Reference) -> PictureState:
    """State of a picture; of named spots there is no size."""
    grey = image if image.ndim == 2 else image.mean(axis=2)
    return picture_state(grey, None if reference.named is not None else spots, reference.polarity)


def _report(out: io.ResultFolder, record: Record, shown: Shown, verdict: Verdict) -> Report:
    from windmark.app.align_report import align_report

    page = align_report(record, shown.pictures())
    put_verdict(page, verdict)
    page.provenance(Provenance(out.sources()))
    (out.place / "report.html").write_text(page.html(), encoding="utf-8")
    record["not_drawn"] = page.failed
    return page
