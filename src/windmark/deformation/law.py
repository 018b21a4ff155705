"""Deformation laws: points and parameters in, displaced points out (AIAA 2005-5007, section V).

A law is a plain function of NumPy arrays, written by whoever knows the model's mechanics::

    @law(tip="mm", twist="deg")
    def wing(xyz, tip, twist, *, root=72.0, span=600.0):
        ...
        return displaced                                  # (N, 3)

Positional arguments after the points are the parameters, keyword-only ones are options that a project file sets.
Built-in laws (`windmark.deformation.laws`) follow the same protocol but know their derivatives.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.deformation.parameter import Parameter
from windmark.errors import WindmarkError

Array = NDArray[np.float64]
Function = Callable[..., Any]


class BoundLaw(Protocol):
    """A law for points that stay the same while its parameters change."""

    def place(self, q: Array) -> Array:
        """Displaced points (N, 3) for parameters (k,)."""

    def linearise(self, q: Array) -> tuple[Array, Array]:
        """Displaced points (N, 3) and their derivative (N, 3, k) by the parameters."""


class Law(Protocol):
    """What the identification asks of a law."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters, in the order of q."""

    def bind(self, xyz: Array) -> BoundLaw:
        """The law for points (N, 3) of the undeformed model, in its frame."""


class LawError(WindmarkError):
    """A law that cannot be used; the message names the file and line where it went wrong."""


@dataclass(frozen=True)
class Numeric:
    """A bound law whose derivative is taken by central differences, exact to about 1e-9 of the displacement.

    Parameters
    ----------
    function : q (k,) -> (N, 3)
    steps : (k,) change of each parameter
    lower, upper : (k,) bounds, where the differences become one-sided; None for none
    """

    function: Callable[[Array], Array]
    steps: Array
    lower: Array | None = None
    upper: Array | None = None

    def place(self, q: Array) -> Array:
        """See `BoundLaw`."""
        return self.function(q)

    def linearise(self, q: Array) -> tuple[Array, Array]:
        """See `BoundLaw`."""
        here = self.function(q)
        out = np.empty((*here.shape, len(q)))
        high = q + self.steps if self.upper is None else np.minimum(q + self.steps, self.upper)
        low = q - self.steps if self.lower is None else np.maximum(q - self.steps, self.lower)
        for j in range(len(q)):
            ahead, behind = q.copy(), q.copy()
            ahead[j], behind[j] = high[j], low[j]
            a, b = self._beside(ahead, here), self._beside(behind, here)
            # At the edge of where a law gives numbers (an arcsin near 1) one side tells.
            if not np.isfinite(a).all():
                a, ahead = here, q
            if not np.isfinite(b).all():
                b, behind = here, q
            with np.errstate(invalid="ignore"):
                out[..., j] = (a - b) / (ahead[j] - behind[j])
        return here, out

    def _beside(self, q: Array, here: Array) -> Array:
        """The points at a small change; no numbers where the law raises there."""
        try:
            return self.function(q)
        except LawError:
            return np.full_like(here, np.nan)


@dataclass(frozen=True)
class Linear:
    """A bound law that is linear in its parameters.

    Parameters
    ----------
    xyz : (N, 3) points where all parameters are 0
    shapes : (N, 3, k) displacement by one unit of each parameter
    """

    xyz: Array
    shapes: Array

    def place(self, q: Array) -> Array:
        """See `BoundLaw`."""
        return np.asarray(self.xyz + self.shapes @ q)

    def linearise(self, q: Array) -> tuple[Array, Array]:
        """See `BoundLaw`."""
        return self.place(q), self.shapes


