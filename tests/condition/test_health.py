from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from costly import mostly_long
from synthetic import conditioned, dome, grid_sensor, recorded
from taxelflow.condition.parameters import Conditioner
from taxelflow.pipeline.api import estimate, read
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.condition.health import Finding
    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Floats

PALM = grid_sensor(8, 10, full_scale=140e3)
BAD = 44
both_modes = pytest.mark.parametrize("mode", ["batch", "stream"])


def wandering(scans: int = 1200, *, clipped: bool = False) -> Floats:
    """Idle, then a dome that goes round and round over the bad taxel's place, twice lifted off."""
    random = np.random.default_rng(0)
    angle = np.arange(scans) / 15
    place = 0.008 * np.stack([np.cos(angle), np.sin(angle)], axis=1) + np.array([-0.005, -0.005])
    values = np.array([dome(PALM, x, y, radius_m=0.018) for x, y in place])
    lifted = (np.arange(scans) % 400) < 100
    values[lifted] = 0
    values += random.normal(0, 100, values.shape)
    return np.where(values > 600, values, 0.0) if clipped else values


def faulty(fault: str, *, clipped: bool = False) -> Floats:
    values = wandering(clipped=clipped)
    random = np.random.default_rng(1)
    if fault == "dead":
        values[:, BAD] = 0.0
    elif fault == "stuck":
        values[:, BAD] = 30e3
    elif fault == "noisy":
        values[:, BAD] += random.normal(0, 3000, len(values))
    elif fault == "offset":
        values[:, BAD] += 20e3 + random.normal(0, 100, len(values))
    elif fault == "weak":
        values[:, BAD] *= 0.1
    elif fault == "strong":
        values[:, BAD] *= 6.0
    elif fault == "silent":
        values[::2, BAD] = np.nan
        values[1::4, BAD] = np.nan
    return values


def found_in(values: Floats, mode: str = "batch", **parameters: str) -> tuple[Finding, ...]:
    _, session = conditioned(values, PALM, mode=mode, **parameters)
    assert session.baseline is not None
    return session.baseline.findings


@both_modes
@pytest.mark.parametrize("clipped", mostly_long([False, True], True))
@pytest.mark.parametrize(
    ("fault", "name", "value"),
    [
        ("dead", "stuck", 0.0),
        ("stuck", "stuck", 30e3),
        ("offset", "offset", 20e3),
        ("weak", "gain", 0.1),
        ("strong", "gain", 6.0),
        ("silent", "silent", 0.75),
    ],
)
def test_a_bad_taxel_is_found_with_the_evidence(fault: str, name: str, value: float, mode: str, clipped: bool) -> None:
    findings = found_in(faulty(fault, clipped=clipped), mode)
    assert [(finding.taxel, finding.fault) for finding in findings] == [(BAD, name)]
    assert findings[0].value == pytest.approx(value, rel=0.3, abs=1.0 if value == 0.0 else 0.0)
    assert findings[0].scans >= 24


@both_modes
def test_a_noisy_taxel_is_found_with_its_ratio(mode: str) -> None:
    findings = found_in(faulty("noisy"), mode)
    assert [(finding.taxel, finding.fault) for finding in findings] == [(BAD, "noisy")]
    assert findings[0].value == pytest.approx(3000, rel=0.3)
    assert findings[0].ratio is not None
    assert 6 < findings[0].ratio < 60


@both_modes
@pytest.mark.parametrize("clipped", [False, True])
def test_nothing_is_found_where_all_is_well(clipped: bool, mode: str) -> None:
    assert found_in(wandering(clipped=clipped), mode) == ()


@pytest.mark.parametrize(("travel_m", "found"), [(0.03, [BAD]), (0.005, [])])
def test_under_a_flat_object_a_taxel_that_reads_noise_is_found_once_it_slides(
    travel_m: float, found: list[int]
) -> None:
    """Its largest reading is anywhere: only its centre shows that it moves, and that no hole of it is there."""
    layout, random = PALM.layout, np.random.default_rng(0)
    x_m = layout.x_m[BAD] + np.linspace(-0.5, 0.5, 300) * travel_m
    reach = np.maximum(np.abs(layout.x_m - x_m[:, np.newaxis]), np.abs(layout.y_m - layout.y_m[BAD]))
    values = 20e3 * np.clip((0.03 - reach) / 0.01, 0.0, 1.0)
    values[:100] = 0.0
    values[:, BAD] = 0.0
    values += random.normal(0, 100, values.shape)
    assert [finding.taxel for finding in found_in(values)] == found


def test_a_still_contact_is_no_fault() -> None:
    random = np.random.default_rng(0)
    pin = dome(PALM, 0.005, 0.005, radius_m=0.004)
    ring = dome(PALM, radius_m=0.025) - 0.999 * dome(PALM, radius_m=0.012)
    for shape in (pin, ring, dome(PALM)):
        values = random.normal(0, 100, (600, 80))
        values[200:] += shape
        assert found_in(values) == ()


@both_modes
@pytest.mark.parametrize(("offset", "found"), [(0.0, []), (20e3, [BAD])])
def test_a_taxel_that_a_held_object_hardly_leaves_is_a_fault_only_if_it_rests_elsewhere(
    offset: float, found: list[int], mode: str
) -> None:
    values = np.random.default_rng(0).normal(0, 100, (600, 80))
    values[40:, BAD] += 50e3
    values[:, BAD] += offset
    values[40:530, BAD + 12] += 20e3  # what else the object loads, in less than nine of ten scans each
    values[530:, BAD + 2] += 20e3
    findings = found_in(values, mode)
    assert [finding.taxel for finding in findings] == found
    assert [finding.fault for finding in findings] == ["offset"] * len(found)
    assert [finding.value for finding in findings] == pytest.approx([offset] * len(found), rel=0.01)


