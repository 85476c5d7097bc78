"""How kernels are compiled: when they are first called, cached on disk, and announced.

A kernel is called from Python; routines are the parts that it is made of. Each kernel is compiled with all its routines
and cached; a routine has no code of its own that Python could call, and costs less (`pipeline`). A routine that is
called both by a kernel and by a routine is compiled twice, as numba's options of the two callers differ: call it from
one level.
"""

from __future__ import annotations

import gc
import logging
import os
import re
import sys
import tempfile
from contextlib import contextmanager
from functools import cache
from hashlib import sha256
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numba
from numba.core import event
from numba.extending import register_jitable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.progress import Progress

    Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_log = logging.getLogger("taxelflow")
_ROOT = Path(__file__).parents[1]
_IMPORT = re.compile(rb"^from (taxelflow[\w.]*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)
_OPTIONS = {"error_model": "numpy", "fastmath": {"reassoc", "contract"}}
"""Sums may be reordered; NaN stays NaN, and a division by 0 is one."""
_TESTED = "0.68."
"""Releases of numba that our pipelines were tested with. Others compile by numba's own, which takes twice as long: the
pipelines use names of numba that its documentation does not have, so they are not even imported."""
_PIPELINES = "taxelflow.runtime.pipeline"
_KERNEL: dict[str, Any] = {}
_ROUTINE: dict[str, Any] = {}
_LEAN: dict[str, Any] = {}
_VECTOR: dict[str, Any] = {}
if numba.__version__.startswith(_TESTED):
    from taxelflow.runtime.pipeline import KernelCompiler, LeanCompiler, RoutineCompiler, VectorCompiler

    _KERNEL["pipeline_class"], _ROUTINE["pipeline_class"] = KernelCompiler, RoutineCompiler
    _LEAN["pipeline_class"], _VECTOR["pipeline_class"] = LeanCompiler, VectorCompiler
_ROUTINE |= {"nogil": True, "no_cfunc_wrapper": True, **_OPTIONS}
_config: Any = numba.config
KERNELS: list[Any] = []
"""All kernels that are imported; `signatures` of each lists for which types it is compiled."""
ROUTINES: set[Callable[..., Any]] = set()
"""All routines that are imported: called from Python they are plain Python, a hundred times as slow."""
_setting = Lock()


def kernel(function: Kernel) -> Kernel:
    """`numba.njit` with a cache, which keeps Python's lock while it runs, and the function's type for mypy.

    A live step calls some twenty kernels of microseconds: each time one gives up the lock, threads of sources and sinks
    run first.
    """
    return _compiled(function, nogil=False)


def exact_kernel(function: Kernel) -> Kernel:
    """A `kernel` that rounds each operation as Python and NumPy do."""
    return _compiled(function, nogil=False, fastmath=False)


def long_kernel(function: Kernel) -> Kernel:
    """A `kernel` that runs without Python's lock: for work of milliseconds, beside which other threads go on."""
    return _compiled(function, nogil=True)


def routine(function: Kernel) -> Kernel:
    """A function that kernels call: it is compiled as part of each of them. Called from Python it is plain Python."""
    return _routine(function, _ROUTINE)


def inlined(function: Kernel) -> Kernel:
    """A `routine` that is always inlined, so that loops over taxels that call it can be vectorised."""
    return _routine(function, _ROUTINE | {"forceinline": True})


def lean_kernel(function: Kernel) -> Kernel:
    """A `routine` that makes no array, and so counts no references: for work of less than the microsecond they take."""
    return _routine(function, _ROUTINE | _LEAN)


def vector_kernel(function: Kernel) -> Kernel:
    """A `lean_kernel` whose loops go several taxels at once, see `vectors`: no turn reads what another one writes."""
    return _routine(function, _ROUTINE | _VECTOR)


def _routine(function: Kernel, options: dict[str, Any]) -> Kernel:
    routine_: Any = register_jitable(**options)
    ROUTINES.add(function)
    return cast("Kernel", routine_(function))


def _compiled(function: Kernel, *, nogil: bool, **options: object) -> Kernel:
    folder = _cache_folder(function)
    compile_: Any = numba.njit
    with _setting:  # numba asks for the folder when it is to cache
        before = _config.CACHE_DIR
        try:
            _config.CACHE_DIR = str(folder) if folder else before
            compiled = compile_(
                cache=folder is not None,
                nogil=nogil,
                no_cfunc_wrapper=True,
                **(_KERNEL | _OPTIONS | options),
            )(function)
        finally:
            _config.CACHE_DIR = before
    KERNELS.append(compiled)
    return cast("Kernel", compiled)


def _cache_folder(function: Callable[..., Any]) -> Path | None:
    """Where a kernel is cached, None if nowhere. The folder is named by the module and a hash of its sources.

    numba itself compares the kernel's own file only, but its routines and constants come from others, too.
    """
    root = _cache_root(_config.CACHE_DIR)
    if root is None or not Path(function.__code__.co_filename).is_file():
        return None
    module = function.__module__
    return root / f"{module}-{hash_of(module)[:16]}"


@cache
def _cache_root(configured: str) -> Path | None:
    """The folder of all caches, None if it cannot be written: NUMBA_CACHE_DIR, else that of the platform."""
    try:
        if configured:
            root = Path(configured)
        elif sys.platform == "win32":
            root = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "taxelflow"
        elif sys.platform == "darwin":
            root = Path.home() / "Library" / "Caches" / "taxelflow"
        else:
            root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "taxelflow"
        root.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=root).close()
    except (OSError, RuntimeError):  # RuntimeError: there is no home
        return None
    return root


