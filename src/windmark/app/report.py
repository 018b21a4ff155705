"""One HTML file that says what was done and shows it: opens anywhere, without a network."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any

from windmark.app.alone import alone

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE = """
:root { --ink: #1c2430; --soft: #5b6778; --line: #d9dfe7; --good: #0a7d33; --bad: #b3261e; --panel: #f6f8fa; }
* { box-sizing: border-box }
body { margin: 0 auto; padding: 1.5rem; max-width: 75rem; color: var(--ink); background: #fff;
       font: 15px/1.5 system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif }
h1 { font-size: 1.7rem; margin: 0 0 .2rem } h2 { margin: 2.2rem 0 .6rem; border-bottom: 2px solid var(--line) }
h3 { margin: 1.4rem 0 .4rem } p { margin: .4rem 0; max-width: 60rem } .soft { color: var(--soft) }
table { border-collapse: collapse; margin: .6rem 0; font-variant-numeric: tabular-nums }
th, td { padding: .22rem .7rem; border-bottom: 1px solid var(--line); text-align: right; vertical-align: top }
th:first-child, td:first-child, td.text, th.text { text-align: left } th { background: var(--panel); font-weight: 600 }
figure { margin: .8rem 0 } img { max-width: 100%; height: auto; border: 1px solid var(--line) }
figcaption { color: var(--soft); font-size: .9rem } .good { color: var(--good) } .bad { color: var(--bad) }
.row { display: flex; flex-wrap: wrap; gap: 1.5rem; align-items: flex-start } .row > * { flex: 0 1 auto }
.scroll { max-height: 26rem; overflow: auto; border: 1px solid var(--line) } .scroll table { margin: 0 }
.scroll th { position: sticky; top: 0 }
@media print { .scroll { max-height: none; overflow: visible } }
"""


@dataclass
class Report:
    """A report under construction: parts in reading order."""

    title: str
    subtitle: str = ""
    parts: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    """Parts that are missing, with the reason."""

    @contextmanager
    def part(self, what: str) -> Iterator[None]:
        """A part that fails alone: whatever goes wrong in it is said in its place and in ``failed``."""
        before, well = len(self.parts), len(self.failed)
        with alone(what, self.failed):
            yield
            return
        del self.parts[before:]
        for said in self.failed[well:]:
            self.text(f"This part is missing: {said}", "bad")

    def drawing(self, what: str, draw: Callable[[], Figure | None], caption: str, *, dpi: int = 110) -> bytes | None:
        """A picture that fails alone, see `part`; as PNG, None where ``draw`` gives none or fails."""
        from windmark.app.pictures import png

        drawn: bytes | None = None
        with self.part(what):
            if (figure := draw()) is not None:
                drawn = png(figure, dpi)
                self.picture(drawn, caption)
        return drawn

    def heading(self, text: str, level: int = 2) -> None:
        """A heading of level 2 or 3."""
        self.parts.append(f"<h{level}>{escape(text)}</h{level}>")

    def text(self, text: str, style: str = "") -> None:
        """A paragraph; style "good", "bad" or "soft"."""
        self.parts.append(f'<p class="{style}">{escape(text)}</p>' if style else f"<p>{escape(text)}</p>")

    def table(self, columns: Sequence[str], rows: Iterable[Sequence[Any]], *, scroll: bool = False) -> None:
        """A table; numbers are formatted with `cell`."""
        head = "".join(f"<th>{escape(c)}</th>" for c in columns)
        body = "".join("<tr>" + "".join(map(_td, row)) + "</tr>" for row in rows)
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        self.parts.append(f'<div class="scroll">{table}</div>' if scroll else table)

    def picture(self, png: bytes, caption: str) -> None:
        """A picture inside the file itself."""
        data = base64.b64encode(png).decode("ascii")
        self.parts.append(
            f'<figure><img alt="{escape(caption)}" src="data:image/png;base64,{data}">'
            f"<figcaption>{escape(caption)}</figcaption></figure>"
        )

    def side_by_side(self, count: int) -> None:
        """Put the last ``count`` parts into one row."""
        row = "".join(f"<div>{part}</div>" for part in self.parts[-count:])
        self.parts[-count:] = [f'<div class="row">{row}</div>']

    def closing(self, files: Iterable[Sequence[str]], options: Mapping[str, Any], seconds: Mapping[str, float]) -> None:
        """The end of a report: files beside it with their content, options, and the seconds that each stage took."""
        self.heading("Files beside this report")
        self.table(["file", "content"], files)
        self.heading("Options and times")
        self.table(["option", "value"], [(k, str(v)) for k, v in options.items()])
        self.table(["stage", "s"], list(seconds.items()))
        self.side_by_side(2)

    def html(self) -> str:
        """The whole page."""
        return (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{escape(self.title)}</title><style>{_STYLE}</style></head><body>"
            f'<h1>{escape(self.title)}</h1><p class="soft">{escape(self.subtitle)}</p>\n'
            + "\n".join(self.parts)
            + "\n</body></html>\n"
        )


def _td(value: Any) -> str:
    """A table cell; words are left, figures right."""
    words = isinstance(value, str) and not value.lstrip("-+").replace(".", "", 1).isdigit()
    style = ' class="text"' if words else ""
    return f"<td{style}>{escape(cell(value))}</td>"


def cell(value: Any) -> str:
    """A value as table text: floats with 4 significant digits, None and NaN as a dash."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        if value != value:  # NaN
            return "–"
        return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"
    return str(value)
