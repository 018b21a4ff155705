"""Every command that the documentation or a --help shows runs as it is written, on the data that it names.

The blocks of a page run in its order, all those of one folder of data (`windmark simulate FOLDER`) in one test: a block
that names no such folder goes on where the one before it stands, as a reader does. Snippets of Python:
`test_documented_python.py`.
"""

import glob
import os
import re
import shlex
import shutil
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted(ROOT.glob("docs/*.md")), *sorted(ROOT.glob("docs/tutorial/*.md"))]
sys.path.insert(0, str(ROOT / "docs"))

from make_reference import every_command, examples  # noqa: E402

DATA = re.compile(r"\bmy-[a-z]+\b")
"""A folder of data in the documentation."""
ELSEWHERE = {
    "windmark view my-test/project.toml": "serves until it is stopped (test_view_job)",
    "windmark view project.toml": "serves until it is stopped (test_view_job)",
    "windmark psp my-polar/psp.toml --scheduler tcp://10.0.0.7:8786": "needs a cluster (test_psp_cluster)",
    "windmark deform my-wing/deform.toml --resume": "needs a run that was stopped (test_deform_resume)",
    "windmark deform my-wing/deform.toml --finish": "needs a run that was stopped (test_deform_resume)",
    "windmark convert targets.txt markers.csv --columns name,x,y,z,sigma_x,sigma_y,sigma_z,- --unit mm":
        "needs the list of another program (test_convert_markers)",
    "windmark warmup": "compiles for minutes where nothing is compiled (test_warmup)",
}  # fmt: skip
"""What cannot run here, and why; the test that sees to it."""
DRAWN = {"README.md"}
"""The page whose reports get their pictures; those of each verb are drawn in its own tests."""
HOME = "my-test"
"""What a block that names the tunnel's pictures without a folder goes on in; its first one is registered there."""
REGISTERED = "windmark register wind-off.tif -m markers.csv -c camera.json -r 4 --unit mm"
DATA_SAY_NO = {"windmark doctor", "windmark doctor --json", "windmark verify my-test/results"}
"""Their exit code 1 tells of the machine or of a difference, and is no failure of the command."""
SMALLER = {
    "windmark simulate my-polar --psp 5": "windmark simulate my-polar --psp 1",
    "windmark simulate my-polar --psp 2": "windmark simulate my-polar --psp 1",
    "windmark simulate my-board --board 6": "windmark simulate my-board --board 4",
    "windmark simulate my-run --infrared 40": "windmark simulate my-run --infrared 8",
    "windmark simulate my-model --photos 12": "windmark simulate my-model --photos 5",
    "windmark simulate my-photos --photos 24": "windmark simulate my-photos --photos 5",
    "windmark simulate my-swing --deforming 24 --clocks": "windmark simulate my-swing --deforming 3 --clocks",
    "windmark simulate my-wing --deforming 12": "windmark simulate my-wing --deforming 3",
    "windmark simulate my-wing --deforming 8": "windmark simulate my-wing --deforming 3",
    "windmark simulate my-wing --deforming 4": "windmark simulate my-wing --deforming 3",
    "windmark simulate my-film --sequence 24": "windmark simulate my-film --sequence 3",
    "windmark simulate my-rig --cameras 4": "windmark simulate my-rig --cameras 2",
    "windmark study -o marker-study": "windmark study -o marker-study --steps 3 --markers 36",
    "windmark study -r 3 --noise-percent 10 -o noisy-markers":
        "windmark study -r 3 --noise-percent 10 -o noisy-markers --steps 3 --markers 36",
    "windmark markers check markers.csv --unit mm -c camera.json --view-from 0,90 --within 50":
        "windmark markers check markers.csv --unit mm -c camera.json --view-from 0,90 --within 50 --quick",
}  # fmt: skip
"""The same with fewer frames, cameras, markers, trials, for time."""


def blocks(page: Path) -> list[list[str]]:
    """The command lines of every block with a windmark in it."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    found = []
    for language, body in re.findall(r"^```(\w*)\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE):
        lines = [line.strip() for line in body.splitlines()]
        if language != "python" and any(line.startswith("windmark ") for line in lines):
            found.append([line for line in lines if line.startswith(("windmark ", "cd "))])
    return found


def chapters() -> dict[str, list[list[str]]]:
    """Blocks of a page by the folder of data that they are of: "guide.md my-test" and so on."""
    out: dict[str, list[list[str]]] = {}
    for page in PAGES:
        if page.name == "paper-map.md":  # docs/run_paper_map.py runs it as a whole
            continue
        of = ""
        for block in blocks(page):
            words = " ".join(block)
            of = next(iter(DATA.findall(words)), HOME if "wind-off" in words else of)
            out.setdefault(f"{page.name} {of}".strip(), []).append(block)
    return out


@pytest.fixture(scope="module")
def carry_out(windmark, made_once, simulated):
    """``carry_out(line)``: run a line of a page; what several pages simulate or try is made once and copied."""

    def run(words, allowed=(0,)):
        done = windmark(*words)
        assert done.code in allowed, f"{shlex.join(words)}\n{done.out[-800:]}\n{done.err[-800:]}"

    def tried():
        return made_once("documented-demo", lambda place: run(["demo", str(place / "out")])) / "out"

    def carried(line):
        words = shlex.split(SMALLER.get(line, line), comments=True)
        if words[0] == "cd":
            os.chdir(words[1])
            return
        given = [w for word in words[1:] for w in (sorted(glob.glob(word)) or [word])]
        if given[0] not in ("simulate", "demo"):
            run(given, (0, 1) if " ".join(words) in DATA_SAY_NO else (0,))
            return
        folder, options = Path(given[1]), given[2:]
        if folder.exists() and given[1] != ".":
            if given[1] == HOME:  # by the same command, and what later blocks go on with lies in it
                return
            shutil.rmtree(folder)
        shutil.copytree(tried() if given[0] == "demo" else simulated(*options), folder, dirs_exist_ok=True)

    return carried


@pytest.mark.slow
@pytest.mark.parametrize("chapter", list(chapters()))
def test_commands_of_the_documentation_run(chapter, carry_out, tmp_path, monkeypatch, request):
    monkeypatch.chdir(tmp_path)
    page, _, data = chapter.partition(" ")
    if page not in DRAWN:
        request.getfixturevalue("undrawn")
    if page == "README.md":
        carry_out("windmark simulate . --seed 7")
    if data == HOME and page == "guide.md":
        for line in (f"windmark simulate {HOME} --seed 7", f"cd {HOME}", REGISTERED):
            carry_out(line)
    ran = 0
    for block in chapters()[chapter]:
        if DATA.search(block[0]):
            os.chdir(tmp_path)
        elif data == HOME:
            os.chdir(tmp_path / HOME)
        for line in block:
            command = line.partition(" #")[0].strip()
            if command not in ELSEWHERE:
                carry_out(command)
                ran += 1
    assert ran or all(line in ELSEWHERE for block in chapters()[chapter] for line in block)


def test_exceptions_are_still_in_the_documentation():
    every = {line for of in chapters().values() for block in of for line in block}
    every |= {line for _, command in every_command() for line in examples(command.epilog or "")}
    assert set(ELSEWHERE) | set(SMALLER) <= every
