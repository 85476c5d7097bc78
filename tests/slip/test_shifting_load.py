"""Objects whose load shifts while they rest, and while they slip: what is reported, and what is suspected."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest

from elastic_skin import PLACES, RATE_HZ, SENSOR, on_skin
from synthetic import recorded
from taxelflow.pipeline import api
from taxelflow.slip.shifting_load import ahead

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording
    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Event

both = pytest.mark.parametrize("mode", ["batch", "stream"])
T_S = np.arange(round(5.0 * RATE_HZ)) / RATE_HZ
AT_REST = np.zeros(len(T_S))
ROCKED = 0.08 * np.sin(2 * np.pi * 0.7 * T_S)
SLID = 2.5 * np.clip(T_S - 3.0, 0.0, 0.8) / 0.8
"""By 2.5 pitches, at 9 mm/s."""
ONSET_S = 4.0
"""Of the slide, after a second without contact."""


def slips(recording: Recording, mode: Mode) -> list[Event]:
    found = api.estimate(recording, method="registration", mode=mode)
    return [event for event in found.events if event.event in ("slip_start", "slip_suspected")]


def starts(events: list[Event]) -> list[Event]:
    return [event for event in events if event.event == "slip_start"]


@both
def test_an_object_that_is_rocked_at_rest_is_only_suspected(mode: Mode) -> None:
    events = slips(on_skin(AT_REST, ROCKED), mode)
    assert events
    assert not starts(events)


@both
def test_an_object_that_slips_while_it_is_rocked_is_reported(mode: Mode) -> None:
    found = [event for event in starts(slips(on_skin(SLID, ROCKED), mode)) if event.t_s >= ONSET_S]
    assert found
    assert found[0].t_s < ONSET_S + 0.8
    assert abs(found[0].onset_s - ONSET_S) < 0.2


@both
def test_the_pose_decides_where_the_contact_was_still(mode: Mode) -> None:
    found = starts(slips(on_skin(SLID, AT_REST), mode))
    assert len(found) == 1
    assert abs(found[0].onset_s - ONSET_S) < 0.05
    assert found[0].t_s - ONSET_S < (0.25 if mode == "stream" else 0.05)


@both
def test_a_smooth_object_that_slides_slowly_is_never_silent(mode: Mode) -> None:
    """A paraboloid, whose slide and tilt look the same, at 0.9 mm/s for 6 s: a quarter of a pitch takes 0.8 s."""
    t_s = np.arange(round(9.0 * RATE_HZ)) / RATE_HZ
    slid = 0.3 * np.clip(t_s - 2.0, 0.0, 6.0)
    off = np.hypot(PLACES[:, 0] + 0.9 - slid[:, np.newaxis], PLACES[:, 1])
    touched = 2e4 * np.maximum(1.0 - (off / 3.0) ** 2, 0.0)
    values = np.concatenate([np.zeros((round(RATE_HZ), len(PLACES))), touched])
    values += np.random.default_rng(0).normal(0.0, 100.0, values.shape)
    found = api.estimate(recorded(values, SENSOR, np.arange(len(values)) / RATE_HZ), method="convolution", mode=mode)
    known_s, reported = found["pad0"].t_s, found["pad0"].slipping.copy()
    for event in found.events:
        last = event.event in ("slip_suspected", "slip_stop")
        reported |= last & (known_s >= event.t_s) & (known_s < event.t_s + 1.25)
    assert reported[(known_s > 3.5) & (known_s < 8.5)].all()


@both
def test_a_swing_on_a_restless_pad_is_only_suspected(mode: Mode) -> None:
    """It trembles first, too little for a pose to move, so that the odds decide."""
    rocked = np.where(T_S < 3.0, 0.01, 0.1) * np.sin(2 * np.pi * T_S)
    result = api.estimate(on_skin(AT_REST, rocked), method="convolution", mode=mode)
    kinds = {event.event for event in result.events}
    assert "slip_suspected" in kinds
    assert "slip_start" not in kinds
    assert np.nanmax(result.evidence) < -2.0


@both
def test_a_slow_slip_of_a_rocked_object_is_reported_before_it_ends(mode: Mode) -> None:
    """By one pitch in a second: since the pull before it, rest explains the pattern as well."""
    slid = np.clip(T_S - 3.0, 0.0, 1.0)
    found = api.estimate(on_skin(slid, ROCKED), method="convolution", mode=mode)["pad0"]
    late = (found.t_s > ONSET_S + 0.65) & (found.t_s < ONSET_S + 0.95)
    assert found.slipping[late].all()


def test_a_stream_reports_a_slip_that_is_over_before_its_bin_is_of_a_rocked_object() -> None:
    """By one pitch in 0.08 s."""
    slid = np.clip((T_S - 3.0) / 0.08, 0.0, 1.0)
    found = api.estimate(on_skin(slid, ROCKED), method="template", mode="stream")["pad0"]
    assert found.slipping[(found.t_s > ONSET_S) & (found.t_s < ONSET_S + 0.09)].any()


def test_a_sensor_without_unseen_error_is_believed() -> None:
    exact = msgspec.structs.replace(SENSOR, unseen_error=0.0)
    assert starts(slips(replace(on_skin(AT_REST, ROCKED), sensor=exact), "stream"))


@both
def test_events_do_not_depend_on_blocks(mode: Mode) -> None:
    whole = on_skin(SLID, ROCKED)
    values = np.concatenate([scans.values for scans in whole.blocks()])
    parts = recorded(values, SENSOR, np.arange(len(values)) / RATE_HZ, block=7)
    assert slips(parts, mode) == slips(whole, mode)


def test_consent_within_the_time_ahead_counts_while_the_slip_goes_on() -> None:
    t_s = 0.1 * np.arange(6.0)
    slipping = np.array([1, 1, 1, 0, 1, 1], dtype=bool)[:, np.newaxis]
    since_s = np.array([np.inf, np.inf, 0.05, -np.inf, np.inf, np.inf])[:, np.newaxis]
    begun = ahead(since_s, slipping, t_s, 0.25, 5)[:, 0]
    assert begun.tolist() == [0.05, 0.05, 0.05, np.inf, np.inf]  # later than the first scan, which claims it too early


def test_a_slip_that_its_pattern_confirms_soon_is_known_before_it_begins() -> None:
    t_s = 0.1 * np.arange(6.0)
    slipping = np.array([1, 0, 0, 1, 1, 0], dtype=bool)[:, np.newaxis]
    since_s = np.array([np.inf, -np.inf, -np.inf, np.inf, -np.inf, -np.inf])[:, np.newaxis]
    begun = ahead(since_s, slipping, t_s, 0.25, 6)[:, 0]
    np.testing.assert_allclose(begun, [np.inf, np.inf, 0.3, -np.inf, -np.inf, np.inf])


@both
def test_shear_that_shows_a_slip_is_enough_where_rest_explains_the_pattern(mode: Mode) -> None:
    rocked = on_skin(AT_REST, ROCKED)
    raw = next(rocked.blocks())
    shear = np.zeros((len(raw), 100, 2))
    slip = (raw.t_s > ONSET_S) & (raw.t_s < ONSET_S + 0.8)
    shear[slip] = (
        2e3 * np.random.default_rng(1).standard_normal((int(slip.sum()), 1, 1)) * np.sin(np.arange(100))[:, None]
    )
    shear += np.random.default_rng(2).normal(0.0, 50.0, shear.shape)
    sheared = api.recording(raw.t_s, raw.values, SENSOR, shear=shear)
    assert not starts(slips(rocked, mode))
    assert starts(slips(sheared, mode))


@both
def test_a_smooth_object_that_slides_over_taxels_of_other_gains_slips(mode: Mode) -> None:
    slid = 2.5 * np.clip(T_S - 3.0, 0.0, 1.0)
    gains = 1.0 + 0.05 * np.random.default_rng(3).standard_normal(len(PLACES))
    off = np.hypot(PLACES[:, 0] + 1.2 - slid[:, np.newaxis], PLACES[:, 1])
    touched = 2e4 * gains * np.exp(-((off / 2.5) ** 2) / 2)
    values = np.concatenate([np.zeros((round(RATE_HZ), len(PLACES))), touched])
    values += np.random.default_rng(0).normal(0.0, 100.0, values.shape)
    found = starts(slips(recorded(values, SENSOR, np.arange(len(values)) / RATE_HZ), mode))
    assert found
    assert abs(found[0].onset_s - ONSET_S) < 0.3