def test_an_idle_recording_shows_no_faults() -> None:
    assert found_in(np.random.default_rng(0).normal(0, 100, (600, 80))) == ()
    assert found_in(np.zeros((600, 80))) == ()


@pytest.mark.parametrize("name", ["stroke", "turn", "press", "tilt", "roll"])
def test_nothing_is_found_in_the_rigs_scenarios(name: str) -> None:
    recording = simulate(SCENARIOS[name])
    session = Conditioner().start(recording.sensor, recording.masked, recording.blocks())
    assert session.baseline is not None
    assert session.baseline.findings == ()


@pytest.mark.long
def test_nothing_is_found_in_real_recordings_until_a_taxel_is_broken(recordings: Path) -> None:
    for file in sorted((recordings / "sdh-dsa").glob("*.dsa")):
        recording = read(file)
        session = Conditioner().start(recording.sensor, recording.masked, recording.blocks())
        assert session.baseline is not None
        assert session.baseline.findings == ()
        assert session.lookahead_counts is not None
        assert (session.lookahead_counts.repeated, session.lookahead_counts.gaps) == (0, 0)
    raw = read(recordings / "sdh-dsa" / "tennisball.dsa")
    values = raw.load().values
    for level in (0.0, 1500.0):
        broken = values.copy()
        broken[:, 142] = level
        session = Conditioner().start(raw.sensor, raw.masked, recorded(broken, raw.sensor).blocks())
        assert session.baseline is not None
        assert [(finding.taxel, finding.fault) for finding in session.baseline.findings] == [(142, "stuck")]


# Masks


def test_by_default_a_bad_taxel_is_reported_and_used() -> None:
    result = estimate(recorded(faulty("offset"), PALM), method="lnorm")
    assert result.summary.masked_taxels == []
    note = next(note for note in result.summary.notes if "faulty" in note)
    assert f"taxel {BAD} (pad0, row 4, col 4) rests at 1.999e+04 Pa" in note
    assert "--condition.mask auto" in note


def test_auto_masks_what_it_finds_and_reports_it() -> None:
    result = estimate(recorded(faulty("offset")[:500], PALM), method="lnorm", condition=Conditioner(mask="auto"))
    assert result.summary.masked_taxels == [BAD]
    assert any(note.startswith(f"masked: taxel {BAD}") for note in result.summary.notes)
    assert not any("faulty" in note for note in result.summary.notes)


@pytest.mark.parametrize("mode", mostly_long(["batch", "stream"], "batch"))
def test_a_taxel_stuck_at_a_load_is_masked_so_that_the_pad_is_tared_and_let_go(mode: Mode) -> None:
    values = faulty("stuck")[:500]
    scans, session = conditioned(values, PALM, mode=mode)
    assert session.baseline is not None
    assert session.baseline.tared.all()
    assert np.flatnonzero(session.baseline.masked).tolist() == [BAD]
    assert [(finding.taxel, finding.fault) for finding in session.baseline.findings] == [(BAD, "stuck")]
    assert not scans.contact[410:490].any()
    result = estimate(recorded(values, PALM), method="lnorm", mode=mode)
    assert any(note.startswith(f"masked: taxel {BAD} (pad0, row 4, col 4) stuck") for note in result.summary.notes)


@pytest.mark.parametrize("level", [0.0, 140e3])
def test_a_taxel_that_may_be_clipped_is_not_masked(level: float) -> None:
    """One that reads nothing may be unloaded, one at full scale may be pressed: neither is surely stuck."""
    values = np.maximum(wandering(), 0.0)
    values[:, BAD] = level
    _, session = conditioned(values, PALM)
    assert session.baseline is not None
    assert [finding.fault for finding in session.baseline.findings] == ["stuck"]
    assert not session.baseline.masked.any()


def test_a_list_masks_what_it_names() -> None:
    scans, session = conditioned(wandering(), PALM, mask="3, 44")
    assert np.flatnonzero(scans.noise == 0).tolist() == [3, 44]
    assert (scans.pressure[:, [3, 44]] == 0).all()
    assert session.baseline is not None
    assert np.flatnonzero(session.baseline.masked).tolist() == [3, 44]


@pytest.mark.long
def test_a_stream_masks_once_it_knows_and_invents_no_motion_then() -> None:
    values = wandering(800)
    values[:, BAD] = 40e3
    values[0:100] += 0.0
    still = values.copy()
    still[100:] = still[150]
    still[:, :BAD] += np.random.default_rng(2).normal(0, 100, still[:, :BAD].shape)
    still[:, BAD + 1 :] += np.random.default_rng(3).normal(0, 100, still[:, BAD + 1 :].shape)
    result = estimate(recorded(still, PALM), mode="stream", condition=Conditioner(mask="auto"))
    assert result.summary.masked_taxels == [BAD]
    moved = result.slips.displacement[110:, 0, :2]
    assert np.nanmax(np.abs(moved)) < 0.001


@pytest.mark.long
def test_masks_of_a_stream_do_not_depend_on_how_it_is_cut() -> None:
    values = faulty("stuck")
    one, _ = conditioned(values, PALM, mode="stream", mask="auto")
    other, _ = conditioned(values, PALM, mode="stream", mask="auto", cuts=range(0, 1200, 17))
    np.testing.assert_array_equal(one.pressure, other.pressure)
    np.testing.assert_array_equal(one.complete, other.complete)
