"""Kernels are lowered once and linked when Python calls them; nothing else may tell the difference."""

import operator
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
import pytest
from numba.core import errors, ir, registry, types

from windmark import compiling
from windmark.geometry import _link
from windmark.geometry._jit import nb


def is_linked(kernel):
    return [result.library._finalized for result in kernel.overloads.values()]


def chain():
    """Three functions, each called by the next."""

    @nb.njit(nogil=True, error_model="numpy")
    def low(values, k):
        if k < 0:
            raise ValueError("no such place", k)
        return np.sort(values)[k] + np.linalg.norm(values)

    @nb.njit(nogil=True)
    def middle(values, k=1):
        return 2.0 * low(values, k)

    @nb.njit(nogil=True)
    def top(values, k):
        return middle(values) + low(values, k) + low(values, 0)

    return low, middle, top


VALUES = np.array([3.0, 1.0, 4.0, 1.5, 9.0])
LOW = np.sort(VALUES) + np.linalg.norm(VALUES)
TOP = 2.0 * LOW[1] + LOW + LOW[0]


def test_the_installed_numba_is_as_known():
    context = registry.cpu_target.target_context
    assert isinstance(context, _link._Context)
    assert context.codegen()._library_class is _link.Library
    assert not _link.install()  # once is enough


@pytest.mark.slow
def test_only_what_python_calls_is_linked():
    low, middle, top = chain()
    assert top(VALUES, 2) == TOP[2]
    assert (is_linked(top), is_linked(middle), is_linked(low)) == ([True], [False], [False])
    assert low(VALUES, 3) == LOW[3]
    assert (is_linked(top), is_linked(middle), is_linked(low)) == ([True], [False], [True])

    @nb.njit(nogil=True)
    def above(values):
        return top(values, 1) - low(values, 1) + middle(values, 4)

    assert above(VALUES) == TOP[1] - LOW[1] + 2.0 * LOW[4]


def test_literals_and_defaults_are_no_signatures_of_their_own():
    low, middle, top = chain()

    @nb.njit(nogil=True)
    def above(values, k):
        return middle(values) + middle(values, k) + middle(values, k=3) + top(values, k)

    assert above(VALUES, 2) == 2.0 * (LOW[1] + LOW[2] + LOW[3]) + TOP[2]
    assert [len(kernel.overloads) for kernel in (low, middle, top)] == [1, 1, 1]


@pytest.mark.parametrize("call", [0, 2])
def test_errors_of_functions_below_come_out_whole(call):
    kernels = chain()
    for _ in range(2):
        with pytest.raises(ValueError, match="no such place") as raised:
            kernels[call](VALUES, -7)
        assert raised.value.args == ("no such place", -7)


def test_a_function_of_numba_alone_may_call_kernels_and_share_its_own_parts():
    _, _, top = chain()
    top(VALUES, 2)

    @numba.njit
    def foreign(values, n):
        return np.sort(values)[0] + top(values, 1) + np.empty(n).size

    assert foreign(VALUES, 3) == VALUES.min() + TOP[1] + 3
    with pytest.raises(ValueError, match="negative dimensions"):
        foreign(VALUES, -3)


def test_threads_that_need_the_same_kernels_get_one_each():
    low, middle, top = chain()
    with ThreadPoolExecutor(4) as pool:
        done = list(pool.map(lambda k: (top, middle, low)[k % 3](VALUES, 2), range(12)))
    assert done == 4 * [TOP[2], 2.0 * LOW[2], LOW[2]]
    assert [len(kernel.overloads) for kernel in (top, middle, low)] == [1, 1, 1]


def test_linking_that_was_interrupted_starts_anew(monkeypatch):
    _, _, top = chain()

    def interrupted(*args):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(_link.Library, "_optimize_final_module", interrupted)
        with pytest.raises(KeyboardInterrupt):
            top(VALUES, 2)
    assert _link._DEPTH.now == 0
    assert top(VALUES, 2) == TOP[2]


def test_who_waits_for_a_kernel_is_told_how_long(monkeypatch):
    said = []
    monkeypatch.setattr(compiling, "_process", compiling._Process())
    monkeypatch.setattr(compiling, "WORTH_A_WORD", 0.0)
    compiling.announce(lambda: said.append("compiling"))
    _, middle, top = chain()
    began, working = compiling.time.perf_counter(), compiling.working_time()
    top(VALUES, 2)
    took, worked = compiling.time.perf_counter() - began, compiling.working_time() - working
    assert 0.0 < compiling.compiling_seconds() <= took - worked <= took
    assert worked < 0.1 * took
    middle(VALUES, 2)
    assert said == ["compiling"]
    before = compiling.compiling_seconds()
    top(VALUES, 3)
    assert compiling.compiling_seconds() == before


