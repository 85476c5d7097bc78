"""Odds of a recording look ahead, and their chunks do not show."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from restless import SENSOR, held, slide
from taxelflow.evaluation.slip_scoring import still_slips
from taxelflow.messages import AMBIGUOUS, OK
from taxelflow.pipeline import api
from taxelflow.slip.odds import AFTER, LiveOdds, Odds, OfflineOdds
from taxelflow.slip.pattern_change import BINS, PatternChanges, PatternWatch

if TYPE_CHECKING:
    from taxelflow.messages import Slips

PITCH_M = SENSOR.layout.pitch_m


@pytest.fixture(scope="module")
def changes() -> dict[int, PatternChanges]:
    """Of an object that slides from 10 s on and then lifts off, by bins after the judged one."""
    recording = held(slide())
    scans = api.conditioned(recording)
    watches = {
        AFTER.live: PatternWatch(recording.layout, 1e-4, AFTER.live),
        AFTER.recorded: PatternWatch(recording.layout, 1e-4, AFTER.recorded, BINS.longer),
    }
    return {after: watch.step(scans) for after, watch in watches.items()}


def at_rest(changes: PatternChanges, quality: int) -> Slips:
    """Poses of this quality that stay, known to 0.1 mm."""
    slips = still_slips(changes.t_s, np.zeros((len(changes), 3)), np.full(3, 1e-4), np.full(3, np.nan))
    covariance = np.broadcast_to(1e-8 * np.eye(3), slips.covariance.shape)
    return replace(slips, covariance=covariance, quality=np.full_like(slips.quality, quality))


def odds_of(watch: LiveOdds | OfflineOdds, changes: PatternChanges, size: int, quality: int = AMBIGUOUS) -> Odds:
    parts = []
    for start in range(0, len(changes), size):
        own = PatternChanges(*(getattr(changes, field.name)[start : start + size] for field in fields(changes)))
        none = np.zeros_like(own.touching)
        parts.append(watch.step(none, at_rest(own, quality), own, none))
    parts.append(watch.finish())
    return Odds(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Odds)))


def test_odds_soon_are_the_highest_of_those_within_half_a_second_and_of_longer_baselines(
    changes: dict[int, PatternChanges],
) -> None:
    whole = changes[AFTER.recorded]
    without = replace(whole, longer=np.full_like(whole.longer, np.nan))
    odds, t_s = odds_of(OfflineOdds(PITCH_M), without, 7), whole.t_s
    now, soon = odds.log_odds[:, 0], odds.soon[:, 0]
    assert (soon >= now)[~np.isnan(now)].all()
    begin = int(np.argmax(now > 0))
    assert (soon[(t_s < t_s[begin] - 0.05) & (t_s > t_s[begin] - 0.45)] > 0).all()
    assert (soon[(t_s < t_s[begin] - 0.7) & (t_s > t_s[begin] - 1.5)] < 0).all()
    longer = odds_of(OfflineOdds(PITCH_M), whole, 7).soon[:, 0]
    assert (longer >= soon)[~np.isnan(soon)].all()
    assert (longer[(t_s < t_s[begin] - 0.05) & (t_s > t_s[begin] - 1.9)] > 0).all()
    assert (longer[(t_s < t_s[begin] - 2.4) & (t_s > t_s[begin] - 4.0)] < 0).all()


@pytest.mark.parametrize("size", [1, 400])
def test_they_do_not_depend_on_the_blocks(changes: dict[int, PatternChanges], size: int) -> None:
    first, second = (odds_of(OfflineOdds(PITCH_M), changes[AFTER.recorded], each) for each in (13, size))
    for field in fields(Odds):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(second, field.name))


def test_a_stream_does_not_look_ahead(changes: dict[int, PatternChanges]) -> None:
    odds = odds_of(LiveOdds(PITCH_M), changes[AFTER.live], 7)
    np.testing.assert_array_equal(odds.log_odds, odds.soon)
    assert np.nanmax(odds.log_odds) > 0


@pytest.mark.parametrize("after", [AFTER.live, AFTER.recorded])
def test_a_pattern_that_changes_is_no_slip_where_precise_poses_stay(
    changes: dict[int, PatternChanges], after: int
) -> None:
    watch = LiveOdds if after == AFTER.live else OfflineOdds
    vague, precise = (odds_of(watch(PITCH_M), changes[after], 7, quality) for quality in (AMBIGUOUS, OK))
    assert np.nanmax(vague.log_odds) > 0
    assert np.nanmax(precise.log_odds) < 0


@pytest.mark.parametrize("after", [AFTER.live, AFTER.recorded])
def test_a_contact_too_brief_to_compare_patterns_has_no_odds_for_or_against_a_slip(
    changes: dict[int, PatternChanges], after: int
) -> None:
    watch, whole = (LiveOdds if after == AFTER.live else OfflineOdds), changes[after]
    brief = replace(whole, unexplained=np.full_like(whole.unexplained, np.nan))
    assert whole.touching.any()
    for each in (odds_of(watch(PITCH_M), brief, 7).log_odds, odds_of(watch(PITCH_M), brief, 7).soon):
        assert np.isnan(each).all()
    assert np.isfinite(odds_of(watch(PITCH_M), whole, 7).log_odds).any()
