"""How kernels are compiled: once, cached on disk, announced, and before a loop starts."""

from __future__ import annotations

import logging
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar, cast

import numba
from numba.core import event

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import Any

    Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_log = logging.getLogger("taxelflow")


def kernel(function: Kernel) -> Kernel:
    """`numba.njit(cache=True)` that keeps the function's type for mypy. Sums may be reordered; NaN stays NaN."""
    return _compiled(function, nogil=True)


def brief_kernel(function: Kernel) -> Kernel:
    """A `kernel` that keeps Python's lock while it runs: for calls of microseconds beside a thread that works."""
    return _compiled(function, nogil=False)


def inlined(function: Kernel) -> Kernel:
    """A `kernel` that becomes part of the kernels that call it, so that their loops over taxels can be vectorised."""
    return _compiled(function, nogil=True, forceinline=True)


def lean_kernel(function: Kernel) -> Kernel:
    """A `kernel` that makes no array, and so counts no references: for work of less than the microsecond they take."""
    return _compiled(function, nogil=True, _nrt=False)


def _compiled(function: Kernel, *, nogil: bool, **options: bool) -> Kernel:
    compile_: Any = numba.njit
    compiled = compile_(cache=True, nogil=nogil, error_model="numpy", fastmath={"reassoc", "contract"}, **options)(
        function
    )
    return cast("Kernel", compiled)


class _Announce(event.Listener):
    """Says once that numba compiles. Loading a cached kernel is no compile and stays silent."""

    def __init__(self) -> None:
        self.said = False

    def on_start(self, _event: object) -> None:
        if not self.said:
            self.said = True
            _log.warning("compiling kernels for this machine, once (up to a minute; later runs load them from a cache)")

    def on_end(self, _event: object) -> None:
        """Nothing to say: the caller goes on."""


@contextmanager
def announced() -> Iterator[None]:
    """Within this context the first compile is logged to `taxelflow` at level WARNING."""
    with event.install_listener("numba:compile", _Announce()):
        yield
