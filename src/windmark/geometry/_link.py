"""Kernels compiled as a C compiler does it: every function once, machine code only for what Python calls.

Numba on its own optimises and emits machine code for each function *with all that it calls*, and makes wrappers for
calls from Python, level by level: a helper five calls down is optimised and emitted six times. More than half of the
time of a first use went there. Here a function that is met while another one is compiled stays as it was lowered; what
Python calls is linked with all functions below it, and optimised and emitted once. A function that is called both ways
is linked when Python first calls it. On disk are only the linked ones, and beside the machine code the functions as
they were before optimisation, for kernels of another run that call them: same code whatever was compiled first.

This reaches into numba's inner classes (``KNOWN`` names what it needs). Where they are not as known, numba links as it
always does: the same results, a longer first use.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import llvmlite.binding as llvm
from numba import _dynfunc
from numba.core import caching, codegen, cpu, environment, registry, sigutils
from numba.core.compiler import Flags
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher
from numba.core.environment import lookup_environment
from numba.core.types.misc import Omitted, unliteral
from numba.core.typing.typeof import typeof

from windmark.compiling import compiled, waiting
from windmark.geometry import _remembered
from windmark.geometry._shipped import Shipped

__all__ = ["Kernel", "install"]

KNOWN: dict[Any, tuple[str, ...]] = {
    codegen.JITCodeLibrary: (
        "_finalize_final_module",
        "_finalize_specific",
        "_get_module_for_linking",
        "_optimize_final_module",
        "_unserialize",
        "add_linking_library",
        "serialize_using_object_code",
    ),
    codegen.JITCPUCodegen: ("_check_llvm_bugs", "_library_class", "set_env"),
    cpu.CPUContext: ("create_cfunc_wrapper", "create_cpython_wrapper", "get_executable", "push_code_library"),
    Dispatcher: ("add_overload", "compile", "enable_caching"),
    caching.FunctionCache: ("_index_key", "_load_overload", "save_overload"),
    caching.IndexDataCacheFile: ("load",),
    **_remembered.KNOWN,
}
_ENVIRONMENT = "_ZN08NumbaEnv"  # numba's prefix of the constants that a function's error messages use


class _Depth:
    """How many functions are being compiled, each for the one before: under numba's compiler lock, so of one thread."""

    now = 0

    @contextmanager
    def deeper(self) -> Iterator[None]:
        self.now += 1
        try:
            yield
        finally:
            self.now -= 1


_DEPTH = _Depth()


class Library(codegen.JITCodeLibrary):
    """Functions as lowered until somebody wants machine code; then these, with all that they call."""

    _shared_module: Any
    _linking_libraries: list[Any]
    _unlinked: bytes | None = None
    _environments: tuple[Any, ...] = ()

    def add_linking_library(self, library: Any) -> None:
        self._linking_libraries.append(library)

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None:
            module = llvm.parse_bitcode(self._bitcode())
            if self._finalized:  # all that is called is in it
                self._linking_libraries = []
            for function in module.functions:
                if not function.is_declaration and function.linkage == llvm.Linkage.external:
                    function.linkage = "linkonce_odr"
            self._shared_module = module
        return self._shared_module

    def _bitcode(self) -> bytes:
        if self._finalized and self._unlinked is not None:
            return zlib.decompress(self._unlinked)
        return bytes(self._final_module.as_bitcode())

    def finalize(self) -> None:
        self._codegen._check_llvm_bugs()
        self._raise_if_finalized()
        for library in _called(self):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._unlinked = zlib.compress(self._final_module.as_bitcode(), 1)
        self._environments = tuple(_environments(self._final_module))
        self._optimize_final_module()
        self._final_module.verify()
        self._finalize_final_module()

    def _finalize_specific(self) -> None:
        super()._finalize_specific()
        for one in _environments(self._final_module):
            self._codegen.set_env(one.env_name, one)

    def serialize_using_object_code(self) -> tuple[Any, ...]:
        self._ensure_finalized()
        module = self._final_module
        names = [v.name for of in (module.functions, module.global_variables) for v in of if not v.is_declaration]
        kept = tuple(one for one in self._environments if one.can_cache())
        return (self.name, "linked", (self._get_compiled_object(), names, self._unlinked, kept))

    @classmethod
    def _unserialize(cls, codegen: Any, state: tuple[Any, ...]) -> Any:
        name, kind, data = state
        if kind != "linked":
            return super()._unserialize(codegen, state)
        self = codegen.create_library(name)
        compiled, names, self._unlinked, self._environments = data
        self.enable_object_caching()
        self._set_compiled_object(compiled)
        self._finalize_final_module()
        self._codegen._engine._defined_symbols.update(names)
        return self


def _called(library: Any) -> list[Any]:
    """All libraries that one needs, each once."""
    found: dict[Any, None] = {}
    open_ = list(library._linking_libraries)
    while open_:
        one = open_.pop()
        if one not in found and one is not library:
            found[one] = None
            if isinstance(one, Library):
                one._get_module_for_linking()
                open_.extend(one._linking_libraries)
    return list(found)


def _environments(module: Any) -> Iterator[Any]:
    for variable in module.global_variables:
        if variable.name.startswith(_ENVIRONMENT):
            found = lookup_environment(variable.name)
            if found is not None:
                yield found


