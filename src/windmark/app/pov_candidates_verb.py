"""`windmark pov --label`: the points of view that three markers leave, and what a fourth says.

Source: AIAA 2005-5007, section III.B.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from windmark import io
from windmark.app import console
from windmark.app.pov_verb import Wishes
from windmark.app.verdict_words import judged
from windmark.errors import UsageError
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.verdict.viewpoint import candidates_verdict
from windmark.registration import PoseCandidates, pose_candidates
from windmark.registration.candidates import COMPATIBLE

Record = dict[str, Any]


def show(wishes: Wishes, places: Mapping[str, tuple[float, float]], sigma_px: float, as_json: bool) -> None:
    """Solve, list, write the pose if one is decided; a fourth marker that fits none of them ends with exit code 1."""
    _check(wishes, len(places))
    assert wishes.markers is not None
    camera = console.read_lens(wishes.cameras[0])
    markers = Lengths(wishes.unit).markers(wishes.markers)
    row = {str(name): k for k, name in enumerate(markers.name)}
    unknown = [name for name in places if name not in row]
    if unknown:
        raise io.FileError(wishes.markers, f"has no marker {unknown[0]}; expected the names of --label")
    xyz = markers.xyz[[row[name] for name in places]]
    found = pose_candidates(np.array(list(places.values())), xyz, camera, sigma_px=sigma_px)
    record, lines = _listed(found, list(places), camera.focal_px, camera.size_px[0], wishes.unit)
    verdict = candidates_verdict(found, list(places))
    lines += judged(record, verdict)
    pose = found.decided
    if wishes.output is not None and pose is not None:
        io.write_camera(wishes.output, camera, pose, unit=wishes.unit)
        record["output"] = wishes.output
        lines.append(f"written: {wishes.output}")
    if not len(found) or not found.compatible.any():
        if not as_json:
            console.answer(record, False, lines)
        console.refuse(verdict.reason, as_json, record, verdict.next_step)
    if wishes.output is not None and pose is None:
        if not as_json:
            console.answer(record, False, lines)
        console.refuse(f"{int(found.compatible.sum())} poses are left, nothing was written", as_json, record,
                       verdict.next_step)  # fmt: skip
    console.answer(record, as_json, lines)


def _check(wishes: Wishes, count: int) -> None:
    if len(wishes.cameras) != 1 or wishes.markers is None:
        raise UsageError("--label needs one camera file and the marker table, --markers")
    if wishes.numbers or wishes.direction or wishes.picture or wishes.grid:
        raise UsageError("--label gives the point of view; expected no numbers, --direction, --grid, --picture with it")
    if wishes.unit not in io.LENGTH_UNITS:
        raise UsageError(f"--unit must say the table's length unit, one of {', '.join(io.LENGTH_UNITS)}")
    if count < 3:
        raise UsageError(f"--label: three markers give candidates, a fourth decides; got {count}")


def _listed(
    found: PoseCandidates, names: list[str], focal_px: float, width: int, unit: str | None
) -> tuple[Record, list[str]]:
    """Every candidate with its seven numbers and the further markers' distances."""
    rows, lines = [], [f"{len(found)} poses show {', '.join(names[:3])} where they are"]
    for k, pose in enumerate(found.cam_from_model):
        pov = pose.to_pov(focal_px, width)
        further = [
            {"marker": n, "residual_px": found.residual_px[k, i], "sigmas": found.sigmas[k, i]}
            for i, n in enumerate(names[3:], start=3)
        ]
        rows.append({"pov": pov, "station": pose.center, "further": further, "compatible": bool(found.compatible[k])})
        angles = ", ".join(f"{v:z.3f}" for v in (pov.rx_deg, pov.ry_deg, pov.rz_deg))
        distances = ", ".join(f"{v:z.3f}" for v in (pov.dx, pov.dy, pov.dz))
        said = "; ".join(
            f"{f['marker']} behind the camera" if np.isnan(f["residual_px"])
            else f"{f['marker']} off by {f['residual_px']:.2f} px, {f['sigmas']:.1f} sigma" for f in further
        )  # fmt: skip
        numbers = f"  {k + 1}: rx, ry, rz {angles} deg; dx, dy, dz {distances} {unit}"
        lines.append("; ".join([numbers, said] if said else [numbers]))
    left = int(found.compatible.sum())
    if len(names) == 3:
        what = "decide between them" if len(found) > 1 else "prove it"
        lines.append(f"give a fourth --label to {what}")
    elif left == 1:
        lines.append(f"{', '.join(names[3:])} {'decides' if len(names) == 4 else 'decide'}: pose 1")
    elif left:
        lines.append(f"{left} poses are within {COMPATIBLE:g} sigma: not decided, give more labels")
    record = {"candidates": rows, "decided": found.decided is not None, "length_unit": unit}
    return record, lines
