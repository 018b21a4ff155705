"""A paint test in 3D: Cp of every point, with sigma, on one grid and one scale."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.app.scene3d import Cut, Field, Scene3D
from windmark.pipeline.psp import PointRecord, PspTest
from windmark.resection import section
from windmark.scene import Mesh

MOST = 24
"""Points whose fields can be chosen."""
Fields = Callable[[PointRecord], tuple[Mesh, dict[str, NDArray[np.float64]]]]


def psp_scene(test: PspTest, records: Sequence[PointRecord], fields: Fields) -> Scene3D | None:
    """Points evenly chosen, on the grid of the first; None where there is none. ``fields`` reads one's."""
    chosen = [records[k] for k in np.unique(np.linspace(0, len(records) - 1, min(MOST, len(records))).astype(int))]
    if not chosen:
        return None
    read = [fields(r) for r in chosen]
    mesh = read[0][0]
    every = np.concatenate([of["cp"][np.isfinite(of["cp"])] for _, of in read])
    low, high = np.percentile(every, [0.5, 99.5]) if len(every) else (0.0, 1.0)
    limits = (float(f"{low:.4g}"), float(f"{high:.4g}")) if high > low else None
    shown = [
        Field(r.name, f"{r.name}, {r.alpha_deg:g}°", "Cp", of["cp"], of["sigma_cp"], limits=limits)
        for r, (_, of) in zip(chosen, read, strict=True)
    ]
    pose = test.deforming.test.stations[0].cam_from_tunnel
    seen = np.any([np.isfinite(f.values) for f in shown], axis=0)
    return Scene3D(test.project.length_unit, pose.rotation[2] - 0.3 * pose.rotation[0], -pose.rotation[1], mesh, shown,
                   cuts=_cuts(test, mesh), focus=mesh.vertices[seen])  # fmt: skip


def _cuts(test: PspTest, mesh: Mesh) -> list[Cut]:
    """Where the sections are, on the whole surface."""
    found = [(entry.name, section(mesh, entry.point, entry.normal)) for entry in test.project.section]
    return [Cut(name, cut.xyz, cut.line) for name, cut in found if len(cut)]
