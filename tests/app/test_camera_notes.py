"""A camera of another program whose lens had to be refitted: every verb that reads it says so, in one line."""

import numpy as np
import pytest

from windmark import io
from windmark.geometry import Camera
from windmark.scene import MarkerSet

SAID = "lens refitted from a backward model: RMS"


@pytest.fixture
def folder(tmp_path):
    """A backward camera (Australis), an empty picture, markers, and a table of too few matches."""
    io.write_camera(tmp_path / "c.json", Camera((200, 160), 300.0, k1=-0.05))
    rng = np.random.default_rng(2)
    io.write_markers(tmp_path / "m.csv", MarkerSet.make([f"m{k}" for k in range(12)], rng.uniform(0, 100, (12, 3))))
    for name in ("a", "b"):
        io.write_image(tmp_path / f"{name}.png", np.full((160, 200), 90, np.uint8))
    (tmp_path / "t.csv").write_text("image,name,x,y\na,m1,10,20\n")
    return tmp_path


@pytest.mark.parametrize(
    "verb",
    [
        ("register", "a.png", "-m", "m.csv", "-r", "3"),
        ("track", "a.png", "b.png", "-m", "m.csv", "-r", "3", "-o", "out"),
        ("calibrate", "t.csv", "-m", "m.csv", "--datum", "free", "-o", "out"),
    ],
    ids=lambda verb: verb[0],
)
def test_a_refitted_lens_is_said(windmark, folder, monkeypatch, verb):
    monkeypatch.chdir(folder)
    assert windmark("convert", "c.json", "c.txt", "--no-pose", "--pixel-mm", "0.01").code == 0
    done = windmark(*verb, "-c", "c.txt", "--unit", "mm")
    assert done.code == 1  # nothing to be seen
    assert done.err.count(SAID) == 1
    assert "c.txt: " in done.err
    plain = windmark(*verb, "-c", "c.json", "--unit", "mm")
    assert SAID not in plain.err
