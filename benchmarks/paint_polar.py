"""A polar of the virtual painted wing reduced, against its truth: Cp per node, sections, CL and Cm, and their 95 %.

    python benchmarks/paint_polar.py [--seeds 101 102] [--incidences 5] [--json FILE]

The wing moves by up to 15 px between wind-off and wind-on, bends by up to 2 % of its span and twists by a degree; two
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
from windmark.errors import WindmarkError
from windmark.geometry import Pose
from windmark.paint import COEFFICIENTS, NodeField, carried
from windmark.pipeline.psp import PspTest, load_psp, read_psp_project
from windmark.pipeline.psp.point import WIND_OFF, WIND_ON, Found, point_task, read_pictures, the_model_in
from windmark.pipeline.psp.table import PointRow
from windmark.pipeline.simulate_psp import simulate_psp
from windmark.scene import Mesh
from windmark.tasks.psp import ModelPicture, ReducedPoint, Sampling, cut_sections, ratio_of, reduce_point, seen_loads

WAYS = ("no alignment", "3D rigid", "3D with deformation")
LOADS = ("CL", "Cm", "CD")
Z = 1.959964


@dataclass
class Score:
    """What is known of one way: errors, and errors over their sigmas.

    Parameters
    ----------
    nodes, in_sigmas : errors of Cp at the nodes of every point, and over their sigmas
    ratio : errors of the ratio over the sigma of its noise, at nodes that were not filled
    loads : coefficient -> (error, sigma, sigma by noise alone) of the wing at every point
    sections : (error, sigma) of the normal force of the seen side of every section and point
    failed : points without a result
    """

    nodes: list[np.ndarray] = field(default_factory=list)
    in_sigmas: list[np.ndarray] = field(default_factory=list)
    ratio: list[float] = field(default_factory=list)
    loads: dict[str, list[tuple[float, float, float]]] = field(default_factory=lambda: {name: [] for name in LOADS})
    sections: list[tuple[float, float]] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    def add(self, test: PspTest, reduced: ReducedPoint, truth: dict[str, np.ndarray], row: PointRow) -> None:
        """Score a point."""
        cp, true = reduced.cp, np.asarray(truth["cp"], dtype=float)
        off = cp.value - true
        on = np.isfinite(off)
        self.nodes.append(off[on])
        self.in_sigmas.append(off[on] / cp.sigma[on])
        sound = on & ~reduced.filled
        noise = (reduced.ratio.value / truth["ratio"] - 1)[sound]
        sigma = (np.sqrt(reduced.ratio.white) / reduced.ratio.value)[sound]
        z = noise / sigma - np.median(noise / sigma)
        self.ratio.append(1.4826 * float(np.median(np.abs(z))))
        self._loads(test, reduced, true, row)
        self._sections(test, reduced, true, row)

    def _loads(self, test: PspTest, reduced: ReducedPoint, true: np.ndarray, row: PointRow) -> None:
        task = point_task(test, row, row.conditions())
        # The truth at the same nodes, on the side that was seen: what was filled in is part of the error.
        exact = seen_loads(reduced.mesh, NodeField.make(true), task.reference, 0.0, [], seen=reduced.cp.known)
        if reduced.loads is None or exact is None:
            return
        k = reduced.loads.names.index("wing")
        for name in LOADS:
            value, sigma = reduced.loads.row("wing")[name]
            noise = reduced.loads.causes[k].get("noise", np.zeros(9))
            alone = float(np.sqrt(noise[COEFFICIENTS.index(name)]))
            self.loads[name].append((value - exact.row("wing")[name][0], sigma, alone))

    def _sections(self, test: PspTest, reduced: ReducedPoint, true: np.ndarray, row: PointRow) -> None:
        task = point_task(test, row, row.conditions())
        exact = cut_sections(test.mesh, NodeField.make(np.nan_to_num(true)), task.sections, task.reference)
        for found, of in zip([s.profile for s in reduced.sections], [s.profile for s in exact], strict=True):
            on = np.flatnonzero(found.upper & found.cp.known)
            on = on[np.argsort(found.x_c[on], kind="stable")]
            x = found.x_c[on]
            weights = np.zeros((1, len(on)))
            weights[0, :-1] += 0.5 * np.diff(x)
            weights[0, 1:] += 0.5 * np.diff(x)
            total = carried(found.cp.take(on), weights)
            self.sections.append((float(total.value[0] - weights[0] @ of.cp.value[on]), float(total.sigma[0])))

    def record(self) -> dict[str, object]:
        """The figures."""
        if not self.nodes:
            return {"points": 0, "failed": self.failed}
        off, z = np.concatenate(self.nodes), np.concatenate(self.in_sigmas)
        out: dict[str, object] = {
            "points": len(self.nodes), "failed": self.failed, "cp_rms": float(np.sqrt(np.mean(off**2))),
            "cp_median": float(np.median(np.abs(off))), "cp_covered": float(np.mean(np.abs(z) < Z)),
            "ratio_noise_over_stated": float(np.median(self.ratio)),
        }
        for name, rows in self.loads.items():
            e, s, noise = np.array(rows).T
            out[name] = {"rms": float(np.sqrt(np.mean(e**2))), "sigma": float(np.median(s)),
                         "covered": float(np.mean(np.abs(e) < Z * s)), "of": len(e),
                         "covered_noise_alone": float(np.mean(np.abs(e) < Z * noise)),
                         "too_small": float(np.median(s / np.maximum(noise, 1e-12)))}  # fmt: skip
        e, s = np.array(self.sections).T
        out["sections"] = {"rms": float(np.sqrt(np.mean(e**2))), "sigma": float(np.median(s)),
                           "covered": float(np.mean(np.abs(e) < Z * s)), "of": len(e)}  # fmt: skip
        return out


def as_a_whole(test: PspTest, found: Found) -> list[Mesh]:
    """The grid in each instant, moved as a whole to where it fits the model's markers best."""
    markers = test.deforming.test.markers
    own = markers.take(markers.role != "wall")
    out = []
    for state in found.states:
        there = state.place(own.xyz, own.volume)[0]
        a, b = own.xyz.mean(axis=0), there.mean(axis=0)
        u, _, vt = np.linalg.svd((own.xyz - a).T @ (there - b))
        turn = vt.T @ np.diag([1.0, 1.0, np.linalg.det(vt.T @ u.T)]) @ u.T
        out.append(test.mesh.moved(Pose(turn, b - turn @ a).apply(test.mesh.vertices)))
    return out


