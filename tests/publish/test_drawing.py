from __future__ import annotations

import re
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest

from synthetic import grid_sensor
from tabled import arched, hexagonal, table_sensor
from taxelflow.publish.drawing import draw_sensor
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.hand import HandModelInvalid
from taxelflow.sensors.pads import Group, Patch

if TYPE_CHECKING:
    from taxelflow.sensors.sensor import Sensor

Capture = pytest.CaptureFixture[str]


def drawn(capsys: Capture, sensor: Sensor) -> str:
    draw_sensor(sensor)
    return capsys.readouterr().out


def test_a_hexagonal_pad_is_drawn_as_it_lies(capsys: Capture) -> None:
    said = drawn(capsys, table_sensor(hexagonal(1)))
    rows = [line.split() for line in said.splitlines() if re.fullmatch(r"[ \d]+", line) and line.strip()]
    assert [len(row) for row in rows] == [2, 3, 2]
    assert "7 taxels in 1 pad, Pa" in said
    assert "7 taxels, 5 mm apart" in said


def test_every_taxel_is_drawn_once_and_those_to_the_right_stand_to_the_right(capsys: Capture) -> None:
    places = np.random.default_rng(8).uniform(0, 0.02, (30, 2))
    said = drawn(capsys, table_sensor(places))
    lines = [line for line in said.splitlines() if re.fullmatch(r"[ \d]+", line) and line.strip()]
    assert sorted(int(n) for line in lines for n in line.split()) == list(range(30))
    for line in lines:
        x = [places[int(n), 0] for n in line.split()]
        assert x == sorted(x)


def test_what_is_too_wide_to_draw_is_listed(capsys: Capture) -> None:
    places = np.array([[0.0, 0.0], [0.001, 0.0005], [0.001, -0.0005], [0.5, 0.0]])
    assert "3: (500.0, 0.0) mm" in drawn(capsys, table_sensor(places))


def test_a_curved_pad_reports_its_stretch(capsys: Capture) -> None:
    assert "laid flat, neighbours within 0.0 %" in drawn(capsys, table_sensor(arched(3, 4, 0.01)[1]))
    assert "laid flat, neighbours within 9.9 %" in drawn(capsys, load_sensor("icub-fingertip-12"))


def test_the_wiring_is_described_where_it_is_not_plain(capsys: Capture) -> None:
    assert "the source sends" not in drawn(capsys, grid_sensor(2, 2))
    said = drawn(capsys, grid_sensor(2, 2, axes=3, normal="x", offset=9.0, gain=(1.0, 2.0, 1.0, 1.0)))
    assert "the source sends 12 numbers a scan, 3 per taxel, of which x is normal to the skin" in " ".join(said.split())
    assert "9 without load, more under load, with a gain for each taxel" in " ".join(said.split())
    assert "255 without load, less under load" in " ".join(drawn(capsys, load_sensor("icub-fingertip-12")).split())
    assert "in an order of its own" in drawn(capsys, load_sensor("barretthand-bh280-96"))


def test_a_group_of_a_table_lists_its_taxels(capsys: Capture) -> None:
    group = Group(name="rim", patches=(Patch(pad="pad0", taxels=(0, 1, 4)),))
    assert "rim  group of 3 taxels of pad0\n0 1 4\n" in drawn(capsys, table_sensor(hexagonal(1), groups=(group,)))


def test_the_joints_of_a_hand_are_named_and_its_links_checked(capsys: Capture) -> None:
    sensor = load_sensor("barretthand-162")
    assert "a hand with the joints spread, f1, f2, f3" in drawn(capsys, sensor)
    pads = (msgspec.structs.replace(sensor.pads[0], link="thumb"), *sensor.pads[1:])
    with pytest.raises(HandModelInvalid, match="it has no link 'thumb'"):
        draw_sensor(msgspec.structs.replace(sensor, pads=pads))