class _Context(cpu.CPUContext):
    """Numba's, but functions that are compiled for another one get neither wrappers nor machine code."""

    def create_cpython_wrapper(self, *args: Any, **options: Any) -> None:
        if not _DEPTH.now:
            super().create_cpython_wrapper(*args, **options)

    def create_cfunc_wrapper(self, *args: Any, **options: Any) -> None:
        if not _DEPTH.now:
            super().create_cfunc_wrapper(*args, **options)

    def get_executable(self, library: Any, fndesc: Any, env: Any) -> Any:
        if not _DEPTH.now or library._finalized:
            return super().get_executable(library, fndesc, env)
        # The name under which callers find it; nobody calls it.
        name = fndesc.qualname.split(".")[-1]
        return _dynfunc.make_function(fndesc.lookup_module(), name, "not linked", 0, env, (library,))


class _Linked(caching.FunctionCache):
    """On disk are functions that Python calls: compiled here, or brought by the package."""

    def __init__(self, function: Any, brought: Shipped | None) -> None:
        super().__init__(function)
        self._brought = brought

    def _load_overload(self, sig: Any, context: Any) -> Any:
        found = super()._load_overload(sig, context)
        if found is not None or self._brought is None:
            return found
        source, name = self._py_func.__code__.co_filename, self._impl.filename_base
        stamp, key = self._impl.locator.get_source_stamp(), self._index_key(sig, context.codegen())
        data = self._brought.load(source, name, stamp, key)
        return None if data is None else self._impl.rebuild(context, data)

    def save_overload(self, sig: Any, data: Any) -> None:
        if data.library._finalized:
            super().save_overload(sig, data)


class Kernel(registry.CPUDispatcher):
    """A compiled function, linked when Python calls it; who waits for that is told how long (`windmark.compiling`)."""

    def enable_caching(self, brought: Shipped | None = None) -> None:
        """Keep what is compiled on the disk, and take from there what was; ``brought`` came with the package."""
        self._cache = _Linked(self.py_func, brought)

    def add_overload(self, cres: Any) -> None:
        if cres.library._finalized:
            super().add_overload(cres)
        else:
            self.overloads[tuple(cres.signature.args)] = cres

    def get_call_template(self, args: Any, kws: Any) -> Any:
        pysig, folded = self._compiler.fold_argument_types(args, kws)
        return (super().get_call_template(tuple(map(_plain, folded)), {})[0], pysig, tuple(map(_plain, folded)), {})

    def compile(self, sig: Any) -> Any:
        with waiting(), global_compiler_lock:
            if _DEPTH.now:  # for another kernel, which calls it
                return super().compile(sig)
            start = time.perf_counter()
            with _DEPTH.deeper():
                entry = super().compile(sig)
            result = self.overloads[tuple(sigutils.normalize_signature(sig)[0])]
            if not result.library._finalized:
                entry = self._link(sig, result)
            if result.metadata is not None:  # none: it was on the disk
                compiled(time.perf_counter() - start)
            return entry

    def _link(self, sig: Any, lowered: Any) -> Any:
        """Machine code of a function with all that it calls, and the way in from Python."""
        context, library = lowered.target_context, lowered.library
        try:
            with context.push_code_library(library):
                context.create_cpython_wrapper(
                    library,
                    lowered.fndesc,
                    lowered.environment,
                    lowered.call_helper,
                    release_gil=bool(self.targetoptions.get("nogil")),
                )
            entry = context.get_executable(library, lowered.fndesc, lowered.environment)
        except BaseException:  # half linked: the next call starts anew
            self.overloads.pop(tuple(lowered.signature.args), None)
            raise
        context.insert_user_function(entry, lowered.fndesc, [library])
        linked = lowered._replace(entry_point=entry)
        self.add_overload(linked)
        self._cache.save_overload(sig, linked)
        return entry


def _plain(type_: Any) -> Any:
    """`f(x, 0)`, `f(x, n)` and f(x) with its default are one function: numba compiles one for each."""
    if isinstance(type_, Omitted) and isinstance(type_.value, bool | int | float):
        return typeof(type_.value)
    return unliteral(type_)


_numbas_rebuild = environment._rebuild_env


def _rebuild_environment(module: str, constants: list[Any], name: str) -> Any:
    """As numba's, which takes the first that it reads: but a function that was linked has constants of its wrapper
    behind those that it had as a part of others.
    """
    found = _numbas_rebuild(module, constants, name)
    found.consts.extend(constants[len(found.consts) :])
    return found


_DEFAULTS = {name: option.default for name, option in Flags.options.items()}
_NAMES = hash(tuple(sorted(_DEFAULTS)))  # as numba has it: of the options' names


def _equal(self: Any, other: Any) -> Any:
    """As numba's, which takes the 30 options one by one, for each call that it types: a sixth of its time."""
    if not isinstance(other, Flags):
        return NotImplemented
    return self._values == other._values or {**_DEFAULTS, **self._values} == {**_DEFAULTS, **other._values}


def _hash_of_names(_: Any) -> int:
    return _NAMES


def install() -> bool:
    """Prepare numba's compiler of this process; False where it is not as known."""
    if not all(hasattr(of, name) for of, names in KNOWN.items() for name in names):
        return False
    context = registry.cpu_target.target_context
    made = context.codegen()
    if type(context) is not cpu.CPUContext or made._library_class is not codegen.JITCodeLibrary:
        return False
    context.__class__ = _Context
    made._library_class = Library
    environment._rebuild_env = _rebuild_environment
    Flags.__eq__, Flags.__hash__ = _equal, _hash_of_names
    _remembered.install_memory()
    return True
