"""What makes a first use long does not creep in again: read from the sources, nothing is compiled."""

import ast
from collections import Counter
from functools import cache
from pathlib import Path

import windmark
from windmark.geometry._jit import kernel_sources

PACKAGE = Path(windmark.__file__).parent

CHEAP = {
    "array", "empty", "empty_like", "eye", "float32", "float64", "full", "int32", "int64", "isfinite", "isnan", "log",
    "ones", "sqrt", "uint8", "uint64", "zeros",
}  # fmt: skip
"""NumPy's functions that compile quickly."""
COSTLY = {
    "append": 6, "arange": 1, "argsort": 5, "ascontiguousarray": 1, "concatenate": 3, "cumsum": 1, "flatnonzero": 1,
    "median": 6, "sort": 3,
}  # fmt: skip
"""How often those stand in kernels that numba compiles anew for every type, a sort for 1 to 2 s: a helper of our own
does for all. Each may become fewer."""
MOST = 453
"""Compiled functions: those of a detection cost 0.3 s of CPU each on a busy machine, typing and lowering alone."""


@cache
def kernels() -> tuple[tuple[str, ast.FunctionDef], ...]:
    """All compiled functions, with the file."""
    found = []
    for name in kernel_sources(PACKAGE):
        for node in ast.walk(ast.parse((PACKAGE / name).read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and any("njit" in ast.unparse(d) for d in node.decorator_list):
                found.append((name, node))
    return tuple(found)


def test_there_are_not_ever_more_kernels():
    assert 300 < len(kernels()) <= MOST


def test_kernels_call_few_functions_of_numpy_that_take_long_to_compile():
    used = Counter(
        call.func.attr
        for _, kernel in kernels()
        for call in ast.walk(kernel)
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute) and ast.unparse(call.func.value) == "np"
    )
    new = {name: count for name, count in used.items() if name not in CHEAP and count > COSTLY.get(name, 0)}
    assert not new, f"write a helper, or change the table with a measurement: {new}"


def test_all_kernels_are_linked_once_and_kept():
    """Numba's own decorator would optimise and emit them with each caller, and would not see that sources changed."""
    own = {"geometry/_jit.py", "geometry/_link.py"}
    for path in PACKAGE.rglob("*.py"):
        name, text = path.relative_to(PACKAGE).as_posix(), path.read_text(encoding="utf-8")
        if "nb.njit" not in text or name in own:
            continue
        tree = ast.parse(text)
        imported = {
            alias.name.partition(".")[0] for n in ast.walk(tree) if isinstance(n, ast.Import) for alias in n.names
        } | {str(n.module).partition(".")[0] for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and not n.level}
        top = {str(n.module) for n in tree.body if isinstance(n, ast.ImportFrom)}
        assert "windmark.geometry._jit" in top, name
        assert "numba" not in imported, name
    for name, kernel in kernels():
        made = [ast.unparse(d) for d in kernel.decorator_list]
        assert len(made) == 1, name
        assert made[0].startswith("nb.njit(cache=True, nogil=True"), f"{name}: {kernel.name}"
