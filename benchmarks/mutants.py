"""Do a room's tests notice when its code is wrong? Small changes, one at a time, and the share that a test sees.

A sample of changes is drawn from the syntax trees of a room: a comparison with another bound or turned round, a
constant that is off by one or by a quarter, another sign or operation, `and` for `or`, a condition turned round. Each
is made in a copy of the sources, and the tests of the room run against it until the first one fails, those of the
changed file first. A change that no test sees is either a line without a test, or one that makes no difference: the
list of those has to be read.

Changes that cannot make a difference are not drawn: ``strict`` of `zip`, which says what holds already; any other
negative length in ``reshape``, which NumPy takes for -1; ``<`` for ``<=`` beside a number such as 0.3 or one of the
file's constants that has a decimal point, which computed values do not hit (they are still turned round, and the number
is changed). A number below 1e-8 guards against rounding or a division by zero, and is as good a guard a quarter larger:
it becomes 0, no guard.

    python benchmarks/mutants.py adjust epipolar --count 20 --seed 1
    python benchmarks/mutants.py calibration --at calibration/solve.py:190

Kernels are left out unless ``--kernels`` asks for them: each change of one compiles everything anew that inlines it.
"""

from __future__ import annotations

import argparse
import ast
import copy
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "windmark"
SWAPS = {
    ast.Lt: (ast.LtE, ast.Gt), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.Lt), ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,), ast.Add: (ast.Sub,), ast.Sub: (ast.Add,), ast.Mult: (ast.Div,), ast.Div: (ast.Mult,),
    ast.FloorDiv: (ast.Mult,), ast.Mod: (ast.FloorDiv,), ast.Pow: (ast.Mult,), ast.And: (ast.Or,), ast.Or: (ast.And,),
    ast.BitAnd: (ast.BitOr,), ast.BitOr: (ast.BitAnd,),
}  # fmt: skip
ROOMS = [
    "adjust", "calibration", "deformation", "detection", "epipolar", "geometry", "options", "paint", "registration",
    "resection", "scene", "tasks",
]  # fmt: skip
STRICT = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
"""Comparisons that differ at the bound alone."""
FACTOR = 1.25
"""Of a constant that is no whole number, or a large one."""
MANY = 100
"""Whole numbers from here on are amounts: one more makes no difference."""
GUARD = 1e-8
"""Constants below are there for rounding."""


@dataclass(frozen=True)
class Change:
    """One place of a file and what stands there instead; ``start`` and ``end`` count bytes."""

    file: str
    line: int
    start: int
    end: int
    was: str
    now: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.was}  ->  {self.now}"


def changes(path: Path) -> list[Change]:
    """All changes of a file."""
    source = path.read_bytes()
    starts = [0]
    for text in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(text))
    found, tree = [], ast.parse(source)
    bounds = _bounds(tree)
    for node in _code(tree):
        start, end = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
        was = source[start:end].decode()
        for other in _instead(node, bounds):
            now = ast.unparse(other)
            now = now if isinstance(node, ast.Constant) else f"({now})"
            found.append(Change(path.relative_to(PACKAGE).as_posix(), node.lineno, start, end, was, now))
    return found


def _code(node: ast.AST) -> Iterator[ast.expr]:
    """Expressions that are run: no annotations, decorators, texts, or lists of names."""
    if isinstance(node, ast.keyword) and node.arg == "strict":
        return
    shape = isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "reshape"
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        if isinstance(node, ast.Assign) and any(getattr(t, "id", "") == "__all__" for t in node.targets):
            return
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.JoinedStr | ast.Raise) or (shape and isinstance(child, ast.UnaryOp)):
                continue
            if isinstance(child, ast.AST):
                if isinstance(child, ast.Compare | ast.BinOp | ast.BoolOp | ast.Constant | ast.UnaryOp | ast.IfExp):
                    yield child
                yield from _code(child)


def _instead(node: ast.expr, bounds: set[str]) -> Iterator[ast.expr]:
    """What may stand in place of an expression; ``bounds`` are names of constants with a decimal point."""
    if isinstance(node, ast.Constant):
        value = node.value
        if isinstance(value, bool):
            yield ast.Constant(not value)
        elif isinstance(value, int):
            yield ast.Constant(value + 1 if value < MANY else round(value * FACTOR))
        elif isinstance(value, float) and value:
            yield ast.Constant(value * FACTOR if value >= GUARD else 0.0)
    elif isinstance(node, ast.Compare):
        sides = [node.left, *node.comparators]
        for k, op in enumerate(node.ops):
            for other in SWAPS.get(type(op), ()):
                if other is STRICT.get(type(op)) and any(_between(s, bounds) for s in sides[k : k + 2]):
                    continue
                new = copy.deepcopy(node)
                new.ops[k] = other()
                yield new
    elif isinstance(node, ast.BinOp | ast.BoolOp):
        for other in SWAPS.get(type(node.op), ()):
            new = copy.deepcopy(node)
            new.op = other()
            yield new
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        if not isinstance(node.operand, ast.Constant):
            yield node.operand
    elif isinstance(node, ast.IfExp):
        yield ast.IfExp(node.test, node.orelse, node.body)


def _between(node: ast.expr, bounds: set[str]) -> bool:
    """Whether it is a number that is not whole, its negative, such a constant, or so many times something."""
    if isinstance(node, ast.UnaryOp):
        return _between(node.operand, bounds)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
        return _between(node.left, bounds) or _between(node.right, bounds)
    if isinstance(node, ast.Name):
        return node.id in bounds
    return isinstance(node, ast.Constant) and isinstance(node.value, float) and not node.value.is_integer()


