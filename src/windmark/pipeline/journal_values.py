"""Values of a journal as bytes: what is read back may be made of windmark's own nouns and of arrays only."""

from __future__ import annotations

import io as streams
import pickle
from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any

from windmark.deformation.volumes import placed_again

_ARRAYS = {
    "builtins": ("set", "frozenset", "slice", "complex"),
    "pathlib": ("PosixPath", "WindowsPath"),
    "numpy": ("ndarray", "dtype"),
    **dict.fromkeys(("numpy._core.multiarray", "numpy.core.multiarray"), ("_reconstruct", "scalar")),
    **dict.fromkeys(("numpy._core.numeric", "numpy.core.numeric"), ("_frombuffer",)),
}
"""What values are made of besides windmark's nouns: module -> names."""


class _Pickler(pickle.Pickler):
    def __init__(self, stream: streams.BytesIO, names: Mapping[int, str]) -> None:
        super().__init__(stream, protocol=5)
        self._names = names

    def persistent_id(self, obj: Any) -> str | None:
        return self._names.get(id(obj))


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream: streams.BytesIO, named: Mapping[str, Any]) -> None:
        super().__init__(stream)
        self._named = named

    def persistent_load(self, pid: str) -> Any:
        return self._named[pid]

    def find_class(self, module: str, name: str) -> Any:
        """Nothing but arrays, plain containers, and nouns: calling one of these only makes a value."""
        if module in _ARRAYS and name in _ARRAYS[module]:
            return super().find_class(module, name)
        if module.split(".")[0] == "windmark" and "." not in name:
            found = super().find_class(module, name)
            if found is placed_again or (
                isinstance(found, type) and (is_dataclass(found) or issubclass(found, tuple))
            ):
                return found
        raise pickle.UnpicklingError(f"{module}.{name} has no place in a journal")


def dumped(value: Any, names: Mapping[int, str]) -> bytes:
    """A value as bytes; the objects of ``names`` (by id) are referred to."""
    stream = streams.BytesIO()
    _Pickler(stream, names).dump(value)
    return stream.getvalue()


def loaded(content: bytes, named: Mapping[str, Any]) -> Any:
    """A value from bytes, with the objects that it refers to."""
    return _Unpickler(streams.BytesIO(content), named).load()
