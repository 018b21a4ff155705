"""From paint and infrared light on nodes to pressure, temperature, Cp, heat flux and loads, each with its sigma."""

from windmark.paint.averaging import AveragedFrames, average_frames
from windmark.paint.axes import COEFFICIENTS, LoadReference
from windmark.paint.carry import Carried, carried, dominant, fewer_modes
from windmark.paint.cell_fit import PaintFit, fit_paint
from windmark.paint.cp import TunnelConditions, pressure_coefficient
from windmark.paint.filling import fill_smoothly
from windmark.paint.in_situ import InSitu, in_situ
from windmark.paint.loads import Loads, integrate_loads
from windmark.paint.modes import MOST_MODES, NodeField, combined, interpolated
from windmark.paint.photons import PhotonTransfer, photon_transfer
from windmark.paint.pressure import PressureMap, TunnelGain, pressure_map
from windmark.paint.radiometry import (
    PIXEL_FLAGS,
    Intensity,
    Linearity,
    SensorModel,
    correct_picture,
    mean_dark,
    mean_flat,
)
from windmark.paint.ratio import form_ratio, mean_reference, reference_at
from windmark.paint.refusal import NotFitted
from windmark.paint.stern_volmer import FLAGS, Inversion, SternVolmer

__all__ = [
    "AveragedFrames", "COEFFICIENTS", "Carried", "FLAGS", "InSitu", "Intensity", "Inversion", "Linearity",
    "LoadReference", "Loads", "MOST_MODES", "NodeField", "NotFitted", "PIXEL_FLAGS", "PaintFit", "PhotonTransfer",
    "PressureMap", "SensorModel", "SternVolmer", "TunnelConditions", "TunnelGain", "average_frames", "carried",
    "combined", "correct_picture", "dominant", "fewer_modes", "fill_smoothly", "fit_paint", "form_ratio", "in_situ",
    "integrate_loads", "interpolated", "mean_dark", "mean_flat", "mean_reference", "photon_transfer",
    "pressure_coefficient", "pressure_map", "reference_at",
]  # fmt: skip
