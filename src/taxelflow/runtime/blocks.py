"""Choice between two equal forms of a computation: a kernel, scan by scan, or NumPy, on a block of scans.

A stream has blocks of one or a few scans, for which the calls of NumPy would take longer than the work. A recording has
large blocks, for which NumPy is as fast as a kernel, without compilation in a first run. Both forms round alike.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

_FEW = 64
"""Scans up to which a kernel is faster; blocks of a stream are smaller."""


def is_block(scans: int, kernel: Callable[..., Any]) -> bool:
    """Whether NumPy is used. For a few scans it is used only if the kernel is not compiled; a stream compiles it.

    A session starts with a block of no scans, for which NumPy is used, so that a recording compiles no kernel.
    """
    if scans == 1:
        return False
    return not 0 < scans <= _FEW or not getattr(kernel, "overloads", None)
