"""A polar of the virtual painted wing reduced, against its truth: Cp per node, sections, CL and Cm, and their 95 %.

    python benchmarks/paint_polar.py [--seeds 101 102] [--incidences 5] [--json FILE]

The wing moves by 10 to 30 px between wind-off and wind-on, bends by up to 2 % of its span and twists by a degree; two
cameras, 27 taps on their side. Three ways side by side (AIAA 2005-5007, Fig. 10): pictures taken as if the model stood
where it was wind-off, moved as a whole, and with the deformation of every picture. Loads are those of the side that the
cameras show, truth and result alike; the truth is that at the same nodes, so the grid's own error is in neither.
"Noise alone" leaves the modes out of the sigma of CL.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from windmark import io
from windmark.deformation import Volume, Volumes
from windmark.errors import WindmarkError
from windmark.paint import COEFFICIENTS, NodeField, carried, integrate_loads, interpolated
from windmark.pipeline.psp import load_psp, read_psp_project
from windmark.pipeline.psp.point import Found, PointOutcome, point_task, read_pictures, reduced_of, the_model_in
from windmark.pipeline.simulate_psp import simulate_psp
from windmark.tasks.psp import UNSEEN_SIDE, ReducedPoint, SectionWanted, cut_sections, seen_sides

WAYS = ("no alignment", "3D rigid", "3D with deformation")
Z = 1.959964


@dataclass
class Score:
    """What is known of one way: errors, and errors over their sigmas."""

    nodes: list[np.ndarray] = field(default_factory=list)
    in_sigmas: list[np.ndarray] = field(default_factory=list)
    ratio_sigma: list[float] = field(default_factory=list)
    loads: dict[str, list[tuple[float, float, float]]] = field(default_factory=lambda: {"CL": [], "Cm": [], "CD": []})
    sections: list[tuple[float, float]] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
