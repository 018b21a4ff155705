"""Small valid files of every format that windmark reads, made by its own writers where it has one."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "io"))


def seeds(folder: Path) -> dict[str, list[Path]]:
    """Format -> files; those of a format that belong together are changed one at a time."""
    return recordings(folder) | grids(folder) | tables(folder) | cameras(folder) | settings(folder)


def _maker(folder: Path, made: dict[str, list[Path]]) -> Callable[[str, str], Path]:
    def at(name: str, kind: str) -> Path:
        path = folder / kind / name
        path.parent.mkdir(exist_ok=True)
        made.setdefault(kind, []).append(path)
        return path

    return at


def grids(folder: Path) -> dict[str, list[Path]]:
    """Surface grids with values at their nodes, where the format has a place for them."""
    import pyvista as pv
    from small_meshes import blocks_mesh, shell_mesh

    from windmark import io
    from windmark.io.plot3d import write_plot3d
    from windmark.io.plot3d_layout import Plot3dLayout

    made: dict[str, list[Path]] = {}
    at = _maker(folder, made)
    blocks, shell = blocks_mesh([(5, 4, 1), (1, 6, 3)], blanked=True), shell_mesh()
    fields = {
        "cp": np.sin(np.arange(len(blocks.vertices))).astype(np.float32),
        "p": np.arange(len(blocks.vertices)) * 1.5,
    }
    of_shell = {"cp": np.cos(np.arange(len(shell.vertices)))}
    units = {"p": "Pa", "length": "mm"}
    layouts = (
        {}, {"text": True}, {"record_mark": 0, "real_bytes": 8}, {"byte_order": ">", "record_mark": 8, "iblank": True},
        {"records": "plane"}, {"records": "component", "iblank": True}, {"text": True, "iblank": True},
    )  # fmt: skip
    for k, layout in enumerate(layouts):
        grid = blocks if layout.get("iblank") else replace(blocks, blanked=None)
        write_plot3d(at(f"{k}.xyz", "plot3d"), grid, layout=Plot3dLayout(**layout))
        whole = Plot3dLayout(**{**layout, "iblank": False, "records": "whole"})
        io.write_plot3d_function(at(f"{k}.f", "function"), blocks, fields, layout=whole)
        made["function"].append(folder / "function" / f"{k}.nam")
    io.write_tecplot(at("a.dat", "tecplot"), blocks, fields, units=units)
    io.write_tecplot(at("b.dat", "tecplot"), shell, of_shell)
    io.write_mesh(at("a.stl", "stl"), shell)
    pv.Cylinder(resolution=5).triangulate().save(at("b.stl", "stl"), binary=False)
    io.write_mesh(at("a.obj", "obj"), shell, length_unit="mm")
    io.write_mesh(at("a.ply", "ply"), shell)
    cylinder = pv.Cylinder(resolution=7).clean()
    cylinder["p"] = np.arange(cylinder.n_points, dtype=float)
    for name, binary in (("b.ply", True), ("c.ply", False)):
        cylinder.save(at(name, "ply"), binary=binary)
    io.write_mesh(at("a.tri", "cart3d"), shell)
    _cart3d_records(at("b.tri", "cart3d"), shell)
    for suffix in ("vtp", "vtu", "vtk"):
        io.write_nodes_vtk(at(f"a.{suffix}", suffix), blocks, fields, units=units)
        io.write_nodes_vtk(at(f"b.{suffix}", suffix), shell, of_shell)
    solid = pv.ImageData(dimensions=(4, 3, 3)).cast_to_unstructured_grid()
    sheet = pv.StructuredGrid(*np.meshgrid(np.arange(4.0), np.arange(3.0), [0.5], indexing="ij"))
    for suffix, surface in (("vtp", cylinder), ("vtu", solid), ("vtk", cylinder), ("vtk", solid), ("vts", sheet)):
        for binary in (True, False):
            surface.save(at(f"{'cd'[binary]}{surface.n_points}.{suffix}", suffix), binary=binary)
    io.write_nodes_vtk(at("a.vtm", "vtm"), blocks, fields)
    made["vtm"] += sorted((folder / "vtm").rglob("*.vt[sp]"))
    io.write_nodes_netcdf(at("a.nc", "netcdf"), blocks, fields, units=units, history={"options": {"a": 1}})
    io.write_nodes_netcdf(at("b.nc", "netcdf"), shell, of_shell)
    return made


def _cart3d_records(path: Path, mesh) -> None:
    def record(values) -> bytes:
        size = np.array([values.nbytes], ">i4").tobytes()
        return size + values.tobytes() + size

    counts = np.array([len(mesh.vertices), len(mesh.triangles)], ">i4")
    path.write_bytes(record(counts) + record(mesh.vertices.astype(">f4")) + record((mesh.triangles + 1).astype(">i4")))


def tables(folder: Path) -> dict[str, list[Path]]:
    """Markers, detections, matches, modes, points, masks."""
    from windmark import io
    from windmark.scene import Detections, MarkerSet

    made: dict[str, list[Path]] = {}
    at = _maker(folder, made)
    rng = np.random.default_rng(1)
    names = [f"m{k}" for k in range(12)]
    role = ["model"] * 8 + ["tap"] * 2 + ["wall"] * 2
    markers = MarkerSet.make(
        names, rng.normal(size=(12, 3)), radius=np.full(12, 2.5), normal=rng.normal(size=(12, 3)),
        volume=["wing"] * 6 + ["body"] * 6, role=role, sigma=np.full((12, 3), 0.1),
    )  # fmt: skip
    io.write_markers(at("a.csv", "markers"), markers, length_unit="mm")
    io.write_tgts(at("a.tgts", "markers"), markers, length_unit="mm")
    spots = Detections.make(rng.uniform(0, 500, (12, 2)), cov=np.tile(np.eye(2) * 0.01, (12, 1, 1)))
    io.write_detections(at("a.csv", "detections"), {"one": spots, "two": spots})
    io.write_detections(at("b.csv", "detections"), spots, names={"": names})
    rows = "".join(f"one,{n},{k}.5,{k},0.1,-0.2,0.22\n" for k, n in enumerate(names))
    at("a.csv", "matches").write_text(f"image,name,x,y,dx,dy,distance_px\n{rows}")
    at("a.csv", "modes").write_text("x,y,z,dx_1,dy_1,dz_1,dx_2,dy_2,dz_2\n" + "1,2,3,.1,.2,.3,4,5,6e-1\n" * 6)
    at("a.csv", "points").write_text("name,x,y,z,nx,ny,nz,volume\n" + "".join(f"{n},1,2,3,0,0,1,wing\n" for n in names))
    at("a.csv", "mask").write_text("polygon,x,y\na,1,1\na,30,2\na,9,17\nb,3,4\nb,8,8\nb,2,9\n")
    io.write_image(at("b.png", "mask"), rng.random((20, 32)) > 0.5)
    for name, image in (
        ("a.tif", rng.random((20, 32))),
        ("b.tif", rng.integers(0, 4096, (20, 32, 3), dtype=np.uint16)),
    ):
        io.write_image(at(name, "image"), image, description="levels")
    io.write_image(at("c.jpg", "image"), rng.integers(0, 255, (20, 32, 3), dtype=np.uint8))
    _packed_tiffs(at, rng)
    return made


def _packed_tiffs(at, rng: np.random.Generator) -> None:
    """Compressions, palettes, tiles and depths that tifffile or Pillow decode."""
    import tifffile
    from PIL import Image

    grey = rng.integers(0, 255, (20, 32), dtype=np.uint8)
    for k, how in enumerate(("tiff_lzw", "packbits", "tiff_adobe_deflate", "group4")):
        Image.fromarray(grey > 99 if how == "group4" else grey).save(at(f"p{k}.tif", "image"), compression=how)
    Image.fromarray(grey).convert("P").save(at("q.tif", "image"))
    tifffile.imwrite(at("r.tif", "image"), np.resize(grey, (40, 64)), tile=(16, 16), compression="zlib", predictor=True)
    tifffile.imwrite(at("s.tif", "image"), grey, photometric="miniswhite")


def cameras(folder: Path) -> dict[str, list[Path]]:
    """Camera files of every program, and where the cameras of a rig are."""
    from windmark import io
    from windmark.geometry import Camera, Pose

    made: dict[str, list[Path]] = {}
    at = _maker(folder, made)
    camera = Camera((1280, 800), 1370.4, 1.0001, 643.8, 373.8, k1=-0.08, k2=0.011, p1=1e-4, p2=-2e-4, k3=1e-3)
    pose = Pose.from_rotvec([0.1, -0.9, 0.3], [3.8, 0.52, 11.5])
    for name in ("a.json", "a.yml", "a.cameramodel"):
        io.write_camera(at(name, "camera"), camera, pose, unit="mm")
    io.write_camera(at("b.json", "camera"), camera, format="opencv")
    io.write_camera(at("b.xml", "camera"), camera)
    io.write_camera(at("b.txt", "camera"), camera, pixel_mm=0.0055)
    matrix, lens = [[1370.4, 0, 3.8], [0, 1370.4, -2.2], [0, 0, 1]], [[-0.08, 0.01, 0, 0, 0]]
    nasa = {"uPSP_cameraMatrix": matrix, "distCoeffs": lens, "rmat": np.eye(3).tolist(), "tvec": [1, 2, 3],
            "sensor_resolution": [800, 1280], "sensor_size": [0.4, 0.6]}  # fmt: skip
    io.write_json(at("n.json", "camera"), nasa)
    io.write_colmap(folder / "colmap", {1: camera}, {"image": (1, pose)}, unit="mm")
    made["colmap"] = sorted((folder / "colmap").iterdir())
    cov = {"left": np.eye(6) * 1e-6}
    io.write_rig(at("rig.json", "rig"), {"left": pose, "right": pose}, unit="mm", cov=cov)
    return made


PROJECT = """title = "fuzz"
length_unit = "mm"
[[camera]]
name = "left"
file = "left.json"
[[image]]
name = "on"
file = "on.tif"
camera = "left"
[markers]
file = "markers.csv"
[grid]
file = "grid.xyz"
volumes = { wing = ["zone01", "zone02"] }
[detect]
radius_px = [2.0, 6.0]
[[section]]
name = "root"
point = [0.0, 1.0, 2.0]
normal = [0, 1, 0]
[output]
folder = "results"
nodes = ["vtk", "csv"]
"""


def settings(folder: Path) -> dict[str, list[Path]]:
    """A project beside the files that it names, which are empty: nothing opens them."""
    made: dict[str, list[Path]] = {}
    at = _maker(folder, made)
    project = at("a.toml", "project")
    project.write_text(PROJECT)
    for name in ("left.json", "on.tif", "markers.csv", "grid.xyz"):
        (project.parent / name).touch()
    return made


def recordings(folder: Path) -> dict[str, list[Path]]:
    """Small recordings of every format."""
    import h5py
    import tifffile
    from camera_files import write_cine, write_mraw, write_spe, write_spe3
    from scipy.io import netcdf_file

    rng = np.random.default_rng(0)
    stack = rng.integers(0, 4096, (4, 8, 12), dtype=np.uint16)
    eight = (stack >> 4).astype(np.uint8)
    made: dict[str, list[Path]] = {}

    def at(name: str, kind: str) -> Path:
        path = folder / kind / name
        path.parent.mkdir(exist_ok=True)
        made.setdefault(kind, []).append(path)
        return path

    for name, options in (("a", {}), ("b", {"compression": "zlib"}), ("c", {"bigtiff": True}), ("d", {"imagej": True})):
        tifffile.imwrite(at(f"{name}.tif", "tiff"), stack, photometric="minisblack", **options)
    for stored in (8, 10, 12, 16):
        header = write_mraw(at(f"r{stored}.mraw", "mraw"), list(stack >> (12 - min(stored, 12))), stored)
        made["mraw"].append(header)
    made["mraw"].append(write_mraw(at("x.mraw", "mraw"), list(stack), 12, xml=True))
    write_cine(at("a.cine", "cine"), list(eight), 8, times=1e9 + np.arange(4), trigger_s=1e9)
    write_cine(at("b.cine", "cine"), list(stack), 16, packing=256, rate=100)
    write_cine(at("c.cine", "cine"), list(stack), 16, packing=1024, cfa=3)
    write_spe(at("a.spe", "spe"), list(stack))
    write_spe3(at("b.spe", "spe"), list(stack), range(4))
    with h5py.File(at("a.h5", "hdf5"), "w") as file:
        file["cam/images"], file["cam/time_s"] = stack, np.arange(4.0)
    with h5py.File(at("b.h5", "hdf5"), "w") as file:
        file.create_dataset("images", data=stack, chunks=(1, 8, 12), compression="gzip", shuffle=True)
    with netcdf_file(at("a.nc", "netcdf3"), "w") as file:
        for name, size in zip("tyx", stack.shape, strict=True):
            file.createDimension(name, size)
        file.createVariable("t", "d", ("t",))[:] = np.arange(4.0)
        file.createVariable("image", "h", ("t", "y", "x"))[:] = stack
    (at("a.csv", "table")).write_text("x;1\n" + "\n".join(";".join(f"{v},5" for v in r) for r in stack[0]))
    _more(at, stack, eight)
    return made


def _more(at, stack, eight) -> None:
    """Formats of the extras, and single pictures."""
    from PIL import Image

    for name in ("a.png", "b.jpg", "c.bmp"):
        Image.fromarray(eight[0]).save(at(name, "picture"))
    Image.fromarray(stack[0]).save(at("d.png", "picture"))
    try:
        from astropy.io import fits

        fits.PrimaryHDU(stack).writeto(at("a.fits", "fits"))
        fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(stack)]).writeto(at("b.fits", "fits"))
    except ModuleNotFoundError:
        print("astropy is absent: FITS is left out")
    try:
        import av
    except ModuleNotFoundError:
        print("av is absent: films are left out")
        return
    for name, codec, kind in (
        ("a.avi", "ffv1", "gray16le"), ("b.mp4", "mpeg4", "yuv420p"), ("c.avi", "mjpeg", "yuvj420p"),
        ("d.avi", "rawvideo", "gray"), ("e.mov", "png", "gray"),
    ):  # fmt: skip
        with av.open(str(at(name, "video")), "w") as out:
            stream = out.add_stream(codec, rate=50)
            stream.width, stream.height, stream.pix_fmt = 32, 16, kind
            for k in range(4):
                values = np.resize(stack[k] if kind == "gray16le" else eight[k], (16, 32))
                frame = av.VideoFrame.from_ndarray(values, format="gray16le" if kind == "gray16le" else "gray")
                out.mux(stream.encode(frame.reformat(format=kind)))
            out.mux(stream.encode())
