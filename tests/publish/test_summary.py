from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest

import taxelflow
from linked import carried
from synthetic import dome, grid_sensor, recorded
from taxelflow.acquire.joints import asked_joints
from taxelflow.messages import Joints
from taxelflow.pipeline.api import estimate, read
from taxelflow.publish.summary import Summary, to_json
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.acquire.base import Recording

TWO = grid_sensor(4, 7, pads=2)


def test_it_names_recording_and_method(stroke: Recording) -> None:
    summary = estimate(stroke, "lnorm", mode="stream", gain=1.04).summary
    assert summary.taxelflow == taxelflow.__version__
    assert (summary.method, summary.mode, summary.sensor, summary.input) == ("lnorm", "stream", "grid", "memory")
    assert summary.parameters["method"] == {"gain": 1.04}
    assert summary.parameters["condition"]["contact_on"] > summary.parameters["condition"]["contact_off"]
    assert summary.parameters["monitor"]["alarms_per_hour"] == 1.0
    assert (summary.scans, summary.t_first_s, summary.t_last_s) == (80, 0.0, 7.9)


def test_it_adds_up_the_rows(stroke: Recording) -> None:
    result = estimate(stroke)
    pad = result.summary.pads["pad0"]
    assert pad.contact_scans == int(result.slips.contact.sum())
    steps = result.slips.displacement[:, 0, :2]
    np.testing.assert_allclose(
        np.sum([contact.net_m for contact in result.summary.contacts], axis=0), np.nansum(steps, axis=0), rtol=1e-9
    )
    paths = [event.path_m for event in result.events if event.event == "slip_start"]
    assert pad.slip_path_m == pytest.approx(sum(paths))
    assert pad.slips == sum(event.event == "slip_start" for event in result.events)
    border = result.slips.border[:, 0].any(axis=1) & result.slips.contact[:, 0]
    assert pad.border_share == pytest.approx(border.sum() / pad.contact_scans)
    assert sum(result.summary.events.values()) == len(result.events)


def test_a_path_that_the_pad_cannot_observe_is_none() -> None:
    sensor = grid_sensor(6, 1)
    random = np.random.default_rng(0)
    scans = np.array([dome(sensor, y_m=y) for y in np.linspace(-0.01, 0.01, 40)])
    values = np.concatenate([np.zeros((20, 6)), scans]) + random.normal(0.0, 100.0, (60, 6))
    (contact,) = estimate(recorded(values, sensor), "template").summary.contacts
    x, y = contact.net_m
    assert x is None
    assert y == pytest.approx(0.02, abs=0.003)


def test_a_pad_that_was_not_touched_has_no_contact() -> None:
    values = np.array([dome(TWO, x) * (k > 20) for k, x in enumerate(np.linspace(-0.01, 0.01, 60))])
    summary = estimate(recorded(values + np.random.default_rng(0).normal(0, 50, values.shape), TWO)).summary
    assert {contact.pad for contact in summary.contacts} == {"pad0"}
    assert summary.pads["pad1"].slip_path_m == 0


def test_events_that_did_not_happen_are_counted_as_zero(palm: taxelflow.Sensor) -> None:
    summary = estimate(recorded(np.zeros((30, 28)), palm)).summary
    assert summary.events == {"contact": 0, "release": 0, "slip_start": 0, "slip_stop": 0, "slip_suspected": 0}


def test_no_contact_at_all_is_a_result_that_reports_it(palm: taxelflow.Sensor) -> None:
    random = np.random.default_rng(0)
    summary = estimate(recorded(random.normal(0, 100, (200, 28)), palm)).summary
    assert not summary.contact
    assert any("no contact" in note for note in summary.notes)


def test_a_pad_that_was_never_idle_is_named() -> None:
    values = np.array([dome(TWO) + dome(TWO, x, pad=1) * (k > 50) for k, x in enumerate(np.linspace(-0.01, 0.01, 200))])
    summary = estimate(recorded(values + np.random.default_rng(0).normal(0, 50, values.shape), TWO)).summary
    assert [note for note in summary.notes if "pad0" in note and "idle" in note]
    assert not any("pad1" in note for note in summary.notes)


def test_masked_taxels_and_dropped_scans_are_listed(palm: taxelflow.Sensor) -> None:
    t_s = np.arange(30) / 10
    t_s[7] = t_s[6]
    summary = estimate(recorded(np.zeros((30, 28)), palm, t_s, masked=np.arange(28) == 9)).summary
    assert summary.masked_taxels == [9]
    assert summary.repeated_scans_dropped == 1
    assert summary.scans == 29


def test_the_unit_is_counts_only_where_no_scale_is_known() -> None:
    values = np.zeros((20, 28))
    for sensor, unit in (
        (grid_sensor(4, 7, unit="count"), "count"),
        (grid_sensor(4, 7, unit="count", scale_pa=2.0), "Pa"),
        (grid_sensor(4, 7, unit="psi"), "Pa"),
    ):
        assert estimate(recorded(values, sensor)).summary.unit == unit


def test_it_states_the_joint_angles_that_were_used(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    held = read(carried(tmp_path, "held.npz", stays=True))
    assert estimate(held).summary.joints == {"slide": [0.0, pytest.approx(0.0098)]}
    t_s, angles = 0.4 * np.arange(6.0), np.array([[0.1], [0.2], [0.0], [0.1], [0.1], [9.0]])
    longer = replace(held, joints=Joints(("slide", "arm"), t_s, np.hstack([angles, 100 + angles])))
    assert estimate(longer).summary.joints == {"slide": [0.0, pytest.approx(0.2)]}  # scans end at 1.38 s
    sensor = load_sensor("barretthand-162")
    given = replace(recorded(np.zeros((30, 162)), sensor), joints=asked_joints("spread=60deg f1=1.2", sensor))
    known = {"spread": np.radians(60.0), "f1": 1.2, "f2": 0.0, "f3": 0.0}
    assert estimate(given).summary.joints == {name: [angle, angle] for name, angle in known.items()}


def test_without_joint_angles_it_states_none(stroke: Recording) -> None:
    assert estimate(stroke).summary.joints == {}
    arm = replace(stroke, joints=Joints(("arm",), np.zeros(1), np.ones((1, 1))))  # the sensor has no hand
    assert estimate(arm).summary.joints == {}


def test_a_summary_of_an_earlier_version_is_read(stroke: Recording) -> None:
    summary = estimate(stroke).summary
    old = json.loads(to_json(summary))
    del old["joints"]
    assert msgspec.json.decode(json.dumps(old), type=Summary) == summary


def test_it_is_strict_json_that_ends_its_line(stroke: Recording) -> None:
    text = to_json(estimate(stroke).summary).decode()
    assert text.endswith("}\n")

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    whole = json.loads(text, parse_constant=refuse)
    assert whole["pads"]["pad0"]["contact_scans"] == 40
    assert whole["loss"] is None
    assert math.isfinite(whole["pads"]["pad0"]["noise"])
