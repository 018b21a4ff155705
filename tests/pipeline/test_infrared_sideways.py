"""Heat along the surface: a fine grid flags it like a coarse one, and noise alone is no flow."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import erf

from windmark.paint import NodeField, Wall
from windmark.pipeline.infrared.flux import FieldMaker, make_fluxes
from windmark.pipeline.infrared.store import Store
from windmark.scene import Mesh, structured_triangles
from windmark.tasks.infrared import LATERAL, CameraTemperature

STEEL = Wall.semi_infinite(15.0, 3.7e6)
TIMES, START, Q = np.arange(16) * 0.2, 0.5, 20000.0


def last_frame(folder, spacing, part, *, noise=0.05, said=None, seed=1):
    """Fields of the last frame of a steel plate under a flux ``Q (1 + part cos k x)``, and the true flux."""
    rng = np.random.default_rng(seed)
    nx, ny = round(0.04 / spacing) + 1, round(0.03 / spacing) + 1
    x, y = np.meshgrid(np.arange(nx) * spacing, np.arange(ny) * spacing)
    x, y = x.ravel(), y.ravel()
    mesh = Mesh.make(np.stack([x, y, 0 * x], axis=1), structured_triangles(nx, ny))
    count, k, store = len(x), 2 * np.pi / 0.02, Store(folder, ("a",))
    effusivity, diffusivity = np.sqrt(15.0 * 3.7e6), 15.0 / 3.7e6
    for n, t in enumerate(np.maximum(TIMES - START, 0)):
        rise = 2 * Q / effusivity * np.sqrt(t / np.pi)
        rise = rise + part * Q / (15.0 * k) * erf(k * np.sqrt(diffusivity * t)) * np.cos(k * x)
        field = NodeField(300 + rise + noise * rng.standard_normal(count), np.full(count, (said or noise) ** 2),
                          np.zeros((count, 0)), (), "K")  # fmt: skip
        store.put(n, mesh.vertices, {"a": CameraTemperature(field, np.ones(count), np.zeros(count, np.uint16))})
    run = SimpleNamespace(
        times=TIMES, walls=(STEEL,), wall_of=np.zeros(count, int), mesh=mesh, metres=1.0, curvature=np.zeros(count),
        project=SimpleNamespace(heat=SimpleNamespace(start_s=START, longest_gap=3, most_lateral=0.1)),
    )  # fmt: skip
    maker = FieldMaker(run, store, make_fluxes(run, store, range(len(TIMES))))
    return maker.fields(len(TIMES) - 1), Q * (1 + part * np.cos(k * x))


@pytest.mark.parametrize("spacing", [2e-3, 1e-3, 6e-4])
def test_a_fine_grid_flags_what_a_coarse_one_does_and_the_sigma_holds_it(tmp_path, spacing):
    done, true = last_frame(tmp_path, spacing, 0.6)
    off = done.flux.value - true
    large = np.abs(off) > 0.1 * np.abs(true)
    assert large.mean() > 0.3
    assert ((done.flags & LATERAL) > 0)[large].mean() > 0.97
    assert np.abs(off / done.flux.sigma).max() < 5
    assert done.flux.names[-1] == "along the surface"


@pytest.mark.parametrize(("spacing", "noise", "said"), [(1e-3, 0.3, None), (6e-4, 0.3, None), (1e-3, 0.3, 0.1)])
def test_noise_is_no_flow_even_where_it_is_more_than_said(tmp_path, spacing, noise, said):
    done, _ = last_frame(tmp_path, spacing, 0.0, noise=noise, said=said)
    assert ((done.flags & LATERAL) > 0).mean() < 0.05
    along = done.flux.modes[:, -1]
    rest = np.sqrt(done.flux.white + (done.flux.modes[:, :-1] ** 2).sum(axis=1))
    assert np.median(np.abs(along)) < np.median(rest)
