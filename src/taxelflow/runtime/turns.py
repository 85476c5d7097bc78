"""Threads that take turns quickly, so that one that answers is not held up by one that computes."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

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
