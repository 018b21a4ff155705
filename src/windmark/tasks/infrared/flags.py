"""What is to be said of a node in a frame, as bits."""

from __future__ import annotations

UNSEEN, MARKER, SATURATED, NO_EMISSIVITY, BEYOND = 1, 2, 4, 8, 16
NO_WALL, BEFORE, NO_START, BRIDGED, GAP, LATE, LATERAL, CURVED = 32, 64, 128, 256, 512, 1024, 2048, 4096
FLAGS = {
    UNSEEN: "no camera shows it",
    MARKER: "on a marker",
    SATURATED: "saturated, or a pixel that does not count",
    NO_EMISSIVITY: "seen under an angle that the emissivity's table does not reach",
    BEYOND: "beyond the camera's calibration",
    NO_WALL: "of no wall",
    BEFORE: "before the heating began",
    NO_START: "never seen before the heating began: its initial temperature is unknown",
    BRIDGED: "behind frames in which it was not seen: its temperature there is a straight line",
    GAP: "behind a gap that is too long",
    LATE: "the back of the wall is felt",
    LATERAL: "heat flows along the surface",
    CURVED: "the surface is bent too sharply for the depth that heat has gone to, or ends there",
}
"""Bits of a node's flag, in words. A heat flux with one of the last three may be wrong by more than its sigma."""


def flag_words(flag: int) -> str:
    """All that a flag says."""
    return "; ".join(words for bit, words in FLAGS.items() if flag & bit)
