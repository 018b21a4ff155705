"""Names and exclusions of the viewer: which spots the project file speaks of, and what a click writes into it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from windmark.errors import UsageError, WindmarkError
from windmark.pipeline.project import Project
from windmark.pipeline.project_edit import SpotEdit, edit_spots
from windmark.pipeline.project_entries import ImageEntry
from windmark.pipeline.results import ImageResult, RunResult
from windmark.pipeline.typed import nearest
from windmark.scene import Detections
from windmark.tasks.labels import excluded_spots

Place = tuple[float, float]


@dataclass(frozen=True)
class Told:
    """What the project file says of the spots of one image.

    Parameters
    ----------
    labels : marker name -> spot, None where no spot is near enough
    excluded : the same for each item of ``exclude``
    """

    labels: dict[str, int | None]
    excluded: list[int | None]

    @staticmethod
    def of(entry: ImageEntry, spots: Detections | None, within_px: float) -> Told:
        """Which spots are meant, as a run finds it."""
        found = Detections.make([]) if spots is None else spots
        return Told(
            {name: _meant(found, place, within_px) for name, place in entry.labels.items()},
            [_meant(found, place, within_px) for place in entry.exclude],
        )

    def record(self) -> dict[str, Any]:
        """For the page."""
        return {"labels": self.labels, "excluded": self.excluded}


def _meant(spots: Detections, place: Place, within_px: float) -> int | None:
    try:
        return int(excluded_spots(spots, [place], within_px)[0])
    except WindmarkError:
        return None


def name_spot(result: RunResult, project: Project, image: str, spot: Any, marker: Any) -> str:
    """Write that a spot is a marker, and no other one is; what else the file said of this spot goes. What was done, in
    words.

    Raises
    ------
    UsageError
        For an unknown image, spot or marker.
    WindmarkError
        Of `edit_spots`.
    """
    item, entry = _image(result, project, image)
    k, place = spot_of(item, spot)
    names = [] if result.markers is None else [str(n) for n in result.markers.name]
    if marker not in names:
        raise UsageError(f"{str(marker)[:60]!r} is no marker of the table with the roles that take part"
                         + nearest(str(marker), names))  # fmt: skip
    told = Told.of(entry, item.detections, project.register_.label_distance_px)
    others = [name for name, at in told.labels.items() if at == k and name != marker]
    edit_spots(project.path, image, SpotEdit((marker, place), None, others, _items(told, k)))
    before = told.labels.get(marker, k)
    moved = "" if before == k else ", a name that had no spot" if before is None else f", which was spot {before}"
    return f"{image}: spot {k} is {marker}{moved}"


def exclude_spot(result: RunResult, project: Project, image: str, spot: Any) -> str:
    """Write that a spot takes no part; a name that the file gave it goes. Answer and errors as `name_spot`."""
    item, entry = _image(result, project, image)
    k, place = spot_of(item, spot)
    told = Told.of(entry, item.detections, project.register_.label_distance_px)
    if _items(told, k):
        raise UsageError(f"{image}: spot {k} is excluded already")
    named = [name for name, at in told.labels.items() if at == k]
    edit_spots(project.path, image, SpotEdit(None, place, named))
    return f"{image}: spot {k} is excluded"


def free_spot(result: RunResult, project: Project, image: str, spot: Any) -> str:
    """Take out what the file says of a spot. Gives what was done; errors as `name_spot`."""
    item, entry = _image(result, project, image)
    k, _ = spot_of(item, spot)
    told = Told.of(entry, item.detections, project.register_.label_distance_px)
    named, items = [name for name, at in told.labels.items() if at == k], _items(told, k)
    if not named and not items:
        raise UsageError(f"{image}: the project file says nothing of spot {k}")
    edit_spots(project.path, image, SpotEdit(None, None, named, items))
    return f"{image}: spot {k} is free again"


def _items(told: Told, spot: int) -> Sequence[int]:
    return [number for number, at in enumerate(told.excluded) if at == spot]


def _image(result: RunResult, project: Project, name: str) -> tuple[ImageResult, ImageEntry]:
    item = next((i for i in result.images if i.name == name), None)
    entry = next((e for e in project.image if e.label == name), None)
    if item is None or entry is None:
        raise UsageError(f"there is no image {str(name)[:60]!r} in this run and in {Path(project.path).name}")
    return item, entry


def spot_of(item: ImageResult, number: Any) -> tuple[int, Place]:
    """The number of a spot, checked, and its place; `UsageError` where there is no such spot."""
    count = 0 if item.detections is None else len(item.detections)
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < count:
        has = f"it has {count}, counted from 0" if count else "none was found or looked for"
        raise UsageError(f"{item.name} has no spot {str(number)[:20]}; {has}")
    assert item.detections is not None
    x, y = item.detections.xy[number].tolist()
    return number, (x, y)
