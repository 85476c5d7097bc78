from __future__ import annotations

import numpy as np

from taxelflow.numerics.ring import at, put


def test_a_ring_holds_the_newest_values() -> None:
    ring = np.full(4, np.nan)
    for number in range(7):
        put(ring, number, 10.0 * number)
        assert [at(ring, k) for k in range(max(number - 3, 0), number + 1)] == [
            10.0 * k for k in range(max(number - 3, 0), number + 1)
        ]
