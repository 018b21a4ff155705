"""What became of a grid in another format: the file written is read back and compared, and what is lost is said."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2, g3
from windmark.io import GridFile
from windmark.scene import Mesh

SINGLE_STEP = 2.0**-23
"""The step of single precision, as part of a number."""
_TOLERANCE = 4 * SINGLE_STEP
"""What rounding to single precision may move a node by, as part of the largest coordinate."""
_MOST_NAMED = 6


@dataclass(frozen=True)
class Difference:
    """How a grid read back differs from the one that was to be written.

    Parameters
    ----------
    largest : largest distance of a corner of a triangle (of a node, where all are there) to where it was
    relative : the same as part of the largest coordinate
    turned : triangles that face the other way
    lost : what the format does not hold, in words
    harm : of it, what later jobs would measure with: values, sides, blanked nodes
    problem : why this is not the same surface; "" where it is
    """

    largest: float
    relative: float
    turned: int
    lost: tuple[str, ...]
    harm: tuple[str, ...] = ()
    problem: str = ""

    @property
    def words(self) -> str:
        """How exactly the nodes came back."""
        if self.largest == 0:
            return "every coordinate is the same bit for bit"
        steps = self.relative / SINGLE_STEP
        return f"nodes moved by {g2(self.largest)} at most, {g2(steps)} of single precision's step"


def compare(meant: GridFile, again: GridFile) -> Difference:
    """Compare what was meant to be written with what was read back."""
    a, b = meant.mesh, again.mesh
    if len(a.triangles) != len(b.triangles):
        problem = f"read back it has {len(b.triangles)} triangles instead of {len(a.triangles)}"
        return Difference(np.inf, np.inf, 0, (), problem=problem)
    used = np.zeros(len(a.vertices), dtype=bool)
    used[a.triangles] = True
    size = float(np.abs(a.vertices[used]).max(initial=0.0))
    off, turned = _corner_differences(a, b)
    same_nodes = len(a.vertices) == len(b.vertices)
    if same_nodes:
        used = used if a.blanked is None else ~a.blanked
        with np.errstate(invalid="ignore"):
            nodes = np.linalg.norm(a.vertices[used] - b.vertices[used], axis=1).max(initial=0.0)
        off = max(off, float(nodes)) if nodes <= _TOLERANCE * size else off
    relative = off / size if size else 0.0
    problem = "" if relative <= _TOLERANCE else f"read back, a corner of a triangle is off by {g3(off)}"
    harm = tuple(_lost_content(meant, again, turned))
    return Difference(off, relative, turned, (*_lost_form(meant, again), *harm), harm, problem)


def _corner_differences(a: Mesh, b: Mesh) -> tuple[float, int]:
    """Largest distance of corresponding corners, and how many triangles are turned round.

    Files keep the order of the triangles, or put those of a volume together.
    """
    best: tuple[float, int] = (np.inf, 0)
    there = b.vertices[b.triangles]
    for order in (np.arange(len(a.triangles)), np.argsort(a.volume, kind="stable")):
        here = a.vertices[a.triangles[order]]
        same, turned = (
            np.min([np.linalg.norm(here - np.roll(t, k, axis=1), axis=2).max(axis=1) for k in range(3)], axis=0)
            for t in (there, there[:, ::-1])
        )
        found = float(np.minimum(same, turned).max(initial=0.0)), int((turned < same).sum())
        best = min(best, found)
        if best[0] == 0:
            break
    return best


def _lost_form(meant: GridFile, again: GridFile) -> list[str]:
    """Units, structure and names."""
    a, b = meant.mesh, again.mesh
    lost = list(meant.left_out)
    if meant.length_unit and again.length_unit != meant.length_unit:
        lost.append(f"the length unit ({meant.length_unit})")
    if a.blocks and not b.blocks:
        lost.append(f"the structure of {len(a.blocks)} block{'s' * (len(a.blocks) > 1)}")
    elif [k.name for k in a.blocks] != [k.name for k in b.blocks]:
        lost.append(f"the names of the blocks ({_named([k.name for k in a.blocks])})")
    if len(b.vertices) != len(a.vertices):
        lost.append(f"{len(a.vertices) - len(b.vertices)} of {len(a.vertices)} nodes (double ones, or in no triangle)"
                    if len(b.vertices) < len(a.vertices) else
                    f"common nodes of parts: {len(a.vertices)} became {len(b.vertices)}")  # fmt: skip
    names, read = np.unique(a.volume), np.unique(b.volume)
    if len(names) > 1 and len(read) == 1:
        lost.append(f"the {len(names)} volumes ({_named(names.tolist())})")
    elif names.tolist() != read.tolist() and not (len(names) == 1 and a.blocks == ()):
        lost.append(f"the names of the volumes ({_named(names.tolist())} are now {_named(read.tolist())})")
    elif len(names) == 1 and names.tolist() != read.tolist() and names[0] != "model":
        lost.append(f"the volume's name ({names[0]})")
    return lost


def _lost_content(meant: GridFile, again: GridFile, turned: int) -> list[str]:
    """Sides, blanked nodes and values."""
    a, b = meant.mesh, again.mesh
    lost = []
    if a.blanked is not None and a.blanked.any() and b.blanked is None:
        lost.append(f"the mark of {int(a.blanked.sum())} blanked nodes")
    if turned:
        lost.append(f"the orientation of {turned} triangles, which face the other way (the format holds blocks only)")
    fields = [name for name in meant.fields if name not in again.fields]
    if fields:
        lost.append(f"the values {_named(fields)}")
    units = [n for n in meant.fields if n in again.fields and meant.units.get(n) != again.units.get(n)]
    if units:
        lost.append(f"the units of {_named(units)}")
    both = [name for name in meant.fields if name in again.fields]
    lost += [_rounded(name, meant.fields[name], again.fields[name]) for name in both]
    return [text for text in lost if text]


def _rounded(name: str, values: NDArray[np.floating], read: NDArray[np.floating]) -> str:
    """What happened to values, if anything."""
    if len(values) != len(read):
        return f"the values {name} at nodes that are not there any more"
    if not np.array_equal(np.isfinite(values), np.isfinite(read)):
        return f"the nodes without a value of {name}: they differ"
    good = np.isfinite(values)
    off = np.abs(values[good].astype(float) - read[good].astype(float)).max(initial=0.0)
    size = np.abs(values[good]).max(initial=0.0)
    if off <= 1e-12 * size:
        return ""
    return f"digits of {name} (off by {g2(off)} at most, values up to {g3(size)})"


def _named(names: list[str]) -> str:
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(names[:_MOST_NAMED]) + more
