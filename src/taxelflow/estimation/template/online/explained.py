"""Whether a pattern explains a scan.

Chi-square per reading does not show it: most taxels of a pad are silent, and a pattern that lies beside the load
explains all of those.
"""

from __future__ import annotations

import numpy as np

from taxelflow.estimation.template.linearization import LaidOut, look_up
from taxelflow.estimation.template.map import Surface
from taxelflow.estimation.template.online.track_state import Track
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import state_of
from taxelflow.numerics.robust import gate
from taxelflow.runtime.compiling import kernel, lean_kernel

MOST_UNEXPLAINED = 0.5
"""Share of the readings, squared, up to which a pattern explains a scan: it explains more than it leaves."""
_SURELY = 3.0
"""Standard deviations of noise that are no evidence against a pattern."""


@kernel
def unexplained(surface: Surface, taxels: LaidOut, error: float, state: Floats) -> float:
    """Share of the readings, squared, that a pattern leaves at a state (5,), beyond noise.

    taxels: from `linearization.laid_out`, with the error in.
    """
    values = np.empty((2, len(taxels.reading)))
    look_up(surface, taxels, state, values)
    gain, left, whole = state_of(state).gain, 0.0, 0.0
    for i in range(len(taxels.reading)):
        if taxels.variance[i] == 0.0:
            continue
        reading, noise = taxels.reading[i], taxels.variance[i] - error * error
        off = reading - (0.0 if np.isnan(values[0, i]) else gain * values[0, i])
        whole += reading * reading
        if off > 0.0 or reading < taxels.ceiling[i]:
            left += max(off * off - _SURELY * _SURELY * noise, 0.0)
    return left / whole if whole > 0.0 else 0.0


@lean_kernel
def fits(m: Track) -> bool:
    """Whether the last scan fits the pattern where the object was looked for."""
    return bool(m.chi <= gate(m.usual, m.count) and m.unexplained <= MOST_UNEXPLAINED)
