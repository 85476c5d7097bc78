"""Which of two equal forms works on scans: kernels, scan by scan, or NumPy, on a block of them.

A stream steps scan by scan, where calling NumPy would take longer than the work. A recording comes in blocks, which
NumPy works on as fast as a kernel, and without a compile in a first run. Both forms round alike.
"""

from __future__ import annotations


def is_block(scans: int) -> bool:
    """Whether NumPy works on them. Sessions start with no scan: a recording then compiles no kernel of streams."""
    return scans != 1
