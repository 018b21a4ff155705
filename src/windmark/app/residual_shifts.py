"""Residuals in space: where a marker seems to be by the pictures of one instant, less where it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.app.scene3d import Shifts
from windmark.app.scene_document import larger
from windmark.errors import g2
from windmark.geometry import Camera, Pose

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SeenBy:
    """What one picture has of the markers.

    Parameters
    ----------
    name : of the picture or its camera
    camera, cam_from_model : its lens and its pose, in the frame that is drawn
    marker : (K,) numbers of the markers whose spots took part
    residual : (K, 2) projected − detected, px
    """

    name: str
    camera: Camera
    cam_from_model: Pose
    marker: NDArray[np.integer]
    residual: Array

    def equations(self, xyz: Array) -> tuple[Array, Array]:
        """(K, 2, 3) and (K, 2): how far right and down in this picture markers that stand at ``xyz`` seem to be off."""
        place, rotation = self.cam_from_model.apply(xyz[self.marker]), self.cam_from_model.rotation
        ray = place[:, :2] / place[:, 2:]
        scale = [self.camera.focal_px, self.camera.focal_px * self.camera.aspect]
        return rotation[:2] - ray[:, :, None] * rotation[2], -self.residual / scale * place[:, 2:]


def residual_shifts(what: str, seen: Sequence[SeenBy], xyz: Array, unit: str) -> Shifts | None:
    """How far markers (N, 3) would have to move to fit the pictures best, no further than these tell: of one picture
    across the line of sight, of several in space. ``what`` names them; None where no spot took part.
    """
    rows: list[list[Array]] = [[] for _ in xyz]
    wanted: list[list[Array]] = [[] for _ in xyz]
    notes: list[list[str]] = [[] for _ in xyz]
    for one in seen:
        across, off = one.equations(xyz)
        for k, a, b, (dx, dy) in zip(one.marker.tolist(), across, off, (-one.residual).tolist(), strict=True):
            rows[k].append(a)
            wanted[k].append(b)
            notes[k].append(f"{one.name}: found − expected {dx:+.2f}, {dy:+.2f} px".replace("-", "−"))
    found = np.array([bool(r) for r in rows])
    if not found.any():
        return None
    vectors = np.full((len(xyz), 3), np.nan)
    for k in np.flatnonzero(found):
        vectors[k] = np.linalg.lstsq(np.concatenate(rows[k]), np.concatenate(wanted[k]), rcond=1e-6)[0]
    factor = larger(vectors, float(np.linalg.norm(np.ptp(xyz, axis=0))))
    rms = float(np.sqrt(np.mean(np.sum(vectors[found] ** 2, axis=1))))
    how = "across the line of sight" if len(seen) == 1 else "by all its pictures"
    words = f"Residuals of {what}: where each marker seems to be, {how}, drawn × {factor:g}; RMS {g2(rms)} {unit}."
    return Shifts(vectors, factor, words, tuple("; ".join(of) for of in notes))
