"""Unknown markers over many pictures: matching, growing, the primaries' frame, the final adjustment."""

from windmark.pipeline.reconstruct.reconstruct import reconstruct
from windmark.pipeline.reconstruct.result import NotReconstructed, Reconstruction

__all__ = ["NotReconstructed", "Reconstruction", "reconstruct"]
