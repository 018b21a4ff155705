"""What a result says against itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Doubt:
    """Something that was found to be wrong, or weaker than it looks.

    Parameters
    ----------
    names : of markers, views, cameras or parameters
    words : a sentence with ``{}`` for each name, in their order; of many names for the first ones
    cause : what it is about, for the verdict on the whole: "moved" (a camera), "late" (its pictures), "swapped",
        "marker", "picture", "attached" (a part to another one), "bent" (a law that is too simple), "bound" (of a law's
        parameter, which the images contradict), "prior" (its sigma, likewise), "noise", "focal", "lens" (or what else
        of a camera), "principal" (point), "sheared" or "distorted" (pictures), "focus" (that nothing checks),
        "control", "table", "discs" (radii or normals of the table), "layout", "mirrored", "mixed" (two cameras),
        "scene" (it changed between pictures),
        "twofold" (a parameter of a law); "" for anything else
    """

    names: tuple[str, ...]
    words: str
    cause: str = ""

    def __str__(self) -> str:
        return self.words.format(*self.names)

    def renamed(self, names: Mapping[str, str]) -> Doubt:
        """The same of things that are called otherwise."""
        return Doubt(tuple(names.get(n, n) for n in self.names), self.words, self.cause)
