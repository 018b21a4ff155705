"""The job of 2D alignment: images of one camera recomputed on a reference by their markers."""

from windmark.pipeline.align2d.named import NamedSpots, read_named
from windmark.pipeline.align2d.outputs import residual_columns, write_one
from windmark.pipeline.align2d.run import AlignedFile, AlignSettings, Reference, align_files, read_reference

__all__ = [
    "AlignSettings", "AlignedFile", "NamedSpots", "Reference", "align_files", "read_named", "read_reference",
    "residual_columns", "write_one",
]  # fmt: skip
