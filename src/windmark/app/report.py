"""One HTML file that says what was done and shows it: opens anywhere, without a network."""

from __future__ import annotations

import base64
import io as byte_io
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from windmark.app import web
from windmark.app.alone import alone
from windmark.app.packing import packed_text
from windmark.app.wording import duration, named, setting
from windmark.errors import earned_decimals

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from windmark.app.provenance import Provenance
    from windmark.app.scene3d import Scene3D

LARGE_PNG = 60_000
"""A picture of more bytes is put in as WebP: a quarter of the size, and no difference to be seen."""
LONGEST = 32
"""Letters of a cell of a table that is never broken into lines."""
ONE_SIZE = 10.0
"""Numbers that differ by no more than this factor have the same number of decimals in a column."""
PACKED_ID = "part"
HINT = "drag: turn · shift or right button: move · click, then wheel: zoom · arrows, + −, 0 · double click: home"
FALLBACK = "The 3D view needs JavaScript and WebGL2. All figures are in the tables."
_SCENE = '<figure class="wm-figure">'
_STYLES = {
    (False, False): "", (True, False): ' class="text"', (False, True): ' class="long"',
    (True, True): ' class="text long"',
}  # fmt: skip
_FIGURE = re.compile(r"[-+−<≤>≥≈]?\s*[\d.,][\d.,eE+\-−±×/() ]*%?")
"""Text that is a number, its error or a part."""


