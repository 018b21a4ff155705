"""An infrared run in 3D: temperature and heat flux frame by frame, where the model was, with cameras and markers."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.app import standing_scene as parts
from windmark.app.scene3d import Field, Frames, Scene3D, looking_over
from windmark.errors import g3
from windmark.pipeline.infrared import FrameRecord, InfraredRun
from windmark.scene import Mesh

MOST = 12
"""Frames that are shown."""
QUANTITIES = (("heat_flux", "heat flux", "W/m²"), ("temperature", "temperature", "K"))
Fields = Callable[[str], tuple[Mesh, dict[str, NDArray[np.float64]]]]


def infrared_scene(run: InfraredRun, records: Sequence[FrameRecord], fields: Fields) -> Scene3D | None:
    """Frames that have fields, evenly chosen, in the tunnel; None where there is none. ``fields`` reads one's."""
    records = [r for r in records if r.followed.standing is not None]
    if not records:
        return None
    chosen = [records[k] for k in parts.spread(len(records), len(run.mesh.vertices), MOST)]
    read = [fields(r.key) for r in chosen]
    mesh, unit, markers = read[0][0], run.project.length_unit, run.deforming.test.markers
    standing = [r.followed.standing for r in chosen if r.followed.standing is not None]
    names = tuple(f"frame {r.key}" + (f", {g3(r.time_s)} s" if np.isfinite(r.time_s) else "") for r in chosen)
    residuals = [parts.shifts(name, s, markers, unit, of_model=False) for name, s in zip(names, standing, strict=True)]
    shown = []
    for key, words, of_unit in QUANTITIES:
        none = np.full(len(mesh.vertices), np.nan)
        pairs = [(of.get(key, none), of.get(f"sigma_{key}", none)) for _, of in read]
        known = np.concatenate([v[np.isfinite(v)] for v, _ in pairs])
        if not known.size:
            continue
        low, high = np.percentile(known, [0.5, 99.5])
        limits = (float(f"{low:.5g}"), float(f"{high:.5g}")) if high > low else None
        shown += [
            Field(f"{r.key}-{key}", f"{words}, {name}", f"{words}, {of_unit}", *pair, limits=limits, shifts=off,
                  frame=k)
            for k, (r, name, pair, off) in enumerate(zip(chosen, names, pairs, residuals, strict=True))
        ]  # fmt: skip
    places = parts.places(standing, of_model=False)
    frames = Frames(
        names, np.stack([of.vertices - mesh.vertices for of, _ in read]).astype(np.float32), None, 1.0, "",
        (places - places[0])[:, parts.own_markers(markers)].astype(np.float32),
        tuple(parts.stations(s, of_model=False) for s in standing), tuple(residuals), len(chosen) - 1,
    )  # fmt: skip
    seen = np.any([np.isfinite(f.values) for f in shown], axis=0) if shown else mesh.used
    first = next(iter(standing[0].cameras.values()))[1]
    ahead, up = looking_over(first, mesh.vertices[seen])
    last = max((k for k, f in enumerate(shown) if f.label == shown[0].label), default=0)
    return Scene3D(unit, ahead, up, mesh, shown, markers=parts.shown_markers(markers, places[0], unit), frames=frames,
                   focus=mesh.vertices[seen], chosen=last)  # fmt: skip