@dataclass(frozen=True)
class FunctionLaw:
    """A law from a plain function.

    Parameters
    ----------
    function : ``function(xyz, *parameters, **options) -> (N, 3)``
    parameters : its parameters, in the order of its positional arguments
    options : what its keyword-only arguments are set to
    source : where it was written, "file.py:12", for messages
    """

    function: Function
    parameters: tuple[Parameter, ...]
    options: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""

    @property
    def name(self) -> str:
        """The function's name."""
        return getattr(self.function, "__name__", "law")

    @property
    def where(self) -> str:
        """File, line and name, for messages."""
        return f"{self.source}: law {self.name}" if self.source else f"law {self.name}"

    @property
    def settings(self) -> dict[str, Any]:
        """Its options and what they are set to."""
        arguments = _signature(self.function).parameters.values()
        return {**{p.name: p.default for p in arguments if p.kind is p.KEYWORD_ONLY}, **self.options}

    def __call__(self, xyz: ArrayLike, *q: float, **options: Any) -> Array:
        """Displaced points, as the function itself gives them."""
        return np.asarray(self.function(np.asarray(xyz, dtype=float), *q, **{**self.options, **options}), dtype=float)

    def with_options(self, options: Mapping[str, Any]) -> FunctionLaw:
        """The law with keyword-only arguments set.

        Raises
        ------
        LawError
            For an option that the function does not have.
        """
        unknown = sorted(set(options) - set(self.settings))
        if unknown:
            has = ", ".join(self.settings) or "none (options are arguments after a *)"
            raise LawError(f"{self.where}: has no option {unknown[0]}; it has {has}")
        return replace(self, options={**self.options, **options})

    def bind(self, xyz: Array) -> Numeric:
        """See `Law`."""

        def place(q: Array) -> Array:
            # A copy, so that a law that writes into its points harms nobody.
            out = np.asarray(self.function(xyz.copy(), *q.tolist(), **self.options))
            if out.dtype.kind not in "fiu":
                raise LawError(f"{self.where}: must return numbers (N, 3), got {out.dtype}")
            if out.dtype.kind == "f" and out.dtype.itemsize < 8:
                # Derivatives are differences: of 7 digits nothing is left, and the search never settles.
                raise LawError(f"{self.where}: must return numbers of 16 digits (float64), got {out.dtype}")
            if out.shape != xyz.shape:
                raise LawError(f"{self.where}: must return {xyz.shape}, like its points, got {out.shape}")
            return np.asarray(out, dtype=float)

        column = {key: np.array([getattr(p, key) for p in self.parameters]) for key in ("step", "lower", "upper")}
        return Numeric(place, column["step"], column["lower"], column["upper"])


def law(**units: str | Parameter | Mapping[str, Any]) -> Callable[[Function], FunctionLaw]:
    """Make a law of a function; its parameters are the positional arguments after the points.

    Parameters
    ----------
    units : parameter -> unit, or everything that `Parameter` takes: ``tip={"unit": "mm", "sigma": 20.0}``.
        Parameters that are not mentioned are pure numbers

    Raises
    ------
    LawError
        When a name is given that is no argument of the function, or the function has no parameter.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> @wm.law(tip={"unit": "mm", "sigma": 20.0})
    ... def bend(xyz, tip, *, span=400.0):
    ...     return xyz + np.outer((xyz[:, 1] / span) ** 2, [0.0, 0.0, tip])
    >>> [(p.name, p.unit, p.sigma) for p in bend.parameters]
    [('tip', 'mm', 20.0)]
    >>> bend.bind(np.array([[0.0, 200.0, 0.0], [0.0, 400.0, 0.0]])).place(np.array([8.0])).tolist()
    [[0.0, 200.0, 2.0], [0.0, 400.0, 8.0]]
    """

    def make(function: Function) -> FunctionLaw:
        return function_law(function, units)

    return make


def function_law(function: Function, units: Mapping[str, Any] | None = None) -> FunctionLaw:
    """See `law`."""
    units = dict(units or {})
    code = getattr(function, "__code__", None)
    source = f"{code.co_filename}:{code.co_firstlineno}" if code is not None else ""
    name = getattr(function, "__name__", "law")
    where = f"{source}: law {name}"
    arguments = list(_signature(function).parameters.values())
    if any(p.kind in (p.VAR_POSITIONAL, p.VAR_KEYWORD) for p in arguments):
        raise LawError(f"{where}: *args and **kwargs have no names; expected every parameter by its own name")
    names = [p.name for p in arguments if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)][1:]
    if not names:
        raise LawError(f"{where}: has no parameter; expected def {name}(xyz, parameter, ...)")
    unknown = sorted(set(units) - set(names))
    if unknown:
        raise LawError(f"{where}: has no parameter {unknown[0]}; it has {', '.join(names)}")
    unset = [p.name for p in arguments if p.kind is p.KEYWORD_ONLY and p.default is p.empty]
    starts = {p.name: p.default for p in arguments if p.default is not p.empty and p.kind is not p.KEYWORD_ONLY}
    if unset:
        raise LawError(f"{where}: option {unset[0]} needs a default, ``{unset[0]}=...``")
    return FunctionLaw(
        function, tuple(_parameter(n, units.get(n, ""), starts.get(n), where) for n in names), {}, source
    )


def _parameter(name: str, what: str | Parameter | Mapping[str, Any], start: float | None, where: str) -> Parameter:
    try:
        if isinstance(what, Parameter):
            return replace(what, name=name)
        given: dict[str, Any] = {"unit": what} if isinstance(what, str) else dict(what)
        if start is not None:
            given.setdefault("start", float(start))
        return Parameter(name, **given)
    except (TypeError, ValueError) as error:
        raise LawError(f"{where}: parameter {name}: {error}") from None


def _signature(function: Function) -> inspect.Signature:
    try:
        return inspect.signature(function)
    except (TypeError, ValueError):
        raise LawError(f"law {function!r}: expected a function written in Python") from None
