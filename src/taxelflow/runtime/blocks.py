"""Which of two equal forms works on scans: kernels, scan by scan, or NumPy, on a block of them.

A stream steps scan by scan, or by a few of them when they have waited, where calling NumPy would take longer than the
work. A recording comes in blocks, which NumPy works on as fast as a kernel, and without a compile in a first run. Both
forms round alike.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

_FEW = 64
"""Up to here a kernel is quicker; a stream's scans that have waited are fewer."""


def is_block(scans: int, kernel: Callable[..., Any]) -> bool:
    """Whether NumPy works on them: on a few scans only if the kernel is not compiled, as it is where a stream runs.

    Sessions start with no scan: a recording then compiles no kernel of streams.
    """
    if scans == 1:
        return False
    return not 0 < scans <= _FEW or not getattr(kernel, "overloads", None)
