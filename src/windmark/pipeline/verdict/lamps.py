"""The verdict on the lamps of a paint test: where they stand beside the model, and whether they light what is seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from windmark.errors import g2
from windmark.geometry import Camera, Pose
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.lengths import lamp_findings
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding
from windmark.resection import see_nodes
from windmark.scene import Mesh


def lamps_findings(
    mesh: Mesh, lamps: Sequence[Sequence[float]], views: Sequence[tuple[Camera, Pose]], unit: str
) -> list[Finding]:
    """Lamps that stand where none can, see `lamp_findings`; else those that light hardly any of what cameras show.

    Parameters
    ----------
    mesh : the model at rest, in the tunnel, turned to the air
    lamps : their places, in the tunnel
    views : the cameras with their poses (cam_from_tunnel)
    unit : of lengths
    """
    if not (len(lamps) and len(mesh.triangles)):
        return []
    return lamp_findings(mesh, lamps, unit) or _unlit(mesh, lamps, views, unit)


def _unlit(
    mesh: Mesh, lamps: Sequence[Sequence[float]], views: Sequence[tuple[Camera, Pose]], unit: str
) -> list[Finding]:
    seen = np.zeros(len(mesh.vertices), bool)
    for camera, pose in views:
        seen |= see_nodes(mesh, camera, pose).visible
    area = np.zeros(len(mesh.vertices))
    np.add.at(area, mesh.triangles, np.linalg.norm(mesh.triangle_normals(), axis=1)[:, None] / 6)
    area, normal = np.where(seen, area, 0.0), np.nan_to_num(mesh.vertex_normals())
    found = []
    for k, lamp in enumerate(lamps if area.sum() > 0 else ()):
        lit = np.einsum("vk,vk->v", np.asarray(lamp) - np.nan_to_num(mesh.vertices), normal) > 0
        part = float(area[lit].sum() / area.sum())
        if part < rules.LAMP_LIGHTS:
            words = f"lamp {k + 1} at ({', '.join(f'{x:.4g}' for x in lamp)}) {unit} lights {g2(100 * part)} % of the "
            words += "surface that cameras show: it is behind it, and light that changes as the model moves is wrong"
            step = "see signs and axes of lamp.position, in the frame of markers and grid; or leave out that lamp"
            found.append(Finding(DOUBTFUL, "lamps", words, step))
    return found
