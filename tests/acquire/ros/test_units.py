from __future__ import annotations

import json
from typing import Any

import pytest

from taxelflow.acquire.devices.base import Faults
from taxelflow.acquire.devices.rosbridge import RosbridgeParser
from taxelflow.acquire.ros.kinds import KINDS
from taxelflow.acquire.ros.units import in_unit_of
from taxelflow.sensors.catalogue import load_sensor

SDH2 = load_sensor("schunk-sdh2")
PRESSURES = "schunk_sdh/PressureArrayList"


@pytest.mark.parametrize("url", ["ros2:/touch", "rosbridge://127.0.0.1:1/touch"])
def test_a_topic_of_pressures_is_in_pascals(url: str) -> None:
    """The named built-in sensor is in counts: estimates would be off by its scale."""
    from taxelflow.runtime import registry
    from taxelflow.runtime.addresses import parse_address

    address = parse_address(f"{url}?type={PRESSURES}")
    sensor = registry.find("source", address.scheme)(address, SDH2).recording.sensor
    assert (sensor.unit, sensor.to_si) == ("Pa", 1.0)
    assert sensor.full_scale == pytest.approx(4095 * 0.79885)


def test_a_type_that_is_known_too_late_for_its_unit_is_asked_for() -> None:
    faults = Faults()
    parser = RosbridgeParser(SDH2, None, faults, timed=True)
    answer = {"op": "service_response", "values": {"type": PRESSURES}}
    scan: dict[str, Any] = {"op": "publish", "msg": {"pressure_list": []}}
    assert [parser.feed(json.dumps(message).encode()) for message in (answer, scan)] == [[], []]
    assert faults.counts == {"bad message": 1}


def test_other_messages_and_sensors_keep_their_unit() -> None:
    for kind in KINDS:
        assert in_unit_of(kind, load_sensor("grid-16x16")) == load_sensor("grid-16x16")
    raw = next(kind for kind in KINDS if "schunk_sdh/msg/TactileSensor" in kind.types)
    assert in_unit_of(raw, SDH2) == SDH2
