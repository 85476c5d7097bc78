"""Calls of a kernel without type inference, for arguments that have the same types in each call.

numba infers the types of all arguments in each call. For a named tuple of five arrays that takes 4 us, as long as many
kernels run: a fifth of a live step of 150 us. Here the types of the first call are used for all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, ParamSpec, TypeVar, cast

import numba
import numpy as np

from taxelflow.runtime.compiling import ROUTINES

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
_known: dict[Any, tuple[tuple[Any, ...], Callable[..., Any]]] = {}
"""Types and compiled code by kernel and kinds of its arguments: numba needs 1 ms to infer the types of records."""


class Settled(Generic[Arguments, Result]):
    """A kernel bound to the types of its first call. Each session makes its own, with the same types in all calls.

    Arguments of other types would be misread in memory. So tests set `checked`, which verifies the types of each call.
    """

    __slots__ = ("_kernel", "_kinds", "_run", "_types")
    checked = False

    def __init__(self, kernel: Callable[Arguments, Result]) -> None:
        self._kernel = kernel
        self._types: tuple[Any, ...] = ()
        self._kinds: tuple[object, ...] = ()
        self._run: Callable[Arguments, Result] | None = None

    def __call__(self, *arguments: Arguments.args, **named: Arguments.kwargs) -> Result:
        """Run the kernel; the first call compiles it if need be. Arguments are given by place."""
        if self._run is None:
            result = self._kernel(*arguments, **named)
            self._settle(arguments)
            return result
        if Settled.checked:
            self._check(arguments)
        return self._run(*arguments, **named)

    def _settle(self, arguments: tuple[object, ...]) -> None:
        """Keep the code that was compiled for these arguments. Python's own functions are kept as they are."""
        compiled = getattr(self._kernel, "overloads", None)
        if compiled is None:
            if Settled.checked and self._kernel in ROUTINES:
                raise TypeError(f"{self._kernel} is a routine, which called from Python is plain Python")
            self._run = self._kernel
            return
        self._kinds = _kinds_of(arguments)
        key = self._kernel, self._kinds
        if key not in _known:
            types = _types_of(arguments)
            _known[key] = types, compiled[types].entry_point
        self._types, run = _known[key]
        self._run = cast("Callable[Arguments, Result]", run)

    def _check(self, arguments: tuple[object, ...]) -> None:
        """Compare what determines numba's types: inferring them takes 0.5 ms for an array of records."""
        if self._types and _kinds_of(arguments) != self._kinds and _types_of(arguments) != self._types:
            raise TypeError(f"{self._kernel} was called with {_types_of(arguments)}, first with {self._types}")


def _types_of(arguments: tuple[object, ...]) -> tuple[Any, ...]:
    typeof: Any = numba.typeof
    return tuple(typeof(argument) for argument in arguments)


def _kinds_of(arguments: tuple[object, ...]) -> tuple[object, ...]:
    """What determines numba's types of arguments. An array of one row has two layouts; its type has the first."""
    return tuple(_kind_of(argument) for argument in arguments)


def _kind_of(argument: object) -> object:
    if isinstance(argument, tuple):
        return type(argument), *_kinds_of(argument)
    if not isinstance(argument, np.ndarray | np.generic):
        return type(argument)
    kind, dtype = type(argument), argument.dtype
    if isinstance(argument, np.generic):
        return kind, dtype, dtype.isalignedstruct
    flags = argument.flags
    layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
    return kind, dtype, dtype.isalignedstruct, argument.ndim, layout, flags.writeable
