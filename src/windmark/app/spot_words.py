"""Spots as reports say them: the note under the cursor, and the table with the digits that each number earns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from windmark.app.report import measured
from windmark.errors import g2
from windmark.scene import Detections
from windmark.scene.detections import FLAGS

COLUMNS = ("spot", "x, px", "y, px", "1 sigma x, px", "1 sigma y, px", "radius, px", "merit", "depth, grey levels",
           "remarks")  # fmt: skip


def spot_notes(spots: Detections, names: Sequence[str] = ()) -> list[str]:
    """What each spot's note says: place, sigma per coordinate, merit, radius; ``names`` of their markers before it."""
    sigma = np.sqrt(np.trace(spots.cov, axis1=1, axis2=2) / 2)
    columns = zip(spots.xy.tolist(), sigma.tolist(), spots.merit.tolist(), spots.radius_px.tolist(), strict=True)
    out = []
    for k, ((x, y), s, m, r) in enumerate(columns):
        known = f", sigma {g2(s)} px" if np.isfinite(s) else ""
        size = f", radius {r:.2f} px" if np.isfinite(r) else ""
        shape = f", merit {m:.3f}" if np.isfinite(m) else ""
        who = f"{names[k]}: " if names else ""
        out.append(f"{who}spot {k}: x {x:.2f}, y {y:.2f} px{known}{shape}{size}".replace("-", "−"))
    return out


def spot_rows(spots: Detections) -> list[tuple[object, ...]]:
    """Rows under `COLUMNS`, numbered as the table of spots has them."""
    sigma = np.sqrt(np.maximum(np.diagonal(spots.cov, axis1=1, axis2=2), 0.0))
    rows: list[tuple[object, ...]] = []
    for k in range(len(spots)):
        (x, sx), (y, sy) = (measured(float(spots.xy[k, i]), float(sigma[k, i])) for i in (0, 1))
        radius, merit = float(spots.radius_px[k]), float(spots.merit[k])
        remarks = ", ".join(words for bit, words in FLAGS.items() if spots.flags[k] & bit)
        rows.append((k, x, y, sx, sy, f"{radius:.2f}" if np.isfinite(radius) else None,
                     f"{merit:.3f}" if np.isfinite(merit) else None, float(spots.depth[k]),
                     remarks or None))  # fmt: skip
    return rows
