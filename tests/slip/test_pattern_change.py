from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elastic_skin import SENSOR as ON_SKIN
from elastic_skin import pressed
from restless import SENSOR, held, slide, texture, tilt
from synthetic import grid_sensor, scans_of
from taxelflow.messages import cut
from taxelflow.pipeline import api
from taxelflow.slip.evidence import CHANGE, log_likelihood_ratio
from taxelflow.slip.pattern_change import BINS, PatternChanges, PatternWatch

if TYPE_CHECKING:
    from taxelflow.messages import Floats, Scans

AFTER = 2
CREEP_M_S = 1e-4


def compared(scans: Scans, after: int = AFTER) -> PatternChanges:
    return PatternWatch(SENSOR.layout, CREEP_M_S, after, BINS.longer).step(scans)


def ratios(changes: PatternChanges) -> Floats:
    """(scans, pads), log likelihood ratio of a contact not known yet."""
    growth = np.full(changes.rise.shape, CHANGE.growth)
    return log_likelihood_ratio(changes.unexplained, changes.noise, changes.rise, growth)


def touched(pressure: Floats, rate_hz: float = 10.0, noise: float = 100.0) -> Scans:
    """Scans in contact throughout, without noise in them."""
    scans = scans_of(SENSOR, pressure, noise=noise)
    always = np.ones_like(scans.contact)
    return replace(scans, t_s=np.arange(len(pressure)) / rate_hz, contact=always, complete=always)


@given(st.floats(-0.2, 0.2), st.floats(-0.5, 0.5), st.floats(0.8, 1.2))
def test_load_and_tilt_are_explained_whatever_they_are(along: float, across: float, gain: float) -> None:
    layout, pattern = SENSOR.layout, texture(np.zeros(5))
    pattern[3:] *= gain * (1 + (along * layout.x_m + across * layout.y_m) / 0.02)
    changes = compared(touched(pattern))
    assert ratios(changes)[4, 0] < -2


@given(st.floats(0.003, 0.01), st.sampled_from([1.0, -1.0]))
def test_a_shift_of_a_textured_object_is_not(way_m: float, side: float) -> None:
    changes = compared(touched(texture(side * way_m * np.array([0, 0, 0, 1, 1.0]))))
    assert ratios(changes)[4, 0] > 0


def test_scale_does_not_matter() -> None:
    pattern = texture(slide()) * tilt(np.arange(len(slide())) / 10.0, 0.2)
    one, other = compared(touched(pattern)), compared(touched(7.0 * pattern, noise=700.0))
    np.testing.assert_allclose(ratios(one), ratios(other), rtol=1e-6)


def test_noise_stirs_nothing_but_tilt_does() -> None:
    shares = []
    for tilted in (0.0, 0.2):
        stirred = compared(api.conditioned(held(np.zeros(200), tilted))).stirred
        shares.append(np.nanmean(stirred))
    assert shares[0] < 0.08
    assert shares[1] > 0.5


def test_noise_alone_stirs_one_bin_in_many() -> None:
    noise = np.random.default_rng(0).normal(0.0, 4e3, (4000, SENSOR.layout.taxels))
    stirred = compared(touched(texture(np.zeros(4000)) + noise, 50.0, noise=4e3)).stirred
    known = stirred[np.isfinite(stirred)]
    assert len(known) > 700
    assert known.mean() < 0.01


@pytest.mark.parametrize("rate_hz", [10.0, 31.0, 100.0, 400.0])
def test_bins_are_of_a_tenth_of_a_second_at_any_rate(rate_hz: float) -> None:
    scans = touched(texture(np.zeros(round(5 * rate_hz))), rate_hz)
    found = np.flatnonzero(np.isfinite(compared(scans).centre_s))
    assert len(found) == pytest.approx(50 - BINS.before - AFTER, abs=5)


def test_the_judged_bin_lies_before_those_after_it() -> None:
    changes = compared(touched(texture(np.zeros(20))), after=1)
    done = np.isfinite(changes.centre_s)
    assert changes.t_s[done] - changes.centre_s[done] == pytest.approx(0.1)


def test_a_contact_that_begins_has_no_evidence_yet() -> None:
    scans = touched(texture(np.zeros(20)))
    scans.contact[:10] = False
    changes = compared(scans)
    assert np.isnan(changes.unexplained[:14]).all()
    assert np.isfinite(changes.unexplained[14:]).all()
    assert changes.touching[11:, 0].tolist() == [False] + [True] * 8


def test_a_missing_taxel_is_no_change() -> None:
    scans = touched(texture(np.zeros(20)))
    scans.pressure[10, 14], scans.complete[10] = 0.0, False
    changes = compared(scans)
    assert np.isnan(changes.unexplained[10:15]).all()
    assert (ratios(changes)[15:] < 0).all()


