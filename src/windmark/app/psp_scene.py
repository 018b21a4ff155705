"""A paint test in 3D: Cp of every point, with sigma, on its deformed grid, with cameras, markers and residuals."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.app import standing_scene as parts
from windmark.app.scene3d import Cut, Field, Frames, Scene3D
from windmark.pipeline.deform.followed import Standing
from windmark.pipeline.psp import PointRecord, PspTest
from windmark.resection import section
from windmark.scene import Mesh

MOST = 24
"""Points whose fields can be chosen."""
Fields = Callable[[PointRecord], tuple[Mesh, dict[str, NDArray[np.float64]]]]


def psp_scene(test: PspTest, records: Sequence[PointRecord], fields: Fields) -> Scene3D | None:
    """Points evenly chosen, each on its own grid; None where there is none. ``fields`` reads one's."""
    if not records:
        return None
    chosen = [records[k] for k in parts.spread(len(records), len(test.mesh.vertices), MOST)]
    read = [fields(r) for r in chosen]
    mesh, unit, markers = read[0][0], test.project.length_unit, test.deforming.test.markers
    every = np.concatenate([of["cp"][np.isfinite(of["cp"])] for _, of in read])
    low, high = np.percentile(every, [0.5, 99.5]) if len(every) else (0.0, 1.0)
    limits = (float(f"{low:.4g}"), float(f"{high:.4g}")) if high > low else None
    standing = [_standing(r) for r in chosen]
    residuals = [None if s is None else parts.shifts(r.name, s, markers, unit, of_model=True)
                 for r, s in zip(chosen, standing, strict=True)]  # fmt: skip
    names = [f"{r.name}, {r.alpha_deg:g}°" for r in chosen]
    shown = [
        Field(r.name, name, "Cp", of["cp"], of["sigma_cp"], limits=limits, shifts=off, frame=k)
        for k, (r, name, (_, of), off) in enumerate(zip(chosen, names, read, residuals, strict=True))
    ]
    known = [s for s in standing if s is not None]
    if len(known) < len(chosen):  # of a run that was stopped by another version
        standing, known = [], []
    places = parts.places(known, of_model=True) if known else None
    frames = Frames(
        tuple(names), np.stack([of.vertices - mesh.vertices for of, _ in read]).astype(np.float32), None, 1.0, "",
        None if places is None else (places - places[0])[:, parts.own_markers(markers)].astype(np.float32),
        tuple(parts.stations(s, of_model=True) for s in known), first=0,
    )  # fmt: skip
    pose = test.deforming.test.stations[0].cam_from_tunnel
    seen = np.any([np.isfinite(f.values) for f in shown], axis=0)
    return Scene3D(
        unit, pose.rotation[2] - 0.3 * pose.rotation[0], -pose.rotation[1], mesh, shown,
        markers=None if places is None else parts.shown_markers(markers, places[0], unit),
        cuts=_cuts(test, mesh), frames=frames, focus=mesh.vertices[seen],
    )  # fmt: skip


def _standing(record: PointRecord) -> Standing | None:
    """Of the first picture with wind: the point's grid is bent as it has it."""
    return next((f.standing for f in record.followed), None)


def _cuts(test: PspTest, mesh: Mesh) -> list[Cut]:
    """Where the sections are, on the whole surface."""
    found = [(entry.name, section(mesh, entry.point, entry.normal)) for entry in test.project.section]
    return [Cut(name, cut.xyz, cut.line) for name, cut in found if len(cut)]
