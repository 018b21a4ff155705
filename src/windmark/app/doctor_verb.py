"""The verbs `windmark doctor` and `windmark warmup`: is this installation sound, and is everything compiled?"""

from __future__ import annotations

import time
from pathlib import Path

from windmark.app import console
from windmark.app.progress import counted
from windmark.pipeline import state


def doctor(as_json: bool) -> None:
    """Look, say it; exit code 1 where something is wrong."""
    found = state.findings(Path.cwd())
    troubles = [f for f in found if f.trouble]
    width = max(len(f.what) for f in found)
    lines = [f"{f.what:{width}}  {f.words}" + (f"\n{'':{width}}  ! {f.trouble}" if f.trouble else "") for f in found]
    lines.append(f"{len(troubles)} thing{'s' if len(troubles) != 1 else ''} to look at" if troubles else "all sound")
    record = {"sound": not troubles, "findings": [vars(f) for f in found]}
    console.answer(record, as_json, lines)
    if troubles:
        raise console.exit_with(console.DATA_SAY_NO)


def warmup(processes: int | None, as_json: bool) -> None:
    """Compile everything with tiny jobs, with progress; what is compiled is kept."""
    from windmark.pipeline.warmup import compile_all

    start = time.perf_counter()
    with counted("compile") as show:
        failed = compile_all(show, processes)
    seconds = time.perf_counter() - start
    record = {"seconds": seconds, "failed": failed}
    if failed:
        why = "; ".join(f"{name}: {what}" for name, what in failed.items())
        console.refuse(f"not everything could be compiled: {why}", as_json, record)
    console.answer(record, as_json, [f"compiled and kept, {seconds:.0f} s; verbs start at once from now on"])
