"""Errors of a reduced paint test against its truth, and over their sigmas; for several benchmarks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from windmark.paint import COEFFICIENTS, NodeField, carried
from windmark.pipeline.psp import PspTest
from windmark.pipeline.psp.point import Found, point_task, sampling_of
from windmark.pipeline.psp.table import PointRow
from windmark.resection import footprints, map_pixels, outline_distance, see_nodes
from windmark.tasks.psp import ModelPicture, ReducedPoint, cut_sections, seen_loads

LOADS = ("CL", "Cm", "CD")
Z = 1.959964


def photon_limit(test: PspTest, found: Mapping[str, Found]) -> tuple[np.ndarray, np.ndarray]:
    """(V,) relative sigma of the ratio by the photo-electrons alone of all pixels nearest to a node: of all pictures of
    the model; and with those of the flat pictures.

    sigma^2 = 1 / N_off + 1 / N_on of each camera, N the electrons of all pictures (the pictures' own light over the
    gain), cameras by inverse variance; pixels near outlines and on markers do not count, as in the reduction. The model
    moves from wind-off to wind-on, so that the flat's noise on a node's pixels, the same in all pictures of a kind, is
    in both.
    """
    pictures, flats = np.zeros(len(test.mesh.vertices)), np.zeros(len(test.mesh.vertices))
    with np.errstate(divide="ignore"):
        for name in test.sensors:
            parts = [_photons(test, [p for p in of.pictures if p.camera == name]) for of in found.values()]
            own, even = np.sum(parts, axis=0)
            pictures += 1 / own
            flats += 1 / (own + even)
        sigmas = [np.sqrt(1 / of) for of in (pictures, flats)]
    pictures, flats = (np.where(np.isfinite(s), s, np.nan) for s in sigmas)
    return pictures, flats


def _photons(test: PspTest, pictures: Sequence[ModelPicture]) -> tuple[np.ndarray, np.ndarray]:
    """(V,) relative variance of the mean of one camera's pictures of a kind: by their electrons, by the flat's."""
    how, electrons, even = sampling_of(test), 0.0, 0.0
    for picture in pictures:
        model, shape = test.sensors[picture.camera].model, picture.light.shape
        where = picture.mesh, picture.lens, picture.cam_from_tunnel
        view = see_nodes(*where, max_obliquity_deg=how.max_obliquity_deg)
        pixels = map_pixels(*where, cull_backfaces=True)
        cells = footprints(pixels, view, (outline_distance(pixels) > how.edge_px) & ~how.patch_pixels(pixels))
        flat = np.broadcast_to(1.0 if model.flat is None else model.flat, shape).ravel()[cells.pixel]
        noise = np.broadcast_to(model.flat_variance, shape).ravel()[cells.pixel] / flat**2
        light = np.nan_to_num(picture.light.ravel()[cells.pixel])
        electrons = electrons + np.bincount(cells.node, light * flat / model.gain, minlength=cells.nodes)
        there = np.bincount(cells.node, np.nan_to_num(noise), minlength=cells.nodes)
        even = even + there / np.maximum(cells.count, 1) ** 2 / len(pictures)
    with np.errstate(divide="ignore"):
        return 1 / np.asarray(electrons), np.asarray(even)


def expected_coverage(cp: NodeField, draws: int = 200) -> tuple[float, float, float]:
    """Part of a point's nodes within 1.96 sigma, by errors drawn from its own covariance: mean, 2.5 and 97.5 %.

    Nodes share their errors, so that one point holds far fewer than 95 % of its nodes at times, and more at others.
    """
    rng, sigma = np.random.default_rng(1), cp.sigma
    found = []
    for _ in range(draws):
        error = cp.modes @ rng.standard_normal(cp.modes.shape[1]) + np.sqrt(cp.white) * rng.standard_normal(len(cp))
        found.append(float(np.mean(np.abs(error) < Z * sigma)))
    low, high = np.quantile(found, [0.025, 0.975])
    return float(np.mean(found)), float(low), float(high)


@dataclass
class Score:
    """What is known of one way: errors, and errors over their sigmas.

    Parameters
    ----------
    nodes, in_sigmas : errors of Cp at the nodes of every point, and over their sigmas
    ratio, noise : scatter of the ratio over its stated noise, at nodes that were not filled; and that noise, relative
    limit, with_flats : stated noise of the ratio over both values of `photon_limit`, median over those nodes
    loads : coefficient -> (error, sigma, sigma by noise alone) of the wing at every point
    sections : (error, sigma) of the normal force of the seen side of every section and point
    failed : points without a result
    expected : see `expected_coverage`, of every point
    """

    nodes: list[np.ndarray] = field(default_factory=list)
    in_sigmas: list[np.ndarray] = field(default_factory=list)
    ratio: list[float] = field(default_factory=list)
    noise: list[float] = field(default_factory=list)
    limit: list[float] = field(default_factory=list)
    with_flats: list[float] = field(default_factory=list)
    loads: dict[str, list[tuple[float, float, float]]] = field(default_factory=lambda: {name: [] for name in LOADS})
    sections: list[tuple[float, float]] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    expected: list[tuple[float, float, float]] = field(default_factory=list)

    def add(
        self, test: PspTest, reduced: ReducedPoint, truth: dict[str, np.ndarray], row: PointRow,
        limit: tuple[np.ndarray, np.ndarray],
    ) -> None:  # fmt: skip
        """Score a point; ``limit``: see `photon_limit`."""
        cp, true = reduced.cp, np.asarray(truth["cp"], dtype=float)
        off = cp.value - true
        on = np.isfinite(off)
        self.nodes.append(off[on])
        self.in_sigmas.append(off[on] / cp.sigma[on])
        sound = on & ~reduced.filled
        # Differences of neighbours: what nodes share (registration, lamps) is in none of them.
        edges = test.mesh.triangles[:, [0, 1, 1, 2]].reshape(-1, 2)
        i, j = edges[sound[edges].all(axis=1)].T
        noise, white = reduced.ratio.value - truth["ratio"], reduced.ratio.white
        self.ratio.append(1.4826 * float(np.median(np.abs(noise[i] - noise[j]) / np.sqrt(white[i] + white[j]))))
        self.noise.append(float(np.median(np.sqrt(white[sound]) / reduced.ratio.value[sound])))
        for of, scores in zip(limit, (self.limit, self.with_flats), strict=True):
            scores.append(float(np.median((np.sqrt(white) / reduced.ratio.value / of)[sound & np.isfinite(of)])))
        self.expected.append(expected_coverage(cp.take(on)))
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
            "ratio_noise_over_stated": float(np.median(self.ratio)), "ratio_noise": float(np.median(self.noise)),
            "ratio_noise_over_photon_limit": float(np.median(self.limit)),
            "with_flats": float(np.median(self.with_flats)), "cp_z_std": float(np.std(z)),
            "cp_expected_per_point": [tuple(round(v, 3) for v in of) for of in self.expected],
            "cp_covered_per_point": [float(np.mean(np.abs(z) < Z)) for z in self.in_sigmas],
        }
        for name, rows in self.loads.items():
            e, s, noise = np.array(rows).T
            out[name] = {"rms": float(np.sqrt(np.mean(e**2))), "sigma": float(np.median(s)),
                         "covered": float(np.mean(np.abs(e) < Z * s)), "of": len(e),
                         "z_rms": float(np.sqrt(np.mean((e / s) ** 2))),
                         "covered_noise_alone": float(np.mean(np.abs(e) < Z * noise)),
                         "too_small": float(np.median(s / np.maximum(noise, 1e-12)))}  # fmt: skip
        e, s = np.array(self.sections).T
        out["sections"] = {"rms": float(np.sqrt(np.mean(e**2))), "sigma": float(np.median(s)),
                           "covered": float(np.mean(np.abs(e) < Z * s)), "of": len(e),
                           "z_rms": float(np.sqrt(np.mean((e / s) ** 2)))}  # fmt: skip
        return out
