"""From paint and infrared light on nodes to pressure, temperature, Cp, heat flux and loads, each with its sigma."""

from windmark.paint.averaging import AveragedFrames, average_frames, enough
from windmark.paint.axes import COEFFICIENTS, LoadReference
from windmark.paint.cameras import CamerasApart, CameraSeams, MergedCameras, merge_cameras
from windmark.paint.carry import Carried, carried, dominant, fewer_modes
from windmark.paint.cell_fit import PaintFit, fit_paint
from windmark.paint.cp import TunnelConditions, pressure_coefficient
from windmark.paint.emissivity import EmissivityTable, dielectric_emissivity
from windmark.paint.filling import fill_smoothly, stranded
from windmark.paint.flux_operator import FluxOperator, before_start, flux_operator
from windmark.paint.form_factors import FormFactors, form_factors
from windmark.paint.heat_flux import HeatFlux, heat_flux
from windmark.paint.in_situ import InSitu, in_situ
from windmark.paint.lateral import curvature_sum, lateral_conductance, lateral_conduction, node_laplacian
from windmark.paint.lateral_scales import LateralScale, lateral_scales, widest_agreed
from windmark.paint.loads import Loads, integrate_loads, load_operator
from windmark.paint.modes import MOST_MODES, NodeField, combined, interpolated
from windmark.paint.patches import FilledField, disc_nodes, fill_patches, polygon_nodes
from windmark.paint.photons import PhotonTransfer, photon_transfer
from windmark.paint.pressure import PressureMap, TunnelGain, pressure_map
from windmark.paint.radiance import PlanckBand, PolynomialRadiance, surface_temperature
from windmark.paint.radiometry import (
    PIXEL_FLAGS,
    Intensity,
    Linearity,
    SensorModel,
    correct_picture,
    mean_dark,
    mean_flat,
)
from windmark.paint.radiosity import SelfIllumination, add_self_illumination, remove_self_illumination
from windmark.paint.ratio import form_ratio, mean_reference, node_shares, reference_at, reference_shares
from windmark.paint.refusal import NotFitted
from windmark.paint.sections import SECTION_LOADS, SectionProfile, SpanLoading, section_profile, span_loading
from windmark.paint.sensor_radiance import SensorRadiance, fit_sensor_radiance
from windmark.paint.stern_volmer import FLAGS, Inversion, SternVolmer
from windmark.paint.temperature import given_temperature, recovery_temperature, thermocouple_temperature, varying
from windmark.paint.temperature_paint import TemperaturePaint, fit_temperature_paint
from windmark.paint.walls import Layer, Wall

__all__ = [
    "AveragedFrames", "COEFFICIENTS", "CameraSeams", "CamerasApart", "Carried", "EmissivityTable", "FLAGS",
    "FilledField", "FluxOperator", "FormFactors", "HeatFlux", "InSitu", "Intensity", "Inversion", "LateralScale",
    "Layer", "Linearity", "LoadReference", "Loads", "MOST_MODES", "MergedCameras", "NodeField", "NotFitted",
    "PIXEL_FLAGS", "PaintFit", "PhotonTransfer", "PlanckBand", "PolynomialRadiance", "PressureMap", "SECTION_LOADS",
    "SectionProfile", "SelfIllumination", "SensorModel", "SensorRadiance", "SpanLoading", "SternVolmer",
    "TemperaturePaint", "TunnelConditions", "TunnelGain", "Wall", "add_self_illumination", "average_frames",
    "before_start", "carried", "combined", "correct_picture", "curvature_sum", "dielectric_emissivity", "disc_nodes",
    "dominant", "enough", "fewer_modes", "fill_patches", "fill_smoothly", "fit_paint", "fit_sensor_radiance",
    "fit_temperature_paint", "flux_operator", "form_factors", "form_ratio", "given_temperature", "heat_flux",
    "in_situ", "integrate_loads", "interpolated", "lateral_conductance", "lateral_conduction", "lateral_scales",
    "load_operator", "mean_dark", "mean_flat", "mean_reference", "merge_cameras", "node_laplacian", "node_shares",
    "photon_transfer", "polygon_nodes", "pressure_coefficient", "pressure_map", "recovery_temperature", "reference_at",
    "reference_shares", "remove_self_illumination", "section_profile", "span_loading", "stranded",
    "surface_temperature", "thermocouple_temperature", "varying", "widest_agreed",
]  # fmt: skip
