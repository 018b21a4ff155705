"""How a verdict looks: three words, three shapes, three colours that everybody tells apart, on paper too."""

from __future__ import annotations

from html import escape
from typing import Any

from windmark.app.report import Report
from windmark.pipeline.verdict import BAD, DOUBTFUL, GOOD, Verdict, Word

SIGNS: dict[Word, str] = {GOOD: "●", DOUBTFUL: "▲", BAD: "■"}
COLOURS: dict[Word, str] = {GOOD: "#004488", DOUBTFUL: "#DDAA33", BAD: "#BB5566"}
"""Blue, yellow and red of Paul Tol's high-contrast scheme: also apart in grey, and for every colour blindness."""
_SHAPES: dict[Word, str] = {
    GOOD: '<circle cx="12" cy="12" r="10"/>',
    DOUBTFUL: '<path d="M12 2 23 22H1z"/>',
    BAD: '<rect x="2" y="2" width="20" height="20"/>',
}
SHOWN = 6
"""Further findings that are listed; all are in summary.json."""


def verdict_lines(verdict: Verdict) -> list[str]:
    """For the terminal: word and reason, next step."""
    return [
        f"{SIGNS[verdict.word]} {verdict.word}: {verdict.reason}",
        *([f"  next: {verdict.next_step}"] if verdict.next_step else []),
    ]


def judged(record: dict[str, Any], verdict: Verdict) -> list[str]:
    """Put a verdict into a job's record; its lines for the terminal."""
    record["verdict"] = verdict.record()
    return verdict_lines(verdict)


def put_verdict(page: Report, verdict: Verdict) -> None:
    """At the head of a report."""
    page.parts.insert(0, verdict_html(verdict))


def verdict_html(verdict: Verdict) -> str:
    """A head of a page: shape, word, reason, next step; further findings below."""
    colour = COLOURS[verdict.word]
    shape = (
        f'<svg viewBox="0 0 24 24" width="30" height="30" aria-hidden="true" style="flex:none;fill:{colour};'
        f'stroke:currentColor;stroke-width:.8">{_SHAPES[verdict.word]}</svg>'
    )
    more = [f for f in verdict.findings if f.reason not in verdict.reason]
    rest = "".join(
        f"<li>{escape(f'{f.where}: ' if f.where else '')}{escape(f.reason)} <i>{escape(f.next_step)}</i></li>"
        for f in more[:SHOWN]
    )
    also = f" and {len(more) - SHOWN} more (summary.json)" if len(more) > SHOWN else ""
    listed = f"<details><summary>also found: {len(more)}{also}</summary><ul>{rest}</ul></details>" if more else ""
    return (
        f'<section class="verdict" data-verdict="{verdict.word}" style="display:flex;gap:.9rem;margin:.9rem 0;'
        f'padding:.7rem 1rem;border-left:.4rem solid {colour}">{shape}<div><strong style="font-size:1.15rem">'
        f"{verdict.word}</strong>: {escape(verdict.reason)}."
        f"<br>Next: {escape(verdict.next_step)}.{listed}</div></section>"
    )
