"""Small meshes for the tests of files: structured blocks with every flat dimension, a shell of triangles."""

from __future__ import annotations

import numpy as np

from windmark.io.structured import structured_mesh, surface_shape, zone_names
from windmark.scene import Block, Mesh

Shape = tuple[int, int, int]


def blocks_mesh(shapes: list[Shape], *, blanked: bool = False, single: bool = True, seed: int = 0) -> Mesh:
    """Wavy patches side by side; ``single``: coordinates that float32 holds exactly."""
    rng = np.random.default_rng(seed)
    blocks, parts, first = [], [], 0
    for k, (name, shape) in enumerate(zip(zone_names(len(shapes)), shapes, strict=True)):
        blocks.append(Block(name, shape, first))
        first += blocks[-1].size
        u, v = np.meshgrid(*(np.arange(n) for n in surface_shape(shape)), indexing="xy")
        x, y = u.ravel() * 0.1 + 3.7 * k + 0.03, v.ravel() * 0.2 - 0.51
        parts.append(np.stack([x, y, np.sin(3 * x + y) + 1.7], axis=1) + rng.normal(0, 1e-3, (len(x), 3)))
    xyz = np.concatenate(parts)
    xyz = xyz.astype(np.float32).astype(float) if single else xyz
    off = rng.random(len(xyz)) < 0.15 if blanked else None
    return structured_mesh(xyz, tuple(blocks), off)


def shell_mesh() -> Mesh:
    """Triangles without blocks, in two volumes; one node is in no triangle."""
    patch = blocks_mesh([(7, 5, 1)], single=False)
    volume = np.where(np.arange(len(patch.triangles)) % len(patch.triangles) < 11, "fuselage", "wing, left")
    return Mesh.make(np.concatenate([patch.vertices, [[9.0, 9.0, 9.0]]]), patch.triangles, volume)
