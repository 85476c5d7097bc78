"""Odds of a slip per scan from the evidence of the bins, in a stream and in a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isnan, log
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.messages import joined
from taxelflow.numerics.bins import AHEAD_BINS, BIN_S
from taxelflow.slip.evidence import (
    AT_REST,
    CHANGE,
    REST_S,
    SLIDE_S,
    UNTOUCHED,
    distance,
    joint_log_likelihood_ratio,
    log_likelihood_ratio,
    looked_back,
    tilt_log_ratio,
    updated,
)
from taxelflow.slip.pattern_change import BINS
from taxelflow.slip.pose_rest import PoseRest
from taxelflow.slip.restless import RestlessPads
from taxelflow.slip.shear_rest import ShearRest

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats, Slips
    from taxelflow.slip.pattern_change import PatternChanges

AGAINST = log(SLIDE_S / REST_S)
"""Log odds of a slip below which its pattern speaks against it: those of an object of which nothing is known."""


class _After(NamedTuple):
    """Bins after the judged one: a stream judges 0.1 s late."""

    live: int = 1
    recorded: int = 2


AFTER = _After()
LIVE_DELAY_S = (AFTER.live + 1) * BIN_S
"""Time within which a stream's pattern shows a slip."""
_SOON_BINS = BINS.before + 1 + AFTER.recorded
"""Bins within which the pattern of a slip that begins has changed."""
_LONGER_REST = CHANGE.at_rest * np.array([((between + 2) / 3) ** CHANGE.exponent for between in BINS.longer])
"""(baselines,), unexplained change at rest over longer baselines; `CHANGE.at_rest` has one bin between its patterns."""


@dataclass(frozen=True, slots=True, eq=False)
class Odds:
    """Of a slip, (scans, pads) each. log_odds: NaN where unknown. soon: in a recording the highest of them within half
    a second, and of those by a longer baseline that begins before; in a stream the same. restless: the odds decide.
    """

    log_odds: Floats
    soon: Floats
    restless: Bools

    def __len__(self) -> int:
        return len(self.log_odds)


@dataclass(frozen=True, slots=True, eq=False)
class _Bin:
    """One bin: (pads,) each, but for its first time. log_ratios: (2, pads), see `updated`. shares: (3, pads),
    probabilities of the states. shown: whether a bin of the contact has been evidence, not time alone. longer: (pads,
    baselines), log odds by longer baselines alone.
    """

    since_s: float
    log_ratios: Floats
    touching: Bools
    shares: Floats
    shown: Bools
    restless: Bools
    longer: Floats