@cache
def hash_of(module: str, root: Path = _ROOT) -> str:
    """Hash of a module's source and of all that it imports from the package at `root`, directly or not.

    Modules without kernels count too: a kernel compiles the constants that it imports into its code.
    """
    found = sources_of(module, root)
    return sha256(b"".join(found[file] for file in sorted(found))).hexdigest()


def sources_of(module: str, root: Path = _ROOT) -> dict[Path, bytes]:
    """The source of a module and of all that it imports from the package at `root`, by file, and how it is compiled."""
    found: dict[Path, bytes] = {}
    waiting = [module, _PIPELINES]
    while waiting:
        for file in _files(waiting.pop(), root):
            if file not in found:
                found[file] = file.read_bytes()
                waiting += [
                    f"{package.decode()}.{name}".rstrip(".")
                    for package, names in _IMPORT.findall(found[file])
                    for name in ["", *re.findall(r"\w+", names.decode())]
                ]
    return found


def _files(module: str, root: Path) -> list[Path]:
    """The file of a module of the package at `root`; none for another package's, or for a name within a module."""
    path = root.parent.joinpath(*module.split("."))
    return [file for file in (path.with_suffix(".py"), path / "__init__.py") if file.is_file() and root in file.parents]


class _Compiles(event.Listener):
    """Hears of every compile: pauses the garbage collector, which would find nothing but take a sixth of the time, and
    announces the first compile in a context of `announced`. Loading a cached kernel is no compile and stays silent.
    """

    def __init__(self) -> None:
        self.contexts = 0
        self._depth = 0
        self._collects = False
        self._announced = False
        self._bar: Progress | None = None

    def on_start(self, _event: object) -> None:
        self._depth += 1
        if self._depth > 1:
            return
        self._collects = gc.isenabled()
        gc.disable()
        if self.contexts and not self._announced:
            self._announced = True
            _log.warning(_notice())
        if self.contexts and self._bar is None and sys.stderr.isatty():
            self._bar = _bar()

    def on_end(self, _event: object) -> None:
        self._depth -= 1
        if self._depth:
            return
        if self._collects:
            gc.enable()
        if self._bar is not None:
            self._bar.advance(self._bar.task_ids[0])

    def close(self) -> None:
        """Take the bar away."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


def _notice() -> str:
    if any(compiled.stats.cache_path is not None for compiled in KERNELS):
        return "compiling kernels for this machine, once (up to half a minute; later runs load them from a cache)"
    return (
        "compiling kernels (up to half a minute), as in every run: there is no folder to cache them; set "
        "NUMBA_CACHE_DIR to a folder that can be written"
    )


def _bar() -> Progress:
    """A bar on stderr that counts kernels, as many as are imported and were not called yet."""
    from rich.console import Console
    from rich.progress import Progress

    bar = Progress(console=Console(stderr=True), transient=True)
    bar.add_task("compiling", total=sum(not compiled.signatures for compiled in KERNELS))
    bar.start()
    return bar


_compiles = _Compiles()
event.register("numba:compile", _compiles)


@contextmanager
def announced() -> Iterator[None]:
    """Within this context the first compile is logged to `taxelflow` at level WARNING; a bar shows how it goes on."""
    _compiles.contexts += 1
    try:
        yield
    finally:
        _compiles.contexts -= 1
        if not _compiles.contexts:
            _compiles.close()
