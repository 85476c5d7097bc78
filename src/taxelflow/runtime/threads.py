"""Python's thread switch interval and garbage collection, set so that a live step is not delayed."""

from __future__ import annotations

import gc
import sys
from contextlib import contextmanager
from threading import Event
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_SWITCH_S = 2e-3
"""How long one thread may keep Python's lock while another one waits; the default of 5 ms is a scan at 200 Hz."""


class _Collections(NamedTuple):
    """Garbage collections of a live run, which makes a few dozens of objects a second that are garbage."""

    objects: int = 700
    young: int = 1
    """New objects before a collection of these, and such collections before one of the middle generation: Python's
    default of 10 makes that one search thousands of objects at once, for 1.5 to 3 ms."""
    old: int = 1000
    """Those of the middle generation before one of the oldest: some minutes."""


@contextmanager
def short_collections() -> Iterator[None]:
    """Collect garbage more often, and less of it at once."""
    before = gc.get_threshold()
    gc.set_threshold(*_Collections())
    try:
        yield
    finally:
        gc.set_threshold(*before)


@contextmanager
def quick_turns() -> Iterator[None]:
    """Switch between threads more often, so that a thread that answers does not wait for one that computes."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


@contextmanager
def uncollected() -> Iterator[Callable[[], None]]:
    """Pause garbage collection until the function that this yields is called, or until the end.

    Searching what has just been imported for garbage takes a tenth of the time of a start. Later collections skip the
    objects that exist by then.
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