class _Forward:
    """Odds after each bin, and which pads are restless."""

    def __init__(self, pitch_m: Floats, after: int, longer: int = 0) -> None:
        """pitch_m: (pads, 2). longer: number of longer baselines."""
        pads, window = len(pitch_m), BINS.before + 1 + after
        self._restless, self._shear = RestlessPads(pads, window), ShearRest(pads)
        self._pose = PoseRest(pitch_m, window)
        self._slipped = np.zeros(pads, dtype=np.bool_)
        nothing, untouched = np.full((2, pads), np.nan), np.zeros(pads, dtype=np.bool_)
        shares = np.repeat(UNTOUCHED, pads, axis=1)
        self.last = _Bin(-np.inf, nothing, untouched, shares, untouched, untouched, np.full((pads, longer), np.nan))

    def step(self, slipping: Bools, slips: Slips, changes: PatternChanges, rested: Bools) -> list[tuple[int, _Bin]]:
        """Bins that are judged in these scans, each with the scan.

        slipping: (scans, pads), by the pose. rested: (scans, pads), `rests` of `Consent`.
        """
        found, start = [], 0
        for scan, since_s in enumerate(changes.centre_s.tolist()):
            if isnan(since_s):
                continue
            touching = changes.touching[scan]
            usual = changes.noise[scan], changes.rise[scan], self._restless.growth
            with np.errstate(invalid="ignore"):  # a change of infinite power
                ratio = log_likelihood_ratio(changes.unexplained[scan], *usual)
            slipped = self._slipped | slipping[start : scan + 1].any(axis=0)
            self._restless.update(slipped, changes, scan, ratio, rested[scan])
            if np.isfinite(changes.spread[scan]).any():
                ratio = self._joint(changes, scan, ratio, usual)
            sheared = np.isfinite(changes.spread[scan])  # that knows a slide from a tilt
            tilts = np.where(sheared, 0.0, tilt_log_ratio(ratio, changes.tilt[scan]))
            rests = self._pose.step(slips, scan, slipped)
            ratio = np.where(rests, np.fmin(ratio, AT_REST), ratio)
            self._slipped, start = np.zeros_like(slipped), scan + 1
            ratios = np.stack([tilts, ratio])
            shares = updated(self.last.shares, ratios, touching, since_s - self.last.since_s)
            shown = touching & (self.last.shown | np.isfinite(ratio))
            longer = self._by_longer(changes.longer[scan])
            self.last = _Bin(since_s, ratios, touching, shares, shown, self._restless.restless, longer)
            found.append((scan, self.last))
        if np.count_nonzero(slipping[start:]):
            self._slipped = self._slipped | slipping[start:].any(axis=0)
        return found

    def _by_longer(self, changes: Floats) -> Floats:
        """(pads, baselines), log odds by longer baselines alone. changes: (pads, baselines, 3)."""
        if not changes.shape[1]:  # a stream
            return changes[..., 0]
        unexplained, noise, rise = np.moveaxis(changes, -1, 0)
        with np.errstate(invalid="ignore"):
            return AGAINST + log_likelihood_ratio(
                unexplained, noise, rise, self._restless.growth[:, np.newaxis], _LONGER_REST[: rise.shape[1]]
            )

    def _joint(self, changes: PatternChanges, scan: int, ratio: Floats, usual: tuple[Floats, Floats, Floats]) -> Floats:
        """(pads,), the ratio with the shear of pads that have it. ratio: by the pattern alone, from what is usual."""
        share = changes.spread[scan]
        with np.errstate(invalid="ignore"):
            noise, rise = changes.spread_noise[scan], changes.rise[scan]
            shear = distance(share, self._shear.spread, noise, rise, self._shear.growth)
            both = joint_log_likelihood_ratio(distance(changes.unexplained[scan], CHANGE.at_rest, *usual), shear)
        self._shear.update(changes, scan, ratio)
        return np.where(np.isfinite(share), both, ratio)


class LiveOdds:
    """Each scan has the odds of the last bin that was judged."""

    def __init__(self, pitch_m: Floats) -> None:
        """pitch_m: (pads, 2)."""
        self._forward = _Forward(pitch_m, AFTER.live)
        self._logged = self._forward.last, _log(self._forward.last)

    def step(self, slipping: Bools, slips: Slips, changes: PatternChanges, rested: Bools) -> Odds:
        """Odds of these scans. slipping: (scans, pads), by the pose. rested: (scans, pads), `rests` of `Consent`."""
        log_odds, restless = np.empty(slipping.shape), np.empty_like(slipping)
        start, last = 0, self._forward.last
        for scan, one in [*self._forward.step(slipping, slips, changes, rested), (len(slipping), None)]:
            if self._logged[0] is not last:  # it holds for many scans
                self._logged = last, _log(last)
            log_odds[start:scan], restless[start:scan] = self._logged[1], last.restless
            start, last = scan, one or last
        return Odds(log_odds, log_odds, restless)

    def finish(self) -> Odds:
        """Nothing is held back."""
        none = self._forward.last.restless[np.newaxis][:0]
        return Odds(none.astype(np.float64), none.astype(np.float64), none)


