"""Flat pictures that are overexposed: the surface that their clipped pixels show has no value in any picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.paint import SensorModel
from windmark.paint.radiometry import saturated_pixels
from windmark.resection import map_pixels
from windmark.scene import Mesh
from windmark.tasks.deform.task import Station

Array = NDArray[np.float64]


def clipped_part(flats: Array, sensor: SensorModel, station: Station, mesh: Mesh) -> float:
    """Part of the pixels that show a mesh at rest which are saturated in any flat picture (F, H, W); 0 to 1.

    Pixels that are hot in the dark pictures, too, are flaws of the sensor, and not meant.
    """
    full = np.any([saturated_pixels(frame, sensor.saturation) for frame in flats], axis=0)
    if sensor.dead is not None:
        full &= ~sensor.dead
    if not full.any():
        return 0.0
    shown = map_pixels(mesh, station.camera, station.cam_from_tunnel, cull_backfaces=True).valid
    return float((full & shown).sum() / max(int(shown.sum()), 1))
