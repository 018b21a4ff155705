"""Whether a result can be had again: what of its inputs, versions and numbers is not what it was."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2
from windmark.io.manifest import _versions, file_hash, read_manifest, unchanged

SAME = 1e-6
"""Relative difference of a number without a sigma that is rounding of another machine."""
PART = 0.1
"""Part of its sigma by which a number may differ."""
SKIPPED = ("report.html", "manifest.json", "summary.json")
"""Files with times and dates; the numbers of a summary are compared by themselves."""
NOT_NUMBERS = ("seconds", "options", "folder", "notes", "windmark", "title", "not_drawn", "verdict")
"""Keys of a summary with times, paths and words."""
TIMES = re.compile(r"(^|_)(seconds|ms|latency)(_|$)|seconds$")
"""Names of columns and keys that say how long something took."""
UNREADABLE = (OSError, UnicodeDecodeError, json.JSONDecodeError, csv.Error, KeyError, RuntimeError)
"""What tables, records and arrays that are cut off or overwritten raise; h5py has the last two of its own."""
SHOWN = 10


@dataclass
class Difference:
    """What is not as it was.

    Parameters
    ----------
    inputs : file -> "changed", "missing" or "changed while it was read"
    versions : package -> (then, now)
    touched : files of the result itself that were changed since
    lost, new : files that are no more, or only now, written
    numbers : file -> what differs in it, in words
    bytes_only : files whose bytes differ and that have no numbers that are compared
    same : files that are the same to the byte, or in all their numbers
    """

    inputs: dict[str, str] = field(default_factory=dict)
    versions: dict[str, tuple[str, str]] = field(default_factory=dict)
    touched: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    new: list[str] = field(default_factory=list)
    numbers: dict[str, list[str]] = field(default_factory=dict)
    bytes_only: list[str] = field(default_factory=list)
    same: list[str] = field(default_factory=list)

    @property
    def repeated(self) -> bool:
        """Whether the numbers are those of then."""
        return not (self.numbers or self.lost or self.touched)


def inputs_now(folder: Path, manifest: dict[str, Any], out: Difference) -> None:
    """Compare inputs, versions and the result's own files with what the manifest says."""
    for one in manifest.get("inputs", ()):
        path = folder / one["file"]
        if not path.is_file():
            out.inputs[one["file"]] = "missing"
        elif file_hash(path) != one["sha256"]:
            out.inputs[one["file"]] = "changed"
        elif one.get("changed_since_read"):
            out.inputs[one["file"]] = "changed while it was read"
    now = _versions()
    then = manifest.get("versions", {})
    out.versions = {k: (str(then[k]), now[k]) for k in then if k in now and then[k] != now[k]}
    kept, changed = unchanged(folder, manifest)
    out.touched = sorted({*changed, *(set(manifest["outputs"]) - kept - changed)})


def results_again(old: Path, new: Path, out: Difference) -> None:
    """Compare the files of two results: those that their manifests name; what else lies in the folders is no matter."""
    before, after = ({name for name in (read_manifest(f) or {"outputs": {}})["outputs"] if (f / name).is_file()}
                     for f in (old, new))  # fmt: skip
    out.lost, out.new = sorted(before - after), sorted(after - before)
    for name in sorted(before & after):
        try:
            said = _differences(old / name, new / name, name)
        except UNREADABLE as error:
            # Cut off, or of something else: it is not the same, and the other files are still to be compared.
            said = [f"cannot be read any more: {str(error) or type(error).__name__}"]
        if said is None:
            out.bytes_only.append(name)
            continue
        if said:
            out.numbers[name] = said[:SHOWN]
        else:
            out.same.append(name)


def _differences(a: Path, b: Path, name: str) -> list[str] | None:
    """What differs in the numbers of a file, in words; None where it has none that are compared."""
    if not name.endswith("summary.json") and (name.endswith(SKIPPED) or file_hash(a) == file_hash(b)):
        return []
    if a.suffix == ".csv":
        return list(_table_differences(a, b))
    if a.suffix == ".nc":
        return list(_array_differences(a, b))
    if a.suffix == ".json":
        return list(_json_differences(json.loads(a.read_text("utf-8")), json.loads(b.read_text("utf-8"))))
    return None


def _rows(path: Path) -> tuple[list[str], list[list[str]]]:
    with path.open(encoding="utf-8-sig", newline="") as stream:
        rows = list(csv.reader(line for line in stream if not line.startswith("#")))
    return (rows[0], rows[1:]) if rows else ([], [])


