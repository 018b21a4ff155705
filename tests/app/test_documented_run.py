"""Every command that the documentation or a --help shows runs as it is written, on the data that it names.

The blocks of a page run in its order, all those of one folder of data (`windmark simulate FOLDER`) in one test: a block
that names no such folder goes on where the one before it stands, as a reader does. Snippets of Python:
`test_documented_python.py`.
"""

import glob
import inspect
import os
import re
import shlex
import shutil
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from windmark.app.cli import app
from windmark.pipeline.simulate_deforming import simulate_deforming
from windmark.pipeline.simulate_psp import simulate_psp

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
    "windmark warmup": "compiles for minutes where nothing is compiled (test_warmup)",
}
"""What cannot run here, and why; the test that sees to it."""
DRAWN = {"README.md", "first-test.md"}
"""Pages whose reports get their pictures; those of each verb are drawn in its own tests."""
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
    "windmark simulate my-model --photos 12": "windmark simulate my-model --photos 8",
    "windmark simulate my-photos --photos 24": "windmark simulate my-photos --photos 10",
    "windmark simulate my-swing --deforming 24 --clocks": "windmark simulate my-swing --deforming 8 --clocks",
    "windmark simulate my-wing --deforming 12": "windmark simulate my-wing --deforming 4",
    "windmark simulate my-wing --deforming 8": "windmark simulate my-wing --deforming 4",
    "windmark simulate my-film --sequence 24": "windmark simulate my-film --sequence 6",
    "windmark simulate my-rig --cameras 4": "windmark simulate my-rig --cameras 3",
    "windmark study -o marker-study": "windmark study -o marker-study --steps 3 --markers 36",
}
"""The same with fewer frames, cameras, markers, for time."""


@pytest.fixture(scope="module", autouse=True)
def small_pictures():
    """Whole jobs on pictures of a third of the usual pixels, for time; their projects say the radius."""
    with pytest.MonkeyPatch.context() as patch:
        for simulate in (simulate_psp, simulate_deforming):
            usual = inspect.signature(simulate).parameters["size_px"].default
            given = tuple((640, 400) if value == usual else value for value in simulate.__defaults__)
            patch.setattr(simulate, "__defaults__", given)
        yield


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


def run(words: list[str], allowed: tuple[int, ...] = (0,)) -> None:
    """A command in this process, in the folder where it stands."""
    done = CliRunner().invoke(app, words)
    assert done.exit_code in allowed, f"{shlex.join(words)}\n{done.output[-1500:]}\n{done.exception!r}"


def carry_out(line: str, made_once) -> None:
    """Run a line of a page; what several pages simulate is made once and copied."""
    words = shlex.split(SMALLER.get(line, line), comments=True)
    if words[0] == "cd":
        os.chdir(words[1])
        return
    given = [w for word in words[1:] for w in (sorted(glob.glob(word)) or [word])]
    if given[0] != "simulate" or given[1] == ".":
        run(given, (0, 1) if " ".join(words) in DATA_SAY_NO else (0,))
        return
    folder, options = Path(given[1]), given[2:]
    if folder.exists():
        if given[1] == HOME:  # by the same command, and what later blocks go on with lies in it
            return
        shutil.rmtree(folder)
    made = made_once("documented" + "".join(options), lambda place: run(["simulate", str(place), *options]))
    shutil.copytree(made, folder)


@pytest.mark.slow
@pytest.mark.parametrize("chapter", list(chapters()))
def test_commands_of_the_documentation_run(chapter, made_once, tmp_path, monkeypatch, request):
    monkeypatch.chdir(tmp_path)
    page, _, data = chapter.partition(" ")
    if page not in DRAWN:
        request.getfixturevalue("undrawn")
    if page == "README.md":
        carry_out("windmark simulate . --seed 7", made_once)
    if data == HOME and page == "guide.md":
        for line in (f"windmark simulate {HOME} --seed 7", f"cd {HOME}", REGISTERED):
            carry_out(line, made_once)
    ran = 0
    for block in chapters()[chapter]:
        if DATA.search(block[0]):
            os.chdir(tmp_path)
        elif data == HOME:
            os.chdir(tmp_path / HOME)
        for line in block:
            command = line.partition(" #")[0].strip()
            if command not in ELSEWHERE:
                carry_out(command, made_once)
                ran += 1
    assert ran or all(line in ELSEWHERE for block in chapters()[chapter] for line in block)


def test_exceptions_are_still_in_the_documentation():
    every = {line for of in chapters().values() for block in of for line in block}
    every |= {line for _, command in every_command() for line in examples(command.epilog or "")}
    assert set(ELSEWHERE) | set(SMALLER) <= every
