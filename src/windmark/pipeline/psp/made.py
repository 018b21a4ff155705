"""What a paint test's results are made with: a run that goes on, and every worker of a cluster, must have the same."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from windmark.pipeline import same_run
from windmark.pipeline.deform.resume import inputs as deform_inputs
from windmark.pipeline.psp.entries import POINT
from windmark.pipeline.psp.load import PspTest
from windmark.pipeline.psp.project import PspProject
from windmark.pipeline.psp.sensors import named_file


def made_with(test: PspTest) -> dict[str, Any]:
    """See `same_run.made_with`; where the results go is left out."""
    project = test.project
    options = json.loads(project.model_dump_json(exclude={"path": True, "output": {"folder"}}))
    return same_run.made_with("psp", {f"[{k}] of the project": v for k, v in options.items()},
                              same_run.with_all(inputs(test), test.read, project.path))  # fmt: skip


def inputs(test: PspTest) -> list[tuple[str, Path]]:
    """The files besides the points' pictures that a project names, each with its key; dark and flat pictures, whose
    pattern names them, are among `PspTest.read`.
    """
    project: PspProject = test.project
    out = [("points.table", project.points.table)]
    out += [(f"wtd of point {row.name}", row.conditions_file) for row in test.rows if row.conditions_file is not None]
    paint = (("paint.cell", project.paint.cell), ("paint.calibration", project.paint.calibration))
    out += [(key, path) for key, path in paint if path is not None]
    out += deform_inputs(test.deforming.project)
    taps, warm = project.taps, project.temperature
    if project.reference is not None and project.reference.table is not None:
        out.append(("reference.table", project.reference.table))
    for key, pattern in (("paint.steady", project.paint.steady), ("temperature.maps", warm.maps)):
        maps = set() if pattern is None else {project.path.parent / pattern.replace(POINT, r.name) for r in test.rows}
        out += [(f"{key} {file.name}", file) for file in sorted(maps) if file.is_file()]
    if taps is not None:
        out += [("taps.file", taps.file), ("taps.pressures", taps.pressures)]
    if warm.thermocouples is not None and warm.readings is not None:
        out += [("temperature.thermocouples", warm.thermocouples), ("temperature.readings", warm.readings)]
    for file_key, path in (("temperature.paint", warm.paint), ("patches.polygons", project.patches.polygons)):
        out += [] if path is None else [(file_key, path)]
    out += [(f"place[{i}].file", entry.file) for i, entry in enumerate(project.place)]
    out += [(f"camera of view {v.name}", v.camera) for v in project.view if v.camera is not None]
    if project.radiometry.linearity is not None:
        out += [(f"radiometry.linearity of {c.name}", named_file(project, "linearity", c.name)) for c in project.camera]
    return out
