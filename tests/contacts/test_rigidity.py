from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from costly import mostly_long
from rigged import rigged
from synthetic import conditioned, dome, grid_sensor
from taxelflow.condition.parameters import Conditioner
from taxelflow.contacts.rigidity import RigidityMonitor
from taxelflow.messages import AMBIGUOUS, OK, UNRESOLVED, cut
from taxelflow.pipeline import api
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Bools


def watched(recording: Recording) -> tuple[Bools, RigidityMonitor]:
    conditioner = Conditioner()
    session = conditioner.start(recording.sensor, recording.masked, None)
    watch = RigidityMonitor(recording.sensor.layout, conditioner.contact_on, conditioner.contact_off)
    scans = [scans for raw in recording.blocks() for scans in session.step(raw)]
    return np.concatenate([watch.step(block) for block in scans]), watch


def test_objects_that_pass_each_other_are_noted_with_the_option_to_use() -> None:
    parted, watch = watched(simulate(rigged("two-contacts", sensing={"rate_hz": 25.0})))
    assert parted[:, 0].any()
    assert not parted[:40].any()  # not before they move
    assert not parted[-5:].any()  # nor after both are gone
    (note,) = watch.notes
    assert note.startswith("grid: contacts moved apart or together by ")
    assert note.endswith(
        f"mm, which feet of one rigid object do not: {np.count_nonzero(parted[:, 0])} scans without an ok pose; if "
        "they move independently, --contacts grid=2 separates them"
    )


@pytest.mark.parametrize(
    "name", mostly_long(["feet-lift", "turn-over-hand", "slide-and-turn-over-hand", "stick-slip", "tilt"], "tilt")
)
def test_feet_of_a_rigid_object_are_not(name: str) -> None:
    parted, watch = watched(simulate(rigged(name)))
    assert not parted.any()
    assert watch.notes == []


@pytest.mark.parametrize(
    ("name", "seed", "changes"),
    [
        ("feet-on-grid", 2, {"load": {"kind": "cycles", "multiples": (0.4, 2.0), "growth": 0.3}}),
        *mostly_long(
            [
                ("feet-on-grid", 1, {"motion": {"middle_m": (0.012, 0.004)}}),  # over the border
                ("feet-on-grid", 0, {"contact": {"feet": 5, "radius_m": 0.004, "ring_m": 0.014}}),  # too many
                ("feet-on-grid", 0, {}),
                ("feet-on-grid", 0, {"load": {"tilt": 0.6}}),
                ("stick-slip-feet", 0, {"sensing": {"rate_hz": 25.0}}),
                ("feet-lift", 0, {"sensing": {"noise_pa": 3000.0}}),
            ]
        ),
    ],
)
def test_feet_that_merge_part_leave_grow_or_lift_are_not(name: str, seed: int, changes: dict[str, Any]) -> None:
    parted, watch = watched(simulate(rigged(name, seed=seed, **changes)))
    assert not parted.any()
    assert watch.notes == []


@pytest.mark.parametrize("seed", mostly_long(range(3), 0))
def test_objects_that_come_together_are_noted(seed: int) -> None:
    parted, watch = watched(simulate(rigged("two-contacts-meet", seed=seed, sensing={"rate_hz": 25.0})))
    assert parted[:, 0].any()
    assert len(watch.notes) == 1


def test_a_foot_that_lifts_and_another_that_comes_down_are_no_one_that_moved() -> None:
    sensor = grid_sensor(12, 20, pitch_m=(0.004, 0.004))
    at_m = {"still": -0.024, "first": 0.002, "next": 0.0125}
    load = {foot: dome(sensor, x, 0.0, radius_m=0.002, peak=50e3) for foot, x in at_m.items()}
    rows = [np.zeros(240)] * 12 + [load["still"] + load["first"]] * 20 + [load["still"] + load["next"]] * 20
    values = np.array(rows) + np.random.default_rng(0).normal(0, 100.0, (52, 240))
    scans, _ = conditioned(values, sensor, mode="stream")
    watch = RigidityMonitor(sensor.layout, Conditioner.contact_on, Conditioner.contact_off)
    assert not watch.step(scans).any()
    assert watch.notes == []


