"""SIGINT and SIGTERM end a run or a batch in order, from its first step to its last."""

from __future__ import annotations

import signal
import threading
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from typing import Self


class EndedEarly(KeyboardInterrupt):
    """A signal came before a live run has begun, where nothing has been read or written; or in a batch."""


class Signals:
    """A context in which SIGINT and SIGTERM ask for the end of a run; it may be entered again inside itself.

    asked: set by a signal. Before `begin` a signal also raises EndedEarly, after it a second SIGINT KeyboardInterrupt.
    In another thread than the main one signals are left as they are.
    """

    def __init__(self) -> None:
        self.asked = threading.Event()
        self._began = self._heard = False
        self._before: list[dict[signal.Signals, Any]] = []

    def begin(self) -> None:
        """The source is open: from now on the run ends by itself once it is asked to. Raises EndedEarly."""
        self._began = True
        if self.asked.is_set():  # and what was raised for it was lost in a callback
            raise EndedEarly

    def __enter__(self) -> Self:
        main = threading.current_thread() is threading.main_thread()
        numbers = (signal.SIGINT, signal.SIGTERM) if main else ()
        self._before.append({number: signal.signal(number, self._ask) for number in numbers})
        return self

    def __exit__(self, *_details: object) -> None:
        for number, handler in self._before.pop().items():
            signal.signal(number, handler)

    def _ask(self, number: int, _frame: object) -> None:
        again, self._heard = self._heard, True
        self.asked.set()
        if not self._began:
            raise EndedEarly
        if again and number == signal.SIGINT:
            raise KeyboardInterrupt
