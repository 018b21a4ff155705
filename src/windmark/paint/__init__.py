"""From paint and infrared light on nodes to pressure, temperature, Cp, heat flux and loads, each with its sigma."""

from windmark.paint.axes import COEFFICIENTS, LoadReference
from windmark.paint.carry import Carried, carried, dominant, fewer_modes
from windmark.paint.cell_fit import PaintFit, fit_paint
from windmark.paint.cp import TunnelConditions, pressure_coefficient
from windmark.paint.filling import fill_smoothly
from windmark.paint.in_situ import InSitu, in_situ
from windmark.paint.loads import Loads, integrate_loads
from windmark.paint.modes import MOST_MODES, NodeField, combined, interpolated
from windmark.paint.pressure import PressureMap, TunnelGain, pressure_map
from windmark.paint.refusal import NotFitted
from windmark.paint.stern_volmer import FLAGS, Inversion, SternVolmer

__all__ = [
    "COEFFICIENTS", "Carried", "FLAGS", "InSitu", "Inversion", "LoadReference", "Loads", "MOST_MODES", "NodeField",
    "NotFitted", "PaintFit", "PressureMap", "SternVolmer", "TunnelConditions", "TunnelGain", "carried", "combined",
    "dominant", "fewer_modes", "fill_smoothly", "fit_paint", "in_situ", "integrate_loads", "interpolated",
    "pressure_coefficient", "pressure_map",
]  # fmt: skip
