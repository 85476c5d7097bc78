from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from costly import mostly_long
from synthetic import dome, grid_sensor
from taxelflow.condition.parameters import Conditioner
from taxelflow.messages import Bools, cut, joined
from taxelflow.pipeline import api
from taxelflow.sensors.pads import Group, Pad, Patch
from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats, Scans

PALM = grid_sensor(4, 7, axes=3, shear=("x", "y"))
OFFSET = 300.0


def grasp(sensor: Sensor = PALM, pads: int = 1) -> tuple[Floats, Floats]:
    """Pressure and shear of 30 idle scans, 30 in contact, 20 idle: (scans, taxels) and (scans, taxels, 2)."""
    random, taxels = np.random.default_rng(0), sensor.layout.taxels
    values, touched = random.normal(0, 100, (80, taxels)), slice(30, 60)
    for pad in range(pads):
        values[touched] += dome(sensor, pad=pad)
    shear = OFFSET + random.normal(0, 10, (80, taxels, 2))
    shear[touched] += np.array([4000.0, -2000.0])
    return values, shear


def recorded(shear: Floats | None = None, sensor: Sensor = PALM, pads: int = 1) -> Recording:
    values, own = grasp(sensor, pads)
    return api.recording(np.arange(80) / 10, values, sensor, shear=own if shear is None else shear)


def conditioned(recording: Recording, size: int = 80, mode: str = "stream", **parameters: Any) -> Scans:
    whole, off = recording.load(), np.zeros(recording.layout.taxels, dtype=np.bool_)
    session = Conditioner(**parameters).start(recording.sensor, off, [whole] if mode == "batch" else None)
    edges = [*range(0, len(whole), size), len(whole)]
    parts = [scans for edge in pairwise(edges) for scans in session.step(cut(whole, *edge))]
    return joined([*parts, *session.finish()])


def shear_of(scans: Scans) -> Floats:
    assert scans.shear is not None
    return scans.shear


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_the_mean_of_idle_scans_is_taken_off(mode: str) -> None:
    scans = conditioned(recorded(), mode=mode)
    touched = scans.contact[:, 0]
    assert touched.sum() == pytest.approx(30, abs=1)
    np.testing.assert_allclose(shear_of(scans)[touched].mean(axis=(0, 1)), [4000, -2000], atol=5)
    np.testing.assert_allclose(shear_of(scans)[~touched].mean(axis=(0, 1)), 0, atol=5)


def test_a_pad_that_was_never_idle_and_one_that_is_not_tared_keep_their_numbers() -> None:
    values, shear = grasp()
    loaded = api.recording(np.arange(30) / 10, values[30:60], PALM, shear=shear[30:60])
    np.testing.assert_array_equal(shear_of(conditioned(loaded)), shear[30:60])
    np.testing.assert_array_equal(shear_of(conditioned(recorded(), tare="none")), shear)


def test_each_pad_has_its_own_offset() -> None:
    two = grid_sensor(4, 7, pads=2, axes=3, shear=("x", "y"))
    scans = conditioned(recorded(sensor=two))
    touched = scans.contact[:, 0]
    assert not scans.contact[:, 1].any()
    assert shear_of(scans)[touched][:, :28].mean(axis=(0, 1))[0] == pytest.approx(4000, abs=5)
    idle = 4000 * np.mean(30 / (30 + np.arange(1, 31)))  # what a mean that follows leaves
    assert shear_of(scans)[touched][:, 28:, 0].mean() == pytest.approx(idle, rel=0.02)


@pytest.mark.parametrize("size", mostly_long([1, 2, 7, 19, 31, 64], 7))
def test_the_blocks_do_not_matter(size: int) -> None:
    np.testing.assert_array_equal(shear_of(conditioned(recorded(), size)), shear_of(conditioned(recorded())))


def test_a_missing_number_and_a_masked_taxel_read_0_and_spoil_no_mean() -> None:
    _, shear = grasp()
    holed = shear.copy()
    holed[10, 3, 1] = holed[40, 5, 0] = np.nan
    scans = conditioned(recorded(holed), mask="7")
    clean = shear_of(conditioned(recorded(), mask="7"))
    assert shear_of(scans)[10, 3, 1] == shear_of(scans)[40, 5, 0] == 0.0
    assert (shear_of(scans)[:, 7] == 0.0).all()
    np.testing.assert_allclose(shear_of(scans)[59], clean[59], atol=2)


def test_filters_delay_shear_as_they_do_pressure() -> None:
    values, _ = grasp()
    shear = np.stack([values, 2 * values], axis=2)
    parameters = {"tare": "none", "lowpass_hz": 1.0, "median_scans": 3}
    scans = conditioned(recorded(shear), **parameters)
    np.testing.assert_allclose(shear_of(scans)[..., 0], scans.pressure, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(shear_of(scans)[..., 1], 2 * scans.pressure, rtol=1e-9, atol=1e-9)


def test_units_are_those_of_pressure() -> None:
    scans = conditioned(recorded(sensor=grid_sensor(4, 7, unit="kPa", axes=3, shear=("x", "y"))), tare="none")
    np.testing.assert_allclose(shear_of(scans), 1e3 * grasp()[1], rtol=1e-12)


def test_a_duplicate_scan_takes_its_shear_along() -> None:
    values, shear = grasp()
    twice: Bools = np.repeat(np.arange(80), 2)
    recording = api.recording(np.arange(160) / 20, values[twice], PALM, shear=shear[twice])
    once = conditioned(recording, mode="batch")
    assert len(once) < 110
    touched = once.contact[:, 0]
    np.testing.assert_allclose(shear_of(once)[touched].mean(axis=(0, 1)), [4000, -2000], atol=5)


def test_a_group_across_pads_has_its_own_frame() -> None:
    pads = [
        Pad(name=name, rows=4, cols=7, pitch_m=(0.01, 0.01), origin_m=(x, 0.0), angle_rad=turn)
        for name, x, turn in (("a", 0.0, 0.0), ("b", 0.1, np.pi / 2))
    ]
    group = Group(name="g", patches=(Patch(pad="a"), Patch(pad="b")))
    sensor = Sensor(name="two", unit="Pa", pads=tuple(pads), groups=(group,), axes=3, shear=("x", "y"))
    scans = conditioned(recorded(sensor=sensor, pads=2), tare="none")
    shear = shear_of(scans)
    own, other = shear[:, 56:84], shear[:, 84:]
    np.testing.assert_allclose(own, shear[:, :28])
    np.testing.assert_allclose(other, np.stack([-shear[:, 28:56, 1], shear[:, 28:56, 0]], axis=2))


def test_sensors_without_shear_have_none() -> None:
    plain = api.recording(np.arange(80) / 10, grasp()[0], grid_sensor(4, 7))
    assert plain.load().shear is None
    assert conditioned(plain).shear is None
