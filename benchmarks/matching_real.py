"""Registration of real pictures from windmark's own detections: labels right, wrong, missing, or refused.

NASA camera 5 with usual and with loose limits of the detector; MyPTV's regular ridge block; the regular two-level plate
of the PIV challenge; the CSP wall of 4094 dots; the regular DBAT sheet with rough coordinates. A prior or a label is
given only where the row says so. The data lie beside the checkout (`../shared/data`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from _matching_real_cases import RealCase, nasa, plate, ridge, sheet, wall
from windmark.registration import Registration, prepare, register
from windmark.registration.search.layout import Layout
from windmark.scene import MarkerSet

SETS: dict[str, Callable[[], Iterator[RealCase]]] = {
    "nasa": nasa, "ridge": ridge, "plate": plate, "wall": wall, "sheet": sheet,
}  # fmt: skip


def main(quick: bool = False, only: tuple[str, ...] = tuple(SETS)) -> dict[str, dict[str, float]]:
    """Measure, print one table, return its rows."""
    figures: dict[str, dict[str, float]] = {}
    print(
        f"{'':38s} {'spots':>5s} {'table':>5s} {'seen':>5s} {'right':>5s} {'wrong':>5s} {'missed':>6s} "
        f"{'rms px':>6s} {'nfa 1e':>6s} {'lead':>5s} {'ms':>7s}"
    )
    for name in only[:1] if quick else only:
        layout, seconds = None, 0.0
        for case in SETS[name]():
            if layout is None or not layout.is_of(case.markers):
                layout, seconds = _prepared(case.markers)
                print(f"{'':38s} prepare {len(case.markers)} markers: {1e3 * seconds:.0f} ms")
            figures[case.name] = {**measure(case, layout), "prepare_ms": 1e3 * seconds}
    return figures


def _prepared(markers: MarkerSet) -> tuple[Layout, float]:
    """The layout, and the CPU time that it took (of the first one, numba's compilation too)."""
    start = time.thread_time()
    layout = prepare(markers).ready()
    return layout, time.thread_time() - start


def measure(case: RealCase, layout: Layout) -> dict[str, float]:
    """Register one picture and count."""
    start = time.thread_time()
    result = register(case.detections, case.markers, case.camera, layout=layout, **case.options)
    register_ms = 1e3 * (time.thread_time() - start)
    gate = np.broadcast_to(case.gate_px, len(case.markers))
    near = np.linalg.norm(case.true_xy[:, None] - case.detections.xy[None], axis=2).min(axis=1) < gate
    row = {"spots": len(case.detections), "markers": len(case.markers), "seen": int(near.sum())}
    row |= {"register_ms": register_ms, "registered": float(bool(result))}
    words = f"{case.name:38s} {row['spots']:5.0f} {row['markers']:5.0f} {row['seen']:5.0f}"
    if not isinstance(result, Registration):
        print(f"{words} refused ({result.cause}) {register_ms:.1f} ms: {result.reason}", flush=True)
        return row
    match = result.matching
    offset = np.linalg.norm(case.detections.xy[match.detection] - case.true_xy[match.marker], axis=1)
    right = int((offset < gate[match.marker]).sum())
    row |= {"right": right, "wrong": len(offset) - right, "missed": row["seen"] - right, "rms_px": result.rms_px}
    row |= {"log10_nfa": result.log10_nfa}
    lead = ""
    if result.runner_up is not None:
        row["lead"] = result.score - result.runner_up.score
        lead = f"{row['lead']:.0f}"
    bent = "" if result.deformation is None else "  deformed"
    print(
        f"{words} {right:5d} {row['wrong']:5.0f} {row['missed']:6.0f} {result.rms_px:6.2f} {result.log10_nfa:6.0f} "
        f"{lead:>5s} {register_ms:7.1f}{bent}",
        flush=True,
    )
    return row


if __name__ == "__main__":
    main()
