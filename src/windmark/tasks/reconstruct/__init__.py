"""Unknown markers over many pictures: matching, growing, the primaries' frame, the final adjustment."""

from windmark.tasks.reconstruct.reconstruct import reconstruct
from windmark.tasks.reconstruct.result import NotReconstructed, Reconstruction

__all__ = ["NotReconstructed", "Reconstruction", "reconstruct"]
