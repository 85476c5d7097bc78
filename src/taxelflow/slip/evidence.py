"""Has the object moved, or was its load only redistributed? A likelihood ratio per bin, and odds over the bins.

Logarithms of the unexplained change of a pattern (`pattern_change.py`) are about normal. At rest their mean is that of
the change that every soft skin shows, of growth under load and of noise; in a slip the change is several times as
large. So are those of the spread of the change of shear (`shear_change.py`), where a sensor has it, and the ratio is
that of both together. A two-state Markov chain, "rests" and "slides", turns ratios into odds: forward for a stream,
forward and backward for a recording.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from taxelflow.messages import Bools, Floats


@dataclass(frozen=True, slots=True)
class _Change:
    """Model of the unexplained change of a pattern, and of the spread of the change of shear."""

    at_rest: float = 0.015
    """Unexplained change within 0.3 s of an object at rest on a soft skin, share of the pattern: the median of ten
    recordings is between 0.5 and 2 %."""
    exponent: float = 0.25
    """Power of time with which that grows: ten recordings, medians of 1.0 % in 0.3 s, 1.3 % in 1.2 s, 1.6 % in 2.2
    s."""
    growth: float = 0.2
    """Unexplained change per change of the log load, of a contact not known yet: a patch that grows changes its
    pattern. Ten recordings: 0.1. A Gaussian patch whose width grows as the cube root of its load: 0.33. A patch that
    grows over a border: 0.6, which has to be learned."""
    growth_bins: int = 30
    prior_bins: int = 5
    """Bins whose median is the growth of a contact, and how many have the usual value at first."""
    slip_factor: float = 6.0
    """Change of a pattern in a slip over that at rest; the spread of the change of shear grows as much."""
    spread: float = 0.6
    """Standard deviation of the logarithm of an unexplained change."""
    correlation: float = 0.3
    """Of these logarithms of pattern and shear: what disturbs one disturbs the other."""
    largest_ratio: float = 10.0
    """Upper limit of a log likelihood ratio: a bin is no proof."""


CHANGE = _Change()
AT_REST = -0.5 * float(np.log(CHANGE.slip_factor) / CHANGE.spread) ** 2
"""Log likelihood ratio of a change of the pattern as it is at rest."""
REST_S, SLIDE_S = 5.0, 0.7
"""Prior mean durations of rest and of a slip in the hand."""


def first_growths() -> deque[float]:
    """Growths of the latest bins, of a contact not known yet."""
    return deque([CHANGE.growth] * CHANGE.prior_bins, maxlen=CHANGE.growth_bins)


def log_likelihood_ratio(
    share: Floats, noise_power: Floats, rise: Floats, growth: Floats, rest: Floats | float = CHANGE.at_rest
) -> Floats:
    """Log likelihood ratio of "moved" against "load and tilt only".

    share: unexplained share of the pattern's power. noise_power: what noise leaves of it unexplained. rise: change of
    the log load. growth: unexplained change at rest per change of the log load. rest: the change at a steady load.
    """
    apart = np.log(CHANGE.slip_factor) / CHANGE.spread
    far = distance(share, rest, noise_power, rise, growth)
    ratio: Floats = np.clip(apart * (far - 0.5 * apart), -CHANGE.largest_ratio, CHANGE.largest_ratio)
    return ratio


def distance(share: Floats, rest: Floats | float, noise_power: Floats, rise: Floats, growth: Floats) -> Floats:
    """Of the logarithm of a change from its mean at rest, standard deviations. rest: the change at a steady load."""
    usual = rest**2 + (growth * rise) ** 2 + noise_power
    far: Floats = 0.5 * np.log(np.maximum(share, 1e-12) / usual) / CHANGE.spread
    return far


def joint_log_likelihood_ratio(pattern: Floats, shear: Floats) -> Floats:
    """Of both witnesses, whose logarithms are normal, correlated and alike. pattern, shear: `distance` of each."""
    apart = np.log(CHANGE.slip_factor) / CHANGE.spread
    joint = apart * (pattern + shear - apart) / (1 + CHANGE.correlation)
    ratio: Floats = np.clip(joint, -CHANGE.largest_ratio, CHANGE.largest_ratio)
    return ratio


def predicted(odds: Floats, step_s: float) -> Floats:
    """Prior odds of a slip after this time."""
    begins, ends = _transitions(step_s)
    ahead: Floats = (begins + odds * (1 - ends)) / (1 - begins + odds * ends)
    return ahead


def updated(odds: Floats, log_ratio: Floats, touching: Bools, step_s: float) -> Floats:
    """(pads,), odds after one more bin: no evidence where the ratio is NaN, rest where there is no contact."""
    factor = np.exp(np.where(np.isnan(log_ratio), 0.0, log_ratio))
    after: Floats = np.where(touching, predicted(odds, step_s) * factor, 0.0)
    return after


def looked_back(later: Floats, log_ratio: Floats, touching: Bools, step_s: float) -> Floats:
    """(pads,), factor on the odds of a bin by all bins after it.

    later: that of the next bin, whose ratio and contact these are, step_s after.
    """
    begins, ends = _transitions(step_s)
    factor = later * np.exp(np.where(np.isnan(log_ratio), 0.0, log_ratio))
    before = (ends + (1 - ends) * factor) / (1 - begins + begins * factor)
    return np.where(touching, before, 1.0)


def _transitions(step_s: float) -> tuple[float, float]:
    """Probabilities that a slip begins, and that it ends, within a time; the first bin has none before it."""
    step_s = min(step_s, REST_S)
    return float(-np.expm1(-step_s / REST_S)), float(-np.expm1(-step_s / SLIDE_S))
