"""Grids and results: seconds to read and write 300,000 nodes, beside VTK's and NumPy's own ways, in one run.

The grid is made here: 14 blocks with as many nodes as NASA's open test grid. The best of several runs counts.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from windmark import io
from windmark.io.structured import structured_mesh, zone_names
from windmark.scene import Block, Mesh

SHAPES = [(21, 41, 1), (21, 41, 1), (41, 41, 1), (41, 21, 1), (241, 201, 1), (21, 81, 1), (21, 81, 1), (481, 201, 1)]
SHAPES += [(3, 201, 1), (3, 201, 1), (741, 3, 1), (741, 3, 1), (741, 201, 1), (1, 41, 41)]


def main(quick: bool = False) -> dict[str, float]:
    """Measure, print one table, return its numbers (seconds, megabytes as named)."""
    results: dict[str, float] = {}
    mesh = grid(SHAPES[:5] if quick else SHAPES)
    rng = np.random.default_rng(0)
    cp = np.where(rng.random(len(mesh.vertices)) < 0.2, np.nan, rng.normal(size=len(mesh.vertices))).astype(np.float32)
    fields = {"cp": cp, "obliquity": rng.uniform(0, 90, len(cp)).astype(np.float32)}
    results["nodes"] = len(mesh.vertices)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        repeat = 2 if quick else 5
        _results(results, place, mesh, fields, repeat)
        _meshes(results, place, mesh, repeat)
        _peers(results, place, mesh, fields, repeat)
    print("\ngrids and results                                    value")
    for name, value in results.items():
        print(f"{name:<50} {value:10.4g}")
    return results


def grid(shapes: list[tuple[int, int, int]]) -> Mesh:
    """Wavy patches in single precision."""
    blocks, parts, first = [], [], 0
    for k, (name, shape) in enumerate(zip(zone_names(len(shapes)), shapes, strict=True)):
        blocks.append(Block(name, shape, first))
        first += blocks[-1].size
        n_fast, n_slow = (n for n in shape if n > 1)
        u, v = (c.ravel() for c in np.meshgrid(np.arange(n_fast), np.arange(n_slow), indexing="xy"))
        parts.append(np.stack([0.05 * u + 40 * k, 0.05 * v, np.sin(0.02 * u) + 0.1 * np.cos(0.05 * v)], axis=1))
    return structured_mesh(np.concatenate(parts).astype(np.float32).astype(float), tuple(blocks))


def best(call: Callable[[], object], repeat: int) -> float:
    """Shortest of several runs, in seconds."""
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def _results(results: dict[str, float], place: Path, mesh: Mesh, fields: dict, repeat: int) -> None:
    writers = {
        "PLOT3D function": ("a.f", io.write_plot3d_function),
        "Tecplot ASCII": ("a.dat", io.write_tecplot),
        "VTK .vtp": ("a.vtp", io.write_nodes_vtk),
        "VTK .vtm": ("a.vtm", io.write_nodes_vtk),
        "NetCDF": ("a.nc", io.write_nodes_netcdf),
        "CSV": ("a.csv", io.write_nodes_csv),
    }
    for name, (file, writer) in writers.items():
        results[f"write {name} [s]"] = best(lambda w=writer, f=file: w(place / f, mesh, fields), repeat)
        if file != "a.vtm":
            results[f"  size of {name} [MB]"] = (place / file).stat().st_size / 1e6
    parts = [results[f"write {name} [s]"] for name in ("PLOT3D function", "Tecplot ASCII", "VTK .vtp")]
    results["write PLOT3D + Tecplot + .vtp together [s]"] = sum(parts)
    results["read Tecplot ASCII [s]"] = best(lambda: io.read_tecplot(place / "a.dat"), repeat)
    results["read NetCDF [s]"] = best(lambda: io.read_nodes_netcdf(place / "a.nc"), repeat)


def _meshes(results: dict[str, float], place: Path, mesh: Mesh, repeat: int) -> None:
    for suffix in (".grid", ".vtp", ".vtm", ".stl", ".ply", ".obj", ".tri"):
        path = place / f"mesh{suffix}"
        results[f"write_mesh {suffix} [s]"] = best(lambda p=path: io.write_mesh(p, mesh), repeat)
        results[f"read_mesh {suffix} [s]"] = best(lambda p=path: io.read_mesh(p), repeat)
    io.write_plot3d(place / "text.grid", mesh, layout=io.Plot3dLayout(text=True))
    results["read_mesh PLOT3D as text [s]"] = best(lambda: io.read_mesh(place / "text.grid"), repeat)


def _peers(results: dict[str, float], place: Path, mesh: Mesh, fields: dict, repeat: int) -> None:
    """The same through VTK's PLOT3D reader (which must be told the layout) and numpy.savetxt."""
    import pyvista

    def read() -> object:
        reader = pyvista.MultiBlockPlot3DReader(str(place / "mesh.grid"))
        reader.auto_detect_format = True
        return reader.read()

    read()
    results["VTK's PLOT3D reader, blocks only [s]"] = best(read, repeat)
    table = np.column_stack([mesh.vertices, *fields.values()])
    results["numpy.savetxt of the five columns [s]"] = best(lambda: np.savetxt(place / "t.dat", table, "%.9g"), 1)


if __name__ == "__main__":
    import sys

    main("--quick" in sys.argv)