def placed(way: str, test: PspTest, on: Found, off: Found) -> list[ModelPicture]:
    """The wind-on pictures with the grid where a way has it."""
    if way == "3D with deformation":
        return list(on.pictures)
    if way == "no alignment":
        first = {p.camera: p for p in reversed(off.pictures)}
        return [replace(p, mesh=first[p.camera].mesh, moves=first[p.camera].moves) for p in on.pictures]
    whole, order = as_a_whole(test, on), list(dict.fromkeys(id(p.mesh) for p in on.pictures))
    return [replace(p, mesh=whole[order.index(id(p.mesh))]) for p in on.pictures]


def run(seed: int, incidences: int, scores: dict[str, Score]) -> None:
    """A polar by all ways."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        simulate_psp(folder, seed, incidences)
        test = load_psp(read_psp_project(folder / "psp.toml"))
        for row in test.rows:
            truth = io.read_nodes_netcdf(folder / "truth" / f"{row.name}.nc")[1]
            found = {kind: the_model_in(test, kind, read_pictures(test, kind, pattern))
                     for kind, pattern in ((WIND_ON, row.on), (WIND_OFF, row.off))}  # fmt: skip
            on, off = found[WIND_ON], found[WIND_OFF]
            mesh = on.states[0].mesh(test.mesh, frame="model")
            task = point_task(test, row, row.conditions())
            how = Sampling(test.project.sampling.max_obliquity_deg, test.project.sampling.edge_px)
            for way, score in scores.items():
                try:
                    ratio = ratio_of(placed(way, test, on, off), off.pictures, how=how, lamps=test.lamps)
                    score.add(test, reduce_point(ratio, test.mesh, mesh, task), truth, row)
                except WindmarkError as error:
                    score.failed.append(f"seed {seed}, {row.name}: {error}")
            print(f"seed {seed}, {row.name} done", flush=True)


def main() -> None:
    """Run, print the table, write the JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, nargs="+", default=[101, 102])
    parser.add_argument("--incidences", type=int, default=5)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    scores = {way: Score() for way in WAYS}
    for seed in options.seeds:
        run(seed, options.incidences, scores)
    records = {way: score.record() for way, score in scores.items()}
    for way, r in records.items():
        print(f"{way}: {json.dumps(r, indent=1)}")
    if options.json:
        options.json.write_text(json.dumps(records, indent=1) + "\n")


if __name__ == "__main__":
    main()
