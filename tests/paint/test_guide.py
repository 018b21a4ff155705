"""The code of the guide's section on paint and infrared runs, on a small virtual case, and finds what was put in."""

import re
import sys
from pathlib import Path

import numpy as np

import windmark as wm
from windmark import paint

sys.path.insert(0, str(Path(__file__).parent))
from paint_shapes import paint as a_paint
from paint_shapes import sphere

GUIDE = Path(__file__).parents[2] / "docs" / "guide.md"


def blocks():
    """Python of the section, in order."""
    text = GUIDE.read_text("utf-8").split("## Paint and infrared: the functions")[1].split("\n## ")[0]
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


def test_the_guides_code_runs_and_finds_the_loads():
    rng = np.random.default_rng(12)
    law, mesh = a_paint(), sphere(40)
    conditions = wm.TunnelConditions.from_mach(1.2e5, 0.6, 300.0, p_0_sigma=50.0, mach_sigma=0.001)
    t_wind = wm.recovery_temperature(conditions, 1).value[0]
    cp_true = -0.4 * mesh.vertices[:, 2]
    p_true = conditions.p_inf + conditions.q_inf * cp_true
    p_cell, t_cell = (g.ravel() for g in np.meshgrid(np.linspace(3e4, 1.4e5, 8), np.linspace(280, 315, 5)))
    off = 2000 * np.ones(len(p_true))
    on = off / (law.ratio(p_true, t_wind) / law.ratio(98500.0, 291.2))
    taps = rng.choice(len(mesh.triangles), 15, replace=False)
    names = {
        "wm": wm, "np": np, "paint": paint, "mesh": mesh, "conditions": conditions, "p_cell": p_cell, "t_cell": t_cell,
        "ratio_cell": law.ratio(p_cell, t_cell) + 0.003 * rng.normal(size=p_cell.size),
        "light_off": wm.NodeField.make(off + 2 * rng.normal(size=len(off)), 2.0),
        "light_on": wm.NodeField.make(on + 2 * rng.normal(size=len(on)), 2.0),
        "tap_nodes": mesh.triangles[taps], "tap_weights": np.full((15, 3), 1 / 3),
        "tap_names": [f"t{k}" for k in range(15)],
        "tap_pressures": p_true[mesh.triangles[taps]].mean(axis=1) + 50 * rng.normal(size=15),
        "signal": wm.NodeField.make(wm.PlanckBand(8.0, 12.0).radiance([300.0, 320.0]), 0.05),
        "histories": 300 + np.cumsum(rng.uniform(0, 0.1, (3, 50)), axis=1),
    }  # fmt: skip
    code = blocks()
    assert len(code) == 2
    for block in code:
        exec(compile(block, str(GUIDE), "exec"), names)
    truth = wm.integrate_loads(mesh, wm.NodeField.make(cp_true), wm.LoadReference(area=0.42, chord=0.21, span=2.0,
                                                                                   alpha_deg=3.0))  # fmt: skip
    got, sigma = names["loads"].row("all")["CL"]
    assert abs(got - truth.row("all")["CL"][0]) < 3 * sigma
    assert sigma < 0.05
    assert names["q"].flux.shape == (3, 50)
