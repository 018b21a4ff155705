"""Laws from users' own files, with errors that point at the user's file and line."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np

from windmark.deformation.law import FunctionLaw, LawError, function_law


@dataclass(frozen=True)
class _Watched:
    """A function whose failures are told as its author needs them: file, line, what went wrong."""

    function: Callable[..., Any]
    file: str

    @property
    def __name__(self) -> str:
        return getattr(self.function, "__name__", "law")

    @property
    def __wrapped__(self) -> Callable[..., Any]:
        """What `inspect.signature` looks at."""
        return self.function

    def __call__(self, *args: Any, **options: Any) -> Any:
        try:
            with np.errstate(all="ignore"):  # numbers that are not finite are looked for in what comes out
                return self.function(*args, **options)
        except (Exception, SystemExit) as error:
            raise _told(error, self.file) from error


@dataclass(frozen=True)
class UserLaw(FunctionLaw):
    """A `FunctionLaw` out of a user's file, whose failures are told with its lines."""

    file: str = ""


def laws_of_source(text: str, file: str) -> dict[str, UserLaw]:
    """All laws of a Python file.

    A function made a law by `law`, and any other public function whose first argument is called ``xyz``.

    Parameters
    ----------
    text : its contents
    file : its name, for messages and tracebacks

    Raises
    ------
    LawError
        When it cannot be compiled or run, or holds no law; with file and line.
    """
    module = ModuleType("windmark_user_laws")
    module.__file__ = file
    try:
        exec(compile(text, file, "exec"), module.__dict__)
    except SyntaxError as error:
        raise LawError(f"{file}:{error.lineno}: {error.msg}") from None
    except LawError:
        raise
    except (Exception, SystemExit) as error:
        raise _told(error, file) from error
    out: dict[str, UserLaw] = {}
    for name, value in vars(module).items():
        if isinstance(value, FunctionLaw):
            out[name] = _watched(value, file)
        elif not name.startswith("_") and _is_plain_law(value, file):
            out[name] = _watched(function_law(value), file)
    if not out:
        raise LawError(f"{file}: holds no law; expected a function like  def wing(xyz, tip, twist):  under @law(...)")
    return out


def _told(error: BaseException, file: str) -> LawError:
    """What went wrong in a user's file, with its line."""
    what = f"{type(error).__name__}: {error}"
    if isinstance(error, SystemExit):
        what = (
            f"calls sys.exit({'' if error.code is None else error.code}); a law must return a result, not end windmark"
        )
    return LawError(f"{where(error, file)}: {what}")


def where(error: BaseException, file: str) -> str:
    """Text file:line of the innermost step of a failure that lies in a file; the file alone if none does."""
    lines = [step.lineno for step in traceback.extract_tb(error.__traceback__) if step.filename == file]
    return f"{file}:{lines[-1]}" if lines else file


def _is_plain_law(value: Any, file: str) -> bool:
    code = getattr(value, "__code__", None)
    return code is not None and code.co_filename == file and code.co_varnames[:1] == ("xyz",) and code.co_argcount > 1


def _watched(plain: FunctionLaw, file: str) -> UserLaw:
    given = {name: getattr(plain, name) for name in ("parameters", "options", "source")}
    law = UserLaw(plain.function, **given, file=file)
    return replace(law, function=_Watched(plain.function, file))
