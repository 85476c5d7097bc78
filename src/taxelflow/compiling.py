"""How kernels are compiled: once, cached on disk, announced, and before a loop starts."""

from __future__ import annotations

import logging
from contextlib import contextmanager
from functools import cache
from hashlib import sha256
from pathlib import Path
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
    _date(compiled, _sources())
    return cast("Kernel", compiled)


def _date(compiled: Any, sources: str) -> None:
    """Have a cached kernel compiled anew when any of our kernels has changed: it may hold that one.

    numba looks at a kernel's own file only, and has no public way to say more. Without a place to write to there is no
    cache, and nothing to date.
    """
    index = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if index is not None:
        index._source_stamp = (index._source_stamp, sources)


@cache
def _sources() -> str:
    return hash_of(Path(__file__).parent)


def hash_of(root: Path) -> str:
    """A hash that changes with any file in a folder that has kernels, or with what they know of messages."""
    files = [(file.name, file.read_bytes()) for file in sorted(root.rglob("*.py"))]
    held = [code for name, code in files if b"taxelflow.compiling" in code or name == "messages.py"]
    return sha256(b"".join(held)).hexdigest()


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
