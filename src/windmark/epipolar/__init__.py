"""Epipolar geometry: which spot is which marker in every picture, and where unknown markers are."""

from windmark.epipolar.associate import WHY, Association, associate

__all__ = ["WHY", "Association", "associate"]
