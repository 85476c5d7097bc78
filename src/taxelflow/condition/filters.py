"""Low-pass and median over time, taxel by taxel, causal: what they take from the noise they add to the lag.

The low-pass is a Butterworth filter of second order at the usual scan rate; the median is of the last few scans and
comes first. Both begin anew after a gap, as if the first reading had always been there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.errors import ParameterInvalid
from taxelflow.messages import Bools, Floats

if TYPE_CHECKING:
    from numpy.typing import NDArray

_TRIAL_SCANS, _TRIAL_TAXELS, _SETTLING = 20_000, 8, 2_000
_NOTHING = 0.01
"""A filtered reading below this share of the noise is 0 again where the sensor says 0: clipped taxels have no noise."""


class Filters:
    """A running filter and its memory. noise_gain: standard deviation of white noise after it over that before.
    lag_s: how much older than its scan the filtered reading is, for slow changes.
    """

    def __init__(self, taxels: int, lowpass_hz: float, median_scans: int, usual_s: float) -> None:
        """lowpass_hz 0 and median_scans 1: off. usual_s: time from scan to scan. Raises ParameterInvalid."""
        self._sos = _butterworth(lowpass_hz, usual_s)
        self._median = median_scans
        self.lag_s = usual_s * (_delay(self._sos) + 0.5 * (median_scans - 1))
        self._begin(_TRIAL_TAXELS)
        noise = np.random.default_rng(0).normal(size=(_TRIAL_SCANS, _TRIAL_TAXELS))
        calm = self.step(noise, np.zeros(_TRIAL_SCANS, dtype=np.bool_), np.zeros(_TRIAL_TAXELS))
        self.noise_gain = float(calm[_SETTLING:].std())
        self._begin(taxels)

    def _begin(self, taxels: int) -> None:
        self._last, self._seen = np.zeros((taxels, self._median)), np.zeros(taxels, dtype=np.int64)
        self._state = np.zeros((taxels, 2))

    def step(self, values: Floats, gap: Bools, noise: Floats) -> Floats:
        """Filtered readings (scans, taxels); a missing one stays missing. noise: (taxels,) before the filter."""
        out = np.empty_like(values)
        run_filters(values, gap, noise, self._sos, self._last, self._seen, self._state, out)
        return out


def _butterworth(lowpass_hz: float, usual_s: float) -> Floats:
    """(5,) b0, b1, b2, a1, a2; all pass if lowpass_hz is 0."""
    if not lowpass_hz:
        return np.array([1.0, 0.0, 0.0, 0.0, 0.0])
    if not lowpass_hz * usual_s < 0.4999:
        raise ParameterInvalid(
            "condition.lowpass_hz", lowpass_hz, f"be below half the scan rate, here {0.5 / usual_s:.3g} Hz"
        )
    from scipy.signal import butter

    section = np.asarray(butter(2, lowpass_hz, fs=1.0 / usual_s, output="sos"), dtype=np.float64)[0]
    return np.delete(section, 3)  # a0 is 1


def _delay(sos: Floats) -> float:
    """Delay of slow changes, in scans: the group delay at 0 Hz."""
    b, a = sos[:3], np.array([1.0, *sos[3:]])
    powers = np.arange(3.0)
    return float(powers @ b / b.sum() - powers @ a / a.sum())


@kernel
def run_filters(
    values: Floats,
    gap: Bools,
    noise: Floats,
    sos: Floats,
    last: Floats,
    seen: NDArray[np.int64],
    state: Floats,
    out: Floats,
) -> None:
    """Fill out (scans, taxels). last: (taxels, n) readings of the median, seen: (taxels,) how many came since the
    start, state: (taxels, 2) of the low-pass, transposed direct form II.
    """
    n = last.shape[1]
    for scan in range(len(values)):
        for k in range(values.shape[1]):
            x = values[scan, k]
            out[scan, k] = np.nan
            if gap[scan]:
                seen[k] = 0
            if np.isnan(x):
                continue
            last[k, seen[k] % n] = x
            seen[k] += 1
            middle = np.median(last[k, : min(seen[k], n)]) if n > 1 else x
            if seen[k] == 1:  # the state in which it would be, had this reading always been there
                settled = middle * (sos[0] + sos[1] + sos[2]) / (1.0 + sos[3] + sos[4])
                state[k, 1] = sos[2] * middle - sos[4] * settled
                state[k, 0] = sos[1] * middle - sos[3] * settled + state[k, 1]
            y = sos[0] * middle + state[k, 0]
            state[k, 0] = sos[1] * middle - sos[3] * y + state[k, 1]
            state[k, 1] = sos[2] * middle - sos[4] * y
            out[scan, k] = 0.0 if x == 0.0 and abs(y) < _NOTHING * noise[k] else y
