"""A paint test, point by point: pictures with poses and deformations to the ratio on the model, pressure and loads."""

from windmark.tasks.psp.channels import as_one_cause, two_colours
from windmark.tasks.psp.cuts import SectionLoads, SectionWanted, SurfaceSection, cut_sections, section_loads
from windmark.tasks.psp.lamps import Lamp
from windmark.tasks.psp.levels import BadPicture, Reference
from windmark.tasks.psp.loads import UNSEEN_SIDE, seen_loads, seen_sides, shown_areas
from windmark.tasks.psp.plausible import mach_of
from windmark.tasks.psp.ratios import CameraRatio, MergedRatio, ratio_of
from windmark.tasks.psp.reduce import PointTask, ReducedPoint, no_patches, reduce_point
from windmark.tasks.psp.sampling import ModelPicture, Patches, Sampling, moved_grid, sample_picture
from windmark.tasks.psp.scatter import Scatter
from windmark.tasks.psp.self_lit import Change, Reflecting, left_words
from windmark.tasks.psp.taps import EITHER_SIDE, OFF_GRID, UNSEEN, Readings, TapTable, field_at

__all__ = [
    "BadPicture", "CameraRatio", "Change", "EITHER_SIDE", "Lamp", "MergedRatio", "ModelPicture", "OFF_GRID", "Patches",
    "PointTask", "Readings", "ReducedPoint", "Reference", "Reflecting", "Sampling", "Scatter", "SectionLoads",
    "SectionWanted", "SurfaceSection", "TapTable", "UNSEEN", "UNSEEN_SIDE",
    "as_one_cause", "cut_sections", "field_at", "left_words", "mach_of", "moved_grid", "no_patches",
    "ratio_of", "reduce_point", "sample_picture", "section_loads", "seen_loads", "seen_sides", "shown_areas",
    "two_colours",
]  # fmt: skip
