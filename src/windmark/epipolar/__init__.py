"""Epipolar geometry: which spot is which marker in every picture, and where unknown markers are."""

from windmark.epipolar.associate import WHY, Association, associate
from windmark.epipolar.chain import CUT, Chain, PairLinks, chain

__all__ = ["CUT", "WHY", "Association", "Chain", "PairLinks", "associate", "chain"]
