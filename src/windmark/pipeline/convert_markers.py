"""A marker table into the other format: CSV and NASA's ``.tgts``; read back and compared."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from windmark import io
from windmark.errors import g3
from windmark.pipeline.convert_units import scale_to, source_unit
from windmark.scene import MarkerSet

Record = dict[str, Any]
SUFFIXES = (".csv", ".tgts")


@dataclass(frozen=True)
class MarkerOptions:
    """How a marker table is converted: the source's length unit where it says none, and the one wanted; the names of
    its columns where it is no table of windmark's (`io.read_listed_markers`).
    """

    unit: str | None = None
    to_unit: str | None = None
    columns: tuple[str, ...] = ()


def convert_markers(source: Path, target: Path, options: MarkerOptions) -> Record:
    """Convert one marker table; every entry is kept, taps and virtual markers too.

    Returns
    -------
    What was done, in figures: counts by role, unit and scale, what is lost, how exact it is.

    Raises
    ------
    ValueError
        For a unit that is missing, or names that the format cannot hold.
    FileError
        For a file that cannot be read or written.
    """
    from_tgts, before = source.suffix.lower() == ".tgts" and not options.columns, list[str]()
    if options.columns:
        markers, before = io.read_listed_markers(source, options.columns)
    else:
        markers = io.read_markers(source, roles=None)
    unit = source_unit(source, io.read_marker_unit(source), options.unit)
    factor, unit = scale_to(source, unit, options.to_unit)
    if factor != 1.0:
        markers = replace(
            markers, xyz=factor * markers.xyz, sigma=factor * markers.sigma, radius=factor * markers.radius
        )
    write = io.write_tgts if target.suffix.lower() == ".tgts" else io.write_markers
    with io.atomic_path(target) as temporary:
        write(temporary, markers, length_unit=unit)
        again = io.read_markers(temporary, roles=None)
        lost, harm, off = _compared(target, markers, again)
    if from_tgts:
        lost.insert(0, "zone, i and j, the entries' places in the grid file")
    if before:
        some = ", ".join(repr(line[:60]) for line in before[:3])
        lost.append(f"{len(before)} line{'s' * (len(before) > 1)} before the first row: {some}")
    if not unit:
        lost.append("nothing says the length unit: --unit writes it as a comment")
    roles, counts = np.unique(markers.role, return_counts=True)
    return {
        "kind": "markers", "input": source,
        "from": "text" if options.columns else _format(source), "output": target, "to": _format(target),
        "markers": len(markers), "roles": dict(zip(roles.tolist(), counts.tolist(), strict=True)),
        "with_normal": int(np.isfinite(markers.normal).all(axis=1).sum()),
        "with_radius": int(np.isfinite(markers.radius).sum()), "length_unit": unit or None, "scale": factor,
        "lost": lost, "harm": harm, "size": float(np.linalg.norm(np.ptp(markers.xyz, axis=0))) if len(markers) else 0.0,
        "read_back_largest": off,
    }  # fmt: skip


def _format(path: Path) -> str:
    return "tgts" if path.suffix.lower() == ".tgts" else "CSV"


def _compared(target: Path, meant: MarkerSet, again: MarkerSet) -> tuple[list[str], list[str], float]:
    """What the file read back lacks, what of it later jobs would measure with, and by how much its numbers differ from
    what was meant; its order may differ.
    """
    place = {name: k for k, name in enumerate(again.name.tolist())}
    missing = [name for name in meant.name.tolist() if name not in place]
    if missing or len(again) != len(meant):
        raise io.FileError(target, f"read back it lacks {', '.join(missing[:5])}; so it was not written")
    same = again.take([place[name] for name in meant.name.tolist()])
    lost = []
    if np.isfinite(meant.sigma).any() and not np.isfinite(same.sigma).any():
        lost.append("the markers' sigmas")
    if (meant.volume != same.volume).any():
        names = np.unique(meant.volume).tolist()
        lost.append(f"the volumes ({', '.join(names[:6])})")
    changed = meant.role != same.role
    for role in np.unique(meant.role[changed]).tolist():
        lost.append(f"the role {role} of {int((meant.role == role).sum())} markers, which are targets now")
    harm = list(lost)
    if any(place[name] != k for k, name in enumerate(meant.name.tolist())):
        lost.append("the order: entries stand in their sections")
    pairs = [(meant.xyz, same.xyz), (meant.normal, same.normal), (meant.radius, same.radius)]
    if any((np.isfinite(a) != np.isfinite(b)).any() for a, b in pairs):
        raise io.FileError(target, "read back it lacks radii or normals; so it was not written")
    off = max(float(np.nanmax(np.abs(a - b), initial=0.0)) for a, b in pairs)
    if off > 1e-9 * max(1.0, float(np.abs(meant.xyz).max())):
        raise io.FileError(target, f"read back, a number is off by {g3(off)}; so it was not written")
    return lost, harm, off
