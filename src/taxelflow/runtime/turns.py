"""Threads that take turns quickly, so that one that answers is not held up by one that computes; starts in one go."""

from __future__ import annotations

import gc
import sys
from contextlib import contextmanager
from threading import Event
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_SWITCH_S = 2e-3
"""How long one thread may keep Python's lock while another one waits; the default of 5 ms is a scan at 200 Hz."""


@contextmanager
def quick_turns() -> Iterator[None]:
    """For a while."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


@contextmanager
def uncollected() -> Iterator[Callable[[], None]]:
    """Without garbage collection until what this gives is called, or to the end: a tenth of the time of a start goes
    into the search for garbage among what has just been imported. Later searches leave out what there is by then.
    """
    before, started = gc.isenabled(), Event()
    gc.disable()

    def start() -> None:
        if not started.is_set():
            started.set()
            gc.freeze()
            if before:
                gc.enable()

    try:
        yield start
    finally:
        start()
