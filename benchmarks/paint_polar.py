"""A polar of the virtual painted wing reduced, against its truth: Cp per node, sections, CL and Cm, and their 95 %.

    python benchmarks/paint_polar.py [--seeds 101 102] [--incidences 5] [--ways "3D with deformation"] [--taps 20]
        [--flats 16] [--json FILE] [--picture FILE]

The wing moves by up to 15 px between wind-off and wind-on, bends by up to 2 % of its span and twists by a degree; two
cameras, 27 taps on their side, of which ``--taps`` keeps some at random. Ways side by side (AIAA 2005-5007, Fig. 10):
pictures taken as if the model stood where it was wind-off; wind-on pictures recomputed on the wind-off ones by their
markers, 2D, orders 1 to 3; the grid moved as a whole; and with the deformation of every picture. Loads are those of the
side that the cameras show, truth and result alike; the truth is that at the same nodes, so the grid's own error is in
neither. "Noise alone" leaves the modes out of the sigma of CL; "over photon limit" is the stated noise of the ratio
over what the photo-electrons of a node's own pixels leave in all pictures of the model; ``--flats`` leaves each camera
so many pictures of even light. ``--picture``: maps of the error of Cp at the last point of the last seed.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from _paint_scores import Score, photon_limit
from windmark import io
from windmark.app.deform_pictures import Maps, maps_picture
from windmark.app.pictures import png
from windmark.errors import DataError, WindmarkError
from windmark.geometry import Pose
from windmark.pipeline.psp import PspTest, load_psp, read_psp_project
from windmark.pipeline.psp.pictures import Taken, said
from windmark.pipeline.psp.point import (
    WIND_OFF,
    WIND_ON,
    Found,
    point_task,
    read_pictures,
    sampling_of,
    the_model_in,
)
from windmark.pipeline.simulate_psp import simulate_psp
from windmark.resection import warp_image
from windmark.scene import Mesh
from windmark.tasks.align2d import align_images
from windmark.tasks.align2d.align import unfolded
from windmark.tasks.psp import ModelPicture, ratio_of, reduce_point

KINDS = {"2D first order": "affine", "2D second order": "poly2", "2D third order": "poly3"}
WAYS = ("no alignment", *KINDS, "3D rigid", "3D with deformation")
Raw = Mapping[str, Sequence[Taken]]


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


def placed(way: str, test: PspTest, found: Mapping[str, Found], raw: Mapping[str, Raw]) -> list[ModelPicture]:
    """The wind-on pictures with the grid where a way has it."""
    on, off = found[WIND_ON], found[WIND_OFF]
    first = {p.camera: p for p in reversed(off.pictures)}
    if way == "3D with deformation":
        return list(on.pictures)
    if way == "no alignment":
        return [replace(p, mesh=first[p.camera].mesh, moves=first[p.camera].moves) for p in on.pictures]
    if way in KINDS:
        return [recomputed(KINDS[way], p, first[p.camera], raw) for p in on.pictures]
    whole, order = as_a_whole(test, on), list(dict.fromkeys(id(p.mesh) for p in on.pictures))
    return [replace(p, mesh=whole[order.index(id(p.mesh))]) for p in on.pictures]


def recomputed(kind: str, picture: ModelPicture, still: ModelPicture, raw: Mapping[str, Raw]) -> ModelPicture:
    """A wind-on picture on the first wind-off one of its camera, by the markers of both."""
    camera = picture.camera
    image = next(p.image for p in raw[WIND_ON][camera] if said(WIND_ON, camera, p) == picture.name)
    found = align_images(image, next(p.image for p in raw[WIND_OFF][camera] if not p.why), kind=kind)
    if not found:
        raise DataError(f"{picture.name}: {found.reason}")
    place = unfolded(found.transform, found.reference_xy)
    light, variance = (warp_image(v, place, picture.lens.size_px) for v in (picture.light, picture.variance))
    return replace(picture, light=light.astype(float), variance=variance, mesh=still.mesh, moves=still.moves)


def run(
    seed: int, incidences: int, taps: int, flats: int, scores: dict[str, Score]
) -> tuple[PspTest, dict[str, np.ndarray]]:
    """A polar by all ways; the test, and the errors of Cp at its last point."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        simulate_psp(folder, seed, incidences)
        if taps:
            few_taps(folder / "tap-pressures.csv", taps, seed)
        for file in folder.glob("calibration/flat-*.tif"):
            if int(file.stem.rsplit("-", 1)[1]) >= flats:
                file.unlink()
        test = load_psp(read_psp_project(folder / "psp.toml"))
        for row in test.rows:
            truth = io.read_nodes_netcdf(folder / "truth" / f"{row.name}.nc")[1]
            raw = {kind: read_pictures(test, kind, pattern)
                   for kind, pattern in ((WIND_ON, row.on), (WIND_OFF, row.off))}  # fmt: skip
            found = {kind: the_model_in(test, kind, pictures) for kind, pictures in raw.items()}
            mesh = found[WIND_ON].states[0].mesh(test.mesh, frame="model")
            limit = photon_limit(test, found)
            task, errors = point_task(test, row, row.conditions()), dict[str, np.ndarray]()
            for way, score in scores.items():
                try:
                    pictures = placed(way, test, found, raw)
                    ratio = ratio_of(pictures, found[WIND_OFF].pictures, how=sampling_of(test), lamps=test.lamps)
                    reduced = reduce_point(ratio, test.mesh, mesh, task)
                    score.add(test, reduced, truth, row, limit)
                    errors[way] = reduced.cp.value - truth["cp"]
                except WindmarkError as error:
                    score.failed.append(f"seed {seed}, {row.name}: {error}")
            print(f"seed {seed}, {row.name} done", flush=True)
    return test, errors


def few_taps(table: Path, count: int, seed: int) -> None:
    """Leave readings of ``count`` taps of the upper side, which cameras show."""
    head, *rows = table.read_text().splitlines()
    names = sorted({row.split(",")[1] for row in rows if row.split(",")[1].startswith("U")})
    kept = set(np.random.default_rng([seed, 91]).permutation(names)[:count].tolist())
    table.write_text("\n".join([head, *(row for row in rows if row.split(",")[1] in kept)]) + "\n")


def main() -> None:
    """Run, print the table, write the JSON and the picture."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, nargs="+", default=[101, 102])
    parser.add_argument("--incidences", type=int, default=5)
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=list(WAYS))
    parser.add_argument("--taps", type=int, default=20, help="0: all")
    parser.add_argument("--flats", type=int, default=16, help="pictures of even light of each camera, at most 16")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    scores = {way: Score() for way in options.ways}
    for seed in options.seeds:
        test, errors = run(seed, options.incidences, options.taps, options.flats, scores)
    records = {way: score.record() for way, score in scores.items()}
    for way, r in records.items():
        print(f"{way}: {json.dumps(r, indent=1)}")
    if options.json:
        options.json.write_text(json.dumps(records, indent=1) + "\n")
    if options.picture:
        maps = [Maps(errors, "error of Cp", diverging=True)]
        figure = maps_picture(test.mesh, maps, direction=[0.0, 0.0, -1.0], up=[0.0, 1.0, 0.0])
        options.picture.write_bytes(png(figure))


if __name__ == "__main__":
    main()