@pytest.mark.parametrize("scans", [1, 3])
def test_readings_at_the_end_of_their_range_are_no_change(scans: int) -> None:
    """scans: of a bin; it is enough that one of them, but the first, is at the end of its range."""
    load = np.repeat([1.0, 1.5], 10 * scans)
    load[1::3] *= 1.0 if scans == 1 else 0.5  # the first scan of all is a bin of its own
    pressure = texture(np.zeros(20 * scans)) * load[:, np.newaxis]
    ceiling = 0.8 * float(pressure.max())
    clipped = touched(np.minimum(pressure, ceiling), 10.0 * scans)
    known = replace(clipped, ceiling=np.full_like(clipped.noise, ceiling))
    assert np.nanmax(compared(clipped).unexplained) > 1e-3
    assert np.nanmax(compared(known).unexplained) < 1e-8


def test_patterns_are_not_compared_across_a_gap() -> None:
    scans = touched(texture(np.repeat([0.0, 0.01], 10)))
    scans = replace(scans, t_s=scans.t_s + np.repeat([0.0, 2.0], 10))
    assert not (ratios(compared(scans)) > 0).any()


@pytest.mark.parametrize(("number", "between"), list(enumerate(BINS.longer)))
def test_longer_baselines_end_with_the_same_bins(number: int, between: int) -> None:
    changes = compared(touched(texture(np.repeat([0.0, 0.01], 30))))
    moved = np.flatnonzero(changes.longer[:, 0, number, 0] > 0.01)
    assert moved[0] == 30  # the first bin after the step is one of those compared
    assert moved[-1] == 30 + between + BINS.before + AFTER - 2
    assert np.isnan(changes.longer[: BINS.before + between + AFTER - 1, 0, number]).all()


@cache
def slid() -> tuple[Scans, PatternChanges]:
    scans = touched(texture(slide(31.0)), 31.0)
    return scans, compared(scans)


@pytest.mark.long
@given(st.lists(st.integers(1, 60), max_size=6))
def test_the_blocks_do_not_matter(sizes: list[int]) -> None:
    scans, whole = slid()
    watch = PatternWatch(SENSOR.layout, CREEP_M_S, AFTER, BINS.longer)
    edges = [0, *(edge for edge in np.cumsum(sizes).tolist() if edge < len(scans)), len(scans)]
    parts = [watch.step(cut(scans, start, stop)) for start, stop in pairwise(edges)]
    for name in ("centre_s", "touching", "unexplained", "noise", "rise", "stirred", "longer"):
        np.testing.assert_array_equal(np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name))


def test_each_pad_has_its_own() -> None:
    sensor = grid_sensor(6, 6, pads=2, pitch_m=(0.005, 0.005))
    still, moved = texture(np.zeros(20)), texture(np.linspace(0, 0.02, 20))
    pressure = np.concatenate([still, moved], axis=1)
    scans = scans_of(sensor, pressure, noise=100.0)
    scans = replace(scans, contact=np.ones_like(scans.contact), complete=np.ones_like(scans.complete))
    ratio = ratios(PatternWatch(sensor.layout, CREEP_M_S, AFTER).step(scans))[10]
    assert ratio[0] < 0 < ratio[1]


def test_wild_readings_warn_of_nothing() -> None:
    pattern = texture(np.zeros(20))
    pattern[10, 3] = 1e300
    ratio = ratios(compared(touched(pattern)))[:, 0]
    assert np.isnan(ratio[[10, 11, 13, 14]]).all()
    assert (ratio[15:] < 0).all()


@pytest.mark.parametrize(("moved", "sign"), [({"tilt": (0.1, -0.05)}, 1.0), ({"x": 0.4, "y": 0.2}, -1.0)])
def test_a_rigid_object_that_tilts_is_known_from_one_that_slides(moved: dict[str, Any], sign: float) -> None:
    """Both change the pattern as a slip does. Only a sensor with an `unseen_error` is asked."""
    pattern = 2e4 * np.stack([pressed()] * 3 + [pressed(**moved)] * 2)
    for unseen_error in (0.05, 0.0):
        sensor = msgspec.structs.replace(ON_SKIN, unseen_error=unseen_error)
        scans = scans_of(sensor, pattern, noise=20.0)
        always = np.ones_like(scans.contact)
        scans = replace(scans, t_s=np.arange(len(pattern)) / 10.0, contact=always, complete=always)
        changes = PatternWatch(sensor.layout, CREEP_M_S, AFTER).step(scans)
        assert ratios(changes)[4, 0] > 0
        tilt = changes.tilt[4, 0]
        assert sign * tilt > 0 if unseen_error else np.isnan(tilt)