def _bounds(tree: ast.Module) -> set[str]:
    """Names that a file gives to numbers with a decimal point."""
    found = set()
    for node in tree.body:
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            names, values = node.targets[0], node.value
            pairs = zip(names.elts, values.elts, strict=True) if _are_tuples(names, values) else [(names, values)]
            found |= {n.id for n, v in pairs if isinstance(n, ast.Name) and _is_float(v)}
    return found


def _are_tuples(*nodes: ast.expr) -> bool:
    return all(isinstance(n, ast.Tuple) for n in nodes)


def _is_float(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, float)


def tests_of(room: str) -> list[str]:
    """Folders of tests that are a room's own."""
    return [f"tests/{room}"]


def nearest(change: Change, tests: list[str]) -> list[str]:
    """The same tests, those of the changed file first."""
    name = f"test_{Path(change.file).stem}.py"
    own = [p.relative_to(ROOT).as_posix() for t in tests for p in sorted((ROOT / t).rglob(name))]
    return [*own, *tests]


class Bench:
    """A copy of the sources in which one change at a time is made."""

    def __init__(self, folder: Path, timeout_s: float) -> None:
        self.package, self.timeout_s = folder / "windmark", timeout_s
        shutil.copytree(PACKAGE, self.package)  # with the compiled kernels, and as old as they are

    def passes(self, tests: list[str]) -> bool:
        """Whether the tests pass; too long a run is none."""
        env = os.environ | {"PYTHONPATH": str(self.package.parent), "PYTHONDONTWRITEBYTECODE": "1"}
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-m", "not slow", "-p", "no:cacheprovider", *tests]
        try:
            done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, timeout=self.timeout_s)
        except subprocess.TimeoutExpired:
            return False
        if done.returncode not in (0, 1, 2):  # nothing was run, or pytest itself went wrong
            raise SystemExit(done.stdout.decode()[-2000:] + done.stderr.decode()[-2000:])
        return done.returncode == 0

    def survives(self, change: Change, tests: list[str]) -> bool:
        """Whether no test sees a change."""
        path = self.package / change.file
        before, stat = path.read_bytes(), path.stat()
        path.write_bytes(before[: change.start] + change.now.encode() + before[change.end :])
        try:
            return self.passes(tests)
        finally:
            path.write_bytes(before)
            os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))


def sources(room: str, kernels: bool) -> list[Path]:
    """Files of a room, those of its kernels only if asked for."""
    files = sorted((PACKAGE / room).rglob("*.py"))
    private = [any(p.startswith("_") and p != "__init__.py" for p in f.relative_to(PACKAGE).parts) for f in files]
    return [f for f, hidden in zip(files, private, strict=True) if kernels or not hidden]


def run(room: str, bench: Bench, args: argparse.Namespace) -> dict[str, object]:
    """A sample of changes of one room."""
    tests = args.tests or tests_of(room)
    every = [c for f in sources(room, args.kernels) for c in changes(f)]
    if args.at:
        file, _, line = args.at.partition(":")
        chosen = [c for c in every if c.file == file and (not line or c.line == int(line))]
    else:
        chosen = random.Random(args.seed).sample(every, min(args.count, len(every)))
    start = time.perf_counter()
    if not bench.passes(tests):
        raise SystemExit(f"{room}: its tests fail, or take over {args.timeout_s:g} s, as they are")
    print(f"{room}: {len(every)} changes, {len(chosen)} tried; the tests take {time.perf_counter() - start:.0f} s")
    survived = []
    for n, change in enumerate(chosen, 1):
        if bench.survives(change, nearest(change, tests)):
            survived.append(str(change))
            print(f"  {n}/{len(chosen)} survived: {change}", flush=True)
    killed = len(chosen) - len(survived)
    print(f"{room}: {killed} of {len(chosen)} killed ({100 * killed / max(len(chosen), 1):.0f} %)", flush=True)
    return {"room": room, "changes": len(every), "tried": len(chosen), "killed": killed, "survived": survived}


def main(quick: bool = False) -> list[dict[str, object]]:
    """A sample of every room; called by `run.py`."""
    return table(ROOMS, argparse.Namespace(
        count=5 if quick else 20, seed=0, at=None, tests=None, kernels=False, timeout_s=600.0
    ))  # fmt: skip


def table(rooms: list[str], args: argparse.Namespace) -> list[dict[str, object]]:
    """One row for each room."""
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder), args.timeout_s)
        return [run(room, bench, args) for room in rooms]


def command() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("rooms", nargs="+", help="folders of src/windmark, such as adjust or tasks/reconstruct")
    parser.add_argument("--count", type=int, default=20, help="changes of each room")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--at", help="FILE[:LINE]: all changes there instead of a sample")
    parser.add_argument("--tests", nargs="*", help="what is run instead of the room's own tests")
    parser.add_argument("--kernels", action="store_true", help="change kernels, too: minutes of compiling for each")
    parser.add_argument("--timeout-s", type=float, default=600.0, help="a run that takes longer has seen the change")
    parser.add_argument("--json", type=Path, help="write the table here, too")
    args = parser.parse_args()
    rows = table(args.rooms, args)
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")


if __name__ == "__main__":
    command()
