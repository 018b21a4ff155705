"""Every command that the documentation or a --help shows is one that the program takes; the cheap ones are run."""

import glob
import json
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import typer

from windmark.app.cli import app

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("docs/*.md"), *ROOT.glob("docs/tutorial/*.md"), ROOT / "README.md"])
sys.path.insert(0, str(ROOT / "docs"))

from make_reference import every_command, examples  # noqa: E402

GROUP = typer.main.get_command(app)
NOT_LITERAL = re.compile(r"\.\.\.|…|\[[A-Z]|VERB|<[a-z]")
"""What a reader has to put something in place of."""


def documented() -> list[tuple[str, str]]:
    """(where, command line) of every block of code."""
    out = []
    for page in PAGES:
        block = False
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        for number, line in enumerate(text.splitlines(), start=1):
            if line.startswith("```"):
                block = not block
            elif block and line.strip().startswith("windmark "):
                out.append((f"{page.name}:{number}", line.strip()))
    return out


def helps() -> list[tuple[str, str]]:
    """(verb, command line) of every example in a --help."""
    return [(words, line) for words, command in every_command() for line in examples(command.epilog or "")]


def parsed(line: str) -> None:
    """Parse as the program does, without carrying it out."""
    words = shlex.split(line, comments=True)[1:]
    words = words[: next((k for k, w in enumerate(words) if w in ("|", ">", "&&", ";")), len(words))]
    if words[:1] in (["--version"], ["-V"], ["--help"], ["--install-completion"]):
        return
    command = GROUP
    while hasattr(command, "commands"):
        assert words, f"no verb in {line!r}"
        command = command.commands[words.pop(0)]
    if "--help" in words:
        words.remove("--help")
        command.make_context("windmark", words, resilient_parsing=True)
        return
    command.make_context("windmark", words)


@pytest.mark.parametrize(("where", "line"), documented(), ids=lambda v: v[:60])
def test_documented_command_parses(where, line):
    if NOT_LITERAL.search(line):
        pytest.skip("has a place to be filled in by the reader")
    parsed(line)


@pytest.mark.parametrize(("verb", "line"), helps(), ids=lambda v: v[:60])
def test_example_of_help_parses(verb, line):
    assert line.split()[1 : 1 + len(verb.split())] == verb.split()
    parsed(line)


def test_every_verb_has_an_example():
    without = [words for words, command in every_command() if not examples(command.epilog or "")]
    assert without == []


def test_the_reference_names_every_verb_and_key():
    from make_reference import commands, keys

    text = commands()
    assert all(f"\n## {words}\n" in text for words, _ in every_command())
    assert "`radius_px`" in keys()
    assert "`emissivity`" in keys()


def test_relative_links_of_the_documentation_lead_somewhere():
    broken = []
    for page in [*PAGES, *ROOT.glob("docs/reference/formats.md")]:
        for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
            file = target.partition("#")[0]
            if file and "://" not in file and not (page.parent / file).exists():
                generated = "reference" in file and Path(file).stem in ("commands", "keys", "api")
                broken += [] if generated else [f"{page.name}: {target}"]
    assert broken == []


def run(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    words = [w for word in shlex.split(line)[1:] for w in (glob.glob(word, root_dir=folder) or [word])]
    return subprocess.run(
        [sys.executable, "-m", "windmark.app.cli", *words], cwd=folder, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("line", ["windmark doctor --json", "windmark -V", "windmark laws", "windmark --help"])
def test_cheap_commands_run(line, tmp_path):
    done = run(line, tmp_path)
    assert done.returncode in (0, 1), done.stderr
    if "--json" in line:
        assert "findings" in json.loads(done.stdout)


def test_wrong_options_are_json_for_machines(tmp_path):
    done = run("windmark run --nope --json", tmp_path)
    assert done.returncode == 2
    assert "--nope" in json.loads(done.stdout)["error"]
    assert "Traceback" not in done.stderr


def anchors(page: Path) -> set[str]:
    """Of the headings, as GitHub and the site make them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    found: list[str] = []
    for heading in re.findall(r"^#{1,6} +(.+?) *$", text, re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", plain.lower()).replace(" ", "-")
        found.append(slug if slug not in found else f"{slug}-{found.count(slug)}")
    return set(found)


@pytest.mark.parametrize("page", [*PAGES, *ROOT.glob("docs/reference/formats.md")], ids=lambda p: p.name)
def test_links_to_a_heading_lead_to_one(page):
    from make_reference import commands

    broken = []
    for target in re.findall(r"\]\(([^)\s]*#[^)\s]*)\)", page.read_text(encoding="utf-8")):
        file, _, anchor = target.partition("#")
        if "://" in file:
            continue
        there = (page.parent / file) if file else page
        if there.suffix == ".md" and there.exists():
            known = anchors(there)
        elif there.name == "commands.md":  # the page is made when the site is built
            known = set(re.findall(r"^## (\S+)$", commands(), re.MULTILINE))
        else:
            continue
        broken += [target] if anchor not in known else []
    assert broken == []


def test_no_key_without_a_meaning_and_no_class_without_its_members():
    from make_reference import api, keys, meanings

    from windmark.pipeline.settings import Strict

    class Silent(Strict):
        """A table. ``told``: this one."""

        told: int = 0
        untold: int = 0

    with pytest.raises(KeyError, match="Silent: its docstring says nothing of untold"):
        meanings(Silent)
    rows = [line for line in keys().splitlines() if line.startswith("| `")]
    assert len(rows) > 330
    assert all(line.replace("\\|", "").split("|")[2].strip() for line in rows)
    assert ":members:" in api().partition("autoclass:: windmark.Camera")[2].partition("```")[0]


def test_the_page_of_tasks_shows_what_runs_on_other_pages():
    """Its commands stand in a table: each is a line of a block elsewhere, which `test_documented_run` carries out."""
    text = (ROOT / "docs" / "howto.md").read_text(encoding="utf-8")
    shown = re.findall(r"^\|[^|]*\| `(windmark [^`]*)` \|", text, re.MULTILINE)
    assert len(shown) > 9
    run_there = {line.partition(" #")[0].strip() for _, line in documented()}
    assert [line for line in shown if line not in run_there] == []


def test_the_smallest_projects_are_projects(tmp_path):
    from windmark.pipeline.check.paths import MODELS

    text = (ROOT / "docs" / "howto.md").read_text(encoding="utf-8")
    found = re.findall(r"for `windmark (\w+)`[^\n]*:\n\n```toml\n(.*?)```", text, re.DOTALL)
    assert [verb for verb, _ in found] == list(MODELS)
    for verb, body in found:
        MODELS[verb].model_validate({"path": tmp_path / "project.toml", **tomllib.loads(body)})
