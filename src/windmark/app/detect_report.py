"""The page of `windmark detect`: each picture with its spots and what was rejected, tables, what it was made of."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import windmark
from windmark import io
from windmark.app import console
from windmark.app.photo import FIRST, FURTHER, Overlay, preview
from windmark.app.provenance import Provenance
from windmark.app.report import Report
from windmark.app.spot_words import COLUMNS, spot_notes, spot_rows
from windmark.app.verdict_words import put_verdict
from windmark.errors import g2
from windmark.pipeline.verdict import Verdict
from windmark.scene import Detections
from windmark.scene.detections import middle_sigma

Array = NDArray[np.float64]

DRAWN = 24
"""Pictures that are shown; of the others, a recording's, there is a row in the first table."""
LISTED, RINGED = 300, 1500
"""Rejected candidates of a picture that are in its table, and those that are drawn, the best first."""


@dataclass(frozen=True)
class NotTaken:
    """Places at which there is no spot: rejected candidates, or expected markers that were not found.

    Parameters
    ----------
    what : one of them, as the key says it
    label : (N,) what each is called; its number, or the marker's name
    xy, radius_px : (N, 2), (N,); NaN where a radius is not known
    reason : (N,) in words; what stands before a colon is the short form
    merit : (N,) NaN where there is none
    """

    what: str
    label: Sequence[str]
    xy: Array
    radius_px: Array
    reason: Sequence[str]
    merit: Array


@dataclass(frozen=True)
class Shown:
    """A picture with what was found in it; ``names`` (M,) of the spots' markers where they are known."""

    name: str
    image: NDArray[np.generic]
    spots: Detections
    polarity: str
    others: NotTaken | None = None
    names: Sequence[str] = ()
    said: str = ""


@dataclass
class DetectPage:
    """A page under construction: pictures are drawn as they come, so that a recording needs the room of one."""

    body: Report = field(default_factory=lambda: Report(""))
    rows: list[tuple[object, ...]] = field(default_factory=list)

    def add(self, one: Shown) -> None:
        """One more picture."""
        others = None if one.others is None else len(one.others.xy)
        sigma = middle_sigma(one.spots.cov)
        known = one.spots.radius_px[np.isfinite(one.spots.radius_px)]
        radius = f"{np.median(known):.2f}" if len(known) else None
        self.rows.append((one.name, len(one.spots), others, one.polarity, radius,
                          g2(sigma) if np.isfinite(sigma) else None, one.said or None))  # fmt: skip
        number = len(self.rows)
        if number > DRAWN:
            return
        with self.body.part(one.name):
            if number == 1:
                self.body.heading(one.name)
                _section(self.body, one, FIRST.photo)
                return
            found = "spot" if len(one.spots) == 1 else "spots"
            summary = f"{escape(one.name)}: {len(one.spots)} {found}"
            with self.body.folded(f"picture-{number}", summary, packed=True, closed=True):
                _section(self.body, one, FURTHER.photo)

    def report(self, verdict: Verdict, output: Path) -> Report:
        """The whole page, for the file ``output``."""
        when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
        page = Report("Markers in pictures", f"windmark {windmark.__version__}, {when}")
        put_verdict(page, verdict)
        if len(self.rows) > 1:
            page.heading("Every picture")
        page.table(["picture", "spots", "not taken", "polarity", "median radius, px", "median 1 sigma, px", "remark"],
                   self.rows, scroll=len(self.rows) > 15)  # fmt: skip
        page.text("Sigma: per coordinate, of the spot's centre. Merit: 0 is a perfect disc, a marker is below the "
                  "limit (--merit-max). Depth: contrast to the background. (0, 0) is the centre of the top left pixel.",
                  "soft")  # fmt: skip
        page.absorb(self.body)
        if len(self.rows) > DRAWN:
            page.text(f"{len(self.rows) - DRAWN} further pictures are not drawn; their spots are in the table beside "
                      "this page.", "soft")  # fmt: skip
        folder = output.absolute().parent
        with io.witness() as read:
            page.provenance(Provenance.of_verb(io.ResultFolder(folder, folder, console.about(folder), read=read)))
        return page


def _section(report: Report, one: Shown, room: int) -> None:
    """A picture and its tables."""
    report.raw(_photo(one, room))
    if len(one.spots):
        report.heading("Spots", 3)
        columns: list[str] = list(COLUMNS)
        rows = spot_rows(one.spots)
        if one.names:
            columns.insert(1, "marker")
            rows = [(row[0], name, *row[1:]) for row, name in zip(rows, one.names, strict=True)]
        report.table(columns, rows, scroll=len(rows) > 15)
    others = one.others
    if others is None or not len(others.xy):
        return
    report.heading(f"{others.what[0].upper()}{others.what[1:]}s", 3)
    report.table(["reason", "number"], Counter(others.reason).most_common())
    some = slice(0, LISTED)
    rows = [(label, f"{x:.1f}", f"{y:.1f}", f"{r:.1f}" if np.isfinite(r) else None,
             f"{m:.3f}" if np.isfinite(m) else None, why)
            for label, (x, y), r, m, why in zip(others.label[some], others.xy[some].tolist(),
                                                others.radius_px[some].tolist(), others.merit[some].tolist(),
                                                others.reason[some], strict=True)]  # fmt: skip
    report.table([others.what, "x, px", "y, px", "radius, px", "merit", "reason"], rows, scroll=len(rows) > 8)
    if len(others.xy) > LISTED:
        report.text(f"The best {LISTED} of {len(others.xy)}; --explain writes all of them.", "soft")


def _photo(one: Shown, room: int) -> str:
    """The picture, the spots as rings, and what was not taken in the colour of its reason."""
    from windmark.app.detect_pictures import COLOURS

    over = Overlay((one.image.shape[1], one.image.shape[0]))
    taken = np.ones(len(one.spots), dtype=bool)
    over.spots(one.spots, taken, spot_notes(one.spots, one.names), (f"spot ({len(one.spots)})", ""))
    if (others := one.others) is not None:
        for number, words in enumerate(dict.fromkeys(others.reason)):
            which = [k for k, reason in enumerate(others.reason) if reason == words]
            _not_taken(over, others, which, f"reason-{number}", COLOURS[number % len(COLOURS)])
    caption = f"{one.name}: {len(one.spots)} spots" + (f", {len(others.xy)} {others.what}s" if others else "")
    return over.html(preview(one.image, room)[0], f"{caption}.")


def _not_taken(over: Overlay, others: NotTaken, which: list[int], layer: str, colour: str) -> None:
    """A layer of those of one reason."""
    words = others.reason[which[0]]
    drawn = [k for k in which if k < RINGED]
    radius = np.clip(1.8 * np.nan_to_num(others.radius_px[drawn], nan=3.0), 5.0, 0.05 * min(over.size_px))
    notes = [f"{others.what} {others.label[k]}: {words}" for k in drawn]
    over.circles(layer, others.xy[drawn], radius, notes, f"{words.split(':')[0]} ({len(which)})", colour)
