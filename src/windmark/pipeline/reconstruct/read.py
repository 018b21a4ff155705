"""Pictures, primary markers and labels of a reconstruction, from their files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.errors import WindmarkError
from windmark.geometry import Camera, Pose
from windmark.io.csvtable import Table
from windmark.pipeline.calibrate.from_pictures import LABEL_PX
from windmark.pipeline.calibrate.read import MatchOptions, find_spots, read_image, read_pictures
from windmark.pipeline.clock import Clock
from windmark.pipeline.lengths import Lengths
from windmark.scene import MarkerSet, View
from windmark.tasks.blur import spot_blur
from windmark.tasks.calibrate.marks import Taken
from windmark.tasks.calibrate.picture import Picture
from windmark.tasks.labels import Place, fixed_spots

LABEL_COLUMNS = ("image", "name", "x", "y")


@dataclass(frozen=True)
class LabelTable:
    """Places of primary markers in pictures, given by hand, with their table for messages.

    Parameters
    ----------
    table : columns image, name, x, y
    image : name of the picture of each row
    xy : (N, 2) pixels
    """

    table: Table
    image: tuple[str, ...]
    xy: NDArray[np.float64]

    def spots(self, pictures: Sequence[Picture]) -> dict[str, dict[int, str]]:
        """{picture: {spot: name}}: the nearest spot of each place.

        Raises
        ------
        FileError
            Names the line that has no spot within `LABEL_PX`, or whose spot has another name already.
        """
        found = {p.name: p.detections for p in pictures}
        places: dict[str, dict[str, Place]] = {}
        out: dict[str, dict[int, str]] = {}
        for row, (image, name) in enumerate(zip(self.image, self.table.text("name"), strict=True)):
            mine = places.setdefault(image, {})
            mine[name] = (float(self.xy[row, 0]), float(self.xy[row, 1]))
            try:
                out[image] = fixed_spots(found[image], mine, LABEL_PX)
            except WindmarkError as error:
                self.table.fail(row, f"picture {image}: {error!s}")
        return out


def read_labels(path: Path, images: Sequence[str], primary: MarkerSet) -> LabelTable:
    """Read a table ``image,name,x,y``; the image is the picture's name, with or without its extension.

    Raises
    ------
    FileError
        Names the line: unknown picture, a marker that is no primary and in one picture only, a marker twice in one
        picture, no number.
    """
    table = io.read_table(path, required=LABEL_COLUMNS, known=LABEL_COLUMNS)
    known, names = set(images), set(primary.name.tolist())
    times = Counter(table.text("name"))
    out: list[str] = []
    seen: dict[tuple[str, str], int] = {}
    for row, (image, name) in enumerate(zip(table.text("image"), table.text("name"), strict=True)):
        out.append(image if image in known else str(Path(image).with_suffix("")))
        if out[-1] not in known:
            table.fail(row, f"a label is for the picture {image!r}; there are {', '.join(images[:5])}")
        if names and name not in names and times[name] < 2:
            table.fail(row, f"{name!r} is no primary marker ({', '.join(sorted(names)[:5])}), and in no other picture")
        if (out[-1], name) in seen:
            table.fail(row, f"{name} is already on line {seen[out[-1], name]} for this picture; expected it once")
        seen[out[-1], name] = int(table.lines[row])
    return LabelTable(table, tuple(out), np.stack([table.numbers("x"), table.numbers("y")], axis=1))


def read_poses(folder: Path, images: Sequence[str], lengths: Lengths) -> dict[str, Pose]:
    """Poses of the pictures that have a file NAME.json in a folder, such as ``views`` of a calibration.

    Raises
    ------
    FileError
        No picture has a file, or a file has no pose or one in another length unit.
    """
    poses = {}
    for name in images:
        path = folder / f"{name}.json"
        if not path.exists():
            continue
        pose = lengths.camera(path).cam_from_model
        if pose is None:
            raise io.FileError(path, f"is a camera without a pose; expected that of the picture {name}")
        poses[name] = pose
    if not poses:
        raise io.FileError(folder, f"has no pose of any picture; expected files such as {images[0]}.json")
    return poses


def read_spots(
    paths: Sequence[io.PictureFile], cameras: Mapping[str, Camera], patterns: Mapping[str, str], options: MatchOptions,
    clock: Clock,
) -> tuple[list[Picture], tuple[View, ...]]:  # fmt: skip
    """All pictures with their spots, and the views that they are.

    Raises
    ------
    ValueError
        For fewer than two readable pictures, sizes that are not those of their camera, names that say no camera.
    """

    def look(path: io.PictureFile, name: str, taken: Taken) -> Picture:
        image, mask = read_image(path, options)
        size = (int(image.shape[1]), int(image.shape[0]))
        spots = find_spots(image, mask, options)
        blur, radius = spot_blur(image, spots, options.polarity)
        return Picture(name, taken.camera, size, spots, taken.frame, blur_px=blur, radius_px=radius)

    with clock("detect"):
        pictures, _ = read_pictures(paths, cameras, patterns, None, look, clock.progress)
    return pictures, tuple(View(p.name, p.camera, p.frame) for p in pictures)
