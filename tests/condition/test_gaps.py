from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from costly import mostly_long
from logged import PALM, WIDE, deduplicated, logged, noisy_grasp
from synthetic import assert_same, conditioned, dome, recorded
from taxelflow.pipeline.api import estimate
from taxelflow.runtime import registry

if TYPE_CHECKING:
    from taxelflow.messages import Floats

OTHERS = sorted({*registry.names("estimator")} - {"template"})
both_modes = pytest.mark.parametrize("mode", ["batch", "stream"])


def stroke_with_gap(gap_s: float) -> tuple[Floats, Floats]:
    """A dome that moves on while 10 scans are lost."""
    x = np.concatenate([np.linspace(-0.05, -0.02, 40), np.linspace(0.02, 0.05, 40)])
    values = np.array([dome(WIDE, place, place / 3) for place in x])
    t_s = np.arange(80) / 30
    t_s[40:] += gap_s
    return t_s, values + np.random.default_rng(0).normal(0, 50, values.shape)


@pytest.mark.parametrize(
    ("method", "mode"),
    mostly_long(
        [(method, mode) for method in OTHERS for mode in ("batch", "stream")],
        *((method, "batch") for method in OTHERS),
        ("convolution", "stream"),
    ),
)
def test_no_motion_is_invented_across_a_gap(method: str, mode: str) -> None:
    t_s, values = stroke_with_gap(0.5)
    result = estimate(recorded(values, WIDE, t_s), method, mode=mode)  # type: ignore[arg-type]
    slips = result.slips
    assert result.summary.gaps == 1
    after = slips.t_s >= t_s[40] - 1e-9
    spans = slips.span_s[after, 0]
    assert not np.nanmax(np.where(np.isfinite(spans), spans, 0.0)) > 0.1
    moved = slips.displacement[..., :2]
    if np.isfinite(moved).any():
        per_scan = 0.03 / 39
        assert np.nanmax(np.abs(moved[after, 0, 0])) < 20 * per_scan
        (net,) = (contact.net_m[0] for contact in result.summary.contacts)
        assert net < 0.075  # of 100 mm, 40 lie in the gap
    assert "contact" in [event.event for event in result.events]
    assert [event.event for event in result.events].count("release") == 0
    assert any(note.startswith("1 gap of 0.533 s") for note in result.summary.notes)


@pytest.mark.long
@both_modes
def test_the_template_knows_the_object_again_and_measures_what_a_gap_hid(mode: str) -> None:
    t_s, values = stroke_with_gap(0.5)
    slips = estimate(recorded(values, WIDE, t_s), "template", mode=mode).slips  # type: ignore[arg-type]
    first = int(np.searchsorted(slips.t_s, t_s[40] - 1e-9))
    assert slips.displacement[first, 0, 0] == pytest.approx(0.04, abs=0.0002)
    assert slips.span_s[first, 0] == pytest.approx(0.5 + 1 / 30)


@pytest.mark.parametrize("method", ["convolution", "principal_axis"])
def test_the_object_does_not_jump_across_a_gap(method: str) -> None:
    t_s, values = stroke_with_gap(0.5)
    pose = estimate(recorded(values, WIDE, t_s), method).motions.pose[:, :2]
    steps = np.abs(np.diff(pose, axis=0))
    assert np.nanmax(steps) < 0.005


def test_the_first_scan_after_a_gap_is_not_complete_and_no_other() -> None:
    t_s, values = stroke_with_gap(0.5)
    scans, session = conditioned(values, WIDE, t_s=t_s)
    assert np.flatnonzero(~scans.complete[:, 0]).tolist() == [40]
    assert scans.contact[40].all()
    assert (session.counts.gaps, round(session.counts.longest_gap_s, 3)) == (1, 0.533)


def test_three_lost_scans_are_a_gap_and_one_is_not() -> None:
    values = noisy_grasp(60, clipped=False)
    for lost, gaps in ((1, 0), (3, 1)):
        t_s = np.arange(60) / 30
        t_s[30:] += lost / 30
        assert deduplicated(t_s, values)[0].counts.gaps == gaps


@pytest.mark.parametrize(("steps", "gaps"), [(2, 0), (3, 1)])
def test_a_step_is_usual_once_three_have_been_like_it(steps: int, gaps: int) -> None:
    t_s = np.append(np.arange(steps + 1), steps + 30) / 30
    assert deduplicated(t_s, noisy_grasp(len(t_s), clipped=False), passes=1)[0].counts.gaps == gaps


def test_a_sensor_that_hangs_while_its_logger_goes_on_leaves_a_gap() -> None:
    values = np.repeat(noisy_grasp(clipped=False), 3, axis=0)
    hung = np.concatenate([values[:600], np.repeat(values[599:600], 90, axis=0), values[600:]])
    deduplicator, _ = deduplicated(np.arange(990) / 90.0, hung)
    assert deduplicator.counts.gaps == 1
    assert deduplicator.counts.longest_gap_s == pytest.approx(93 / 90, abs=0.02)


def test_a_slower_rate_is_not_a_gap_for_ever() -> None:
    t_s = np.concatenate([np.arange(100) / 100, 1 + np.arange(1, 101) / 10])
    deduplicator, _ = deduplicated(t_s, noisy_grasp(200, clipped=False))
    assert 1 <= deduplicator.counts.gaps <= 8


def test_jitter_is_no_gap() -> None:
    t_s = np.cumsum(np.random.default_rng(0).uniform(0.02, 0.045, 300))
    deduplicator, _ = deduplicated(t_s, noisy_grasp(clipped=False))
    assert deduplicator.counts.gaps == 0
    assert deduplicator.counts.step_s == pytest.approx(float(np.diff(t_s).mean()))
    assert deduplicator.counts.step_std_s == pytest.approx(float(np.diff(t_s).std()))


def test_conditioned_scans_are_the_same_however_a_stream_with_repeats_and_gaps_comes() -> None:
    t_s, values = logged(noisy_grasp(clipped=False), 3)
    t_s[400:] += 2.0
    one, _ = conditioned(values, PALM, mode="stream", t_s=t_s)
    other, _ = conditioned(values, PALM, mode="stream", t_s=t_s, cuts=range(0, 900, 7))
    assert_same(one, other)
