"""A reconstruction as files and as a record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import windmark
from windmark import io
from windmark.calibration import Calibration
from windmark.errors import g3
from windmark.geometry import PARAMETERS
from windmark.pipeline.calibrate.outputs import match_columns, sigma_rms, write_network
from windmark.scene import Detections, MarkerSet
from windmark.tasks.calibrate.marks import Marks
from windmark.tasks.calibrate.picture import Picture
from windmark.tasks.reconstruct.pair import PairLines
from windmark.tasks.reconstruct.primaries import PRIMARY_SIGMA, default_sigma
from windmark.tasks.reconstruct.result import NotReconstructed, Reconstruction

Array = NDArray[np.float64]
Record = dict[str, Any]


@dataclass(frozen=True)
class Residuals:
    """Primary markers against their table.

    Parameters
    ----------
    name : (K,) of the primaries that were reconstructed
    difference, sigma : (K, 3) adjusted less given coordinates; 1 sigma of the table, NaN where it has none
    missing : primaries that were not reconstructed
    """

    name: tuple[str, ...]
    difference: Array
    sigma: Array
    missing: tuple[str, ...]


def primary_residuals(result: Reconstruction, primary: MarkerSet) -> Residuals:
    """How far the primaries are from where their table has them."""
    place = {str(n): k for k, n in enumerate(result.markers.name)}
    known = [k for k, n in enumerate(primary.name) if str(n) in place]
    at = [place[str(primary.name[k])] for k in known]
    missing = tuple(str(n) for n in primary.name if str(n) not in place)
    return Residuals(
        tuple(str(primary.name[k]) for k in known), result.markers.xyz[at] - primary.xyz[known], primary.sigma[known],
        missing,
    )  # fmt: skip


def primary_sigma_words(primary: MarkerSet, unit: str) -> list[str]:
    """With which sigma the primaries hold the frame, in a sentence; none without primaries."""
    if not len(primary):
        return []
    none = ~np.isfinite(primary.sigma).all(axis=1)
    extent = float(np.linalg.norm(np.ptp(primary.xyz, axis=0)))
    own = primary.sigma[np.isfinite(primary.sigma)]
    table = f"held with the sigma of their table ({g3(own.min())} to {g3(own.max())} {unit})" if len(own) else ""
    default = (
        f"held with 1 sigma of {g3(default_sigma(primary))} {unit} per coordinate, {PRIMARY_SIGMA:g} of their extent "
        f"of {extent:.4g} {unit}: their table gives none"
    )
    if none.all():
        return [default]
    return [f"{table}; {int(none.sum())} of {len(primary)} {default}" if none.any() else table]


def length_words(unit: str) -> str:
    """A unit behind a number."""
    return "(free scale)" if unit == "free" else unit


def network(result: Reconstruction) -> Calibration:
    """The adjustment behind a reconstruction, its markers with their roles."""
    return replace(result.calibration, markers=result.markers)


def write_reconstruction(result: Reconstruction, folder: Path, unit: str, detections: Mapping[str, Detections]) -> None:
    """The files of a calibration (cameras, markers, poses, residuals) and the matches, into ``folder``.

    ``detections`` of the pictures by name: open.csv holds the spots of two pictures that stayed open.
    """
    done = network(result)
    write_network(done, folder, unit)
    obs = done.observations
    mine = result.linked
    links = replace(obs, view=obs.view[mine], point=obs.point[mine], xy=obs.xy[mine], cov=obs.cov[mine])
    marks = Marks(links, done.markers, done.cameras, done.views)
    io.write_table(folder / "matches.csv", match_columns(marks))
    if result.free_scale:
        path = folder / "markers.csv"
        path.write_text(f"# length_unit: free; {result.frame}\n" + path.read_text(encoding="utf-8"), encoding="utf-8")
    if any(len(s) for s in result.open_spots.values()):
        rows = [(n, *detections[n].xy[k].tolist()) for n, some in result.open_spots.items() for k in some.tolist()]
        io.write_table(folder / "open.csv", {
            "image": np.array([r[0] for r in rows]), "x": np.array([r[1] for r in rows]),
            "y": np.array([r[2] for r in rows]),
        })  # fmt: skip


def marks_of(result: Reconstruction) -> dict[str, int]:
    """Markers of each view, by its name."""
    count = np.bincount(result.tracks.view, minlength=len(result.views))
    return {v.name: int(n) for v, n in zip(result.views, count, strict=True)}


def picture_records(pictures: Sequence[Picture], result: Reconstruction | NotReconstructed) -> list[Record]:
    """What became of each picture."""
    found_by = result.found_by if isinstance(result, Reconstruction) else {}
    count = marks_of(result) if isinstance(result, Reconstruction) else {}
    return [
        {"image": p.name, "spots": len(p.detections), "markers": count.get(p.name, 0), "pose": found_by.get(p.name),
         "problem": result.dropped.get(p.name, "")}
        for p in pictures
    ]  # fmt: skip


def record(
    result: Reconstruction, primary: MarkerSet, pictures: Sequence[Picture], unit: str, pair: PairLines | None
) -> Record:
    """The reconstruction in figures: what `--json` prints and summary.json holds."""
    done, against = result.calibration, primary_residuals(result, primary)
    cameras = {
        name: {p: {"value": getattr(camera, p), "sigma": done.sigma(name, p)} for p in PARAMETERS}
        for name, camera in result.cameras.items()
    }
    views, markers = np.unique(result.count, return_counts=True)
    return {
        "windmark": windmark.__version__, "reconstructed": True, "length_unit": unit,
        "pictures": picture_records(pictures, result), "markers": len(result.markers),
        "primary": len(against.name), "secondary": len(result.markers) - len(against.name),
        "markers_by_views": {str(v): int(n) for v, n in zip(views, markers, strict=True)},
        "rms_px": result.rms_px, "sigma0": done.sigma0, "redundancy": done.redundancy,
        "marks": len(done.observations), "left_out": int((~done.used).sum()),
        "left_out_but_linked": int((result.linked & ~done.used).sum()),
        "marker_sigma_rms": sigma_rms(result.markers),
        "normals": int(np.isfinite(result.normal_sigma_deg).sum()),
        "normal_sigma_deg": _median(result.normal_sigma_deg),
        "primaries": [
            {"name": n, "difference": d, "sigma": s}
            for n, d, s in zip(against.name, against.difference, against.sigma, strict=True)
        ],
        "frame": result.frame or "that of the primary markers",
        "primary_sigma_default": default_sigma(primary) if len(primary) else None,
        "open_spots": {n: len(s) for n, s in result.open_spots.items()},
        "primaries_not_found": list(against.missing), "unrecognised": dict(result.unrecognised),
        "warnings": list(result.warnings), "suspect": list(result.suspect), "cameras": cameras,
        "unchecked": [
            {"what": what, "words": words}
            for what, words in (("camera", result.unchecked), ("primaries", done.unchecked)) if words
        ],
        "dropped": dict(result.dropped),
        "pair": None if pair is None else pair_record(pair),
    }  # fmt: skip


def _median(values: Array) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None


def pair_record(pair: PairLines) -> Record:
    """A pair of pictures in figures."""
    return {"images": [pair.a.name, pair.b.name], "in_both": len(pair.names), "only_in_first": len(pair.a.alone),
            "only_in_second": len(pair.b.alone), "rms_px": pair.rms_px}  # fmt: skip