@pytest.mark.parametrize(("grown", "is_noted"), [(1.15, True), (1.4, False), (0.7, False)])
def test_a_contact_that_grows_or_shrinks_as_it_goes_has_no_distance(grown: float, is_noted: bool) -> None:
    sensor = grid_sensor(10, 20, pitch_m=(0.004, 0.004))
    share = np.concatenate([np.zeros(12), np.linspace(0.0, 1.0, 10), np.ones(8)])
    other = [dome(sensor, 0.008 + 0.008 * s, radius_m=0.003 * grown**s) for s in share]
    rows = [np.zeros(200)] * 12 + [dome(sensor, -0.018, radius_m=0.003) + one for one in other]
    values = np.array(rows) + np.random.default_rng(0).normal(0, 100.0, (42, 200))
    scans, _ = conditioned(values, sensor, mode="stream")
    watch = RigidityMonitor(sensor.layout, Conditioner.contact_on, Conditioner.contact_off)
    assert watch.step(scans).any() == is_noted
    assert len(watch.notes) == is_noted


@pytest.mark.long
def test_feet_turned_and_slid_are_not_whatever_the_noise() -> None:
    contact = {"shape": "feet", "radius_m": 0.005, "ring_m": 0.014, "feet": 3}
    motion = {"kind": "strokes", "travel_m": 0.02, "speed_m_s": 0.01, "turn_rad_s": 0.4, "middle_m": (0.0, 0.0)}
    for noise_pa in (100.0, 3000.0):
        sensing = {"rate_hz": 25.0, "noise_pa": noise_pa}
        parted, _ = watched(simulate(rigged("stick-slip", contact=contact, motion=motion, sensing=sensing)))
        assert not parted.any(), noise_pa


def test_a_pad_is_checked_without_a_note_where_its_contacts_are_separated() -> None:
    recording = simulate(rigged("two-contacts", motion={"strokes": 1}, sensing={"rate_hz": 25.0}))
    alone, _ = watched(recording)
    parted, watch = watched(recording.with_contacts(2))
    assert alone.any()
    np.testing.assert_array_equal(parted[:, 0], alone[:, 0])
    assert not parted[:, 1:].any()
    assert watch.notes == []


@pytest.mark.long
@pytest.mark.parametrize("method", ["lnorm", pytest.param("template", marks=pytest.mark.long)])
def test_no_pose_is_ok_after_contacts_have_moved_apart_on_a_pad_that_is_taken_for_one(method: str) -> None:
    recording = simulate(rigged("two-contacts", motion={"strokes": 1}, sensing={"rate_hz": 25.0}))
    parted, _ = watched(recording)
    result = api.estimate(recording, method, mode="stream")
    quality = result.slips.quality[:, 0]
    assert not (quality[parted[:, 0]] == OK).any()
    assert set(np.unique(quality[parted[:, 0]])) & {UNRESOLVED, AMBIGUOUS}
    assert any("--contacts grid=2" in note for note in result.summary.notes)
    separated = api.estimate(recording, method, mode="stream", contacts={"grid": 2})
    np.testing.assert_array_equal(separated.slips.quality[:, 0], quality)
    assert (separated.slips.quality[parted[:, 0], 1:] == OK).mean() > 0.3
    assert not any("--contacts" in note for note in separated.summary.notes)


@pytest.mark.parametrize(
    ("name", "noise_pa"),
    mostly_long(
        [("two-contacts", 200.0), ("feet-on-grid", 200.0), ("feet-lift", 3000.0), ("stick-slip-feet", 3000.0)],
        ("feet-on-grid", 200.0),
    ),
)
def test_pads_with_one_contact_again_are_tracked_as_by_the_whole_check(name: str, noise_pa: float) -> None:
    recording = simulate(rigged(name, sensing={"rate_hz": 25.0, "noise_pa": noise_pa}))
    conditioner = Conditioner()
    session = conditioner.start(recording.sensor, recording.masked, None)
    quick, whole = (
        RigidityMonitor(recording.sensor.layout, conditioner.contact_on, conditioner.contact_off) for _ in range(2)
    )
    alone = []
    for raw in recording.blocks():
        for scans in session.step(raw):
            for scan in range(len(scans)):
                whole._single = False
                block = cut(scans, scan, scan + 1)
                np.testing.assert_array_equal(quick.step(block), whole.step(block))
                alone.append(quick._single)
                assert states(quick) == states(whole)
    assert any(np.diff(np.array(alone, dtype=int)) > 0)  # it was alone again after several


def states(monitor: RigidityMonitor) -> list[object]:
    """What the next scans depend on."""
    tracker = monitor._tracker
    assert tracker is not None
    tracks, labels = tracker._memory.tracks, tracker._memory.taxels["label"]
    ages = [tracks[name].tolist() for name in ("age", "parted_scans", "peakless_scans")]
    return [ages, labels.tolist(), monitor._memory.pairs.tolist(), monitor._memory.pads["moved_apart"].tolist()]
