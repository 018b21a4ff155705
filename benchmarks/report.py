"""The main job's report: its size and the time it takes beyond the reduction, for one picture and for hundreds.

NASA's plate (309,062 nodes; `../shared/data/nasa-upsp-cam5`) where it is at hand, else a synthetic surface of as many.
More pictures are the same one with fresh noise, so that nothing of them is alike to a packer. Wanted: 3 MB for one
picture with value and sigma in 3D, 150 kB for each further one, 500 below 80 MB and within 60 s.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from windmark.app.run_report import run_report
from windmark.pipeline.clock import Clock
from windmark.pipeline.job import run_project
from windmark.pipeline.project import read_project
from windmark.pipeline.results import ImageResult, RunResult
from windmark.pipeline.simulate import simulate
from windmark.resection import node_values

EXAMPLE = Path(__file__).parents[1] / "examples" / "nasa-upsp-cam5.toml"
NOISE = 2.0
"""Grey levels of fresh noise."""


def main(quick: bool = False) -> dict[str, float]:
    """Measure, print one table, return its numbers (MB, kB, seconds as named)."""
    results: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        done = reduced(Path(folder))
        count = 0 if done.mesh is None else len(done.mesh.vertices)
        results["nodes"] = count
        for pictures in (1, 2, 12, 13, 40) if quick else (1, 2, 12, 13, 100, 500):
            result = several(done, pictures)
            wall, cpu, text = written(result, Path(folder) / f"report-{pictures}.html")
            results[f"{pictures} pictures, size [MB]"] = text / 1e6
            results[f"{pictures} pictures, beyond the reduction [s]"] = wall
            results[f"{pictures} pictures, beyond the reduction [CPU s]"] = cpu
        for pictures in (2, 12, 13):
            most = 3.0 + 0.15 * (pictures - 1)
            results[f"{pictures} pictures, below 3 MB + 150 kB for each further one by [MB]"] = (
                most - results[f"{pictures} pictures, size [MB]"]
            )
        for few, many in ((1, 2), (13, 40 if quick else 500)):
            more = results[f"{many} pictures, size [MB]"] - results[f"{few} pictures, size [MB]"]
            results[f"each further picture, {few} to {many} [kB]"] = 1e3 * more / (many - few)
    print("\nreport                                                                  value")
    for name, value in results.items():
        print(f"{name:<70} {value:10.4g}")
    return results


def reduced(folder: Path) -> RunResult:
    """A job of one picture, done."""
    given = {"output": {"folder": folder / "results"}}
    if EXAMPLE.exists():
        project = read_project(EXAMPLE, given)
        if all(entry.file.exists() for entry in project.image):
            return run_project(project)
    print("NASA's data are not at hand: the virtual wing instead", file=sys.stderr)
    simulate(folder, 1)
    result = run_project(read_project(folder / "project.toml", given))
    return replace(result, images=result.images[:1])


def several(done: RunResult, count: int) -> RunResult:
    """The first picture ``count`` times, each with noise of its own in its pixels and, so, its values."""
    first = done.images[0]
    images = tuple(noisy(first, done, k) for k in range(count))
    names = [entry.model_copy(update={"name": f"picture-{k:04d}"}) for k in range(count)
             for entry in done.project.image[:1]]  # fmt: skip
    return replace(done, images=images, project=done.project.model_copy(update={"image": tuple(names)}))


def noisy(item: ImageResult, done: RunResult, k: int) -> ImageResult:
    rng = np.random.default_rng(k)
    assert item.image is not None
    assert item.nodes is not None
    top = np.iinfo(item.image.dtype).max
    taken = np.clip(np.rint(item.image + NOISE * rng.standard_normal(item.image.shape)), 0, top)
    image = taken.astype(item.image.dtype)
    values = node_values(item.quantity.of(image), item.nodes, interpolation=done.project.resect.interpolation)
    return replace(item, name=f"picture-{k:04d}", image=image, values=values)


def written(result: RunResult, path: Path) -> tuple[float, float, int]:
    """Seconds by the clock and of the processor, and bytes."""
    wall, cpu = time.perf_counter(), time.process_time()
    page = run_report(result, Clock())
    path.write_text(page.html(), encoding="utf-8")
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    if page.failed:
        raise SystemExit(f"parts are missing: {page.failed[:3]}")
    return wall, cpu, path.stat().st_size


if __name__ == "__main__":
    found = main("--quick" in sys.argv)
    if "--json" in sys.argv:
        print(json.dumps(found))
