"""Laws from users' files: what works in a few lines, and how faults are told."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from windmark.deformation import LawError, check_law, laws_of_source, with_parameters
from windmark.deformation.laws import make_law

XYZ = np.random.default_rng(0).uniform(0, 600, (30, 3))

OWN = """import numpy as np
from windmark.deformation import law

@law(tip="mm", twist="deg")
def wing(xyz, tip, twist, *, root=72.0, span=600.0):
    e = np.clip((xyz[:, 1] - root) / (span - root), 0, None)
    angle = np.radians(twist) * e
    out = xyz.copy()
    out[:, 2] += tip * e**2 - np.sin(angle) * xyz[:, 0]
    return out
"""


def test_a_law_in_few_lines():
    assert len(OWN.splitlines()) <= 15
    laws = laws_of_source(OWN, "own.py")
    assert list(laws) == ["wing"]
    wing = laws["wing"]
    assert [(p.name, p.unit) for p in wing.parameters] == [("tip", "mm"), ("twist", "deg")]
    assert wing.source == "own.py:4"
    assert wing.name == "wing"
    assert check_law(wing, XYZ) == ()
    e = np.clip((XYZ[:, 1] - 72) / 528, 0, None)
    np.testing.assert_allclose(wing.bind(XYZ).place(np.array([5.0, 0]))[:, 2], XYZ[:, 2] + 5 * e**2)
    short = wing.with_options({"span": 300.0})
    assert check_law(short, XYZ) == ()
    assert short.bind(XYZ).place(np.array([5.0, 0]))[:, 2].max() > 10
    with pytest.raises(LawError, match=r"own\.py:4: law wing: has no option chord; it has root, span"):
        wing.with_options({"chord": 1})


def test_the_guide_s_laws_work():
    guide = (Path(__file__).parents[2] / "docs" / "guide.md").read_text(encoding="utf-8")
    section = guide[guide.index("### Laws") :]
    text = section.split("```python\n")[1].split("```")[0]
    assert len(text.splitlines()) <= 15
    (own,) = laws_of_source(text, "guide.md").values()
    assert check_law(own, XYZ) == ()
    for volume in tomllib.loads(section.split("```toml\n")[1].split("```")[0])["volume"]:
        law = with_parameters(make_law(volume["law"], volume["options"], unit="mm"), volume.get("parameters", {}))
        assert check_law(law, XYZ) == ()


def test_plain_functions_count_helpers_do_not():
    text = "def fin(xyz, tip):\n    return _up(xyz, tip)\n\ndef _up(xyz, tip):\n    return xyz + tip\n\n"
    text += "def other(a, b):\n    return a\n"
    assert list(laws_of_source(text, "own.py")) == ["fin"]


def call(text, q=(1.0,)):
    (law,) = laws_of_source(text, "own.py").values()
    law.bind(XYZ).place(np.array(q))


HEAD = "import numpy as np\n\ndef wing(xyz, tip):\n    {}\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("def wing(xyz, tip:\n    return xyz\n", "own.py:1: '\\(' was never closed"),
        ("import nothing_like_this\n", "own.py:1: ModuleNotFoundError: No module named 'nothing_like_this'"),
        ("a = 1\nb = a / 0\n", "own.py:2: ZeroDivisionError: division by zero"),
        ("a = 1\n", "own.py: holds no law; expected a function like"),
        ("def wing(xyz, *q):\n    return xyz\n", r"holds no law|\*args"),
        ("def wing(xyz, tip, *q):\n    return xyz\n", r"own.py:1: law wing: \*args and \*\*kwargs"),
        ("def wing(xyz, tip, *, span):\n    return xyz\n", "own.py:1: law wing: option span needs a default"),
        ("from windmark.deformation import law\n\n@law(tap='mm')\ndef wing(xyz, tip):\n    return xyz\n",
         "own.py:3: law wing: has no parameter tap; it has tip"),
        (HEAD.format("return xyz + tup"), "own.py:4: NameError: name 'tup' is not defined"),
        (HEAD.format("return np.linalg.solve(np.zeros((3, 3)), xyz.T).T"), "own.py:4: LinAlgError: Singular matrix"),
        (HEAD.format("return xyz[:5]"), r"own.py:3: law wing: must return \(30, 3\), like its points, got \(5, 3\)"),
        (HEAD.format("return None"), r"own.py:3: law wing: must return"),
        (HEAD.format("return 'up'"), r"own.py:3: law wing: must return numbers \(N, 3\)"),
        (HEAD.format("return xyz + 1j"), r"own.py:3: law wing: must return"),
    ],
)  # fmt: skip
def test_faults_are_told_with_file_and_line(text, words):
    with pytest.raises(LawError, match=words):
        call(text)


def test_the_innermost_line_of_the_file_counts():
    text = "def _half(x):\n    return x / 0\n\ndef wing(xyz, tip):\n    return xyz * _half(tip)\n"
    with pytest.raises(LawError, match=r"own\.py:2: ZeroDivisionError"):
        call(text)


def test_numbers_that_are_not_finite_are_found_by_the_check_not_warned_of():
    (law,) = laws_of_source(HEAD.format("return xyz + np.log(tip - 1)"), "own.py").values()
    with pytest.raises(LawError, match=r"own\.py:3: law wing: returns \[nan, nan, nan\] for the point"):
        check_law(law, XYZ)