def test_options_are_compared_as_numba_does():
    from numba.core.compiler import Flags
    from numba.core.targetconfig import TargetConfig

    one, same, other = Flags(), Flags(), Flags()
    same.release_gil, other.release_gil = one.release_gil, not one.release_gil
    for a in (one, same, other):
        assert hash(a) == TargetConfig.__hash__(a)
        for b in (one, same, other):
            assert (a == b) == TargetConfig.__eq__(a, b)
    assert one == same != other
    assert one != 1


CACHED = """
import numpy as np
from windmark.geometry._jit import nb

@nb.njit(cache=True, nogil=True)
def low(values, k):
    if k < 0:
        raise ValueError("no such place", k)
    return values[k] + values[3]

@nb.njit(cache=True, nogil=True)
def middle(values, k):
    return 2.0 * low(values, k)
"""
FIRST = """
import numpy as np
from lower import low, middle
print(middle(np.arange(4.0), 1), *(sum(k.stats.cache_hits.values()) for k in (low, middle)))
"""
SECOND = """
import sys
import numpy as np
from lower import low, middle
from windmark.geometry._jit import nb

@nb.njit(cache=True, nogil=True)
def top(values, k):
    return middle(values, k) + low(values, k)

if sys.argv[1:]:
    print(middle(np.arange(4.0), 1))
print(top(np.arange(4.0), 1), *(sum(k.stats.cache_hits.values()) for k in (low, middle, top)))
for kernel in (top, middle, low):
    try:
        kernel(np.arange(4.0), -1)
    except ValueError as error:
        print(*error.args)
"""


@pytest.mark.slow
def test_what_was_linked_in_another_run_is_read_and_linked_again(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "lower.py").write_text(CACHED)

    def run(text, *arguments):
        script = tmp_path / "script.py"
        script.write_text(text)
        command = [sys.executable, str(script), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()

    once = 2.0 * (1.0 + 3.0)
    both = once + 1.0 + 3.0
    assert run(FIRST) == [f"{once} 0 0"]
    assert run(FIRST) == [f"{once} 0 1"]
    raised = ["no such place -1"] * 3
    assert run(SECOND) == [f"{both} 0 1 0", *raised]
    assert run(SECOND) == [f"{both} 0 0 1", *raised]
    assert run(SECOND, "and middle") == [f"{once}", f"{both} 0 1 1", *raised]


ARRAYS = """
import numpy as np
from windmark.geometry._jit import nb

@nb.njit(cache=True, nogil=True)
def part(values):
    out = np.empty(len(values))
    for i in range(len(values)):
        out[i] = 2.0 * values[i]
    return out

@nb.njit(cache=True, nogil=True)
def whole(values):
    return part(values)[0]
"""
ORDER = """
import sys
import numpy as np
import arrays
for name in sys.argv[1:]:
    print(getattr(arrays, name)(np.ones(2)))
"""


@pytest.mark.slow
def test_a_part_of_a_read_function_may_be_read_itself(tmp_path, monkeypatch):
    """What it hands to Python needs constants that the part of another function has not."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "arrays.py").write_text(ARRAYS)
    (tmp_path / "script.py").write_text(ORDER)
    for names in (["whole"], ["part"], ["whole", "part"], ["part", "whole"]):
        command = [sys.executable, str(tmp_path / "script.py"), *names]
        said = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
        assert said == ["2.0" if name == "whole" else "[2. 2.]" for name in names]


def test_variables_of_statements_are_found_as_numba_finds_them():
    """In the same order, through lists, dictionaries and other statements, and nothing for what holds none."""
    loc = ir.Loc("here", 1)
    a, b, c = (ir.Var(None, name, loc) for name in "abc")
    call = ir.Expr.call(a, [b, c], (("key", b),), loc)
    found = [
        ir.Assign(call, c, loc), call, ir.Expr.build_map([(a, b), (c, a)], 2, {}, {}, loc),
        ir.Expr.build_tuple([c, b, a], loc), ir.SetItem(a, b, c, loc), ir.Jump(3, loc),
    ]  # fmt: skip
    assert [[v.name for v in one.list_vars()] for one in found] == [
        ["a", "b", "c", "b", "c"], ["a", "b", "c", "b"], ["a", "b", "c", "a"], ["c", "b", "a"], ["a", "b", "c"], [],
    ]  # fmt: skip


def test_calls_that_were_typed_are_known():
    """One search for functions and types that were there before; another for other types."""
    context = registry.cpu_target.typing_context
    context.refresh()
    add = context.resolve_value_type(operator.add)
    first = context.resolve_function_type(add, (types.float64, types.int64), {})
    assert context.resolve_function_type(add, (types.float64, types.int64), {}) is first
    assert first.return_type == types.float64
    assert context.resolve_function_type(add, (types.int64, types.int64), {}).return_type == types.int64
    with pytest.raises(errors.TypingError):
        context.resolve_function_type(add, (types.float64, types.none), {})
