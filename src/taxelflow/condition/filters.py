"""Low-pass and median over time, taxel by taxel, causal: less noise for more lag.

The low-pass is a Butterworth filter of second order at the usual scan rate; the median is of the last few scans and
comes first. Both start again after a gap, in the steady state of the first reading.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.errors import ParameterInvalid
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records, record, records
from taxelflow.runtime.compiling import kernel, routine


class _Trial(NamedTuple):
    """White noise of a made-up pad."""

    scans: int = 20_000
    taxels: int = 8
    settling_scans: int = 2_000
    """White noise that is filtered to measure the noise gain, to 1 %."""


_TRIAL = _Trial()
_MIN_NOISE_SHARE = 0.01
"""A filtered reading below this share of the noise is 0 where the sensor reads 0: clipped taxels have no noise."""


class Biquad:
    """Coefficients of y + a1 y' + a2 y'' = b0 x + b1 x' + b2 x'' (a prime is one scan back)."""

    b0: float
    b1: float
    b2: float
    a1: float
    a2: float


class FilterState:
    """State of one taxel: readings since the start, and that of the low-pass in transposed direct form II."""

    readings: int
    z1: float
    z2: float


class Filters:
    """A running filter.

    noise_gain: standard deviation of white noise after the filter over that before. lag_s: how much older than its scan
    a filtered reading is, for slow changes.
    """

    def __init__(self, taxels: int, lowpass_hz: float, median_scans: int, usual_s: float) -> None:
        """lowpass_hz 0 and median_scans 1: off. usual_s: time from scan to scan. Raises ParameterInvalid."""
        self._biquads = _butterworth(lowpass_hz, usual_s)
        self._median = median_scans
        self.lag_s = usual_s * (_delay(record(Biquad, self._biquads)) + 0.5 * (median_scans - 1))
        self._reset(_TRIAL.taxels)
        noise = np.random.default_rng(0).normal(size=(_TRIAL.scans, _TRIAL.taxels))
        filtered = self.step(noise, np.zeros(_TRIAL.scans, dtype=np.bool_), np.zeros(_TRIAL.taxels))
        self.noise_gain = float(filtered[_TRIAL.settling_scans :].std())
        self._reset(taxels)

    def _reset(self, taxels: int) -> None:
        self._recent, self._states = np.zeros((taxels, self._median)), records(FilterState, taxels)

    def step(self, values: Floats, gap: Bools, noise: Floats) -> Floats:
        """Filtered readings (scans, taxels); a missing one stays missing. noise: (taxels,) before the filter."""
        filtered = np.empty_like(values)
        run_filters(values, gap, noise, self._biquads, self._recent, self._states, filtered)
        return filtered


def _butterworth(lowpass_hz: float, usual_s: float) -> Records:
    """`Biquad` (1,); all pass if lowpass_hz is 0."""
    biquads = records(Biquad, 1)
    if not lowpass_hz:
        biquads["b0"] = 1.0
        return biquads
    if not lowpass_hz * usual_s < 0.4999:
        raise ParameterInvalid(
            "condition.lowpass_hz", lowpass_hz, f"be below half the scan rate, here {0.5 / usual_s:.3g} Hz"
        )
    from scipy.signal import butter

    b0, b1, b2, _, a1, a2 = butter(2, lowpass_hz, fs=1.0 / usual_s, output="sos")[0]  # a0 is 1
    biquads[0] = (b0, b1, b2, a1, a2)
    return biquads


def _delay(f: Biquad) -> float:
    """Group delay at 0 Hz, in scans: the delay of slow changes."""
    b, a = np.array([f.b0, f.b1, f.b2]), np.array([1.0, f.a1, f.a2])
    powers = np.arange(3.0)
    return float(powers @ b / b.sum() - powers @ a / a.sum())


@kernel
def run_filters(
    values: Floats, gap: Bools, noise: Floats, biquads: Records, recent: Floats, states: Records, filtered: Floats
) -> None:
    """Fill filtered (scans, taxels).

    gap: (scans,). noise: (taxels,). biquads: `Biquad` (1,). recent: (taxels, scans of the median), ring buffers of the
    last readings. states: `FilterState` (taxels,).
    """
    for scan in range(len(values)):
        for k in range(values.shape[1]):
            x = values[scan, k]
            state: FilterState = states[k]
            if gap[scan]:
                state.readings = 0
            if np.isnan(x):
                filtered[scan, k] = np.nan
                continue
            y = _low_pass(_running_median(x, recent[k], state), biquads[0], state)
            filtered[scan, k] = 0.0 if x == 0.0 and abs(y) < _MIN_NOISE_SHARE * noise[k] else y


@routine
def _running_median(x: float, recent: Floats, state: FilterState) -> float:
    """Median of the last readings, this one included."""
    n = len(recent)
    recent[state.readings % n] = x
    state.readings += 1
    return float(np.median(recent[: min(state.readings, n)])) if n > 1 else x


@routine
def _low_pass(x: float, f: Biquad, state: FilterState) -> float:
    if state.readings == 1:  # the steady state for this reading
        steady = x * (f.b0 + f.b1 + f.b2) / (1.0 + f.a1 + f.a2)
        state.z2 = f.b2 * x - f.a2 * steady
        state.z1 = f.b1 * x - f.a1 * steady + state.z2
    y = f.b0 * x + state.z1
    state.z1 = f.b1 * x - f.a1 * y + state.z2
    state.z2 = f.b2 * x - f.a2 * y
    return y
