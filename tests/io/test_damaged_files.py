"""Damaged files of every format: some changed ones of each; ten thousand of each are in benchmarks/fuzz.py."""

from __future__ import annotations

import logging
import sys
import warnings
from pathlib import Path

import pytest

from windmark import io

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from _fuzz_files import seeds
from fuzz import put, reader_of

RECORDINGS = ("tiff", "mraw", "cine", "spe", "hdf5", "netcdf3", "table", "picture", "fits")
GRIDS = ("plot3d", "function", "tecplot", "stl", "obj", "ply", "cart3d", "vtp", "vtu", "vtk", "vts", "vtm", "netcdf")
TABLES = ("markers", "detections", "matches", "modes", "points", "mask", "image", "camera", "colmap", "rig", "project")
COUNT = 30


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return seeds(tmp_path_factory.mktemp("seeds"))


@pytest.mark.parametrize("kind", [*RECORDINGS, *GRIDS, *TABLES])
def test_damage_gives_a_sentence_or_content(files, tmp_path, kind):
    if kind not in files:
        pytest.skip("the library of this format is absent")
    read, refused = reader_of(kind), []
    logging.disable(logging.CRITICAL)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for seed in range(COUNT):
            try:
                read(put(files[kind], files[kind][0].parent, tmp_path, seed))
            except io.FileError as error:
                refused.append(error)
    logging.disable(logging.NOTSET)
    assert COUNT // 8 < len(refused) < COUNT
    assert not [e for e in refused if "\n" in str(e) or len(str(e)) > 2000 or isinstance(e.__cause__, MemoryError)]
