"""Damaged recordings: a few hundred changed files per format; ten thousand are in benchmarks/fuzz_frames.py."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

import numpy as np
import pytest

from windmark import io

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from fuzz_frames import changed, seeds

KINDS = ("tiff", "mraw", "cine", "spe", "netcdf3", "table", "picture", "fits")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return seeds(tmp_path_factory.mktemp("seeds"))


@pytest.mark.parametrize("kind", KINDS)
def test_damage_gives_a_sentence_or_frames(files, tmp_path, kind):
    logging.disable(logging.CRITICAL)
    if kind not in files:
        pytest.skip("the library of this format is absent")
    refused: list[io.FileError] = []
    for seed in range(150):
        rng = np.random.default_rng([seed, 77])
        name = files[kind][rng.integers(len(files[kind]))]
        for path in files[kind]:
            (tmp_path / path.name).write_bytes(path.read_bytes())
        (tmp_path / name.name).write_bytes(changed(name.read_bytes(), rng))
        try:
            with io.frames(tmp_path / name.name) as frames:
                frames[len(frames) - 1]
        except io.FileError as error:
            refused.append(error)
    logging.disable(logging.NOTSET)
    assert 30 < len(refused) < 140
    assert not [e for e in refused if "\n" in str(e) or isinstance(e.__cause__, MemoryError)]
