"""What is true of a virtual paint test: fields at the nodes, loads, sections, readings of the taps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.scene import Mesh
from windmark.synth.motion import flex
from windmark.synth.polar_flow import PolarFlow
from windmark.synth.pressure_paint import Air
from windmark.synth.psp import PIVOT, PspPoint, PspTest
from windmark.synth.sequence import WingState

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NodeTruth:
    """Fields at the nodes of the grid, (V,) each; NaN on what carries no paint.

    Parameters
    ----------
    cp : pressure coefficient
    p_Pa, T_K : with wind
    ratio : I of the still air over I with wind, of the paint alone: light, fading and flicker are not in it
    """

    cp: Array
    p_Pa: Array
    T_K: Array
    ratio: Array


def node_truth(test: PspTest, point: PspPoint) -> NodeTruth:
    """The fields of a point."""
    mesh = test.mesh
    p, warm, still_p, still_T = (np.full(len(mesh.vertices), np.nan) for _ in range(4))
    normals = mesh.vertex_normals()
    for volume in test.paint.sensitive:
        v = np.unique(mesh.triangles[mesh.volume == volume])
        p[v], warm[v] = point.wind.state(mesh.vertices[v], normals[v], volume)
        still_p[v], still_T[v] = point.still.state(mesh.vertices[v], normals[v], volume)
    ratio = test.law.ratio(p, warm) / test.law.ratio(still_p, still_T)
    return NodeTruth((p - point.wind.p_inf_Pa) / point.wind.q_inf_Pa, p, warm, ratio)


def tap_pressures(test: PspTest, air: Air) -> Array:
    """(N,) true pressures at the taps (Pa)."""
    taps = test.taps
    out = np.full(len(taps), np.nan)
    for volume in set(taps.volume.tolist()):
        own = taps.volume == volume
        out[own] = air.state(taps.xyz[own], taps.normal[own], volume)[0]
    return out


def placed(test: PspTest, state: WingState) -> Mesh:
    """The grid where the model is in a state, in the tunnel's frame; walls at rest."""
    shape, mesh = test.test.shape, test.mesh
    vertices = mesh.vertices.copy()
    wing = np.unique(mesh.triangles[mesh.volume == "wing"])
    vertices[wing] = flex(
        vertices[wing], state.tip_fraction, state.twist_deg, root=shape.body_radius, span=shape.span,
        sweep_deg=shape.sweep_deg, axis_x=0.25 * shape.root_chord,
    )  # fmt: skip
    model = np.unique(mesh.triangles[mesh.volume != "wall"])
    vertices[model] = state.motion.apply(vertices[model])
    return mesh.moved(vertices)


@dataclass(frozen=True)
class LoadTruth:
    """Coefficients of a part of the model in the tunnel's (wind) axes: x drag, z lift, nose-up moment.

    Lengths are made with the span between root and tip and the mean chord; moments are about the pivot.
    """

    volume: str
    cl: float
    cd: float
    cm: float


def reference_lengths(test: PspTest) -> tuple[float, float]:
    """Area (mm^2) of the wing outside the body, and its mean chord (mm)."""
    shape = test.test.shape
    chord = float(shape.chord(0.5 * (shape.body_radius + shape.span)))
    return chord * (shape.span - shape.body_radius), chord


def load_truth(test: PspTest, mesh: Mesh, state: WingState, cp: Array) -> list[LoadTruth]:
    """Pressure loads of each painted volume; ``mesh`` in the tunnel (`placed`), ``cp`` (V,) at its nodes."""
    area, chord = reference_lengths(test)
    about = state.motion.apply(np.array(PIVOT))
    corner = mesh.vertices[mesh.triangles]
    vector = 0.5 * np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    # Cp is linear over a facet: its force is at the mean of the corners but for what weights them unevenly.
    at = cp[mesh.triangles]
    force = -at.mean(axis=1)[:, None] * vector
    weight = (at + at.sum(axis=1, keepdims=True)) / 12
    arm = np.einsum("tk,tkx->tx", weight, corner - about)
    moment = -np.cross(arm, vector)
    out = []
    for volume in test.paint.sensitive:
        own = mesh.volume == volume
        total, turn = force[own].sum(axis=0) / area, moment[own].sum(axis=0) / (area * chord)
        out.append(LoadTruth(volume, float(total[2]), float(total[0]), float(turn[1])))
    return out


def section_truth(test: PspTest, wind: PolarFlow, eta: float, count: int = 100) -> tuple[Array, Array, Array]:
    """Chordwise x/c (2 n,), side (1 upper, -1 lower) and Cp at a span station of the wing at rest."""
    shape = test.test.shape
    s = (np.arange(count) + 0.5) / count
    t = (eta * shape.span - shape.wing_root) / (shape.span - shape.wing_root)
    patches = shape.patches()
    parts = []
    for side, block in ((1.0, "wing_upper"), (-1.0, "wing_lower")):
        xyz, normal = patches[block].place(s, np.full(count, t))
        parts.append((shape.planform(xyz)[0], np.full(count, side), wind.cp(xyz, normal, "wing")))
    return tuple(np.concatenate([part[k] for part in parts]) for k in range(3))  # type: ignore[return-value]
