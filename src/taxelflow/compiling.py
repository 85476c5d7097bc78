"""How kernels are compiled: once, cached on disk, announced, and before a loop starts."""

from __future__ import annotations

import logging
import re
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
_ROOT = Path(__file__).parent
_IMPORT = re.compile(rb"^from (taxelflow[\w.]*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)


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
    _date(compiled, hash_of(function.__module__))
    return cast("Kernel", compiled)


def _date(compiled: Any, sources: str) -> None:
    """Recompile a cached kernel when its module, or one that it imports from taxelflow, has changed.

    numba compares the kernel's own file only, and has no public way to add more. Without a writable cache there is
    nothing to date.
    """
    index = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if index is not None:
        index._source_stamp = (index._source_stamp, sources)


@cache
def hash_of(module: str, root: Path = _ROOT) -> str:
    """Hash of a module's source and of all that it imports from the package at `root`, directly or not.

    Modules without kernels count too: a kernel compiles the constants that it imports into its code.
    """
    found: dict[Path, bytes] = {}
    waiting = [module]
    while waiting:
        for file in _files(waiting.pop(), root):
            if file not in found:
                found[file] = file.read_bytes()
                waiting += [
                    f"{package.decode()}.{name}".rstrip(".")
                    for package, names in _IMPORT.findall(found[file])
                    for name in ["", *re.findall(r"\w+", names.decode())]
                ]
    return sha256(b"".join(found[file] for file in sorted(found))).hexdigest()


def _files(module: str, root: Path) -> list[Path]:
    """The file of a module of the package at `root`; none for another package's, or for a name within a module."""
    path = root.parent.joinpath(*module.split("."))
    return [file for file in (path.with_suffix(".py"), path / "__init__.py") if file.is_file() and root in file.parents]


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
