"""A mesh as plain arrays, and names that a file may give to its parts."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from windmark.io.apart import Content
from windmark.io.errors import LONGEST_NAME, FileError
from windmark.io.structured import Volumes, rename_volumes
from windmark.io.text import Pathlike
from windmark.scene import Block, Mesh

def check_names(path: Pathlike, names: Iterable[str], where: int | str | None = None) -> None:
    """`FileError` for a name of more than `LONGEST_NAME` characters."""
    for name in names:
        if len(name) > LONGEST_NAME:
            what = f"the name {name[:20]!r}... has {len(name)} characters; expected at most {LONGEST_NAME}"
            raise FileError(path, what, where)


def mesh_content(path: Pathlike, mesh: Mesh) -> Content:
    """The mesh as `content_mesh` takes it."""
    names, which = np.unique(mesh.volume, return_inverse=True)
    check_names(path, [*names.tolist(), *(block.name for block in mesh.blocks)])
    content: Content = {
        "vertices": mesh.vertices,
        "triangles": mesh.triangles,
        "volume_names": names.tolist(),
        "triangle_volume": which.astype(np.int32),
        "length_unit": mesh.length_unit,
        "blocks": [[block.name, block.shape_ijk, block.first] for block in mesh.blocks],
    }
    return content if mesh.blanked is None else {**content, "blanked": mesh.blanked}


def content_mesh(content: Content, volumes: Volumes = None) -> Mesh:
    """The mesh of `mesh_content`, its volumes renamed as `rename_volumes` says."""
    names = np.array(rename_volumes(content["volume_names"], volumes), dtype=np.str_)
    blocks = tuple(Block(name, (i, j, k), first) for name, (i, j, k), first in content["blocks"])
    volume = names[content["triangle_volume"]]
    return Mesh(
        content["vertices"], content["triangles"], volume, blocks, content.get("blanked"), content["length_unit"]
    )
