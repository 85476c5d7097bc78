"""Whether a pattern explains a scan.

Chi-square per reading does not show it: most taxels of a pad are silent, and a pattern that lies beside the load
explains all of those.
"""

from __future__ import annotations

import numpy as np

from taxelflow.estimation.template.linearization import LaidOut, pressure_at
from taxelflow.estimation.template.map import Surface
from taxelflow.estimation.template.online.track_state import Track
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import state_of
from taxelflow.numerics.robust import gate
from taxelflow.runtime.compiling import lean_kernel

MOST_UNEXPLAINED = 0.5
"""Share of the readings, squared, up to which a pattern explains a scan: it explains more than it leaves."""
KNOWN_UNEXPLAINED = 0.1
"""The same, up to which a scan shows the object of a pattern; doubt of it is no evidence."""
MISTAKEN = 2
"""After this many scans in a row that do not fit its pattern, it is another object."""
_SURELY = 3.0
"""Standard deviations of noise that are no evidence against a pattern."""


@lean_kernel
def unexplained(surface: Surface, taxels: LaidOut, error: float, state: Floats, centre: Floats) -> float:
    """Share of the readings, squared, that a pattern leaves at a state (5,), beyond noise.

    taxels: from `linearization.laid_out`, with the error in. centre: (2,), filled with the centre of the pressure that
    the pattern shows on them; the state's place if it shows none.
    """
    h, left, low = surface.lattice
    left, low = left / h, low / h
    x, y, theta, gain, size = state_of(state)
    scale = np.exp(-size) / h
    cos_0, sin_0 = scale * np.cos(theta), scale * np.sin(theta)
    remains = whole = total = sx = sy = 0.0
    for i in range(len(taxels.x)):  # without a branch, as vector registers need it
        cos = cos_0 * taxels.cos[i] - sin_0 * taxels.sin[i]
        sin = sin_0 * taxels.cos[i] + cos_0 * taxels.sin[i]
        dx, dy = taxels.x[i] - x, taxels.y[i] - y
        q, _, _ = pressure_at(surface.c, cos * dx + sin * dy - left, cos * dy - sin * dx - low)
        reading, variance = taxels.reading[i], taxels.variance[i]
        model, live = 0.0 if np.isnan(q) else gain * q, variance != 0.0
        off = reading - model
        seen = model if live else 0.0
        total += seen
        sx += seen * dx
        sy += seen * dy
        counts = live and (off > 0.0 or reading < taxels.ceiling[i])
        beyond = off * off - _SURELY * _SURELY * (variance - error * error)
        remains += beyond if counts and beyond > 0.0 else 0.0
        whole += reading * reading if live else 0.0
    centre[0], centre[1] = x, y
    if total > 0.0:
        centre[0], centre[1] = x + sx / total, y + sy / total
    return float(remains / whole) if whole > 0.0 else 0.0


@lean_kernel
def fits(m: Track) -> bool:
    """Whether the last scan fits the pattern where the object was looked for."""
    return bool(m.chi <= gate(m.usual, m.count) and m.unexplained <= MOST_UNEXPLAINED)
