"""The verdict on a file in another format: what later jobs would miss in it, and sizes that no model has."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from windmark.errors import g2, g3
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding, Verdict
from windmark.scene.units import IN_MM

Record = Mapping[str, Any]
_UNIT = "see in which unit the source is: --unit says it, --to-unit converts"
_KEEP = {
    "grid": "take a format that keeps it, such as .vtm or .vtp, or keep the source",
    "markers": "take .csv, which keeps it, or keep the source",
    "camera": "see docs/reference/formats.md for what the format holds, or take .json",
    "pictures": "take .tif, .png or .h5, which keep every grey level",
}


def converted_verdict(record: Record) -> Verdict:
    """Judge a conversion by what the job says of it."""
    kind = record["kind"]
    found = [Finding(DOUBTFUL, "format", said, _KEEP[kind]) for said in _harm(record)]
    found += _size(record)
    if record.get("doubtful"):
        found.append(Finding(DOUBTFUL, "units", record["doubtful"], "see in which unit the source has its matrix"))
    return Verdict.of(found, 1, f"read back, it holds the same {kind}", "use it in place of the source")


def _harm(record: Record) -> list[str]:
    """What is lost that counts."""
    if record["kind"] == "camera":
        off = record["read_back_largest_px"]
        return [f"read back, rays are {g2(off)} px beside their pixels"] if off > rules.PLACE_PX else []
    if record["kind"] == "pictures":
        frames, same = record["read_back"]["frames"], record["read_back"]["same"]
        return [f"{frames - same} of {frames} pictures are not the same to the last grey level"] * (same < frames)
    return [f"lost: {said}" for said in record["harm"]]


def _size(record: Record) -> list[Finding]:
    """Models and distances of a size that is none, in the unit that is said."""
    unit = record.get("length_unit")
    if not unit:
        return []
    metres = IN_MM[unit] / 1000
    low, high = (limit / metres for limit in rules.MODEL_M)
    size, distance = record.get("size"), record.get("distance")
    if size and not low <= size <= high:
        said = f"the {'markers span' if record['kind'] == 'markers' else 'grid spans'} {g3(size)} {unit}"
        return [Finding(DOUBTFUL, "units", f"{said}, as no model does", _UNIT)]
    if distance and distance > high:  # a rig's first camera is at nothing
        said = f"the camera is {g3(distance)} {unit} from the model, as none is"
        return [Finding(DOUBTFUL, "units", said, _UNIT)]
    return []
