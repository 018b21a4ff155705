"""`windmark laws` as a user runs it."""

import numpy as np
import pytest
from PIL import Image

from windmark.app import laws_verb
from windmark.app.laws_examples import example, wing_points
from windmark.app.laws_pictures import amount
from windmark.deformation.laws import CATALOG

OWN = '''import numpy as np
from windmark.deformation import law

@law(tip="mm", twist="deg")
def wing(xyz, tip, twist, *, root=72.0, span=600.0):
    """Parabolic bending, linear twist."""
    e = np.clip((xyz[:, 1] - root) / (span - root), 0, None)
    angle = np.radians(twist) * e
    out = xyz.copy()
    out[:, 2] += tip * e**2 - np.sin(angle) * (xyz[:, 0] - 123 - 0.45 * xyz[:, 1])
    return out
'''
MARKERS = (
    "name,x,y,z,volume,role\na,200,100,10,wing,model\nb,300,500,30,wing,model\nc,0,0,70,body,model\nw,0,0,-400,,wall\n"
)


def test_built_in_laws_are_listed_with_options_and_units(windmark):
    done = windmark("laws")
    assert done.code == 0
    for kind, entry in CATALOG.items():
        assert f"{kind}: {entry.line}" in done.out
    assert "option bend: a list of whole numbers; powers of the bending [default [2, 3]]" in done.out
    assert "option root: three numbers x, y, z; where the elastic axis meets the clamped section [required]" in done.out
    assert "parameters: bend_2 (mm), bend_3 (mm), twist_1 (deg), twist_2 (deg), sway_2 (mm)" in done.out


def test_json_and_pictures(windmark, tmp_path, monkeypatch):
    monkeypatch.setattr(laws_verb, "CATALOG", {kind: CATALOG[kind] for kind in ("hinge", "beam")})
    done = windmark("laws", "--pictures", tmp_path / "new" / "laws", "--json")
    assert done.code == 0
    assert [law["name"] for law in done.json["laws"]] == ["hinge", "beam"]
    beam = done.json["laws"][1]
    assert {o["name"]: o["required"] for o in beam["options"]}["root"] is True
    assert beam["parameters"][0]["unit"] == "mm"
    assert {*done.json["pictures"], "manifest.json"} == {p.name for p in (tmp_path / "new" / "laws").iterdir()}
    for name in done.json["pictures"]:
        with Image.open(tmp_path / "new" / "laws" / name) as picture:
            shades = np.asarray(picture.convert("RGB")).reshape(-1, 3).astype(int)
        blue = (shades[:, 2] - shades[:, 0] > 100).mean()
        assert 0.002 < blue < 0.2, name


def test_a_panel_moves_the_model_visibly_but_not_too_far():
    for kind in CATALOG:
        shown = example(kind)
        points = np.concatenate(shown.moving)
        size = np.linalg.norm(shown.law.bind(points).linearise(np.zeros(len(shown.law.parameters)))[1], axis=1).max(0)
        for parameter, one in zip(shown.law.parameters[:6], size, strict=False):
            assert 15 < amount(parameter, one) * one <= 75 or parameter.unit == "deg"


def test_a_file_of_ones_own_is_checked(windmark, tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "markers.csv").write_text(MARKERS)
    done = windmark("laws", tmp_path / "own.py")
    assert done.code == 0
    assert f"checked on {len(wing_points())} points of a half wing" in done.out
    assert "wing: Parabolic bending, linear twist." in done.out
    assert "option root: float [default 72]" in done.out
    assert "parameters: tip (mm), twist (deg)" in done.out
    assert "sound" in done.out
    done = windmark("laws", tmp_path / "own.py", "-m", tmp_path / "markers.csv", "--volume", "body", "--json")
    assert done.code == 0
    assert done.json["points"] == 1
    assert [r.rsplit(": ", 1)[1] for r in done.json["laws"][0]["remarks"]] == [
        "parameter tip moves none of the 1 points", "parameter twist moves none of the 1 points",
    ]  # fmt: skip
    done = windmark("laws", tmp_path / "own.py", "--pictures", tmp_path / "pictures", "--json")
    assert done.json["pictures"] == ["wing.png"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (OWN.replace("return out", "return out[:3]"), "own.py:4: law wing: must return (48, 3), like its points"),
        (OWN.replace("xyz.copy()", "xyz.copi()"), "own.py:9: AttributeError"),
        (OWN.replace("e**2 -", "e**2 +* -"), "own.py:10: invalid syntax"),
        (OWN.replace("tip * e**2", "tip * np.log(e - 1)"), "own.py:4: law wing: returns ["),
        ("x = 1\n", "own.py: holds no law"),
    ],
)
def test_a_broken_file_is_named_with_its_line(windmark, tmp_path, text, words):
    (tmp_path / "own.py").write_text(text)
    done = windmark("laws", tmp_path / "own.py")
    assert done.code == 2
    assert words in done.err
    assert "Traceback" not in done.err


def test_wrong_usage(windmark, tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "markers.csv").write_text(MARKERS)
    for arguments, words in (
        (["-m", tmp_path / "markers.csv"], "give it first"),
        ([tmp_path / "own.py", "--volume", "wing"], "--volume has no meaning without --markers"),
        ([tmp_path / "own.py", "-m", tmp_path / "markers.csv", "--volume", "fin"], "no marker of volume 'fin'; it has"),
        ([tmp_path / "none.py"], "no such file"),
    ):
        done = windmark("laws", *arguments)
        assert done.code == 2
        assert words in done.err
