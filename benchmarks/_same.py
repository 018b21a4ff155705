"""Are two results the same, byte by byte, but for what tells when and how fast they were made?"""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

TIMES = frozenset({"seconds", "latency_s", "median_seconds", "slowest_seconds", "median_frame_ms", "median_latency_ms",
                   "folder"})  # fmt: skip
"""Columns, variables and keys that no two runs have the same: how long something took, and where the result lies."""
LEFT = "the run was ended before it was measured"
Rows = list[dict[str, str]]


def differences(one: Path, other: Path) -> list[str]:
    """Names of the files in which two results differ."""
    files = [{p.relative_to(place).as_posix() for p in place.rglob("*") if p.is_file()} for place in (one, other)]
    only = [f"{name} in one of them only" for name in sorted(files[0] ^ files[1])]
    return only + [name for name in sorted(files[0] & files[1]) if not _alike(one / name, other / name)]


def _alike(a: Path, b: Path) -> bool:
    if a.name == "manifest.json":  # hashes of outputs follow their times; `state` sees that they are right
        told, also = (json.loads(path.read_text()) for path in (a, b))
        return all(told[key] == also[key] for key in ("verb", "refused", "versions", "inputs")) and (
            told["outputs"].keys() == also["outputs"].keys())  # fmt: skip
    if a.suffix == ".json":
        return bool(_untimed(json.loads(a.read_text())) == _untimed(json.loads(b.read_text())))
    if a.suffix == ".csv":
        return table(a) == table(b)
    if a.suffix == ".nc":
        return _series_alike(a, b)
    if a.suffix == ".html":  # words and pictures; the numbers in it are those of the tables, and times
        first, second = (re.sub(r"[\d.]+", "", path.read_text()) for path in (a, b))
        return first == second
    return a.read_bytes() == b.read_bytes()


def _series_alike(a: Path, b: Path) -> bool:
    import xarray

    with xarray.open_dataset(a) as first, xarray.open_dataset(b) as second:
        gone = [name for name in TIMES if name in first]
        history = [data.attrs.pop("history").replace(str(path.parent), "") for data, path in ((first, a), (second, b))]
        return history[0] == history[1] and bool(first.drop_vars(gone).identical(second.drop_vars(gone)))


def _untimed(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _untimed(v) for key, v in value.items() if key not in TIMES}
    return [_untimed(v) for v in value] if isinstance(value, list) else value


def table(path: Path) -> Rows:
    """Rows of a table without wall times; lines that begin with # are rows, too."""
    with open(path, newline="") as stream:
        return [{k: v for k, v in row.items() if k not in TIMES} for row in csv.DictReader(stream)]


def ended_rightly(ended: Path, whole: Path) -> list[str]:
    """What is wrong with a live result whose run was ended on the way, beside an undisturbed one.

    Its frames are the first ones of the undisturbed run with the same numbers in every table; every other frame that it
    names is said to be left.
    """
    rows = table(ended / "deformation.csv")
    done = [row["frame"] for row in rows if row["status"] != "left"]
    usual = [row["frame"] for row in table(whole / "deformation.csv")]
    wrong = [] if done == usual[: len(done)] else [f"frames {done} of {usual}"]
    wrong += [f"frame {row['frame']} is left: {row['reason']}" for row in rows
              if row["status"] == "left" and row["reason"] != LEFT]  # fmt: skip
    for name in ("deformation.csv", "cameras.csv", "span.csv", "markers.csv", "arrivals.csv"):
        mine, theirs = ([r for r in table(place / name) if r["frame"] in done] for place in (ended, whole))
        wrong += [] if mine == theirs else [f"{name}: other rows of the frames that were measured"]
    with_row = {row["frame"] for row in rows}
    wrong += [f"file {r['file']} without a row" for r in table(ended / "arrivals.csv") if r["frame"] not in with_row]
    return wrong