class OfflineOdds:
    """Each scan has the odds of its bin by the bins before and after, 2 to 4 s late."""

    def __init__(self, pitch_m: Floats) -> None:
        """pitch_m: (pads, 2)."""
        self._forward = _Forward(pitch_m, AFTER.recorded, len(BINS.longer))
        self._bins: list[_Bin] = []  # not given yet, after the last one that was
        self._given = self._forward.last
        self._t = np.zeros(0)  # of the scans held

    def step(self, slipping: Bools, slips: Slips, changes: PatternChanges, rested: Bools) -> Odds:
        """Odds of the oldest scans, as many as are known. slipping, rested: see `LiveOdds.step`."""
        self._bins += [one for _, one in self._forward.step(slipping, slips, changes, rested)]
        self._t = np.concatenate([self._t, changes.t_s])
        parts = [self._chunk([], 0, -np.inf)]
        while len(self._bins) >= 2 * AHEAD_BINS:
            parts.append(self._chunk(self._bins[: 2 * AHEAD_BINS], AHEAD_BINS, self._bins[AHEAD_BINS].since_s))
            self._bins = self._bins[AHEAD_BINS:]
        return joined(parts)

    def finish(self) -> Odds:
        """Odds of the scans that `step` has held back."""
        return self._chunk(self._bins, len(self._bins), np.inf)

    def _chunk(self, bins: list[_Bin], count: int, until_s: float) -> Odds:
        """Odds of the scans before a time, which are those of the first `count` bins or of the last one given."""
        known = [self._given, *_smoothed(bins)]
        smoothed = known[: count + 1]
        scans = int(np.searchsorted(self._t, until_s))
        times, self._t = self._t[:scans], self._t[scans:]
        place = np.searchsorted([one.since_s for one in smoothed], times, side="right") - 1
        self._given = smoothed[-1]

        log_odds, restless = np.stack([_log(one) for one in known]), np.stack([one.restless for one in smoothed])
        return Odds(log_odds[place], _soon(log_odds, known)[place], restless[place])


def _smoothed(bins: list[_Bin]) -> list[_Bin]:
    """Bins with the odds that also regard the bins after them in the list; all are as restless as the last."""
    found: list[_Bin] = []
    later, shown = np.ones((3, 0)), np.zeros(0, dtype=np.bool_)
    for number in range(len(bins) - 1, -1, -1):
        one = bins[number]
        if number == len(bins) - 1:
            later, shown = np.ones_like(one.shares), one.shown
        else:
            after = bins[number + 1]
            later = looked_back(later, after.log_ratios, after.touching, after.since_s - one.since_s)
            shown = one.shown | (after.touching & shown)
        found.append(replace(one, shares=one.shares * later, shown=shown, restless=bins[-1].restless))
    return found[::-1]


def _soon(log_odds: Floats, known: list[_Bin]) -> Floats:
    """(bins, pads), highest log odds of each bin and those after it that may show the same slip; NaN where unknown.

    The bin in which a contact ends has those of the one before it.
    """
    soon = _highest(log_odds, _SOON_BINS)
    for baseline, between in enumerate(BINS.longer):
        longer = np.stack([one.longer[:, baseline] for one in known])
        soon = np.fmax(soon, _highest(longer, between))
    unknown = np.isnan(log_odds)
    soon[unknown] = np.nan
    soon[1:] = np.where(unknown[1:], soon[:-1], soon[1:])
    return soon


def _highest(values: Floats, bins: int) -> Floats:
    """(bins, pads), highest value of each bin and this many after it; NaN where all are unknown."""
    highest = values.copy()
    for ahead in range(1, min(bins, len(values) - 1) + 1):
        highest[:-ahead] = np.fmax(highest[:-ahead], values[ahead:])
    return highest


def _log(one: _Bin) -> Floats:
    """Log odds; NaN before any evidence of a contact."""
    with np.errstate(divide="ignore"):
        log_odds: Floats = np.log(one.shares[2]) - np.log(one.shares[0] + one.shares[1])
        return np.where(one.shown & (one.shares[2] > 0), log_odds, np.nan)
