"""An infrared run of the virtual heated wing against its truth: temperature, heat flux, and their 95 % intervals.

    python benchmarks/paint_infrared.py [--seeds 301 302] [--frames 30] [--json FILE]

The wing moves by some 10 px, bends and heats up by 2 to 6 K in a second before two cameras; what the project says of
emissivity, surroundings and walls is off the truth by its sigma. The truth is that of the virtual test, whose walls are
followed by finite differences. Several ways side by side: everything corrected; emissivity that does not fall with the
angle; nothing reflected; the grid left where it was at first; no curvature. Errors are those of nodes that a way's own
flags call sound (without curvature none is called too sharply bent);
"steady" leaves out the first third of a second of heating, which the samples hardly resolve.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from windmark import io
from windmark.pipeline.deform.pictures import follow_deformation
from windmark.pipeline.deform.wind_off import zeroed
from windmark.pipeline.infrared import InfraredRun, load_infrared, read_infrared_project
from windmark.pipeline.infrared.flux import FieldMaker, make_fluxes
from windmark.pipeline.infrared.run import DOUBTFUL, one_frame
from windmark.pipeline.infrared.store import Store
from windmark.pipeline.simulate_infrared import simulate_infrared

WAYS = ("everything", "no angle", "no reflection", "no motion", "no curvature")
Z = 1.959964
STEADY_S = 0.35
NOTHING_K = 100.0
"""Surroundings that send no light to speak of."""


@dataclass
class Score:
    """Errors of one way: (error, sigma, frame's seconds after the start, node) of every node and frame."""

    temperature: list[np.ndarray] = field(default_factory=list)
    flux: list[np.ndarray] = field(default_factory=list)
    flagged: list[float] = field(default_factory=list)

    def record(self) -> dict[str, float]:
        """The figures."""
        e, s, _, _ = np.concatenate(self.temperature, axis=1)
        q, t, since, _ = np.concatenate(self.flux, axis=1)
        late = since > STEADY_S
        return {
            "T_rms_K": rms(e), "T_bias_K": float(np.median(e)), "T_sigma_K": float(np.median(s)),
            "T_covered": covered(e, s), "q_rms": rms(q), "q_sigma": float(np.median(t)), "q_covered": covered(q, t),
            "q_rms_steady": rms(q[late]), "q_bias_steady": float(np.median(q[late])),
            "q_sigma_steady": float(np.median(t[late])), "q_covered_steady": covered(q[late], t[late]),
            "histories_covered_median": histories(self.flux), "flagged": float(np.mean(self.flagged)),
        }  # fmt: skip


def rms(e: np.ndarray) -> float:
    return float(np.sqrt(np.mean(e**2)))


def covered(e: np.ndarray, s: np.ndarray) -> float:
    return float(np.mean(np.abs(e) < Z * s))


def histories(rows: list[np.ndarray]) -> float:
    """Median over the nodes of the part of a node's history within its intervals."""
    out = []
    for seed in {float(r[3, 0]) // 1e6 for r in rows if r.shape[1]}:
        own = np.concatenate([r for r in rows if r.shape[1] and r[3, 0] // 1e6 == seed], axis=1)
        node, inside = (own[3] % 1e6).astype(int), np.abs(own[0]) < Z * own[1]
        count = np.bincount(node)
        out.append((np.bincount(node, inside) / np.maximum(count, 1))[count > 5])
    return float(np.median(np.concatenate(out)))


def changed(run: InfraredRun, way: str) -> InfraredRun:
    """The run as a way has it."""
    if way == "no angle":
        e = float(run.project.surface.emissivity or 0.0)
        return replace(run, surface=replace(run.surface, emissivity=lambda angle: np.full(np.shape(angle), e)))
    if way == "no reflection":
        return replace(run, surface=replace(run.surface, surroundings=NOTHING_K, surroundings_sigma=0.0))
    return replace(run, curvature=np.zeros(len(run.curvature))) if way == "no curvature" else run


def reduce_by(way: str, run: InfraredRun, found: list, folder: Path, number: int, score: Score) -> None:
    """All frames by one way, against the truth."""
    run = changed(run, way)
    store, good = Store(folder / way.replace(" ", "-"), tuple(run.sensors)), []
    first = found[0][0].state
    for frame, images in found:
        placed = replace(frame, state=first) if way == "no motion" and frame.state is not None else frame
        if one_frame(run, store, placed, images).status == "reduced":
            good.append(frame.index)
    done = make_fluxes(run, store, good)
    maker = FieldMaker(run, store, done)
    assert run.project.heat is not None
    for index in good:
        fields = maker.fields(index)
        truth = io.read_nodes_netcdf(folder / "test" / "truth" / f"{index}.nc")[1]
        since = float(run.times[index]) - run.project.heat.start_s
        sound = (fields.flags & DOUBTFUL) == 0
        for of, name, rows in ((fields.temperature, "temperature", score.temperature),
                               (fields.flux, "heat_flux", score.flux)):  # fmt: skip
            off = of.value - np.asarray(truth[name], dtype=float)
            on = np.flatnonzero(of.known & np.isfinite(off) & (sound | (name == "temperature")))
            rows.append(np.stack([off[on], of.sigma[on], np.full(len(on), since), on + 1e6 * number]))
            if name == "heat_flux" and of.known.any():
                score.flagged.append(float(np.mean(~sound[of.known])))


def run_seed(seed: int, number: int, frames: int, scores: dict[str, Score]) -> None:
    """One virtual run by all ways; the model is found once."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "test").mkdir()
        simulate_infrared(folder / "test", seed, frames)
        run = load_infrared(read_infrared_project(folder / "test" / "infrared.toml"))
        run = replace(run, deforming=zeroed(run.deforming, run.timeline)[0])
        found = list(zip(follow_deformation(run.timeline.frames, run.deforming.test), run.timeline.frames, strict=True))
        for way, score in scores.items():
            reduce_by(way, run, found, folder, number, score)
            print(f"seed {seed}, {way} done", flush=True)


def main() -> None:
    """Run, print the table, write the JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, nargs="+", default=[301, 302])
    parser.add_argument("--frames", type=int, default=30)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    scores = {way: Score() for way in WAYS}
    for number, seed in enumerate(options.seeds):
        run_seed(seed, number, options.frames, scores)
    records = {way: score.record() for way, score in scores.items()}
    for way, r in records.items():
        print(f"{way:14s} " + ", ".join(f"{k} {v:.4g}" for k, v in r.items()))
    if options.json:
        options.json.write_text(json.dumps(records, indent=1) + "\n")


if __name__ == "__main__":
    main()
