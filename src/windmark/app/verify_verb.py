"""The verb `windmark verify`: run a result again as its manifest says, and compare."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, get_type_hints

from windmark import io
from windmark.app import console
from windmark.app.progress import progress
from windmark.app.verdict_words import verdict_lines
from windmark.errors import UsageError
from windmark.io.manifest import MANIFEST, read_manifest
from windmark.pipeline.repeat import Difference, inputs_now, results_again
from windmark.pipeline.settings import has_path
from windmark.pipeline.verdict import DOUBTFUL, Finding, Verdict

Record = dict[str, Any]
TARGETS = ("output", "folder")
"""Parameters of a verb that say where its result goes."""
SHOWN = 12


def verify(windmark: Any, folder: Path, keep: Path | None, as_json: bool) -> None:
    """Run again, compare, say what differs; exit code 1 where numbers do. ``windmark`` is the command of all verbs."""
    manifest = read_manifest(folder)
    if manifest is None:
        raise UsageError(f"{folder}: has no {MANIFEST} that can be read; expected the folder of a result of windmark")
    sound = isinstance(manifest.get("inputs", []), list) and isinstance(manifest.get("options", {}), dict)
    inputs = manifest.get("inputs", []) if sound else []
    named = [isinstance(one, dict) and {"file", "sha256"} <= set(one) for one in inputs]
    if not (sound and all(named)):
        raise io.FileError(folder / MANIFEST, "its inputs or options are not those of a result of windmark")
    if manifest.get("unfinished"):
        raise UsageError(f"{folder}: this run did not come to its end; --resume or --finish it first")
    if keep is not None and keep.exists():
        raise UsageError(f"{keep} is there already; --keep expects a new folder")
    found = Difference()
    inputs_now(folder, manifest, found)
    missing = [name for name, what in found.inputs.items() if what == "missing"]
    if missing:
        raise io.FileError(folder / missing[0], f"is missing, and the run needs it{_more(missing)}")
    with tempfile.TemporaryDirectory(prefix="windmark-verify-") as place:
        target = keep or Path(place) / folder.resolve().name
        with progress() as show:
            show(f"windmark {manifest.get('verb')} again")
            refusal = _again(arguments(windmark, manifest, folder, target))
        if refusal is None:
            results_again(folder, target / _within(manifest, folder), found)
    if refusal is not None and not manifest.get("refused"):
        console.refuse(f"the run that gave this result is refused now: {refusal}", as_json, _record(found, folder))
    record = _record(found, folder)
    if found.repeated:
        console.answer(record, as_json, _lines(found, folder, manifest, _stored_verdict(folder)))
        return
    verdict = compared(found)
    if as_json:
        console.refuse("the result cannot be had again", True, {**record, "verdict": verdict.record()})
    console.answer(record, False, _lines(found, folder, manifest, verdict))
    raise console.exit_with(console.DATA_SAY_NO)


def _again(words: list[str]) -> str | None:
    """A command of windmark in a process of its own; why it refused, if it did."""
    command = [sys.executable, "-m", "windmark.app.cli", *words, "--json"]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", errors="replace", check=False)
    if done.returncode == console.DONE:
        return None
    if done.returncode == console.FAULT:
        raise RuntimeError(f"the run ended with a fault: {done.stderr[-2000:]}")
    try:
        said = json.loads(done.stdout).get("error", "")
    except ValueError:
        said = ""
    return said or done.stderr.strip()[-400:] or f"exit code {done.returncode}"


def arguments(windmark: Any, manifest: Record, folder: Path, target: Path) -> list[str]:
    """The words of the command line that make a result again, with the same options in another folder.

    Raises
    ------
    UsageError
        When the manifest is of no verb of this version, or its result is no folder.
    """
    verb, command = str(manifest.get("verb")), windmark
    for word in verb.split():
        command = getattr(command, "commands", {}).get(word)
        if command is None:
            raise UsageError(f"{folder}: made by windmark {verb}, which this version does not have")
    options = dict(manifest.get("options", {}))
    words, last = verb.split(), []
    known = {p.name: p for p in command.params}
    hints = get_type_hints(command.callback)
    where = next((name for name in TARGETS if name in known), None)
    if where is None:
        raise UsageError(f"{folder}: windmark {verb} writes no folder that could be compared")
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise UsageError(f"{folder}: made with {', '.join(unknown)}, which this version of windmark {verb} lacks")
    for name, value in {**options, where: str(target.resolve())}.items():
        param = known[name]
        is_path = name != where and has_path(hints.get(name))
        values = [_placed(v, folder) if is_path else str(v) for v in (value if isinstance(value, list) else [value])]
        if param.param_type_name == "argument":
            last += values
        elif getattr(param, "is_flag", False):
            words += [param.opts[0]] if value else list(param.secondary_opts[:1])
        else:
            words += [w for v in values for w in (param.opts[0], v)]
    return [*words, *(["--", *last] if any(word.startswith("-") for word in last) else last)]


def _within(manifest: Record, folder: Path) -> str:
    """Where a result is in the folder that its verb was given: `windmark demo` writes one into it, beside its data."""
    given = next((manifest["options"][name] for name in TARGETS if name in manifest.get("options", {})), ".")
    return os.path.relpath(folder.resolve(), (folder / str(given)).resolve())


def _placed(value: Any, folder: Path) -> str:
    """Paths of a manifest are relative to the result."""
    return os.path.normpath(folder.resolve() / str(value))


def _stored_verdict(folder: Path) -> Verdict | None:
    try:
        return Verdict.of_record(json.loads((folder / "summary.json").read_text(encoding="utf-8"))["verdict"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _record(found: Difference, folder: Path) -> Record:
    return {"result": folder, "repeated": found.repeated, **vars(found)}


def compared(found: Difference) -> Verdict:
    """The verdict on a result that is not had again: doubtful, by what is not as it was."""
    inputs = [f"{name} {what}" for name, what in found.inputs.items()]
    if inputs:
        why, step = f"its input is another one: {inputs[0]}{_more(inputs)}", "run the job again, or take that file back"
    elif found.touched:
        why, step = f"it was changed or taken away since: {found.touched[0]}{_more(found.touched)}", "run the job again"
    elif found.versions:
        name, (then, now) = next(iter(found.versions.items()))
        why = f"{name} was {then} and is {now} (see the numbers that differ)"
        step = "run the job again, or with the versions of then"
    else:
        why, step = "the same inputs and versions give other numbers", "report it, with the result's folder"
    return Verdict.of([Finding(DOUBTFUL, "file", f"the result cannot be had again: {why}", step)], 1, "", "")


def _lines(found: Difference, folder: Path, manifest: Record, verdict: Verdict | None) -> list[str]:
    count = len(found.same)
    head = "the same again" if found.repeated else "NOT the same"
    lines = [f"{folder}: {head}: {count} files agree (windmark {manifest.get('verb')}, run again)"]
    lines += [f"input {what}: {name}" for name, what in found.inputs.items()]
    lines += [f"version of {name}: {a} then, {b} now" for name, (a, b) in found.versions.items()]
    lines += _some([f"the result itself was changed or taken away since: {name}" for name in found.touched])
    lines += _some([f"not written any more: {name}" for name in found.lost])
    lines += _some([f"  {name}: {words}" for name, every in found.numbers.items() for words in every[:3]])
    if found.bytes_only:
        some = ", ".join(found.bytes_only[:4])
        lines.append(f"other bytes, numbers not compared: {some}{_more(found.bytes_only[3:])}")
    return [*lines, *(verdict_lines(verdict) if verdict is not None else [])]


def _some(lines: list[str]) -> list[str]:
    """The first of them, and how many there are besides."""
    return lines if len(lines) <= SHOWN else [*lines[:SHOWN], f"  and {len(lines) - SHOWN} more, see --json"]


def _more(names: list[str]) -> str:
    return f" (and {len(names) - 1} more)" if len(names) > 1 else ""