@dataclass
class Report:
    """A report under construction: parts in reading order."""

    title: str
    subtitle: str = ""
    parts: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    """Parts that are missing, with the reason."""
    folder: Path | None = None
    """Of the test: paths are told from there."""
    data: dict[str, str] = field(default_factory=dict)
    """Packed data of the page by the id of its element, see `packing`."""

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
        said = escape(self.told(text))
        self.parts.append(f'<p class="{style}">{said}</p>' if style else f"<p>{said}</p>")

    def listed(self, head: str, items: Iterable[str], style: str = "") -> None:
        """Sentences under one another, below what is said of all of them."""
        points = "".join(f"<li>{escape(self.told(item))}</li>" for item in items)
        self.raw(f'<div class="{style}"><p>{escape(head)}</p><ul>{points}</ul></div>')

    def told(self, text: str) -> str:
        """Without private paths, see `private_paths.told`."""
        from windmark.pipeline.private_paths import told

        return told(text, *([] if self.folder is None else [self.folder])) if "/" in text or "\\" in text else text

    def _cell(self, value: Any) -> Any:
        return self.told(value) if isinstance(value, str) else value

    def table(self, columns: Sequence[str], rows: Iterable[Sequence[Any]], *, scroll: bool = False) -> None:
        """A table; numbers are formatted with `cell`. Words are left, figures right, each column as most of it is."""
        content = [[self._cell(v) for v in row] for row in rows]
        words = [_of_words(column) for column in zip(*content, strict=True)] or [False] * len(columns)
        head = _row("th", columns, words)
        texts = zip(*map(_column, zip(*content, strict=True)), strict=True)
        body = "".join(f"<tr>{_row('td', row, words)}</tr>" for row in texts)
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        self.parts.append(f'<div class="scroll">{table}</div>' if scroll else table)

    def picture(self, png: bytes, caption: str) -> None:
        """A picture inside the file itself; a large one as WebP."""
        kind, content = _smaller(png)
        data = base64.b64encode(content).decode("ascii")
        self.raw(
            f'<figure><img alt="{escape(caption)}" src="data:image/{kind};base64,{data}">'
            f"<figcaption>{escape(caption)}</figcaption></figure>"
        )

    def raw(self, html: str) -> None:
        """HTML as it is: whoever makes it escapes what comes from the data."""
        self.parts.append(html)

    def chart(self, svg: str, caption: str) -> None:
        """A drawing as SVG, see `svg.Chart`."""
        self.raw(f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>")

    def scene(self, what: str, make: Callable[[], Scene3D | None], caption: str) -> None:
        """A scene that turns, which fails alone as `drawing` does; nothing where ``make`` gives none."""
        from windmark.app.scene_document import documents

        with self.part(what):
            scene = make()
            if scene is None:
                return
            ident = f"scene-{sum(part.startswith(_SCENE) for part in self.parts)}"
            self.data.update(documents(scene, ident))
            self.raw(
                f'{_SCENE}<div class="wm-scene" data-blob="{ident}"><div class="wm-stage">'
                f'<canvas tabindex="0" role="img" aria-label="{escape(caption)}"></canvas><div class="wm-names"></div>'
                f'<div class="wm-tip" role="tooltip" hidden></div><img class="wm-still" alt="{escape(caption)}">'
                f'<p class="wm-hint">{HINT}</p><p class="wm-fallback">{FALLBACK}</p></div>'
                f'<div class="wm-panel"></div></div><figcaption>{escape(caption)}</figcaption></figure>'
            )

    @contextmanager
    def folded(self, ident: str, summary: str, *, packed: bool, closed: bool) -> Iterator[None]:
        """What is written inside stands in a part of its own that can be closed; ``summary`` is HTML.

        ``packed``: it takes a third of the room, pictures but for 6 % apart. ``closed`` at first: unpacked when
        somebody opens it, so that a report of many is there at once; else when the page is loaded.
        """
        before = len(self.parts)
        yield
        inner = "\n".join(self.parts[before:])
        del self.parts[before:]
        if packed:
            part = f"{PACKED_ID}-{ident}"
            self.data[part] = packed_text(b"{}", inner.encode())
            opened = "" if closed else " open"
            self.raw(f'<details id="{escape(ident)}" data-blob="{escape(part)}"{opened}><summary>{summary}</summary>'
                     '<div class="wm-packed">opening …</div></details>')  # fmt: skip
        else:
            self.raw(f'<details id="{escape(ident)}" open><summary>{summary}</summary>{inner}</details>')

    def absorb(self, other: Report) -> None:
        """Another report's parts, as the next of this one."""
        self.parts += other.parts
        self.failed += other.failed
        self.data |= other.data

    def provenance(self, of: Provenance) -> None:
        """What it was made of and with: inputs with their hashes, versions, options."""
        self.heading("Made from")
        self.parts.append(of.html())

    def side_by_side(self, count: int) -> None:
        """Put the last ``count`` parts into one row."""
        row = "".join(f"<div>{part}</div>" for part in self.parts[-count:])
        self.parts[-count:] = [f'<div class="row">{row}</div>']

    def closing(self, files: Iterable[Sequence[str]], options: Mapping[str, Any], seconds: Mapping[str, float]) -> None:
        """The end of a report: files beside it with their content, options, and the seconds that each stage took."""
        self.heading("Files beside this report")
        self.table(["file", "content"], files)
        self.heading("Options and times")
        self.table(["option", "value"], [(named(k), setting(v)) for k, v in options.items()])
        self.table(["stage", "s"], [(stage, duration(s)) for stage, s in seconds.items()])
        self.side_by_side(2)

    def html(self, style: str = "", script: str = "") -> str:
        """The whole page; ``style`` and ``script`` are put behind every report's own."""
        more = f"\n<script>{script}</script>" if script else ""
        return (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{escape(self.title)}</title><style>{web.style()}{style}</style></head><body>"
            f'<h1>{escape(self.title)}</h1><p class="soft">{escape(self.subtitle)}</p>\n'
            + "\n".join(self.parts)
            + "".join(f'\n<script type="text/plain" id="{escape(k)}">{v}</script>' for k, v in self.data.items())
            + f"\n<script>{web.script()}</script>{more}</body></html>\n"
        )


def _smaller(png: bytes) -> tuple[str, bytes]:
    """The kind and the bytes of a picture."""
    if len(png) <= LARGE_PNG:
        return "png", png
    from PIL import Image

    stream = byte_io.BytesIO()
    Image.open(byte_io.BytesIO(png)).convert("RGB").save(stream, "webp", quality=86, method=3)
    return ("webp", stream.getvalue()) if stream.tell() < len(png) else ("png", png)


def _row(tag: str, texts: Iterable[str], words: Sequence[bool]) -> str:
    return "".join(
        f"<{tag}{_STYLES[of_words, tag == 'td' and len(text) > LONGEST]}>{escape(text)}</{tag}>"
        for text, of_words in zip(texts, words, strict=True)
    )


def _column(values: Sequence[Any]) -> list[str]:
    """The texts of a column; one of nothing but numbers ends at the same decimal where they are of one size."""
    texts = [cell(v) for v in values]
    known = [(k, v) for k, v in enumerate(values) if v is not None]
    if not all(isinstance(v, float) for _, v in known):
        return texts
    numbers = [k for k, v in known if math.isfinite(v) and "e" not in texts[k]]
    sizes = [abs(values[k]) for k in numbers if values[k] != 0.0]
    if not sizes or max(sizes) > ONE_SIZE * min(sizes):
        return texts
    decimals = max(len(texts[k].partition(".")[2]) for k in numbers)
    for k in numbers:
        texts[k] = f"{values[k]:z.{decimals}f}"
    return texts


def _of_words(column: Sequence[Any]) -> bool:
    """Whether most of what a column says are words."""
    said = [v for v in column if v is not None and v == v and v not in ("", "-", "–", "−")]
    return 2 * sum(isinstance(v, str) and not _FIGURE.fullmatch(v) for v in said) > len(said)


def measured(value: float, sigma: float, sign: str = "") -> tuple[str, str]:
    """A number and its sigma with the digits that it earns, as text; dashes where there is none."""
    if not math.isfinite(value):
        return "–", "–"
    digits = earned_decimals([sigma])
    return f"{value:{sign}z.{digits}f}", f"{sigma:.{digits}f}" if sigma > 0 else "–"


def fixed(value: float, decimals: int) -> str:
    """A number with so many decimals, a dash where there is none."""
    return f"{value:z.{decimals}f}" if math.isfinite(value) else "–"


def measured_rows(values: Iterable[Iterable[float]], sigmas: Iterable[Iterable[float]]) -> list[tuple[str, ...]]:
    """`measured` of rows of several numbers each: the numbers, then their sigmas."""
    pairs = [[measured(v, s) for v, s in zip(*row, strict=True)] for row in zip(values, sigmas, strict=True)]
    return [(*(value for value, _ in row), *(sigma for _, sigma in row)) for row in pairs]


def cell(value: Any) -> str:
    """A value as table text: floats with 4 significant digits, None and NaN as a dash."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        if value != value:  # NaN
            return "–"
        return f"{value:z.4g}" if abs(value) < 1e4 else f"{value:.0f}"
    return str(value)
