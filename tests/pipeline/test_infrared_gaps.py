"""Cameras that lack pictures: heat flux goes on from those that they have, and frames without one are told."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.paint import NodeField, Wall
from windmark.pipeline.infrared.flux import FieldMaker, make_fluxes
from windmark.pipeline.infrared.record import REDUCED, FrameRecord
from windmark.pipeline.infrared.store import Store
from windmark.pipeline.verdict import DOUBTFUL, GOOD
from windmark.pipeline.verdict.infrared import infrared_verdict
from windmark.scene import Mesh, structured_triangles
from windmark.synth.heating import RESIN
from windmark.tasks.infrared import GAP, CameraTemperature

START, NOISE, TIMES = 0.3, 0.01, np.arange(45) * 0.05
WALL = Wall.semi_infinite(0.25, 1.7e6)


def flux(since):
    return 1500 * np.minimum(since / 0.15, 1) * (since > 0) * np.exp(-0.2 * since)


RISE = RESIN.rise(flux, np.maximum(TIMES - START, 0))


def fields(tmp_path, lost, seed=1):
    """Frames' fields of two cameras that see a plate, whose pictures in some frames are ``lost``."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(12.0), np.arange(8.0))
    mesh = Mesh.make(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), structured_triangles(12, 8))
    count, store = len(mesh.vertices), Store(tmp_path, ("a", "b"))
    for k, rise in enumerate(RISE):
        seen = {}
        for c in "ab":
            if k not in lost[c]:
                field = NodeField(300 + rise + NOISE * rng.standard_normal(count), np.full(count, NOISE**2),
                                  np.zeros((count, 0)), (), "K")  # fmt: skip
                seen[c] = CameraTemperature(field, np.ones(count), np.zeros(count, np.uint16))
        store.put(k, mesh.vertices, seen)
    run = SimpleNamespace(
        times=TIMES, walls=(WALL,), wall_of=np.zeros(count, int), mesh=mesh, metres=1.0, curvature=np.zeros(count),
        project=SimpleNamespace(heat=SimpleNamespace(start_s=START, longest_gap=3, most_lateral=0.1)),
    )  # fmt: skip
    frames = range(len(TIMES))
    maker = FieldMaker(run, store, make_fluxes(run, store, frames))
    return [maker.fields(k) for k in frames]


@pytest.mark.parametrize("lost", [{"a": [20], "b": [25]}, {"a": [3, 20, 21], "b": [2, 9]}])
def test_each_camera_lacks_another_picture_and_the_heat_flux_goes_on(tmp_path, lost):
    done = fields(tmp_path, lost)
    for k in range(7, len(TIMES)):
        assert done[k].flux.known.all()
        assert done[k].no_flux == ""
    true = flux(TIMES - START)
    off = np.array([(done[k].flux.value - true[k]) / done[k].flux.sigma for k in range(10, len(TIMES))])
    assert (np.abs(off) < 1.96).mean() > 0.93
    assert (np.abs(off) < 1.96).mean(axis=1).min() > 0.85


def test_behind_a_gap_that_is_too_long_in_every_camera_frames_are_told(tmp_path):
    done = fields(tmp_path, {"a": [20, 21, 22, 23], "b": [25, 26, 27, 28]})
    assert [k for k, f in enumerate(done) if f.no_flux] == list(range(25, 45))
    assert done[29].no_flux == "behind a gap that is too long"
    assert (done[29].flags & GAP > 0).all()
    assert done[24].flux.known.all()  # b's, from before its gap
    alone = fields(tmp_path / "one", {"a": [20, 21, 22, 23], "b": []})
    assert not any(f.no_flux for f in alone)
    never = fields(tmp_path / "none", {"a": range(7), "b": range(7, 45)})
    assert all(f.no_flux.startswith("never seen before the heating began") for f in never[7:])


def test_a_verdict_names_frames_without_heat_flux():
    def run(without):
        same = {"pictures": {}, "status": REDUCED, "seen": 0.3, "median_T": 300.0, "median_sigma_T": 0.1}
        return [FrameRecord(f"{k}", k, 0.1 * k, no_flux="behind a gap" if k in without else "", **same)
                for k in range(60)]  # fmt: skip

    assert infrared_verdict(run([])).word == GOOD
    found = infrared_verdict(run(range(31, 60)))
    assert (found.word, found.cause) == (DOUBTFUL, "lost")
    assert found.reason == ("29 of 60 frames with temperatures have no heat flux on most nodes (frames 31, 32, 33, 34, "
                            "35 and 24 more): behind a gap")  # fmt: skip
