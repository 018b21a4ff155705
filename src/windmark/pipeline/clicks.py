"""Matches by hand, read from a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from windmark import io
from windmark.tasks.clicked_pair import Clicks


def read_clicks(path: Path, names: Sequence[str]) -> Clicks:
    """A table ``x_a,y_a,x_b,y_b[,name]``, or ``image,name,x,y`` with the same names in both pictures.

    Raises
    ------
    FileError
        Names the line: no number, unknown picture, a name twice in one picture, no name in both.
    """
    table = io.read_table(path, required=(), known=("x_a", "y_a", "x_b", "y_b", "name", "image", "x", "y"))
    if "x_a" in table:
        four = table.together("x_a", "y_a", "x_b", "y_b")
        assert four is not None
        table.check(np.isfinite(four).all(axis=1), "a place is missing; expected x_a, y_a, x_b, y_b")
        own = table.text("name") if "name" in table else [str(k + 1) for k in range(len(table))]
        seen: set[str] = set()
        for row, name in enumerate(own):
            if name in seen:
                table.fail(row, f"the name {name} is there before; expected it once")
            seen.add(name)
        return Clicks(four[:, :2], four[:, 2:], tuple(own), "name" in table)
    lost = [c for c in ("image", "name", "x", "y") if c not in table]
    if lost:
        raise io.FileError(path, f"has no column {lost[0]}; expected x_a,y_a,x_b,y_b or image,name,x,y", "header")
    xy = np.column_stack([table.numbers("x"), table.numbers("y")])
    places: dict[str, dict[str, int]] = {n: {} for n in names}
    for row, (image, name) in enumerate(zip(table.text("image"), table.text("name"), strict=True)):
        stem = image if image in places else str(Path(image).with_suffix(""))
        if stem not in places:
            table.fail(row, f"the picture {image!r} is none of {', '.join(names)}")
        if name in places[stem]:
            table.fail(row, f"{name} is there before for this picture; expected it once")
        places[stem][name] = row
    a, b = (places[n] for n in names)
    both = [n for n in a if n in b]
    if not both:
        raise io.FileError(path, "no name is in both pictures", "name")
    return Clicks(xy[[a[n] for n in both]], xy[[b[n] for n in both]], tuple(both), True)
