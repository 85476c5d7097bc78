"""Linear algebra of small matrices on one core: BLAS would share each call among all of them, and wait for each."""

from __future__ import annotations

from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import TYPE_CHECKING

import scipy.linalg  # noqa: F401 - its BLAS is found only once it is loaded
from threadpoolctl import OpenBLASController, ThreadpoolController

if TYPE_CHECKING:
    from collections.abc import Iterator


class _Contexts:
    """Contexts that are open now, in all threads.

    OpenBLAS has one count of threads for the process, and threadpoolctl lets a single thread set it until it has left
    its context; what others ask for is ignored. So the first context sets it, and the last one restores it.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._open = 0

    def enter(self) -> None:
        with self._lock:
            if not self._open:
                OpenBLASController.clear_controlling_thread(force=True)
                self._limited = _blas().limit(limits=1)
            self._open += 1

    def leave(self) -> None:
        with self._lock:
            self._open -= 1
            if not self._open:
                OpenBLASController.clear_controlling_thread(force=True)
                self._limited.restore_original_limits()
                OpenBLASController.clear_controlling_thread(force=True)


_contexts = _Contexts()


@contextmanager
def on_one_core() -> Iterator[None]:
    """Within this context BLAS uses a single thread, until the last thread has left it."""
    _contexts.enter()
    try:
        yield
    finally:
        _contexts.leave()


@cache
def _blas() -> ThreadpoolController:
    """The BLAS libraries, which take a millisecond to find."""
    return ThreadpoolController().select(user_api="blas")
