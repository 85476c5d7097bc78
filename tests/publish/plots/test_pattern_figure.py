from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from rigged import svg_words
from synthetic import dome, grid_sensor
from tabled import hexagonal, table_sensor
from taxelflow.messages import LearnedPattern
from taxelflow.publish.plots.pattern import Contact, pattern_figure
from taxelflow.publish.plots.patterns import patterns_figure
from taxelflow.publish.plots.style import save, styled

if TYPE_CHECKING:
    from pathlib import Path

SENSOR = grid_sensor(6, 8)


@pytest.fixture
def contact() -> Contact:
    x, y = np.linspace(-0.03, 0.03, 40), np.linspace(-0.02, 0.02, 30)
    u, v = np.meshgrid(x, y)
    pressure = 50e3 * np.exp(-(u**2 / 2e-4 + v**2 / 5e-5))
    pressure[:, :3] = np.nan
    pattern = LearnedPattern("pad0", 0.0, 2.0, 20, x, y, pressure, 0.01 * pressure, True, np.zeros(0, np.int64))
    t_s = np.linspace(0.0, 2.0, 20)
    pose = np.stack([0.01 * t_s - 0.01, 0.0 * t_s, 0.4 * t_s], axis=1)
    scan = SENSOR.layout.grid(0, dome(SENSOR))
    return Contact(pattern, "Pa", t_s, pose, np.full((20, 3), 1e-3), t_s < 1.0, 4, scan, 0.4 * t_s, pose)


def words(contact: Contact, path: Path) -> list[str]:
    with styled():
        return svg_words(save(pattern_figure(SENSOR.layout, contact, 0.0), path / "pattern.svg"))


def test_a_pattern_stands_beside_a_scan_its_way_and_its_turn(contact: Contact, tmp_path: Path) -> None:
    seen = words(contact, tmp_path)
    for word in ("one scan", "pattern from 20 scans", "path on the pad", "pressure in kPa", "20 mm", "turn in deg"):
        assert word in seen
    assert {"template", "principal axis", "truth", "quality not ok"} <= set(seen)


def test_the_turn_counts_from_its_first_known_value(contact: Contact) -> None:
    pose = contact.pose.copy()
    pose[:3, 2] = np.nan
    turned = np.array([0.0, 0.0, 0.7])
    moved = replace(contact, pose=pose + turned, axis_rad=0.4 * contact.t_s + 0.7, true=contact.pose + turned)
    with styled():
        turn = pattern_figure(SENSOR.layout, moved, 0.0).axes[-1]
    lines = {line.get_label(): line.get_ydata() for line in turn.lines}
    known = np.degrees(0.4 * (contact.t_s - contact.t_s[3]))
    np.testing.assert_allclose(lines["template"][3:], known[3:], atol=1e-9)
    for name in ("truth", "principal axis"):
        np.testing.assert_allclose(lines[name], known, atol=1e-9)
    low, high = turn.get_ylim()
    assert low < known[0] < known[-1] < high < 50.0


@pytest.mark.long
def test_what_is_not_known_is_not_drawn(contact: Contact, tmp_path: Path) -> None:
    pose = contact.pose.copy()
    pose[:, 2] = np.nan
    bare = replace(contact, pose=pose, axis_rad=None, true=None, scan=None)
    seen = words(bare, tmp_path)
    assert "turn in deg" not in seen
    assert "pattern from 20 scans" in seen
    assert "one scan" not in seen
    assert "pressure in kPa" in seen
    unknown = replace(contact, axis_rad=np.full(20, np.nan), true=None, ok=np.ones(20, dtype=np.bool_))
    assert not {"principal axis", "truth", "quality not ok"} & set(words(unknown, tmp_path))


@pytest.mark.long
def test_counts_stay_counts_and_small_pressures_pascals(contact: Contact, tmp_path: Path) -> None:
    weak = replace(contact.pattern, pressure=1e-2 * contact.pattern.pressure)
    assert "pressure in Pa" in words(replace(contact, pattern=weak), tmp_path)
    assert "pressure in counts" in words(replace(contact, unit="count"), tmp_path)


@pytest.mark.long
def test_the_same_contact_gives_the_same_file(contact: Contact, tmp_path: Path) -> None:
    words(contact, tmp_path)
    first = (tmp_path / "pattern.svg").read_bytes()
    words(contact, tmp_path)
    assert (tmp_path / "pattern.svg").read_bytes() == first


def test_taxels_of_a_table_are_drawn_where_they_lie(contact: Contact) -> None:
    table = table_sensor(hexagonal(2, 0.004))
    image = table.layout.grid(0, np.arange(19.0))
    with styled():
        drawn = pattern_figure(table.layout, replace(contact, scan=image), 0.0).axes[0].collections[0]
    middles = 1e-3 * np.array([path.vertices[:-1].mean(axis=0) for path in drawn.get_paths()])
    np.testing.assert_allclose(middles, np.stack([table.layout.x_m, table.layout.y_m], axis=1), atol=1e-9)


def test_times_of_contacts_count_from_the_first_scan_as_those_of_positions_do(contact: Contact) -> None:
    later = replace(contact, t_s=contact.t_s + 7.0)
    patterns = [replace(contact.pattern, t_first_s=begin) for begin in (7.0, 10.5)]
    with styled():
        title = pattern_figure(SENSOR.layout, later, 5.0).get_suptitle()
        panels = [axis.get_title(loc="left") for axis in patterns_figure(patterns, "Pa", 5.0).axes]
    assert title == "Pattern of the object on pad0, contact of 2.0 s from 2.0 s on"
    assert [panel.split("\n")[1] for panel in panels] == ["2.0 s, 20 scans", "5.5 s, 20 scans"]
