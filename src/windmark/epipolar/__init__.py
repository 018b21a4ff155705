"""Epipolar geometry: which spot is which marker in every picture, and where unknown markers are."""

from windmark.epipolar.associate import WHY, Association, associate
from windmark.epipolar.chain import CUT, Chain, PairLinks, chain
from windmark.epipolar.known import KnownPair, match_known_pair
from windmark.epipolar.pair import match_pair
from windmark.epipolar.result import NotMatched, PairMatching

__all__ = [
    "CUT", "WHY", "Association", "Chain", "KnownPair", "NotMatched", "PairLinks", "PairMatching", "associate", "chain",
    "match_known_pair", "match_pair",
]  # fmt: skip