def _table_differences(a: Path, b: Path) -> Iterator[str]:
    """Numbers of two tables that differ by more than a part of their sigma."""
    (head, first), (other, second) = _rows(a), _rows(b)
    if head != other:
        yield f"columns {', '.join(head)}, now {', '.join(other)}"
        return
    if len(first) != len(second):
        yield f"{len(first)} rows, now {len(second)}"
        return
    at = {name: n for n, name in enumerate(head)}
    for n, name in enumerate(head):
        if TIMES.search(name):
            continue
        sigma = at.get(f"sigma_{name}", at.get(f"{name}_sigma"))
        worst = 0.0, ""
        for k, (old, new) in enumerate(zip(first, second, strict=True)):
            if n >= len(old) or n >= len(new) or old[n] == new[n]:
                continue
            known = _number(old[sigma]) if sigma is not None and sigma < len(old) else None
            far = _far(_number(old[n]), _number(new[n]), known)
            if far > worst[0]:
                worst = far, f"{name}, row {k + 1}: {old[n]}, now {new[n]}{_sigmas(old[n], new[n], known)}"
        if worst[0] > 1:
            yield worst[1]


def _array_differences(a: Path, b: Path) -> Iterator[str]:
    """Arrays of two NetCDF files that differ by more than a part of their sigma."""
    with h5py.File(a) as old, h5py.File(b) as new:
        first, second = ({name: of for name, of in f.items() if isinstance(of, h5py.Dataset)} for f in (old, new))
        if first.keys() != second.keys():
            yield f"arrays {', '.join(first)}, now {', '.join(second)}"
            return
        for name in (n for n in first if not TIMES.search(n)):
            x, y = first[name][()], second[name][()]
            if np.shape(x) != np.shape(y):
                yield f"{name}: {np.shape(x)} numbers, now {np.shape(y)}"
            elif np.asarray(x).dtype.kind not in "iufb":
                if not np.array_equal(x, y):
                    yield f"{name}: other words"
            else:
                sigma = next((first[s][()] for s in (f"{name}_sigma", f"sigma_{name}") if s in first), None)
                yield from _farthest(name, np.asarray(x, float), np.asarray(y, float), sigma)


def _farthest(name: str, x: NDArray[np.float64], y: NDArray[np.float64], sigma: Any) -> Iterator[str]:
    """The number of an array that differs most, where it does so by more than is allowed."""
    allowed = np.maximum(SAME * np.maximum(np.abs(x), np.abs(y)), 1e-12)
    if sigma is not None and np.shape(sigma) == x.shape:
        allowed = np.fmax(allowed, PART * np.nan_to_num(np.asarray(sigma, float)))
    with np.errstate(invalid="ignore"):
        far = np.where((x == y) | (np.isnan(x) & np.isnan(y)), 0.0, np.abs(x - y) / allowed)
    far = np.where(np.isnan(far), np.inf, far)
    if far.size and far.max() > 1:
        at = np.unravel_index(int(far.argmax()), far.shape)
        yield f"{name}{[int(k) for k in at]}: {x[at]:.8g}, now {y[at]:.8g} ({int((far > 1).sum())} numbers differ)"


def _json_differences(a: Any, b: Any, key: str = "", sigma: float | None = None) -> Iterator[str]:
    """Numbers of two records that differ; words count, too."""
    if isinstance(a, dict) and isinstance(b, dict):
        for name in dict.fromkeys((*a, *b)):
            if name in NOT_NUMBERS or TIMES.search(name):
                continue
            here = f"{key}.{name}" if key else name
            if (name in a) != (name in b):
                yield f"{here}: only {'then' if name in a else 'now'}"
                continue
            known = a.get("sigma") if name == "value" else a.get(f"{name}_sigma", a.get(f"sigma_{name}"))
            yield from _json_differences(a[name], b[name], here, known if isinstance(known, int | float) else None)
    elif isinstance(a, list) and isinstance(b, list):
        if len(a) != len(b):
            yield f"{key}: {len(a)} entries, now {len(b)}"
        else:
            for n, (x, y) in enumerate(zip(a, b, strict=True)):
                yield from _json_differences(x, y, f"{key}[{n}]")
    elif _is_number(a) and _is_number(b):
        if _far(float(a), float(b), sigma) > 1:
            yield f"{key}: {a:.8g}, now {b:.8g}{_sigmas(a, b, sigma)}"
    elif a != b and _is_number(a) != _is_number(b):
        yield f"{key}: {a}, now {b}"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _far(old: float | None, new: float | None, sigma: float | None) -> float:
    """A difference over what is allowed; infinite where one of them is no number."""
    if old is None or new is None:
        return math.inf
    if old == new or (math.isnan(old) and math.isnan(new)):
        return 0.0
    if not (math.isfinite(old) and math.isfinite(new)):
        return math.inf
    allowed = max(SAME * max(abs(old), abs(new)), 1e-12)
    if sigma is not None and math.isfinite(sigma) and sigma > 0:
        allowed = max(allowed, PART * sigma)
    return abs(new - old) / allowed


def _sigmas(old: Any, new: Any, sigma: float | None) -> str:
    try:
        return "" if not sigma else f" ({g2(abs(float(new) - float(old)) / sigma)} sigma)"
    except ValueError:
        return ""
