"""Markers of pictures that were told by name: from a table of matches, or of detections with names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.scene import Detections

OF_DETECTIONS = {"radius", "merit", "axis_major", "axis_minor", "angle_deg", "depth", "flags"}
"""Columns that a table of matches does not have."""


@dataclass(frozen=True)
class NamedSpots:
    """Spots of one picture and their names."""

    spots: Detections
    names: tuple[str, ...]

    def pairs_with(self, image: NamedSpots) -> NDArray[np.int64]:
        """(K, 2) which of these is which of another picture's, by name."""
        there = {name: k for k, name in enumerate(image.names)}
        return np.array([(k, there[n]) for k, n in enumerate(self.names) if n in there], dtype=np.int64).reshape(-1, 2)


def read_named(path: Path) -> Mapping[str, NamedSpots]:
    """Named spots of every image of a table: `io.read_matches`, or `io.read_detections` with the column `name`.

    Raises
    ------
    FileError
        As those; also for a name that comes twice in one image.
    """
    table = io.read_table(path, required=("name", "x", "y"), known=None)
    if not OF_DETECTIONS & set(table.columns):
        matches = io.read_matches(path)
        return {
            str(image): NamedSpots(
                Detections.make(matches.xy[matches.image == image], cov=matches.cov[matches.image == image]),
                tuple(matches.name[matches.image == image].tolist()),
            )
            for image in dict.fromkeys(matches.image.tolist())
        }
    spots, names = io.read_detections(path), io.read_detection_names(path)
    found = {}
    for image, every in names.items():
        named = [k for k, name in enumerate(every) if name]
        mine = [every[k] for k in named]
        double = sorted({name for name in mine if mine.count(name) > 1})
        if double:
            raise io.FileError(path, f"{double[0]!r} is the name of two spots of image {image!r}; expected one")
        found[image] = NamedSpots(spots[image].take(named), tuple(mine))
    return found


def of_image(table: Mapping[str, NamedSpots], path: Path) -> NamedSpots | None:
    """The spots of a picture; its column `image` holds the file's name with or without extension."""
    return table.get(path.name, table.get(path.stem))
