"""Damaged recordings: thousands of changed files per format, and what becomes of each.

Seed files of every format are written small, then changed: bytes flipped, numbers grown, the file cut off, parts doubled
or blanked. Every changed file is opened and read in a child process whose memory is limited, so that a crash, a hang
(over 5 s) or an allocation that the file's bytes do not justify is counted instead of ending the benchmark. Good answers
are frames, or one sentence (`FileError`).

    python benchmarks/fuzz_frames.py --count 10000 [--formats cine,mraw] [--json fuzz.json]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing as mp
import os
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "io"))

HANG_S = 5.0
MEMORY_BYTES = 400 * 2**20
"""What a child may take on top of what it needs to start: seeds are some kilobytes."""


def seeds(folder: Path) -> dict[str, list[Path]]:
    """Small files of every format; those of several files are changed one at a time."""
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
        tifffile.imwrite(at(f"{name}.tif", "tiff"), stack, **options)
    for stored in (8, 10, 12, 16):
        made.setdefault("mraw", []).append(write_mraw(at(f"r{stored}.mraw", "mraw"), list(stack >> (12 - min(stored, 12))), stored))
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
    for name, codec, kind in (("a.avi", "ffv1", "gray16le"), ("b.mp4", "mpeg4", "yuv420p"), ("c.avi", "mjpeg", "yuvj420p"),
                              ("d.avi", "rawvideo", "gray"), ("e.mov", "png", "gray")):  # fmt: skip
        with av.open(str(at(name, "video")), "w") as out:
            stream = out.add_stream(codec, rate=50)
            stream.width, stream.height, stream.pix_fmt = 32, 16, kind
            for k in range(4):
                values = np.resize(stack[k] if kind == "gray16le" else eight[k], (16, 32))
                frame = av.VideoFrame.from_ndarray(values, format="gray16le" if kind == "gray16le" else "gray")
                out.mux(stream.encode(frame.reformat(format=kind)))
            out.mux(stream.encode())


def changed(data: bytes, rng: np.random.Generator) -> bytes:
    """One of the ways in which files are damaged."""
    values = bytearray(data)
    size = len(values)
    way = rng.integers(6)
    near = min(size, 4200) if rng.random() < 0.7 else size  # headers decide more than pixels
    if way == 0:
        return bytes(values[: rng.integers(size)])
    if way == 1:
        for place in rng.integers(near, size=rng.integers(1, 9)):
            values[place] ^= 1 << rng.integers(8)
    elif way == 2:
        for place in rng.integers(near, size=rng.integers(1, 4)):
            values[place] = (0, 255, 127, 128, 1, 10)[rng.integers(6)]
    elif way == 3:  # a number grown or emptied, wherever it may begin
        place, width = int(rng.integers(near)), int(rng.choice([2, 4, 8]))
        values[place : place + width] = (b"\xff" * 8, b"\0" * 8, b"\xff\xff\xff\x7f" * 2, b"\0\0\0\x40" * 2)[
            rng.integers(4)
        ][:width]
    elif way == 4:
        a, b = sorted(int(k) for k in rng.integers(size, size=2))
        values[a:b] = values[a:b] * 2 if rng.random() < 0.5 else b""
    else:
        a = int(rng.integers(near))
        values[a : a + rng.integers(1, 64)] = rng.bytes(int(rng.integers(1, 64)))
    return bytes(values)


def child(files: list[str], first: int, count: int, folder: str, pipe) -> None:
    """Change, read, report: one letter for every file."""
    import resource
    import warnings

    warnings.simplefilter("error")
    from windmark import io

    content = {f: Path(f).read_bytes() for f in files}
    for f in files:  # imports and first use belong to the start
        with io.frames(f) as frames:
            frames[0]
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * os.sysconf("SC_PAGE_SIZE") + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # what libraries say of damage
    for k in range(first, first + count):
        rng = np.random.default_rng(k)
        name = files[rng.integers(len(files))]
        for f in files:  # companions as they were
            (Path(folder) / Path(f).name).write_bytes(content[f])
        place = Path(folder) / Path(name).name
        place.write_bytes(changed(content[name], rng))
        pipe.send((k, "start", ""))
        try:
            with io.frames(place) as frames:
                for number in sorted({0, len(frames) // 2, len(frames) - 1}):
                    frames[number]
                frames.time_s, frames.note, frames.name(0)
            pipe.send((k, "read", ""))
        except io.FileError as error:
            memory = isinstance(error.__cause__, MemoryError)
            pipe.send((k, "memory" if memory else "refused", str(error) if memory or "\n" in str(error) else ""))
        except BaseException as error:
            pipe.send((k, "traceback", f"{type(error).__name__}: {error}"[:300]))


def fuzz(files: list[Path], count: int, seed: int = 0) -> tuple[Counter, list[tuple[int, str, str]]]:
    """Counts of what became of ``count`` changed files, and the bad ones."""
    context = mp.get_context("spawn")
    counts: Counter = Counter()
    bad: list[tuple[int, str, str]] = []
    at, end = seed, seed + count
    while at < end:
        with tempfile.TemporaryDirectory() as folder:
            mine, theirs = context.Pipe(duplex=False)
            process = context.Process(target=child, args=([str(f) for f in files], at, end - at, folder, theirs))
            process.start()
            theirs.close()
            at, outcome = _watched(process, mine, at, end, counts, bad)
            if outcome:
                counts[outcome] += 1
                bad.append((at, outcome, f"exit code {process.exitcode}"))
                at += 1
    return counts, bad


def _watched(process, pipe, at: int, end: int, counts: Counter, bad: list) -> tuple[int, str]:
    """Follow a child until it is done, dies or hangs; the file at hand, and what was wrong with it."""
    started = False
    while at < end:
        if not pipe.poll(HANG_S if started else 120):
            process.kill()
            process.join()
            return at, "hang"
        try:
            k, word, text = pipe.recv()
        except EOFError:
            process.join()
            return at, "crash"
        started = True
        if word == "start":
            at = k
            continue
        counts[word] += 1
        if text:
            bad.append((k, word, text))
        at = k + 1
    process.join()
    return at, ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--formats", default="")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    table, wrong = {}, 0
    print(f"{'format':10} {'files':>7} {'read':>7} {'refused':>8} {'traceback':>10} {'memory':>7} {'hang':>5} {'crash':>6} {'s':>6}")
    with tempfile.TemporaryDirectory() as folder:
        for kind, files in seeds(Path(folder)).items():
            if asked.formats and kind not in asked.formats.split(","):
                continue
            start = time.perf_counter()
            counts, bad = fuzz(files, asked.count, asked.seed)
            row = {n: counts[n] for n in ("read", "refused", "traceback", "memory", "hang", "crash")}
            table[kind] = {**row, "bad": bad[:50]}
            print(f"{kind:10} {asked.count:7d} {row['read']:7d} {row['refused']:8d} {row['traceback']:10d} {row['memory']:7d}"
                  f" {row['hang']:5d} {row['crash']:6d} {time.perf_counter() - start:6.0f}", flush=True)  # fmt: skip
            for item in bad[:8]:
                print("   ", *item)
            wrong += len(bad)
    if asked.json:
        asked.json.write_text(json.dumps(table, indent=1))
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
