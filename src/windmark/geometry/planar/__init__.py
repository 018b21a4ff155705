"""Transformations of a picture's plane: similarity, affine, projective, polynomials, thin-plate spline."""

from windmark.geometry.planar.choice import Choice, Trial, choose
from windmark.geometry.planar.fit import PlanarFit, fit_planar
from windmark.geometry.planar.hull import hull_of, inside_hull
from windmark.geometry.planar.outliers import sound_pairs
from windmark.geometry.planar.transform import KINDS, NEEDED, PlanarTransform, planar_from_record

__all__ = [
    "KINDS", "NEEDED", "Choice", "PlanarFit", "PlanarTransform", "Trial", "choose", "fit_planar", "hull_of",
    "inside_hull", "planar_from_record", "sound_pairs",
]  # fmt: skip
