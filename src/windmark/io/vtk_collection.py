"""ParaView collections: files of one folder as the steps of one animation."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from xml.sax.saxutils import quoteattr

from windmark.io.atomic import atomic_write


def write_collection(path: str | os.PathLike[str], steps: Sequence[tuple[float, str]]) -> None:
    """Write a ``.pvd`` file, which ParaView opens as an animation.

    Parameters
    ----------
    path : of the collection
    steps : time and file of each step, the file relative to the collection. Where a time is unknown (NaN) all are
        numbered instead: times and numbers on one axis would be in no order

    Raises
    ------
    FileError
        Where the file cannot be written; then nothing is.
    """
    known = all(math.isfinite(time) for time, _ in steps)
    rows = [
        f'    <DataSet timestep="{time if known else k:.9g}" file={quoteattr(file)}/>\n'
        for k, (time, file) in enumerate(steps)
    ]
    with atomic_write(path) as stream:
        stream.write('<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n')
        stream.write("".join(rows) + "  </Collection>\n</VTKFile>\n")
