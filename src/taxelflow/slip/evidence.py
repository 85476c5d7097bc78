"""Has the object moved, or was its load only redistributed? A likelihood ratio per bin, and odds over the bins.

Logarithms of the unexplained change of a pattern (`pattern_change.py`) are about normal. At rest their mean is that of
the change that every soft skin shows, of growth under load and of noise; in a slip the change is several times as
large. So are those of the spread of the change of shear (`shear_change.py`), where a sensor has it, and the ratio is
that of both together.

An object that a hand tilts or swings changes its pattern as much as one that slides. What separates them is which of
the two explains the change: the logarithm of what a slide leaves over what rest does (`rest_or_slide`) is normal, with
the same deviation, around that of "clearly better" on either side. One bin shows little, but what tilts goes on to.

A Markov chain of three states, "rests", "tilts" and "slides", turns ratios into odds: forward for a stream, forward and
backward for a recording.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.rest_or_slide import Unexplained
from taxelflow.numerics.robust import CLEARLY
from taxelflow.numerics.rounding import NEGLIGIBLE
from taxelflow.runtime.compiling import inlined, kernel, lean_kernel


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
"""Prior mean durations of rest and of a slip in the hand. An object that tilts does so for as long as one rests."""
UNTOUCHED = np.array([[1.0], [0.0], [0.0]])
"""(3, 1), probabilities of the states where there is no contact."""


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
    return _limited(apart * (far - 0.5 * apart))


def looks_like_slip(share: Floats, noise_power: Floats, rise: Floats) -> Bools:
    """Whether a change is as in a slip, if a contact does not change with its load."""
    with np.errstate(invalid="ignore"):
        found: Bools = log_likelihood_ratio(share, noise_power, rise, np.zeros_like(rise)) > 0.0
    return found


def tilt_over_slide(left: Unexplained) -> float:
    """Log likelihood ratio of "tilts" against "slides"; NaN where rest fits all readings.

    The logarithm of the root of chi-square over its n degrees of freedom has the variance 1 / 2n and the bias -1 / 2n:
    few taxels show little.
    """
    rest, slide = 0.5 / left.free_rest, 0.5 / left.free_slide
    return 2.0 * float(np.log(CLEARLY)) / (CHANGE.spread**2 + rest + slide) * (left.log_ratio() - rest + slide)


def tilt_log_ratio(log_ratio: Floats, tilt: Floats) -> Floats:
    """Log likelihood ratio of "tilts" against "rests", of a change with this one of "slides" against "rests".

    tilt: that of "tilts" against "slides"; where it is NaN, a change that is as in a slip is no tilt.
    """
    found: Floats = np.where(np.isnan(tilt), np.minimum(log_ratio, 0.0), log_ratio + tilt)
    return found


def distance(share: Floats, rest: Floats | float, noise_power: Floats, rise: Floats, growth: Floats) -> Floats:
    """Of the logarithm of a change from its mean at rest, standard deviations. rest: the change at a steady load."""
    usual = rest**2 + (growth * rise) ** 2 + noise_power
    far: Floats = 0.5 * np.log(np.maximum(share, NEGLIGIBLE) / np.maximum(usual, NEGLIGIBLE)) / CHANGE.spread
    return far


def joint_log_likelihood_ratio(pattern: Floats, shear: Floats) -> Floats:
    """Of both witnesses, whose logarithms are normal, correlated and alike. pattern, shear: `distance` of each."""
    apart = np.log(CHANGE.slip_factor) / CHANGE.spread
    return _limited(apart * (pattern + shear - apart) / (1 + CHANGE.correlation))


def _limited(log_ratio: Floats) -> Floats:
    """A bin is no proof."""
    limited: Floats = np.maximum(np.minimum(log_ratio, CHANGE.largest_ratio), -CHANGE.largest_ratio)
    return limited


class _Transitions(NamedTuple):
    """Probabilities of the next state: the same or the other, of rest and tilt; that a slip begins, stays or ends."""

    same: float
    other: float
    begins: float
    stays: float
    ends: float


@kernel
def updated(shares: Floats, log_ratios: Floats, touching: Bools, step_s: float) -> Floats:
    """(3, pads), probabilities of the states after one more bin: rests where there is no contact.

    shares: those before it. log_ratios: (2, pads), of "tilts" and of "slides" against "rests"; NaN is no evidence.
    """
    found, to = np.empty((3, len(touching))), _transitions(step_s)
    for pad in range(len(touching)):
        rests, tilts, slides = shares[0, pad], shares[1, pad], shares[2, pad]
        found[0, pad] = to.same * rests + to.other * tilts + to.ends * slides
        found[1, pad] = (to.other * rests + to.same * tilts) * _factor(log_ratios[0, pad])
        found[2, pad] = (to.begins * (rests + tilts) + to.stays * slides) * _factor(log_ratios[1, pad])
        total = found[0, pad] + found[1, pad] + found[2, pad]
        for state in range(3):
            found[state, pad] = found[state, pad] / total if touching[pad] else UNTOUCHED[state, 0]
    return found


@kernel
def looked_back(later: Floats, log_ratios: Floats, touching: Bools, step_s: float) -> Floats:
    """(3, pads), factors on the states of a bin by all bins after it.

    later: those of the next bin, whose ratios and contact these are, step_s after.
    """
    found, to = np.empty((3, len(touching))), _transitions(step_s)
    for pad in range(len(touching)):
        rests = later[0, pad]
        tilts, slides = later[1, pad] * _factor(log_ratios[0, pad]), later[2, pad] * _factor(log_ratios[1, pad])
        found[0, pad] = to.same * rests + to.other * tilts + to.begins * slides
        found[1, pad] = to.other * rests + to.same * tilts + to.begins * slides
        found[2, pad] = to.ends * rests + to.stays * slides
        most = max(found[0, pad], found[1, pad], found[2, pad])
        for state in range(3):
            found[state, pad] = found[state, pad] / most if touching[pad] else 1.0
    return found


@inlined
def _factor(log_ratio: float) -> float:
    """Likelihood of a bin, of a state over that of "rests"."""
    return 1.0 if np.isnan(log_ratio) else np.exp(log_ratio)


@lean_kernel
def _transitions(step_s: float) -> _Transitions:
    """Those after a time; the first bin has none before it."""
    passed = min(step_s, REST_S)
    begins, ends = -np.expm1(-passed / REST_S), -np.expm1(-passed / SLIDE_S)
    return _Transitions((1.0 - begins) * (1.0 - begins), (1.0 - begins) * begins, begins, 1.0 - ends, ends)
