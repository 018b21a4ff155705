"""PLOT3D layouts in words, as the command line takes them: ``ascii``, ``double,big,iblank`` and so on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from windmark import io
from windmark.errors import UsageError
from windmark.io import Plot3dLayout

WORDS: dict[str, dict[str, Any]] = {
    "ascii": {"text": True, "record_mark": 4, "records": "whole"},
    "binary": {"text": False},
    "little": {"text": False, "byte_order": "<"},
    "big": {"text": False, "byte_order": ">"},
    "records": {"text": False, "record_mark": 4},
    "records8": {"text": False, "record_mark": 8},
    "stream": {"text": False, "record_mark": 0, "records": "whole"},
    "whole": {"records": "whole"},
    "component": {"text": False, "records": "component"},
    "plane": {"text": False, "records": "plane"},
    "single": {"real_bytes": 4},
    "double": {"real_bytes": 8},
    "iblank": {"iblank": True},
    "no-iblank": {"iblank": False},
    "multi-block": {"multi_block": True},
    "one-block": {"multi_block": False},
}
"""Each word with what it fixes: binary or text, byte order, record marks (of 4 or 8 bytes, or none: a C stream), what
is in a record, precision, IBLANK, number of blocks at the head of the file."""


def fixed_by(option: str, text: str | None) -> dict[str, Any]:
    """What words fix, as fields of `Plot3dLayout`.

    Raises
    ------
    ValueError
        For an unknown word, or two that contradict each other.
    """
    said: dict[str, Any] = {}
    by: dict[str, str] = {}
    for word in filter(None, (w.strip().lower() for w in (text or "").split(","))):
        if word not in WORDS:
            raise UsageError(f"{option} takes words of {', '.join(WORDS)}, with commas between, got {word!r}")
        for key, value in WORDS[word].items():
            if said.setdefault(key, value) != value:
                raise UsageError(f"{option}: {by[key]} and {word} contradict each other")
            by.setdefault(key, word)
    return said


def read_layout(path: Path, text: str | None) -> Plot3dLayout | None:
    """The layout of a PLOT3D file of which the user knows something; None where nothing is said.

    Raises
    ------
    FileError
        Where no layout with these words fits the file, or several do.
    """
    said = fixed_by("--from-plot3d", text)
    if not said:
        return None
    fits = io.fitting_layouts(path)
    chosen = [layout for layout in fits if all(getattr(layout, key) == value for key, value in said.items())]
    if said.get("text"):  # text has no records and shows its precision by its digits
        asked = [key for key in ("iblank", "multi_block") if key in said]
        chosen = [a for a in fits if a.text and all(getattr(a, key) == said[key] for key in asked)]
    if len(chosen) != 1:
        which = " or ".join(layout.words for layout in (chosen or fits))
        what = "several layouts fit" if chosen else f"does not fit --from-plot3d {text}"
        raise io.FileError(path, f"{what}; it could be: {which}")
    return chosen[0]


def write_layout(
    text: str | None, source: Plot3dLayout | None, blanked: bool, double: bool, blocks: int
) -> Plot3dLayout:
    """The layout to write: what the words say, then the source's own, then what `io.write_plot3d` takes.

    Parameters
    ----------
    text : the user's words
    source : layout of the source, if it is PLOT3D too
    blanked : whether the grid has blanked nodes, which need IBLANK
    double : whether single precision would lose digits
    blocks : number of blocks

    Raises
    ------
    ValueError
        For words that cannot be together, or that the grid cannot have.
    """
    said = fixed_by("--plot3d", text)
    base = replace(source or Plot3dLayout(), note="")
    base = replace(base, iblank=base.iblank or blanked, multi_block=base.multi_block or blocks > 1)
    base = replace(base, real_bytes=8 if double else base.real_bytes)
    if base.records != "whole" and not said.get("record_mark", base.record_mark):
        base = replace(base, records="whole")
    if said.get("records", "whole") != "whole" and not said.get("record_mark", base.record_mark):
        said.setdefault("record_mark", 4)
    if said.get("text"):
        base = replace(base, records="whole")
    layout = replace(base, **said)
    if blanked and not layout.iblank:
        raise UsageError("--plot3d no-iblank: the grid has blanked nodes, which need IBLANK")
    if blocks > 1 and not layout.multi_block:
        raise UsageError(f"--plot3d one-block: the grid has {blocks} blocks")
    return layout
